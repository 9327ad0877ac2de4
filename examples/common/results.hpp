// SPDX-License-Identifier: MIT
#pragma once

#include <filesystem>
#include <vector>

#include "traceur/body/character.hpp"
#include "traceur/io/replay.hpp"

namespace example {

/// The humanoid that comes with the examples: in the source tree, or beside an installed program.
std::filesystem::path default_character();

/// The same path from the root on, without dots; an empty one stays empty.
std::filesystem::path absolute_path(const std::filesystem::path& path);

/// Makes the folder and leaves the file as it was: what cannot be written is better found out before hours of work. Throws
/// traceur::Error.
void check_writable(const std::filesystem::path& folder, const std::filesystem::path& file);

/// A character and its motion (nq x frames) as a replay draws them.
traceur::io::ReplayCharacter replay_character(const traceur::body::Character& character);
std::vector<float> replay_poses(const traceur::body::Skeleton& skeleton, const Eigen::MatrixXd& poses);

}  // namespace example
