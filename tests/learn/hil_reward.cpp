// SPDX-License-Identifier: MIT
#include <traceur/learn/hil_reward.hpp>

#include <cmath>

#include <doctest/doctest.h>

#include <traceur/core/pack.hpp>

#include "support.hpp"

using namespace learn_test;
using namespace traceur::learn;
using doctest::Approx;

namespace {

HilReward only(double HilReward::* weight) {
  HilReward r;
  r.position_weight = r.rotation_weight = r.velocity_weight = r.angular_velocity_weight = r.height_weight = 0;
  r.*weight = 1;
  return r;
}

}  // namespace

TEST_CASE("perfect tracking earns the sum of the weights; power is a penalty") {
  const Pair pair(1);
  const HilReward reward;
  CHECK(reward(pair.reference(), pair.reference(), 0.0) == Approx(6).epsilon(1e-14));
  CHECK(reward(pair.reference(), pair.reference(), 400.0) == Approx(5.6).epsilon(1e-14));
}

TEST_CASE("exponents are norms, not squared norms") {
  Pair pair(2);
  pair.dq.setZero();
  pair.dv.setZero();
  pair.dq.head(3) << 0.2, 0.1, 0.2;
  pair.dv.head(3) << 2, 1, 2;
  const auto reference = pair.reference(), state = pair.off(1, 1);
  const double bodies = std::sqrt(7.0);
  CHECK(only(&HilReward::position_weight)(state, reference, 0.0) == Approx(std::exp(-1.5 * bodies * 0.3)));
  CHECK(only(&HilReward::height_weight)(state, reference, 0.0) == Approx(std::exp(-20 * 0.2)));
  CHECK(only(&HilReward::velocity_weight)(state, reference, 0.0) == Approx(std::exp(-0.12 * bodies * 3)));
  CHECK(only(&HilReward::rotation_weight)(state, reference, 0.0) == Approx(1));
  pair.dq.setZero();
  pair.dv.setZero();
  pair.dq.segment(3, 3) << 0.2, 0.1, 0.2;
  pair.dv.segment(3, 3) << 2, 1, 2;
  CHECK(only(&HilReward::rotation_weight)(pair.off(1, 0), reference, 0.0) == Approx(std::exp(-0.3 * bodies * 0.3)));
  CHECK(only(&HilReward::angular_velocity_weight)(pair.off(0, 1), reference, 0.0) == Approx(std::exp(-0.05 * bodies * 3)));
}

TEST_CASE("each term falls as its error grows") {
  const Pair pair(3);
  const auto reference = pair.reference();
  for (const auto weight : {&HilReward::position_weight, &HilReward::rotation_weight, &HilReward::height_weight})
    CHECK(falls([&](double u) { return only(weight)(pair.off(u, 0), reference, 0.0); }));
  for (const auto weight : {&HilReward::velocity_weight, &HilReward::angular_velocity_weight})
    CHECK(falls([&](double u) { return only(weight)(pair.off(0, u), reference, 0.0); }));
}

TEST_CASE("power is counted without sign and without the root") {
  const Skeleton s = creature().skeleton;
  Eigen::VectorXd torque = Eigen::VectorXd::Constant(s.nv(), -2), v = Eigen::VectorXd::Constant(s.nv(), 3);
  v[8] = -1;
  CHECK(absolute_power(s, torque.data(), v.data()) == 6 * (s.nv() - 7) + 2);
}

TEST_CASE("lanes of a pack earn what single characters do") {
  using P = traceur::core::Pack<double>;
  const Pair pair(6);
  const auto reference = pair.reference(), state = pair.off(0.4, 0.4);
  CHECK(HilReward{}(wide<P>(pair.character, state), wide<P>(pair.character, reference), P(10.0))[1] ==
        Approx(HilReward{}(state, reference, 10.0)).epsilon(1e-8));
}

TEST_CASE("progress is cut to 5 cm a step and going back costs nothing") {
  const HilTargetReward reward;
  CHECK(reward(3.0, 2.97, false) == Approx(0.6));
  CHECK(reward(3.0, 2.0, false) == Approx(1));
  CHECK(reward(3.0, 3.5, false) == 0);
  CHECK(reward(0.3, 0.25, true) == Approx(2));
}

TEST_CASE("walking at the wanted speed, facing the wanted way, earns 1") {
  const HilHeadingReward reward;
  CHECK(reward(1.2, 1) == 1);
  CHECK(reward(0.2, 1) == Approx(0.7 * std::exp(-0.25) + 0.3));
  CHECK(reward(1.2, -1) == Approx(0.4));
}
