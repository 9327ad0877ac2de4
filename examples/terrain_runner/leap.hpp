// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "traceur/control/controller.hpp"
#include "traceur/control/tracking_reference.hpp"

namespace terrain_runner {

/// When a runner's feet are on the ground, in ticks of its gait's period: found by watching it run.
struct GaitEvents {
  int right_take_off = 0;  ///< first tick of the flight after the stance of the right foot
  int left_landing = 0;    ///< first tick of the stance of the left foot after it
};

/// A running leap up a step, authored on top of a runner's own gait: a step on the left foot, take-off from the right one, a
/// longer flight in which the centre of mass flies as gravity has it, landing on the left foot on top. Legs are bent in
/// flight, the more the higher the step.
struct LeapShape {
  double speed = 3.5;         ///< m/s along the ground, all the time
  int flight_ticks = 20;
  double behind_edge = 0.30;  ///< the left ankle lands so far behind the edge, m
  double lead_s = 0.1;        ///< targets are ahead of states by so much, as the gait's are
  double thigh = 0.15, thigh_rise = 0.6;       ///< bending of the leading hip, rad, and per metre of the step
  double knee = 0.2, knee_rise = 0.9;          ///< of its knee
  double trail_knee = 0.2, trail_knee_rise = 0.9;  ///< of the trailing knee
};

/// The parts with offsets of their own: step before, take-off, flight, landing.
inline constexpr int leap_parts = 4;

struct Leap {
  traceur::control::Controller controller;  ///< done once; its frame's origin is the edge on the ground before the step
  std::vector<int> parts;                   ///< of each tick
  int end = 0;                              ///< tick at which a step on the right foot begins on top; another step follows
  double distance = 0;                      ///< from the centre of mass to the edge at its beginning, m
};

/// The leap onto a step of some height (m), from the gait `run` (a cyclic controller that heads for +x).
Leap make_leap(const traceur::sim::Model& model, const traceur::control::Roles& roles, const traceur::control::Controller& run,
               const GaitEvents& events, double height, const LeapShape& shape = {});

/// The leap in the mirror, which begins with a step on the other foot. Laws and offsets are seen from the stance foot, so
/// the same numbers do for both.
traceur::control::Controller mirrored(const traceur::sim::Model& model, const traceur::control::Roles& roles, traceur::control::Controller leap);

}  // namespace terrain_runner
