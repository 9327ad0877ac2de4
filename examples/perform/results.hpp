// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <string>

#include "../common/results.hpp"
#include "performer.hpp"

namespace perform {

/// The job's report, filled as the job goes on; written once, at its end.
class Report {
public:
  /// Throws traceur::Error when the report or the results could not be written there.
  Report(const Options& options, const Scene& scene);

  void add(const Preparation& preparation);
  void add(const OpenLoopResult& result);
  void add_hardening(const Learned& learned);
  void add_fine_tuning(const Learned& tuned);
  void add(const TrialResult& trials, const Learned& learned);
  void add(const PushResult& result);
  void add(const Recording& recording);
  /// Writes the report and returns the exit status: a job that got to its end may still have failed its test.
  int write(double wall_s, example::Ending ending);

  /// The numbers that a viewer of the replay wants to see.
  const std::vector<std::pair<std::string, std::string>>& facts() const { return facts_; }

private:
  const Options& options_;
  nlohmann::ordered_json json_;
  std::string failed_test_;
  double simulated_s_ = 0;
  std::vector<std::pair<std::string, std::string>> facts_;
};

/// Writes replay.html and motion.jsonl.
void write_recording(const Options& options, const Scene& scene, const Recording& recording, const Report& report);

/// Writes open_loop.jsonl: the simulated motion of a search.
void write_open_loop(const Options& options, const Scene& scene, const Motion& motion, const SavedSearch& search);

}  // namespace perform
