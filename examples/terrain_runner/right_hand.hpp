// SPDX-License-Identifier: MIT
#pragma once

#include <array>

#include "traceur/control/clearing.hpp"

namespace terrain_runner {

/// The right hand of a manoeuvre that is sampled or linearized, the lanes' only grip.
struct RightHand {
  traceur::sim::Extras extras;
  int body = 0, from = 0, to = 0;  ///< moving body; ticks in which it may hold on

  RightHand(const traceur::sim::Model& model, int first, int last) : from(first), to(last) {
    extras.grips = {traceur::control::find_hands(model)[0]};
    body = model.moving_of_joint[static_cast<std::size_t>(extras.grips[0].joint)];
  }

  template <class S>
  void operator()(traceur::sim::Lanes<S>& lanes, int tick) const noexcept {
    if (tick < from || tick > to) return;
    for (int l = 0; l < traceur::core::lane_count<S>; ++l)
      traceur::control::hold_until_passed(lanes, l, 0, body, {1, 0, 0}, tick < to);
  }
};

/// The same of a manoeuvre that is sampled, feet charged for being too low over the obstacle.
struct ClearingAid : RightHand {
  traceur::control::Hurdle hurdle;
  std::array<int, 2> feet;   ///< moving bodies
  double clearance = 0.08;   ///< of soles over the obstacle, m
  double weight = 1000;      ///< 1/m^2

  ClearingAid(const traceur::sim::Model& model, const traceur::control::Roles& roles, const traceur::control::Hurdle& h, int first, int last)
      : RightHand(model, first, last), hurdle(h), feet{roles.legs[0].foot, roles.legs[1].foot} {}

  template <class S>
  S cost(const traceur::sim::Lanes<S>& lanes, int) const noexcept {
    using T = traceur::core::Element<S>;
    constexpr double ankle_height = 0.05, toes = 0.17, heel = 0.08;
    S sum(T(0));
    if (!(hurdle.top > 0)) return sum;
    for (const int f : feet) {
      const auto& p = lanes.work().bodies[static_cast<std::size_t>(f)].position;
      const S low = traceur::core::max(S(static_cast<T>(hurdle.top + clearance + ankle_height)) - p.z, S(T(0)));
      const auto in_the_way = (p.x > S(static_cast<T>(-toes))) & (p.x < S(static_cast<T>(hurdle.depth + heel)));
      sum += traceur::core::select(in_the_way, S(static_cast<T>(weight)) * low * low, S(T(0)));
    }
    return sum;
  }
};

}  // namespace terrain_runner
