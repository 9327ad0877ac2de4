// SPDX-License-Identifier: MIT
#include <traceur/control/running.hpp>

#include <array>
#include <utility>
#include <vector>

#include <doctest/doctest.h>

#include "moving_gait.hpp"

using namespace figures;

namespace {

using S = core::Pack<float, 4>;

}  // namespace

TEST_CASE("who stands to the end has survived, with speed and turn near zero") {
  const Sway s;
  control::RunningTrials<S> trials(s.f.model, s.f.roles, s.parameters, s.ground, s.c, s.gait);
  const auto out = trials.run(
      s.settings(), 4, [&](int) { return s.numbers.data(); }, [](int) { return control::RunningTask{}; }, [](int l) { return l; });
  for (const control::RunningOutcome& o : out) {
    CHECK(o.survived);
    CHECK(o.record.seconds == doctest::Approx(2));
    CHECK(o.record.cycles == 2);
    CHECK(o.record.head_movement < 0.1);
    // f* = 2 (0.2 v + 0.8) at v = 0, and two steps a second are done.
    CHECK(o.record.frequency_error == doctest::Approx(2 * 0.4));
    CHECK(o.record.speed_error < 0.3);
    CHECK(o.cost == doctest::Approx(control::running_cost(o.record)));
  }
}

TEST_CASE("beta stretches the run, and who falls loses the rest of it") {
  const Sway s;
  control::RunningTrials<S> trials(s.f.model, s.f.roles, s.parameters, s.ground, s.c, s.gait);
  Eigen::VectorXd slow = s.numbers, folding = s.numbers;
  slow[s.gait.shape.beta()] = 1.2;
  // Hips bent by a radian more than standing allows.
  for (int side = 0; side < 2; ++side) folding.segment(s.gait.shape.offset(side), 6) << 0, -1.5, 0, 0, -1.5, 0;
  const auto out = trials.run(
      s.settings(), 2, [&](int l) { return l == 0 ? slow.data() : folding.data(); }, [](int) { return control::RunningTask{}; },
      [](int) { return 0; });
  CHECK(out[0].survived);
  CHECK(out[0].record.wanted_seconds == doctest::Approx(2.4));
  CHECK(out[0].record.seconds == doctest::Approx(2.4));
  CHECK_FALSE(out[1].survived);
  CHECK(out[1].record.seconds < 1.9);
  CHECK(out[1].cost >= out[1].record.wanted_seconds - out[1].record.seconds);
}

TEST_CASE("a run depends on its start and not on its lane") {
  const Sway s;
  control::RunningTrials<S> trials(s.f.model, s.f.roles, s.parameters, s.ground, s.c, s.gait);
  const auto run = [&](int used, auto start) {
    return trials.run(s.settings(), used, [&](int) { return s.numbers.data(); }, [](int) { return control::RunningTask{}; }, start);
  };
  const auto a = run(4, [](int l) { return l; }), b = run(2, [](int l) { return 3 - l; });
  CHECK(a[3].cost == b[0].cost);
  CHECK(a[2].cost == b[1].cost);
  CHECK(a[0].cost != a[1].cost);
}

TEST_CASE("the mirrored control makes the mirrored run") {
  const Sway s;
  control::RunningTrials<S> trials(s.f.model, s.f.roles, s.parameters, s.ground, s.c, s.gait);
  Eigen::VectorXd left = s.numbers;
  left.segment(s.gait.shape.offset(0), 9).setConstant(0.02);
  const Eigen::VectorXd right = s.gait.shape.mirrored(left);
  const auto out = trials.run(
      s.settings(), 2, [&](int l) { return l == 0 ? left.data() : right.data(); },
      [](int l) { return control::RunningTask{l == 0 ? 0.01 : -0.01, 0}; }, [](int) { return 3; });
  CHECK(out[0].survived);
  CHECK(out[1].survived);
  CHECK(out[1].record.head_movement == doctest::Approx(out[0].record.head_movement).epsilon(1e-2));
  CHECK(out[1].record.speed_error == doctest::Approx(out[0].record.speed_error).epsilon(1e-2));
}

TEST_CASE("every other start is on the other foot if that is asked for") {
  const Sway s;
  control::RunningTrials<S> trials(s.f.model, s.f.roles, s.parameters, s.ground, s.c, s.gait);
  Eigen::VectorXd one = s.numbers;
  one.segment(s.gait.shape.offset(0), 9).setConstant(0.02);
  const Eigen::VectorXd other = s.gait.shape.mirrored(one);
  control::RunningSettings e = s.settings();
  const auto run = [&](const Eigen::VectorXd& control) {
    return trials.run(e, 2, [&](int) { return control.data(); }, [](int) { return control::RunningTask{}; }, [](int l) { return 2 + l; });
  };
  const auto before = run(one);
  e.either_foot = true;
  const auto after = run(one), mirrored = run(other);
  CHECK(after[0].cost == before[0].cost);
  CHECK(after[1].record.head_movement != before[1].record.head_movement);
  CHECK(mirrored[1].record.head_movement == doctest::Approx(before[1].record.head_movement).epsilon(1e-2));
  CHECK(mirrored[1].record.speed_error == doctest::Approx(before[1].record.speed_error).epsilon(1e-2));
}

TEST_CASE("pushes depend on the start alone, and end with the run that asked for them") {
  const Sway s;
  control::RunningTrials<S> trials(s.f.model, s.f.roles, s.parameters, s.ground, s.c, s.gait);
  control::RunningSettings e = s.settings();
  const auto run = [&](int used, auto start) {
    return trials.run(e, used, [&](int) { return s.numbers.data(); }, [](int) { return control::RunningTask{}; }, start);
  };
  const auto calm = run(2, [](int l) { return l; });
  e.push = 0.1;
  const auto pushed = run(2, [](int l) { return l; }), other_lane = run(2, [](int l) { return 1 - l; });
  CHECK(pushed[1].cost == other_lane[0].cost);
  CHECK(pushed[0].cost != calm[0].cost);
  e.push = 0;
  CHECK(run(2, [](int l) { return l; })[0].cost == calm[0].cost);
}

TEST_CASE("a wandering reference has another speed and turn at every step, within what is allowed, whatever the lane") {
  const Sway s;
  control::RunningTrials<S> trials(s.f.model, s.f.roles, s.parameters, s.ground, s.c, s.gait);
  control::RunningSettings e = s.settings();
  struct Steps {
    std::vector<double> speeds, headings;
  };
  const auto run = [&](int used, auto start) {
    std::array<Steps, 4> steps;
    const auto out = trials.run(
        e, used, [&](int) { return s.numbers.data(); }, [](int) { return control::RunningTask{0, 0.5}; }, start,
        [&](int tick, const auto&, const auto& players) {
          // Steps are of 30 ticks.
          if (tick % 30 != 29) return;
          for (std::size_t l = 0; l < 4; ++l) {
            steps[l].speeds.push_back(players[l].speed());
            steps[l].headings.push_back(players[l].frame().heading);
          }
        });
    return std::pair(out, steps);
  };
  const auto [still, kept] = run(2, [](int l) { return l; });
  for (const double v : kept[0].speeds) CHECK(v == 0.5);
  e.wander = {0.02, 0.1};
  const auto [out, steps] = run(2, [](int l) { return l; });
  const auto [exchanged, other] = run(2, [](int l) { return 1 - l; });
  REQUIRE(steps[0].speeds.size() >= 2);
  double before = 0;
  for (std::size_t k = 0; k < steps[0].speeds.size(); ++k) {
    const double off = steps[0].speeds[k] - 0.5, turn = steps[0].headings[k] - before;
    before = steps[0].headings[k];
    CHECK(std::abs(off) <= 0.1);
    CHECK(std::abs(turn) <= 0.02 + 1e-9);
    CHECK(off != 0);
    CHECK(turn != 0);
    if (k > 0) CHECK(steps[0].speeds[k] != steps[0].speeds[k - 1]);
  }
  CHECK(steps[0].speeds == other[1].speeds);
  CHECK(steps[0].headings == other[1].headings);
  CHECK(steps[0].speeds != steps[1].speeds);
  CHECK(out[0].cost == exchanged[1].cost);
}

TEST_CASE("a start moves the whole body at the speed asked for") {
  const Sway s;
  const auto start = [&](double perturbation, std::uint64_t number) {
    return control::RunningStart::make(s.f.model, s.c, 1.0, 3.0, perturbation, control::Perturbation{}, 1, 2, number);
  };
  CHECK(start(0, 1).velocity[0] == doctest::Approx(s.c.start_velocity[0] + 2));
  CHECK(start(0, 1).pose == s.c.start_pose);
  CHECK(start(1, 1).pose != start(1, 2).pose);
  CHECK(start(1, 1).pose == start(1, 1).pose);
  CHECK((start(1, 1).pose.head(7) - s.c.start_pose.head(7)).norm() == 0);
}
