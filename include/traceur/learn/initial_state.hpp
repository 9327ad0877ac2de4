// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>

#include "traceur/core/random.hpp"
#include "traceur/motion/clip.hpp"

namespace traceur::learn {

/// Reference state initialisation (Peng et al. 2018, section 6.2): a reference time from which an episode starts, uniform
/// over the clip. `least_remaining` (s) is what a clip that is not cyclic must still have to go, as far as it is that long.
inline double reference_time(const motion::Clip& clip, core::RandomStream& random, double least_remaining = 0) {
  const double end = clip.cyclic ? clip.duration() : std::max(0.0, clip.duration() - least_remaining);
  return end * random.uniform();
}

/// Standard deviations of perturbed state initialisation (HIL, section 6.3): Gaussian noise on a reference state, so that
/// controllers learn to get into a skill from beside it. The paper does not print them; these keep a standing humanoid on
/// its feet and are meant to be swept.
struct Perturbation {
  double root_position = 0.02;          ///< m, horizontally and vertically
  double root_rotation = 0.05;          ///< rad
  double joint_rotation = 0.05;         ///< rad
  double root_velocity = 0.1;           ///< m/s
  double root_angular_velocity = 0.1;   ///< rad/s
  double joint_velocity = 0.5;          ///< rad/s

  /// Starts as the reference has them.
  static Perturbation none() { return {0, 0, 0, 0, 0, 0}; }
};

/// Adds noise to pose q (nq numbers) and velocity v (nv numbers). Rotations are disturbed in the tangent space, so they stay
/// unit quaternions. `scratch` has nv numbers. Allocates nothing; draws 2 nv normals whatever the deviations.
inline void perturb(const body::Skeleton& skeleton, const Perturbation& deviation, core::RandomStream& random,
                    Eigen::Ref<Eigen::VectorXd> q, Eigen::Ref<Eigen::VectorXd> v,
                    Eigen::Ref<Eigen::VectorXd> scratch) noexcept {
  const int root = skeleton.free_root() ? 6 : 0;
  for (int i = 0; i < skeleton.nv(); ++i) {
    const double size = i >= root ? deviation.joint_rotation : i >= 3 ? deviation.root_rotation : deviation.root_position;
    const double speed =
        i >= root ? deviation.joint_velocity : i >= 3 ? deviation.root_angular_velocity : deviation.root_velocity;
    scratch[i] = size * random.normal();
    v[i] += speed * random.normal();
  }
  body::displace(skeleton, q.data(), scratch.data(), q.data());
  body::normalize(skeleton, q.data());
}

}  // namespace traceur::learn
