// SPDX-License-Identifier: MIT
#include <traceur/learn/tracking_reward.hpp>

#include <vector>

#include <doctest/doctest.h>

#include "tracking_support.hpp"

using namespace traceur;
using namespace traceur::learn;
using namespace learn_test;
using doctest::Approx;

TEST_CASE("each reward is its own header's, as a share of its most") {
  const body::Skeleton& skeleton = humanoid().character.skeleton;
  const std::vector<int> ends = end_effectors(humanoid(), roles());
  TrackingState<double> state(humanoid().character), reference(humanoid().character);
  reference.q[0] = 0.1;
  reference.v[7] = 2;
  reference.measure(humanoid().character);
  const std::vector<double> touch{1, 0, 1}, label{1, 1, 0};
  const TrackingEvidence<double> evidence{touch, label, 300.0};

  const TrackingReward deepmimic(skeleton, ends, DeepMimicRewardParameters{});
  const DeepMimicReward plain(skeleton, joint_weights(skeleton, deepmimic_joint_weights), ends);
  CHECK(deepmimic(state, reference, evidence) == Approx(plain(state, reference)).epsilon(1e-12));
  CHECK(deepmimic(state, state, evidence) == Approx(1));
  CHECK_FALSE(deepmimic.reads_contacts());

  const TrackingReward parc(skeleton, ends, ParcRewardParameters{});
  const ParcReward whole(skeleton, joint_weights(skeleton, parc_joint_weights), ends);
  CHECK(parc.most() == 2);
  CHECK(parc(state, reference, evidence) == Approx(0.5 * whole(state, reference, touch, label)).epsilon(1e-12));
  CHECK(parc.reads_contacts());

  const TrackingReward hil(skeleton, ends, HilReward{});
  CHECK(hil.most() == 6);
  CHECK(hil(state, reference, evidence) == Approx(HilReward{}(state, reference, 300.0) / 6).epsilon(1e-12));
  CHECK(hil(state, state, TrackingEvidence<double>{{}, {}, 0.0}) == Approx(1));
  CHECK(hil.reads_power());
}
