// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "kinds.hpp"

namespace terrain_runner {

enum class Command { train, run, evaluate, plot, compare };

/// What the user asked for.
struct Options {
  Command command = Command::run;
  std::filesystem::path gait;       ///< train: a running controller, as perform writes it
  std::filesystem::path skills;     ///< all but train: folder that train wrote
  std::filesystem::path character;  ///< MJCF file
  std::filesystem::path out;        ///< folder of all results
  std::filesystem::path report;     ///< JSON; by default report.json in `out`
  std::uint64_t seed = 1;
  int threads = 0;  ///< 0: all
  bool quick = false;
  bool resume = false;
  bool learn_gait = true;  ///< train: false when the gait is the one that comes with the examples, which is one already
  int courses = 100;    ///< evaluate
  std::int64_t runs = 0;    ///< compare: of each way to explore; 0 for as many as training has
  int obstacles = 2;    ///< of a course
  std::vector<Kind> kinds;  ///< of obstacles
  OfKinds<std::optional<std::array<double, 2>>> heights;  ///< lowest and highest of each kind, m; none: as they were learned
  bool live = false;        ///< run: no faster than real time
  bool ablations = false;   ///< evaluate: each part left out in turn
  bool approach = false;    ///< evaluate: one obstacle from many distances,
  bool running = false;     ///< evaluate: speeds and turns
  int trials = 701;         ///< so many
  std::string simulator = "bundled";
  std::string without;  ///< evaluate: what to leave out: planner, feedback, recovery, blending or interpolation
};

/// Reads the command line. Returns nothing when help was asked for and printed. Throws traceur::Error that names the fault.
std::optional<Options> read_options(int argc, char** argv);

}  // namespace terrain_runner
