// SPDX-License-Identifier: MIT
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include <traceur/io/asf_amc.hpp>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  try {
    // The skeleton comes first, the motion after a line with an exclamation mark.
    const std::size_t cut = text.find("\n!");
    const traceur::io::Asf asf = traceur::io::parse_asf(text.substr(0, cut), "fuzz.asf");
    if (cut == std::string_view::npos) return 0;
    traceur::io::AsfAmcOptions options;
    if (size % 2 == 1) {
      options.unit = 0.05;
      options.up = traceur::io::UpAxis::z;
    }
    traceur::io::parse_amc(text.substr(cut + 2), asf, "fuzz.amc", options).clip.check();
  } catch (const traceur::Error& error) {
    if (std::string_view(error.what()).find('\n') != std::string_view::npos) std::abort();
  }
  return 0;
}
