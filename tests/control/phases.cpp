// SPDX-License-Identifier: MIT
#include <traceur/control/phases.hpp>

#include <doctest/doctest.h>

#include <string>

using namespace traceur::control;

namespace {

constexpr double dt = 1.0 / 60;

/// The phase after so many equal ticks.
int hold(PhaseDetector& d, const PhaseSenses& s, int ticks) {
  for (int t = 0; t < ticks; ++t) d.update(s, dt);
  return d.phase();
}
PhaseSenses feet(bool right, bool left) {
  PhaseSenses s;
  s.foot_down = {right, left};
  return s;
}

}  // namespace

TEST_CASE("a jump takes off, flies and lands") {
  PhaseDetector d(jump_phases());
  CHECK(hold(d, feet(true, false), 10) == 0);
  CHECK(hold(d, feet(false, false), 1) == 1);
  CHECK(hold(d, feet(false, false), 20) == 1);
  CHECK(hold(d, feet(false, true), 1) == 2);
  CHECK(hold(d, feet(false, false), 20) == 2);
  d.restart();
  CHECK(d.phase() == 0);
}

TEST_CASE("a vault's first phase ends where the hand was put, not where it is") {
  PhaseDetector d(vault_phases());
  PhaseSenses s = feet(true, false);
  s.center = 1;
  CHECK(hold(d, s, 5) == 0);
  CHECK_FALSE(d.hand_place() == d.hand_place());
  s = feet(false, false);
  s.center = 1.2;
  s.hand = 1.5;
  s.hand_touches = true;
  CHECK(hold(d, s, 2) == 0);
  CHECK(d.hand_place() == 1.5);
  s.hand_touches = false;
  s.hand = 0.9;
  s.center = 1.49;
  CHECK(hold(d, s, 5) == 0);
  s.center = 1.51;
  CHECK(hold(d, s, 1) == 1);
  // It began in the air, so the first foot ends it.
  CHECK(hold(d, s, 5) == 1);
  s.foot_down = {false, true};
  CHECK(hold(d, s, 1) == 2);
}

TEST_CASE("a vault in which a foot never left the ground does not end its second phase by that foot") {
  PhaseDetector d({PhaseEvent::one_foot_lands, PhaseEvent::never});
  CHECK(hold(d, feet(true, false), 100) == 0);
  CHECK(hold(d, feet(false, false), 1) == 0);
  CHECK(hold(d, feet(true, false), 1) == 1);
}

TEST_CASE("a drop-roll needs both feet to land, one after the other or at once, and rolls over its shin") {
  PhaseDetector d(drop_roll_phases());
  CHECK(hold(d, feet(true, true), 5) == 0);
  CHECK(hold(d, feet(false, false), 4) == 1);
  CHECK(hold(d, feet(true, false), 4) == 1);
  CHECK(hold(d, feet(true, true), 1) == 2);
  PhaseSenses s = feet(true, true);
  s.center = 1;
  s.shin = 1.1;
  s.shin_down = true;
  CHECK(hold(d, s, 10) == 2);
  s.center = 1.11;
  s.shin_down = false;
  CHECK(hold(d, s, 10) == 2);
  s.shin_down = true;
  CHECK(hold(d, s, 1) == 3);
  CHECK(hold(d, s, 100) == 3);
  CHECK(d.seconds() == doctest::Approx(100 * dt));
}

TEST_CASE("feet that bounce have not both landed") {
  PhaseDetector d(drop_roll_phases());
  hold(d, feet(false, false), 10);
  REQUIRE(d.phase() == 1);
  hold(d, feet(true, false), 4);
  hold(d, feet(false, false), 4);
  CHECK(hold(d, feet(false, true), 4) == 1);
  CHECK(hold(d, feet(true, true), 1) == 2);
}

TEST_CASE("no phase is shorter than asked") {
  PhaseDetector d(jump_phases(), 0.1);
  hold(d, feet(true, false), 10);
  CHECK(hold(d, feet(false, false), 1) == 1);
  // A foot that drags for a tick after take-off is no landing.
  CHECK(hold(d, feet(true, false), 1) == 1);
  CHECK(hold(d, feet(false, false), 6) == 1);
  CHECK(hold(d, feet(false, true), 1) == 2);
}

TEST_CASE("plans are checked") {
  CHECK_THROWS_WITH(PhaseDetector({}), "phases: expected a phase");
  CHECK_THROWS_WITH(PhaseDetector(jump_phases(), -1), "phases: expected a least time of zero or more");
}
