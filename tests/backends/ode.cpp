// SPDX-License-Identifier: MIT
#include <traceur/backends/ode.hpp>

#include "conformance.hpp"

using traceur::backends::Ode;

TEST_CASE("ODE is a simulator") {
  conformance::Bounds bounds;
  bounds.carried = 1e-4;
  bounds.fall = 1e-4;
  bounds.momentum = 0.003;
  bounds.weight = 0.005;
  bounds.creep = 0.0005;
  bounds.step_response = 0.01;
  bounds.torque = 0.002;
  bounds.slope_creep = 1e-6;
  bounds.slide = 0.01;
  bounds.grip = 0.0005;
  bounds.hanging = 0.001;
  bounds.push = 0.001;
  conformance::conforms<Ode>(bounds);
}

TEST_CASE("ODE keeps the norm of every motor's torque within its limit") {
  conformance::keeps_torque_norms<Ode>();
}

TEST_CASE("ODE takes turned rest frames and a turned, welded root") {
  conformance::takes_turned_frames<Ode>();
}

TEST_CASE("ODE lets a capsule lie still across a seam of columns and on two bars") {
  conformance::lets_a_capsule_lie<Ode>();
}

TEST_CASE("ODE draws a gap of a grip together") {
  conformance::draws_a_gap_together<Ode>();
}

TEST_CASE("instances of ODE come and go in any order") {
  const scene::Character c = scene::box({0.1, 0.1, 0.1}, 5);
  Eigen::VectorXd q = c.skeleton.neutral_pose();
  q[2] = 2;
  auto first = std::make_unique<Ode>(c, 2);
  auto second = std::make_unique<Ode>(c, 1);
  first.reset();
  second->reset(0, q, Eigen::VectorXd::Zero(6));
  Ode moved = std::move(*second);
  second.reset();
  moved.step(48);
  CHECK(moved.velocity(0)[2] == doctest::Approx(-0.981));
}
