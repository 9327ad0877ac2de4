// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <map>
#include <numbers>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "traceur/body/character.hpp"

namespace traceur::body {

/// A point on the surface of a body's shape.
struct SurfacePoint {
  int body = 0;                          ///< joint index of the body
  core::Vector3<double> local{0, 0, 0};  ///< m, in the body's frame
};

/// How many points stand for a shape. The defaults are those of PARC's released code: a box has a lattice of 3 by 6 on
/// each of 2 slices (36 points), a capsule 4 points on each of 4 circles around its axis (16), a sphere the 12 corners
/// of an icosahedron.
struct SurfaceSampling {
  int box_x = 3, box_y = 6, box_z = 2;  ///< points along each edge, at least 2
  int capsule_slices = 4;               ///< circles from one end of the axis to the other, at least 2
  int capsule_circle = 4;               ///< points on each, at least 3; the first where the shape's x axis leaves
  bool capsule_poles = false;           ///< also the two outermost points of the round ends
  int sphere_subdivisions = 0;          ///< 0: 12 points, 1: 42, each further one about four times as many
};

namespace detail {

/// Corners of an icosahedron whose triangles were cut in four `subdivisions` times, on the unit sphere.
inline std::vector<core::Vector3<double>> unit_sphere_points(int subdivisions) {
  using Vec = core::Vector3<double>;
  const double g = std::numbers::phi;
  std::vector<Vec> points;
  for (const double a : {1.0, -1.0})
    for (const double b : {g, -g})
      for (const Vec& v : {Vec{a, b, 0}, Vec{0, a, b}, Vec{b, 0, a}}) points.push_back((1 / norm(v)) * v);
  // Two corners share an edge if they are as near as corners can be.
  const double edge = 1.01 * 2 / std::sqrt(1 + g * g);
  std::vector<std::array<std::size_t, 3>> faces;
  const auto joined = [&](std::size_t i, std::size_t j) { return norm(points[i] - points[j]) < edge; };
  for (std::size_t i = 0; i < 12; ++i)
    for (std::size_t j = i + 1; j < 12; ++j)
      for (std::size_t k = j + 1; k < 12; ++k)
        if (joined(i, j) && joined(j, k) && joined(i, k)) faces.push_back({i, j, k});
  for (int s = 0; s < subdivisions; ++s) {
    std::map<std::pair<std::size_t, std::size_t>, std::size_t> middles;
    const auto middle = [&](std::size_t i, std::size_t j) {
      const auto [found, fresh] = middles.try_emplace({i < j ? i : j, i < j ? j : i}, points.size());
      if (fresh) {
        const Vec m = points[i] + points[j];
        points.push_back((1 / norm(m)) * m);
      }
      return found->second;
    };
    std::vector<std::array<std::size_t, 3>> finer;
    for (const auto& [i, j, k] : faces) {
      const std::size_t a = middle(i, j), b = middle(j, k), c = middle(k, i);
      finer.insert(finer.end(), {{i, a, c}, {a, j, b}, {c, b, k}, {a, b, c}});
    }
    faces = std::move(finer);
  }
  return points;
}

}  // namespace detail

/// Points on the surface of one shape, in its body's frame. Throws Error if a number of points is out of range.
inline std::vector<SurfacePoint> surface_points(const Shape& shape, const SurfaceSampling& s = {}) {
  using Vec = core::Vector3<double>;
  const std::string where = "surface points of '" + shape.name + "': ";
  std::vector<SurfacePoint> out;
  const auto add = [&](const Vec& p) { out.push_back({shape.body, shape.position + shape.rotation.rotate(p)}); };
  const auto along = [](int i, int n, double half) { return half * (2.0 * i / (n - 1) - 1); };
  switch (shape.kind) {
    case Shape::Kind::sphere:
      if (s.sphere_subdivisions < 0 || s.sphere_subdivisions > 6) throw Error(where + "expected 0 to 6 subdivisions");
      for (const Vec& v : detail::unit_sphere_points(s.sphere_subdivisions)) add(shape.size.x * v);
      break;
    case Shape::Kind::capsule:
      if (s.capsule_slices < 2 || s.capsule_circle < 3)
        throw Error(where + "expected at least 2 circles of at least 3 points");
      for (int i = 0; i < s.capsule_slices; ++i)
        for (int k = 0; k < s.capsule_circle; ++k) {
          const double angle = 2 * std::numbers::pi * k / s.capsule_circle;
          add({shape.size.x * std::cos(angle), shape.size.x * std::sin(angle), along(i, s.capsule_slices, shape.size.y)});
        }
      if (s.capsule_poles)
        for (const double end : {-1.0, 1.0}) add({0, 0, end * (shape.size.x + shape.size.y)});
      break;
    case Shape::Kind::box:
      if (s.box_x < 2 || s.box_y < 2 || s.box_z < 2) throw Error(where + "expected at least 2 points along each edge");
      for (int k = 0; k < s.box_z; ++k)
        for (int i = 0; i < s.box_x; ++i)
          for (int j = 0; j < s.box_y; ++j)
            add({along(i, s.box_x, shape.size.x), along(j, s.box_y, shape.size.y), along(k, s.box_z, shape.size.z)});
      break;
  }
  return out;
}

/// Points on all shapes of a character (PARC C.1), body after body. Throws Error as for one shape.
inline std::vector<SurfacePoint> surface_points(const Character& character, const SurfaceSampling& s = {}) {
  std::vector<SurfacePoint> out;
  for (int b = 0; b < character.skeleton.size(); ++b)
    for (const Shape& shape : character.shapes) {
      if (shape.body != b) continue;
      const std::vector<SurfacePoint> points = surface_points(shape, s);
      out.insert(out.end(), points.begin(), points.end());
    }
  return out;
}

/// Where the points are in the world, m: 3 numbers for each, one after the other. Any scalar.
template <class S>
inline void place_points(std::span<const SurfacePoint> points, const Frames<S>& frames, S* out) noexcept {
  for (std::size_t k = 0; k < points.size(); ++k)
    frames.point(points[k].body, points[k].local.template cast<S>()).store(out + 3 * k);
}

}  // namespace traceur::body
