// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>

#include "traceur/core/vector3.hpp"

namespace traceur::control {

/// What a runner is asked for: theta of Terrain Runner, s4.1.
struct RunningTask {
  double turn = 0;   ///< phi, rad per step, counter-clockwise
  double speed = 0;  ///< v, m/s
};

/// Step frequency that goes with a speed (Terrain Runner, s4.1.3): f / c_f = 0.2 v / c_v + 0.8, from those of the clip. The
/// paper's clip has 4.2 steps/s at 4.4 m/s.
struct StepFrequency {
  double frequency = 4.2;  ///< c_f, steps/s
  double speed = 4.4;      ///< c_v, m/s

  double operator()(double v) const noexcept { return frequency * (0.2 * v / speed + 0.8); }
};

/// Weights of Eq. 8, which the paper does not give.
struct RunningCostWeights {
  double time = 1;        ///< w_t, 1/s of the time not run
  double head = 10;       ///< w_h, 1/m of mean head movement
  double turn = 20;       ///< w_phi, 1/rad
  double speed = 2;       ///< w_v, s/m
  double frequency = 1;   ///< w_f, s/step
};

/// What Eq. 8 is made of, gathered from one run.
struct RunningRecord {
  double seconds = 0;          ///< T_s, until the fall or the end
  double wanted_seconds = 0;   ///< N_d T_c
  double head_movement = 0;    ///< mean over time of the head's distance from its mean place, both from the centre of mass in
                               ///< the facing frame, m
  int cycles = 0;              ///< N_s, whole ones
  double turn_error = 0;       ///< sum over cycles of |phi_i - phi*|, rad per step
  double speed_error = 0;      ///< sum of |v_i - v*|, m/s
  double frequency_error = 0;  ///< sum of |f_i - f*|, steps/s
};

/// Terrain Runner, Eq. 8. A run without one whole cycle has no cycle to judge: only the first term counts, and it is
/// the largest then.
inline double running_cost(const RunningRecord& r, const RunningCostWeights& w = {}) noexcept {
  double cost = w.time * std::fmax(0.0, r.wanted_seconds - r.seconds) + w.head * r.head_movement;
  if (r.cycles > 0)
    cost += (w.turn * r.turn_error + w.speed * r.speed_error + w.frequency * r.frequency_error) / r.cycles;
  return cost;
}

}  // namespace traceur::control
