// SPDX-License-Identifier: MIT
#include <traceur/nn/positions.hpp>

#include <cmath>

#include <doctest/doctest.h>

#include "module_laws.hpp"

using namespace traceur::nn;
using laws::Index;
using Matrixd = Eigen::MatrixXd;

TEST_CASE("a sinusoid starts at 0 and 1 and turns by one radian a step in its first pair") {
  constexpr Index width = 6;
  for (Index i = 0; i < width; ++i) CHECK(sinusoid(0, i, width) == (i % 2 == 0 ? 0.0 : 1.0));
  CHECK(sinusoid(3, 0, width) == doctest::Approx(std::sin(3.0)));
  CHECK(sinusoid(3, 1, width) == doctest::Approx(std::cos(3.0)));
  CHECK(sinusoid(3, 2, width) == doctest::Approx(std::sin(3.0 / std::pow(10000.0, 2.0 / 6))));
  CHECK(sinusoid(3, 5, width) == doctest::Approx(std::cos(3.0 / std::pow(10000.0, 4.0 / 6))));
}

TEST_CASE("the product of two sinusoids depends on their distance alone") {
  constexpr Index width = 16;
  const auto product = [](double a, double b) {
    double sum = 0;
    for (Index i = 0; i < width; ++i) sum += sinusoid(a, i, width) * sinusoid(b, i, width);
    return sum;
  };
  CHECK(product(5, 5) == doctest::Approx(width / 2));
  CHECK(product(2, 9) == doctest::Approx(product(31, 38)));
  CHECK(std::abs(product(2, 9) - product(2, 10)) > 0.1);
}

TEST_CASE("sinusoidal positions add the same table to every sample") {
  const SinusoidalPositions positions(6, 4);
  laws::check_module<float>(positions, 4);
  laws::check_module<double>(positions, 4);
  laws::check_gradient(positions, 8);
  const Matrixd x = laws::random_table(6, 8, 1);
  Matrixd y(6, 8);
  auto w = positions.workspace<double>(8);
  positions.forward<double>(nullptr, x, w, y);
  for (Index j = 0; j < 8; ++j) {
    for (Index i = 0; i < 6; ++i) CHECK(y(i, j) - x(i, j) == doctest::Approx(sinusoid(static_cast<double>(j % 4), i, 6)));
  }
}

TEST_CASE("learned positions add their columns") {
  const LearnedPositions positions(5, 3);
  laws::check_module<float>(positions, 3);
  laws::check_module<double>(positions, 3);
  laws::check_gradient(positions, 6);
  const Matrixd theta = laws::random_parameters(positions, 2), x = laws::random_table(5, 6, 3);
  const Eigen::Map<const Matrixd> table(theta.data(), 5, 3);
  Matrixd y(5, 6);
  auto w = positions.workspace<double>(6);
  positions.forward(theta.data(), x, w, y);
  for (Index j = 0; j < 6; ++j) CHECK(y.col(j) == x.col(j) + table.col(j % 3));
}

TEST_CASE("a step embedding is the sinusoid of the step, whole or not") {
  const StepEmbedding embedding(8);
  laws::check_module<float>(embedding);
  laws::check_module<double>(embedding);
  laws::check_gradient(embedding, 3);
  Eigen::MatrixXf steps(1, 3), y(8, 3);
  steps << 0.0f, 20.5f, 999.0f;
  auto w = embedding.workspace<float>(3);
  embedding.forward<float>(nullptr, steps, w, y);
  for (Index j = 0; j < 3; ++j) {
    for (Index i = 0; i < 8; ++i) CHECK(std::abs(static_cast<double>(y(i, j)) - sinusoid(steps(j), i, 8)) < 1e-7);
  }
}

TEST_CASE("an odd width cannot hold pairs") {
  CHECK_THROWS_WITH_AS(StepEmbedding(7), "step embedding: expected an even number of features, got 7", traceur::Error);
  CHECK_THROWS_AS(SinusoidalPositions(3, 2), traceur::Error);
  CHECK_THROWS_AS(SinusoidalPositions(4, 0), traceur::Error);
  CHECK_THROWS_AS(LearnedPositions(0, 2), traceur::Error);
  CHECK_THROWS_AS(LearnedPositions(2, 0), traceur::Error);
}
