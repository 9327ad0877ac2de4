// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <span>

#include "traceur/learn/tracking_error.hpp"

namespace traceur::learn {

/// exp(-squared_error / sigma^2): the form of all of Lee et al.'s rewards, the task's (Eq. 8) among them.
template <class S>
S gaussian_reward(const S& squared_error, double sigma) {
  using std::exp;
  return exp(S(-1 / (sigma * sigma)) * squared_error);
}

/// The tracking reward of Lee et al., "Learning a Family of Motor Skills from a Single Motion Clip", ACM TOG 40(4), 2021,
/// Eq. 6 and 7: in (0, 1], 1 when tracking is perfect. It is earned continuously: a `reward_rate`.
struct LeeTrackingReward {
  double joint_weight = 0.28;
  double end_effector_weight = 0.28;
  double center_weight = 0.28;
  double time_weight = 0.16;

  double joint_sigma = 3.16;        ///< rad, on the sum over joints
  double end_effector_sigma = 0.8;  ///< m, on the sum over end effectors
  double center_sigma = 0.35;       ///< m
  double time_sigma = 0.1;          ///< on the rate of reference time

  /// The weights of the authors' released code: 0.8 space + 0.2 time, time by exp(-40 d^2). Its space sigmas act on means
  /// of squared entries and come to nearly the paper's.
  static LeeTrackingReward released_code() {
    LeeTrackingReward r;
    r.joint_weight = 0.8 * 0.5;
    r.end_effector_weight = 0.8 * 0.3;
    r.center_weight = 0.8 * 0.2;
    r.time_weight = 0.2;
    r.time_sigma = std::sqrt(1.0 / 40);
    return r;
  }

  /// `tau` and `reference_tau`: logarithms of the rate at which reference time passes. What the reference is aligned to is
  /// the caller's choice; places are compared in the world.
  template <class S>
  S operator()(const body::Skeleton& skeleton, const TrackingState<S>& state, const TrackingState<S>& reference,
               std::span<const int> end_effectors, const S& tau, const S& reference_tau) const {
    using std::exp;
    const S late = exp(tau) - exp(reference_tau);
    return S(joint_weight) * gaussian_reward(joint_error(skeleton, state, reference), joint_sigma) +
           S(end_effector_weight) * gaussian_reward(place_error<S>(state, reference, end_effectors), end_effector_sigma) +
           S(center_weight) *
               gaussian_reward(S(squared_norm(state.center_of_mass - reference.center_of_mass)), center_sigma) +
           S(time_weight) * gaussian_reward(S(late * late), time_sigma);
  }
};

/// How tracking and task are added up (Eq. 5 and section 4.2).
struct LeeRewardWeights {
  double tracking = 1;
  double task = 0;

  static LeeRewardWeights no_task() { return {1, 0}; }
  /// A task judged once, when its time is over: goes into `StepResult::reward`.
  static LeeRewardWeights spike() { return {1, 10}; }
  /// A task judged all the time: goes into `StepResult::reward_rate`, as tracking does.
  static LeeRewardWeights continuous() { return {0.9, 0.1}; }
};

}  // namespace traceur::learn
