// SPDX-License-Identifier: MIT
#include <traceur/body/skeleton.hpp>

#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace body_test;

TEST_CASE("skeleton: coordinates follow one another without gaps") {
  const Skeleton s = creature().skeleton;
  int q = 0, v = 0;
  for (const Joint& j : s.joints()) {
    CHECK(j.q_index == q);
    CHECK(j.v_index == v);
    q += position_size(j.type);
    v += velocity_size(j.type);
  }
  CHECK(s.nq() == q);
  CHECK(s.nv() == v);
  CHECK(q == 7 + 4 + 4 + 1 + 1 + 1);
  CHECK(v == 6 + 3 + 3 + 1 + 1 + 1);
  CHECK(s.free_root());
  CHECK(s.size() == 7);
  CHECK(s.find("elbow") == 4);
  CHECK(s.find("elbow_body") == -1);
  CHECK(s.find_body("elbow_body") == 4);
  CHECK(s.find("tail") == -1);
  CHECK(!Skeleton().free_root());
}

TEST_CASE("skeleton: the neutral pose is zero angles and identity rotations") {
  const Skeleton s = creature().skeleton;
  const Eigen::VectorXd q = s.neutral_pose();
  CHECK(q.sum() == 3);
  for (const Joint& j : s.joints()) {
    if (j.type == JointType::free) CHECK(q[j.q_index + 6] == 1);
    if (j.type == JointType::ball) CHECK(q[j.q_index + 3] == 1);
  }
}

TEST_CASE("skeleton: a joint that does not fit is refused by name") {
  const auto refused = [](const Joint& bad) {
    Skeleton s = creature().skeleton;
    std::string what;
    try {
      s.add(bad);
    } catch (const traceur::Error& e) {
      what = e.what();
    }
    CHECK_MESSAGE(what.find("'bad'") != std::string::npos, what);
    CHECK(s.size() == 7);
  };
  Joint good;
  good.name = good.body = "bad";
  good.parent = 3;
  CHECK(creature().skeleton.add(good) == 7);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  Joint j = good;
  j.parent = -1;
  refused(j);
  j.parent = 7;
  refused(j);
  j = good;
  j.type = JointType::free;
  refused(j);
  j = good;
  j.body = "head_body";
  refused(j);
  j = good;
  j.offset.y = nan;
  refused(j);
  j = good;
  j.axis = {1, 1, 0};
  refused(j);
  j.axis = {nan, 0, 1};
  refused(j);
  j = good;
  j.rest = {0, 0, 0, 0.9};
  refused(j);
  // The root.
  for (const auto& [type, parent] :
       {std::pair{JointType::hinge, -1}, std::pair{JointType::ball, -1}, std::pair{JointType::free, 0}}) {
    Joint root;
    root.type = type;
    root.parent = parent;
    Skeleton s;
    CHECK_THROWS_AS(s.add(root), traceur::Error);
  }
}
