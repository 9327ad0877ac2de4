// SPDX-License-Identifier: MIT
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include <traceur/io/clip_file.hpp>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  try {
    const traceur::io::LoadedClip loaded = traceur::io::parse_clip(text, "fuzz");
    // What was read comes back bit for bit.
    const std::string written = traceur::io::format_clip(loaded.clip);
    if (traceur::io::format_clip(traceur::io::parse_clip(written, "again").clip) != written) std::abort();
  } catch (const traceur::Error& error) {
    if (std::string_view(error.what()).find('\n') != std::string_view::npos) std::abort();
  }
  return 0;
}
