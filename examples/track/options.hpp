// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace track {

/// What the user asked for.
struct Options {
  std::vector<std::filesystem::path> clips;
  std::filesystem::path character;  ///< MJCF file
  std::filesystem::path play;       ///< a policy to test and show instead of learning one
  std::filesystem::path out;        ///< folder of all results
  std::filesystem::path report;     ///< JSON; by default report.json in `out`
  std::string task = "track";       ///< or speed: move as fast as asked, in the clips' style
  std::string reward = "deepmimic"; ///< of tracking; or parc, hil
  double priority_floor = 0.01;     ///< least weight of starts that never fail beside those that always do
  double slowest = 1, fastest = 4;  ///< m/s, of the speed task
  std::string simulator = "bundled";  ///< or another engine's name
  double samples = 0;               ///< to learn from
  double minutes = 0;               ///< wall time after which learning stops early; 0: none
  std::uint64_t seed = 1;
  int threads = 0;  ///< 0: all
  bool quick = false;
  bool resume = false;  ///< go on with the job in `out`
};

/// Reads the command line; of a job that is resumed, also what it was begun with. Returns nothing when help was asked
/// for and printed. Throws traceur::Error that names the fault.
std::optional<Options> read_options(int argc, char** argv);

/// The options that a job's result depends on, as checkpoints and reports keep them.
nlohmann::ordered_json job_arguments(const Options& options);

}  // namespace track
