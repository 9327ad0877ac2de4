// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include <Eigen/Core>

#include "traceur/control/controller.hpp"
#include "traceur/control/tracking_reference.hpp"

namespace terrain_runner {

/// When a runner's feet are on the ground, in ticks of its gait's period: found by watching it run.
struct GaitEvents {
  int right_take_off = 0;  ///< first tick of the flight after the stance of the right foot
  int left_landing = 0;    ///< first tick of the stance of the left foot after it
};

/// A running gait at any moment, and its ticks that manoeuvres are built around: a step on the left foot, the one on the right
/// foot after it, its take-off, the left foot's landing, and the next step on the right foot. How many of its ticks pass in one
/// of time is `rate`: a control's beta runs it faster or slower.
struct GaitClock {
  const traceur::sim::Model* model;
  const traceur::control::Controller* run;
  int left_step = 0, right_step = 0, take_off = 0, landing = 0, next_right_step = 0;
  double rate = 1;

  /// Throws traceur::Error unless the gait has two steps. Both must outlive it.
  GaitClock(const traceur::sim::Model& m, const traceur::control::Controller& c, const GaitEvents& events);

  int ticks() const { return run->ticks(); }
  int of_period(double tick) const;
  double speed() const;  ///< m/s
  /// The pose at any tick, its root where the mean path would have it were its speed zero.
  Eigen::VectorXd pose(double tick) const;
  /// What the motors are given.
  Eigen::VectorXd target(double tick) const;
};

/// Sets a reference's velocities to central differences of its poses, one-sided at both ends, and measures it at `points`.
void differentiate(const traceur::sim::Model& model, const traceur::control::Roles& roles, const std::vector<traceur::control::TrackedPoint>& points,
                   traceur::control::TrackingReference& r);

/// Lifts a measured reference between two ticks so that its centre of mass flies from where it is at the one to where it is at the
/// other as gravity (m/s^2) has it. It is to be differentiated again after.
void fly(traceur::control::TrackingReference& r, int from, int to, double gravity);

}  // namespace terrain_runner
