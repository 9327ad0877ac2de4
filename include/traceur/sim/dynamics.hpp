// SPDX-License-Identifier: MIT
#pragma once

#include <limits>
#include <vector>

#include "traceur/core/pack.hpp"
#include "traceur/sim/numbers.hpp"
#include "traceur/sim/parameters.hpp"

namespace traceur::sim {

/// Everything the articulated-body algorithm keeps about one moving body of one group of lanes. All vectors are in world
/// axes and all moments are about the body's joint, so a ball joint's motion subspace is the identity and only 3x3
/// inverses occur.
template <class S>
struct BodyWork {
  core::Matrix3<S> rotation;           ///< body to world
  core::Vector3<S> position;           ///< joint, m
  core::Vector3<S> arm;                ///< from the parent's joint to this one, m
  core::Vector3<S> linear, angular;    ///< velocity of the joint's origin, angular velocity
  core::Vector3<S> relative;           ///< angular velocity relative to the parent
  core::Vector3<S> spin;               ///< angular velocity that velocity-dependent forces are taken at
  core::Vector3<S> axis;               ///< hinge axis
  core::Symmetric3<S> inertia;         ///< about the joint
  core::Vector3<S> first_moment;       ///< mass x (centre of mass - joint)
  // Own inertia and bias with contacts, to which a pass adds everything outboard (articulated).
  core::Symmetric3<S> j, m;
  core::Matrix3<S> h;
  core::Vector3<S> n, f;  ///< bias moment and force
  core::Vector3<S> bias_angular, bias_linear;
  core::Vector3<S> turning_angular, turning_linear;  ///< acceleration at constant joint and root velocities
  core::Symmetric3<S> d_inverse;
  core::Vector3<S> u_j, u_f;  ///< hinge: columns J a and H^T a
  S d_hinge;
  core::Vector3<S> alpha, acceleration;  ///< angular; linear of the joint's origin
  // Joint torque: explicit part and implicit inertia as used by the current pass; ball: body axes, hinge: x only.
  core::Vector3<S> motor, stop;
  S motor_inertia, stop_inertia;
  core::Vector3<S> torque;      ///< motor torque of the last step, N m, body axes (hinge: x)
  core::Vector3<S> joint_rate;  ///< joint acceleration, body axes (hinge: x), rad/s^2
};

/// The lowest-level view of one group of lanes: coordinates and scratch, all of scalar S.
template <class S>
struct DynamicsWork {
  std::vector<BodyWork<S>> bodies;
  core::Vector3<S> center_of_mass;   ///< m
  core::Vector3<S> linear_momentum;  ///< kg m/s
  core::Vector3<S> angular_momentum; ///< about the centre of mass, kg m^2/s
  explicit DynamicsWork(const Model& model) : bodies(model.bodies.size()) {}
};

/// Frames, twists, world inertias and momenta of all bodies at (q, v).
template <class S>
[[gnu::always_inline]] inline void update_kinematics(const Model& model, const Numbers<S>& numbers, const S* q, const S* v,
                                                     DynamicsWork<S>& w) {
  using core::Quaternion;
  using core::Vector3;
  using T = core::Element<S>;
  Vector3<S> moment = Vector3<S>::zero(), p = Vector3<S>::zero(), l = Vector3<S>::zero();
  const Vector3<S> origin = model.bodies[0].type == body::JointType::free ? Vector3<S>::from(q) : Vector3<S>::zero();
  for (std::size_t i = 0; i < model.bodies.size(); ++i) {
    const MovingBody& b = model.bodies[i];
    const BodyNumbers<S>& c = numbers.bodies[i];
    BodyWork<S>& k = w.bodies[i];
    const S* qj = q + b.q_index;
    const S* vj = v + b.v_index;
    if (b.type == body::JointType::free) {
      k.rotation = Quaternion<S>::from(qj + 3).matrix();
      k.position = Vector3<S>::from(qj);
      k.arm = Vector3<S>::zero();
      k.linear = Vector3<S>::from(vj);
      k.angular = Vector3<S>::from(vj + 3);
      k.relative = k.angular;
    } else {
      const Vector3<S>& offset = c.offset;
      core::Matrix3<S> local;
      if (b.type == body::JointType::ball) {
        Quaternion<S> r = Quaternion<S>::from(qj);
        if (b.turned_rest) r = b.rest.cast<T>().template cast<S>() * r;
        local = r.matrix();
      } else {
        Quaternion<S> r = core::about_axis(b.axis.cast<T>().template cast<S>(), qj[0]);
        if (b.turned_rest) r = b.rest.cast<T>().template cast<S>() * r;
        local = r.matrix();
      }
      if (b.parent >= 0) {
        const BodyWork<S>& parent = w.bodies[static_cast<std::size_t>(b.parent)];
        k.arm = parent.rotation * offset;
        k.position = parent.position + k.arm;
        k.rotation = parent.rotation * local;
        k.linear = parent.linear + cross(parent.angular, k.arm);
        k.angular = parent.angular;
      } else {
        k.arm = offset;
        k.position = offset;
        k.rotation = local;
        k.linear = Vector3<S>::zero();
        k.angular = Vector3<S>::zero();
      }
      if (b.type == body::JointType::ball) {
        k.relative = k.rotation * Vector3<S>::from(vj);
      } else {
        k.axis = k.rotation * b.axis.cast<T>().template cast<S>();
        k.relative = vj[0] * k.axis;
      }
      k.angular += k.relative;
    }
    const S& mass = c.mass;
    k.inertia = rotated(c.inertia, k.rotation);
    k.first_moment = k.rotation * c.first_moment;
    // Momentum about the root's origin; shifted to the centre of mass below.
    const Vector3<S> from_origin = k.position - origin;
    const Vector3<S> body_p = mass * k.linear + cross(k.angular, k.first_moment);
    moment += mass * from_origin + k.first_moment;
    p += body_p;
    l += k.inertia * k.angular + cross(k.first_moment, k.linear) + cross(from_origin, body_p);
  }
  const Vector3<S> center = numbers.inverse_mass * moment;
  w.center_of_mass = origin + center;
  w.linear_momentum = p;
  w.angular_momentum = l - cross(center, p);
}

/// Adds weight and velocity-dependent forces: each body's own inertia and bias, before contacts.
///
/// `rates`, if given, are the accelerations of the last step (nv numbers, layout of velocities); of a free root the first of
/// its numbers is how far to look ahead with them, s. Velocities that stand half a step before the pose are so brought
/// up to it (leapfrog), which keeps the energy of a body in flight.
template <class S>
[[gnu::always_inline]] inline void load_inertias(const Model& model, const Numbers<S>& numbers, const S& gravity, DynamicsWork<S>& w,
                                                 const S* rates = nullptr) {
  using core::Vector3;
  if (model.bodies[0].type != body::JointType::free) rates = nullptr;
  const S ahead = rates ? rates[0] : S(0.0);
  for (std::size_t i = 0; i < model.bodies.size(); ++i) {
    const MovingBody& b = model.bodies[i];
    BodyWork<S>& k = w.bodies[i];
    const S& mass = numbers.bodies[i].mass;
    k.j = k.inertia;
    k.m = core::Symmetric3<S>::scalar(mass);
    k.h = core::Matrix3<S>::skew(k.first_moment);
    if (!rates) {
      k.spin = k.angular;
    } else if (b.type == body::JointType::free) {
      k.spin = k.angular + ahead * Vector3<S>::from(rates + 3);
    } else {
      const S* rate = rates + b.v_index;
      k.spin = k.relative + (b.type == body::JointType::ball ? ahead * (k.rotation * Vector3<S>::from(rate))
                                                             : (ahead * rate[0]) * k.axis);
      if (b.parent >= 0) k.spin += w.bodies[static_cast<std::size_t>(b.parent)].spin;
    }
    k.n = cross(k.spin, k.inertia * k.spin);
    k.n.x += gravity * k.first_moment.y;
    k.n.y -= gravity * k.first_moment.x;
    k.f = cross(k.spin, cross(k.spin, k.first_moment));
    k.f.z += gravity * mass;
    k.bias_angular = k.bias_linear = k.turning_angular = k.turning_linear = Vector3<S>::zero();
    if (b.parent >= 0) {
      const BodyWork<S>& parent = w.bodies[static_cast<std::size_t>(b.parent)];
      k.bias_angular = cross(parent.spin, k.spin - parent.spin);
      k.bias_linear = cross(parent.spin, cross(parent.spin, k.arm));
      k.turning_angular = parent.turning_angular + k.bias_angular;
      k.turning_linear = parent.turning_linear + cross(parent.turning_angular, k.arm) + k.bias_linear;
    }
  }
}

/// One backward and one forward pass of the articulated-body algorithm: accelerations of every body and joint from the own
/// inertias and biases, the joints' torques and the inertia that implicit torques add. A joint's torque is
/// motor + stop - (motor_inertia + stop_inertia + armature) x joint acceleration. Outboard inertias are added in place, so
/// own ones must be loaded again before another pass.
template <class S>
[[gnu::always_inline]] inline void articulated_body(const Model& model, DynamicsWork<S>& w) {
  using core::Matrix3;
  using core::Symmetric3;
  using core::Vector3;
  using T = core::Element<S>;
  for (std::size_t i = model.bodies.size(); i-- > 0;) {
    const MovingBody& b = model.bodies[i];
    BodyWork<S>& k = w.bodies[i];
    if (b.type == body::JointType::free) continue;
    const S d = k.motor_inertia + k.stop_inertia + S(static_cast<T>(b.actuator.armature));
    Symmetric3<S> j, m;
    Matrix3<S> h;
    Vector3<S> n, f;
    if (b.type == body::JointType::ball) {
      const Vector3<S> tau = k.rotation * (k.motor + k.stop);
      Symmetric3<S> sum = k.j;
      sum += Symmetric3<S>::scalar(d);
      k.d_inverse = sum.inverse();
      const Matrix3<S> dh = k.d_inverse * k.h;
      const Vector3<S> free_alpha = k.d_inverse * (tau - k.n);
      if (b.parent < 0) continue;
      j = Symmetric3<S>::scalar(d) - (d * d) * k.d_inverse;
      h = d * dh;
      m = k.m - core::upper(k.h.transpose() * dh);
      n = tau - d * free_alpha;
      f = k.f + transpose_times(k.h, free_alpha);
    } else {
      k.u_j = k.j * k.axis;
      k.u_f = transpose_times(k.h, k.axis);
      k.d_hinge = S(1.0) / (dot(k.axis, k.u_j) + d);
      if (b.parent < 0) continue;
      const S free_rate = k.d_hinge * (k.motor.x + k.stop.x - dot(k.axis, k.n));
      const Vector3<S> sj = k.d_hinge * k.u_j, sf = k.d_hinge * k.u_f;
      j = k.j - Symmetric3<S>{sj.x * k.u_j.x, sj.y * k.u_j.y, sj.z * k.u_j.z, sj.x * k.u_j.y, sj.x * k.u_j.z, sj.y * k.u_j.z};
      m = k.m - Symmetric3<S>{sf.x * k.u_f.x, sf.y * k.u_f.y, sf.z * k.u_f.z, sf.x * k.u_f.y, sf.x * k.u_f.z, sf.y * k.u_f.z};
      h = k.h - Matrix3<S>{sj.x * k.u_f.x, sj.x * k.u_f.y, sj.x * k.u_f.z, sj.y * k.u_f.x, sj.y * k.u_f.y,
                           sj.y * k.u_f.z, sj.z * k.u_f.x, sj.z * k.u_f.y, sj.z * k.u_f.z};
      n = k.n + free_rate * k.u_j;
      f = k.f + free_rate * k.u_f;
    }
    n += j * k.bias_angular + h * k.bias_linear;
    f += transpose_times(h, k.bias_angular) + m * k.bias_linear;
    // To the parent's joint: a_child = a_parent - [l]x alpha.
    BodyWork<S>& parent = w.bodies[static_cast<std::size_t>(b.parent)];
    const Vector3<S>& l = k.arm;
    // lm = [l]x M, hl = H [l]x; J_parent = J - H[l]x + [l]x H^T - [l]x M [l]x.
    const Vector3<S> mx = cross(l, Vector3<S>{m.xx, m.xy, m.xz}), my = cross(l, Vector3<S>{m.xy, m.yy, m.yz}),
                     mz = cross(l, Vector3<S>{m.xz, m.yz, m.zz});
    const Matrix3<S> lm{mx.x, my.x, mz.x, mx.y, my.y, mz.y, mx.z, my.z, mz.z};
    // [l]x (H^T) has columns l x (rows of H); its transpose is -H [l]x.
    const Vector3<S> hx = cross(l, h.row_x()), hy = cross(l, h.row_y()), hz = cross(l, h.row_z());
    // [l]x M [l]x = lm [l]x: row r is -(l x row_r) ... written as cross(row, l) = -cross(l, row).
    const Vector3<S> qx = cross(lm.row_x(), l), qy = cross(lm.row_y(), l), qz = cross(lm.row_z(), l);
    parent.j += Symmetric3<S>{j.xx + (hx.x + hx.x) - qx.x, j.yy + (hy.y + hy.y) - qy.y, j.zz + (hz.z + hz.z) - qz.z,
                              j.xy + (hx.y + hy.x) - qx.y, j.xz + (hx.z + hz.x) - qx.z, j.yz + (hy.z + hz.y) - qy.z};
    parent.h += h + lm;
    parent.m += m;
    parent.n += n + cross(l, f);
    parent.f += f;
  }
  for (std::size_t i = 0; i < model.bodies.size(); ++i) {
    const MovingBody& b = model.bodies[i];
    BodyWork<S>& k = w.bodies[i];
    if (b.type == body::JointType::free) {
      const Symmetric3<S> m_inverse = k.m.inverse();
      const Matrix3<S> mh = m_inverse * k.h.transpose();
      const Symmetric3<S> schur = k.j - core::upper(k.h * mh);
      k.alpha = schur.inverse() * (k.h * (m_inverse * k.f) - k.n);
      k.acceleration = -(m_inverse * (k.f + transpose_times(k.h, k.alpha)));
      k.joint_rate = k.alpha;
      continue;
    }
    Vector3<S> alpha = k.bias_angular, a = k.bias_linear;
    if (b.parent >= 0) {
      const BodyWork<S>& parent = w.bodies[static_cast<std::size_t>(b.parent)];
      alpha += parent.alpha;
      a += parent.acceleration + cross(parent.alpha, k.arm);
    }
    const S d = k.motor_inertia + k.stop_inertia + S(static_cast<T>(b.actuator.armature));
    if (b.type == body::JointType::ball) {
      const Vector3<S> tau = k.rotation * (k.motor + k.stop);
      k.alpha = k.d_inverse * (tau + d * alpha - k.h * a - k.n);
      k.joint_rate = transpose_times(k.rotation, k.alpha - alpha);
    } else {
      const S rate = k.d_hinge * (k.motor.x + k.stop.x - dot(k.u_j, alpha) - dot(k.u_f, a) - dot(k.axis, k.n));
      k.alpha = alpha + rate * k.axis;
      k.joint_rate = Vector3<S>{rate, S(0.0), S(0.0)};
    }
    k.acceleration = a;
  }
}

/// Joint and root accelerations (nv numbers, layout of velocities) of a character in free space: pose q, velocity v, joint
/// torques tau (nv numbers, the root's ignored), weight included. The root's linear acceleration is that of its origin.
/// Independent of any time step; the reference for other engines. `numbers` are the model's.
template <class S>
inline void forward_dynamics(const Model& model, const Numbers<S>& numbers, const S* q, const S* v, const S* tau, const S& gravity,
                             DynamicsWork<S>& w, S* out) {
  update_kinematics(model, numbers, q, v, w);
  load_inertias(model, numbers, gravity, w);
  for (std::size_t i = 0; i < model.bodies.size(); ++i) {
    const MovingBody& b = model.bodies[i];
    BodyWork<S>& k = w.bodies[i];
    k.stop = k.motor = core::Vector3<S>::zero();
    k.stop_inertia = k.motor_inertia = S(0.0);
    if (b.type == body::JointType::ball) k.motor = core::Vector3<S>::from(tau + b.v_index);
    if (b.type == body::JointType::hinge) k.motor.x = tau[b.v_index];
  }
  articulated_body(model, w);
  for (std::size_t i = 0; i < model.bodies.size(); ++i) {
    const MovingBody& b = model.bodies[i];
    const BodyWork<S>& k = w.bodies[i];
    if (b.type == body::JointType::free) {
      k.acceleration.store(out);
      k.alpha.store(out + 3);
    } else if (b.type == body::JointType::ball) {
      k.joint_rate.store(out + b.v_index);
    } else {
      out[b.v_index] = k.joint_rate.x;
    }
  }
}

/// The same with the model's numbers made on the way, which allocates.
template <class S>
inline void forward_dynamics(const Model& model, const S* q, const S* v, const S* tau, const S& gravity, DynamicsWork<S>& w, S* out) {
  forward_dynamics(model, Numbers<S>(model), q, v, tau, gravity, w, out);
}

}  // namespace traceur::sim
