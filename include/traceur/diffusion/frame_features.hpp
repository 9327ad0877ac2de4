// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <traceur/body/kinematics.hpp>
#include <traceur/body/skeleton.hpp>
#include <traceur/core/error.hpp>
#include <traceur/core/rotation.hpp>
#include <traceur/terrain/local_map.hpp>

namespace traceur::diffusion {

/// A frame of motion as numbers that a generator learns (Xu et al. 2025, PARC, section 5), for a character of J joints below
/// its root:
///
///     p0 root position (3, m), q0 root rotation (3), q joint rotations (3 J), p joint positions (3 J, m),
///     c contact labels in [0, 1] of all bodies (J + 1)
///
/// in a heading frame of the caller's choice, for a generator that of one frame of its window. Rotations are exponential
/// maps: the root's from its body to the heading frame, a joint's on top of its rest frame; that of a hinge lies along its
/// axis and that of a fixed joint is zero. Positions are those of joints, as forward kinematics gives them.
class FrameFeatures {
public:
  /// Throws Error unless the skeleton has a free root.
  explicit FrameFeatures(body::Skeleton skeleton) : skeleton_(std::move(skeleton)) {
    if (!skeleton_.free_root()) throw Error("frame features: expected a skeleton with a free root");
  }

  const body::Skeleton& skeleton() const noexcept { return skeleton_; }
  int joints() const noexcept { return skeleton_.size() - 1; }
  Eigen::Index size() const noexcept { return contact(skeleton_.size()); }
  static constexpr Eigen::Index root_position() noexcept { return 0; }
  static constexpr Eigen::Index root_rotation() noexcept { return 3; }
  /// Of body `i`; of the root (0), where its own rotation or position stands.
  Eigen::Index rotation(int i) const noexcept { return 3 + 3 * i; }
  Eigen::Index position(int i) const noexcept { return i == 0 ? 0 : 3 + 3 * (joints() + i); }
  Eigen::Index contact(int i) const noexcept { return 6 + 6 * joints() + i; }

  /// The rotation of body `i` that feature v stands for, on top of its rest frame: what v has across a hinge's axis, or at
  /// a fixed joint, does not count.
  template <class S>
  core::Quaternion<S> joint_rotation(int i, const core::Vector3<S>& v) const noexcept {
    const body::Joint& joint = skeleton_[i];
    if (joint.type == body::JointType::fixed) return core::Quaternion<S>::identity();
    if (joint.type == body::JointType::hinge) {
      const core::Vector3<S> axis = joint.axis.template cast<S>();
      return core::about_axis(axis, dot(axis, v));
    }
    return core::exp_map(v);
  }

  /// Places and rotations of all bodies in the heading frame, from the root's position and the rotations of features `x`.
  template <class S>
  void kinematics(const S* x, body::Frames<S>& out) const noexcept {
    out.position[0] = core::Vector3<S>::from(x);
    out.rotation[0] = core::exp_map(core::Vector3<S>::from(x + 3));
    for (int i = 1; i < skeleton_.size(); ++i) {
      const body::Joint& joint = skeleton_[i];
      const auto k = static_cast<std::size_t>(i), p = static_cast<std::size_t>(joint.parent);
      out.position[k] = out.position[p] + out.rotation[p].rotate(joint.offset.template cast<S>());
      out.rotation[k] = out.rotation[p] * joint.rest.template cast<S>() *
                        joint_rotation(i, core::Vector3<S>::from(x + rotation(i)));
    }
  }

  /// Features of pose q (nq numbers) seen from `frame`, with a contact label for each body, or null for none, into `x`
  /// (size() numbers). `scratch` is for as many bodies as the skeleton has.
  template <class S>
  void encode(const double* q, const double* contacts, const terrain::HeadingFrame<double>& frame,
              body::Frames<double>& scratch, S* x) const noexcept {
    body::forward_kinematics(skeleton_, q, scratch);
    const core::Quaternion<double> turn = to_world(frame).conjugate();
    for (int i = 0; i < skeleton_.size(); ++i) {
      const auto k = static_cast<std::size_t>(i);
      const core::Vector3<double> p = frame.to_local(scratch.position[k]);
      const core::Quaternion<double> r = i == 0 ? turn * scratch.rotation[0] : body::joint_rotation(skeleton_[i], q);
      p.template cast<S>().store(x + position(i));
      core::log_map(r).template cast<S>().store(x + rotation(i));
      x[contact(i)] = contacts == nullptr ? S(0) : static_cast<S>(contacts[i]);
    }
    // A hinge may have turned by more than half a round.
    for (int i = 1; i < skeleton_.size(); ++i) {
      const body::Joint& joint = skeleton_[i];
      if (joint.type == body::JointType::hinge) (q[joint.q_index] * joint.axis).template cast<S>().store(x + rotation(i));
    }
  }

  /// The pose that features stand for, by their root position and rotations, and contact labels limited to [0, 1] (null if
  /// they are not wanted).
  template <class S>
  void decode(const S* x, const terrain::HeadingFrame<double>& frame, double* q, double* contacts) const noexcept {
    using Q = core::Quaternion<double>;
    const auto vector = [x](Eigen::Index at) {
      return core::Vector3<double>{static_cast<double>(x[at]), static_cast<double>(x[at + 1]), static_cast<double>(x[at + 2])};
    };
    frame.to_world(vector(0)).store(q);
    const Q root = skeleton_[0].rest.conjugate() * to_world(frame) * core::exp_map(vector(3));
    root.normalized().store(q + 3);
    for (int i = 1; i < skeleton_.size(); ++i) {
      const body::Joint& joint = skeleton_[i];
      if (joint.type == body::JointType::hinge) q[joint.q_index] = dot(joint.axis, vector(rotation(i)));
      if (joint.type == body::JointType::ball) core::exp_map(vector(rotation(i))).store(q + joint.q_index);
    }
    for (int i = 0; contacts != nullptr && i < skeleton_.size(); ++i) {
      contacts[i] = std::clamp(static_cast<double>(x[contact(i)]), 0.0, 1.0);
    }
  }

  /// Makes features something the body can do: joint positions those of forward kinematics, rotations of hinges along their
  /// axes and of fixed joints zero, contact labels within [0, 1]. PARC's published code does so after every step of
  /// denoising.
  template <class S>
  void project(S* x, body::Frames<S>& scratch) const noexcept {
    for (int i = 1; i < skeleton_.size(); ++i) {
      const body::Joint& joint = skeleton_[i];
      S* const v = x + rotation(i);
      if (joint.type == body::JointType::fixed) core::Vector3<S>::zero().store(v);
      if (joint.type == body::JointType::hinge) {
        const core::Vector3<S> axis = joint.axis.template cast<S>();
        (dot(axis, core::Vector3<S>::from(v)) * axis).store(v);
      }
    }
    kinematics(x, scratch);
    for (int i = 0; i < skeleton_.size(); ++i) {
      scratch.position[static_cast<std::size_t>(i)].store(x + position(i));
      x[contact(i)] = std::clamp(x[contact(i)], S(0), S(1));
    }
  }

  /// Features of one heading frame seen from another.
  template <class S>
  void change_frame(const terrain::HeadingFrame<double>& from, const terrain::HeadingFrame<double>& to,
                    S* x) const noexcept {
    const core::Quaternion<double> turn = to_world(to).conjugate() * to_world(from);
    for (int i = 0; i < skeleton_.size(); ++i) {
      const core::Vector3<double> p = core::Vector3<S>::from(x + position(i)).template cast<double>();
      to.to_local(from.to_world(p)).template cast<S>().store(x + position(i));
    }
    const core::Vector3<double> v = core::Vector3<S>::from(x + 3).template cast<double>();
    core::log_map(turn * core::exp_map(v)).template cast<S>().store(x + 3);
  }

private:
  static core::Quaternion<double> to_world(const terrain::HeadingFrame<double>& frame) noexcept {
    // Half the heading's angle, from its sine and cosine.
    return core::about_axis(core::Vector3<double>{0, 0, 1}, std::atan2(frame.sine, frame.cosine));
  }

  body::Skeleton skeleton_;
};

/// The heading frame of a pose's root: its origin at the root, x where the root faces, z up.
inline terrain::HeadingFrame<double> heading_frame(const body::Skeleton& skeleton, const double* q) {
  return terrain::HeadingFrame<double>::of(core::Vector3<double>::from(q),
                                           skeleton[0].rest * core::Quaternion<double>::from(q + 3));
}

/// Shifts and scales features so that a generator sees numbers of about unit size: z = (x - mean) / deviation, the same for
/// every frame of a window.
template <class S>
struct FeatureScale {
  Eigen::Matrix<S, Eigen::Dynamic, 1> mean, deviation;

  /// Leaves `features` numbers as they are.
  static FeatureScale none(Eigen::Index features) {
    FeatureScale scale;
    scale.mean.setZero(features);
    scale.deviation.setOnes(features);
    return scale;
  }

  /// Mean and deviation over all columns of `frames`; deviations below `least` count as that.
  static FeatureScale of(const Eigen::Ref<const Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>>& frames,
                         double least = 0.01) {
    if (frames.cols() < 1) throw Error("feature scale: expected at least one frame");
    FeatureScale scale = none(frames.rows());
    for (Eigen::Index i = 0; i < frames.rows(); ++i) {
      double sum = 0, squares = 0;
      for (Eigen::Index j = 0; j < frames.cols(); ++j) sum += static_cast<double>(frames(i, j));
      const double mean = sum / static_cast<double>(frames.cols());
      for (Eigen::Index j = 0; j < frames.cols(); ++j) {
        const double way = static_cast<double>(frames(i, j)) - mean;
        squares += way * way;
      }
      scale.mean[i] = static_cast<S>(mean);
      scale.deviation[i] = static_cast<S>(std::max(std::sqrt(squares / static_cast<double>(frames.cols())), least));
    }
    return scale;
  }

  Eigen::Index size() const noexcept { return mean.size(); }
  /// Whole frames below each other, in place.
  void apply(S* x, Eigen::Index frames) const noexcept {
    for (Eigen::Index f = 0; f < frames; ++f)
      for (Eigen::Index i = 0; i < size(); ++i, ++x) *x = (*x - mean[i]) / deviation[i];
  }
  void undo(S* x, Eigen::Index frames) const noexcept {
    for (Eigen::Index f = 0; f < frames; ++f)
      for (Eigen::Index i = 0; i < size(); ++i, ++x) *x = *x * deviation[i] + mean[i];
  }
};

}  // namespace traceur::diffusion
