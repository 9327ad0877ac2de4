// SPDX-License-Identifier: MIT
#pragma once

#include "traceur/sim/contact.hpp"

namespace traceur::sim {

/// A place on a character that can hold on: to a point of the world, or to a point of an object.
struct GripPoint {
  int joint = 0;                          ///< joint of the skeleton whose frame carries it
  core::Vector3<double> point{0, 0, 0};   ///< m, in that frame
  int object = -1;                        ///< index of the object it holds on to; -1 for the world
};

/// Numbers in a grip's state: whether it holds (1 or 0), its anchor (m; world, or the object's frame), the force at which it
/// breaks (N).
inline constexpr int grip_numbers = 5;

/// A grip as a spring and damper implicit in velocity: `stretch` leads from the anchor to the place on the character, m.
template <class S>
[[gnu::always_inline]] inline LinearContact<S> linearize_grip(const Parameters& p, const S& held, const core::Vector3<S>& stretch) {
  using T = core::Element<S>;
  const S stiffness(static_cast<T>(p.grip_stiffness)), resistance(static_cast<T>(p.grip_stiffness * p.dt + p.grip_damping));
  return {-((held * stiffness) * stretch), core::Symmetric3<S>::scalar(held * resistance)};
}

}  // namespace traceur::sim
