// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <cstddef>
#include <numbers>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "traceur/core/error.hpp"
#include "traceur/core/rotation.hpp"
#include "traceur/terrain/height_grid.hpp"

namespace traceur::terrain {

/// A character's own frame (PARC 6.1, HIL 6): origin at its root, x where the root faces, z up. `T`: `float` or
/// `double`.
template <class T = double>
struct HeadingFrame {
  core::Vector3<T> origin{0, 0, 0};  ///< m, world
  T cosine = 1, sine = 0;            ///< of the heading, counted from world +x about +z

  static HeadingFrame at(const core::Vector3<T>& origin, T heading) {
    return {origin, std::cos(heading), std::sin(heading)};
  }
  /// The frame of a root; a root that faces straight up or down is taken to face +x, as in core::heading.
  static HeadingFrame of(const core::Vector3<T>& position, const core::Quaternion<T>& rotation) {
    const core::Vector3<T> forward = core::heading(rotation).rotate({T(1), T(0), T(0)});
    return {position, forward.x, forward.y};
  }

  core::Vector3<T> direction_to_world(const core::Vector3<T>& v) const noexcept {
    return {cosine * v.x - sine * v.y, sine * v.x + cosine * v.y, v.z};
  }
  core::Vector3<T> direction_to_local(const core::Vector3<T>& v) const noexcept {
    return {cosine * v.x + sine * v.y, cosine * v.y - sine * v.x, v.z};
  }
  core::Vector3<T> to_world(const core::Vector3<T>& p) const noexcept { return origin + direction_to_world(p); }
  core::Vector3<T> to_local(const core::Vector3<T>& p) const noexcept { return direction_to_local(p - origin); }
};

/// Places in the ground plan on a square lattice: PARC's 31 by 31 view of its motion generator (s5.1, spacing and split
/// of the authors' code). Entry i + nx j lies i - back spacings ahead and j - side spacings to the left.
struct SquareMap {
  double spacing = 0.2;  ///< m
  int back = 10;         ///< places behind the root
  int ahead = 20;        ///< places before it
  int side = 15;         ///< places to each side
  double limit = 3;      ///< heights are limited to +- this, m; infinity for no limit

  int nx() const { return back + 1 + ahead; }
  int ny() const { return 2 * side + 1; }
};

/// Places on rays that fan out from the root: the view of PARC's motion tracker (authors' code; 7 rays of 63 places,
/// 441 heights). Entry k + points r is the k-th place of ray r; ray 0 is the rightmost.
struct HeightFan {
  int rays = 7;
  double half_angle = std::numbers::pi / 4;  ///< rad, from the middle ray to the outermost
  int points = 63;                           ///< per ray
  double first = -0.10;                      ///< of a ray's first place, m ahead of the root
  double spacing = 0.05;                     ///< m
  double limit = 3;                          ///< heights are limited to +- this, m; infinity for no limit
};

/// What a character sees of the ground: heights relative to its root at fixed places of its heading frame.
template <class T = double>
class LocalMap {
public:
  /// Throws Error on a spacing that is not positive or a number of places below one.
  explicit LocalMap(const SquareMap& p = {}) : limit_(static_cast<T>(p.limit)) {
    if (p.back < 0 || p.ahead < 0 || p.side < 0) throw Error("square map: expected no negative number of places");
    check("square map", p.spacing, p.limit);
    for (int j = -p.side; j <= p.side; ++j)
      for (int i = -p.back; i <= p.ahead; ++i) add(i * p.spacing, j * p.spacing);
  }
  explicit LocalMap(const HeightFan& p) : limit_(static_cast<T>(p.limit)) {
    if (p.rays < 1 || p.points < 1) throw Error("height fan: expected at least one ray of one place");
    check("height fan", p.spacing, p.limit);
    for (int r = 0; r < p.rays; ++r) {
      const double angle = p.rays == 1 ? 0 : p.half_angle * (2.0 * r / (p.rays - 1) - 1);
      for (int k = 0; k < p.points; ++k) {
        const double ahead = p.first + k * p.spacing;
        add(ahead * std::cos(angle), ahead * std::sin(angle));
      }
    }
  }

  int size() const noexcept { return static_cast<int>(x_.size()); }
  /// A place in the heading frame, m; z is 0.
  core::Vector3<T> place(int k) const {
    return {x_[static_cast<std::size_t>(k)], y_[static_cast<std::size_t>(k)], T(0)};
  }

  /// Height of the ground at every place less the height of the frame's origin, m, within the limit. `out` has size()
  /// entries. A frame that is not finite gives NaN.
  void sample(const HeightGrid& grid, const HeadingFrame<T>& frame, std::span<T> out) const noexcept {
    const HeightTable<T>& t = grid.table<T>();
    const T taint = T(0) * (frame.origin.x + frame.origin.y + frame.origin.z + frame.cosine + frame.sine);
    for (std::size_t k = 0; k < x_.size(); ++k) {
      const T x = frame.origin.x + (frame.cosine * x_[k] - frame.sine * y_[k]);
      const T y = frame.origin.y + (frame.sine * x_[k] + frame.cosine * y_[k]);
      out[k] = core::clamp(t.height(t.column(x), t.row(y)) - frame.origin.z, -limit_, limit_) + taint;
    }
  }

private:
  static void check(const char* name, double spacing, double limit) {
    if (!(spacing > 0)) throw Error(std::string(name) + ": expected a spacing above zero");
    if (!(limit > 0)) throw Error(std::string(name) + ": expected a limit above zero");
  }
  void add(double x, double y) {
    x_.push_back(static_cast<T>(x));
    y_.push_back(static_cast<T>(y));
  }

  std::vector<T> x_, y_;
  T limit_;
};

/// The terrain that a square map shows, in the heading frame: one cell around each place, heights relative to the
/// origin. Losses and `HeightBounds` then work on the view alone (PARC A.3, last sentence). `heights` has nx ny
/// entries.
template <class T>
inline HeightGrid local_grid(const SquareMap& p, std::span<const T> heights) {
  if (heights.size() != static_cast<std::size_t>(p.nx()) * static_cast<std::size_t>(p.ny()))
    throw Error("local grid: expected " + std::to_string(p.nx() * p.ny()) + " heights, found " +
                std::to_string(heights.size()));
  Eigen::MatrixXd h(p.nx(), p.ny());
  for (std::size_t k = 0; k < heights.size(); ++k) h.data()[k] = static_cast<double>(heights[k]);
  return HeightGrid(std::move(h), p.spacing, -(p.back + 0.5) * p.spacing, -(p.side + 0.5) * p.spacing, "local grid");
}

}  // namespace traceur::terrain
