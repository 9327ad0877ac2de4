// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "traceur/core/pack.hpp"
#include "traceur/sim/model.hpp"

namespace traceur::sim {

/// What the dynamics needs to know of one moving body and may differ from lane to lane.
template <class N>
struct BodyNumbers {
  core::Vector3<N> offset;           ///< joint in the parent's frame, m
  N mass;                            ///< kg
  core::Vector3<N> first_moment;     ///< mass x centre of mass, body frame, kg m
  core::Symmetric3<N> inertia;       ///< about the joint, body axes, kg m^2
  N stiffness, damping;              ///< of the joint's motor, N m/rad, N m s/rad
  N torque_limit;                    ///< N m
  N reach;                           ///< largest distance of its surface from its joint, m
};

/// A contact sphere's place in its body's frame and its radius, m.
template <class N>
struct SphereNumbers {
  core::Vector3<N> center;
  N radius;
};

/// A touching feature's middle and half axis in its body's frame and its radius, m.
template <class N>
struct FeatureNumbers {
  core::Vector3<N> center, half_axis;
  N radius;
};

/// The numbers of a model in the form that a step reads: N is the scalar that is stepped, so that each lane of a pack may have
/// a body of its own. Loading them costs no more than broadcasting one number to all lanes.
template <class N>
struct Numbers {
  N total_mass, inverse_mass;
  std::vector<BodyNumbers<N>> bodies;
  std::vector<SphereNumbers<N>> contacts;
  std::vector<FeatureNumbers<N>> features;

  explicit Numbers(const Model& m) : bodies(m.bodies.size()), contacts(m.contacts.size()), features(m.features.size()) {
    for (int lane = 0; lane < core::lane_count<N>; ++lane) set(lane, m);
  }

  /// Gives one lane the numbers of a model, which must be like the first in everything else.
  void set(int lane, const Model& m) {
    using T = core::Element<N>;
    const auto number = [&](N& to, double x) { core::set_lane(to, lane, static_cast<T>(x)); };
    const auto vector = [&](core::Vector3<N>& to, const core::Vector3<double>& x) {
      number(to.x, x.x);
      number(to.y, x.y);
      number(to.z, x.z);
    };
    number(total_mass, m.total_mass);
    number(inverse_mass, 1.0 / m.total_mass);
    for (std::size_t i = 0; i < bodies.size(); ++i) {
      const MovingBody& from = m.bodies[i];
      BodyNumbers<N>& to = bodies[i];
      vector(to.offset, from.offset);
      number(to.mass, from.mass);
      vector(to.first_moment, from.first_moment);
      number(to.inertia.xx, from.inertia.xx);
      number(to.inertia.yy, from.inertia.yy);
      number(to.inertia.zz, from.inertia.zz);
      number(to.inertia.xy, from.inertia.xy);
      number(to.inertia.xz, from.inertia.xz);
      number(to.inertia.yz, from.inertia.yz);
      number(to.stiffness, from.actuator.stiffness);
      number(to.damping, from.actuator.damping);
      number(to.torque_limit, from.actuator.torque_limit);
      number(to.reach, from.reach);
    }
    for (std::size_t i = 0; i < contacts.size(); ++i) {
      vector(contacts[i].center, m.contacts[i].center);
      number(contacts[i].radius, m.contacts[i].radius);
    }
    for (std::size_t i = 0; i < features.size(); ++i) {
      vector(features[i].center, m.features[i].center);
      vector(features[i].half_axis, m.features[i].half_axis);
      number(features[i].radius, m.features[i].radius);
    }
  }
};

/// Throws Error where a model cannot share a pack with another: bodies, joints, stops and shapes must be the same in kind and
/// order; lengths, masses, inertias, gains and torque limits are free.
inline void check_same_build(const Model& a, const Model& b) {
  const std::string where = "character '" + b.character.name + "': ";
  if (a.bodies.size() != b.bodies.size() || a.nq != b.nq || a.contacts.size() != b.contacts.size() ||
      a.features.size() != b.features.size() || a.moving_of_joint != b.moving_of_joint)
    throw Error(where + "expected the bodies, joints and shapes of '" + a.character.name + "'");
  for (std::size_t i = 0; i < a.bodies.size(); ++i) {
    const MovingBody &x = a.bodies[i], &y = b.bodies[i];
    const std::string body = where + "body '" + b.character.skeleton[y.joint].body + "': ";
    if (x.parent != y.parent || x.type != y.type || x.contacts != y.contacts || x.features != y.features)
      throw Error(body + "expected the joint and the shapes it has in '" + a.character.name + "'");
    for (int f = x.first_feature; f < x.first_feature + x.features; ++f) {
      const auto k = static_cast<std::size_t>(f);
      if ((squared_norm(a.features[k].half_axis) > 0) != (squared_norm(b.features[k].half_axis) > 0))
        throw Error(body + "expected the shapes it has in '" + a.character.name + "', in their order");
    }
    const core::Quaternion<double> d = x.rest.conjugate() * y.rest;
    if (!(std::abs(std::abs(d.w) - 1) < 1e-9) || !(norm(x.axis - y.axis) < 1e-9))
      throw Error(body + "its rest rotation and axis cannot differ between lanes");
    const body::Actuator &p = x.actuator, &q = y.actuator;
    if (p.limited != q.limited || p.armature != q.armature || std::isfinite(p.torque_limit) != std::isfinite(q.torque_limit) ||
        std::isfinite(p.cone) != std::isfinite(q.cone) || (std::isfinite(p.cone) && p.cone != q.cone) ||
        (p.limited && (norm(p.lower - q.lower) > 0 || norm(p.upper - q.upper) > 0)))
      throw Error(body + "its stops, its armature and whether its torque is limited cannot differ between lanes");
  }
}

}  // namespace traceur::sim
