// SPDX-License-Identifier: MIT
// Scenes that several tests of the simulator share.
#pragma once

#include <cmath>
#include <cstdint>

#include <Eigen/Core>

#include <traceur/body/momentum.hpp>
#include <traceur/body/pose.hpp>
#include <traceur/core/random.hpp>
#include <traceur/io/mjcf.hpp>
#include <traceur/sim/world.hpp>

#ifndef TRACEUR_TEST_OWN_STEPS
// Compiled once, in support.cpp: a step takes a compiler long.
extern template void traceur::sim::Lanes<double>::step(int) noexcept;
extern template void traceur::sim::Lanes<float>::step(int) noexcept;
extern template void traceur::sim::Lanes<traceur::core::Pack<float>>::step(int) noexcept;
extern template void traceur::sim::Lanes<traceur::core::Pack<float, 4>>::step(int) noexcept;
extern template void traceur::sim::Lanes<traceur::core::Pack<double, 4>>::step(int) noexcept;
#endif

namespace scene {

using traceur::body::Character;
using traceur::body::JointType;
using Vector = traceur::core::Vector3<double>;
using Quaternion = traceur::core::Quaternion<double>;

inline const Character& humanoid() {
  static const Character character = traceur::io::read_mjcf(TRACEUR_SOURCE_DIR "/examples/characters/humanoid.xml");
  return character;
}

inline Quaternion random_rotation(traceur::core::RandomStream& random) {
  return Quaternion{random.normal(), random.normal(), random.normal(), random.normal()}.normalized();
}

/// Root at the origin in any rotation; joints up to `angle` radians from rest along random axes.
inline Eigen::VectorXd random_pose(const Character& c, traceur::core::RandomStream& random, double angle) {
  Eigen::VectorXd q = c.skeleton.neutral_pose();
  for (const auto& j : c.skeleton.joints()) {
    double* at = q.data() + j.q_index;
    if (j.type == JointType::free) random_rotation(random).store(at + 3);
    if (j.type == JointType::hinge) at[0] = random.uniform(-angle, angle);
    if (j.type == JointType::ball) {
      const Vector axis = random_rotation(random).vec();
      exp_map((random.uniform(-angle, angle) / (norm(axis) + 1e-12)) * axis).store(at);
    }
  }
  return q;
}

/// As random_pose with hinges between their stops: what a motion could ask for.
inline Eigen::VectorXd random_target(const Character& c, traceur::core::RandomStream& random, double angle) {
  Eigen::VectorXd q = random_pose(c, random, angle);
  for (int i = 0; i < c.skeleton.size(); ++i) {
    const auto& j = c.skeleton[i];
    const auto& a = c.actuators[static_cast<std::size_t>(i)];
    if (j.type == JointType::hinge && a.limited) q[j.q_index] = random.uniform(a.lower.x, a.upper.x);
  }
  return q;
}

inline Eigen::VectorXd random_velocity(const Character& c, traceur::core::RandomStream& random, double speed) {
  Eigen::VectorXd v(c.skeleton.nv());
  for (Eigen::Index i = 0; i < v.size(); ++i) v[i] = speed * random.uniform(-1.0, 1.0);
  return v;
}

/// The humanoid leaning forward a little from its ankles, which puts its weight over the middle of its feet.
inline Eigen::VectorXd standing_pose() {
  const auto& s = humanoid().skeleton;
  Eigen::VectorXd q = s.neutral_pose();
  const double lean = 0.045;
  q[2] = 0.8835;
  about_axis(Vector{0, 1, 0}, lean).store(q.data() + 3);
  for (const char* ankle : {"right_ankle", "left_ankle"})
    about_axis(Vector{0, 1, 0}, -lean).store(q.data() + s[s.find(ankle)].q_index);
  return q;
}

inline Eigen::VectorXd at_rest() { return Eigen::VectorXd::Zero(humanoid().skeleton.nv()); }

/// One free box of uniform density; half extents in m.
inline Character box(const Vector& half, double mass) {
  Character c;
  c.name = "box";
  traceur::body::Joint root;
  root.name = "root";
  root.body = "box";
  root.type = JointType::free;
  c.skeleton.add(root);
  traceur::body::Shape shape;
  shape.kind = traceur::body::Shape::Kind::box;
  shape.name = "box";
  shape.size = half;
  c.shapes.push_back(shape);
  c.inertias.push_back(solid(shape, mass / (8 * half.x * half.y * half.z)));
  c.actuators.resize(1);
  return c;
}

/// Momenta of a character at (q, v), computed by the body module and not by the simulator.
inline traceur::body::Momentum<double> momentum_of(const Character& c, const Eigen::VectorXd& q,
                                                   const Eigen::VectorXd& v) {
  traceur::body::Frames<double> frames(c.skeleton);
  traceur::body::Twists<double> twists(c.skeleton);
  forward_kinematics(c.skeleton, q.data(), frames);
  forward_velocities(c.skeleton, frames, v.data(), twists);
  return momentum(c, frames, twists);
}

}  // namespace scene
