// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "options.hpp"
#include "trainer.hpp"
#include "traceur/learn/evaluate_locomotion.hpp"

namespace track {

using Movers = traceur::learn::Locomotion<Lane, traceur::core::ThreadExecutor>;

/// One look at a run of the speed task, after a block of updates.
struct SpeedMilestone {
  double samples = 0;
  double score = 0;          ///< task reward of the mean action, in [0, 1]
  double speed_error = 0;    ///< m/s
  double completed = 0;      ///< share of the tests
  double episode_s = 0;      ///< mean length in training
  double real_accuracy = 0, fake_accuracy = 0;  ///< of the discriminator
  double style_reward = 0, task_reward = 0;     ///< of a step in training
  double divergence = 0, explained_variance = 0, policy_rate = 0;
};

/// What a run of the speed task came to.
struct SpeedTraining {
  std::vector<SpeedMilestone> milestones;
  std::vector<std::string> warnings;
  double samples = 0, wall_s = 0, best_score = -1;
};

/// As `train` does, for moving at any speed of a range in the style of the clips: proximal policy optimisation beside
/// adversarial imitation. Throws example::Interrupted, and traceur::Error when a gradient is not finite; what was saved last
/// stands.
SpeedTraining train_speed(const Scene& scene, const Options& options, traceur::learn::ProcessGroup& processes);

/// One episode of the mean action from each of `count` starts, the wanted speeds spread over the range: all of them, then
/// thirds of the range.
std::vector<traceur::learn::SpeedBand> test_speed(const Scene& scene, const Options& options, traceur::learn::Policy<float>& policy,
                                                  int count);

/// The policy asked for one speed after the other, from the slowest to the fastest.
Recording record_speed(const Scene& scene, const Options& options, traceur::learn::Policy<float>& policy);

}  // namespace track
