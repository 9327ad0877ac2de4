// SPDX-License-Identifier: MIT
#include <traceur/diffusion/terrain_encoder.hpp>

#include <cmath>
#include <string>
#include <string_view>
#include <vector>

#include <doctest/doctest.h>

#include "support.hpp"

using traceur::diffusion::TerrainEncoder;

static_assert(traceur::nn::Module<TerrainEncoder, float> && traceur::nn::Module<TerrainEncoder, double>);

namespace {

Table<double> some_parameters(const TerrainEncoder& m) {
  Table<double> theta(m.parameters(), 1);
  traceur::core::RandomStream random(1);
  m.initialize(theta.data(), random);
  return theta;
}

Table<double> output(const TerrainEncoder& m, const Table<double>& theta, const Table<double>& x) {
  Table<double> y(m.outputs(), x.cols());
  auto w = m.workspace<double>(x.cols());
  m.forward(theta.data(), x, w, y);
  return y;
}

}  // namespace

TEST_CASE("the published sizes") {
  const TerrainEncoder m(TerrainEncoder::Parameters{});
  CHECK(m.inputs() == 31 * 31);
  CHECK(m.tokens() == 64);
  CHECK(m.outputs() == 64 * 256);
  const Eigen::Index convolutions = 32 * (25 + 1) + 2 * 32 * (32 * 25 + 1) + 64 * (32 * 16 + 1);
  CHECK(m.parameters() == convolutions + 256 * (64 * 4 + 1));
}

TEST_CASE("the gradient by parameters and heights is the slope, and columns do not depend on each other") {
  const TerrainEncoder m({.height = 9, .width = 7, .layers = {{2, 2}, {3, 3}}, .patch = 2, .token = 4, .scale = 0.5});
  const Table<double> theta = some_parameters(m), x = random_table<double>(m.inputs(), 3, 2);
  const Table<double> weights = random_table<double>(m.outputs() + 1, 3, 3);  // with a gap between the columns
  auto w = m.workspace<double>(3);
  Table<double> y(m.outputs() + 1, 3), dx(m.inputs(), 3), dtheta = Table<double>::Zero(m.parameters(), 1);
  m.forward(theta.data(), x, w, y.topRows(m.outputs()));
  m.backward(theta.data(), x, weights.topRows(m.outputs()), w, dtheta.data(), dx);
  const auto value = [&](const Table<double>& at, const Table<double>& in) {
    return (output(m, at, in).array() * weights.topRows(m.outputs()).array()).sum();
  };
  const double h = 1e-6;
  m.for_each_parameter([&](std::string_view name, Eigen::Index offset, Eigen::Index rows, Eigen::Index cols) {
    Table<double> direction = Table<double>::Zero(m.parameters(), 1);
    direction.middleRows(offset, rows * cols) = random_table<double>(rows * cols, 1, 4);
    INFO(std::string(name));
    CHECK((dtheta.array() * direction.array()).sum() ==
          doctest::Approx((value(theta + h * direction, x) - value(theta - h * direction, x)) / (2 * h)).epsilon(1e-6));
  });
  const Table<double> direction = random_table<double>(m.inputs(), 3, 5);
  CHECK((dx.array() * direction.array()).sum() ==
        doctest::Approx((value(theta, x + h * direction) - value(theta, x - h * direction)) / (2 * h)).epsilon(1e-6));
  for (Eigen::Index j = 0; j < 3; ++j) {
    CHECK(same_bits<double>(output(m, theta, x.col(j)), y.topRows(m.outputs()).col(j)));
  }
}

TEST_CASE("tokens see the ground beneath their patch alone") {
  const TerrainEncoder m({.height = 8, .width = 8, .layers = {{2, 3}}, .patch = 3, .token = 5, .scale = 1});
  const Table<double> theta = some_parameters(m);
  Table<double> x = random_table<double>(64, 1, 2);
  const Table<double> before = output(m, theta, x);
  x(7) += 1;  // first row, last column: in the upper right patch
  const Table<double> after = output(m, theta, x);
  CHECK(before.topRows(5) == after.topRows(5));
  CHECK(before.middleRows(5, 5) != after.middleRows(5, 5));
  CHECK(before.bottomRows(10) == after.bottomRows(10));
}

TEST_CASE("a terrain encoder refuses shapes that do not fit") {
  using P = TerrainEncoder::Parameters;
  CHECK_THROWS_AS(TerrainEncoder(P{.height = 8, .width = 8, .layers = {}, .patch = 2, .token = 4, .scale = 1}), traceur::Error);
  CHECK_THROWS_AS(TerrainEncoder(P{.height = 8, .width = 8, .layers = {{2, 9}}, .patch = 2, .token = 4, .scale = 1}),
                  traceur::Error);
  CHECK_THROWS_AS(TerrainEncoder(P{.height = 8, .width = 8, .layers = {{2, 2}}, .patch = 2, .token = 4, .scale = 1}),
                  traceur::Error);
}
