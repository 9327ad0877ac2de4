// SPDX-License-Identifier: MIT
#include <traceur/parameterize/density.hpp>

#include <cmath>

#include <doctest/doctest.h>

#include <traceur/parameterize/elite_set.hpp>

#include "support.hpp"

using namespace traceur::parameterize;
using support::fails_with;
using traceur::core::RandomStream;

namespace {
using Vector = Eigen::VectorXd;
}  // namespace

TEST_CASE("density: the probability integrates to 1") {
  for (const Eigen::Index n : {1, 2}) {
    RandomStream random(1, static_cast<std::uint64_t>(n));
    Vector unit(n);
    for (Eigen::Index d = 0; d < n; ++d) unit(d) = 0.5 + static_cast<double>(d);
    KdTree points(n, unit);
    for (int i = 0; i < 40; ++i) points.insert(support::uniform(random, n, 1).col(0));
    const KernelDensity density({0.2, 7.0, 4.0});
    // The midpoint rule converges very fast for smooth functions that vanish at the ends.
    const double low = -1.7, high = 2.7, h = 0.044;
    const int steps = static_cast<int>(std::lround((high - low) / h));
    double integral = 0.0;
    Vector a(n);
    for (int i = 0; i < steps; ++i) {
      a(0) = low + (i + 0.5) * h;
      if (n == 1) {
        integral += density.probability(points, a) * h;
        continue;
      }
      for (int j = 0; j < steps; ++j) {
        a(1) = low + (j + 0.5) * h;
        integral += density.probability(points, a) * h * h;
      }
    }
    CHECK(integral == doctest::Approx(1.0).epsilon(1e-5));
  }
}

TEST_CASE("density: Eq. 15 as written, over the elites within reach") {
  EliteSet<int> elites(3);
  RandomStream random(2);
  for (int i = 0; i < 2000; ++i) elites.insert(support::uniform(random, 3, 1).col(0), random.uniform());
  const KernelDensity density({0.15, 2.0, 2.5});
  for (int trial = 0; trial < 50; ++trial) {
    const Vector a = support::uniform(random, 3, 1).col(0);
    double expected = 0.0;
    for (int i = 0; i < elites.size(); ++i) {
      const double squared = (elites.parameter(i) - a).squaredNorm();
      if (squared < 0.375 * 0.375) expected += 2.0 * std::exp(-squared / 0.0225);
    }
    CHECK(density(elites, a) == doctest::Approx(expected).epsilon(1e-12));
  }
}

TEST_CASE("density: by default, what is within the radius of an elite is heavily visited") {
  EliteSet<int> elites(2);
  elites.insert(Vector::Zero(2), 1.0);
  const KernelDensity density;
  Vector a = Vector::Zero(2);
  CHECK(density(elites, a) == 1.0);
  a(0) = 0.0999;
  CHECK(density(elites, a) > 0.8);
  a(0) = 0.27;
  CHECK(density(elites, a) < 0.2);
  a(0) = 1.0;
  CHECK(density(elites, a) == 0.0);
  CHECK(density.probability(EliteSet<int>(2), a) == 0.0);
}

TEST_CASE("density: what does not fit is refused") {
  CHECK(fails_with([] { KernelDensity({0.0, 1.0, 3.0}); }, "bandwidth"));
  CHECK(fails_with([] { KernelDensity({0.1, -1.0, 3.0}); }, "peak"));
  CHECK(fails_with([] { KernelDensity({0.1, 1.0, 0.0}); }, "reach"));
}
