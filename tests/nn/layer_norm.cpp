// SPDX-License-Identifier: MIT
#include <traceur/nn/layer_norm.hpp>

#include <doctest/doctest.h>

#include "module_laws.hpp"

using namespace traceur::nn;
using laws::Index;
using Matrixd = Eigen::MatrixXd;

TEST_CASE("layer norm obeys the laws of modules at every number of features") {
  for (const Index n : {1, 2, 7, 16, 33}) {
    CAPTURE(n);
    laws::check_module<float>(LayerNorm(n));
    laws::check_module<double>(LayerNorm(n));
    laws::check_gradient(LayerNorm(n, n == 1 ? 1.0 : 1e-5), 3);
  }
}

TEST_CASE("layer norm gives every column mean 0 and variance 1, before weight and bias") {
  const LayerNorm norm(20, 1e-12);
  Matrixd theta(norm.parameters(), 1);
  traceur::core::RandomStream random(1);
  norm.initialize(theta.data(), random);
  const Matrixd x = (3 * laws::random_table(20, 6, 2).array() + 50).matrix();
  const Matrixd y = laws::output(norm, theta, x);
  for (Index j = 0; j < y.cols(); ++j) {
    CHECK(y.col(j).mean() == doctest::Approx(0).epsilon(1e-10));
    CHECK(y.col(j).squaredNorm() / 20 == doctest::Approx(1).epsilon(1e-10));
  }
  const Matrixd weight = laws::random_table(20, 1, 3), bias = laws::random_table(20, 1, 4);
  theta << weight, bias;
  const Matrixd scaled = (weight.asDiagonal() * y).colwise() + bias.col(0);
  CHECK(laws::relative_error(laws::output(norm, theta, x), scaled) < 1e-12);
}

TEST_CASE("layer norm does not see shift and scale of a column") {
  const LayerNorm norm(9, 1e-14);
  const Matrixd theta = laws::random_parameters(norm, 5), x = laws::random_table(9, 4, 6);
  const Matrixd y = laws::output(norm, theta, x);
  CHECK(laws::relative_error(laws::output(norm, theta, (2.5 * x.array() - 3).matrix()), y) < 1e-10);
}

TEST_CASE("a constant column becomes the bias") {
  const LayerNorm norm(5);
  const Matrixd theta = laws::random_parameters(norm, 7);
  CHECK(laws::output(norm, theta, Matrixd::Constant(5, 1, 1e6)) == theta.bottomRows(5));
}

TEST_CASE("layer norm refuses no features and an epsilon that is not positive") {
  CHECK_THROWS_WITH_AS(LayerNorm(0), "layer norm: expected at least one feature, got 0", traceur::Error);
  CHECK_THROWS_AS(LayerNorm(3, 0.0), traceur::Error);
  CHECK_THROWS_AS(LayerNorm(3, std::numeric_limits<double>::quiet_NaN()), traceur::Error);
}
