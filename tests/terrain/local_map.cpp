// SPDX-License-Identifier: MIT
#include <traceur/terrain/local_map.hpp>

#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/random.hpp>

namespace {

using namespace traceur;
using core::RandomStream;
using terrain::HeadingFrame;
using terrain::HeightFan;
using terrain::HeightGrid;
using terrain::LocalMap;
using terrain::SquareMap;
using Vector = core::Vector3<double>;

HeightGrid rough(RandomStream& random) {
  Eigen::MatrixXd h(25, 20);
  for (Eigen::Index k = 0; k < h.size(); ++k) h.data()[k] = random.uniform(-5, 5);
  return HeightGrid(h, 0.4, -4, -3);
}

std::vector<double> sampled(const LocalMap<double>& map, const HeightGrid& grid, const HeadingFrame<double>& frame) {
  std::vector<double> out(static_cast<std::size_t>(map.size()));
  map.sample(grid, frame, out);
  return out;
}

}  // namespace

TEST_CASE("heading frame: there and back, and the heading of a root that leans") {
  RandomStream random(21);
  for (int trial = 0; trial < 200; ++trial) {
    const Vector origin{random.uniform(-5, 5), random.uniform(-5, 5), random.uniform(-5, 5)};
    const double heading = random.uniform(-3.1, 3.1);
    const auto frame = HeadingFrame<double>::at(origin, heading);
    const Vector p{random.uniform(-5, 5), random.uniform(-5, 5), random.uniform(-5, 5)};
    CHECK(norm(frame.to_local(frame.to_world(p)) - p) < 1e-12);
    CHECK(norm(frame.to_world({1, 0, 0}) - origin - Vector{std::cos(heading), std::sin(heading), 0}) < 1e-12);
    // Pitch and roll do not change where the root faces.
    const auto turn = core::about_axis(Vector{0, 0, 1}, heading) *
                      core::about_axis(Vector{0, 1, 0}, random.uniform(-1.4, 1.4)) *
                      core::about_axis(Vector{1, 0, 0}, random.uniform(-3, 3));
    const auto of_root = HeadingFrame<double>::of(origin, turn);
    CHECK(of_root.cosine == doctest::Approx(std::cos(heading)));
    CHECK(of_root.sine == doctest::Approx(std::sin(heading)));
  }
}

TEST_CASE("square map: each entry is the height at its place in the turned frame") {
  RandomStream random(22);
  const HeightGrid grid = rough(random);
  const SquareMap p;
  const LocalMap<double> map(p);
  CHECK(map.size() == 31 * 31);
  CHECK(p.nx() == 31);
  CHECK(p.ny() == 31);
  int limited = 0;
  for (int trial = 0; trial < 50; ++trial) {
    const double heading = random.uniform(-3.1, 3.1);
    const Vector origin{random.uniform(-6, 8), random.uniform(-5, 7), random.uniform(-1, 1)};
    const std::vector<double> heights = sampled(map, grid, HeadingFrame<double>::at(origin, heading));
    int bad = 0;
    for (int j = 0; j < 31; ++j)
      for (int i = 0; i < 31; ++i) {
        const double ahead = 0.2 * (i - 10), left = 0.2 * (j - 15);
        const double x = origin.x + ahead * std::cos(heading) - left * std::sin(heading);
        const double y = origin.y + ahead * std::sin(heading) + left * std::cos(heading);
        // On the line between two cells rounding decides.
        const double to_x = (x - grid.x0()) / 0.4, to_y = (y - grid.y0()) / 0.4;
        if (std::abs(to_x - std::round(to_x)) < 1e-9 || std::abs(to_y - std::round(to_y)) < 1e-9) continue;
        const double h = grid.height(x, y) - origin.z, expected = std::min(std::max(h, -3.0), 3.0);
        limited += h != expected ? 1 : 0;
        if (std::abs(heights[static_cast<std::size_t>(i + 31 * j)] - expected) > 1e-12) ++bad;
      }
    CHECK(bad == 0);
  }
  CHECK(limited > 1000);
}

TEST_CASE("square map: turning and moving the world with the character changes nothing") {
  // A quarter turn maps cells onto cells.
  RandomStream random(23);
  Eigen::MatrixXd h(20, 20), turned(20, 20);
  for (Eigen::Index k = 0; k < h.size(); ++k) h.data()[k] = random.uniform(-1, 1);
  for (int j = 0; j < 20; ++j)
    for (int i = 0; i < 20; ++i) turned(19 - j, i) = h(i, j);
  const HeightGrid grid(h, 0.4, -4, -4), other(turned, 0.4, -4, -4);
  const LocalMap<double> map;
  for (int trial = 0; trial < 20; ++trial) {
    const double heading = random.uniform(-3, 3);
    const Vector at{random.uniform(-3, 3), random.uniform(-3, 3), 0.4};
    const auto a = sampled(map, grid, HeadingFrame<double>::at(at, heading));
    const auto b = sampled(map, other, HeadingFrame<double>::at({-at.y, at.x, at.z}, heading + std::numbers::pi / 2));
    int different = 0;
    for (std::size_t k = 0; k < a.size(); ++k) different += std::abs(a[k] - b[k]) > 1e-12 ? 1 : 0;
    CHECK(different == 0);
  }
}

TEST_CASE("height fan: 441 heights on seven rays from 10 cm behind to 3 m ahead") {
  RandomStream random(24);
  const HeightGrid grid = rough(random);
  const LocalMap<double> fan{HeightFan{}};
  CHECK(fan.size() == 441);
  CHECK(norm(fan.place(62 + 63 * 3) - Vector{3, 0, 0}) < 1e-12);
  CHECK(norm(fan.place(63 * 3) - Vector{-0.1, 0, 0}) < 1e-12);
  const double half = std::sqrt(0.5);
  CHECK(norm(fan.place(62) - Vector{3 * half, -3 * half, 0}) < 1e-12);
  CHECK(norm(fan.place(440) - Vector{3 * half, 3 * half, 0}) < 1e-12);
  const double degree = std::numbers::pi / 180;
  CHECK(std::atan2(fan.place(62 + 63).y, fan.place(62 + 63).x) == doctest::Approx(-30 * degree));
  const auto frame = HeadingFrame<double>::at({0.5, 0.7, 0.3}, 1.1);
  const auto heights = sampled(fan, grid, frame);
  for (int k = 0; k < fan.size(); ++k) {
    const Vector p = frame.to_world(fan.place(k));
    CHECK(heights[static_cast<std::size_t>(k)] == std::min(std::max(grid.height(p.x, p.y) - 0.3, -3.0), 3.0));
  }
  HeightFan one;
  one.rays = 1;
  CHECK(LocalMap<double>(one).place(62).y == 0);
}

TEST_CASE("local map: float agrees with double, and what is no number shows") {
  RandomStream random(25);
  const HeightGrid grid = rough(random);
  const LocalMap<double> precise;
  const LocalMap<float> fast;
  const auto at = HeadingFrame<double>::at({0.53, 0.71, 0.3}, 0.4321);
  const auto heights = sampled(precise, grid, at);
  std::vector<float> single(heights.size());
  fast.sample(grid, HeadingFrame<float>::at({0.53f, 0.71f, 0.3f}, 0.4321f), single);
  int different = 0;
  for (std::size_t k = 0; k < heights.size(); ++k)
    different += std::abs(heights[k] - static_cast<double>(single[k])) > 1e-5 ? 1 : 0;
  CHECK(different == 0);
  constexpr double no_number = std::numeric_limits<double>::quiet_NaN();
  for (const Vector& bad :
       {Vector{no_number, 0, 0}, Vector{0, std::numeric_limits<double>::infinity(), 0}, Vector{0, 0, no_number}})
    for (const double h : sampled(precise, grid, HeadingFrame<double>::at(bad, 0.0))) CHECK(std::isnan(h));
}

TEST_CASE("local grid: the view as terrain gives back the view") {
  RandomStream random(26);
  const HeightGrid grid = rough(random);
  const SquareMap p;
  const LocalMap<double> map(p);
  const auto heights = sampled(map, grid, HeadingFrame<double>::at({1, 2, 0.5}, 2.0));
  const HeightGrid local = terrain::local_grid<double>(p, heights);
  CHECK(sampled(map, local, {}) == heights);
  for (int k = 0; k < map.size(); ++k)
    CHECK(local.height(map.place(k).x + 0.09, map.place(k).y - 0.09) == heights[static_cast<std::size_t>(k)]);
}

TEST_CASE("local map: sizes that make no sense are refused") {
  const auto message = [](auto p) {
    try {
      LocalMap<double> map(p);
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  SquareMap square;
  square.spacing = 0;
  CHECK(message(square) == "square map: expected a spacing above zero");
  square = {};
  square.back = -1;
  CHECK(message(square) == "square map: expected no negative number of places");
  HeightFan fan;
  fan.rays = 0;
  CHECK(message(fan) == "height fan: expected at least one ray of one place");
  fan = {};
  fan.limit = 0;
  CHECK(message(fan) == "height fan: expected a limit above zero");
}
