// SPDX-License-Identifier: MIT
#pragma once

#include <limits>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "traceur/body/kinematics.hpp"

namespace traceur::body {

/// A collision shape, also what replays draw.
struct Shape {
  enum class Kind { sphere, capsule, box };
  Kind kind = Kind::sphere;
  std::string name;
  int body = 0;                                                            ///< joint index of the body that carries it
  core::Vector3<double> position{0, 0, 0};                                 ///< centre in the body's frame, m
  core::Quaternion<double> rotation = core::Quaternion<double>::identity();  ///< shape to body; a capsule lies along its z
  core::Vector3<double> size{0, 0, 0};  ///< sphere: radius; capsule: radius, half length of its axis; box: half extents; m
};

/// Mass properties of one body.
struct Inertia {
  double mass = 0;                                                              ///< kg
  core::Vector3<double> center{0, 0, 0};                                        ///< centre of mass in the body's frame, m
  core::Symmetric3<double> about_center = core::Symmetric3<double>::zero();  ///< kg m^2, body axes
};

/// The motor and the stops of one joint.
struct Actuator {
  double stiffness = 0;     ///< proportional gain kp, N m/rad
  double damping = 0;       ///< derivative gain kd, N m s/rad
  double torque_limit = std::numeric_limits<double>::infinity();  ///< N m; on the torque's norm for a ball joint
  double armature = 0;      ///< rotor inertia added to each of the joint's axes, kg m^2
  bool limited = false;     ///< whether lower and upper hold
  core::Vector3<double> lower{0, 0, 0};  ///< rad; hinge: x only; ball: of each component of the rotation vector
  core::Vector3<double> upper{0, 0, 0};
  double cone = std::numeric_limits<double>::infinity();  ///< ball: largest rotation angle from rest, rad
};

/// A simulated body: skeleton, masses, shapes, motors. `inertias` and `actuators` have one entry per joint.
struct Character {
  std::string name;
  Skeleton skeleton;
  std::vector<Inertia> inertias;
  std::vector<Actuator> actuators;
  std::vector<Shape> shapes;

  double total_mass() const {
    double mass = 0;
    for (const Inertia& i : inertias) mass += i.mass;
    return mass;
  }
};

/// Throws Error when the character cannot be simulated: a size that does not match, a mass or inertia that is negative or
/// not finite, a moving body without mass, a shape of no size, limits the wrong way round. `where` begins the message.
inline void check_character(const Character& c, const std::string& where) {
  const auto n = static_cast<std::size_t>(c.skeleton.size());
  if (n == 0) throw Error(where + ": expected at least one body");
  if (c.inertias.size() != n || c.actuators.size() != n)
    throw Error(where + ": expected one inertia and one actuator for each of " + std::to_string(n) + " joints");
  // A welded body may be massless: what it is welded to carries it. A joint needs mass on its own body or on one welded to it.
  std::vector<double> carried(n, 0.0);
  for (std::size_t i = n; i-- > 0;) {
    const Joint& j = c.skeleton[static_cast<int>(i)];
    const Inertia& in = c.inertias[i];
    const std::string body = where + ": body '" + j.body + "': ";
    if (!(in.mass >= 0) || !std::isfinite(in.mass)) throw Error(body + "mass must be a finite number, zero or more");
    const core::Symmetric3<double>& m = in.about_center;
    if (!std::isfinite(m.xx + m.yy + m.zz + m.xy + m.xz + m.yz + in.center.x + in.center.y + in.center.z))
      throw Error(body + "inertia or centre of mass is not finite");
    if (!(m.xx >= 0 && m.yy >= 0 && m.zz >= 0)) throw Error(body + "inertia is negative");
    carried[i] += in.mass;
    if (j.parent >= 0) carried[static_cast<std::size_t>(j.parent)] += carried[i];
    if (j.type != JointType::fixed && !(carried[i] > 0)) throw Error(body + "has zero mass and cannot move");
    const Actuator& a = c.actuators[i];
    const std::string joint = where + ": joint '" + j.name + "': ";
    if (!(a.stiffness >= 0 && a.damping >= 0 && a.armature >= 0) || !std::isfinite(a.stiffness + a.damping + a.armature))
      throw Error(joint + "stiffness, damping and armature must be finite, zero or more");
    if (!(a.torque_limit >= 0)) throw Error(joint + "torque limit must be zero or more");
    if (a.limited && !(a.lower.x <= a.upper.x && a.lower.y <= a.upper.y && a.lower.z <= a.upper.z))
      throw Error(joint + "range has its lower end above its upper end");
  }
  for (const Shape& s : c.shapes) {
    const std::string shape = where + ": shape '" + s.name + "': ";
    if (s.body < 0 || s.body >= c.skeleton.size()) throw Error(shape + "names a body that does not exist");
    const bool positive = s.size.x > 0 && (s.kind == Shape::Kind::sphere || s.size.y > 0) &&
                          (s.kind != Shape::Kind::box || s.size.z > 0);
    if (!positive || !std::isfinite(s.size.x + s.size.y + s.size.z)) throw Error(shape + "size must be positive and finite");
  }
}

/// Mass and inertia of a solid shape of uniform density (kg/m^3), about its own centre, in the shape's axes.
inline Inertia solid(const Shape& s, double density) {
  constexpr double pi = std::numbers::pi;
  Inertia in;
  const double r = s.size.x;
  if (s.kind == Shape::Kind::sphere) {
    in.mass = density * 4.0 / 3.0 * pi * r * r * r;
    in.about_center = core::Symmetric3<double>::scalar(0.4 * in.mass * r * r);
  } else if (s.kind == Shape::Kind::capsule) {
    const double length = 2 * s.size.y;
    const double cylinder = density * pi * r * r * length;
    const double caps = density * 4.0 / 3.0 * pi * r * r * r;
    in.mass = cylinder + caps;
    const double across = cylinder * (r * r / 4 + length * length / 12) +
                          caps * (0.4 * r * r + length * length / 4 + 3.0 / 8.0 * r * length);
    const double along = cylinder * r * r / 2 + caps * 0.4 * r * r;
    in.about_center = {across, across, along, 0, 0, 0};
  } else {
    const core::Vector3<double> h = s.size;
    in.mass = density * 8 * h.x * h.y * h.z;
    const double m = in.mass / 3;
    in.about_center = {m * (h.y * h.y + h.z * h.z), m * (h.x * h.x + h.z * h.z), m * (h.x * h.x + h.y * h.y), 0, 0, 0};
  }
  return in;
}

/// The same inertia seen from a frame in which its own frame sits at `position`, turned by `rotation`.
inline Inertia transformed(const Inertia& in, const core::Vector3<double>& position, const core::Quaternion<double>& rotation) {
  return {in.mass, position + rotation.rotate(in.center), rotated(in.about_center, rotation.matrix())};
}

/// Two inertias in one frame taken as one rigid body (parallel-axis theorem).
inline Inertia combined(const Inertia& a, const Inertia& b) {
  Inertia out;
  out.mass = a.mass + b.mass;
  if (!(out.mass > 0)) return out;
  out.center = (1 / out.mass) * (a.mass * a.center + b.mass * b.center);
  const auto shifted = [&](const Inertia& i) {
    const core::Vector3<double> d = i.center - out.center;
    return i.about_center + core::Symmetric3<double>::scalar(i.mass * squared_norm(d)) - core::Symmetric3<double>::outer(i.mass, d);
  };
  out.about_center = shifted(a) + shifted(b);
  return out;
}

}  // namespace traceur::body
