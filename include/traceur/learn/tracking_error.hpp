// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <span>

#include "traceur/learn/tracking_state.hpp"

namespace traceur::learn {

/// Square root whose derivative at zero is zero instead of infinite, so that perfect tracking has a gradient.
template <class S>
S safe_root(const S& x) {
  using core::select;
  using std::sqrt;
  const auto positive = S(0.0) < x;
  return select(positive, S(sqrt(select(positive, x, S(1.0)))), S(0.0));
}

/// Squared angle of the rotation from a to b, rad^2: |a (-) b|^2.
template <class S>
S squared_angle(const core::Quaternion<S>& a, const core::Quaternion<S>& b) {
  return squared_norm(log_map(a.conjugate() * b));
}

/// Sum over joints of w_j |q_j (-) q^_j|^2, rad^2, the root's own rotation left out. `weight` has one number a joint of the
/// skeleton, or none for 1 everywhere.
template <class S>
S joint_error(const body::Skeleton& skeleton, const TrackingState<S>& state, const TrackingState<S>& reference,
              std::span<const double> weight = {}) {
  S sum(0.0);
  for (int i = 1; i < skeleton.size(); ++i) {
    const body::Joint& j = skeleton[i];
    const double w = weight.empty() ? 1.0 : weight[static_cast<std::size_t>(i)];
    const auto at = static_cast<std::size_t>(j.q_index);
    if (j.type == body::JointType::hinge) {
      const S d = state.q[at] - reference.q[at];
      sum += S(w) * d * d;
    } else if (j.type == body::JointType::ball) {
      sum += S(w) * squared_angle(core::Quaternion<S>::from(&state.q[at]), core::Quaternion<S>::from(&reference.q[at]));
    }
  }
  return sum;
}

/// Sum over joints of w_j |w_j - w^_j|^2, (rad/s)^2, of the joints' own (local) angular velocities, the root left out.
template <class S>
S joint_velocity_error(const body::Skeleton& skeleton, const TrackingState<S>& state,
                       const TrackingState<S>& reference, std::span<const double> weight = {}) {
  S sum(0.0);
  for (int i = 1; i < skeleton.size(); ++i) {
    const body::Joint& j = skeleton[i];
    const double w = weight.empty() ? 1.0 : weight[static_cast<std::size_t>(i)];
    for (int k = 0; k < body::velocity_size(j.type); ++k) {
      const auto at = static_cast<std::size_t>(j.v_index + k);
      const S d = state.v[at] - reference.v[at];
      sum += S(w) * d * d;
    }
  }
  return sum;
}

/// Squared distances of the roots: m^2, rad^2, (m/s)^2, (rad/s)^2, in world axes.
template <class S>
struct RootError {
  S position, rotation, velocity, angular_velocity;

  RootError(const TrackingState<S>& state, const TrackingState<S>& reference)
      : position(squared_norm(state.frames.position[0] - reference.frames.position[0])),
        rotation(squared_angle(state.frames.rotation[0], reference.frames.rotation[0])),
        velocity(squared_norm(state.twists.linear[0] - reference.twists.linear[0])),
        angular_velocity(squared_norm(state.twists.angular[0] - reference.twists.angular[0])) {}
};

/// Sum over the named bodies of the squared distance between their places in the world, m^2.
template <class S>
S place_error(const TrackingState<S>& state, const TrackingState<S>& reference, std::span<const int> bodies) {
  S sum(0.0);
  for (const int b : bodies) {
    const auto k = static_cast<std::size_t>(b);
    sum += squared_norm(state.frames.position[k] - reference.frames.position[k]);
  }
  return sum;
}

/// The same with every place seen from its own root, world axes: blind to where the characters are.
template <class S>
S relative_place_error(const TrackingState<S>& state, const TrackingState<S>& reference, std::span<const int> bodies) {
  const core::Vector3<S> apart = state.frames.position[0] - reference.frames.position[0];
  S sum(0.0);
  for (const int b : bodies) {
    const auto k = static_cast<std::size_t>(b);
    sum += squared_norm(state.frames.position[k] - reference.frames.position[k] - apart);
  }
  return sum;
}

}  // namespace traceur::learn
