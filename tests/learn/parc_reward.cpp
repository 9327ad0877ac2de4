// SPDX-License-Identifier: MIT
#include <traceur/learn/parc_reward.hpp>

#include <cmath>

#include <doctest/doctest.h>

#include <traceur/core/pack.hpp>

#include "support.hpp"

using namespace learn_test;
using namespace traceur::learn;
using doctest::Approx;
using Parameters = ParcRewardParameters;

namespace {

const std::vector<double> weights{0, 1, 0, 0.6, 0.4, 0, 1};
const std::vector<int> keys{3, 5, 6};

}  // namespace

TEST_CASE("perfect tracking without contacts earns 1") {
  const Pair pair(1);
  const ParcReward reward(pair.character.skeleton, weights, keys);
  CHECK(reward(pair.reference(), pair.reference()) == Approx(1).epsilon(1e-14));
  const Parameters p;
  CHECK(p.pose_weight + p.joint_velocity_weight + p.root_weight + p.root_velocity_weight + p.key_weight == Approx(1));
}

TEST_CASE("the terms are Eq. 16-20 and the whole is Eq. 22") {
  const Pair pair(2);
  const ParcReward reward(pair.character.skeleton, weights, keys);
  const auto reference = pair.reference(), state = pair.off(1, 1);
  const auto square = [](const Eigen::VectorXd& d, int at, int n) { return d.segment(at, n).squaredNorm(); };
  const auto sum = [&](const Eigen::VectorXd& d) {
    return square(d, 6, 3) + 0.6 * square(d, 9, 3) + 0.4 * square(d, 12, 1) + square(d, 14, 1);
  };
  double key = 0;
  for (const int b : keys) {
    const auto k = static_cast<std::size_t>(b);
    key += squared_norm(state.frames.position[k] - reference.frames.position[k]);
  }
  const double terms[] = {std::exp(-0.25 * sum(pair.dq)), std::exp(-0.01 * sum(pair.dv)),
                          std::exp(-5 * (square(pair.dq, 0, 3) + 0.1 * square(pair.dq, 3, 3))),
                          std::exp(-(square(pair.dv, 0, 3) + 0.1 * square(pair.dv, 3, 3))), std::exp(-10 * key)};
  CHECK(reward.pose(state, reference) == Approx(terms[0]));
  CHECK(reward.joint_velocity(state, reference) == Approx(terms[1]));
  CHECK(reward.root(state, reference) == Approx(terms[2]));
  CHECK(reward.root_velocity(state, reference) == Approx(terms[3]));
  CHECK(reward.key(state, reference) == Approx(terms[4]));
  CHECK(reward(state, reference) ==
        Approx(0.5 * terms[0] + 0.1 * terms[1] + 0.15 * terms[2] + 0.1 * terms[3] + 0.15 * terms[4]));
}

TEST_CASE("each term falls as its error grows") {
  const Pair pair(3);
  const ParcReward reward(pair.character.skeleton, weights, keys);
  const auto reference = pair.reference();
  CHECK(falls([&](double u) { return reward.pose(pair.off(u, 0), reference); }));
  CHECK(falls([&](double u) { return reward.joint_velocity(pair.off(0, u), reference); }));
  CHECK(falls([&](double u) { return reward.root(pair.off(u, 0), reference); }));
  CHECK(falls([&](double u) { return reward.root_velocity(pair.off(0, u), reference); }));
  CHECK(falls([&](double u) { return reward.key(pair.off(u, 0), reference); }));
}

TEST_CASE("a wanted contact earns, an unwanted costs, a missed one does neither") {
  const std::vector<double> none{0, 0}, first{1, 0}, both{1, 1};
  const auto contact = [](const std::vector<double>& c, const std::vector<double>& reference) {
    return ParcReward::contact<double>(c, reference);
  };
  CHECK(contact(first, first) == 0.5);
  CHECK(contact(first, none) == -0.5);
  CHECK(contact(none, first) == 0);
  CHECK(contact(both, first) == 0);
  CHECK(contact(both, both) == 1);
  const Pair pair(4);
  const ParcReward reward(pair.character.skeleton, weights, keys);
  CHECK(reward(pair.reference(), pair.reference(), both, both) == Approx(2));
}

TEST_CASE("key bodies may be compared as seen from the roots, as the released code does") {
  Pair pair(5);
  pair.dq.setZero();
  pair.dq[0] = 0.3;
  Parameters p;
  p.key_relative_to_root = true;
  const Skeleton& s = pair.character.skeleton;
  CHECK(ParcReward(s, weights, keys, p).key(pair.off(1, 0), pair.reference()) == Approx(1));
  CHECK(ParcReward(s, weights, keys).key(pair.off(1, 0), pair.reference()) == Approx(std::exp(-10 * 3 * 0.09)));
}

TEST_CASE("lanes of a pack earn what single characters do") {
  using P = traceur::core::Pack<double>;
  const Pair pair(6);
  const ParcReward reward(pair.character.skeleton, weights, keys);
  const auto reference = pair.reference(), state = pair.off(0.4, 0.4);
  CHECK(reward(wide<P>(pair.character, state), wide<P>(pair.character, reference))[1] ==
        Approx(reward(state, reference)).epsilon(1e-8));
}

TEST_CASE("what does not fit the skeleton is refused") {
  const Skeleton s = creature().skeleton;
  CHECK_THROWS_WITH_AS(ParcReward(s, {1}, keys), "parc reward: expected 7 joint weights, got 1", traceur::Error);
  CHECK_THROWS_WITH_AS(ParcReward(s, weights, {-1}), "parc reward: key body -1 is not a body of the skeleton", traceur::Error);
}
