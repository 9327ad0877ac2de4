// SPDX-License-Identifier: MIT
#pragma once

#include "traceur/control/roles.hpp"
#include "traceur/sim/lanes.hpp"

namespace traceur::control {

/// How soles slide while they carry: over the feet's contact points with the ground, at the start of the last time step.
template <class S>
struct SoleSlide {
  S sum;   ///< of normal force times tangential speed, N m/s
  S load;  ///< sum of normal forces, N
};

/// Reads the bundled simulator's contacts: what other engines do does not show in them.
template <class S>
SoleSlide<S> loaded_sole_slide(const sim::Lanes<S>& lanes, const sim::Model& model, const Roles& roles) {
  using T = core::Element<S>;
  SoleSlide<S> out{S(T(0)), S(T(0))};
  for (const auto& leg : roles.legs) {
    const sim::MovingBody& foot = model.bodies[static_cast<std::size_t>(leg.foot)];
    for (int i = 0; i < foot.contacts; ++i) {
      const sim::ContactMemory<S> m = lanes.contact_memory(static_cast<std::size_t>(foot.first_contact + i));
      out.sum += m.normal_force * m.sliding_speed;
      out.load += m.normal_force;
    }
  }
  return out;
}

}  // namespace traceur::control
