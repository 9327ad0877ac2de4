// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "traceur/sim/contact.hpp"
#include "traceur/sim/dynamics.hpp"

namespace traceur::sim {

/// A free rigid body that characters push, strike and land on.
struct ObjectShape {
  enum class Kind { box, sphere };
  Kind kind = Kind::box;
  core::Vector3<double> half_size{0.25, 0.25, 0.25};  ///< box: half extents; sphere: its radius first; m
  double mass = 10;                                   ///< kg, spread evenly
  core::Vector3<double> position{0, 0, 0.25};         ///< of its centre when its lane is reset, m

  /// Throws Error, one line beginning with `where`, on a size or mass that is not positive and finite.
  void check(const std::string& where) const {
    const bool sized = half_size.x > 0 && (kind == Kind::sphere || (half_size.y > 0 && half_size.z > 0));
    if (!sized || !std::isfinite(half_size.x + half_size.y + half_size.z)) throw Error(where + "expected a size above zero");
    if (!std::isfinite(position.x + position.y + position.z)) throw Error(where + "position is not finite");
    if (!(mass > 0) || !std::isfinite(mass)) throw Error(where + "expected a mass above zero");
  }

  /// Principal moments of inertia about its centre, kg m^2.
  core::Vector3<double> inertia() const {
    const core::Vector3<double>& h = half_size;
    if (kind == Kind::sphere) return (0.4 * mass * h.x * h.x) * core::Vector3<double>{1, 1, 1};
    return (mass / 3) * core::Vector3<double>{h.y * h.y + h.z * h.z, h.x * h.x + h.z * h.z, h.x * h.x + h.y * h.y};
  }

  body::Shape shape() const {
    body::Shape s;
    s.kind = kind == Kind::box ? body::Shape::Kind::box : body::Shape::Kind::sphere;
    s.size = half_size;
    return s;
  }
};

/// Numbers in an object's state, its contacts' memories apart: position of its centre (m), quaternion, velocity (m/s) and
/// angular velocity (rad/s), world axes.
inline constexpr int object_coordinates = 13;

/// How a free rigid body answers forces: the blocks of its inverse inertia, contacts included. Moments and velocities are
/// about the body's reference point.
template <class S>
struct Mobility {
  core::Symmetric3<S> mass_inverse, schur_inverse;
  core::Matrix3<S> h;

  Mobility() = default;
  /// From inertia J, coupling H and mass M as a BodyWork holds them.
  [[gnu::always_inline]] explicit Mobility(const BodyWork<S>& k) : mass_inverse(k.m.inverse()), h(k.h) {
    const core::Matrix3<S> mh = mass_inverse * h.transpose();
    schur_inverse = (k.j - core::upper(h * mh)).inverse();
  }

  struct Twist {
    core::Vector3<S> angular, linear;
  };
  /// Accelerations due to a moment and a force.
  [[gnu::always_inline]] Twist answer(const core::Vector3<S>& moment, const core::Vector3<S>& force) const {
    const core::Vector3<S> angular = schur_inverse * (moment - h * (mass_inverse * force));
    return {angular, mass_inverse * (force - transpose_times(h, angular))};
  }
  /// Acceleration of the point at `arm` for a unit force there: a symmetric 3x3 matrix, 1/kg.
  [[gnu::always_inline]] core::Symmetric3<S> at(const core::Vector3<S>& arm) const {
    using core::Vector3;
    const S zero(0.0), one(1.0);
    const auto column = [&](const Vector3<S>& e) {
      const Twist a = answer(cross(arm, e), e);
      return a.linear + cross(a.angular, arm);
    };
    const Vector3<S> x = column({one, zero, zero}), y = column({zero, one, zero}), z = column({zero, zero, one});
    return {x.x, y.y, z.z, x.y, x.z, y.z};
  }
};

/// The law f = f0 - K (u - u_o) of a contact with a body that gives way, as one against a body that does not: u_o' = `free` -
/// dt W f, where `free` is its velocity at the end of the step without the contact and W its mobility there, gives
///
///     f = (I + dt K W)^-1 (f0 + K free) - (K^-1 + dt W)^-1 u
///
/// With W times the number of contacts between the two (mass splitting) all of them together stay stable and what one
/// gains in momentum the other loses.
template <class S>
[[gnu::always_inline]] inline LinearContact<S> yielding(const LinearContact<S>& c, const core::Symmetric3<S>& mobility,
                                                        const core::Vector3<S>& free, const S& dt) {
  using core::Matrix3;
  using core::Vector3;
  const core::Symmetric3<S>& k = c.resistance;
  // (I + dt K W)^-1 by the adjugate: the product of two symmetric matrices is not symmetric.
  Matrix3<S> a = dt * (k * mobility.full());
  a.xx += S(1.0);
  a.yy += S(1.0);
  a.zz += S(1.0);
  const Vector3<S> yz = cross(a.row_y(), a.row_z()), zx = cross(a.row_z(), a.row_x()), xy = cross(a.row_x(), a.row_y());
  const S inverse = S(1.0) / dot(a.row_x(), yz);
  const Matrix3<S> g = inverse * Matrix3<S>{yz.x, zx.x, xy.x, yz.y, zx.y, xy.y, yz.z, zx.z, xy.z};
  return {g * (c.force + k * free), core::upper(g * k.full())};
}

/// Everything a group keeps about one object between and within steps.
template <class S>
struct ObjectWork {
  core::Vector3<S> half_size;           ///< zero for a sphere
  S rounding;                           ///< a sphere's radius, m
  S mass;
  core::Vector3<S> inertia;             ///< principal moments, kg m^2
  std::vector<SphereNumbers<S>> contacts;
  std::vector<FeatureNumbers<S>> features;
  S reach;                              ///< m
  BodyWork<S> body;
  Mobility<S> mobility;
  core::Vector3<S> force, moment;       ///< from the character in this step, about its centre
  core::Vector3<S> impulse;             ///< from the character over the last call of `step`, N s
  S touching;                           ///< contacts and grips that share it in this step
};

}  // namespace traceur::sim
