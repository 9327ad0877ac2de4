// SPDX-License-Identifier: MIT
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include <nlohmann/json.hpp>

namespace perform {

/// What the user asked for.
struct Options {
  std::filesystem::path clip;        ///< motion file; may be empty when a controller is replayed
  std::filesystem::path character;   ///< MJCF file
  std::filesystem::path terrain;     ///< height grid; empty: the clip's own, or level ground
  std::filesystem::path skeleton;    ///< ASF or DeepMimic character that goes with the clip; empty: found by the reader
  std::filesystem::path joint_map;   ///< empty: joints are recognised by name
  std::filesystem::path controller;  ///< replayed without learning; empty: one is learnt
  std::filesystem::path out;         ///< folder of all results
  std::filesystem::path report;      ///< JSON; by default report.json in `out`
  std::optional<double> unit;        ///< m
  std::optional<double> fps;         ///< frames/s
  std::string up = "detect";         ///< detect, x, y or z
  std::string motion = "auto";       ///< auto, cyclic or once
  std::string feedback = "large";    ///< small (63 numbers a phase) or large (99)
  std::string simulator = "bundled"; ///< what tests, pushes, fine-tuning and the replay run on
  double fine_tune_s = 0;            ///< wall time of learning on that simulator after the controller is had, s
  /// Whether the law goes on learning in worlds that differ. By default that of a gait does once it is learnt, unless the
  /// job is quick.
  std::optional<bool> robust;
  int dt_hz = 240;                   ///< simulation steps a second, a multiple of 60
  std::uint64_t seed = 1;
  int threads = 0;  ///< 0: all
  bool perturb = false;
  bool open_loop = false;  ///< stop after the open-loop search
  bool quick = false;
  bool resume = false;  ///< continue the job in `out`
};

/// Reads the command line; of a job that is resumed, also what it was begun with. Returns nothing when help was asked
/// for and printed. Throws traceur::Error that names the fault.
std::optional<Options> read_options(int argc, char** argv);

/// The options that a job's result depends on, as resumed jobs and reports keep them.
nlohmann::ordered_json job_arguments(const Options& options);

}  // namespace perform
