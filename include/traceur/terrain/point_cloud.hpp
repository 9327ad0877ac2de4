// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "traceur/core/error.hpp"
#include "traceur/core/random.hpp"
#include "traceur/core/rotation.hpp"
#include "traceur/terrain/box_scene.hpp"
#include "traceur/terrain/local_map.hpp"

namespace traceur::terrain {

/// A point of a box's surface. `u` in [0, 1) chooses the face, each by its share of the area; `v` and `w` in [0, 1) the
/// place on it. World, m.
inline core::Vector3<double> surface_point(const Box& box, double u, double v, double w) {
  const core::Vector3<double>& h = box.half_size;
  const double area[3] = {h.y * h.z, h.z * h.x, h.x * h.y};
  double at = u * 2 * (area[0] + area[1] + area[2]);
  int face = 0;
  while (face < 5 && at >= area[face / 2]) at -= area[face++ / 2];
  const double side = face % 2 == 0 ? -1 : 1, a = 2 * v - 1, b = 2 * w - 1;
  const core::Vector3<double> local = face / 2 == 0   ? core::Vector3<double>{side * h.x, a * h.y, b * h.z}
                                      : face / 2 == 1 ? core::Vector3<double>{a * h.x, side * h.y, b * h.z}
                                                      : core::Vector3<double>{a * h.x, b * h.y, side * h.z};
  return box.center + box.rotation.rotate(local);
}

/// Points on the surfaces of a scene's obstacles (HIL B.1), in groups that lie close together, one for each box.
template <class T = double>
class PointCloud {
public:
  static constexpr int default_per_box = 15;

  PointCloud() = default;

  /// Samples `per_box` points of each box, uniform on its surface. A box's faces get their points in proportion to
  /// their areas to within one point (stratified in u of `surface_point`), which plain sampling does only on average.
  /// Box b draws from stream b of `seed`: its points do not depend on the other boxes. Throws Error if per_box is below
  /// one.
  explicit PointCloud(const BoxScene& scene, int per_box = default_per_box, std::uint64_t seed = 0) {
    if (per_box < 1) throw Error("point cloud: expected at least one point per box");
    std::vector<core::Vector3<T>> group;
    for (int b = 0; b < scene.size(); ++b) {
      core::RandomStream random(seed, static_cast<std::uint64_t>(b));
      group.clear();
      for (int k = 0; k < per_box; ++k) {
        const double u = (k + random.uniform()) / per_box, v = random.uniform(), w = random.uniform();
        group.push_back(surface_point(scene.boxes()[static_cast<std::size_t>(b)], u, v, w).template cast<T>());
      }
      add_group(group);
    }
  }

  /// Adds points that lie close together, m, world. Throws Error if one is not finite.
  void add_group(std::span<const core::Vector3<T>> points) {
    if (points.empty()) return;
    core::Vector3<T> low = points[0], high = points[0];
    for (std::size_t k = 0; k < points.size(); ++k) {
      const core::Vector3<T>& p = points[k];
      if (!std::isfinite(p.x + p.y + p.z))
        throw Error("point cloud: point " + std::to_string(points_.size() + k) + " is not finite");
      low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
      high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
    }
    Group g{T(0.5) * (low + high), T(0), size(), size() + static_cast<int>(points.size())};
    for (const core::Vector3<T>& p : points) g.radius = std::max(g.radius, norm(p - g.center));
    points_.insert(points_.end(), points.begin(), points.end());
    groups_.push_back(g);
  }

  int size() const { return static_cast<int>(points_.size()); }
  bool empty() const { return points_.empty(); }
  int groups() const { return static_cast<int>(groups_.size()); }
  const core::Vector3<T>& operator[](int k) const { return points_[static_cast<std::size_t>(k)]; }

private:
  struct Group {
    core::Vector3<T> center;
    T radius;
    int first, last;
  };
  template <class>
  friend class NearestPoints;

  std::vector<core::Vector3<T>> points_;
  std::vector<Group> groups_;
};

/// Finds the N points of a cloud nearest to a place. Holds the memory a search needs, so one per thread; a search
/// allocates only in a cloud of more groups than any before.
///
/// Groups are visited in the order in which their bounding balls come near; the search ends at a ball that begins
/// beyond the N-th best point.
template <class T = double>
class NearestPoints {
public:
  static constexpr int default_count = 60;

  /// Throws Error if `count` is below one.
  explicit NearestPoints(int count = default_count, int groups = 64)
      : count_(static_cast<std::size_t>(std::max(count, 1))) {
    if (count < 1) throw Error("nearest points: expected to look for at least one");
    best_.reserve(count_);
    found_.reserve(count_);
    order_.reserve(static_cast<std::size_t>(std::max(groups, 0)));
  }

  int count() const { return static_cast<int>(count_); }

  /// Indices of the nearest points, nearest first, of two equally near the one of lower index first. All of them where
  /// the cloud has fewer than count(); none for a place that is not finite. Valid until the next call.
  std::span<const int> find(const PointCloud<T>& cloud, const core::Vector3<T>& place) {
    best_.clear();
    found_.clear();
    order_.clear();
    if (!std::isfinite(place.x + place.y + place.z)) return found_;
    for (std::size_t g = 0; g < cloud.groups_.size(); ++g) {
      const T to_center = norm(cloud.groups_[g].center - place), radius = cloud.groups_[g].radius;
      // Rounding may not put a ball farther away than its points.
      const T slack = 8 * std::numeric_limits<T>::epsilon() * (to_center + radius + norm(place));
      order_.push_back({std::max(to_center - radius - slack, T(0)), static_cast<int>(g)});
    }
    std::sort(order_.begin(), order_.end());
    for (const Entry& e : order_) {
      if (best_.size() == count_ && e.distance * e.distance > best_.front().distance) break;
      const auto& group = cloud.groups_[static_cast<std::size_t>(e.index)];
      for (int k = group.first; k < group.last; ++k) {
        const Entry candidate{squared_norm(cloud[k] - place), k};
        if (best_.size() == count_) {
          if (!(candidate < best_.front())) continue;
          std::pop_heap(best_.begin(), best_.end());
          best_.back() = candidate;
        } else {
          best_.push_back(candidate);
        }
        std::push_heap(best_.begin(), best_.end());
      }
    }
    std::sort_heap(best_.begin(), best_.end());
    for (const Entry& e : best_) found_.push_back(e.index);
    return found_;
  }

  /// The nearest points to the frame's origin in the frame's axes, nearest first, as count() triples x y z (m): what a
  /// HIL policy sees. Where the cloud has fewer points the nearest is repeated, which a network that takes the maximum
  /// over points does not notice; without any point all is zero. Returns how many points are real.
  int observe(const PointCloud<T>& cloud, const HeadingFrame<T>& frame, std::span<T> out) {
    find(cloud, frame.origin);
    for (std::size_t k = 0; k < count_; ++k) {
      const core::Vector3<T> p = found_.empty() ? core::Vector3<T>{T(0), T(0), T(0)}
                                                : frame.to_local(cloud[found_[k < found_.size() ? k : 0]]);
      out[3 * k] = p.x;
      out[3 * k + 1] = p.y;
      out[3 * k + 2] = p.z;
    }
    return static_cast<int>(found_.size());
  }

private:
  /// Distances of points are squared, those of groups are not.
  struct Entry {
    T distance;
    int index;
    bool operator<(const Entry& o) const {
      return distance < o.distance || (distance == o.distance && index < o.index);
    }
  };

  std::size_t count_;
  std::vector<Entry> best_;  // a heap with the farthest in front
  std::vector<Entry> order_;
  std::vector<int> found_;
};

/// How full the cells of a cube around the root are: the representation that HIL B.1 tried and dropped, kept to compare
/// with.
struct VoxelGrid {
  int side = 10;         ///< cells along each edge of the cube
  double spacing = 0.2;  ///< m

  int size() const { return side * side * side; }

  /// For each cell, i + side (j + side k) with i ahead, j to the left, k up, the share of it that is within a box,
  /// taken as that of a cell cut by one face at the signed distance of its middle: 1 half a cell deep or more, 0 half a
  /// cell off or more. `out` has size() entries; `scratch` is memory for the search of boxes.
  template <class T>
  void occupancy(const BoxScene& scene, const HeadingFrame<double>& frame, std::span<T> out,
                 std::vector<int>& scratch) const {
    scratch.clear();
    scene.near(frame.origin, 0.5 * std::sqrt(3.0) * side * spacing, scratch);
    std::size_t cell = 0;
    for (int k = 0; k < side; ++k)
      for (int j = 0; j < side; ++j)
        for (int i = 0; i < side; ++i) {
          const double half = 0.5 * (side - 1);
          const core::Vector3<double> place =
              frame.to_world({(i - half) * spacing, (j - half) * spacing, (k - half) * spacing});
          double nearest = std::numeric_limits<double>::infinity();
          for (const int b : scratch) {
            const Box& box = scene.boxes()[static_cast<std::size_t>(b)];
            nearest = std::min(
                nearest, box_distance(box.rotation.conjugate().rotate(place - box.center), box.half_size).distance);
          }
          out[cell++] = static_cast<T>(std::clamp(0.5 - nearest / spacing, 0.0, 1.0));
        }
  }
};

}  // namespace traceur::terrain
