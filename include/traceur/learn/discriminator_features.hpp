// SPDX-License-Identifier: MIT
#pragma once

#include <span>
#include <string>
#include <utility>
#include <vector>

#include "traceur/learn/feature_writer.hpp"
#include "traceur/learn/tracking_state.hpp"
#include "traceur/terrain/local_map.hpp"

namespace traceur::learn {

/// What a discriminator sees of one step (HIL, appendix B.2), all in the character's own frame, origin at the root, x where
/// it faces, z up: velocity (m/s) and angular velocity (rad/s) of the root, rotation of every joint (rotation vectors and
/// hinge angles, rad), joint rates (rad/s), places of the end effectors (m), and on request the scene's points nearest to
/// the root (m). Where a character is, and which way it heads, cannot be told from them.
class DiscriminatorFeatures {
 public:
  /// `end_effectors`: bodies, in the paper hands and feet. `points`: of the scene, 60 in the paper. Throws Error on a
  /// skeleton without a free root, a body that does not exist, or a negative number of points.
  explicit DiscriminatorFeatures(const body::Skeleton& skeleton, std::vector<int> end_effectors, int points = 0)
      : skeleton_(skeleton), end_effectors_(std::move(end_effectors)), points_(points) {
    if (!skeleton.free_root()) throw Error("discriminator features: expected a skeleton with a free root");
    for (const int b : end_effectors_)
      if (b < 0 || b >= skeleton.size())
        throw Error("discriminator features: end effector " + std::to_string(b) + " is not a body of the skeleton");
    if (points < 0) throw Error("discriminator features: expected no negative number of points");
  }

  /// How many numbers they are.
  Eigen::Index size() const noexcept {
    return 6 + 2 * (skeleton_.nv() - 6) + 3 * static_cast<Eigen::Index>(end_effectors_.size()) + 3 * points_;
  }
  int points() const noexcept { return points_; }

  /// Writes all but the points; the rows for these are left to the caller.
  template <class S, class T>
  void write(const TrackingState<S>& state, FeatureWriter<S, T>& to) const noexcept {
    const auto frame = terrain::HeadingFrame<S>::of(state.frames.position[0], state.frames.rotation[0]);
    to.put(frame.direction_to_local(core::Vector3<S>::from(state.v.data())));
    to.put(frame.direction_to_local(core::Vector3<S>::from(state.v.data() + 3)));
    to.put_joints(skeleton_, state.q.data());
    for (int i = 6; i < skeleton_.nv(); ++i) to.put(state.v[static_cast<std::size_t>(i)]);
    for (const int b : end_effectors_) to.put(frame.to_local(state.frames.position[static_cast<std::size_t>(b)]));
    to.skip(3 * points_);
  }

 private:
  body::Skeleton skeleton_;
  std::vector<int> end_effectors_;
  int points_;
};

}  // namespace traceur::learn
