// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <string>

#include "traceur/sim/model.hpp"

namespace traceur::backends::detail {

/// How far a joint's rotation vector (rad; hinge: the angle in x) is beyond its stops, per component; zero within them.
inline core::Vector3<double> stop_excess(const body::Actuator& a, bool ball, const core::Vector3<double>& present) {
  const auto beyond = [](double x, double low, double high) { return std::max(x - high, 0.0) + std::min(x - low, 0.0); };
  core::Vector3<double> excess{0, 0, 0};
  if (a.limited) {
    excess.x = beyond(present.x, a.lower.x, a.upper.x);
    if (ball) {
      excess.y = beyond(present.y, a.lower.y, a.upper.y);
      excess.z = beyond(present.z, a.lower.z, a.upper.z);
    }
  }
  const double angle = norm(present);
  if (ball && angle > a.cone) excess += ((angle - a.cone) / angle) * present;
  return excess;
}

/// Mass properties of a moving body with all that is welded to it, in its own frame.
inline body::Inertia merged_inertia(const sim::MovingBody& b) {
  body::Inertia in;
  in.mass = b.mass;
  if (!(b.mass > 0)) return in;
  in.center = (1 / b.mass) * b.first_moment;
  in.about_center = b.inertia - core::Symmetric3<double>::scalar(b.mass * squared_norm(in.center)) +
                    core::Symmetric3<double>::outer(b.mass, in.center);
  return in;
}

/// Throws Error, one line beginning with `engine`, unless there is a lane and a body that moves, and every such body has a
/// mass and an inertia about every axis: engines, unlike articulated-body dynamics, refuse point masses.
inline void check_engine(const std::string& engine, const sim::Model& model, int lanes) {
  if (lanes < 1) throw Error(engine + ": expected at least one lane, found " + std::to_string(lanes));
  if (model.bodies.empty()) throw Error(engine + ": expected a character with a joint that moves");
  for (const sim::MovingBody& b : model.bodies) {
    const std::string& name = model.character.skeleton[b.joint].body;
    if (!(b.mass > 0)) throw Error(engine + ": body '" + name + "': expected a mass above zero");
    const core::Symmetric3<double> i = merged_inertia(b).about_center;
    const double minor = i.xx * i.yy - i.xy * i.xy;
    const double det = i.xx * (i.yy * i.zz - i.yz * i.yz) - i.xy * (i.xy * i.zz - i.yz * i.xz) + i.xz * (i.xy * i.yz - i.yy * i.xz);
    if (!(i.xx > 0 && minor > 0 && det > 0)) throw Error(engine + ": body '" + name + "': expected an inertia about every axis");
  }
}

}  // namespace traceur::backends::detail
