// SPDX-License-Identifier: MIT
#include <numbers>

#include <traceur/backends/dart.hpp>

#include "conformance.hpp"

using traceur::backends::Dart;

TEST_CASE("DART is a simulator") {
  conformance::Bounds bounds;
  bounds.carried = 3e-4;
  bounds.fall = 1e-9;
  bounds.momentum = 1e-9;
  bounds.weight = 0.02;
  bounds.creep = 0.0002;
  bounds.step_response = 0.01;
  bounds.torque = 0.001;
  bounds.slope_creep = 1e-4;
  bounds.slide = 0.01;
  bounds.grip = 0.0005;
  bounds.hanging = 0.002;
  bounds.push = 0.001;
  conformance::conforms<Dart>(bounds);
}

TEST_CASE("DART keeps the norm of every motor's torque within its limit") {
  const scene::Character& c = scene::humanoid();
  Dart w(c, 1);
  w.reset(0, scene::standing_pose(), scene::at_rest());
  traceur::core::RandomStream random(11);
  double most = 0;
  for (int n = 0; n < 20; ++n) {
    w.set_target(0, scene::random_target(c, random, 2.0));
    for (int k = 0; k < 16; ++k) {
      w.step(1);
      for (int j = 0; j < c.skeleton.size(); ++j)
        if (c.actuators[static_cast<std::size_t>(j)].stiffness > 0)
          most = std::max(most, norm(w.motor_torque(0, j)) / c.actuators[static_cast<std::size_t>(j)].torque_limit);
    }
  }
  CHECK_FALSE(w.failed(0));
  CHECK(most <= 1 + 2e-6);
  CHECK(most > 0.99);
}

TEST_CASE("DART takes turned rest frames and a turned, welded root") {
  using traceur::core::about_axis;
  scene::Character c = scene::humanoid();
  traceur::body::Skeleton turned;
  traceur::core::RandomStream random(12);
  traceur::body::Joint base;
  base.name = base.body = "base";
  base.type = scene::JointType::fixed;
  base.offset = {0.1, 0.2, 5};
  base.rest = scene::random_rotation(random);
  turned.add(base);
  for (traceur::body::Joint j : c.skeleton.joints()) {
    ++j.parent;
    if (j.type == scene::JointType::free) {
      j.type = scene::JointType::ball;
      j.offset = {0.3, 0, 0.1};
    }
    j.rest = scene::random_rotation(random);
    turned.add(j);
  }
  c.skeleton = turned;
  c.inertias.insert(c.inertias.begin(), traceur::body::Inertia{});
  c.actuators.insert(c.actuators.begin(), traceur::body::Actuator{});
  for (auto& s : c.shapes) ++s.body;
  for (auto& a : c.actuators) a = traceur::body::Actuator{};
  const Eigen::VectorXd q = scene::random_pose(c, random, 1.0), v = scene::random_velocity(c, random, 1.0);
  // Without motors a step agrees with the bundled simulator's to first order in its length.
  traceur::sim::Parameters p;
  p.dt = 1e-5;
  Dart w(c, 1, p);
  traceur::sim::World<double> reference(c, 1, p);
  w.reset(0, q, v);
  reference.reset(0, q, v);
  w.step(100);
  reference.step(100);
  CHECK((w.pose(0) - reference.pose(0)).cwiseAbs().maxCoeff() < 1e-5);
  const double change = (reference.velocity(0) - v).norm();
  CHECK(change > 0.05);
  CHECK((w.velocity(0) - reference.velocity(0)).norm() < 0.02 * change);
}

TEST_CASE("DART lets a capsule lie still across a seam of columns and on two bars") {
  scene::Character c = scene::box({0.1, 0.1, 0.1}, 4);
  c.shapes[0].kind = traceur::body::Shape::Kind::capsule;
  c.shapes[0].size = {0.05, 0.3, 0};
  c.shapes[0].rotation = about_axis(scene::Vector{0, 1, 0}, std::numbers::pi / 2);
  traceur::sim::Scene place;
  SUBCASE("columns") {
    Eigen::MatrixXd heights = Eigen::MatrixXd::Constant(4, 4, 0.5);
    heights(3, 3) = 0.2;
    place.ground = traceur::sim::Ground<double>(traceur::terrain::HeightGrid(heights, 0.4, -0.8, -0.7));
  }
  SUBCASE("bars above the ground") {
    traceur::terrain::Box left, right;
    left.half_size = right.half_size = {0.05, 0.4, 0.05};
    left.center = {-0.15, 0, 0.45};
    right.center = {0.15, 0, 0.45};
    place.boxes = traceur::terrain::BoxScene({left, right});
  }
  Dart w(c, 1, {}, place);
  Eigen::VectorXd q = c.skeleton.neutral_pose();
  q[2] = 0.55;
  w.reset(0, q, Eigen::VectorXd::Zero(6));
  w.step(480);
  CHECK_FALSE(w.failed(0));
  CHECK(w.pose(0)[2] == doctest::Approx(0.55).epsilon(0.01));
  CHECK(w.velocity(0).head(3).norm() < 0.01);
  CHECK(w.velocity(0).tail(3).norm() < 0.05);
  CHECK(w.contact_force(0, 0).z == doctest::Approx(4 * 9.81).epsilon(0.02));
}

TEST_CASE("DART draws a gap of a grip together") {
  const scene::Character c = scene::box({0.1, 0.1, 0.1}, 5);
  Dart w(c, 1);
  Eigen::VectorXd q = c.skeleton.neutral_pose();
  q[2] = 2;
  w.reset(0, q, Eigen::VectorXd::Zero(6));
  const scene::Vector point{0, 0, 0.1}, anchor{0.02, 0.01, 2.11};
  w.hold(0, 0, point, anchor);
  w.step(480);
  CHECK(norm(conformance::frames(c, w.pose(0)).point(0, point) - anchor) < 1e-3);
  // A reset lets go.
  w.reset(0, q, Eigen::VectorXd::Zero(6));
  w.step(48);
  CHECK(w.velocity(0)[2] == doctest::Approx(-0.981));
  CHECK(norm(w.grip_force(0, 0)) == 0);
}
