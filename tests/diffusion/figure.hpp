// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <numbers>
#include <string>

#include <Eigen/Core>

#include <traceur/body/skeleton.hpp>
#include <traceur/core/random.hpp>
#include <traceur/motion/clip.hpp>

/// A figure with every kind of joint, and motions of it.
namespace figure {

using traceur::body::Joint;
using traceur::body::JointType;
using traceur::body::Skeleton;
using traceur::core::Quaternion;
using traceur::core::Vector3;

inline Joint joint(const std::string& name, int parent, JointType type, Vector3<double> offset) {
  Joint j;
  j.name = j.body = name;
  j.parent = parent;
  j.type = type;
  j.offset = offset;
  j.axis = {0, 1, 0};
  return j;
}

inline Skeleton skeleton() {
  Skeleton s;
  s.add(joint("pelvis", -1, JointType::free, {0, 0, 0}));
  Joint chest = joint("chest", 0, JointType::ball, {0, 0, 0.25});
  chest.rest = traceur::core::about_axis(Vector3<double>{0, 0, 1}, 0.3);
  s.add(chest);
  s.add(joint("hand", 1, JointType::fixed, {0.3, 0.1, 0}));
  s.add(joint("thigh", 0, JointType::ball, {0, 0.1, 0}));
  s.add(joint("shin", 3, JointType::hinge, {0, 0, -0.4}));
  s.add(joint("foot", 4, JointType::ball, {0, 0, -0.4}));
  return s;
}

/// A pose with angles of about `size` rad.
inline Eigen::VectorXd random_pose(const Skeleton& s, std::uint64_t seed, double size = 0.8) {
  traceur::core::RandomStream random(seed);
  Eigen::VectorXd q = s.neutral_pose();
  const auto vector = [&] { return Vector3<double>{size * random.normal(), size * random.normal(), size * random.normal()}; };
  vector().store(q.data());
  for (const Joint& j : s.joints()) {
    if (j.type == JointType::hinge) q[j.q_index] = size * random.normal();
    if (j.type == JointType::ball) traceur::core::exp_map(vector()).store(q.data() + j.q_index);
    if (j.type == JointType::free) traceur::core::exp_map(vector()).store(q.data() + 3);
  }
  return q;
}

/// Walks straight ahead (heading 0.5 rad) at 1.5 m/s for `seconds`, limbs swinging, with contact labels.
inline traceur::motion::Clip walk(double seconds = 2) {
  traceur::motion::Clip clip;
  clip.name = "walk";
  clip.skeleton = skeleton();
  const int keys = static_cast<int>(std::round(60 * seconds)) + 1;
  clip.times = Eigen::VectorXd::LinSpaced(keys, 0, seconds);
  clip.poses.resize(clip.skeleton.nq(), keys);
  clip.contacts.setZero(clip.skeleton.size(), keys);
  for (int k = 0; k < keys; ++k) {
    const double t = clip.times[k], swing = std::sin(2 * std::numbers::pi * t);
    Eigen::VectorXd q = clip.skeleton.neutral_pose();
    q[0] = 1 + 1.5 * t * std::cos(0.5);
    q[1] = -2 + 1.5 * t * std::sin(0.5);
    q[2] = 0.85 + 0.02 * swing;
    const auto turn = [&](Vector3<double> v) { return traceur::core::exp_map(v); };
    turn({0, 0, 0.5}).store(q.data() + 3);
    turn({0.1 * swing, 0, 0.2 * swing}).store(q.data() + clip.skeleton[1].q_index);
    turn({0, 0.6 * swing, 0}).store(q.data() + clip.skeleton[3].q_index);
    q[clip.skeleton[4].q_index] = 0.4 + 0.4 * swing;
    turn({0, -0.3 * swing, 0}).store(q.data() + clip.skeleton[5].q_index);
    clip.poses.col(k) = q;
    clip.contacts(5, k) = swing > 0 ? 1 : 0;
  }
  return clip;
}

}  // namespace figure
