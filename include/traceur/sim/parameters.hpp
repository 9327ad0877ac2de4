// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <string>

#include "traceur/core/error.hpp"

namespace traceur::sim {

/// Constants of the bundled simulator. They are part of what a controller was learned on: keep them with it.
struct Parameters {
  double dt = 1.0 / 480;                ///< time step, s
  double gravity = 9.81;                ///< m/s^2, downwards
  double friction = 1.0;                ///< Coulomb coefficient of every contact
  double contact_stiffness = 1e5;       ///< normal spring of one contact sphere, N/m
  double contact_damping = 1000;        ///< normal damper of one contact sphere, N s/m
  double damping_depth = 0.004;         ///< penetration at which the normal damper has doubled, m
  double spring_depth = 0.02;           ///< penetration beyond which the normal spring grows no more, m
  double bristle_stiffness = 1e6;       ///< tangential spring that holds a sticking contact, N/m
  double bristle_damping = 3000;        ///< tangential damper of a sticking contact, N s/m
  double stop_stiffness = 1500;         ///< joint limit spring, N m/rad
  double stop_damping = 30;             ///< joint limit damper, N m s/rad
  double grip_stiffness = 5e5;          ///< spring of a grip, N/m
  double grip_damping = 2000;           ///< damper of a grip, N s/m
  double self_stiffness = 4e4;          ///< spring between bodies of one character, N/m
  double self_damping = 30;             ///< damper between bodies of one character, N s/m
  double joint_speed_limit = 60;        ///< joint speeds are clamped to this, rad/s
  bool conserve_momentum = true;        ///< whether momenta are held to change by external impulses only

  /// Throws Error naming the field that is out of range.
  void check() const {
    const auto positive = [](double x, const char* name) {
      if (!(x > 0) || !std::isfinite(x)) throw Error(std::string("simulation parameter '") + name + "': expected a positive number");
    };
    const auto at_least_zero = [](double x, const char* name) {
      if (!(x >= 0) || !std::isfinite(x)) throw Error(std::string("simulation parameter '") + name + "': expected zero or more");
    };
    positive(dt, "dt");
    positive(damping_depth, "damping_depth");
    positive(spring_depth, "spring_depth");
    positive(joint_speed_limit, "joint_speed_limit");
    at_least_zero(gravity, "gravity");
    at_least_zero(friction, "friction");
    at_least_zero(contact_stiffness, "contact_stiffness");
    at_least_zero(contact_damping, "contact_damping");
    at_least_zero(bristle_stiffness, "bristle_stiffness");
    at_least_zero(bristle_damping, "bristle_damping");
    at_least_zero(stop_stiffness, "stop_stiffness");
    at_least_zero(stop_damping, "stop_damping");
    at_least_zero(grip_stiffness, "grip_stiffness");
    at_least_zero(grip_damping, "grip_damping");
    at_least_zero(self_stiffness, "self_stiffness");
    at_least_zero(self_damping, "self_damping");
  }
};

}  // namespace traceur::sim
