// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <utility>

#include <Eigen/Core>

#include "traceur/body/character.hpp"
#include "traceur/core/error.hpp"
#include "traceur/core/random.hpp"
#include "traceur/terrain/generators.hpp"
#include "traceur/terrain/height_grid.hpp"

namespace traceur::terrain {

/// How closely a motion and its ground belong together.
struct BoundMargins {
  double clearance = 0.02;  ///< kept free below every part of the body, m
  double support = 0.05;    ///< ground within this of the body may carry it and stays as it is, m
};

/// For each cell of a terrain, how low and how high its top may be for a motion to remain as it was (PARC A.3).
///
/// Collects the places of the body's parts, frame by frame. A top may rise to `clearance` below the lowest part of the
/// body that was ever above it. It may not sink where the body stood on it, nor, next to the body, below the body's
/// upper end: there it may be a wall that a hand pushed. The heights the terrain has are always within the bounds, also
/// where the motion already went through the ground. Between frames nothing is known: of a motion with few frames, add
/// poses in between.
///
///        ____                    upper   lower
///       |body|       over:       |   z_low - clearance, h if it stood there (within support), else none
///       |____|       beside:     |   none, at most z_high
///   ___        ___
///      |______|      elsewhere:  |   none, none
class HeightBounds {
public:
  explicit HeightBounds(HeightGrid grid, const BoundMargins& margins = {})
      : grid_(std::move(grid)),
        margins_(margins),
        lower_(Eigen::MatrixXd::Constant(grid_.nx(), grid_.ny(), -std::numeric_limits<double>::infinity())),
        upper_(Eigen::MatrixXd::Constant(grid_.nx(), grid_.ny(), std::numeric_limits<double>::infinity())) {
    if (!(margins.clearance >= 0) || !(margins.support >= 0))
      throw Error("height bounds: expected clearance and support of zero or more");
  }

  const HeightGrid& grid() const { return grid_; }
  /// Lowest and highest permitted height of each cell, nx by ny, m; infinite where nothing binds.
  const Eigen::MatrixXd& lower() const { return lower_; }
  const Eigen::MatrixXd& upper() const { return upper_; }

  /// A ball, m, world. Exact.
  void add_ball(const core::Vector3<double>& center, double radius) {
    const double reach = radius + margins_.support;
    each_cell(center, {reach, reach, 0}, [&](int i, int j) {
      const double dx = std::max({west(i) - center.x, center.x - east(i), 0.0});
      const double dy = std::max({south(j) - center.y, center.y - north(j), 0.0});
      const double squared = dx * dx + dy * dy;
      if (squared <= radius * radius) {
        over(i, j, center.z - std::sqrt(radius * radius - squared));
      } else if (squared <= reach * reach) {
        beside(i, j, center.z - radius, center.z + radius);
      }
    });
  }

  /// A capsule between two points, m, world. Covered by balls, which makes it at most 3 % too thick.
  void add_capsule(const core::Vector3<double>& from, const core::Vector3<double>& to, double radius) {
    const double length = norm(to - from);
    const int pieces = std::max(1, static_cast<int>(std::ceil(std::min(2 * length / radius, 1e4))));
    const double covering = std::hypot(radius, 0.5 * length / pieces);
    for (int k = 0; k <= pieces; ++k) add_ball(from + (static_cast<double>(k) / pieces) * (to - from), covering);
  }

  /// A box of half sizes `half`, m, world. Exact.
  void add_box(const core::Vector3<double>& center, const core::Vector3<double>& half,
               const core::Quaternion<double>& rotation) {
    using core::Vector3;
    std::array<Vector3<double>, 8> corners;
    Vector3<double> bounds{0, 0, 0};
    for (std::size_t c = 0; c < 8; ++c) {
      const Vector3<double> offset = rotation.rotate(
          {(c & 1) != 0 ? half.x : -half.x, (c & 2) != 0 ? half.y : -half.y, (c & 4) != 0 ? half.z : -half.z});
      corners[c] = center + offset;
      bounds = {std::max(bounds.x, std::abs(offset.x)), std::max(bounds.y, std::abs(offset.y)),
                std::max(bounds.z, std::abs(offset.z))};
    }
    const double s = margins_.support;
    each_cell(center, {bounds.x + s, bounds.y + s, 0}, [&](int i, int j) {
      const double z = lowest_within(corners, i, j);
      if (z < std::numeric_limits<double>::infinity()) {
        over(i, j, z);
      } else {
        beside(i, j, center.z - bounds.z, center.z + bounds.z);
      }
    });
  }

  /// All shapes of a character whose bodies are at `frames`.
  void add(const body::Character& character, const body::Frames<double>& frames) {
    for (const body::Shape& s : character.shapes) {
      const core::Vector3<double> center = frames.point(s.body, s.position);
      const core::Quaternion<double> rotation = frames.rotation[static_cast<std::size_t>(s.body)] * s.rotation;
      switch (s.kind) {
        case body::Shape::Kind::sphere:
          add_ball(center, s.size.x);
          break;
        case body::Shape::Kind::capsule: {
          const core::Vector3<double> axis = rotation.rotate({0, 0, s.size.y});
          add_capsule(center - axis, center + axis, s.size.x);
          break;
        }
        case body::Shape::Kind::box:
          add_box(center, s.size, rotation);
          break;
      }
    }
  }

  /// Brings heights, nx by ny, within the bounds.
  void clamp(Eigen::Ref<Eigen::MatrixXd> heights) const { heights = heights.cwiseMin(upper_).cwiseMax(lower_); }

private:
  // The border's cells go on for ever.
  double west(int i) const { return i == 0 ? -std::numeric_limits<double>::infinity() : grid_.x0() + i * grid_.cell(); }
  double east(int i) const {
    return i == grid_.nx() - 1 ? std::numeric_limits<double>::infinity() : grid_.x0() + (i + 1) * grid_.cell();
  }
  double south(int j) const {
    return j == 0 ? -std::numeric_limits<double>::infinity() : grid_.y0() + j * grid_.cell();
  }
  double north(int j) const {
    return j == grid_.ny() - 1 ? std::numeric_limits<double>::infinity() : grid_.y0() + (j + 1) * grid_.cell();
  }

  template <class F>
  void each_cell(const core::Vector3<double>& center, const core::Vector3<double>& reach, F&& f) const {
    if (!std::isfinite(center.x + center.y + center.z + reach.x + reach.y))
      throw Error("height bounds: a place is not finite");
    const int i1 = grid_.column(center.x + reach.x), j1 = grid_.row(center.y + reach.y);
    for (int j = grid_.row(center.y - reach.y); j <= j1; ++j)
      for (int i = grid_.column(center.x - reach.x); i <= i1; ++i) f(i, j);
  }

  void over(int i, int j, double z_low) {
    const double h = grid_(i, j);
    upper_(i, j) = std::min(upper_(i, j), std::max(h, z_low - margins_.clearance));
    if (z_low - h <= margins_.support) lower_(i, j) = h;
  }

  void beside(int i, int j, double z_low, double z_high) {
    const double h = grid_(i, j);
    if (h > z_low) lower_(i, j) = std::max(lower_(i, j), std::min(h, z_high));
  }

  // A convex body's lowest point over a rectangle lies on its surface: each face is cut to the rectangle.
  double lowest_within(const std::array<core::Vector3<double>, 8>& corners, int i, int j) const {
    constexpr std::size_t faces[6][4] = {{0, 1, 3, 2}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                         {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 3, 7, 5}};
    const double low[2] = {west(i), south(j)}, high[2] = {east(i), north(j)};
    double lowest = std::numeric_limits<double>::infinity();
    for (const auto& face : faces) {
      // Each of the four cuts adds one corner at most.
      std::array<core::Vector3<double>, 8> polygon, next;
      std::size_t n = 0;
      for (const std::size_t c : face) polygon[n++] = corners[c];
      for (int cut = 0; cut < 4 && n > 0; ++cut) {
        const bool along_x = cut < 2;
        const double sign = cut % 2 == 0 ? 1 : -1;
        const double bound = cut % 2 == 0 ? low[along_x ? 0 : 1] : high[along_x ? 0 : 1];
        if (!std::isfinite(bound)) continue;
        const auto within = [&](const core::Vector3<double>& p) { return sign * ((along_x ? p.x : p.y) - bound); };
        std::size_t kept = 0;
        for (std::size_t k = 0; k < n; ++k) {
          const core::Vector3<double>&a = polygon[k], &b = polygon[(k + 1) % n];
          const double da = within(a), db = within(b);
          if (da >= 0) next[kept++] = a;
          if ((da < 0) != (db < 0)) next[kept++] = a + (da / (da - db)) * (b - a);
        }
        polygon = next;
        n = kept;
      }
      for (std::size_t k = 0; k < n; ++k) lowest = std::min(lowest, polygon[k].z);
    }
    return lowest;
  }

  HeightGrid grid_;
  BoundMargins margins_;
  Eigen::MatrixXd lower_, upper_;
};

/// What `augmented` does to a terrain before it brings it back within the bounds. Numbers of PARC's code, which sets
/// them for the 31 by 31 view; how its flattening and shift are placed is chosen here.
struct Augmentation {
  int boxes = 4;                       ///< most rotated boxes; their number is uniform in [0, boxes]
  double side_min = 2, side_max = 12;  ///< cells, each of a box's two sides
  double rise_min = -2, rise_max = 2;  ///< of a box's top over the ground at its middle, m
  int flattenings = 3;                 ///< how often a flattening is considered
  double flattening_chance = 0.15;     ///< that a square of cells is raised to its highest
  int flattening_side = 10;            ///< cells, longest side of that square (shortest 2)
  double shift_chance = 0.1;           ///< that the whole terrain is raised by between rise_min and rise_max
};

/// Another terrain on which the motion behind `bounds` takes place unchanged (PARC A.3): boxes turned by any angle,
/// flattened squares and now and then another level, all within the bounds.
inline HeightGrid augmented(const HeightBounds& bounds, const Augmentation& p, core::RandomStream& random) {
  if (p.boxes < 0 || p.flattenings < 0 || p.flattening_side < 2 || !(p.side_min > 0) || !(p.side_min <= p.side_max) ||
      !(p.rise_min <= p.rise_max))
    throw Error("augmentation: expected numbers of zero or more and ranges that are not empty");
  const HeightGrid& grid = bounds.grid();
  Eigen::MatrixXd h = grid.heights();
  const int boxes = detail::between(random, 0, p.boxes);
  for (int b = 0; b < boxes; ++b) {
    // In cells, the middle of cell (i, j) at (i, j).
    const double ci = random.uniform(-0.5, grid.nx() - 0.5), cj = random.uniform(-0.5, grid.ny() - 0.5);
    const double half_i = 0.5 * random.uniform(p.side_min, p.side_max),
                 half_j = 0.5 * random.uniform(p.side_min, p.side_max);
    const double angle = random.uniform(0, std::numbers::pi), c = std::cos(angle), s = std::sin(angle);
    const double rise = random.uniform(p.rise_min, p.rise_max);
    const double top = rise + h(std::clamp(static_cast<int>(std::lround(ci)), 0, grid.nx() - 1),
                                std::clamp(static_cast<int>(std::lround(cj)), 0, grid.ny() - 1));
    for (int j = 0; j < grid.ny(); ++j)
      for (int i = 0; i < grid.nx(); ++i)
        if (std::abs(c * (i - ci) + s * (j - cj)) <= half_i && std::abs(c * (j - cj) - s * (i - ci)) <= half_j)
          h(i, j) = top;
  }
  for (int k = 0; k < p.flattenings; ++k) {
    if (!random.bernoulli(p.flattening_chance)) continue;
    const int side = detail::between(random, 2, p.flattening_side);
    const int rows = std::min(side, grid.nx()), cols = std::min(side, grid.ny());
    const int i = detail::between(random, 0, grid.nx() - rows), j = detail::between(random, 0, grid.ny() - cols);
    h.block(i, j, rows, cols).setConstant(h.block(i, j, rows, cols).maxCoeff());
  }
  if (random.bernoulli(p.shift_chance)) h.array() += random.uniform(p.rise_min, p.rise_max);
  bounds.clamp(h);
  return HeightGrid(std::move(h), grid.cell(), grid.x0(), grid.y0(), "augmentation");
}

}  // namespace traceur::terrain
