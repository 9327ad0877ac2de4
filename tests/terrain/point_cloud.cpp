// SPDX-License-Identifier: MIT
#include <traceur/terrain/point_cloud.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include <doctest/doctest.h>

namespace {

using namespace traceur;
using core::RandomStream;
using terrain::Box;
using terrain::BoxScene;
using terrain::HeadingFrame;
using terrain::NearestPoints;
using terrain::PointCloud;
using Vector = core::Vector3<double>;

Box any_box(RandomStream& random, double spread) {
  Box b;
  b.center = {random.uniform(-spread, spread), random.uniform(-spread, spread), random.uniform(0, 2)};
  b.half_size = {random.uniform(0.1, 1), random.uniform(0.1, 1), random.uniform(0.1, 1)};
  b.rotation =
      core::Quaternion<double>{random.normal(), random.normal(), random.normal(), random.normal()}.normalized();
  return b;
}

BoxScene any_scene(RandomStream& random, int boxes, double spread) {
  std::vector<Box> list;
  for (int k = 0; k < boxes; ++k) list.push_back(any_box(random, spread));
  return BoxScene(std::move(list), "scene", std::numeric_limits<double>::infinity());
}

template <class T>
std::vector<int> brute_force(const PointCloud<T>& cloud, const core::Vector3<T>& place, int count) {
  std::vector<std::pair<T, int>> all;
  for (int k = 0; k < cloud.size(); ++k) all.push_back({squared_norm(cloud[k] - place), k});
  std::sort(all.begin(), all.end());
  std::vector<int> out;
  for (std::size_t k = 0; k < all.size() && static_cast<int>(k) < count; ++k) out.push_back(all[k].second);
  return out;
}

template <class T>
void check_nearest() {
  RandomStream random(31);
  NearestPoints<T> search(60);
  for (int trial = 0; trial < 150; ++trial) {
    const PointCloud<T> cloud(any_scene(random, 1 + static_cast<int>(random.below(40)), trial % 2 ? 3 : 30), 15,
                              static_cast<std::uint64_t>(trial));
    for (int n = 0; n < 10; ++n) {
      const core::Vector3<T> place{static_cast<T>(random.uniform(-20, 20)), static_cast<T>(random.uniform(-20, 20)),
                                   T(1)};
      const auto found = search.find(cloud, place);
      CHECK(std::vector<int>(found.begin(), found.end()) == brute_force(cloud, place, 60));
    }
  }
}

}  // namespace

TEST_CASE("point cloud: fifteen points on every box's surface") {
  RandomStream random(32);
  const BoxScene scene = any_scene(random, 20, 5);
  const PointCloud<double> cloud(scene);
  CHECK(cloud.size() == 15 * 20);
  CHECK(cloud.groups() == 20);
  for (int k = 0; k < cloud.size(); ++k) {
    const Box& b = scene.boxes()[static_cast<std::size_t>(k / 15)];
    const Vector local = b.rotation.conjugate().rotate(cloud[k] - b.center);
    CHECK(std::abs(terrain::box_distance(local, b.half_size).distance) < 1e-12);
  }
  const PointCloud<double> again(scene), other(scene, 15, 1);
  CHECK(norm(again[7] - cloud[7]) == 0);
  CHECK(norm(other[7] - cloud[7]) > 0);
  // A box has its points whatever else is in the scene.
  const PointCloud<double> first(BoxScene({scene.boxes()[0]}));
  CHECK(norm(first[3] - cloud[3]) == 0);
}

TEST_CASE("point cloud: uniform on the surface: faces by area, every face evenly") {
  Box b;
  b.center = {1, 2, 3};
  b.half_size = {0.5, 1, 2};
  const double area[3] = {4 * 1 * 2, 4 * 0.5 * 2, 4 * 0.5 * 1}, whole = 2 * (area[0] + area[1] + area[2]);
  std::array<double, 6> counts{};
  Vector sum{0, 0, 0};
  std::array<double, 3> squares{};
  constexpr int clouds = 4000, per = 15;
  for (std::uint64_t seed = 0; seed < clouds; ++seed) {
    const PointCloud<double> cloud(BoxScene({b}), per, seed);
    std::array<int, 6> own{};
    for (int k = 0; k < cloud.size(); ++k) {
      const Vector p = cloud[k] - b.center;
      const double off[3] = {std::abs(std::abs(p.x) - 0.5), std::abs(std::abs(p.y) - 1), std::abs(std::abs(p.z) - 2)};
      const auto axis = static_cast<std::size_t>(std::min_element(off, off + 3) - off);
      const double along[3] = {p.x, p.y, p.z};
      ++own[2 * axis + (along[axis] > 0 ? 1 : 0)];
      sum += p;
      for (std::size_t e = 0; e < 3; ++e) squares[e] += along[e] * along[e];
    }
    for (std::size_t f = 0; f < 6; ++f) {
      counts[f] += own[f];
      CHECK(std::abs(own[f] - per * area[f / 2] / whole) < 2);
    }
  }
  constexpr double n = clouds * per;
  for (std::size_t f = 0; f < 6; ++f) CHECK(counts[f] / n == doctest::Approx(area[f / 2] / whole).epsilon(0.03));
  CHECK(norm(sum) / n < 0.02);
  // E x^2 on a face across x is h^2, on the others h^2 / 3.
  const double half[3] = {0.5, 1, 2};
  for (std::size_t e = 0; e < 3; ++e) {
    const double across = 2 * area[e] / whole;
    CHECK(squares[e] / n == doctest::Approx(half[e] * half[e] * (across + (1 - across) / 3)).epsilon(0.02));
  }
}

TEST_CASE("nearest points: those of a search through all of them, float and double") {
  check_nearest<double>();
  check_nearest<float>();
}

TEST_CASE("nearest points: of points equally near the lower index comes first") {
  PointCloud<double> cloud;
  const Vector here[] = {{1, 0, 0}, {0, 1, 0}, {-1, 0, 0}}, there[] = {{0, -1, 0}, {0, 0, 1}, {5, 0, 0}};
  cloud.add_group(here);
  cloud.add_group(there);
  NearestPoints<double> four(4), ten(10);
  auto found = four.find(cloud, {0, 0, 0});
  CHECK(std::vector<int>(found.begin(), found.end()) == std::vector<int>{0, 1, 2, 3});
  found = ten.find(cloud, {0, 0, 0});
  CHECK(std::vector<int>(found.begin(), found.end()) == std::vector<int>{0, 1, 2, 3, 4, 5});
  CHECK(ten.find(cloud, {0, std::numeric_limits<double>::quiet_NaN(), 0}).empty());
}

TEST_CASE("observation: nearest first, in the character's axes, padded by the nearest") {
  RandomStream random(33);
  const PointCloud<double> cloud(any_scene(random, 2, 4));
  NearestPoints<double> search;
  std::vector<double> out(180);
  const auto frame = HeadingFrame<double>::at({1, -2, 0.9}, 0.8);
  CHECK(search.observe(cloud, frame, out) == 30);
  double before = 0;
  for (std::size_t k = 0; k < 60; ++k) {
    const Vector local{out[3 * k], out[3 * k + 1], out[3 * k + 2]};
    if (k < 30) {
      CHECK(norm(local) >= before - 1e-12);
      before = norm(local);
      CHECK(norm(frame.to_world(local) - cloud[brute_force(cloud, frame.origin, 60)[k]]) < 1e-12);
    } else {
      CHECK(local.x == out[0]);
      CHECK(local.z == out[2]);
    }
  }
  // Turning and moving the scene with the character changes nothing.
  PointCloud<double> moved;
  std::vector<Vector> points;
  const auto motion = HeadingFrame<double>::at({3, 4, 0}, 2.0);
  for (int k = 0; k < cloud.size(); ++k) points.push_back(motion.to_world(cloud[k]));
  moved.add_group(points);
  std::vector<double> same(180);
  search.observe(moved, HeadingFrame<double>::at(motion.to_world(frame.origin), 2.8), same);
  for (std::size_t k = 0; k < 180; ++k) CHECK(same[k] == doctest::Approx(out[k]).scale(1));
  CHECK(search.observe(PointCloud<double>(), frame, out) == 0);
  CHECK(std::all_of(out.begin(), out.end(), [](double x) { return x == 0; }));
}

TEST_CASE("voxels: full within a box, empty away from it, by halves on its face") {
  const terrain::VoxelGrid voxels;
  CHECK(voxels.size() == 1000);
  std::vector<double> out(1000);
  std::vector<int> scratch;
  const auto frame = HeadingFrame<double>::at({2, 1, 1}, 0.5);
  // A wall in front of the character, turned like it: its near face through the middles of the cells 0.5 m ahead.
  Box wall;
  wall.center = frame.to_world({0.5 + 1, 0, 0});
  wall.half_size = {1, 4, 4};
  wall.rotation = core::about_axis(Vector{0, 0, 1}, 0.5);
  voxels.occupancy<double>(BoxScene({wall}), frame, out, scratch);
  for (int k = 0; k < 10; ++k)
    for (int j = 0; j < 10; ++j)
      for (int i = 0; i < 10; ++i)
        CHECK(out[static_cast<std::size_t>(i + 10 * (j + 10 * k))] == doctest::Approx(i < 7 ? 0 : i == 7 ? 0.5 : 1));
  voxels.occupancy<double>(BoxScene(), frame, out, scratch);
  CHECK(std::all_of(out.begin(), out.end(), [](double x) { return x == 0; }));
}

TEST_CASE("voxels: their sum is the volume, as well as cells can tell") {
  RandomStream random(34);
  const terrain::VoxelGrid voxels;
  std::vector<float> out(1000);
  std::vector<int> scratch;
  for (int trial = 0; trial < 20; ++trial) {
    Box b;
    b.half_size = {random.uniform(0.3, 0.5), random.uniform(0.3, 0.5), random.uniform(0.3, 0.5)};
    b.rotation = core::about_axis(Vector{0, 0, 1}, random.uniform(0, 3));
    voxels.occupancy<float>(BoxScene({b}), {}, out, scratch);
    double volume = 0;
    for (const float x : out) volume += 0.008 * static_cast<double>(x);
    CHECK(volume == doctest::Approx(8 * b.half_size.x * b.half_size.y * b.half_size.z).epsilon(0.1));
  }
}

TEST_CASE("point cloud: what makes no sense is refused") {
  const auto message = [](const auto& f) {
    try {
      f();
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  CHECK(message([] { PointCloud<double>(BoxScene(), 0); }) == "point cloud: expected at least one point per box");
  CHECK(message([] { NearestPoints<double>(0); }) == "nearest points: expected to look for at least one");
  PointCloud<double> cloud;
  const Vector bad[] = {{0, 0, 0}, {0, std::numeric_limits<double>::infinity(), 0}};
  CHECK(message([&] { cloud.add_group(bad); }) == "point cloud: point 1 is not finite");
  CHECK(cloud.empty());
}
