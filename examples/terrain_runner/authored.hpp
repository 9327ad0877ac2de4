// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "gait_clock.hpp"

namespace terrain_runner {

/// A manoeuvre as it is meant to be, before any of it was simulated. It begins with a running step on the left foot and takes
/// off from the right one; running goes on after it. Its frame's origin is where the obstacle begins, on the ground before it.
struct Authored {
  traceur::control::TrackingReference reference;
  Eigen::MatrixXd targets;     ///< nq x ticks, what the motors would be given if all were physical
  std::vector<int> stance;     ///< of each tick: 0 right, 1 left
  std::vector<int> phase;      ///< of each tick: the law
  std::vector<int> parts;      ///< of each tick: the offset
  int end = 0;                 ///< tick at which the manoeuvre gives way to running, which begins with a step on the right foot
  int regulated = 0;           ///< ticks from the begin on that a regulator should keep to what is simulated of it
  int hold_from = 0, hold_to = 0;  ///< ticks in which the right hand may hold on to the obstacle
  double depth = 0;            ///< of the obstacle along the way, m; 0: it has no other side
};

/// A box of some height, `depth` m along the way, to be vaulted.
struct VaultShape {
  double depth = 0.4;
  double speed = 3.5;         ///< m/s, before and after it
  double slowest = 3.0;       ///< m/s, over it
  int flight_ticks = 34;
};

Authored author_vault(const traceur::sim::Model& model, const traceur::control::Roles& roles, const GaitClock& gait, double height,
                      const VaultShape& shape = {});

}  // namespace terrain_runner
