// SPDX-License-Identifier: MIT
#pragma once

#include <filesystem>
#include <string>

#include <traceur/body/character.hpp>
#include <traceur/io/mjcf.hpp>

/// The examples' character, which what simulates or moves one is timed with.
inline const std::string& humanoid_file() {
  static const std::string path =
      (std::filesystem::path(__FILE__).parent_path() / "../examples/characters/humanoid.xml").string();
  return path;
}

inline const traceur::body::Character& humanoid() {
  static const traceur::body::Character character = traceur::io::read_mjcf(humanoid_file());
  return character;
}
