// SPDX-License-Identifier: MIT
#pragma once

#include "traceur/learn/feature_writer.hpp"
#include "traceur/learn/tracking_state.hpp"
#include "traceur/terrain/local_map.hpp"

namespace traceur::learn {

/// The frame that a character sees the world in: origin at its root, x where the root faces, z up.
template <class S>
terrain::HeadingFrame<S> heading_frame(const TrackingState<S>& state) noexcept {
  return terrain::HeadingFrame<S>::of(state.frames.position[0], state.frames.rotation[0]);
}

/// A rotation as the frame sees it.
template <class S>
core::Quaternion<S> rotation_to_local(const terrain::HeadingFrame<S>& frame, const core::Quaternion<S>& r) noexcept {
  // The frame's half angle from its cosine and sine; the root is bounded away from zero where the frame faces backwards.
  using std::sqrt;
  const S half_cosine = sqrt(core::max(S(0.0), S(0.5) * (S(1.0) + frame.cosine)));
  const S size = sqrt(core::max(S(0.0), S(0.5) * (S(1.0) - frame.cosine)));
  const S half_sine = core::select(frame.sine < S(0.0), S(-size), size);
  return core::Quaternion<S>{S(0.0), S(0.0), -half_sine, half_cosine} * r;
}

/// A character's state from itself, little enough for a small network: height of the root above `ground`, the root's axes,
/// velocity and angular velocity, rotation vectors and rates of the joints, places of the bodies, all in its own frame.
struct CharacterObservation {
  static Eigen::Index size(const body::Skeleton& s) noexcept { return 13 + 2 * (s.nv() - 6) + 3 * (s.size() - 1); }

  template <class S, class T>
  static void write(const body::Skeleton& skeleton, const TrackingState<S>& state, const S& ground, FeatureWriter<S, T>& to) noexcept {
    const auto frame = heading_frame(state);
    to.put(state.frames.position[0].z - ground);
    to.put_axes(rotation_to_local(frame, state.frames.rotation[0]));
    to.put(frame.direction_to_local(state.twists.linear[0]));
    to.put(frame.direction_to_local(state.twists.angular[0]));
    to.put_joints(skeleton, state.q.data());
    for (int i = 6; i < skeleton.nv(); ++i) to.put(state.v[static_cast<std::size_t>(i)]);
    for (std::size_t b = 1; b < state.frames.position.size(); ++b) to.put(frame.to_local(state.frames.position[b]));
  }
};

/// The state of HIL, section 6, and of PARC's tracker: height of the root above `ground`, then of every body its place (the
/// root's left out, which is zero), axes, velocity and angular velocity in the character's own frame.
struct BodyObservation {
  static Eigen::Index size(const body::Skeleton& s) noexcept { return 1 + 15 * s.size() - 3; }

  template <class S, class T>
  static void write(const TrackingState<S>& state, const S& ground, FeatureWriter<S, T>& to) noexcept {
    const auto frame = heading_frame(state);
    to.put(state.frames.position[0].z - ground);
    for (std::size_t b = 1; b < state.frames.position.size(); ++b) to.put(frame.to_local(state.frames.position[b]));
    for (const auto& r : state.frames.rotation) to.put_axes(rotation_to_local(frame, r));
    for (const auto& v : state.twists.linear) to.put(frame.direction_to_local(v));
    for (const auto& w : state.twists.angular) to.put(frame.direction_to_local(w));
  }
};

/// A frame of a reference as a character sees it (PARC, section 6.1): place and axes of its root in the character's own
/// frame, rotation vectors of its joints. `pose` has nq numbers.
struct ReferenceObservation {
  static Eigen::Index size(const body::Skeleton& s) noexcept { return 9 + s.nv() - 6; }

  template <class S, class T>
  static void write(const body::Skeleton& skeleton, const terrain::HeadingFrame<S>& frame, const S* pose, FeatureWriter<S, T>& to) noexcept {
    to.put(frame.to_local(core::Vector3<S>::from(pose)));
    to.put_axes(rotation_to_local(frame, core::Quaternion<S>::from(pose + 3)));
    to.put_joints(skeleton, pose);
  }
};

/// A place to go to (HIL, section 6.1): where it is in the character's own frame, m.
struct TargetObservation {
  static constexpr Eigen::Index size = 3;

  template <class S, class T>
  static void write(const terrain::HeadingFrame<S>& frame, const core::Vector3<S>& target, FeatureWriter<S, T>& to) noexcept {
    to.put(frame.to_local(target));
  }
};

}  // namespace traceur::learn
