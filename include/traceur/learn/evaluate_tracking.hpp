// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "traceur/learn/tracking.hpp"

namespace traceur::learn {

/// What became of one episode of each environment, by motion.
struct TrackingEvaluation {
  int episodes = 0, completed = 0, falls = 0, drifts = 0, failures = 0;
  double normalized_return = 0;    ///< mean reward a step of whole episodes, nothing being earned after an early end: at most 1
  double joint_error_m = 0;        ///< mean distance of joints from the reference while tracking
  double seconds = 0;              ///< mean length
};

/// One episode in every environment from where they begin with this seed. `policy(observations, actions)` maps columns.
/// Leaves the environments at their ends.
template <class S, core::Executor E, class Policy>
std::vector<TrackingEvaluation> evaluate_tracking(Tracking<S, E>& environments, std::uint64_t seed, Policy&& policy) {
  const Eigen::Index n = environments.environments();
  environments.reset(seed);
  Eigen::MatrixXf observation(environments.observations(), n), action(environments.actions(), n);
  StepResult<float> result(n);
  std::vector<TrackingEvaluation> out(environments.motions().size());
  std::vector<bool> over(static_cast<std::size_t>(n), false);
  std::vector<double> expected(out.size(), 0), steps(out.size(), 0);
  for (Eigen::Index e = 0; e < n; ++e) expected[static_cast<std::size_t>(environments.motion(e))] += environments.steps_left(e);
  for (Eigen::Index left = n; left > 0;) {
    environments.observe(observation);
    policy(ConstColumns<float>(observation), Columns<float>(action));
    result.clear();
    environments.step(action, result);
    for (Eigen::Index e = 0; e < n; ++e) {
      if (over[static_cast<std::size_t>(e)]) continue;
      const auto m = static_cast<std::size_t>(environments.motion(e));
      TrackingEvaluation& sum = out[m];
      const TrackingEnd end = environments.ending(e);
      if (end == TrackingEnd::running || end == TrackingEnd::completed) {
        sum.normalized_return += static_cast<double>(result.reward[e]);
        sum.joint_error_m += environments.joint_error(e);
        steps[m] += 1;
      }
      if (end == TrackingEnd::running) continue;
      over[static_cast<std::size_t>(e)] = true;
      --left;
      ++sum.episodes;
      sum.completed += end == TrackingEnd::completed;
      sum.falls += end == TrackingEnd::fall;
      sum.drifts += end == TrackingEnd::drift;
      sum.failures += end == TrackingEnd::failure;
    }
  }
  for (std::size_t m = 0; m < out.size(); ++m) {
    if (expected[m] > 0) out[m].normalized_return /= expected[m];
    if (steps[m] > 0) out[m].joint_error_m /= steps[m];
    if (out[m].episodes > 0) out[m].seconds = steps[m] / out[m].episodes / environments.settings().control_hz;
  }
  return out;
}

}  // namespace traceur::learn
