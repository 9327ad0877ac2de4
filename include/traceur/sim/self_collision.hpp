// SPDX-License-Identifier: MIT
#pragma once

#include "traceur/sim/contact.hpp"

namespace traceur::sim {

/// The points closest to each other on two segments, from their middles `a`, `b` (m) and half axes `u`, `v` (m; may be zero).
template <class S>
struct SegmentPair {
  core::Vector3<S> on_a, on_b;
};

template <class S>
[[gnu::always_inline]] inline SegmentPair<S> closest_points(const core::Vector3<S>& a, const core::Vector3<S>& u,
                                                            const core::Vector3<S>& b, const core::Vector3<S>& v) {
  using core::clamp;
  using core::select;
  const S one(1.0), tiny(static_cast<core::Element<S>>(1e-12));
  const core::Vector3<S> d = a - b;
  const S uu = dot(u, u), vv = dot(v, v), uv = dot(u, v), ud = dot(u, d), vd = dot(v, d);
  const S across = uu * vv - uv * uv;
  // Parallel segments have no single closest pair; any s will do, and the middle one does not jump.
  const S s0 = select(across > S(static_cast<core::Element<S>>(1e-6)) * (uu * vv) + tiny, clamp((uv * vd - vv * ud) / core::max(across, tiny), -one, one), S(0.0));
  const S t = clamp((uv * s0 + vd) / core::max(vv, tiny), -one, one);
  const S s = clamp((uv * t - ud) / core::max(uu, tiny), -one, one);
  return {a + s * u, b + t * v};
}

/// Force on the first of two bodies that overlap by `depth` m along the unit normal from the second to the first, when they
/// approach with `speed` m/s: a spring and a damper that never pulls. It is explicit, and the opposite acts at the same point
/// of the other body, so a character cannot lift itself by its own arms.
template <class S>
[[gnu::always_inline]] inline core::Vector3<S> self_collision_force(const Parameters& p, const S& depth,
                                                                    const core::Vector3<S>& normal, const S& approach) {
  using T = core::Element<S>;
  const S zero(0.0);
  const S push = S(static_cast<T>(p.self_stiffness)) * depth +
                 S(static_cast<T>(p.self_damping)) * approach;
  return core::select(depth > zero, core::max(push, zero), zero) * normal;
}

}  // namespace traceur::sim
