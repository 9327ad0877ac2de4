// SPDX-License-Identifier: MIT
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "progress.hpp"
#include "traceur/body/character.hpp"
#include "traceur/core/error.hpp"
#include "traceur/io/replay.hpp"
#include "traceur/terrain/height_grid.hpp"

namespace example {

/// The humanoid that comes with the examples: in the source tree, or beside an installed program.
std::filesystem::path default_character();

/// The same path from the root on, without dots; an empty one stays empty.
std::filesystem::path absolute_path(const std::filesystem::path& path);

/// Makes the folder and leaves the file as it was: what cannot be written is better found out before hours of work. Throws
/// traceur::Error.
void check_writable(const std::filesystem::path& folder, const std::filesystem::path& file);

/// A number as a person would read it.
std::string rounded(double x, int digits);

/// How a job ended.
struct Ending {
  std::string status = "done";  ///< or "interrupted" or "failed", and then `why`
  std::string why;
};

/// Carries out a job and says how it ended; `resume` is the command that continues it after an interruption, empty where
/// there is none.
template <class Work>
Ending ending_of(const std::string& resume, Work&& work) {
  try {
    work();
  } catch (const Interrupted&) {
    return {"interrupted", resume.empty() ? "" : "go on with: " + resume};
  } catch (const std::exception& e) {
    return {"failed", e.what()};
  }
  return {};
}

/// Completes a report and writes it, says how the job ended, and returns the exit status.
int write_report(const std::filesystem::path& path, nlohmann::ordered_json report, double wall_s, const Ending& ending);

/// What the run of `program` that wrote a safetensors file was asked for. Throws traceur::Error when it was none.
nlohmann::ordered_json saved_arguments(const std::filesystem::path& path, const std::string& program);
/// What to throw when they are not complete.
traceur::Error not_written_by(const std::filesystem::path& path, const std::string& program);

/// Ground as a replay draws it.
traceur::io::ReplayTerrain replay_terrain(const traceur::terrain::HeightGrid& grid);

/// A character and its motion (nq x frames) as a replay draws them.
traceur::io::ReplayCharacter replay_character(const traceur::body::Character& character);
std::vector<float> replay_poses(const traceur::body::Skeleton& skeleton, const Eigen::MatrixXd& poses);

}  // namespace example
