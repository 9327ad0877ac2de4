// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>

#include "../common/progress.hpp"
#include "options.hpp"
#include "timing.hpp"
#include "trainer.hpp"
#include "traceur/learn/ppo.hpp"
#include "traceur/learn/process_group.hpp"

namespace track {

/// Gives the environments that the settings are for their places among `all`; how many they are. Throws traceur::Error when
/// the processes cannot share all of them out evenly.
template <class Settings>
int take_share(Settings& settings, int all, const traceur::learn::ProcessGroup& processes) {
  const int share = share_of(all, processes);
  settings.first_environment = processes.rank() * share;
  settings.all_environments = all;
  return share;
}

/// How far a run has come of the samples and minutes that it may use up. Processes that share a run make the same calls and
/// are told the same.
class Budget {
public:
  /// Of a run that is already where it begins or goes on from.
  Budget(const Options& options, traceur::learn::Ppo<float>& ppo, const Timing& timing, traceur::learn::ProcessGroup& processes)
      : options_(&options),
        ppo_(&ppo),
        timing_(&timing),
        processes_(&processes),
        line_("learning, thousand samples", thousands(samples()), thousands(options.samples)) {}

  double samples() const { return static_cast<double>(ppo_->samples()); }
  /// Used up, of all.
  double share() const { return samples() / options_->samples; }
  /// Whether there is an update to make.
  bool samples_left() const { return samples() < options_->samples; }
  /// Whether to begin another block of updates: with samples left, and minutes by the clock of the first process.
  bool goes_on() const {
    return samples_left() && !(options_->minutes > 0 && traceur::learn::agreed(*processes_, timing_->seconds()) > 60 * options_->minutes);
  }

  /// After an update: lowers the rate of the policy, tells how it stands, and throws example::Interrupted when the first
  /// process was asked to stop.
  void updated(const char* text) {
    // Steps grow small towards the end, where the policy of the last update is otherwise no better than its neighbours.
    const double left = std::max(0.0, 1 - share());
    ppo_->set_policy_rate(std::min(ppo_->policy_rate(), ppo_->parameters().most_policy_rate * std::clamp(left / 0.3, 0.02, 1.0)));
    line_.tell(thousands(samples()), text);
    if (traceur::learn::agreed(*processes_, example::interruption_asked())) throw example::Interrupted{};
  }

private:
  static int thousands(double count) { return static_cast<int>(count / 1e3); }

  const Options* options_;
  traceur::learn::Ppo<float>* ppo_;
  const Timing* timing_;
  traceur::learn::ProcessGroup* processes_;
  example::ProgressLine line_;
};

}  // namespace track
