// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include "traceur/body/skeleton.hpp"
#include "traceur/core/pack.hpp"
#include "traceur/core/rotation.hpp"

namespace traceur::learn {

/// Writes numbers of the lanes of a pack into columns, one column a lane, row after row: observations and features are sums
/// of such writes. A plain scalar has one lane.
template <class S, class T = float>
class FeatureWriter {
 public:
  /// Begins at row 0 of lane 0; the next lane's column begins `stride` numbers later.
  FeatureWriter(T* to, Eigen::Index stride) noexcept : to_(to), stride_(stride) {}

  /// Rows written so far.
  Eigen::Index rows() const noexcept { return row_; }
  /// Leaves rows for the caller to write, lane by lane, and gives where those of lane 0 begin.
  T* skip(Eigen::Index rows) noexcept {
    T* const here = to_ + row_;
    row_ += rows;
    return here;
  }
  Eigen::Index stride() const noexcept { return stride_; }

  void put(const S& x) noexcept {
    for (int lane = 0; lane < core::lane_count<S>; ++lane) to_[lane * stride_ + row_] = static_cast<T>(core::lane_of(x, lane));
    ++row_;
  }
  void put(const core::Vector3<S>& v) noexcept {
    put(v.x);
    put(v.y);
    put(v.z);
  }
  /// The first and the last axis of a rotation: 6 numbers without a jump.
  void put_axes(const core::Quaternion<S>& r) noexcept {
    const core::Matrix3<S> m = r.matrix();
    put(core::Vector3<S>{m.xx, m.yx, m.zx});
    put(core::Vector3<S>{m.xz, m.yz, m.zz});
  }
  /// Joints of a pose without its root: rotation vectors of balls, angles of hinges, nv - 6 numbers in all.
  void put_joints(const body::Skeleton& skeleton, const S* q) noexcept {
    for (int i = 1; i < skeleton.size(); ++i) {
      const body::Joint& j = skeleton[i];
      if (j.type == body::JointType::ball) put(log_map(core::Quaternion<S>::from(q + j.q_index)));
      if (j.type == body::JointType::hinge) put(q[j.q_index]);
    }
  }

 private:
  T* to_;
  Eigen::Index stride_, row_ = 0;
};

}  // namespace traceur::learn
