// SPDX-License-Identifier: MIT
#pragma once

#include "traceur/core/vector3.hpp"

namespace traceur::sim {

/// Where the ground is, seen from a point.
template <class S>
struct GroundSample {
  S distance;                ///< signed distance to the surface, m; negative below it
  core::Vector3<S> normal;  ///< unit gradient of the distance, pointing out of the ground
};

/// What characters stand on: the plane z = 0 unless a terrain is given.
template <class T>
class Ground {
 public:
  /// No contact is possible above this height, m.
  T highest() const { return T(0); }

  template <class S>
  [[gnu::always_inline]] GroundSample<S> sample(const core::Vector3<S>& point) const {
    return {point.z, core::Vector3<S>{S(0.0), S(0.0), S(1.0)}};
  }
};

}  // namespace traceur::sim
