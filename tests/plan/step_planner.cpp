// SPDX-License-Identifier: MIT
#include <traceur/plan/step_planner.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/random.hpp>

#include "../error_message.hpp"

namespace {

using namespace traceur;
using core::RandomStream;
using plan::Approach;
using plan::DirectionTracker;
using plan::StepLength;
using plan::StepPlan;
using plan::StepPlanner;

using Parameters = StepPlanner<double>::Parameters;

/// Eq. 15 as it is printed; the last speed is the approach's.
double cost(const Parameters& p, double distance, double speed, const Approach<double>& approach,
            const std::vector<double>& v) {
  double u = distance, sum = 0, before = speed;
  for (std::size_t i = 0; i < v.size(); ++i) {
    u -= p.length(v[i]);
    sum += (i == 0 ? p.first_weight : p.change_weight) * (v[i] - before) * (v[i] - before);
    before = v[i];
  }
  return sum + p.distance_weight * (u - approach.distance) * (u - approach.distance);
}

/// Minimises one speed at a time, each exactly by the parabola through three values, until nothing moves.
std::vector<double> descend(const Parameters& p, double distance, double speed, const Approach<double>& approach,
                            int n) {
  std::vector<double> v(static_cast<std::size_t>(n), approach.speed);
  for (int round = 0; round < 5000; ++round) {
    double moved = 0;
    for (std::size_t i = 0; i + 1 < v.size(); ++i) {
      const double at = v[i];
      const double middle = cost(p, distance, speed, approach, v);
      v[i] = at + 1;
      const double above = cost(p, distance, speed, approach, v);
      v[i] = at - 1;
      const double below = cost(p, distance, speed, approach, v);
      v[i] = at + 0.5 * (below - above) / (above - 2 * middle + below);
      moved = std::max(moved, std::abs(v[i] - at));
    }
    if (moved < 1e-12) break;
  }
  return v;
}

using traceur_test::message;

}  // namespace

TEST_CASE("step length: the paper's line, and the fit of runs that lie on one") {
  const StepLength<double> paper;
  CHECK(paper(2) == doctest::Approx(0.57));
  CHECK(paper(4.4) == doctest::Approx(1.05));
  CHECK(paper(5) == doctest::Approx(1.17));
  std::vector<double> v, l;
  for (double speed = 2; speed <= 5; speed += 0.1) {
    v.push_back(speed);
    l.push_back(0.31 * speed - 0.04);
  }
  const auto fitted = StepLength<double>::fit(v, l);
  CHECK(fitted.slope == doctest::Approx(0.31));
  CHECK(fitted.offset == doctest::Approx(-0.04));
  CHECK(fitted.residual(v, l) < 1e-12);
}

TEST_CASE("step length: of runs that scatter, no other line is nearer") {
  RandomStream random(51);
  std::vector<double> v, l;
  for (int k = 0; k < 60; ++k) {
    v.push_back(random.uniform(2, 5));
    l.push_back(0.2 * v.back() + 0.17 + random.normal(0, 0.03));
  }
  const auto fitted = StepLength<double>::fit(v, l);
  CHECK(fitted.slope == doctest::Approx(0.2).epsilon(0.1));
  const double least = fitted.residual(v, l);
  CHECK(least == doctest::Approx(0.03).epsilon(0.3));
  for (const double d : {-1e-3, 1e-3}) {
    CHECK(StepLength<double>{fitted.slope + d, fitted.offset}.residual(v, l) > least);
    CHECK(StepLength<double>{fitted.slope, fitted.offset + d}.residual(v, l) > least);
    CHECK(StepLength<double>{fitted.slope + d, fitted.offset - 3.5 * d}.residual(v, l) > least);
  }
  CHECK(StepLength<float>::fit(std::vector<float>{1, 2}, std::vector<float>{3, 5}).slope == doctest::Approx(2));
  const std::vector<double> same{3, 3, 3}, some{1, 2, 3}, two{1, 2};
  CHECK(message([&] { StepLength<double>::fit(same, some); }) == "step length: expected runs at two speeds or more");
  CHECK(message([&] { StepLength<double>::fit({}, {}); }) == "step length: expected runs at two speeds or more");
  CHECK(message([&] { StepLength<double>::fit(some, two); }) ==
        "step length: expected a length for each of 3 speeds, found 2");
}

TEST_CASE("plan: the closed form is the minimum that descent finds") {
  RandomStream random(52);
  for (int trial = 0; trial < 300; ++trial) {
    Parameters p;
    p.length = {random.uniform(0.1, 0.4), random.uniform(0, 0.3)};
    p.distance_weight = std::pow(10, random.uniform(-1, 2));
    p.change_weight = random.uniform(0.3, 3);
    p.first_weight = random.uniform(0.3, 3);
    StepPlanner<double> planner(p);
    const Approach<double> approach{random.uniform(0.5, 2), random.uniform(2, 5)};
    const double speed = random.uniform(2, 5), distance = random.uniform(2, 10);
    const int n = 1 + static_cast<int>(random.below(6));
    const StepPlan<double> found = planner.plan(distance, speed, approach, n);
    REQUIRE(static_cast<int>(found.speeds.size()) == n);
    CHECK(found.speeds.back() == approach.speed);
    const std::vector<double> speeds(found.speeds.begin(), found.speeds.end());
    CHECK(cost(p, distance, speed, approach, speeds) == doctest::Approx(found.cost));
    const std::vector<double> expected = descend(p, distance, speed, approach, n);
    for (std::size_t i = 0; i < speeds.size(); ++i) CHECK(speeds[i] == doctest::Approx(expected[i]).epsilon(1e-6));
    double u = distance;
    for (const double v : speeds) u -= p.length(v);
    CHECK(found.distance == doctest::Approx(u));
    // No plan near by is cheaper.
    for (int k = 0; k < 20 && n > 1; ++k) {
      std::vector<double> other = speeds;
      for (std::size_t i = 0; i + 1 < other.size(); ++i) other[i] += random.normal(0, 0.05);
      CHECK(cost(p, distance, speed, approach, other) >= found.cost);
    }
  }
}

TEST_CASE("plan: limits of the weights") {
  const Approach<double> approach{1.2, 3.4};
  Parameters p;
  p.distance_weight = 0;
  StepPlanner<double> careless(p);
  // The distance of no matter: equal changes.
  const auto even = careless.plan(9, 2.2, approach, 4);
  for (std::size_t i = 0; i < 4; ++i) CHECK(even.speeds[i] == doctest::Approx(2.2 + 0.3 * static_cast<double>(i + 1)));
  p.distance_weight = 1e9;
  StepPlanner<double> careful(p);
  CHECK(careful.plan(5.5, 2.2, approach, 5).distance == doctest::Approx(1.2));
  // A runner who arrives right as they run changes nothing.
  const double right = 1.2 + 6 * p.length(3.4);
  const auto steady = careful.plan(right, 3.4, approach);
  CHECK(steady.speeds.size() == 6);
  for (const double v : steady.speeds) CHECK(v == doctest::Approx(3.4));
  CHECK(steady.cost < 1e-12);
}

TEST_CASE("plan: the number of steps is the distance over the mean step") {
  StepPlanner<double> planner;
  const Approach<double> approach{1.0, 4.0};
  const double length = 0.2 * 3 + 0.17;
  for (int n = 1; n < 200; ++n) {
    CHECK(planner.steps(1.0 + n * length, 2.0, approach) == n);
    CHECK(planner.steps(1.0 + (n + 0.4) * length, 2.0, approach) == n);
    CHECK(planner.steps(1.0 + (n - 0.4) * length, 2.0, approach) == n);
  }
  CHECK(planner.steps(1.0 + 0.4 * length, 2.0, approach) == 0);
  CHECK(planner.steps(0.2, 2.0, approach) == 0);
  CHECK(planner.plan(0.2, 2.0, approach).speeds.empty());
  CHECK(planner.plan(0.2, 2.0, approach).distance == 0.2);
  CHECK(planner.steps(1e9, 2.0, approach) == 256);
  CHECK(planner.steps(std::nan(""), 2.0, approach) == 0);
  CHECK(planner.plan(1e9, 2.0, approach).speeds.size() == 256);
}

TEST_CASE("plan: replanned at every step, a runner whose steps miss arrives where they should") {
  Parameters p;
  p.distance_weight = 10;
  StepPlanner<double> planner(p);
  const Approach<double> approach{1.5, 3.4};
  double worst = 0, slowest = 10, fastest = 0, blind = 0;
  for (std::uint64_t trial = 0; trial < 300; ++trial) {
    RandomStream random(53, trial);
    const double start = random.uniform(8, 30), first = random.uniform(2.5, 4.5);
    double distance = start, speed = first;
    int steps = 0;
    while (planner.steps(distance, speed, approach) > 0) {
      const auto plan = planner.plan(distance, speed, approach);
      // What the runner does is not quite what was planned.
      speed = plan.speeds[0] + random.normal(0, 0.05);
      distance -= p.length(speed) + random.normal(0, 0.03);
      slowest = std::min(slowest, speed);
      fastest = std::max(fastest, speed);
      REQUIRE(++steps < 100);
    }
    worst = std::max(worst, std::abs(distance - approach.distance));
    CHECK(std::abs(speed - approach.speed) < 0.6);
    // The same errors with the first plan carried through.
    RandomStream same(53, trial);
    same.uniform();
    same.uniform();
    const auto plan = planner.plan(start, first, approach);
    double u = start;
    for (const double v : plan.speeds) u -= p.length(v + same.normal(0, 0.05)) + same.normal(0, 0.03);
    blind = std::max(blind, std::abs(u - approach.distance));
  }
  CHECK(worst < 0.35);
  CHECK(blind > worst);
  CHECK(slowest > 1.5);
  CHECK(fastest < 6);
}

TEST_CASE("plan: float agrees with double") {
  StepPlanner<float> fast;
  StepPlanner<double> precise;
  const auto a = fast.plan(30.0f, 2.5f, {1.2f, 3.8f});
  const auto b = precise.plan(30.0, 2.5, {1.2, 3.8});
  REQUIRE(a.speeds.size() == b.speeds.size());
  for (std::size_t i = 0; i < a.speeds.size(); ++i)
    CHECK(static_cast<double>(a.speeds[i]) == doctest::Approx(b.speeds[i]).epsilon(1e-4));
}

TEST_CASE("direction: a runner comes to the line and meets the obstacle square on, turning within the range") {
  RandomStream random(54);
  const DirectionTracker<double> tracker;
  for (int trial = 0; trial < 200; ++trial) {
    const double approach = random.uniform(-3.1, 3.1);
    double along = -40, offset = random.uniform(-2, 2), heading = approach + random.uniform(-0.6, 0.6);
    while (along < -1) {
      const double turn = tracker.turn(heading, approach, offset);
      CHECK(std::abs(turn) <= 6 * std::numbers::pi / 180 + 1e-15);
      heading += turn;
      along += 0.8 * std::cos(heading - approach);
      offset += 0.8 * std::sin(heading - approach);
    }
    CHECK(std::abs(offset) < 0.02);
    CHECK(std::abs(std::remainder(heading - approach, 2 * std::numbers::pi)) < 0.01);
  }
  // Across the seam of angles the shorter way.
  CHECK(tracker.turn(3.1, -3.1, 0.0) == doctest::Approx(2 * std::numbers::pi - 6.2));
  DirectionTracker<double> square;
  square.lookahead = std::numeric_limits<double>::infinity();
  CHECK(square.turn(0.05, 0.0, 5.0) == doctest::Approx(-0.05));
}

TEST_CASE("step planner: parameters that make no sense are refused") {
  Parameters p;
  p.change_weight = 0;
  CHECK(message([&] { StepPlanner<double> planner(p); }) == "step planner: expected weights above zero");
  p = {};
  p.most_steps = 0;
  CHECK(message([&] { StepPlanner<double> planner(p); }) == "step planner: expected room for at least one step");
}
