// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <concepts>
#include <cstdint>
#include <string>

#include <Eigen/Core>

#include "traceur/core/error.hpp"

namespace traceur::learn {

/// Columns of numbers to read or write: one row a feature, one column an environment, columns any distance apart, so that
/// a rollout's memory can be written directly.
template <class S>
using Columns = Eigen::Ref<Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>, 0, Eigen::OuterStride<>>;
template <class S>
using ConstColumns = Eigen::Ref<const Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>, 0, Eigen::OuterStride<>>;

/// Whether and why an episode is over after a step.
enum class End : std::uint8_t {
  running,     ///< it goes on
  terminated,  ///< nothing can be earned any more: the value of what follows is zero
  timed_out,   ///< cut off from outside although it could go on: what follows keeps its value
  failed       ///< the simulation gave a number that is not finite: the step teaches nothing and is left out
};

/// What one step of a batch of environments gives, one entry an environment.
template <class S>
struct StepResult {
  using Vector = Eigen::Matrix<S, Eigen::Dynamic, 1>;

  Vector reward;       ///< earned at once at the start of the step (a spike)
  Vector reward_rate;  ///< earned at this constant rate all through the step, per unit of `duration`
  Vector duration;     ///< length of the step in the unit of time in which the discount is stated; 1 for plain steps
  Eigen::Matrix<End, Eigen::Dynamic, 1> end;

  /// Nothing earned, steps of length 1, all running.
  explicit StepResult(Eigen::Index environments)
      : reward(Vector::Zero(environments)),
        reward_rate(Vector::Zero(environments)),
        duration(Vector::Ones(environments)),
        end(Eigen::Matrix<End, Eigen::Dynamic, 1>::Constant(environments, End::running)) {}

  Eigen::Index environments() const noexcept { return reward.size(); }

  /// Back to the state after construction.
  void clear() noexcept {
    reward.setZero();
    reward_rate.setZero();
    duration.setOnes();
    end.setConstant(End::running);
  }
};

/// Many environments that are stepped together; in every matrix, column e belongs to environment e. Laws the compiler
/// cannot check:
/// - `reset(seed)` begins a first episode everywhere. All randomness of environment e comes from `core::RandomStream`s
///   keyed by the seed, e and the number of e's episode or step, so threads never change a result.
/// - `observe` writes what the policy sees now. It changes nothing.
/// - `step` is given a cleared result and actions of any finite size, which it limits itself. It never begins a new
///   episode: after a step that ended one, `observe` still shows the last state, whose value a time-out needs.
/// - `restart(e)` begins the next episode of environment e.
/// - Nothing but the constructor and `reset` allocates or throws; a state that is not finite is reported as `End::failed`.
template <class E, class S = float>
concept Environments =
    requires(E& env, const E& constant, std::uint64_t seed, Eigen::Index e, Columns<S> out, ConstColumns<S> actions,
             StepResult<S>& result) {
      { constant.environments() } -> std::same_as<Eigen::Index>;
      { constant.observations() } -> std::same_as<Eigen::Index>;
      { constant.actions() } -> std::same_as<Eigen::Index>;
      { env.reset(seed) } -> std::same_as<void>;
      { constant.observe(out) } -> std::same_as<void>;
      { env.step(actions, result) } -> std::same_as<void>;
      { env.restart(e) } noexcept -> std::same_as<void>;
    };

namespace detail {

/// Throws Error unless `value` is at least 1: `pendulum: expected at least one environment, got 0`.
inline void check_at_least_one(const char* where, const char* what, Eigen::Index value) {
  if (value < 1) {
    throw Error(std::string(where) + ": expected at least one " + what + ", got " + std::to_string(value));
  }
}

/// Throws Error unless `value` is zero or more and finite: `ppo: policy_rate must be zero or more`.
inline void check_zero_or_more(const char* where, const char* what, double value) {
  if (!(value >= 0) || !std::isfinite(value)) throw Error(std::string(where) + ": " + what + " must be zero or more");
}

}  // namespace detail

}  // namespace traceur::learn
