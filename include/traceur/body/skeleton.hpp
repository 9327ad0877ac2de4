// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "traceur/core/error.hpp"
#include "traceur/core/rotation.hpp"

namespace traceur::body {

/// How a body moves relative to its parent.
enum class JointType {
  fixed,  ///< welded: no coordinates
  hinge,  ///< one angle about `axis`
  ball,   ///< a unit quaternion
  free    ///< root only: a position and a unit quaternion in the world
};

/// Numbers a joint holds in a pose vector q.
constexpr int position_size(JointType type) {
  return type == JointType::free ? 7 : type == JointType::ball ? 4 : type == JointType::hinge ? 1 : 0;
}

/// Numbers a joint holds in a velocity vector v, and in a tangent vector.
constexpr int velocity_size(JointType type) {
  return type == JointType::free ? 6 : type == JointType::ball ? 3 : type == JointType::hinge ? 1 : 0;
}

/// One joint and the body that it moves. The body's frame has its origin at the joint.
struct Joint {
  std::string name;
  std::string body;
  int parent = -1;  ///< index of the parent joint, smaller than this joint's own; -1 for the root
  JointType type = JointType::ball;
  core::Vector3<double> offset{0, 0, 0};                                   ///< joint's place in the parent's frame, m
  core::Quaternion<double> rest = core::Quaternion<double>::identity();  ///< frame at zero coordinates, seen from the parent
  core::Vector3<double> axis{0, 0, 1};                                     ///< hinge axis in the joint's own frame, unit
  int q_index = 0;  ///< first entry in a pose vector; set by Skeleton
  int v_index = 0;  ///< first entry in a velocity vector; set by Skeleton
};

/// A tree of joints, parents before children.
///
/// A pose is one vector q of `nq()` numbers: root position (m, world) and root quaternion (x y z w, body to world), then
/// for every other joint its angle (rad) or its quaternion (joint frame seen from the parent's rest frame). A velocity is
/// one vector v of `nv()` numbers: root linear velocity of the root's origin (m/s, world), root angular velocity (rad/s,
/// world), then hinge rates (rad/s) and ball joints' angular velocities (rad/s, in the joint's own moving frame). Tangent
/// vectors have the layout of velocities.
class Skeleton {
 public:
  /// Appends a joint and returns its index. Throws Error on a parent that does not come before, a second root, a free
  /// joint below the root, an axis or rest rotation that is not unit, a duplicate body name, or a number that is not finite.
  int add(Joint joint) {
    const int index = size();
    const std::string where = "skeleton: joint '" + joint.name + "': ";
    if ((index == 0) != (joint.parent < 0)) throw Error(where + "expected exactly one root, and it first");
    if (joint.parent >= index) throw Error(where + "expected a parent that comes before it");
    if (index > 0 && joint.type == JointType::free) throw Error(where + "a free joint is for the root only");
    if (index == 0 && (joint.type == JointType::hinge || joint.type == JointType::ball))
      throw Error(where + "the root is free or fixed");
    const double finite = joint.offset.x + joint.offset.y + joint.offset.z;
    if (!std::isfinite(finite)) throw Error(where + "offset is not finite");
    if (!(std::abs(norm(joint.axis) - 1.0) < 1e-6)) throw Error(where + "hinge axis is not a unit vector");
    if (!(std::abs(dot(joint.rest, joint.rest) - 1.0) < 1e-6)) throw Error(where + "rest rotation is not a unit quaternion");
    if (find_body(joint.body) >= 0) throw Error(where + "a second body named '" + joint.body + "'");
    joint.q_index = nq_;
    joint.v_index = nv_;
    nq_ += position_size(joint.type);
    nv_ += velocity_size(joint.type);
    joints_.push_back(std::move(joint));
    return index;
  }

  int size() const { return static_cast<int>(joints_.size()); }
  int nq() const { return nq_; }
  int nv() const { return nv_; }
  bool free_root() const { return !joints_.empty() && joints_[0].type == JointType::free; }
  const Joint& operator[](int i) const { return joints_[static_cast<std::size_t>(i)]; }
  std::span<const Joint> joints() const { return joints_; }

  /// Index of the joint of that name, or -1.
  int find(std::string_view joint_name) const {
    for (int i = 0; i < size(); ++i)
      if ((*this)[i].name == joint_name) return i;
    return -1;
  }
  /// Index of the joint that moves the body of that name, or -1.
  int find_body(std::string_view body_name) const {
    for (int i = 0; i < size(); ++i)
      if ((*this)[i].body == body_name) return i;
    return -1;
  }

  /// The pose of zero angles and identity rotations, root at the origin.
  Eigen::VectorXd neutral_pose() const {
    Eigen::VectorXd q = Eigen::VectorXd::Zero(nq_);
    for (const Joint& j : joints_) {
      if (j.type == JointType::free) q[j.q_index + 6] = 1.0;
      if (j.type == JointType::ball) q[j.q_index + 3] = 1.0;
    }
    return q;
  }

 private:
  std::vector<Joint> joints_;
  int nq_ = 0;
  int nv_ = 0;
};

}  // namespace traceur::body
