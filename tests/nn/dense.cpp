// SPDX-License-Identifier: MIT
#include <traceur/nn/dense.hpp>

#include <cmath>

#include <doctest/doctest.h>

#include "allocations.hpp"
#include "module_laws.hpp"

using namespace traceur::nn;
using laws::Table;
using traceur::core::RandomStream;

static_assert(Module<Dense<>, float> && Module<Dense<Gelu>, double>);

TEST_CASE("one layer by hand") {
  const Dense<Relu> layer(2, 3);
  REQUIRE(layer.parameters() == 9);
  Table<double> theta(9, 1), x(2, 1), expected(3, 1);
  theta << 1, 2, 3, 4, 5, 6, 0.5, -100, 0.25;  // columns of the weight, then the bias
  x << 10, -1;
  expected << 10 - 4 + 0.5, 0, 30 - 6 + 0.25;
  CHECK(laws::equal(laws::output(layer, theta, x), expected));

  const Dense<> plain(2, 3, false);
  REQUIRE(plain.parameters() == 6);
  expected << 6, 15, 24;
  CHECK(laws::equal(laws::output(plain, theta, x), expected));
}

TEST_CASE("gradients are those of the loss") {
  laws::check_gradient(Dense<>(7, 5), 4);
  laws::check_gradient(Dense<>(3, 20, false), 5);
  laws::check_gradient(Dense<Tanh>(19, 1), 9);
  laws::check_gradient(Dense<Sigmoid>(4, 2), 30);
  laws::check_gradient(Dense<Silu>(9, 17), 3);
  laws::check_gradient(Dense<Gelu>(5, 9), 2);
  laws::check_gradient(Dense<GeluTanh>(5, 9, false), 2);
}

TEST_CASE("the laws of modules") {
  laws::check_module<float>(Dense<>(7, 5));
  laws::check_module<double>(Dense<>(40, 1));
  laws::check_module<float>(Dense<LeakyRelu<>>(17, 33, false));
  laws::check_module<float>(Dense<Gelu>(3, 65));
  laws::check_module<double>(Dense<Relu>(1, 1));
}

TEST_CASE("nothing is taken from the heap after the workspace") {
  const Dense<Gelu> layer(30, 20);
  auto w = layer.workspace<float>(50);
  RandomStream random(1);
  Table<float> theta(layer.parameters(), 1), x = Table<float>::Ones(30, 50), y(20, 50), dx(30, 50), dtheta = theta;
  layer.initialize(theta.data(), random);
  dtheta.setZero();
  const long before = allocations();
  layer.forward(theta.data(), x, w, y);
  layer.backward(theta.data(), x, y, w, dtheta.data(), dx);
  layer.infer(theta.data(), x.col(0), w, y.col(0));
  CHECK(allocations() == before);
}

TEST_CASE("starts") {
  const Dense<> layer(100, 40);
  RandomStream random(5);
  Table<double> theta(layer.parameters(), 1);
  layer.initialize(theta.data(), random);
  CHECK(theta.cwiseAbs().maxCoeff() <= 0.1);
  CHECK(theta.cwiseAbs().maxCoeff() > 0.09);
  CHECK(theta.bottomRows(40).cwiseAbs().maxCoeff() > 0.05);
  layer.initialize(theta.data(), random, He{});
  CHECK(theta.bottomRows(40).isZero(0));
  CHECK(theta.topRows(4000).cwiseAbs().maxCoeff() > 0.3);
}

TEST_CASE("impossible shapes are refused") {
  CHECK_THROWS_WITH_AS(Dense<>(0, 3), "dense: expected at least one input, got 0", traceur::Error);
  CHECK_THROWS_WITH_AS(Dense<>(3, -1), "dense: expected at least one output, got -1", traceur::Error);
  CHECK_THROWS_WITH_AS(Dense<>(3, 1).workspace<float>(0), "dense workspace: expected at least one column, got 0",
                       traceur::Error);
}
