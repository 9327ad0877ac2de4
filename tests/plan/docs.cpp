// SPDX-License-Identifier: MIT
// The snippets of docs/plan.md, compiled and run. Keep the two alike.
#include <cmath>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/random.hpp>
#include <traceur/plan/a_star.hpp>
#include <traceur/plan/navigation_graph.hpp>
#include <traceur/plan/step_planner.hpp>
#include <traceur/terrain/generators.hpp>

using namespace traceur;

TEST_CASE("docs/plan.md: paths over terrain") {
  std::vector<core::Vector3<double>> way;

  terrain::RandomBoxes boxes;
  core::RandomStream random(7);
  const terrain::HeightGrid ground = terrain::random_boxes(boxes, random);

  const plan::NavigationGraph graph(ground);
  plan::PathPlanner planner;
  std::vector<int> path;
  if (const auto ends = plan::random_endpoints(graph, {}, random)) {
    const double cost = planner.plan(graph, ends->start, ends->goal, 7, 0, path);  // infinite where there is no path
    for (const int node : path) way.push_back(graph.position(node));               // m, middles of tops
    CHECK(std::isfinite(cost));
  }

  REQUIRE(way.size() > 1);
  CHECK(std::hypot(way.back().x - way.front().x, way.back().y - way.front().y) >= 5 - 1e-9);
}

TEST_CASE("docs/plan.md: steps up to an obstacle") {
  struct Runner {
    double distance = 25, speed = 2.8, heading = 0.2, offset = 0.5;
    void step(double v, double turn) {
      const double length = 0.2 * v + 0.17;
      speed = v;
      heading += turn;
      distance -= length * std::cos(heading);
      offset += length * std::sin(heading);
    }
  } runner;

  plan::StepPlanner<double> steps;
  const plan::Approach<double> approach{1.4, 3.4};  // u_h in m, v_in in m/s
  const plan::DirectionTracker<double> direction;
  while (steps.steps(runner.distance, runner.speed, approach) > 0) {
    const auto plan = steps.plan(runner.distance, runner.speed, approach);
    runner.step(plan.speeds[0], direction.turn(runner.heading, 0, runner.offset));
  }

  CHECK(runner.speed == doctest::Approx(3.4));
  CHECK(std::abs(runner.distance - 1.4) < 0.1);
  CHECK(std::abs(runner.offset) < 0.05);
}
