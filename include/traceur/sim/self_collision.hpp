// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <vector>

#include "traceur/body/kinematics.hpp"
#include "traceur/sim/contact.hpp"
#include "traceur/sim/model.hpp"

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

/// Pairs of joints, for Extras::self_collisions, whose bodies should not pass through each other: all that are no neighbours
/// in the tree and at least `apart` m from each other in the neutral pose.
inline std::vector<std::array<int, 2>> self_collision_pairs(const Model& model, double apart = 0.005) {
  const body::Skeleton& skeleton = model.character.skeleton;
  const Eigen::VectorXd neutral = skeleton.neutral_pose();
  body::Frames<double> frames(skeleton);
  body::forward_kinematics(skeleton, neutral.data(), frames);
  const auto near = [&](const MovingBody& a, const MovingBody& b) {
    for (int i = a.first_feature; i < a.first_feature + a.features; ++i)
      for (int j = b.first_feature; j < b.first_feature + b.features; ++j) {
        const TouchingFeature &f = model.features[static_cast<std::size_t>(i)], &g = model.features[static_cast<std::size_t>(j)];
        const auto turned = [&](const MovingBody& m, const core::Vector3<double>& v) {
          return frames.point(m.joint, v) - frames.point(m.joint, {0, 0, 0});
        };
        const SegmentPair<double> p = closest_points(frames.point(a.joint, f.center), turned(a, f.half_axis),
                                                     frames.point(b.joint, g.center), turned(b, g.half_axis));
        if (norm(p.on_a - p.on_b) < f.radius + g.radius + apart) return true;
      }
    return false;
  };
  std::vector<std::array<int, 2>> out;
  for (std::size_t a = 0; a < model.bodies.size(); ++a)
    for (std::size_t b = a + 1; b < model.bodies.size(); ++b) {
      const MovingBody &first = model.bodies[a], &second = model.bodies[b];
      if (first.parent == static_cast<int>(b) || second.parent == static_cast<int>(a) || near(first, second)) continue;
      out.push_back({first.joint, second.joint});
    }
  return out;
}

}  // namespace traceur::sim
