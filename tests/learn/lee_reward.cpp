// SPDX-License-Identifier: MIT
#include <traceur/learn/lee_reward.hpp>

#include <cmath>

#include <doctest/doctest.h>

#include <traceur/core/pack.hpp>

#include "support.hpp"

using namespace learn_test;
using namespace traceur::learn;
using doctest::Approx;

namespace {

const std::vector<int> ends{3, 5, 6};

LeeTrackingReward only(double LeeTrackingReward::* weight) {
  LeeTrackingReward r;
  r.joint_weight = r.end_effector_weight = r.center_weight = r.time_weight = 0;
  r.*weight = 1;
  return r;
}

}  // namespace

TEST_CASE("perfect tracking earns 1, by the paper's weights and by the released code's") {
  const Pair pair(1);
  const Skeleton& s = pair.character.skeleton;
  const auto reference = pair.reference();
  CHECK(LeeTrackingReward{}(s, reference, reference, ends, 0.2, 0.2) == Approx(1).epsilon(1e-14));
  CHECK(LeeTrackingReward::released_code()(s, reference, reference, ends, 0.2, 0.2) == Approx(1).epsilon(1e-14));
}

TEST_CASE("the terms are Eq. 7") {
  const Pair pair(2);
  const Skeleton& s = pair.character.skeleton;
  const auto reference = pair.reference(), state = pair.off(1, 0);
  const auto earned = [&](double LeeTrackingReward::* weight) {
    return only(weight)(s, state, reference, ends, std::log(1.1), std::log(0.95));
  };
  double places = 0;
  for (const int b : ends) {
    const auto k = static_cast<std::size_t>(b);
    places += squared_norm(state.frames.position[k] - reference.frames.position[k]);
  }
  const double center = squared_norm(state.center_of_mass - reference.center_of_mass);
  CHECK(earned(&LeeTrackingReward::joint_weight) ==
        Approx(std::exp(-pair.dq.tail(s.nv() - 6).squaredNorm() / (3.16 * 3.16))));
  CHECK(earned(&LeeTrackingReward::end_effector_weight) == Approx(std::exp(-places / 0.64)));
  CHECK(earned(&LeeTrackingReward::center_weight) == Approx(std::exp(-center / (0.35 * 0.35))));
  CHECK(earned(&LeeTrackingReward::time_weight) == Approx(std::exp(-0.15 * 0.15 / 0.01)));
}

TEST_CASE("each term falls as its error grows") {
  const Pair pair(3);
  const Skeleton& s = pair.character.skeleton;
  const auto reference = pair.reference();
  for (const auto weight :
       {&LeeTrackingReward::joint_weight, &LeeTrackingReward::end_effector_weight, &LeeTrackingReward::center_weight})
    CHECK(falls([&](double u) { return only(weight)(s, pair.off(u, 0), reference, ends, 0.0, 0.0); }));
  CHECK(falls([&](double u) { return only(&LeeTrackingReward::time_weight)(s, reference, reference, ends, -0.2 * u, 0.0); }));
}

TEST_CASE("a task's reward is a Gaussian of its error") {
  CHECK(gaussian_reward(0.0, 0.3) == 1);
  CHECK(gaussian_reward(0.18, 0.3) == Approx(std::exp(-2)));
}

TEST_CASE("weights of tracking and task are the paper's") {
  CHECK(LeeRewardWeights::spike().tracking == 1);
  CHECK(LeeRewardWeights::spike().task == 10);
  CHECK(LeeRewardWeights::continuous().tracking == 0.9);
  CHECK(LeeRewardWeights::continuous().task == 0.1);
  CHECK(LeeRewardWeights::no_task().tracking == 1);
}

TEST_CASE("lanes of a pack earn what single characters do") {
  using P = traceur::core::Pack<double>;
  const Pair pair(4);
  const Skeleton& s = pair.character.skeleton;
  const auto reference = pair.reference(), state = pair.off(0.4, 0);
  CHECK(LeeTrackingReward{}(s, wide<P>(pair.character, state), wide<P>(pair.character, reference), ends, P(0.1), P(0))[1] ==
        Approx(LeeTrackingReward{}(s, state, reference, ends, 0.1, 0.0)).epsilon(1e-8));
}
