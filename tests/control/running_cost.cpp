// SPDX-License-Identifier: MIT
#include <traceur/control/running_cost.hpp>

#include <doctest/doctest.h>

using namespace traceur::control;

TEST_CASE("the paper's step frequencies go with its step lengths") {
  // v / f of Eq. 8's rule against l = 0.2 v + 0.17: they agree to 4 cm over the paper's range.
  const StepFrequency f;
  CHECK(f(4.4) == doctest::Approx(4.2));
  for (const double v : {2.0, 3.0, 4.4, 5.0}) CHECK(std::abs(v / f(v) - (0.2 * v + 0.17)) < 0.045);
}

TEST_CASE("each term of Eq. 8 counts by its weight") {
  RunningRecord r;
  r.seconds = r.wanted_seconds = 16;
  r.cycles = 20;
  const RunningCostWeights w{1, 10, 20, 2, 1};
  CHECK(running_cost(r, w) == 0);
  RunningRecord x = r;
  x.seconds = 11;
  CHECK(running_cost(x, w) == doctest::Approx(5));
  x = r;
  x.head_movement = 0.03;
  CHECK(running_cost(x, w) == doctest::Approx(0.3));
  // Errors are means over cycles.
  x = r;
  x.turn_error = 20 * 0.01;
  x.speed_error = 20 * 0.1;
  x.frequency_error = 20 * 0.2;
  CHECK(running_cost(x, w) == doctest::Approx(0.2 + 0.2 + 0.2));
}

TEST_CASE("falling at once costs the whole time and nothing else") {
  RunningRecord r;
  r.wanted_seconds = 16;
  r.seconds = 0.3;
  CHECK(running_cost(r) == doctest::Approx(15.7));
}
