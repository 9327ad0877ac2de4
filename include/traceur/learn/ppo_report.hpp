// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>

#include <Eigen/Core>

namespace traceur::learn {

/// How a rollout and the update from it went. A run whose divergence sits at a thousandth of its target or at ten times it,
/// or whose rate sits at a bound, is stuck.
struct PpoReport {
  double reward = 0;              ///< mean of a step
  double episode_return = 0;      ///< mean undiscounted sum over the episodes that ended in the rollout; 0 if none did
  double episode_steps = 0;       ///< their mean length
  int terminated = 0;             ///< episodes that ended for good
  int timed_out = 0;              ///< episodes that were cut off
  int failed = 0;                 ///< episodes ended by a number that is not finite
  Eigen::Index samples = 0;       ///< learnt from
  int epochs = 0;                 ///< gone through
  double surrogate = 0;           ///< mean loss of the policy in the last epoch
  double value_loss = 0;          ///< mean in the last epoch
  double divergence = 0;          ///< estimated KL from the policy that acted, mean over the last epoch
  double clip_fraction = 0;       ///< share of samples whose ratio was out of bounds in the last epoch
  double explained_variance = 0;  ///< of the returns by the values before the update
  double entropy = 0;             ///< of the policy after the update
  double policy_gradient = 0;     ///< mean length before clipping in the last epoch
  double value_gradient = 0;
  double policy_rate = 0;         ///< the update was made with
};

/// A training run to be saved: flat arrays and counts, nothing else.
template <class S>
struct PpoState {
  using Vector = Eigen::Matrix<S, Eigen::Dynamic, 1>;

  Vector policy;  ///< the policy's parameters, then its head's
  Vector value;
  Vector policy_optimizer;
  Vector value_optimizer;
  Eigen::VectorXd normalizer;
  std::int64_t policy_steps = 0;  ///< taken by the optimizer
  std::int64_t value_steps = 0;
  std::int64_t updates = 0;
  std::int64_t ticks = 0;  ///< steps of every environment
  double policy_rate = 0;
};

}  // namespace traceur::learn
