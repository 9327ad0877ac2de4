// SPDX-License-Identifier: MIT
#include <traceur/control/resimulate.hpp>

#include <doctest/doctest.h>

#include "moving_gait.hpp"

using namespace figures;

namespace {

using S = core::Pack<float, 4>;

control::Controller simulated_sway(const Sway& s) {
  control::RunningTrials<S> trials(s.f.model, s.f.roles, s.parameters, s.ground, s.c, s.gait);
  control::RunningSettings e = Sway::settings();
  e.cycles = 2;
  e.perturbation = 0;
  return control::resimulated(trials, s.f.model, s.f.roles, s.c, s.gait, s.numbers, 0, e);
}

}  // namespace

TEST_CASE("a resimulated gait is its own mirror image, and near what it was made of") {
  const Sway s;
  const control::Controller r = simulated_sway(s);
  const int n = r.ticks();
  REQUIRE(n == s.c.ticks());
  for (const int t : {0, 7, 29}) {
    const Eigen::VectorXd here = r.reference.poses.col(t), mirrored = control::mirrored_pose(s.f.model, s.f.roles, r.reference.poses.col(t + n / 2));
    CHECK((here.head(3) - mirrored.head(3)).norm() < 1e-6);
    for (const sim::MovingBody& b : s.f.model.bodies)
      if (b.type == body::JointType::ball)
        CHECK(apart(Quaternion::from(here.data() + b.q_index), Quaternion::from(mirrored.data() + b.q_index)) < 1e-6);
    CHECK((r.reference.velocities.col(t) - control::mirrored_tangent(s.f.model, s.f.roles, r.reference.velocities.col(t + n / 2))).norm() < 1e-5);
    CHECK((here - s.c.reference.poses.col(t)).norm() < 0.2);
  }
  CHECK(r.sensory.norm() == 0);
}

TEST_CASE("without a law the targets of a resimulated gait are those it was given") {
  const Sway s;
  const control::Controller r = simulated_sway(s);
  for (const int t : {0, 11, 45})
    for (const sim::MovingBody& b : s.f.model.bodies)
      if (b.type == body::JointType::ball)
        CHECK(apart(Quaternion::from(r.targets.col(t).data() + b.q_index), Quaternion::from(s.c.targets.col(t).data() + b.q_index)) < 1e-5);
}

TEST_CASE("what falls cannot be resimulated") {
  const Sway s;
  control::RunningTrials<S> trials(s.f.model, s.f.roles, s.parameters, s.ground, s.c, s.gait);
  Eigen::VectorXd folding = s.numbers;
  for (int side = 0; side < 2; ++side) folding.segment(s.gait.shape.offset(side), 6) << 0, -1.5, 0, 0, -1.5, 0;
  CHECK(contains(error_of([&] { control::resimulated(trials, s.f.model, s.f.roles, s.c, s.gait, folding, 0, Sway::settings()); }), "a run fell after"));
}
