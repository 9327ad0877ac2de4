// SPDX-License-Identifier: MIT
#pragma once

#include <string>

#include "traceur/body/skeleton.hpp"

namespace traceur::body {

/// q (+) d: the pose reached from q by the tangent vector d (rad, m). Root: position plus d[0..2], rotation
/// exp(d[3..5]) q in world axes; ball joints q exp(d), the right-multiplied local exponential map of Lee et al. 2021,
/// Eq. 2; hinges q + d. `q`, `d` and `out` have nq, nv and nq numbers; `out` may be `q`. The pose may hold plain numbers
/// where the displacement holds dual ones.
template <class S, class P>
inline void displace(const Skeleton& skeleton, const P* q, const S* d, S* out) {
  using core::Quaternion;
  using core::Vector3;
  for (const Joint& j : skeleton.joints()) {
    const P* qj = q + j.q_index;
    const S* dj = d + j.v_index;
    S* oj = out + j.q_index;
    switch (j.type) {
      case JointType::fixed:
        break;
      case JointType::hinge:
        oj[0] = S(qj[0]) + dj[0];
        break;
      case JointType::ball:
        (Quaternion<S>::from(qj) * exp_map(Vector3<S>::from(dj))).store(oj);
        break;
      case JointType::free:
        (Vector3<S>::from(qj) + Vector3<S>::from(dj)).store(oj);
        (exp_map(Vector3<S>::from(dj + 3)) * Quaternion<S>::from(qj + 3)).store(oj + 3);
        break;
    }
  }
}

/// The tangent vector d with a (+) d = b, the shorter way round at every joint. Divided by a time step it is the velocity
/// that leads from a to b.
template <class S>
inline void difference(const Skeleton& skeleton, const S* a, const S* b, S* out) {
  using core::Quaternion;
  using core::Vector3;
  for (const Joint& j : skeleton.joints()) {
    const S* aj = a + j.q_index;
    const S* bj = b + j.q_index;
    S* oj = out + j.v_index;
    switch (j.type) {
      case JointType::fixed:
        break;
      case JointType::hinge:
        oj[0] = bj[0] - aj[0];
        break;
      case JointType::ball:
        log_map(Quaternion<S>::from(aj).conjugate() * Quaternion<S>::from(bj)).store(oj);
        break;
      case JointType::free:
        (Vector3<S>::from(bj) - Vector3<S>::from(aj)).store(oj);
        log_map(Quaternion<S>::from(bj + 3) * Quaternion<S>::from(aj + 3).conjugate()).store(oj + 3);
        break;
    }
  }
}

/// The pose a share u of the way from a to b: linear for positions and angles, slerp for rotations. The poses may hold plain
/// numbers where the share is a dual one.
template <class S, class P>
inline void interpolate(const Skeleton& skeleton, const P* a, const P* b, const S& u, S* out) {
  using core::Quaternion;
  for (const Joint& j : skeleton.joints()) {
    const P* aj = a + j.q_index;
    const P* bj = b + j.q_index;
    S* oj = out + j.q_index;
    int rotation = -1;
    if (j.type == JointType::hinge) oj[0] = S(aj[0]) + u * S(bj[0] - aj[0]);
    if (j.type == JointType::free) {
      for (int k = 0; k < 3; ++k) oj[k] = S(aj[k]) + u * S(bj[k] - aj[k]);
      rotation = 3;
    }
    if (j.type == JointType::ball) rotation = 0;
    if (rotation >= 0) slerp(Quaternion<S>::from(aj + rotation), Quaternion<S>::from(bj + rotation), u).store(oj + rotation);
  }
}

/// Scales every quaternion of the pose to unit length.
template <class S>
inline void normalize(const Skeleton& skeleton, S* q) {
  using core::Quaternion;
  for (const Joint& j : skeleton.joints()) {
    const int rotation = j.type == JointType::free ? 3 : j.type == JointType::ball ? 0 : -1;
    if (rotation < 0) continue;
    S* r = q + j.q_index + rotation;
    Quaternion<S>::from(r).normalized().store(r);
  }
}

/// Throws Error when q is not a pose of the skeleton: wrong size, a number that is not finite, a quaternion further than
/// 1e-3 from unit length. `where` begins the message.
inline void check_pose(const Skeleton& skeleton, const Eigen::Ref<const Eigen::VectorXd>& q, const std::string& where) {
  if (q.size() != skeleton.nq())
    throw Error(where + ": expected a pose of " + std::to_string(skeleton.nq()) + " numbers, found " + std::to_string(q.size()));
  for (const Joint& j : skeleton.joints()) {
    const int n = position_size(j.type);
    for (int k = 0; k < n; ++k)
      if (!std::isfinite(q[j.q_index + k])) throw Error(where + ": joint '" + j.name + "' is not finite");
    if (n >= 4 && std::abs(q.segment(j.q_index + n - 4, 4).norm() - 1.0) > 1e-3)
      throw Error(where + ": joint '" + j.name + "': expected a unit quaternion");
  }
}

}  // namespace traceur::body
