// SPDX-License-Identifier: MIT
#include <traceur/body/kinematics.hpp>

#include <cmath>
#include <type_traits>
#include <vector>

#include <Eigen/Geometry>
#include <doctest/doctest.h>

#include "../core/support.hpp"
#include "support.hpp"
#include <traceur/body/pose.hpp>

using namespace body_test;

TEST_CASE("kinematics: a planar arm of two hinges is the textbook's") {
  Skeleton s;
  Joint base, shoulder, elbow, tip;
  base.name = base.body = "base";
  base.type = JointType::fixed;
  shoulder.name = shoulder.body = "shoulder";
  shoulder.parent = 0;
  shoulder.type = JointType::hinge;
  elbow.name = elbow.body = "elbow";
  elbow.parent = 1;
  elbow.type = JointType::hinge;
  elbow.offset = {0.7, 0, 0};
  tip.name = tip.body = "tip";
  tip.parent = 2;
  tip.type = JointType::fixed;
  tip.offset = {0.4, 0, 0};
  for (const Joint& j : {base, shoulder, elbow, tip}) s.add(j);
  const double q[2] = {0.6, -1.1}, v[2] = {2.0, 3.0};
  Frames<double> f(s);
  Twists<double> t(s);
  forward_kinematics(s, q, f);
  forward_velocities(s, f, v, t);
  const double a = q[0], b = q[0] + q[1];
  CHECK(norm(f.position[3] - Vector{0.7 * std::cos(a) + 0.4 * std::cos(b), 0.7 * std::sin(a) + 0.4 * std::sin(b), 0}) <
        1e-15);
  CHECK(norm(t.angular[3] - Vector{0, 0, 5}) < 1e-15);
  CHECK(norm(t.linear[3] - Vector{-0.7 * std::sin(a) * 2 - 0.4 * std::sin(b) * 5,
                                  0.7 * std::cos(a) * 2 + 0.4 * std::cos(b) * 5, 0}) < 1e-14);
}

TEST_CASE("kinematics: frames are the product of homogeneous transforms") {
  const Skeleton s = creature().skeleton;
  RandomStream random(8);
  Frames<double> f(s);
  for (int trial = 0; trial < 20; ++trial) {
    const Eigen::VectorXd q = random_pose(s, random);
    forward_kinematics(s, q.data(), f);
    std::vector<Eigen::Isometry3d> world(static_cast<std::size_t>(s.size()));
    for (int i = 0; i < s.size(); ++i) {
      const Joint& j = s[i];
      const auto k = static_cast<std::size_t>(i);
      const double* at = q.data() + j.q_index;
      Eigen::Isometry3d local = Eigen::Isometry3d::Identity();
      local.translate(j.offset.eigen());
      local.rotate(j.rest.eigen());
      if (j.type == JointType::hinge) local.rotate(Eigen::AngleAxisd(at[0], j.axis.eigen()));
      if (j.type == JointType::ball) local.rotate(Eigen::Quaterniond(at[3], at[0], at[1], at[2]));
      if (j.type == JointType::free) {
        local = Eigen::Isometry3d::Identity();
        local.translate(Eigen::Vector3d(at[0], at[1], at[2]));
        local.rotate(Eigen::Quaterniond(at[6], at[3], at[4], at[5]));
      }
      world[k] = j.parent < 0 ? local : world[static_cast<std::size_t>(j.parent)] * local;
      CHECK((f.position[k].eigen() - world[k].translation()).norm() < 1e-13);
      CHECK((f.rotation[k].matrix().eigen() - world[k].rotation()).norm() < 1e-13);
      CHECK((f.point(i, {0.1, 0.2, 0.3}).eigen() - world[k] * Eigen::Vector3d(0.1, 0.2, 0.3)).norm() < 1e-13);
    }
  }
}

TEST_CASE("kinematics: twists are the rates of frames") {
  const Skeleton s = creature().skeleton;
  RandomStream random(9);
  Frames<double> f(s), later(s), earlier(s);
  Twists<double> t(s);
  const double h = 1e-5;
  for (int trial = 0; trial < 20; ++trial) {
    const Eigen::VectorXd q = random_pose(s, random), v = random_tangent(s, random, 3);
    Eigen::VectorXd moved = q;
    forward_kinematics(s, q.data(), f);
    forward_velocities(s, f, v.data(), t);
    const Eigen::VectorXd step = h * v, back = -h * v;
    displace(s, q.data(), step.data(), moved.data());
    forward_kinematics(s, moved.data(), later);
    displace(s, q.data(), back.data(), moved.data());
    forward_kinematics(s, moved.data(), earlier);
    for (std::size_t k = 0; k < t.linear.size(); ++k) {
      CHECK(norm((1 / (2 * h)) * (later.position[k] - earlier.position[k]) - t.linear[k]) < 1e-7);
      CHECK(norm((1 / (2 * h)) * log_map(later.rotation[k] * earlier.rotation[k].conjugate()) - t.angular[k]) < 1e-7);
    }
  }
}

TEST_CASE_TEMPLATE("kinematics: every scalar gives what double gives", S, TRACEUR_TEST_SCALARS) {
  const Skeleton s = creature().skeleton;
  RandomStream random(10);
  const Eigen::VectorXd q = random_pose(s, random), v = random_tangent(s, random, 3);
  Frames<double> f(s);
  Twists<double> t(s);
  forward_kinematics(s, q.data(), f);
  forward_velocities(s, f, v.data(), t);
  using T = traceur::core::Element<S>;
  std::vector<S> sq, sv;
  for (const double x : q) sq.push_back(S(static_cast<T>(x)));
  for (const double x : v) sv.push_back(S(static_cast<T>(x)));
  Frames<S> sf(s);
  Twists<S> st(s);
  forward_kinematics(s, sq.data(), sf);
  forward_velocities(s, sf, sv.data(), st);
  const double tolerance = std::is_same_v<T, float> ? 2e-5 : 1e-12;
  for (std::size_t k = 0; k < f.position.size(); ++k)
    for (int l = 0; l < traceur::core::lane_count<S>; ++l) {
      CHECK(std::abs(law::number(sf.position[k].y, l) - f.position[k].y) < tolerance);
      CHECK(std::abs(law::number(sf.rotation[k].z, l) - f.rotation[k].z) < tolerance);
      CHECK(std::abs(law::number(st.linear[k].x, l) - t.linear[k].x) < tolerance);
      CHECK(std::abs(law::number(st.angular[k].z, l) - t.angular[k].z) < tolerance);
    }
}
