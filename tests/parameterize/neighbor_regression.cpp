// SPDX-License-Identifier: MIT
#include <traceur/parameterize/neighbor_regression.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/parameterize/elite_set.hpp>

#include "support.hpp"

using namespace traceur::parameterize;
using support::fails_with;
using traceur::core::RandomStream;

namespace {

using Vector = Eigen::VectorXd;

EliteSet<> some_elites(const Vector& unit) {
  EliteSetParameters parameters;
  parameters.unit = unit;
  EliteSet<> elites(2, parameters);
  RandomStream random(5);
  for (int i = 0; i < 500; ++i) {
    const Vector a = support::uniform(random, 2, 1).col(0);
    elites.insert(a, random.uniform(0.2, 1.0), support::uniform(random, 3, 1).col(0));
  }
  return elites;
}

}  // namespace

TEST_CASE("neighbor regression: Eq. 14 over the nearest elites, as written") {
  Vector unit(2);
  unit << 1.0, 0.7;
  const EliteSet<> elites = some_elites(unit);
  const NeighborRegression regression;
  RandomStream random(6);
  for (int trial = 0; trial < 50; ++trial) {
    const Vector a = support::uniform(random, 2, 1, -0.2, 1.2).col(0);
    std::vector<std::pair<double, int>> order;
    for (int i = 0; i < elites.size(); ++i) {
      order.emplace_back((elites.parameter(i) - a).cwiseQuotient(unit).squaredNorm(), i);
    }
    std::sort(order.begin(), order.end());
    Vector mean = Vector::Zero(3);
    double sum = 0.0;
    for (std::size_t k = 0; k < 5; ++k) {
      const double weight = elites.fitness(order[k].second) * std::exp(-order[k].first / (0.28 * 0.28));
      mean += weight * elites.payload(order[k].second);
      sum += weight;
    }
    CHECK((regression(elites, a) - mean / sum).norm() < 1e-12);
  }
}

TEST_CASE(
    "neighbor regression: at an elite of its own it tends to that elite as sigma shrinks, and far away it stays "
    "finite") {
  const EliteSet<> elites = some_elites(Vector::Ones(2));
  const NeighborRegression sharp(NeighborRegression::Parameters{5, 0.01});
  CHECK((sharp(elites, elites.parameter(3)) - elites.payload(3)).norm() < 1e-12);
  const Vector far = sharp(elites, Vector::Constant(2, 1e3));
  CHECK(far.allFinite());
  CHECK(far.minCoeff() >= 0.0);
  CHECK(far.maxCoeff() <= 1.0);
}

TEST_CASE("neighbor regression: with fewer elites than neighbors it uses those there are") {
  EliteSet<> elites(1);
  const NeighborRegression regression;
  CHECK(fails_with([&] { regression(elites, Vector::Zero(1)); }, "got none"));
  elites.insert(Vector::Zero(1), 0.5, Vector::Constant(2, 3.0));
  CHECK(regression(elites, Vector::Ones(1)) == Vector::Constant(2, 3.0));
  // Halfway, the fitness alone decides.
  elites.insert(Vector::Ones(1), 1.0, Vector::Constant(2, 6.0));
  CHECK((regression(elites, Vector::Constant(1, 0.5)) - Vector::Constant(2, 5.0)).norm() < 1e-12);
  CHECK(fails_with([] { NeighborRegression(NeighborRegression::Parameters{0, 0.28}); }, "neighbors"));
  CHECK(fails_with([] { NeighborRegression(NeighborRegression::Parameters{5, 0.0}); }, "sigma"));
  double weights[2];
  Neighbor neighbors[2];
  CHECK(fails_with([&] { regression.weigh(elites, Vector::Zero(1), neighbors, weights); }, "room for 5"));
}

TEST_CASE("proxy switch: the regression until the loss has once been low, then at random") {
  ProxySwitch proxy(0.1, 0.3);
  RandomStream random(7);
  proxy.report(0.5);
  for (int i = 0; i < 100; ++i) CHECK(proxy.use_regression(random));
  proxy.report(0.05);
  proxy.report(0.5);
  CHECK(proxy.trained());
  int used = 0;
  for (int i = 0; i < 10000; ++i) used += proxy.use_regression(random);
  CHECK(std::abs(used - 3000) < 200);
  CHECK(fails_with([] { ProxySwitch(0.0); }, "loss_threshold"));
  CHECK(fails_with([] { ProxySwitch(0.1, 1.5); }, "probability"));
}
