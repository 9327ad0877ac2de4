// SPDX-License-Identifier: MIT
#include <traceur/learn/joint_weights.hpp>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace learn_test;
using namespace traceur::learn;

TEST_CASE("the first entry that is part of a joint's name counts; root and welds need none") {
  const NamedWeight table[] = {{"spine", 1.0}, {"head", 0.5}, {"e", 0.25}, {"wrist", 0.0}};
  CHECK(joint_weights(creature().skeleton, table) == std::vector<double>{0, 1, 0.25, 0.5, 0.25, 0, 0.25});
  const NamedWeight lacking[] = {{"spine", 1.0}, {"head", 0.5}, {"elbow", 0.25}};
  CHECK_THROWS_WITH_AS(joint_weights(creature().skeleton, lacking), "joint weights: expected an entry for joint 'wrist'",
                       traceur::Error);
}

TEST_CASE("the released humanoids' weights are the published ones") {
  Skeleton s;
  for (const char* name : {"root", "abdomen", "neck", "right_shoulder", "right_elbow", "right_wrist", "right_hip",
                           "right_knee", "right_ankle"}) {
    traceur::body::Joint j;
    j.name = j.body = name;
    j.parent = s.size() - 1;
    j.type = s.size() == 0 ? traceur::body::JointType::free : traceur::body::JointType::ball;
    s.add(j);
  }
  CHECK(joint_weights(s, parc_joint_weights) == std::vector<double>{0, 1, 0.6, 0.6, 0.4, 0, 1, 0.6, 0.4});
  CHECK(joint_weights(s, deepmimic_joint_weights) == std::vector<double>{1, 0.5, 0.3, 0.3, 0.2, 0, 0.5, 0.3, 0.2});
}
