// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include "traceur/control/roles.hpp"

namespace traceur::control {

/// A position or polar vector reflected in the x-z plane.
template <class S>
inline core::Vector3<S> mirrored_vector(const core::Vector3<S>& v) {
  return {v.x, -v.y, v.z};
}

/// A rotation vector (axial) reflected in the x-z plane.
template <class S>
inline core::Vector3<S> mirrored_rotation(const core::Vector3<S>& v) {
  return {-v.x, v.y, -v.z};
}

/// A tangent or velocity vector (nv numbers) of the mirrored motion: left and right exchanged, everything reflected in the
/// x-z plane. An involution. Bodies' frames must be mirror images at rest, as they are in a symmetric character. `out` is
/// another vector.
inline void mirror_tangent(const sim::Model& model, const Roles& roles, const Eigen::VectorXd& d, Eigen::VectorXd& out) {
  using core::Vector3;
  out = d;
  for (std::size_t b = 0; b < model.bodies.size(); ++b) {
    const sim::MovingBody& to = model.bodies[b];
    const sim::MovingBody& from = model.bodies[static_cast<std::size_t>(roles.mirror[b])];
    double* o = out.data() + to.v_index;
    const double* i = d.data() + from.v_index;
    if (to.type == body::JointType::free) {
      mirrored_vector(Vector3<double>::from(i)).store(o);
      mirrored_rotation(Vector3<double>::from(i + 3)).store(o + 3);
    } else if (to.type == body::JointType::ball) {
      mirrored_rotation(Vector3<double>::from(i)).store(o);
    } else {
      o[0] = dot(mirrored_rotation(from.axis), to.axis) > 0 ? i[0] : -i[0];
    }
  }
}
inline Eigen::VectorXd mirrored_tangent(const sim::Model& model, const Roles& roles, const Eigen::VectorXd& d) {
  Eigen::VectorXd out;
  mirror_tangent(model, roles, d, out);
  return out;
}

/// A pose of the mirrored motion (nq numbers). An involution.
inline void mirror_pose(const sim::Model& model, const Roles& roles, const Eigen::VectorXd& q, Eigen::VectorXd& out) {
  using core::Quaternion;
  using core::Vector3;
  out = q;
  const auto turn = [](const double* i, double* o) {
    const Quaternion<double> r = Quaternion<double>::from(i);
    Quaternion<double>{-r.x, r.y, -r.z, r.w}.store(o);
  };
  for (std::size_t b = 0; b < model.bodies.size(); ++b) {
    const sim::MovingBody& to = model.bodies[b];
    const sim::MovingBody& from = model.bodies[static_cast<std::size_t>(roles.mirror[b])];
    double* o = out.data() + to.q_index;
    const double* i = q.data() + from.q_index;
    if (to.type == body::JointType::free) {
      mirrored_vector(Vector3<double>::from(i)).store(o);
      turn(i + 3, o + 3);
    } else if (to.type == body::JointType::ball) {
      turn(i, o);
    } else {
      o[0] = dot(mirrored_rotation(from.axis), to.axis) > 0 ? i[0] : -i[0];
    }
  }
}
inline Eigen::VectorXd mirrored_pose(const sim::Model& model, const Roles& roles, const Eigen::VectorXd& q) {
  Eigen::VectorXd out;
  mirror_pose(model, roles, q, out);
  return out;
}

}  // namespace traceur::control
