// SPDX-License-Identifier: MIT
// The interpolant in dual numbers. Apart from tests/parameterize/rbf.cpp so that a build without Ceres keeps that one.
#include <cmath>

#include <ceres/jet.h>
#include <doctest/doctest.h>

#include <traceur/parameterize/rbf.hpp>

#include "support.hpp"

using namespace traceur::parameterize;

TEST_CASE("rbf: the derivative by dual numbers is that by differences, and stays finite at a centre") {
  using Jet = ceres::Jet<double, 2>;
  traceur::core::RandomStream random(1);
  const Eigen::MatrixXd centres = support::uniform(random, 2, 30), values = support::uniform(random, 3, 30);
  for (const Kernel kernel : {Kernel::linear, Kernel::cubic, Kernel::thin_plate}) {
    RbfParameters p;
    p.kernel = kernel;
    p.unit = Eigen::Vector2d(0.5, 2.0);
    const Rbf rbf(centres, values, p);
    for (int trial = 0; trial < 20; ++trial) {
      const Eigen::VectorXd theta = support::uniform(random, 2, 1).col(0);
      const Jet x[] = {Jet(theta(0), 0), Jet(theta(1), 1)};
      Jet y[3];
      rbf.evaluate<Jet>(x, y);
      for (Eigen::Index d = 0; d < 2; ++d) {
        const double h = 1e-6;
        Eigen::VectorXd step = Eigen::VectorXd::Zero(2);
        step(d) = h;
        const Eigen::VectorXd slope = (rbf(theta + step) - rbf(theta - step)) / (2.0 * h);
        for (Eigen::Index o = 0; o < 3; ++o) {
          CHECK(std::abs(y[o].v(d) - slope(o)) < 1e-5 * (1.0 + std::abs(slope(o))));
          CHECK(y[o].a == doctest::Approx(rbf(theta)(o)));
        }
      }
    }
    const Jet x[] = {Jet(centres(0, 4), 0), Jet(centres(1, 4), 1)};
    Jet y[3];
    rbf.evaluate<Jet>(x, y);
    for (const Jet& value : y) CHECK((std::isfinite(value.v(0)) && std::isfinite(value.v(1))));
  }
}
