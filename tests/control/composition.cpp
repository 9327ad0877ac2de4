// SPDX-License-Identifier: MIT
#include <traceur/control/composition.hpp>

#include <doctest/doctest.h>

#include <numbers>

#include "moving_gait.hpp"

using namespace figures;
using control::RunStage;

namespace {

constexpr double tick = 1.0 / 60;

struct Course {
  const Figure& f = small();
  control::Controller running = any_controller(f, 20, true, 3, 1), leap = any_controller(f, 30, false, 3, 2, {{}, 3, 2});
  control::Skill gait{control::MotionTable(f.model, f.roles, running, {1.0}), {running.shape, 2}, running.limits};
  control::Skill once{control::MotionTable(f.model, f.roles, leap, {1.0}), {leap.shape, 2}, leap.limits};
  Eigen::VectorXd run = gait.shape.neutral(running.law), exit = gait.shape.neutral(0.5 * running.law);
  control::Manoeuvre m{&once, once.shape.neutral(leap.law), 1.2, 3.2, 2.8, 0.4};

  /// Goes on until a step begins or the stage changes; ticks it took.
  int wait(control::Composer& c, double& x) const {
    const RunStage before = c.stage();
    for (int t = 1; t < 1000; ++t) {
      x += 3 * tick;
      c.advance(tick, x, 0);
      if (c.at_step() || c.stage() != before) return t;
    }
    return -1;
  }
};

}  // namespace

TEST_CASE("running goes step by step, and asks at the beginning of each") {
  const Course s;
  control::Composer c(s.f.model, s.gait);
  c.start(s.run, 3, {}, c.step_start(1));
  CHECK(c.step_start(0) == 0);
  CHECK(c.step_start(1) == 10);
  REQUIRE(c.at_step());
  CHECK(c.side() == 1);
  c.step(s.run, 3, 0.1);
  CHECK_FALSE(c.at_step());
  double x = 0;
  CHECK(s.wait(c, x) == 10);
  CHECK(c.at_step());
  CHECK(c.side() == 0);
  // The step turned by what was asked for.
  CHECK(c.player().frame().heading == doctest::Approx(0.1));
  Eigen::VectorXd slow = s.run;
  slow[s.gait.shape.beta()] = 1.5;
  c.step(slow, 2, 0);
  CHECK(s.wait(c, x) == 15);
  CHECK(c.side() == 1);
}

TEST_CASE("a manoeuvre goes through transIn, clear and transOut back to running") {
  const Course s;
  control::Composer::Settings settings;
  settings.trans_out_steps = 2;
  control::Composer c(s.f.model, s.gait, settings);
  c.set_exit(s.exit);
  c.start(s.run, 3, {}, c.step_start(1));
  c.clear(s.m, {0.2, 5, 1, 0}, 3, 0);
  CHECK(c.stage() == RunStage::trans_in);
  CHECK(c.player().blending());
  double x = 3;
  CHECK(s.wait(c, x) == 15);
  CHECK(c.stage() == RunStage::clear);
  // References are blended over one running step.
  CHECK_FALSE(c.player().blending());
  CHECK(s.wait(c, x) == 15);
  CHECK(c.stage() == RunStage::trans_out);
  CHECK(c.player().blending());
  CHECK(c.player().speed() == 2.8);
  CHECK(c.player().frame().heading == 0.2);
  CHECK(c.player().frame().x == x);
  CHECK(c.player().frame().z == 0.4);
  // The leap's last stance is on the right, so the left foot's step is next.
  CHECK(c.side() == 1);
  for (int i = 0; i < s.gait.shape.size(); ++i) CHECK(c.player().control()[i] == s.exit[i]);
  REQUIRE(c.at_step());
  c.step(s.exit, 2.8, 0);
  s.wait(c, x);
  CHECK(c.stage() == RunStage::trans_out);
  c.step(s.exit, 2.8, 0);
  s.wait(c, x);
  CHECK(c.stage() == RunStage::run);
  CHECK(c.at_step());
}

TEST_CASE("a manoeuvre that may slide is done where it is begun, up to so far from its place") {
  Course s;
  s.m.slide = 0.3;
  const auto frame_from = [&](double off) {
    control::Composer c(s.f.model, s.gait);
    c.start(s.run, 3, {}, c.step_start(1));
    // The obstacle is 5 m ahead along y.
    c.clear(s.m, {std::numbers::pi / 2, 0, 5, 0.1}, 0.07, 5 - s.m.distance + off);
    return c.player().frame();
  };
  for (const double off : {-0.2, 0.0, 0.1}) {
    CHECK(frame_from(off).y == doctest::Approx(5 + off));
    CHECK(frame_from(off).x == doctest::Approx(0));
    CHECK(frame_from(off).z == 0.1);
  }
  CHECK(frame_from(0.5).y == doctest::Approx(5.3));
  CHECK(frame_from(-2).y == doctest::Approx(4.7));
  s.m.slide = 0;
  CHECK(frame_from(0.5).y == doctest::Approx(5));
}

TEST_CASE("a manoeuvre may have a transOut of its own length") {
  Course s;
  s.m.steps_out = 1;
  control::Composer c(s.f.model, s.gait);
  c.set_exit(s.exit);
  c.start(s.run, 3, {}, c.step_start(1));
  c.clear(s.m, {}, 0, 0);
  double x = 0;
  s.wait(c, x);
  s.wait(c, x);
  REQUIRE(c.stage() == RunStage::trans_out);
  c.step(s.exit, 2.8, 0);
  s.wait(c, x);
  CHECK(c.stage() == RunStage::run);
}

TEST_CASE("a manoeuvre's recovery is added to running's numbers during transOut, and only then") {
  Course s;
  s.m.recovery = Eigen::VectorXd::Constant(s.gait.shape.size(), 0.01);
  control::Composer::Settings settings;
  settings.trans_out_steps = 2;
  control::Composer c(s.f.model, s.gait, settings);
  c.set_exit(s.exit);
  c.start(s.run, 3, {}, c.step_start(1));
  const auto is = [&](const Eigen::VectorXd& wanted) {
    for (int i = 0; i < s.gait.shape.size(); ++i) CHECK(c.player().control()[i] == wanted[i]);
  };
  is(s.run);
  c.clear(s.m, {}, 0, 0);
  double x = 0;
  s.wait(c, x);
  s.wait(c, x);
  REQUIRE(c.stage() == RunStage::trans_out);
  is(s.exit + s.m.recovery);
  c.step(s.run, 2.8, 0);
  is(s.run + s.m.recovery);
  s.wait(c, x);
  c.step(s.run, 2.8, 0);
  s.wait(c, x);
  REQUIRE(c.stage() == RunStage::run);
  c.step(s.run, 2.8, 0);
  is(s.run);
}

TEST_CASE("without blending references change at once") {
  const Course s;
  control::Composer::Settings settings;
  settings.blend = false;
  control::Composer c(s.f.model, s.gait, settings);
  c.set_exit(s.exit);
  c.start(s.run, 3, {}, 0);
  c.clear(s.m, {}, 0, 0);
  CHECK_FALSE(c.player().blending());
}

TEST_CASE("only a gait of two steps can be run with") {
  const Course s;
  CHECK_THROWS_WITH(control::Composer(s.f.model, s.once), "composition: expected a gait of two steps");
}
