// SPDX-License-Identifier: MIT
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include <traceur/io/terrain_file.hpp>
#include <traceur/terrain/signed_distance.hpp>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const traceur::terrain::HeightGrid grid =
        traceur::io::parse_terrain(std::string_view(reinterpret_cast<const char*>(data), size), "fuzz");
    // What is accepted can be asked for distances and be written.
    (void)traceur::terrain::surface(grid, traceur::core::Vector3<double>{0.1, 0.2, 0.3});
    (void)traceur::io::terrain_to_json(grid).dump();
  } catch (const traceur::Error& error) {
    if (std::string_view(error.what()).find('\n') != std::string_view::npos) std::abort();
  }
  return 0;
}
