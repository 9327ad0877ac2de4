// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>

#include "traceur/learn/tracking_error.hpp"

namespace traceur::learn {

/// The tracking reward of Wang et al., "HIL", 2026, Eq. 2 with the constants of Eq. 8.
///
/// Each exponent is a decay times a norm, not a squared norm, of all bodies' errors stacked into one vector: places,
/// rotations, velocities and angular velocities in world axes. The energy term is printed with a plus sign and described
/// as a penalty; it is subtracted. Perfect tracking at rest gives the sum of the weights, 6.
struct HilReward {
  double position_weight = 2.5;
  double rotation_weight = 1.5;
  double velocity_weight = 0.5;
  double angular_velocity_weight = 0.5;
  double height_weight = 1;
  double energy_weight = 0.001;  ///< s/J

  double position_decay = 1.5;           ///< 1/m
  double rotation_decay = 0.3;           ///< 1/rad
  double velocity_decay = 0.12;          ///< s/m
  double angular_velocity_decay = 0.05;  ///< s/rad
  double height_decay = 20;              ///< 1/m, of the root

  /// `power`: sum over joints of |torque x rate|, W, as `absolute_power` gives it.
  template <class S>
  S operator()(const TrackingState<S>& state, const TrackingState<S>& reference, const S& power) const {
    using std::exp;
    S position(0.0), rotation(0.0), velocity(0.0), angular_velocity(0.0);
    for (std::size_t b = 0; b < state.frames.position.size(); ++b) {
      position += squared_norm(state.frames.position[b] - reference.frames.position[b]);
      rotation += squared_angle(state.frames.rotation[b], reference.frames.rotation[b]);
      velocity += squared_norm(state.twists.linear[b] - reference.twists.linear[b]);
      angular_velocity += squared_norm(state.twists.angular[b] - reference.twists.angular[b]);
    }
    const S rise = state.frames.position[0].z - reference.frames.position[0].z;
    return S(position_weight) * exp(S(-position_decay) * safe_root(position)) +
           S(rotation_weight) * exp(S(-rotation_decay) * safe_root(rotation)) +
           S(velocity_weight) * exp(S(-velocity_decay) * safe_root(velocity)) +
           S(angular_velocity_weight) * exp(S(-angular_velocity_decay) * safe_root(angular_velocity)) +
           S(height_weight) * exp(S(-height_decay) * safe_root(S(rise * rise))) - S(energy_weight) * power;
  }
};

/// Sum over the joints' degrees of freedom, the root's left out, of |torque x rate|, W. Both have nv numbers.
template <class S>
S absolute_power(const body::Skeleton& skeleton, const S* torque, const S* v) {
  using core::select;
  S sum(0.0);
  for (int i = skeleton.free_root() ? 6 : 0; i < skeleton.nv(); ++i) {
    const S p = torque[i] * v[i];
    sum += select(p < S(0.0), S(-p), p);
  }
  return sum;
}

/// HIL's reward for reaching targets, Eq. 5 and appendix C.1: the metres gained on the target in a step, cut to
/// [0, `fastest`] so that hurrying does not pay, and once a bonus for being there. The paper prints neither weight.
struct HilTargetReward {
  double progress_weight = 20;  ///< 1/m: the fastest step earns 1
  double reached_weight = 1;
  double fastest = 0.05;  ///< m a step

  double operator()(double distance_before, double distance, bool reached_now) const {
    return progress_weight * std::clamp(distance_before - distance, 0.0, fastest) + (reached_now ? reached_weight : 0.0);
  }
};

/// HIL's reward for walking and facing given ways, Eq. 6 and 7: in [-facing_weight, 1].
struct HilHeadingReward {
  double speed_weight = 0.7;
  double facing_weight = 0.3;
  double decay = 0.25;  ///< s^2/m^2
  double speed = 1.2;   ///< wanted along the heading, m/s

  /// `along`: the root's velocity along the wanted heading, m/s. `facing`: cosine between the root's facing and the wanted.
  double operator()(double along, double facing) const {
    return speed_weight * std::exp(-decay * (speed - along) * (speed - along)) + facing_weight * facing;
  }
};

}  // namespace traceur::learn
