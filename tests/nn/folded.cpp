// SPDX-License-Identifier: MIT
#include <traceur/nn/folded.hpp>

#include <doctest/doctest.h>

#include <traceur/nn/dense.hpp>
#include <traceur/nn/positions.hpp>

#include "module_laws.hpp"

using namespace traceur::nn;
using laws::Index;
using Matrixd = Eigen::MatrixXd;

TEST_CASE("a folded module does to the tokens below each other what it does to columns") {
  const Folded<Dense<Tanh>> m(Dense<Tanh>(3, 2), 4);
  CHECK(m.inputs() == 12);
  CHECK(m.outputs() == 8);
  const Matrixd theta = laws::random_parameters(m, 1), x = laws::random_table(12, 3, 2), y = laws::output(m, theta, x);
  const Matrixd columns = Eigen::Map<const Matrixd>(x.data(), 3, 12);
  CHECK(laws::equal(Eigen::Map<const Matrixd>(y.data(), 2, 12), laws::output(m.module(), theta, columns)));
}

TEST_CASE("folded modules obey the laws of modules, of contiguous columns and others") {
  laws::check_module<float>(Folded<Dense<Tanh>>(Dense<Tanh>(3, 2), 4));
  laws::check_module<double>(Folded<Dense<Tanh>>(Dense<Tanh>(2, 5), 3));
  laws::check_gradient(Folded<Dense<Tanh>>(Dense<Tanh>(3, 2), 4), 2);
  // A sample of a sequence module is then one column.
  laws::check_module<double>(Folded<LearnedPositions>(LearnedPositions(3, 4), 4));
  // Several columns at a time that do not lie next to each other.
  const Folded<Dense<Tanh>> m(Dense<Tanh>(3, 2), 4);
  const Matrixd theta = laws::random_parameters(m, 3), wide = laws::random_table(15, 3, 4), dy = laws::random_table(9, 3, 5);
  auto w = m.workspace<double>(3);
  Matrixd y(8, 3), dx(12, 3), wide_y = Matrixd::Zero(9, 3), wide_dx = Matrixd::Zero(14, 3);
  Matrixd dtheta = Matrixd::Zero(m.parameters(), 1), again = dtheta;
  const Matrixd x = wide.middleRows(2, 12), dout = dy.topRows(8);
  m.forward(theta.data(), x, w, y);
  m.backward(theta.data(), x, dout, w, dtheta.data(), dx);
  m.forward(theta.data(), wide.middleRows(2, 12), w, wide_y.bottomRows(8));
  m.backward(theta.data(), wide.middleRows(2, 12), dy.topRows(8), w, again.data(), wide_dx.topRows(12));
  CHECK(laws::equal(wide_y.bottomRows(8), y));
  CHECK(laws::equal(wide_dx.topRows(12), dx));
  CHECK(laws::equal(again, dtheta));
  CHECK(wide_y.row(0).isZero(0));
  CHECK(wide_dx.bottomRows(2).isZero(0));
}

TEST_CASE("folding needs a token") { CHECK_THROWS_AS(Folded<Dense<>>(Dense<>(1, 1), 0), traceur::Error); }
