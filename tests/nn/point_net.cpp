// SPDX-License-Identifier: MIT
#include <traceur/nn/point_net.hpp>

#include <algorithm>

#include <doctest/doctest.h>

#include <traceur/nn/mlp.hpp>

#include "module_laws.hpp"

using namespace traceur::nn;
using laws::Index;
using Matrixd = Eigen::MatrixXd;

namespace {

PointNet<Mlp<>> make(Index points) { return PointNet<Mlp<>>(Mlp<>({3, 6, 5}), points); }

// The points of each cloud in another order.
Matrixd reordered(const Matrixd& x) {
  Matrixd out(x.rows(), x.cols());
  const Index points = x.rows() / 3;
  for (Index p = 0; p < points; ++p) out.middleRows(3 * p, 3) = x.middleRows(3 * ((3 * p + 1) % points), 3);
  return out;
}

}  // namespace

TEST_CASE("a point net obeys the laws of modules") {
  laws::check_module<float>(make(4));
  laws::check_module<double>(make(7));
  laws::check_gradient(make(5), 3);
  laws::check_gradient(make(1), 2);
}

TEST_CASE("a feature of a cloud is the largest of its points") {
  const PointNet<Mlp<>> m = make(4);
  const Matrixd theta = laws::random_parameters(m, 1), x = laws::random_table(12, 3, 2), y = laws::output(m, theta, x);
  for (Index j = 0; j < 3; ++j) {
    const Matrixd cloud = Eigen::Map<const Matrixd>(x.col(j).data(), 3, 4);
    const Matrixd features = laws::output(m.module(), theta, cloud);
    for (Index i = 0; i < 5; ++i) CHECK(y(i, j) == features.row(i).maxCoeff());
  }
}

TEST_CASE("a point net does not see the order of the points, nor points that are there twice") {
  const PointNet<Mlp<>> m = make(5);
  const Matrixd theta = laws::random_parameters(m, 3), x = laws::random_table(15, 2, 4), y = laws::output(m, theta, x);
  CHECK(laws::equal(laws::output(m, theta, reordered(x)), y));
  Matrixd longer(21, 2);
  longer << x, x.topRows(3), x.middleRows(6, 3);
  CHECK(laws::equal(laws::output(make(7), theta, longer), y));
}

TEST_CASE("only points that are the largest somewhere get a gradient, of two alike the first") {
  const PointNet<Dense<>> m(Dense<>(1, 1, false), 4);
  const Matrixd theta = Matrixd::Constant(1, 1, 2), x = (Matrixd(4, 1) << 1, 3, 3, -5).finished();
  auto w = m.workspace<double>(1);
  Matrixd y(1, 1), dx(4, 1), dtheta = Matrixd::Zero(1, 1);
  m.forward(theta.data(), x, w, y);
  m.backward(theta.data(), x, Matrixd::Constant(1, 1, 10), w, dtheta.data(), dx);
  CHECK(y(0) == 6);
  CHECK(dx == (Matrixd(4, 1) << 0, 20, 0, 0).finished());
  CHECK(dtheta(0) == 30);
}

TEST_CASE("a point net needs a point") { CHECK_THROWS_AS(make(0), traceur::Error); }
