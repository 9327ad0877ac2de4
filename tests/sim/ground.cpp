// SPDX-License-Identifier: MIT
#include <traceur/sim/ground.hpp>

#include <cmath>
#include <limits>
#include <memory>

#include <doctest/doctest.h>

#include <traceur/core/random.hpp>

using traceur::Error;
using traceur::core::Pack;
using traceur::core::Vector3;
using traceur::sim::Ground;

TEST_CASE("ground: a point's distance to a plane") {
  const Ground<double> level;
  CHECK(level.highest() == 0);
  CHECK(level.sample(Vector3<double>{3, 4, -0.25}).distance == -0.25);
  CHECK(level.sample(Vector3<double>{3, 4, 2}).normal.z == 1);
  CHECK(level.grid() == nullptr);

  const Vector3<double> n{0.6, 0, 0.8};
  const auto slope = Ground<double>::plane(n, 0.5);
  const auto s = slope.sample(0.7 * n + Vector3<double>{-0.8, 5, 0.6});
  CHECK(s.distance == doctest::Approx(0.2));
  CHECK(norm(s.normal - n) < 1e-15);
  CHECK(slope.highest() == std::numeric_limits<double>::infinity());
  CHECK(Ground<double>::plane({0, 0, 1}, 0.5).highest() == 0.5);

  const auto packs = Ground<float>::plane(n, 0.5).sample(Vector3<Pack<float, 4>>{1.0f, 2.0f, 3.0f});
  const auto floats = Ground<float>::plane(n, 0.5).sample(Vector3<float>{1, 2, 3});
  for (int l = 0; l < 4; ++l) CHECK(packs.distance[l] == doctest::Approx(floats.distance));
}

TEST_CASE("ground: refuses what is not a plane") {
  CHECK_THROWS_AS(Ground<float>::plane({0, 0, 2}, 0), Error);
  CHECK_THROWS_AS(Ground<float>::plane({0, 0, std::nan("")}, 0), Error);
  CHECK_THROWS_AS(Ground<float>::plane({0, 0, 1}, std::numeric_limits<double>::infinity()), Error);
}

TEST_CASE("ground: a terrain is sampled alike in every scalar and outlives its maker") {
  Eigen::MatrixXd heights(4, 3);
  traceur::core::RandomStream random(1);
  for (Eigen::Index i = 0; i < heights.size(); ++i) heights.data()[i] = random.uniform(-0.5, 0.5);
  auto grid = std::make_unique<traceur::terrain::HeightGrid>(heights, 0.4, -0.8, -0.6);
  const Ground<float> ground(*grid);
  const Ground<double> exact(*grid);
  const traceur::terrain::HeightGrid copy = *grid;
  grid.reset();
  CHECK(exact.highest() == heights.maxCoeff());
  REQUIRE(ground.grid() != nullptr);
  for (int trial = 0; trial < 200; ++trial) {
    Vector3<Pack<float, 8>> p;
    for (int l = 0; l < 8; ++l) {
      p.x.set(l, random.uniform<float>(-1.5f, 1.5f));
      p.y.set(l, random.uniform<float>(-1.5f, 1.5f));
      p.z.set(l, random.uniform<float>(-0.7f, 0.9f));
    }
    p.x.set(5, std::numeric_limits<float>::quiet_NaN());
    p.z.set(6, std::numeric_limits<float>::infinity());
    const float reach = 0.1f;
    const auto packs = ground.sample(p, reach);
    for (int l = 0; l < 5; ++l) {
      const Vector3<double> point{p.x[l], p.y[l], p.z[l]};
      const auto s = exact.sample(point);
      CHECK(s.distance == traceur::terrain::surface(copy, point).distance);
      CHECK(s.distance == doctest::Approx(traceur::terrain::signed_distance(copy, point)).epsilon(1e-12));
      if (std::abs(s.distance) < reach)
        CHECK(packs.distance[l] == doctest::Approx(s.distance).epsilon(1e-4));
      else
        CHECK((packs.distance[l] > reach || s.distance < 0));
    }
    CHECK(std::isnan(packs.distance[5]));
    CHECK(!(packs.distance[6] < 0));
  }
}
