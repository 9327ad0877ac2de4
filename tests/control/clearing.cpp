// SPDX-License-Identifier: MIT
#include <traceur/control/clearing.hpp>

#include <doctest/doctest.h>

#include "moving_gait.hpp"

using namespace figures;

namespace {

using S = core::Pack<float, 4>;

/// Swaying on, as a manoeuvre that clears nothing.
struct Stand : Sway {
  control::Skill once;
  control::Manoeuvre m;
  std::vector<control::RunningState> states;

  Stand() {
    control::Controller still = c;
    still.cyclic = false;
    once = {control::MotionTable(f.model, f.roles, still, {1.0}), {c.shape, 1}, c.limits};
    m.skill = &once;
    m.control = once.shape.neutral(c.law);
    states.push_back({c.start_pose, c.start_velocity});
    const Eigen::Vector3d center = c.reference.center_of_mass.col(0);
    states[0].pose[0] -= center.x();
    states[0].pose[1] -= center.y();
  }
  control::ClearingSettings quiet() const {
    control::ClearingSettings e;
    e.place = e.velocity = 0;
    e.steps_after = 1;
    return e;
  }
  auto run(const control::ClearingSettings& e, double height = 0) const {
    control::ClearingTrials<S> trials(f.model, f.roles, parameters, ground, control::Hurdle::step(height), c.tick, c.steps_per_tick, gait);
    return trials.run(
        e, 2, [&](int) -> const control::Manoeuvre& { return m; }, [](int l) { return l; }, states, [&](double) { return numbers; });
  }
};

}  // namespace

TEST_CASE("who stands behind the edge at the end has cleared it, who stands before it has not") {
  Stand s;
  s.m.distance = -0.5;
  for (const auto& o : s.run(s.quiet())) {
    if (o.seconds == 0) continue;  // lanes that are not used
    CHECK(o.survived);
    CHECK(o.cleared);
    CHECK(o.seconds == doctest::Approx(1.5));
    CHECK(o.contact == 0);
    CHECK(o.balance < 0.1);
    CHECK(std::abs(o.exit_speed) < 0.3);
  }
  s.m.distance = 0.5;
  CHECK(s.run(s.quiet())[0].survived);
  CHECK_FALSE(s.run(s.quiet())[0].cleared);
}

TEST_CASE("soles that pass the edge too low cost what they lack") {
  Stand s;
  // Feet right over the edge, of a step that is not there: the trial is told a height that the ground has not.
  s.m.distance = 0;
  const double low = s.run(s.quiet(), 0.1)[0].contact, lower = s.run(s.quiet(), 0.2)[0].contact;
  CHECK(low > 0.05);
  CHECK(lower - low == doctest::Approx(0.1).epsilon(1e-3));
}

TEST_CASE("equal starts go equally, others differ, and a fall costs the time lost") {
  Stand s;
  s.m.distance = -0.5;
  control::ClearingSettings e = s.quiet();
  e.place = 0.1;
  e.velocity = 0.1;
  const auto a = s.run(e), b = s.run(e);
  CHECK(a[0].cost == b[0].cost);
  CHECK(a[0].cost != a[1].cost);
  e.stream = 5;
  CHECK(s.run(e)[0].cost != a[0].cost);
  s.m.control.segment(s.once.shape.offset(0), 6) << 0, -1.5, 0, 0, -1.5, 0;
  const auto fallen = s.run(e)[0];
  CHECK_FALSE(fallen.survived);
  CHECK(fallen.cost > 5);
}

TEST_CASE("lanes have steps of their own, and what is not settled at the end costs") {
  Stand s;
  s.m.distance = 0;
  control::ClearingTrials<S> trials(s.f.model, s.f.roles, s.parameters, s.ground, control::Hurdle::step(0.1), s.c.tick, s.c.steps_per_tick, s.gait);
  trials.place(1, s.ground, control::Hurdle::step(0.2));
  control::ClearingSettings e = s.quiet();
  const auto run = [&] {
    return trials.run(
        e, 2, [&](int) -> const control::Manoeuvre& { return s.m; }, [](int) { return 0; }, s.states, [&](double) { return s.numbers; });
  };
  const auto free = run();
  CHECK(trials.hurdle(0).top == 0.1);
  CHECK(trials.hurdle(1).top == 0.2);
  CHECK(free[1].contact - free[0].contact == doctest::Approx(0.1).epsilon(1e-3));
  CHECK(free[0].unsettled > 0);
  CHECK(free[0].unsettled < 0.5);
  e.settle = 2;
  CHECK(run()[0].cost == doctest::Approx(free[0].cost + 2 * free[0].unsettled));
}

TEST_CASE("a state keeps how far off it is, and its reference's place and speed") {
  Stand s;
  s.m.distance = 0.5;
  CHECK_FALSE(s.run(s.quiet())[0].cleared);
  s.states[0].off = 1;
  CHECK(s.run(s.quiet())[0].cleared);
  const double calm = s.run(s.quiet())[0].pose;
  s.states[0].frame.x = 0.1;
  s.states[0].speed = 0.3;
  CHECK(s.run(s.quiet())[0].pose != calm);
}

TEST_CASE("running states begin with a step on the left foot, over the origin") {
  const Stand s;
  control::RunningTrials<S> trials(s.f.model, s.f.roles, s.parameters, s.ground, s.c, s.gait);
  control::RunningSettings e = Sway::settings();
  e.cycles = 2;
  const auto states = control::running_states(trials, s.f.model, s.gait, {}, s.numbers, e, 4);
  CHECK(states.size() >= 4);
  for (const control::RunningState& state : states) {
    const auto m = momentum_of(s.f, state.pose, state.velocity);
    CHECK(std::abs(m.center_of_mass.x) < 1e-4);
    CHECK(std::abs(m.center_of_mass.y) < 1e-4);
  }
}

TEST_CASE("a step goes on, a box has another side, and feet are in its way as far as it reaches") {
  const control::Hurdle step = control::Hurdle::step(0.2), box = control::Hurdle::box(0.7, 0.4), down = control::Hurdle::step(-1);
  CHECK(step.floor(-0.1) == 0);
  CHECK(step.floor(0.1) == 0.2);
  CHECK(step.floor(9) == 0.2);
  CHECK(box.floor(0.39) == 0.7);
  CHECK(box.floor(0.41) == 0);
  CHECK(down.floor(0.1) == -1);
  CHECK(step.in_the_way(-0.1, 0.15, 0.06));
  CHECK_FALSE(step.in_the_way(0.1, 0.15, 0.06));
  CHECK(box.in_the_way(0.42, 0.15, 0.06));
  CHECK_FALSE(box.in_the_way(0.47, 0.15, 0.06));
  CHECK_FALSE(down.in_the_way(0, 0.15, 0.06));
}

TEST_CASE("who should hold on and does not has not cleared it") {
  Stand s;
  s.m.distance = -0.5;
  const auto free = s.run(s.quiet())[0];
  s.m.hand = 0;
  s.m.hold_to = 1000;
  control::ClearingSettings e = s.quiet();
  e.uncleared = 3;
  const auto o = s.run(e)[0];
  CHECK(o.survived);
  CHECK_FALSE(o.held);
  CHECK_FALSE(o.cleared);
  CHECK(o.cost == doctest::Approx(free.cost + 3 + e.weights.contact * e.no_hand));
}

TEST_CASE("told from its reference, a fall is to be turned or lower than that") {
  std::array<S, control::full_sensors> ds;
  ds.fill(S(0.0f));
  CHECK_FALSE(control::off_reference(ds, 1, 1.0, 0.3));
  core::set_lane(ds[1], 1, 1.1f);
  CHECK(control::off_reference(ds, 1, 1.0, 0.3));
  CHECK_FALSE(control::off_reference(ds, 0, 1.0, 0.3));
  core::set_lane(ds[5], 2, -0.4f);
  CHECK(control::off_reference(ds, 2, 1.0, 0.3));
}
