// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "traceur/body/momentum.hpp"

namespace traceur::learn {

/// A moving character with all that tracking rewards and terminations measure, in world axes. Any scalar: a number, a pack
/// of environments, a dual number.
template <class S>
struct TrackingState {
  std::vector<S> q;  ///< pose, as body::Skeleton lays it out
  std::vector<S> v;  ///< velocity
  body::Frames<S> frames;
  body::Twists<S> twists;
  core::Vector3<S> center_of_mass;   ///< m
  core::Vector3<S> center_velocity;  ///< m/s

  /// At rest in the neutral pose. The character has masses.
  explicit TrackingState(const body::Character& character)
      : v(static_cast<std::size_t>(character.skeleton.nv()), S(0.0)),
        frames(character.skeleton),
        twists(character.skeleton) {
    const Eigen::VectorXd neutral = character.skeleton.neutral_pose();
    for (Eigen::Index i = 0; i < neutral.size(); ++i) q.push_back(S(neutral[i]));
    measure(character);
  }

  /// Brings everything else up to date with q and v. Allocates nothing.
  void measure(const body::Character& character) {
    body::forward_kinematics(character.skeleton, q.data(), frames);
    body::forward_velocities(character.skeleton, frames, v.data(), twists);
    const body::Momentum<S> m = body::momentum(character, frames, twists);
    center_of_mass = m.center_of_mass;
    center_velocity = m.velocity();
  }
};

}  // namespace traceur::learn
