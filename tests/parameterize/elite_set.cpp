// SPDX-License-Identifier: MIT
#include <traceur/parameterize/elite_set.hpp>

#include <algorithm>
#include <limits>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/parameterize/neighbor_regression.hpp>

#include "support.hpp"

using namespace traceur::parameterize;
using support::fails_with;
using traceur::core::RandomStream;

static_assert(NeighborSource<EliteSet<>>);
static_assert(NeighborSource<EliteSet<int>>);
static_assert(RatedVectors<EliteSet<>>);
static_assert(RatedPoints<EliteSet<int>>);
static_assert(!RatedVectors<EliteSet<int>>);
static_assert(!RatedPoints<KdTree>);

namespace {
using Vector = Eigen::VectorXd;
}  // namespace

TEST_CASE("elite set: no two elites are within the radius, after a million random episodes") {
  EliteSetParameters parameters;
  parameters.unit = Vector(3);
  parameters.unit << 1.0, 0.5, 2.0;
  EliteSet<int> elites(3, parameters);
  RandomStream random(1);
  Vector a(3);
  for (int i = 0; i < 1000000; ++i) {
    for (Eigen::Index d = 0; d < 3; ++d) a(d) = random.uniform();
    elites.insert(a, random.uniform(), i);
  }
  REQUIRE(elites.size() > 300);
  double nearest = std::numeric_limits<double>::infinity();
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < elites.size(); ++i) {
    least = std::min(least, elites.fitness(i));
    for (int j = 0; j < i; ++j) {
      nearest =
          std::min(nearest, (elites.parameter(i) - elites.parameter(j)).cwiseQuotient(parameters.unit).squaredNorm());
    }
  }
  CHECK(nearest >= 0.01 * (1.0 - 1e-12));
  CHECK(least > 0.1);
  // Each place has seen hundreds of episodes, so what is kept is far better than the average episode.
  double mean = 0.0;
  for (int i = 0; i < elites.size(); ++i) mean += elites.fitness(i) / elites.size();
  CHECK(mean > 0.9);
}

TEST_CASE("elite set: what it keeps is what the rule, applied to a plain list, keeps") {
  EliteSetParameters parameters;
  parameters.radius = 0.2;
  EliteSet<int> elites(2, parameters);
  struct Episode {
    Vector a;
    double fitness;
    int number;
  };
  std::vector<Episode> list;
  RandomStream random(2);
  for (int i = 0; i < 5000; ++i) {
    const Vector a = support::uniform(random, 2, 1).col(0);
    // Few different values, so that ties occur.
    const double fitness = 0.05 * random.below(20);
    const auto near = [&](const Episode& e) { return (e.a - a).squaredNorm() < 0.04; };
    const auto as_good = [&](const Episode& e) { return near(e) && !(fitness > e.fitness); };
    const bool expected = fitness > 0.1 && std::none_of(list.begin(), list.end(), as_good);
    const auto replaced = std::count_if(list.begin(), list.end(), near);
    const EliteOutcome outcome = elites.insert(a, fitness, i);
    CHECK(outcome.accepted == expected);
    if (!expected) {
      CHECK(!outcome.discovery);
      continue;
    }
    CHECK(outcome.replaced == replaced);
    list.erase(std::remove_if(list.begin(), list.end(), near), list.end());
    list.push_back({a, fitness, i});
    REQUIRE(elites.size() == static_cast<int>(list.size()));
  }
  std::vector<int> kept, expected;
  for (int i = 0; i < elites.size(); ++i) kept.push_back(elites.payload(i));
  for (const Episode& e : list) expected.push_back(e.number);
  std::sort(kept.begin(), kept.end());
  CHECK(kept == expected);
  for (int i = 0; i < elites.size(); ++i) {
    const auto of = [&](const Episode& e) { return e.number == elites.payload(i); };
    const auto episode = std::find_if(list.begin(), list.end(), of);
    CHECK(elites.parameter(i) == episode->a);
    CHECK(elites.fitness(i) == episode->fitness);
    Neighbor self;
    CHECK(elites.nearest(elites.parameter(i), {&self, 1}) == 1);
    CHECK(self.index == i);
  }
}

TEST_CASE("elite set: a discovery is clearly better than what it replaces") {
  EliteSet<int> elites(1);
  const Vector a = Vector::Zero(1);
  CHECK(!elites.insert(a, 0.1).accepted);
  CHECK(!elites.insert(a, std::numeric_limits<double>::quiet_NaN()).accepted);
  EliteOutcome outcome = elites.insert(a, 0.3);
  CHECK((outcome.accepted && outcome.discovery && outcome.replaced == 0));
  outcome = elites.insert(Vector::Constant(1, 0.05), 0.31);
  CHECK((outcome.accepted && !outcome.discovery && outcome.replaced == 1));
  outcome = elites.insert(a, 0.34);
  CHECK((outcome.accepted && outcome.discovery && outcome.replaced == 1));
  CHECK(!elites.insert(a, 0.34).accepted);
  // Exactly at the radius is not within it.
  CHECK(elites.insert(Vector::Constant(1, 0.1), 0.2).replaced == 0);
  CHECK(elites.size() == 2);
}

TEST_CASE("elite set: what does not fit is refused") {
  EliteSetParameters parameters;
  parameters.radius = 0.0;
  CHECK(fails_with([&] { EliteSet<>(2, parameters); }, "EliteSet: radius"));
  parameters = {};
  parameters.margin = -1.0;
  CHECK(fails_with([&] { EliteSet<>(2, parameters); }, "EliteSet: margin"));
  parameters = {};
  parameters.unit = Vector::Ones(3);
  CHECK(fails_with([&] { EliteSet<>(2, parameters); }, "unit"));
  EliteSet<> elites(2);
  CHECK(fails_with([&] { elites.insert(Vector::Ones(1), 1.0); }, "2 finite numbers"));
  CHECK(elites.size() == 0);
}
