// SPDX-License-Identifier: MIT
#pragma once

#include <utility>

#include "traceur/learn/gae.hpp"

namespace traceur::learn {

/// What a batch of environments went through in a fixed number of steps, and what was made of it: the data of one policy
/// update. All memory is taken by the constructor.
///
/// Per-step numbers are matrices of steps x environments; features have one column a sample. Both are column-major, so the
/// steps of one environment are neighbours and sample `sample(t, e)` is also where row t, column e lies in memory.
template <class S>
struct Rollout {
  using Matrix = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;

  Matrix observation;      ///< observations x samples
  Matrix action;           ///< actions x samples
  Matrix log_probability;  ///< of the action under the policy that took it
  Matrix reward;           ///< spikes
  Matrix reward_rate;
  Matrix duration;
  Matrix value;            ///< estimate for the state in which the step begins
  Matrix timed_out_value;  ///< estimate for the last state where the step timed out, else 0
  Matrix last_value;       ///< 1 x environments: estimate for the state after the last step
  Eigen::Matrix<End, Eigen::Dynamic, Eigen::Dynamic> end;
  Matrix advantage;
  Matrix target;  ///< what the value function is fitted to

  /// Throws Error unless all sizes are at least 1.
  Rollout(Eigen::Index observations, Eigen::Index actions, Eigen::Index environments, Eigen::Index steps) {
    detail::check_at_least_one("rollout", "observation", observations);
    detail::check_at_least_one("rollout", "action", actions);
    detail::check_at_least_one("rollout", "environment", environments);
    detail::check_at_least_one("rollout", "step", steps);
    observation.setZero(observations, environments * steps);
    action.setZero(actions, environments * steps);
    for (Matrix* m : {&log_probability, &reward, &reward_rate, &value, &timed_out_value, &advantage, &target})
      m->setZero(steps, environments);
    duration.setOnes(steps, environments);
    last_value.setZero(1, environments);
    end.setConstant(steps, environments, End::running);
  }

  Eigen::Index steps() const noexcept { return value.rows(); }
  Eigen::Index environments() const noexcept { return value.cols(); }
  Eigen::Index samples() const noexcept { return value.size(); }
  Eigen::Index sample(Eigen::Index step, Eigen::Index environment) const noexcept {
    return environment * steps() + step;
  }

  /// The columns of one step in a matrix with a column a sample, one an environment: what `Environments` read and write.
  Columns<S> at_step(Matrix& features, Eigen::Index step) const noexcept {
    return Columns<S>(Eigen::Map<Matrix, 0, Eigen::OuterStride<>>(
        features.data() + step * features.rows(), features.rows(), environments(),
        Eigen::OuterStride<>(steps() * features.rows())));
  }

  /// Keeps what a step gave. Where it failed, or a reward or duration is not finite or a duration not positive, the step
  /// counts as failed and earns nothing.
  void record(Eigen::Index step, const StepResult<S>& result) noexcept {
    for (Eigen::Index e = 0; e < environments(); ++e) {
      const bool sound = std::isfinite(result.reward[e]) && std::isfinite(result.reward_rate[e]) &&
                         std::isfinite(result.duration[e]) && result.duration[e] > S(0);
      reward(step, e) = result.reward[e];
      reward_rate(step, e) = result.reward_rate[e];
      duration(step, e) = result.duration[e];
      end(step, e) = result.end[e];
      timed_out_value(step, e) = S(0);
      if (!sound || result.end[e] == End::failed) fail(step, e);
    }
  }

  /// Marks a step as failed: it earns nothing and is left out of the minibatches.
  void fail(Eigen::Index step, Eigen::Index environment) noexcept {
    reward(step, environment) = S(0);
    reward_rate(step, environment) = S(0);
    duration(step, environment) = S(1);
    end(step, environment) = End::failed;
  }

  Trajectories<S> trajectories() const noexcept {
    return {reward, reward_rate, duration, value, timed_out_value, last_value, end};
  }
};

}  // namespace traceur::learn
