// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "traceur/body/skeleton.hpp"

namespace traceur::body {

/// Where every body of a skeleton is: world position of its joint (m) and rotation from body to world.
template <class S>
struct Frames {
  std::vector<core::Vector3<S>> position;
  std::vector<core::Quaternion<S>> rotation;

  Frames() = default;
  explicit Frames(const Skeleton& skeleton)
      : position(static_cast<std::size_t>(skeleton.size())), rotation(static_cast<std::size_t>(skeleton.size())) {}

  /// World place of a point given in the frame of body `i`.
  core::Vector3<S> point(int i, const core::Vector3<S>& local) const {
    const auto k = static_cast<std::size_t>(i);
    return position[k] + rotation[k].rotate(local);
  }
};

/// How fast every body moves: velocity of its joint's origin (m/s) and angular velocity (rad/s), both in world axes.
template <class S>
struct Twists {
  std::vector<core::Vector3<S>> linear;
  std::vector<core::Vector3<S>> angular;

  Twists() = default;
  explicit Twists(const Skeleton& skeleton)
      : linear(static_cast<std::size_t>(skeleton.size())), angular(static_cast<std::size_t>(skeleton.size())) {}
};

/// The rotation a joint's coordinates add to its rest frame.
template <class S>
inline core::Quaternion<S> joint_rotation(const Joint& joint, const S* q) {
  switch (joint.type) {
    case JointType::hinge:
      return core::about_axis(joint.axis.cast<S>(), q[joint.q_index]);
    case JointType::ball:
      return core::Quaternion<S>::from(q + joint.q_index);
    case JointType::free:
      return core::Quaternion<S>::from(q + joint.q_index + 3);
    case JointType::fixed:
      break;
  }
  return core::Quaternion<S>::identity();
}

/// Frames of all bodies at pose q (nq numbers). Any scalar: `double`, `ceres::Jet`, a pack.
template <class S>
inline void forward_kinematics(const Skeleton& skeleton, const S* q, Frames<S>& out) {
  for (int i = 0; i < skeleton.size(); ++i) {
    const Joint& j = skeleton[i];
    const auto k = static_cast<std::size_t>(i);
    const core::Quaternion<S> local = j.rest.cast<S>() * joint_rotation(j, q);
    if (j.parent < 0) {
      out.position[k] = j.type == JointType::free ? core::Vector3<S>::from(q) : j.offset.cast<S>();
      out.rotation[k] = local;
    } else {
      const auto p = static_cast<std::size_t>(j.parent);
      out.position[k] = out.position[p] + out.rotation[p].rotate(j.offset.cast<S>());
      out.rotation[k] = out.rotation[p] * local;
    }
  }
}

/// Twists of all bodies at velocity v (nv numbers), given the frames of the same pose.
template <class S>
inline void forward_velocities(const Skeleton& skeleton, const Frames<S>& frames, const S* v, Twists<S>& out) {
  using core::Vector3;
  for (int i = 0; i < skeleton.size(); ++i) {
    const Joint& j = skeleton[i];
    const auto k = static_cast<std::size_t>(i);
    if (j.parent < 0) {
      out.linear[k] = j.type == JointType::free ? Vector3<S>::from(v) : Vector3<S>::zero();
      out.angular[k] = j.type == JointType::free ? Vector3<S>::from(v + 3) : Vector3<S>::zero();
      continue;
    }
    const auto p = static_cast<std::size_t>(j.parent);
    out.linear[k] = out.linear[p] + cross(out.angular[p], frames.position[k] - frames.position[p]);
    Vector3<S> relative = Vector3<S>::zero();
    if (j.type == JointType::hinge) relative = v[j.v_index] * j.axis.cast<S>();
    if (j.type == JointType::ball) relative = Vector3<S>::from(v + j.v_index);
    out.angular[k] = out.angular[p] + frames.rotation[k].rotate(relative);
  }
}

}  // namespace traceur::body
