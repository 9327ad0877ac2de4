// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "../common/engines.hpp"
#include "../common/lane.hpp"
#include "options.hpp"
#include "processes.hpp"
#include "traceur/io/safetensors.hpp"
#include "traceur/learn/evaluate_tracking.hpp"
#include "traceur/learn/policy.hpp"
#include "traceur/learn/ppo.hpp"

namespace track {

using Lane = example::Lane;
using Environments = traceur::learn::Tracking<Lane, traceur::core::ThreadExecutor>;
using Evaluation = traceur::learn::TrackingEvaluation;

/// Who tracks what.
struct Scene {
  std::string character_text;  ///< MJCF
  traceur::sim::Model model;
  traceur::control::Roles roles;
  std::vector<traceur::learn::ReferenceMotion> motions;
};

/// Loads the character and puts the clips on it; prints what loading and retargeting report. Throws traceur::Error.
Scene load_scene(const Options& options);

/// Has the environments moved by the simulator that was asked for.
template <class E>
void use_simulator(E& environments, const Scene& scene, const Options& options) {
  environments.use(example::make_engines(options.simulator, scene.character_text, scene.model, nullptr, environments.settings().simulation,
                                         static_cast<int>(environments.environments()) / E::group_width()));
}
/// How many of `all` environments each process has. Throws traceur::Error when they cannot be shared out evenly.
int share_of(int all, const traceur::learn::ProcessGroup& processes);

/// What collides with what, and the policy of a run as it is now.
traceur::sim::Extras extras_of(const traceur::sim::Model& model);
traceur::learn::Policy<float> policy_of(const traceur::learn::Ppo<float>& ppo);
/// As policy.safetensors, with what the run was asked for.
void write_policy(const Options& options, const traceur::learn::Policy<float>& policy);

/// One look at the run, after a block of updates.
struct Milestone {
  double samples = 0;
  double normalized_return = 0;  ///< of the mean action from starts all over the motions, mean over motions
  double from_begin = 0;         ///< the same from the motions' begins
  double episode_s = 0;          ///< mean length in training
  double divergence = 0, explained_variance = 0, policy_rate = 0;

  /// What policies are chosen by: the begin counts as much as all other starts, as it is where a motion is mostly played from.
  double score() const { return 0.5 * (normalized_return + from_begin); }
};

/// Says what looks wrong, and notes it, unless it was said before.
void warn_once(std::vector<std::string>& warnings, const char* text);
/// What had been said when a checkpoint was written.
std::vector<std::string> saved_warnings(const traceur::io::Safetensors& file);

/// What a run came to.
struct Training {
  std::vector<Milestone> milestones;
  std::vector<std::string> warnings;  ///< what a person should look at, each told once
  double samples = 0, wall_s = 0, best_score = 0;
};

/// Learns until the samples are used up, the minutes are over, or interruption is asked for; saves a checkpoint after every
/// block of updates. A block begins all episodes anew, so that a resumed run goes through the same numbers. The policy that
/// did best in the tests between blocks is kept in policy.safetensors. Throws example::Interrupted, and traceur::Error when
/// a gradient is not finite; what was saved last stands. Processes share the environments and the gradients out between them,
/// with the same result whatever their number; the first of them writes.
Training train(const Scene& scene, const Options& options, traceur::learn::ProcessGroup& processes);

/// One episode of the mean action from each of `count` starts, by motion: `cyclic_s` seconds of cyclic motions, others as long
/// as they last.
std::vector<Evaluation> test(const Scene& scene, const Options& options, traceur::learn::Policy<float>& policy,
                             traceur::learn::TrackingStart start, int count, double cyclic_s);

/// What was seen of one character.
struct Recording {
  double tick = 0;                    ///< s
  Eigen::MatrixXd poses, references;  ///< nq x frames; references may have no frames
  struct Contact {
    traceur::core::Vector3<double> point, force;  ///< m, N
  };
  std::vector<std::vector<Contact>> contacts;  ///< by frame
};

/// Writes down what lane 0 does, frame by frame.
class Recorder {
 public:
  Recorder(const Scene& scene, double tick);
  void add(const traceur::sim::Lanes<Lane>& lanes);
  void add_reference(const traceur::learn::ReferenceMotion& motion, int tick, std::array<float, 2> shift);
  Recording finish();

 private:
  const Scene* scene_;
  Recording out_;
  std::vector<Eigen::VectorXd> poses_, references_;
};

/// A motion, tracked from its begin for up to 12 s.
Recording record(const Scene& scene, const Options& options, traceur::learn::Policy<float>& policy, int motion);

}  // namespace track
