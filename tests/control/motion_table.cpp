// SPDX-License-Identifier: MIT
#include <traceur/control/motion_table.hpp>

#include <doctest/doctest.h>

#include <cmath>
#include <numbers>

#include <traceur/motion/scaling.hpp>

#include "moving_gait.hpp"

using namespace figures;

namespace {

Eigen::VectorXf sample(const control::MotionTable& t, double alpha, double beta, double phase) {
  Eigen::VectorXf out(t.layout().size());
  t.sample(alpha, beta, phase, out.data());
  return out;
}

}  // namespace

TEST_CASE("at its own amplitude a table holds the controller's targets and reference") {
  const Figure& f = humanoid();
  const control::Controller c = any_controller(f, 20, true, 2.5);
  const control::MotionTable table(f.model, f.roles, c, {0.5, 1.0, 1.5});
  const control::MomentLayout& l = table.layout();
  CHECK(table.speed() == doctest::Approx(2.5).epsilon(1e-6));
  CHECK(table.duration() == doctest::Approx(20 / 60.0));
  for (const int t : {0, 5, 19}) {
    const Eigen::VectorXf m = sample(table, 1, 1, t);
    for (const sim::MovingBody& b : f.model.bodies) {
      const Eigen::VectorXd target = c.targets.col(t);
      if (b.type == body::JointType::hinge) CHECK(m[b.q_index - 7] == doctest::Approx(target[b.q_index]).epsilon(1e-5));
      if (b.type == body::JointType::ball)
        CHECK(apart(Quaternion::from(m.data() + b.q_index - 7), Quaternion::from(target.data() + b.q_index)) < 1e-6);
    }
    const Eigen::Vector3d center = c.reference.center_of_mass.col(t), velocity = c.reference.center_velocity.col(t);
    const double travelled = table.speed() * t * c.tick;
    CHECK(m[l.center()] == doctest::Approx(center.x() - table.start_center().x - travelled).epsilon(1e-4).scale(1));
    CHECK(m[l.center() + 2] == doctest::Approx(center.z()).epsilon(1e-5));
    CHECK(m[l.velocity()] == doctest::Approx(velocity.x() - table.speed()).epsilon(1e-4).scale(1));
    for (int i = 0; i < 6; ++i)
      CHECK(m[l.feet() + i] == doctest::Approx(c.reference.feet(i, t) - center[i % 3]).epsilon(1e-5).scale(1));
    CHECK(m[l.sensory() + 4] == doctest::Approx(c.sensory(4, t)));
  }
  CHECK(table.step_starts() == std::vector<int>{0, 10});
}

TEST_CASE("a gait goes round, a motion done once stays in its last moment") {
  const Figure& f = small();
  const control::Controller gait = any_controller(f, 16, true, 2), once = any_controller(f, 16, false, 2);
  const control::MotionTable round(f.model, f.roles, gait, {1.0}), last(f.model, f.roles, once, {1.0});
  CHECK((sample(round, 1, 1, 3.25) - sample(round, 1, 1, 3.25 + 32)).norm() < 1e-4f);
  CHECK((sample(round, 1, 1, -0.5) - sample(round, 1, 1, 15.5)).norm() < 1e-4f);
  CHECK(round.stance(9.5) == 1);
  CHECK(round.stance(-0.5) == 1);
  CHECK(round.stance(16.5) == 0);
  CHECK(sample(last, 1, 1, 16) == sample(last, 1, 1, 99));
  CHECK(sample(last, 1, 1, 0) == sample(last, 1, 1, -1));
  // Half way between ticks numbers are half way.
  CHECK((sample(round, 1, 1, 4.5) - 0.5f * (sample(round, 1, 1, 4) + sample(round, 1, 1, 5))).norm() < 1e-6f);
}

TEST_CASE("amplitudes scale states and actions about their means, Eq. 5 and 6") {
  const Figure& f = humanoid();
  const control::Controller c = any_controller(f, 20, true, 2.5);
  const control::MotionTable table(f.model, f.roles, c, {0.5, 1.0});
  const control::MomentLayout& l = table.layout();
  motion::Clip targets{"targets", f.skeleton(), Eigen::VectorXd::LinSpaced(21, 0, 20.0 / 60), c.reference.poses, {}, false};
  for (int t = 0; t < 21; ++t) targets.poses.col(t).tail(f.model.nq - 7) = c.targets.col(t % 20).tail(f.model.nq - 7);
  const motion::Clip half = motion::scale_amplitude(targets, 0.5);
  for (const int t : {2, 13}) {
    const Eigen::VectorXf m = sample(table, 0.5, 1, t), whole = sample(table, 1, 1, t), stretched = sample(table, 0.5, 1.25, t);
    for (const sim::MovingBody& b : f.model.bodies)
      if (b.type == body::JointType::ball)
        CHECK(apart(Quaternion::from(m.data() + b.q_index - 7), Quaternion::from(half.poses.col(t).data() + b.q_index)) < 1e-6);
    // The root's rotation is scaled towards upright, its angular velocity with it and by the stretch of time.
    const Vector turn = log_map(Quaternion::from(m.data() + l.root())), full = log_map(Quaternion::from(whole.data() + l.root()));
    CHECK(norm(turn - 0.5 * full) < 1e-5);
    for (int i = 0; i < 3; ++i) {
      CHECK(m[l.spin() + i] == doctest::Approx(0.5 * whole[l.spin() + i]).epsilon(1e-4).scale(1));
      CHECK(stretched[l.spin() + i] == doctest::Approx(m[l.spin() + i] / 1.25).epsilon(1e-5).scale(1));
    }
    // In between, in between; beyond, as at the end.
    CHECK((sample(table, 0.75, 1, t) - 0.5f * (m + whole)).norm() < 1e-5f);
    CHECK(sample(table, 0.1, 1, t) == m);
    CHECK(sample(table, 7, 1, t) == whole);
  }
}

TEST_CASE("a family of motions is interpolated by its parameter") {
  const Figure& f = small();
  control::Controller low = any_controller(f, 12, false, 2), high = low;
  high.reference.poses.row(2).array() += 0.5;
  control::measure_reference(f.model, f.roles, f.points, high.reference);
  control::MotionTable table(f.model, f.roles, {low, high}, {0.0, 0.4});
  const int z = table.layout().center() + 2;
  CHECK(sample(table, 0.1, 1, 5)[z] == doctest::Approx(sample(table, 0, 1, 5)[z] + 0.125).epsilon(1e-5));
  CHECK(table.offset(3) == 0);
  table.divide({0, 0, 0, 1, 1, 1, 2, 2, 2, 2, 2, 2});
  CHECK(table.offset(3) == 1);
  CHECK(table.offset(40) == 2);
  CHECK_THROWS_WITH(table.divide({0, 1}), "motion table: expected an offset for every tick");
  control::Controller longer = any_controller(f, 14, false, 2);
  CHECK_THROWS_WITH(control::MotionTable(f.model, f.roles, {low, longer}, {0.0, 0.4}),
                    "motion table of 'any': expected motions done once, alike in length, stance and phases");
  CHECK_THROWS_WITH(control::MotionTable(f.model, f.roles, {low, high}, {0.4, 0.4}),
                    "motion table of 'any': expected values that increase");
}

TEST_CASE("between motions whose targets go round opposite ways there is a rotation all the same") {
  const Figure& f = small();
  control::Controller low = any_controller(f, 12, false, 2), high = low;
  int ball = -1;
  for (const sim::MovingBody& b : f.model.bodies)
    if (b.type == traceur::body::JointType::ball) ball = b.q_index;
  REQUIRE(ball >= 7);
  // A jump from one side to the other, through rest in the one and behind in the other: the same rotations at the end.
  for (int t = 0; t < 12; ++t) {
    const double angle = t < 6 ? 1.4 : -1.4, other = t < 3 ? 1.4 : t < 6 ? 3.0 : 2 * std::numbers::pi - 1.4;
    const auto put = [&](control::Controller& c, double a) { traceur::core::about_axis(traceur::core::Vector3<double>{0, 1, 0}, a).store(c.targets.col(t).data() + ball); };
    put(low, angle);
    put(high, other);
  }
  control::MotionTable table(f.model, f.roles, {low, high}, {0.0, 1.0});
  for (const double share : {0.25, 0.5, 0.75}) {
    const Eigen::VectorXf there = sample(table, share, 1, 8).segment(ball - 7, 4);
    CHECK(there.norm() == doctest::Approx(1).epsilon(1e-4));
    CHECK(std::abs(there[1]) == doctest::Approx(std::sin(0.7)).epsilon(1e-3));
  }
}

TEST_CASE("what no table can be made of is refused") {
  const Figure& f = small();
  const control::Controller c = any_controller(f, 12, true, 2);
  CHECK_THROWS_WITH(control::MotionTable(f.model, f.roles, c, std::vector<double>{}), "motion table of 'any': expected an amplitude");
  CHECK_THROWS_WITH(control::MotionTable(f.model, f.roles, c, std::vector<double>{1.0, 0.5}),
                    "motion table of 'any': expected amplitudes above zero that increase");
}
