// SPDX-License-Identifier: MIT
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include <traceur/io/bvh.hpp>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  try {
    // The options decide what a file leaves open, so that every branch is within reach.
    traceur::io::BvhOptions options;
    if (size % 2 == 1) {
      options.unit = 0.01;
      options.up = traceur::io::UpAxis::y;
    }
    const traceur::io::LoadedClip loaded = traceur::io::parse_bvh(text, "fuzz", options);
    loaded.clip.check();
    if (!std::isfinite(loaded.report.fps)) std::abort();
    // What was read can be written and read again.
    traceur::io::parse_bvh(traceur::io::format_bvh(loaded.clip), "again", {0.01, traceur::io::UpAxis::y, 0})
        .clip.check();
  } catch (const traceur::Error& error) {
    if (std::string_view(error.what()).find('\n') != std::string_view::npos) std::abort();
  }
  return 0;
}
