// SPDX-License-Identifier: MIT
#include <traceur/learn/deepmimic_reward.hpp>

#include <cmath>

#include <doctest/doctest.h>

#include <traceur/core/pack.hpp>

#include "support.hpp"

using namespace learn_test;
using namespace traceur::learn;
using doctest::Approx;
using Parameters = DeepMimicRewardParameters;

namespace {

const std::vector<double> weights{2, 1, 0, 1, 3, 2, 1};
const std::vector<int> ends{3, 5, 6};

/// Only one term left.
DeepMimicReward only(double Parameters::* weight) {
  Parameters p;
  p.pose_weight = p.velocity_weight = p.end_effector_weight = p.root_weight = p.center_weight = 0;
  p.*weight = 1;
  return DeepMimicReward(creature().skeleton, weights, ends, p);
}

}  // namespace

TEST_CASE("perfect tracking earns 1, the sum of the released weights") {
  const Pair pair(1);
  const DeepMimicReward reward(pair.character.skeleton, weights, ends);
  CHECK(reward(pair.reference(), pair.reference()) == Approx(1).epsilon(1e-14));
  const Parameters p;
  CHECK(p.pose_weight == 0.5);
  CHECK(p.velocity_weight == 0.05);
  CHECK(p.end_effector_weight == 0.15);
  CHECK(p.root_weight == 0.2);
  CHECK(p.center_weight == 0.1);
}

TEST_CASE("each term falls as its error grows, and closed forms hold") {
  const Pair pair(2);
  const auto reference = pair.reference();
  for (const auto weight : {&Parameters::pose_weight, &Parameters::end_effector_weight, &Parameters::root_weight})
    CHECK(falls([&](double u) { return only(weight)(pair.off(u, 0), reference); }));
  for (const auto weight : {&Parameters::velocity_weight, &Parameters::root_weight, &Parameters::center_weight})
    CHECK(falls([&](double u) { return only(weight)(pair.off(0, u), reference); }));

  // Weights 2 1 0 1 3 2 1 divided by 10; joints in the order of their names in support.hpp; 7 joints.
  const auto square = [](const Eigen::VectorXd& d, int at, int n) { return d.segment(at, n).squaredNorm(); };
  const auto sum = [&](const Eigen::VectorXd& d) {
    return 0.1 * (2 * square(d, 3, 3) + square(d, 6, 3) + square(d, 9, 3) + 3 * square(d, 12, 1) + 2 * square(d, 13, 1) +
                  square(d, 14, 1));
  };
  const auto state = pair.off(1, 1);
  CHECK(only(&Parameters::pose_weight)(state, reference) == Approx(std::exp(-2.0 / 15 * 7 * sum(pair.dq))));
  CHECK(only(&Parameters::velocity_weight)(state, reference) == Approx(std::exp(-0.1 / 15 * 7 * sum(pair.dv))));
  CHECK(only(&Parameters::root_weight)(state, reference) ==
        Approx(std::exp(-5 * (square(pair.dq, 0, 3) + 0.1 * square(pair.dq, 3, 3) + 0.01 * square(pair.dv, 0, 3) +
                              0.001 * square(pair.dv, 3, 3)))));
  CHECK(only(&Parameters::center_weight)(state, reference) ==
        Approx(std::exp(-squared_norm(state.center_velocity - reference.center_velocity))));
}

TEST_CASE("end effectors are seen from the root in its heading, their height from the ground") {
  const DeepMimicReward reward = only(&Parameters::end_effector_weight);
  Pair pair(3);
  pair.dq.setZero();
  pair.dq[0] = 3;
  pair.dq[1] = -2;
  CHECK(reward(pair.off(1, 0), pair.reference()) == Approx(1));
  // Turned about the vertical by a quarter.
  Eigen::VectorXd turned = pair.q;
  (traceur::core::about_axis(Vector3<double>{0, 0, 1}, 1.57) * Quaternion<double>::from(pair.q.data() + 3))
      .store(turned.data() + 3);
  CHECK(reward(at(pair.character, turned, pair.v), pair.reference()) == Approx(1));
  // Lifted by 0.2 m: 10 * 0.04 unless the ground is lifted as well.
  pair.dq.setZero();
  pair.dq[2] = 0.2;
  CHECK(reward(pair.off(1, 0), pair.reference()) == Approx(std::exp(-0.4)));
  CHECK(reward(pair.off(1, 0), pair.reference(), 0.7, 0.5) == Approx(1));
}

TEST_CASE("lanes of a pack earn what single characters do") {
  using P = traceur::core::Pack<double>;
  const Pair pair(4);
  const DeepMimicReward reward(pair.character.skeleton, weights, ends);
  const auto reference = pair.reference(), state = pair.off(0.4, 0.4);
  const P wide_reward = reward(wide<P>(pair.character, state), wide<P>(pair.character, reference));
  CHECK(wide_reward[1] == Approx(reward(state, reference)).epsilon(1e-8));
}

TEST_CASE("what does not fit the skeleton is refused") {
  const Skeleton s = creature().skeleton;
  CHECK_THROWS_WITH_AS(DeepMimicReward(s, {1, 1}, ends), "deepmimic reward: expected 7 joint weights, got 2", traceur::Error);
  CHECK_THROWS_WITH_AS(DeepMimicReward(s, weights, {7}), "deepmimic reward: end effector 7 is not a body of the skeleton",
                       traceur::Error);
  CHECK_THROWS_AS(DeepMimicReward(s, std::vector<double>(7, 0.0), ends), traceur::Error);
  CHECK_THROWS_AS(DeepMimicReward(s, weights, {}), traceur::Error);
}
