// SPDX-License-Identifier: MIT
#include <traceur/learn/termination.hpp>

#include <limits>

#include <doctest/doctest.h>

#include <traceur/core/pack.hpp>

#include "support.hpp"

using namespace learn_test;
using namespace traceur::learn;

namespace {

constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();

/// The whole character shifted by so many metres.
TrackingState<double> shifted(const Pair& pair, double x, double z = 0) {
  Eigen::VectorXd q = pair.q;
  q[0] += x;
  q[2] += z;
  return at(pair.character, q, pair.v);
}

}  // namespace

TEST_CASE("one joint beyond its limit is enough") {
  const Pair pair(1);
  const Skeleton& s = pair.character.skeleton;
  const auto reference = pair.reference();
  CHECK_FALSE(strayed<double>(shifted(pair, 0.49), reference, hil_limits(s)));
  CHECK(strayed<double>(shifted(pair, 0.51), reference, hil_limits(s)));
  const std::vector<int> feet{5, 6};
  CHECK_FALSE(strayed<double>(shifted(pair, 0.69), reference, parc_limits(s, feet)));
  CHECK(strayed<double>(shifted(pair, 0.71), reference, parc_limits(s, feet)));

  // Only a foot is off, as far as its hinge allows.
  Eigen::VectorXd q = pair.q;
  q[s[5].q_index - 1] += 3;
  const auto kicked = at(pair.character, q, pair.v);
  const double off = norm(kicked.frames.position[5] - reference.frames.position[5]);
  std::vector<double> limit(7, 0.99 * off);
  CHECK(strayed<double>(kicked, reference, limit));
  limit[5] = no_limit;
  CHECK_FALSE(strayed<double>(kicked, reference, limit));
}

TEST_CASE("a place that is not a number is beyond every limit") {
  const Pair pair(2);
  auto lost = pair.reference();
  lost.frames.position[3].y = not_a_number;
  CHECK(strayed<double>(lost, pair.reference(), hil_limits(pair.character.skeleton)));
  lost = pair.reference();
  lost.frames.rotation[0].x = not_a_number;
  CHECK(root_strayed<double>(lost, pair.reference(), RootLimits::lee()));
}

TEST_CASE("the root may not go too far, turn too far, sink or rise") {
  Pair pair(3);
  pair.q[2] = 1;
  const auto reference = pair.reference();
  const auto lee = RootLimits::lee(), parc = RootLimits::parc_code();
  CHECK_FALSE(root_strayed(shifted(pair, 0.59), reference, parc));
  CHECK(root_strayed(shifted(pair, 0.61), reference, parc));
  CHECK_FALSE(root_strayed(shifted(pair, 0.79), reference, lee));
  CHECK(root_strayed(shifted(pair, 0.81), reference, lee));
  pair.q[2] = 0.15;
  CHECK_FALSE(root_strayed(shifted(pair, 0), pair.reference(), lee));
  CHECK(root_strayed(shifted(pair, 0, -0.06), pair.reference(), lee));
  CHECK_FALSE(root_strayed(shifted(pair, 0, -0.06), pair.reference(), parc));
  pair.q[2] = 3.95;
  CHECK(root_strayed(shifted(pair, 0, 0.06), pair.reference(), lee));
  for (const double angle : {1.2, 1.3, 1.35}) {
    Eigen::VectorXd q = pair.q;
    (traceur::core::about_axis(Vector3<double>{0, 0, 1}, angle) * Quaternion<double>::from(q.data() + 3)).store(q.data() + 3);
    CHECK(root_strayed(at(pair.character, q, pair.v), pair.reference(), lee) == (angle > 0.4 * 3.14159265));
    CHECK(root_strayed(at(pair.character, q, pair.v), pair.reference(), parc) == (angle > 1.309));
  }
}

TEST_CASE("lanes of a pack stray one by one") {
  using P = traceur::core::Pack<double>;
  const Pair pair(4);
  auto state = wide<P>(pair.character, pair.reference());
  const auto reference = state;
  state.q[0].set(1, state.q[0][1] + 0.55);
  state.measure(pair.character);
  const auto out = strayed<P>(state, reference, hil_limits(pair.character.skeleton));
  const auto root = root_strayed(state, reference, RootLimits::parc_code());
  for (int lane = 0; lane < P::width; ++lane) {
    CHECK(out[lane] == (lane == 1));
    CHECK_FALSE(root[lane]);
  }
}

TEST_CASE("a fall is a touch by a body that must not") {
  const std::vector<unsigned char> may{0, 0, 1, 1};
  const auto touching = [&](std::vector<unsigned char> touches) { return fell(touches, may); };
  CHECK_FALSE(touching({0, 0, 1, 1}));
  CHECK(touching({0, 1, 1, 1}));
  CHECK_FALSE(touching({0, 0, 0, 0}));
  CHECK(touching({0, 0, 0, 0, 1}));
}

TEST_CASE("targets are missed by 2 m, heads are down below 0.3 m, and nonsense is both") {
  CHECK_FALSE(missed_target(2.4, 0.5));
  CHECK(missed_target(2.6, 0.5));
  CHECK(missed_target(not_a_number, 0.5));
  CHECK_FALSE(head_down(0.31));
  CHECK(head_down(0.29));
  CHECK(head_down(not_a_number));
}
