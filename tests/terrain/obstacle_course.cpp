// SPDX-License-Identifier: MIT
#include <traceur/terrain/obstacle_course.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include "../error_message.hpp"

namespace {

using namespace traceur;
using terrain::Box;
using terrain::BoxScene;
using terrain::CourseParameters;
using terrain::Obstacle;
using terrain::ObstacleCourse;
using Vector = core::Vector3<double>;

Box upright(const Vector& center, const Vector& half) {
  Box b;
  b.center = center;
  b.half_size = half;
  return b;
}

std::vector<Obstacle> obstacles() {
  Box ramp = upright({0.2, 0, 0.5}, {0.5, 0.6, 0.1});
  ramp.rotation = core::about_axis(Vector{0, 1, 0}, -0.4);
  return {{"wall", {upright({1, 0, 0.5}, {0.1, 1, 0.5})}},
          {"steps", {upright({0, 0, 0.2}, {0.3, 0.8, 0.2}), upright({0.7, 0, 0.4}, {0.3, 0.8, 0.4})}},
          {"ramp", {ramp}}};
}

double wrapped(double angle) { return std::remainder(angle, 2 * std::numbers::pi); }

using traceur_test::message;

}  // namespace

TEST_CASE("extent: from the nearest to the farthest corner along x") {
  for (const Obstacle& o : obstacles()) {
    double low = 1e9, high = -1e9;
    for (const Box& b : o.boxes)
      for (int c = 0; c < 8; ++c) {
        const Vector corner =
            b.center + b.rotation.rotate({(c & 1 ? 1 : -1) * b.half_size.x, (c & 2 ? 1 : -1) * b.half_size.y,
                                          (c & 4 ? 1 : -1) * b.half_size.z});
        low = std::min(low, corner.x);
        high = std::max(high, corner.x);
      }
    CHECK(terrain::extent_of(o).entry == doctest::Approx(low));
    CHECK(terrain::extent_of(o).exit == doctest::Approx(high));
  }
}

TEST_CASE("course: five obstacles, gaps of 2 to 3 m, turned by at most 20 degrees, nothing touching") {
  const auto list = obstacles();
  const CourseParameters p;
  std::array<int, 3> drawn{};
  double shortest = 1e9, longest = 0, most = 0;
  for (std::uint64_t index = 0; index < 200; ++index) {
    const ObstacleCourse course = terrain::obstacle_course(list, p, 41, index);
    REQUIRE(course.placements.size() == 5);
    int boxes = 0;
    for (std::size_t k = 0; k < 5; ++k) {
      const auto& at = course.placements[k];
      const Obstacle& o = list[static_cast<std::size_t>(at.index)];
      ++drawn[static_cast<std::size_t>(at.index)];
      CHECK(at.scale == 1);
      CHECK(at.first_box == boxes);
      boxes += static_cast<int>(o.boxes.size());
      CHECK(at.last_box == boxes);
      const Vector entry = at.place({terrain::extent_of(o).entry, 0, 0});
      if (k == 0) {
        CHECK(norm(entry - Vector{2, 0, 0}) < 1e-12);
        CHECK(at.heading == 0);
        continue;
      }
      const auto& before = course.placements[k - 1];
      const Vector exit = before.place({terrain::extent_of(list[static_cast<std::size_t>(before.index)]).exit, 0, 0});
      const double gap = norm(entry - exit), turn = std::abs(wrapped(at.heading - before.heading));
      CHECK(gap >= 2);
      CHECK(gap <= 3);
      CHECK(turn <= 20 * std::numbers::pi / 180 + 1e-12);
      shortest = std::min(shortest, gap);
      longest = std::max(longest, gap);
      most = std::max(most, turn);
      // Whoever leaves the one before turns on the spot and walks straight at this one.
      CHECK(std::abs(wrapped(std::atan2(entry.y - exit.y, entry.x - exit.x) - at.heading)) < 1e-9);
    }
    CHECK(course.scene.size() == boxes);
  }
  CHECK(shortest < 2.02);
  CHECK(longest > 2.98);
  CHECK(most > 19 * std::numbers::pi / 180);
  for (const int n : drawn) CHECK(n > 250);
}

TEST_CASE("course: the boxes are the obstacle's, placed") {
  const auto list = obstacles();
  const ObstacleCourse course = terrain::obstacle_course(list, {}, 42);
  for (const auto& at : course.placements) {
    const Obstacle& o = list[static_cast<std::size_t>(at.index)];
    for (std::size_t b = 0; b < o.boxes.size(); ++b) {
      const Box& placed = course.scene.boxes()[static_cast<std::size_t>(at.first_box) + b];
      // The signed distance of any place is that in the obstacle's own frame.
      for (const Vector& local : {Vector{0.3, 0.2, 0.9}, Vector{-0.5, 1, 0.1}}) {
        const BoxScene own({o.boxes[b]}), there({placed});
        CHECK(there.sample(at.place(local)).distance == doctest::Approx(own.sample(local).distance));
      }
    }
  }
}

TEST_CASE("noise: of the size asked for, in place, heading and scale, and none of the layout's business") {
  const auto list = obstacles();
  CourseParameters p, noisy;
  noisy.set_noise(0.05);
  double position = 0, heading = 0, scale = 0, drift = 0;
  int n = 0;
  for (std::uint64_t index = 0; index < 800; ++index) {
    const ObstacleCourse plain = terrain::obstacle_course(list, p, 43, index),
                         off = terrain::obstacle_course(list, noisy, 43, index);
    for (std::size_t k = 0; k < 5; ++k) {
      const auto &a = plain.placements[k], &b = off.placements[k];
      REQUIRE(a.index == b.index);
      const Vector d = b.position - a.position;
      CHECK(d.z == 0);
      position += (d.x * d.x + d.y * d.y) / 2;
      heading += std::pow(b.heading - a.heading, 2);
      scale += std::pow(b.scale - 1, 2);
      drift += b.scale - 1;
      ++n;
    }
  }
  CHECK(std::sqrt(position / n) == doctest::Approx(0.05).epsilon(0.05));
  CHECK(std::sqrt(heading / n) == doctest::Approx(0.05).epsilon(0.05));
  CHECK(std::sqrt(scale / n) == doctest::Approx(0.05).epsilon(0.05));
  CHECK(std::abs(drift / n) < 0.004);
  // Twice the noise is the same disturbance twice.
  CourseParameters more = noisy;
  more.set_noise(0.1);
  const ObstacleCourse plain = terrain::obstacle_course(list, p, 43), one = terrain::obstacle_course(list, noisy, 43),
                       two = terrain::obstacle_course(list, more, 43);
  for (std::size_t k = 0; k < 5; ++k)
    CHECK(norm((two.placements[k].position - plain.placements[k].position) -
               2.0 * (one.placements[k].position - plain.placements[k].position)) < 1e-12);
}

TEST_CASE("noise: what stood on the ground stands") {
  CourseParameters p;
  p.set_noise(0.2);
  const std::vector<Obstacle> list{{"block", {upright({0, 0, 0.6}, {0.3, 0.3, 0.6})}}};
  for (std::uint64_t index = 0; index < 50; ++index) {
    const ObstacleCourse course = terrain::obstacle_course(list, p, 44, index);
    for (const Box& b : course.scene.boxes()) CHECK(b.center.z - b.half_size.z == doctest::Approx(0).scale(1));
    for (const auto& at : course.placements)
      CHECK(course.scene.boxes()[static_cast<std::size_t>(at.first_box)].half_size.x ==
            doctest::Approx(0.3 * at.scale));
  }
}

TEST_CASE("course: twenty obstacles that never touch, the same for the same seed") {
  CourseParameters p;
  p.obstacles = 20;
  p.set_noise(0.1);
  const auto list = obstacles();
  for (std::uint64_t index = 0; index < 30; ++index) {
    const ObstacleCourse course = terrain::obstacle_course(list, p, 45, index);
    const auto& boxes = course.scene.boxes();
    for (std::size_t a = 0; a < course.placements.size(); ++a)
      for (std::size_t b = a + 1; b < course.placements.size(); ++b)
        for (int k = course.placements[a].first_box; k < course.placements[a].last_box; ++k)
          for (int l = course.placements[b].first_box; l < course.placements[b].last_box; ++l)
            CHECK(BoxScene::overlap_of(boxes[static_cast<std::size_t>(k)], boxes[static_cast<std::size_t>(l)]) <= 0);
    const ObstacleCourse again = terrain::obstacle_course(list, p, 45, index);
    for (std::size_t k = 0; k < 20; ++k) CHECK(norm(again.placements[k].position - course.placements[k].position) == 0);
  }
  const ObstacleCourse other = terrain::obstacle_course(list, p, 46);
  CHECK(norm(other.placements[3].position - terrain::obstacle_course(list, p, 45).placements[3].position) > 0);
}

TEST_CASE("course: what cannot be made is refused") {
  const auto list = obstacles();
  CHECK(message([] { terrain::obstacle_course({}, {}, 1); }) == "obstacle course: expected obstacles to choose from");
  CHECK(message([] {
          terrain::obstacle_course({{"gate", {}}}, {}, 1);
        }) == "obstacle course: obstacle 'gate' has no boxes");
  CourseParameters p;
  p.gap_min = 4;
  CHECK(message([&] { terrain::obstacle_course(list, p, 1); }).find("gap_min <= gap_max") != std::string::npos);
  p = {};
  p.set_noise(-1);
  CHECK(message([&] { terrain::obstacle_course(list, p, 1); }) == "obstacle course: expected noise of zero or more");
  p = {};
  p.gap_min = p.gap_max = -3;
  const std::vector<Obstacle> long_one{{"slab", {upright({0, 0, 0.2}, {5, 1, 0.2})}}};
  CHECK(message([&] { terrain::obstacle_course(long_one, p, 1); }).find("finds no place") != std::string::npos);
}
