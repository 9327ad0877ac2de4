// SPDX-License-Identifier: MIT
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
  conformance::keeps_torque_norms<Dart>();
}

TEST_CASE("DART takes turned rest frames and a turned, welded root") {
  conformance::takes_turned_frames<Dart>();
}

TEST_CASE("DART lets a capsule lie still across a seam of columns and on two bars") {
  conformance::lets_a_capsule_lie<Dart>();
}

TEST_CASE("DART draws a gap of a grip together") {
  conformance::draws_a_gap_together<Dart>();
}
