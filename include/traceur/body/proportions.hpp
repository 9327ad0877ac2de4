// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <span>
#include <string>
#include <vector>

#include "traceur/body/character.hpp"

namespace traceur::body {

/// How much a segment is stretched along itself and across, and its joint's motor strengthened. Factors.
struct SegmentScale {
  double length = 1;
  double radius = 1;
  double strength = 1;  ///< of stiffness, damping and torque limit
};

/// The direction a segment is long in, body frame: from its joint towards its children, or to its own centre of mass where it
/// has none, or up where neither tells.
inline core::Vector3<double> segment_axis(const Character& c, int joint) {
  core::Vector3<double> sum{0, 0, 0};
  bool has_children = false;
  for (const Joint& j : c.skeleton.joints())
    if (j.parent == joint) {
      sum += j.offset;
      has_children = true;
    }
  if (!has_children) sum = c.inertias[static_cast<std::size_t>(joint)].center;
  const double length = norm(sum);
  return length > 1e-6 ? (1 / length) * sum : core::Vector3<double>{0, 0, 1};
}

/// The character with other proportions (Lee et al. 2021, s7.1): every segment is stretched by the linear map
/// A = radius (1 - a a^T) + length a a^T about its joint, a its axis. Density stays, so mass grows as length x radius^2;
/// centre of mass, inertia and the places of children and shapes follow A exactly, the shapes' own sizes as far as their kind
/// allows (a capsule stays round, a sphere's radius follows `radius`). One scale for each joint. Throws Error on another
/// number of scales or a factor that is not positive and finite.
inline Character with_proportions(const Character& character, std::span<const SegmentScale> scales) {
  using core::Matrix3;
  using core::Symmetric3;
  using core::Vector3;
  const auto n = static_cast<std::size_t>(character.skeleton.size());
  const std::string where = "proportions of '" + character.name + "': ";
  if (scales.size() != n) throw Error(where + "expected one scale for each of " + std::to_string(n) + " joints");
  std::vector<Matrix3<double>> map(n, Matrix3<double>::identity());
  for (std::size_t i = 0; i < n; ++i) {
    const SegmentScale& s = scales[i];
    for (const double factor : {s.length, s.radius, s.strength})
      if (!(factor > 0) || !std::isfinite(factor))
        throw Error(where + "body '" + character.skeleton[static_cast<int>(i)].body + "': expected factors above zero");
    const Vector3<double> a = segment_axis(character, static_cast<int>(i));
    map[i] = (Symmetric3<double>::scalar(s.radius) + Symmetric3<double>::outer(s.length - s.radius, a)).full();
  }
  Character out = character;
  out.skeleton = Skeleton();
  for (std::size_t i = 0; i < n; ++i) {
    Joint j = character.skeleton[static_cast<int>(i)];
    if (j.parent >= 0) j.offset = map[static_cast<std::size_t>(j.parent)] * j.offset;
    out.skeleton.add(std::move(j));

    const Matrix3<double>& m = map[i];
    const double growth = scales[i].length * scales[i].radius * scales[i].radius;
    Inertia& in = out.inertias[i];
    in.mass *= growth;
    in.center = m * in.center;
    // Second moments of mass, the integral of x x^T, are what a linear map acts on.
    const Symmetric3<double>& was = character.inertias[i].about_center;
    const Symmetric3<double> second = Symmetric3<double>::scalar(0.5 * (was.xx + was.yy + was.zz)) - was;
    const Symmetric3<double> moved = core::upper(m * (second.full() * m.transpose()));
    in.about_center = growth * (Symmetric3<double>::scalar(moved.xx + moved.yy + moved.zz) - moved);

    Actuator& a = out.actuators[i];
    a.stiffness *= scales[i].strength;
    a.damping *= scales[i].strength;
    a.torque_limit *= scales[i].strength;
  }
  for (Shape& s : out.shapes) {
    const auto body = static_cast<std::size_t>(s.body);
    const Matrix3<double>& m = map[body];
    s.position = m * s.position;
    const auto stretch = [&](const Vector3<double>& axis) { return norm(m * s.rotation.rotate(axis)); };
    if (s.kind == Shape::Kind::sphere) s.size.x *= scales[body].radius;
    if (s.kind == Shape::Kind::capsule) {
      s.size.x *= scales[body].radius;
      s.size.y *= stretch({0, 0, 1});
    }
    if (s.kind == Shape::Kind::box) {
      s.size.x *= stretch({1, 0, 0});
      s.size.y *= stretch({0, 1, 0});
      s.size.z *= stretch({0, 0, 1});
    }
  }
  return out;
}

}  // namespace traceur::body
