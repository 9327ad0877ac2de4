// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <vector>

#include "gait_clock.hpp"
#include "kinds.hpp"

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
  int placed = 0;              ///< tick from which on it is all one where on the ground it is done
  int hold_from = 0, hold_to = 0;  ///< ticks in which the right hand may hold on to the obstacle
  double depth = 0;            ///< of the obstacle along the way, m; 0: it has no other side
};

/// When what happens in a manoeuvre on top of running: up to the right foot's take-off and from the left foot's landing on it is
/// running, at whatever pace; in between it is the manoeuvre's own.
struct Passage {
  const GaitClock* gait;
  int step_at = 0;              ///< tick at which the step on the right foot begins that takes off
  int fly_at = 0, land_at = 0;  ///< ticks of take-off and landing
  int stand_at = 0;             ///< tick at which the step on the right foot after it begins, and
  int end = 0;                  ///< when the one begins that is so many steps (an even number) later
  int ticks = 0;                ///< so many more steps after that, in which its end has to stand the test

  Passage(const GaitClock& clock, int middle, int steps_after, int steps_beyond);
  bool running(int tick) const { return tick <= fly_at || tick >= land_at; }
  /// Tick of the gait.
  double clock(int tick) const;
  /// Of the foot that running has on the ground: 0 right, 1 left.
  int stance(int tick) const;
  /// Poses of running at a pace (m/s at any time, ticks), along x from 0; those between are not set.
  Eigen::MatrixXd run(const std::function<double(double)>& pace) const;
  /// Poses as a reference, measured.
  traceur::control::TrackingReference reference(const Eigen::MatrixXd& poses, const traceur::control::Roles& roles) const;
  /// The manoeuvre of a reference whose poses are final, with targets: running's, and in the middle such as lead the reference.
  Authored author(traceur::control::TrackingReference reference, const traceur::control::Roles& roles) const;
};

/// A step up to be leapt onto, off the right foot and onto the left one. Legs are bent in flight, the more the higher the step.
struct JumpShape {
  double speed = 3.5;         ///< m/s along the ground, all the time
  int flight_ticks = 24;
  double behind_edge = 0.30;  ///< the left ankle lands so far behind the edge, m
  double thigh = 0.15, thigh_rise = 0.8;       ///< bending of the leading hip, rad, and per metre of the step
  double knee = 0.2, knee_rise = 1.2;          ///< of its knee
  double trail_knee = 0.3, trail_knee_rise = 1.4;  ///< of the trailing knee
  double sinks = 0.3;         ///< of the height, by which landing is lower than running
  int steps_after = 2;        ///< that belong to it still,
  int steps_beyond = 2;       ///< and that are sampled with it
};

Authored author_jump(const traceur::sim::Model& model, const traceur::control::Roles& roles, const GaitClock& gait, double height,
                     const JumpShape& shape = {});

/// A cliff to run off, of some height: a flight, and a roll from the feet over the back to running.
struct DropShape {
  double speed = 3.5;         ///< m/s, before and after it
  double slowest = 2.2;       ///< m/s, in the roll
  int flight_ticks = 41;
  int roll_ticks = 66;
  int steps_after = 4;        ///< that belong to it still,
  int steps_beyond = 1;       ///< and that are sampled with it
};

Authored author_drop(const traceur::sim::Model& model, const traceur::control::Roles& roles, const GaitClock& gait, double height,
                     const DropShape& shape = {});

/// A box of some height, `depth` m along the way, to be vaulted.
struct VaultShape {
  double depth = 0.4;
  double speed = 3.5;         ///< m/s, before and after it
  double slowest = 3.0;       ///< m/s, over it
  double leans_from = 0.85;   ///< height above which one leans to the side, the more the higher, m
  int flight_ticks = 34;
  int steps_after = 2;        ///< that belong to it still,
  int steps_beyond = 1;       ///< and that are sampled with it
};

Authored author_vault(const traceur::sim::Model& model, const traceur::control::Roles& roles, const GaitClock& gait, double height,
                      const VaultShape& shape = {});

/// The manoeuvre of a kind at an obstacle of some height, m.
inline Authored author(Kind kind, const traceur::sim::Model& model, const traceur::control::Roles& roles, const GaitClock& gait, double height) {
  if (kind == Kind::jump) return author_jump(model, roles, gait, height);
  return kind == Kind::vault ? author_vault(model, roles, gait, height) : author_drop(model, roles, gait, height);
}

}  // namespace terrain_runner
