// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include "leap.hpp"

namespace terrain_runner {

/// A running gait at any moment, and its ticks that manoeuvres are built around: a step on the left foot, the one on the right
/// foot after it, its take-off, the left foot's landing, and the next step on the right foot.
struct GaitClock {
  const traceur::sim::Model* model;
  const traceur::control::Controller* run;
  int left_step = 0, right_step = 0, take_off = 0, landing = 0, next_right_step = 0;

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

}  // namespace terrain_runner
