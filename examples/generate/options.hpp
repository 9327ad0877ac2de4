// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace generate {

/// What the user asked for.
struct Options {
  std::vector<std::filesystem::path> clips;
  std::filesystem::path character;  ///< MJCF file
  std::filesystem::path play;       ///< a generator to use instead of training one
  std::filesystem::path out;        ///< folder of all results
  std::filesystem::path report;     ///< JSON; by default report.json in `out`
  std::string size = "paper";       ///< of the network; or small
  std::string terrain = "boxes";    ///< or walks, stairs
  double relief = 0.4;              ///< m, of boxes and walks, up and down
  int steps = 0;                    ///< of training
  double minutes = 0;               ///< wall time after which training stops early; 0: none
  int batch = 32;                   ///< motions to choose from
  double seconds = 0;               ///< of a motion, at most
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

}  // namespace generate
