// SPDX-License-Identifier: MIT
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "options.hpp"
#include "traceur/core/pack.hpp"
#include "traceur/learn/evaluate_tracking.hpp"
#include "traceur/learn/policy.hpp"
#include "traceur/learn/ppo_report.hpp"

namespace track {

using Lane = traceur::core::Pack<float>;
using Environments = traceur::learn::Tracking<Lane, traceur::core::ThreadExecutor>;
using Evaluation = traceur::learn::TrackingEvaluation;

/// Who tracks what.
struct Scene {
  traceur::sim::Model model;
  traceur::control::Roles roles;
  std::vector<traceur::learn::ReferenceMotion> motions;
};

/// Loads the character and puts the clips on it; prints what loading and retargeting report. Throws traceur::Error.
Scene load_scene(const Options& options);

/// One look at the run, after a block of updates.
struct Milestone {
  double samples = 0, wall_s = 0;
  double normalized_return = 0;  ///< of the mean action, mean over motions
  double episode_s = 0;          ///< mean length in training
  double divergence = 0, explained_variance = 0, policy_rate = 0;
};

/// What a run came to.
struct Training {
  std::vector<Milestone> milestones;
  std::vector<std::string> warnings;  ///< what a person should look at, each told once
  double samples = 0, wall_s = 0, best_return = 0;
};

/// Learns until the samples are used up, the minutes are over, or interruption is asked for; saves a checkpoint after every
/// block of updates. A block begins all episodes anew, so that a resumed run goes through the same numbers. The policy that
/// did best in the tests between blocks is kept in policy.safetensors. Throws example::Interrupted, and traceur::Error when
/// a gradient is not finite; what was saved last stands.
Training train(const Scene& scene, const Options& options);

/// One episode of the mean action from each of `count` starts, by motion.
std::vector<Evaluation> test(const Scene& scene, const Options& options, traceur::learn::Policy<float>& policy,
                             traceur::learn::TrackingStart start, int count);

/// A motion, tracked from its begin for up to 12 s.
struct Recording {
  double tick = 0;                    ///< s
  Eigen::MatrixXd poses, references;  ///< nq x frames
  struct Contact {
    traceur::core::Vector3<double> point, force;  ///< m, N
  };
  std::vector<std::vector<Contact>> contacts;  ///< by frame
};
Recording record(const Scene& scene, traceur::learn::Policy<float>& policy, int motion);

}  // namespace track
