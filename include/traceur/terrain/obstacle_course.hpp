// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "traceur/core/error.hpp"
#include "traceur/core/random.hpp"
#include "traceur/core/rotation.hpp"
#include "traceur/terrain/box_scene.hpp"

namespace traceur::terrain {

/// Something to get past, as it stands in a reference clip: boxes in a frame whose origin is on the ground and whose x
/// is the way across.
struct Obstacle {
  std::string name;
  std::vector<Box> boxes;  ///< m
};

/// How far an obstacle's boxes reach along its own x, m.
struct Extent {
  double entry = 0, exit = 0;
};
inline Extent extent_of(const Obstacle& obstacle) {
  Extent e{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  for (const Box& b : obstacle.boxes) {
    const double half = b.half_bounds().x;
    e.entry = std::min(e.entry, b.center.x - half);
    e.exit = std::max(e.exit, b.center.x + half);
  }
  return e;
}

/// How obstacles follow one another (HIL C.2), and how far they are from where they should be.
struct CourseParameters {
  int obstacles = 5;
  double gap_min = 2, gap_max = 3;            ///< m, from an obstacle's far side to the next one's near side
  double turn = 20 * std::numbers::pi / 180;  ///< rad, most by which an obstacle is turned against the one before
  double start_gap = 2;                       ///< m, from the world's origin to the first obstacle, which is not turned

  /// Standard deviations of the noise, zero in training: of an obstacle's place (m, each of x and y), of its heading
  /// (rad) and of its size (a factor around 1).
  double position_noise = 0, heading_noise = 0, scale_noise = 0;
  /// The paper's one number for all three; 0.03 by default there, 0 to 0.2 in its Figure 7.
  void set_noise(double sigma) { position_noise = heading_noise = scale_noise = sigma; }
};

/// A course of obstacles. Obstacle k of `placements` is a copy of obstacle `index` of the list it was drawn from.
struct ObstacleCourse {
  struct Placement {
    int index = 0;
    core::Vector3<double> position{0, 0, 0};  ///< of the obstacle's origin, m, world
    double heading = 0;                       ///< of the obstacle's x, rad, world
    double scale = 1;                         ///< about the obstacle's origin
    int first_box = 0, last_box = 0;          ///< its boxes in the scene, [first, last)

    /// World place of a point of the reference clip, in the frame of the obstacle. The clip's root is not scaled with
    /// the obstacle: a person stays as tall as they were.
    core::Vector3<double> place(const core::Vector3<double>& local) const {
      const double c = std::cos(heading), s = std::sin(heading);
      return position + core::Vector3<double>{c * local.x - s * local.y, s * local.x + c * local.y, local.z};
    }
  };

  BoxScene scene;
  std::vector<Placement> placements;
};

namespace detail {

inline void place_boxes(const Obstacle& obstacle, const ObstacleCourse::Placement& at, std::vector<Box>& out) {
  const core::Quaternion<double> turn = core::about_axis(core::Vector3<double>{0, 0, 1}, at.heading);
  for (const Box& b : obstacle.boxes)
    out.push_back({at.place(at.scale * b.center), at.scale * b.half_size, turn * b.rotation});
}

inline bool apart(const std::vector<Box>& boxes, std::size_t first) {
  for (std::size_t a = first; a < boxes.size(); ++a)
    for (std::size_t b = 0; b < first; ++b)
      if (norm(boxes[a].center - boxes[b].center) < norm(boxes[a].half_size) + norm(boxes[b].half_size) &&
          BoxScene::overlap_of(boxes[a], boxes[b]) > 0)
        return false;
  return true;
}

}  // namespace detail

/// Course number `index` of a seed: obstacles drawn from the list with equal chances, gaps and turns uniform (HIL C.2).
///
/// An obstacle stands where a walker comes to who leaves the one before straight over its far side and turns at once.
/// Noise moves and turns it on the ground and scales it about its place on the ground, so what stood still stands. It
/// comes from random numbers of its own: courses of one seed and index that differ in noise alone are the same course
/// more or less disturbed, as a sweep over noise wants. An obstacle that would touch one before it is drawn anew.
///
/// Throws Error if the list or an obstacle is empty, a range makes no sense, or an obstacle finds no place in a hundred
/// draws.
inline ObstacleCourse obstacle_course(const std::vector<Obstacle>& obstacles, const CourseParameters& p,
                                      std::uint64_t seed, std::uint64_t index = 0) {
  if (obstacles.empty()) throw Error("obstacle course: expected obstacles to choose from");
  for (const Obstacle& o : obstacles)
    if (o.boxes.empty()) throw Error("obstacle course: obstacle '" + o.name + "' has no boxes");
  if (p.obstacles < 0 || !(p.gap_min <= p.gap_max) || !(p.turn >= 0))
    throw Error("obstacle course: expected a number of obstacles, gap_min <= gap_max and a turn of zero or more");
  if (!(p.position_noise >= 0 && p.heading_noise >= 0 && p.scale_noise >= 0))
    throw Error("obstacle course: expected noise of zero or more");
  constexpr int attempts = 100;
  ObstacleCourse course;
  std::vector<Box> boxes;
  core::Vector3<double> exit{0, 0, 0};
  double heading = 0;
  for (int k = 0; k < p.obstacles; ++k) {
    core::RandomStream layout(seed, 2 * index, static_cast<std::uint64_t>(k));
    core::RandomStream noise(seed, 2 * index + 1, static_cast<std::uint64_t>(k));
    const std::size_t before = boxes.size();
    for (int attempt = 0;; ++attempt) {
      if (attempt == attempts)
        throw Error("obstacle course: obstacle " + std::to_string(k) +
                    " finds no place; expected wider gaps or less noise");
      ObstacleCourse::Placement at;
      at.index = static_cast<int>(layout.below(static_cast<std::uint32_t>(obstacles.size())));
      const Obstacle& obstacle = obstacles[static_cast<std::size_t>(at.index)];
      const Extent extent = extent_of(obstacle);
      const double gap = layout.uniform(p.gap_min, p.gap_max), turn = layout.uniform(-p.turn, p.turn);
      at.heading = k == 0 ? 0 : heading + turn;
      at.position = exit;
      at.position = at.place({(k == 0 ? p.start_gap : gap) - extent.entry, 0, 0});
      const core::Vector3<double> next_exit = at.place({extent.exit, 0, 0});
      const double next_heading = at.heading;

      at.position.x += p.position_noise * noise.normal();
      at.position.y += p.position_noise * noise.normal();
      at.heading += p.heading_noise * noise.normal();
      at.scale = std::max(1 + p.scale_noise * noise.normal(), 0.1);
      at.first_box = static_cast<int>(before);
      detail::place_boxes(obstacle, at, boxes);
      at.last_box = static_cast<int>(boxes.size());
      if (detail::apart(boxes, before)) {
        course.placements.push_back(at);
        exit = next_exit;
        heading = next_heading;
        break;
      }
      boxes.resize(before);
    }
  }
  course.scene = BoxScene(std::move(boxes), "obstacle course");
  return course;
}

}  // namespace traceur::terrain
