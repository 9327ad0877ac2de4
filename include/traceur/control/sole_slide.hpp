// SPDX-License-Identifier: MIT
#pragma once

#include "traceur/control/roles.hpp"
#include "traceur/sim/lanes.hpp"

namespace traceur::control {

/// How the soles slide while they carry, mean over the last call of `step`. Of the bundled simulator: what other engines do
/// is not in its lanes.
template <class S>
sim::LoadedSlide<S> sole_slide(const sim::Lanes<S>& lanes, const Roles& roles) {
  using T = core::Element<S>;
  sim::LoadedSlide<S> out{S(T(0)), S(T(0))};
  for (const auto& leg : roles.legs) {
    const sim::LoadedSlide<S>& foot = lanes.body_slide()[static_cast<std::size_t>(leg.foot)];
    out.load += foot.load;
    out.sum += foot.sum;
  }
  return out;
}

}  // namespace traceur::control
