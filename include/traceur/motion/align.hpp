// SPDX-License-Identifier: MIT
#pragma once

#include "traceur/motion/clip.hpp"

namespace traceur::motion {

/// A rigid motion along the ground: turn about the vertical through the origin, then shift. p -> turn p + shift.
struct GroundTransform {
  core::Quaternion<double> turn = core::Quaternion<double>::identity();  ///< about +z
  core::Vector3<double> shift{0, 0, 0};                                  ///< m

  core::Vector3<double> apply(const core::Vector3<double>& p) const { return turn.rotate(p) + shift; }
  core::Quaternion<double> apply(const core::Quaternion<double>& r) const { return turn * r; }
  /// Moves the root of a pose that has a free root.
  void apply_root(Eigen::Ref<Eigen::VectorXd> q) const {
    apply(core::Vector3<double>::from(q.data())).store(q.data());
    apply(core::Quaternion<double>::from(q.data() + 3)).store(q.data() + 3);
  }
  /// Turns the root's velocities, which are in world axes.
  void apply_root_velocity(Eigen::Ref<Eigen::VectorXd> v) const {
    turn.rotate(core::Vector3<double>::from(v.data())).store(v.data());
    turn.rotate(core::Vector3<double>::from(v.data() + 3)).store(v.data() + 3);
  }
  GroundTransform inverse() const { return {turn.conjugate(), turn.conjugate().rotate(-shift)}; }
  /// Applies b first.
  friend GroundTransform operator*(const GroundTransform& a, const GroundTransform& b) {
    return {a.turn * b.turn, a.apply(b.shift)};
  }
};

/// A turn about the vertical by the angle at which `forward`, fixed in the root's frame, points in the horizontal plane.
inline core::Quaternion<double> facing(const core::Quaternion<double>& root, const core::Vector3<double>& forward) {
  const core::Vector3<double> d = root.rotate(forward);
  if (d.x * d.x + d.y * d.y < 1e-12) return core::Quaternion<double>::identity();
  return core::about_axis(core::Vector3<double>{0, 0, 1}, std::atan2(d.y, d.x));
}

/// The ground frame below a pose's root, as the transform from it to the world: origin at the root's horizontal place, x
/// along the root's facing. `forward` is the facing direction in the root's frame.
inline GroundTransform ground_frame(const Eigen::Ref<const Eigen::VectorXd>& q,
                                    const core::Vector3<double>& forward = {1, 0, 0}) {
  return {facing(core::Quaternion<double>::from(q.data() + 3), forward), {q[0], q[1], 0}};
}

/// The clip moved as a whole. Throws Error if its root is not free.
inline Clip moved(const Clip& clip, const GroundTransform& transform) {
  detail::require_free_root(clip);
  Clip out = clip;
  for (int k = 0; k < out.keys(); ++k) transform.apply_root(out.poses.col(k));
  return out;
}

/// A moved clip and what moved it: clip point to aligned point.
struct Aligned {
  Clip clip;
  GroundTransform transform;
};

/// The clip moved along the ground so that at reference time phi its root is above the origin and faces +x; heights stay.
/// `forward` is the facing direction in the root's frame. Throws Error if the root is not free.
inline Aligned align(const Clip& clip, double phi = 0, const core::Vector3<double>& forward = {1, 0, 0}) {
  detail::require_free_root(clip);
  const GroundTransform transform = ground_frame(clip.sample(phi), forward).inverse();
  return {moved(clip, transform), transform};
}

/// The clip moved along the ground so that at reference time phi its root is where that of pose `q` is, and faces the same
/// way. Throws Error if the root is not free or `q` is not a pose of the skeleton.
inline Aligned align_to(const Clip& clip, double phi, const Eigen::Ref<const Eigen::VectorXd>& q,
                        const core::Vector3<double>& forward = {1, 0, 0}) {
  detail::require_free_root(clip);
  body::check_pose(clip.skeleton, q, detail::where(clip) + ": align_to");
  const GroundTransform transform = ground_frame(q, forward) * ground_frame(clip.sample(phi), forward).inverse();
  return {moved(clip, transform), transform};
}

}  // namespace traceur::motion
