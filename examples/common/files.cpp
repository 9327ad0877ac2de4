// SPDX-License-Identifier: MIT
#include "files.hpp"

#include <fstream>
#include <sstream>

#include "traceur/io/load_clip.hpp"
#include "traceur/io/mjcf.hpp"
#include "traceur/io/safetensors.hpp"

namespace example {

using namespace traceur;
namespace fs = std::filesystem;

std::string read_file(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  if (!in || !(text << in.rdbuf())) throw Error(path.string() + ": cannot be read");
  return text.str();
}

body::Character read_character(const fs::path& path) { return io::read_mjcf(path); }
sim::Model read_model(const fs::path& path) { return sim::make_model(read_character(path)); }

io::LoadedClip load_clip(const fs::path& path) { return io::load_clip(path); }
io::LoadedClip load_clip(const fs::path& path, const io::LoadOptions& options) { return io::load_clip(path, options); }

io::Safetensors read_tensors(const fs::path& path) { return io::read_safetensors(path); }
void write_tensors(const fs::path& path, const io::Safetensors& tensors) { io::write_safetensors(path, tensors); }

}  // namespace example
