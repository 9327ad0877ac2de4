// SPDX-License-Identifier: MIT
#pragma once

#include <filesystem>
#include <string>

#include "traceur/body/character.hpp"
#include "traceur/io/load_report.hpp"
#include "traceur/sim/model.hpp"

namespace traceur::io {
struct LoadOptions;
class Safetensors;
}  // namespace traceur::io

namespace example {

// Readers and writers of files, which take a compiler long, compiled once. They throw traceur::Error.

std::string read_file(const std::filesystem::path& path);

/// io::read_mjcf, and what sim::make_model makes of it.
traceur::body::Character read_character(const std::filesystem::path& path);
traceur::sim::Model read_model(const std::filesystem::path& path);

/// io::load_clip.
traceur::io::LoadedClip load_clip(const std::filesystem::path& path);
traceur::io::LoadedClip load_clip(const std::filesystem::path& path, const traceur::io::LoadOptions& options);

/// io::read_safetensors and io::write_safetensors.
traceur::io::Safetensors read_tensors(const std::filesystem::path& path);
void write_tensors(const std::filesystem::path& path, const traceur::io::Safetensors& tensors);

}  // namespace example
