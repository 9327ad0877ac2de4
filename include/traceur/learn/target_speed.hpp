// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "traceur/core/random.hpp"
#include "traceur/learn/feature_writer.hpp"
#include "traceur/terrain/local_map.hpp"

namespace traceur::learn {

/// What a character is asked for: to move at a speed along a heading of the world.
struct MovingGoal {
  float speed = 1;      ///< m/s
  float heading = 0;    ///< rad, from world +x about +z
  float left_s = 0;     ///< until another goal takes its place
};

/// The task of moving as asked (Peng et al. 2021, "AMP"; HIL, section 6.2), with goals that change at random.
struct TargetSpeed {
  double slowest = 1, fastest = 4;  ///< m/s
  double turn = 0;                  ///< a new heading is at most this far from the one before, rad
  double least_s = 2, most_s = 6;   ///< how long a goal stands

  double speed_weight = 0.7;
  double facing_weight = 0.3;
  double decay = 0.25;    ///< of the speed's error, s^2/m^2
  double sideways = 0;    ///< how much velocity across the heading counts beside that along it; the papers have 0

  /// Throws Error that names a field out of its range.
  void check() const {
    if (!(slowest >= 0 && fastest >= slowest) || !std::isfinite(fastest)) throw Error("target speed: expected 0 <= slowest <= fastest");
    if (!(least_s > 0 && most_s >= least_s)) throw Error("target speed: expected 0 < least_s <= most_s");
    if (!(turn >= 0) || !std::isfinite(turn)) throw Error("target speed: expected a turn of zero or more");
    for (const double w : {speed_weight, facing_weight, decay, sideways})
      if (!(w >= 0) || !std::isfinite(w)) throw Error("target speed: expected weights of zero or more");
  }

  /// A goal that follows one of heading `from`.
  MovingGoal draw(float from, core::RandomStream& random) const noexcept {
    MovingGoal goal;
    goal.speed = static_cast<float>(random.uniform(slowest, fastest));
    goal.heading = from + static_cast<float>(random.uniform(-turn, turn));
    goal.left_s = static_cast<float>(random.uniform(least_s, most_s));
    return goal;
  }

  /// In [-facing_weight, speed_weight + facing_weight]:
  /// speed_weight exp(-decay ((v* - along)^2 + sideways across^2)) + facing_weight cos(facing, heading).
  /// `velocity`: m/s, world. `speed` and the goal's axis, (`cosine`, `sine`) of its heading, may differ between lanes.
  template <class S>
  S reward(const core::Vector3<S>& velocity, const terrain::HeadingFrame<S>& facing, const S& speed, const S& cosine,
           const S& sine) const {
    using std::exp;
    const S along = cosine * velocity.x + sine * velocity.y, across = cosine * velocity.y - sine * velocity.x;
    const S off = speed - along;
    return S(speed_weight) * exp(S(-decay) * (off * off + S(sideways) * across * across)) +
           S(facing_weight) * (facing.cosine * cosine + facing.sine * sine);
  }

  /// Numbers that `observe` writes.
  static constexpr Eigen::Index observations = 3;

  /// What a policy sees of a goal: its heading's axis in the character's frame, and its speed.
  template <class S, class T>
  static void observe(const terrain::HeadingFrame<S>& frame, const S& speed, const S& cosine, const S& sine, FeatureWriter<S, T>& to) noexcept {
    to.put(frame.cosine * cosine + frame.sine * sine);
    to.put(frame.cosine * sine - frame.sine * cosine);
    to.put(speed);
  }
};

}  // namespace traceur::learn
