// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "traceur/core/error.hpp"
#include "traceur/core/rotation.hpp"

namespace traceur::terrain {

/// A solid box that does not move: a block, a wall, a step of a stair, a bar.
struct Box {
  core::Vector3<double> center{0, 0, 0};     ///< m, world
  core::Vector3<double> half_size{0, 0, 0};  ///< m, along the box's own axes
  core::Quaternion<double> rotation = core::Quaternion<double>::identity();  ///< box to world

  /// Half the sides of the smallest upright box around it, m, world axes.
  core::Vector3<double> half_bounds() const {
    const core::Matrix3<double> r = rotation.matrix();
    const core::Vector3<double>& h = half_size;
    return {std::abs(r.xx) * h.x + std::abs(r.xy) * h.y + std::abs(r.xz) * h.z,
            std::abs(r.yx) * h.x + std::abs(r.yy) * h.y + std::abs(r.yz) * h.z,
            std::abs(r.zx) * h.x + std::abs(r.zy) * h.y + std::abs(r.zz) * h.z};
  }
};

/// Signed distance from a box's surface and the unit outward normal there.
template <class S>
struct BoxSample {
  S distance;               ///< m, negative inside
  core::Vector3<S> normal;  ///< box axes or world axes, those of the point it was asked for
};

/// Distance of a point in the box's own axes (m) from a box of half sizes `h`. Outside, the normal points from the closest
/// point of the surface, so it turns smoothly about edges and corners; inside it is that of the nearest face.
template <class S>
[[gnu::always_inline]] inline BoxSample<S> box_distance(const core::Vector3<S>& p, const core::Vector3<S>& h) {
  using core::Vector3;
  using std::abs;
  using std::sqrt;
  const S zero(0.0), one(1.0);
  const Vector3<S> sign{core::select(p.x < zero, -one, one), core::select(p.y < zero, -one, one),
                        core::select(p.z < zero, -one, one)};
  const Vector3<S> d{abs(p.x) - h.x, abs(p.y) - h.y, abs(p.z) - h.z};
  const Vector3<S> out{core::max(d.x, zero), core::max(d.y, zero), core::max(d.z, zero)};
  const S beyond = sqrt(squared_norm(out));
  const S deepest = core::max(d.x, core::max(d.y, d.z));
  const auto inside = deepest <= zero;
  const auto by_x = (d.x >= d.y) & (d.x >= d.z);
  const auto by_y = d.y >= d.z;
  // A point that only rounding has put outside has a face's normal too: its distance is too short to give a direction.
  const S tiny(static_cast<core::Element<S>>(1e-12));
  const auto by_face = beyond <= tiny;
  const S inverse = one / core::max(beyond, tiny);
  const Vector3<S> face{core::select(by_x, one, zero), core::select(by_x, zero, core::select(by_y, one, zero)),
                        core::select(by_x, zero, core::select(by_y, zero, one))};
  const Vector3<S> n = core::select(by_face, face, inverse * out);
  return {core::select(inside, deepest, beyond), Vector3<S>{sign.x * n.x, sign.y * n.y, sign.z * n.z}};
}

/// Static boxes of any orientation, checked once, with a uniform grid over the ground plan that finds the few near a place.
/// Immutable; characters, planners and losses may share one.
class BoxScene {
 public:
  BoxScene() = default;

  /// Throws Error, one line beginning with `where` and naming the box, on a size that is not positive, a number that is not
  /// finite, a rotation that is not unit, boxes farther apart than numbers reach, or two that overlap by more than
  /// `overlap` m (those that touch are fine).
  explicit BoxScene(std::vector<Box> boxes, const std::string& where = "scene", double overlap = 1e-3)
      : boxes_(std::move(boxes)) {
    for (std::size_t i = 0; i < boxes_.size(); ++i) check(boxes_[i], where + ": box " + std::to_string(i) + ": ");
    index(where);
    std::vector<int> others;
    for (std::size_t i = 0; i < boxes_.size(); ++i) {
      others.clear();
      near(boxes_[i].center, norm(boxes_[i].half_size), others);
      for (int other : others)
        if (other > static_cast<int>(i) && overlap_of(boxes_[i], boxes_[static_cast<std::size_t>(other)]) > overlap)
          throw Error(where + ": boxes " + std::to_string(i) + " and " + std::to_string(other) + " overlap");
    }
  }

  const std::vector<Box>& boxes() const { return boxes_; }
  int size() const { return static_cast<int>(boxes_.size()); }
  bool empty() const { return boxes_.empty(); }

  /// Appends, in increasing order and once each, the indices of the boxes that may come within `radius` m of a point: all
  /// that do, and some that do not. None for a point or radius that is not a number.
  void near(const core::Vector3<double>& point, double radius, std::vector<int>& out) const {
    if (boxes_.empty() || !(radius >= 0) || !std::isfinite(point.x + point.y + point.z)) return;
    const std::size_t before = out.size();
    const int i0 = column(point.x - radius), i1 = column(point.x + radius);
    const int j0 = row(point.y - radius), j1 = row(point.y + radius);
    for (int j = j0; j <= j1; ++j)
      for (int i = i0; i <= i1; ++i) {
        const auto cell = static_cast<std::size_t>(i + nx_ * j);
        for (int k = first_[cell]; k < first_[cell + 1]; ++k) {
          const int b = listed_[static_cast<std::size_t>(k)];
          const core::Vector3<double> d = boxes_[static_cast<std::size_t>(b)].center - point;
          const core::Vector3<double>& h = bounds_[static_cast<std::size_t>(b)];
          if (std::abs(d.x) <= h.x + radius && std::abs(d.y) <= h.y + radius && std::abs(d.z) <= h.z + radius) out.push_back(b);
        }
      }
    std::sort(out.begin() + static_cast<std::ptrdiff_t>(before), out.end());
    out.erase(std::unique(out.begin() + static_cast<std::ptrdiff_t>(before), out.end()), out.end());
  }

  /// Signed distance of a point (m, world) from the nearest box and the world normal there; infinite without boxes.
  BoxSample<double> sample(const core::Vector3<double>& point) const {
    BoxSample<double> best{std::numeric_limits<double>::infinity(), {0, 0, 1}};
    for (const Box& b : boxes_) {
      const BoxSample<double> s = box_distance(b.rotation.conjugate().rotate(point - b.center), b.half_size);
      if (s.distance < best.distance) best = {s.distance, b.rotation.rotate(s.normal)};
    }
    return best;
  }

  /// How deep two boxes reach into each other along the axis in which they do so least (separating axes), m; negative when
  /// they are apart.
  static double overlap_of(const Box& a, const Box& b) {
    using core::Vector3;
    const core::Matrix3<double> ra = a.rotation.matrix(), rb = b.rotation.matrix();
    const std::array<Vector3<double>, 3> ea{Vector3<double>{ra.xx, ra.yx, ra.zx}, {ra.xy, ra.yy, ra.zy}, {ra.xz, ra.yz, ra.zz}};
    const std::array<Vector3<double>, 3> eb{Vector3<double>{rb.xx, rb.yx, rb.zx}, {rb.xy, rb.yy, rb.zy}, {rb.xz, rb.yz, rb.zz}};
    const Vector3<double> d = b.center - a.center;
    double least = std::numeric_limits<double>::infinity();
    const auto along = [&](const Vector3<double>& axis) {
      const double length = norm(axis);
      if (length < 1e-9) return;
      const auto extent = [&](const std::array<Vector3<double>, 3>& e, const Vector3<double>& h) {
        return std::abs(dot(axis, e[0])) * h.x + std::abs(dot(axis, e[1])) * h.y + std::abs(dot(axis, e[2])) * h.z;
      };
      least = std::min(least, (extent(ea, a.half_size) + extent(eb, b.half_size) - std::abs(dot(axis, d))) / length);
    };
    for (std::size_t i = 0; i < 3; ++i) {
      along(ea[i]);
      along(eb[i]);
      for (std::size_t j = 0; j < 3; ++j) along(cross(ea[i], eb[j]));
    }
    return least;
  }

 private:
  static void check(const Box& b, const std::string& where) {
    if (!std::isfinite(b.center.x + b.center.y + b.center.z)) throw Error(where + "centre is not finite");
    const double size = b.half_size.x + b.half_size.y + b.half_size.z;
    if (!(b.half_size.x > 0 && b.half_size.y > 0 && b.half_size.z > 0) || !std::isfinite(size))
      throw Error(where + "expected half sizes above zero");
    if (!(std::abs(dot(b.rotation, b.rotation) - 1) < 1e-6)) throw Error(where + "rotation is not a unit quaternion");
  }

  void index(const std::string& where) {
    if (boxes_.empty()) return;
    double x1 = -std::numeric_limits<double>::infinity(), y1 = x1;
    x0_ = y0_ = std::numeric_limits<double>::infinity();
    for (const Box& b : boxes_) {
      const core::Vector3<double> h = b.half_bounds();
      bounds_.push_back(h);
      x0_ = std::min(x0_, b.center.x - h.x);
      y0_ = std::min(y0_, b.center.y - h.y);
      x1 = std::max(x1, b.center.x + h.x);
      y1 = std::max(y1, b.center.y + h.y);
    }
    if (!std::isfinite(x1 - x0_) || !std::isfinite(y1 - y0_)) throw Error(where + ": boxes are too far apart");
    // At most some thousands of cells, however far the boxes are apart.
    cell_ = std::max({1.0, (x1 - x0_) / 64, (y1 - y0_) / 64});
    nx_ = 1 + static_cast<int>((x1 - x0_) / cell_);
    ny_ = 1 + static_cast<int>((y1 - y0_) / cell_);
    first_.assign(static_cast<std::size_t>(nx_ * ny_) + 1, 0);
    const auto each_cell = [&](std::size_t b, auto&& use) {
      for (int j = row(boxes_[b].center.y - bounds_[b].y); j <= row(boxes_[b].center.y + bounds_[b].y); ++j)
        for (int i = column(boxes_[b].center.x - bounds_[b].x); i <= column(boxes_[b].center.x + bounds_[b].x); ++i)
          use(static_cast<std::size_t>(i + nx_ * j));
    };
    for (std::size_t b = 0; b < boxes_.size(); ++b) each_cell(b, [&](std::size_t cell) { ++first_[cell + 1]; });
    for (std::size_t c = 1; c < first_.size(); ++c) first_[c] += first_[c - 1];
    listed_.resize(static_cast<std::size_t>(first_.back()));
    std::vector<int> next(first_.begin(), first_.end() - 1);
    for (std::size_t b = 0; b < boxes_.size(); ++b)
      each_cell(b, [&](std::size_t cell) { listed_[static_cast<std::size_t>(next[cell]++)] = static_cast<int>(b); });
  }

  int column(double x) const { return static_cast<int>(std::clamp((x - x0_) / cell_, 0.0, static_cast<double>(nx_ - 1))); }
  int row(double y) const { return static_cast<int>(std::clamp((y - y0_) / cell_, 0.0, static_cast<double>(ny_ - 1))); }

  std::vector<Box> boxes_;
  std::vector<core::Vector3<double>> bounds_;
  double x0_ = 0, y0_ = 0, cell_ = 1;
  int nx_ = 1, ny_ = 1;
  std::vector<int> first_, listed_;  ///< boxes of each cell
};

}  // namespace traceur::terrain
