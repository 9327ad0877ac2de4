// SPDX-License-Identifier: MIT
#pragma once

#include "traceur/sim/numbers.hpp"
#include "traceur/terrain/box_scene.hpp"

namespace traceur::sim {

/// One box for each lane, each lane's own: a static box near the character or a free object. All of it rounded outwards by
/// `rounding`, so that half sizes of zero make a sphere.
template <class S>
struct Obstacle {
  core::Vector3<S> center;     ///< m, world
  core::Matrix3<S> rotation;   ///< box to world
  core::Vector3<S> half_size;  ///< m
  S rounding;                  ///< m
  S id;                        ///< which box of the lane's scene it is
};

/// Where a feature and an obstacle are closest, or deepest in each other.
template <class S>
struct Touch {
  S distance;               ///< between the surfaces, m; negative where they overlap
  core::Vector3<S> normal;  ///< unit, out of the obstacle, world
  core::Vector3<S> arm;     ///< from the feature's middle to its axis' closest point, m, world
};

/// Signed distance of a point (m, world) from an obstacle.
template <class S>
[[gnu::always_inline]] inline S obstacle_distance(const Obstacle<S>& o, const core::Vector3<S>& point) {
  return terrain::box_distance(transpose_times(o.rotation, point - o.center), o.half_size).distance - o.rounding;
}

/// A sphere of some radius about `center` (m, world) against an obstacle.
template <class S>
[[gnu::always_inline]] inline Touch<S> touch_sphere(const Obstacle<S>& o, const core::Vector3<S>& center, const S& radius) {
  const terrain::BoxSample<S> s = terrain::box_distance(transpose_times(o.rotation, center - o.center), o.half_size);
  return {s.distance - o.rounding - radius, o.rotation * s.normal, core::Vector3<S>::zero()};
}

/// A capsule against an obstacle. The signed distance from a convex body is convex, inside as well as outside, so bisection
/// of its slope along the axis finds the deepest point. Ends have spheres of their own: the capsule counts as far as it is
/// deeper than they are, so that lying flat does not make a third contact that comes and goes; where it is not deeper its
/// distance is any positive number.
template <class S>
[[gnu::always_inline]] inline Touch<S> touch_capsule(const Obstacle<S>& o, const core::Vector3<S>& center,
                                                     const core::Vector3<S>& half_axis, const S& radius) {
  using core::Vector3;
  using T = core::Element<S>;
  constexpr double deeper = 0.002;  // m, by which it must be deeper to count in full
  const Vector3<S> p = transpose_times(o.rotation, center - o.center), d = transpose_times(o.rotation, half_axis);
  const S zero(0.0), one(1.0);
  const terrain::BoxSample<S> first = terrain::box_distance(p - d, o.half_size), last = terrain::box_distance(p + d, o.half_size);
  const S ends = core::min(first.distance, last.distance), size = o.rounding + radius;
  // Convexity bounds how much deeper than its ends a segment can be, and a distance changes no faster than its point moves.
  const S gain = S(2.0) * core::min(-dot(first.normal, d), dot(last.normal, d));
  const S nearest = S(0.5) * (first.distance + last.distance) - norm(d) - size;
  const auto counts = (gain > S(static_cast<T>(0.01 * deeper))) & (nearest < zero);
  if (!core::any(counts)) return {one, Vector3<S>::zero(), Vector3<S>::zero()};
  S low(-1.0), high(1.0);
  for (int k = 0; k < 8; ++k) {
    const S t = S(0.5) * (low + high);
    const S slope = dot(terrain::box_distance(p + t * d, o.half_size).normal, d);
    low = core::select(slope > zero, low, t);
    high = core::select(slope < zero, high, t);
  }
  const S t = S(0.5) * (low + high);
  const terrain::BoxSample<S> s = terrain::box_distance(p + t * d, o.half_size);
  const S share = core::clamp((ends - s.distance) * S(static_cast<T>(1 / deeper)), zero, one);
  const S distance = s.distance - size;
  // Where the middle is deepest the surfaces are parallel along the axis, also at an edge, where one side's normal is not.
  const Vector3<S> along = s.normal - (dot(s.normal, d) / core::max(squared_norm(d), S(static_cast<T>(1e-12)))) * d;
  const S length = norm(along);
  const Vector3<S> normal = core::select(length > S(static_cast<T>(1e-3)), (one / core::max(length, S(static_cast<T>(1e-3)))) * along, s.normal);
  return {core::select(counts, core::select(distance < zero, share * distance, distance), one), o.rotation * normal, t * half_axis};
}

}  // namespace traceur::sim
