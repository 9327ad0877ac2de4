// SPDX-License-Identifier: MIT
// A character with every kind of joint, in random poses.
#pragma once

#include <algorithm>
#include <string>

#include <Eigen/Core>

#include <traceur/body/character.hpp>
#include <traceur/core/random.hpp>

namespace body_test {

using namespace traceur::body;
using traceur::core::Quaternion;
using traceur::core::RandomStream;
using Vector = traceur::core::Vector3<double>;

inline Quaternion<double> random_rotation(RandomStream& random) {
  return Quaternion<double>{random.normal(), random.normal(), random.normal(), random.normal()}.normalized();
}
inline Vector random_vector(RandomStream& random, double size) {
  return {random.uniform(-size, size), random.uniform(-size, size), random.uniform(-size, size)};
}

/// A free root, a ball with a turned rest frame, a weld, hinges, two branches.
inline Character creature() {
  Character c;
  c.name = "creature";
  RandomStream random(1);
  const auto add = [&](const char* name, int parent, JointType type) {
    Joint j;
    j.name = name;
    j.body = std::string(name) + "_body";
    j.parent = parent;
    j.type = type;
    j.offset = random_vector(random, 0.5);
    if (parent >= 0) j.rest = random_rotation(random);
    const Vector axis = random_vector(random, 1);
    j.axis = (1 / norm(axis)) * axis;
    Shape s;
    s.name = name;
    s.body = c.skeleton.add(j);
    s.kind = Shape::Kind::box;
    s.size = {0.1 + 0.2 * random.uniform(), 0.1 + 0.2 * random.uniform(), 0.1 + 0.2 * random.uniform()};
    c.inertias.push_back(transformed(solid(s, 500), random_vector(random, 0.2), random_rotation(random)));
    c.actuators.emplace_back();
    c.shapes.push_back(s);
  };
  add("root", -1, JointType::free);
  add("spine", 0, JointType::ball);
  add("plate", 1, JointType::fixed);
  add("head", 2, JointType::ball);
  add("elbow", 2, JointType::hinge);
  add("wrist", 4, JointType::hinge);
  add("leg", 0, JointType::hinge);
  return c;
}

inline Eigen::VectorXd random_pose(const Skeleton& s, RandomStream& random) {
  Eigen::VectorXd q = s.neutral_pose();
  for (const Joint& j : s.joints()) {
    double* at = q.data() + j.q_index;
    if (j.type == JointType::free) {
      random_vector(random, 2).store(at);
      random_rotation(random).store(at + 3);
    }
    if (j.type == JointType::ball) random_rotation(random).store(at);
    if (j.type == JointType::hinge) at[0] = random.uniform(-3.0, 3.0);
  }
  return q;
}

inline Eigen::VectorXd random_tangent(const Skeleton& s, RandomStream& random, double size) {
  Eigen::VectorXd v(s.nv());
  for (Eigen::Index i = 0; i < v.size(); ++i) v[i] = random.uniform(-size, size);
  return v;
}

/// The largest difference between two poses, quaternions of either sign.
inline double apart(const Skeleton& s, const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
  double worst = 0;
  for (const Joint& j : s.joints()) {
    const int n = position_size(j.type);
    if (n == 1 || n == 7)
      worst = std::max(worst, (a.segment(j.q_index, n == 7 ? 3 : 1) - b.segment(j.q_index, n == 7 ? 3 : 1)).norm());
    if (n < 4) continue;
    const auto x = a.segment(j.q_index + n - 4, 4), y = b.segment(j.q_index + n - 4, 4);
    worst = std::max(worst, std::min((x - y).norm(), (x + y).norm()));
  }
  return worst;
}

}  // namespace body_test
