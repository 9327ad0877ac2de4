// SPDX-License-Identifier: MIT
#include <traceur/learn/tracking_error.hpp>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace learn_test;
using namespace traceur::learn;
using doctest::Approx;

TEST_CASE("joint errors are weighted squares of the displacement's joint part") {
  const Pair pair(1);
  const Skeleton& s = pair.character.skeleton;
  const auto reference = pair.reference(), state = pair.off(1, 1);
  const std::vector<double> weight{9, 1, 2, 3, 4, 5, 6};
  double turned = 0, spun = 0, plain = 0;
  for (int i = 1; i < s.size(); ++i)
    for (int k = 0; k < traceur::body::velocity_size(s[i].type); ++k) {
      const int at = s[i].v_index + k;
      turned += weight[static_cast<std::size_t>(i)] * pair.dq[at] * pair.dq[at];
      spun += weight[static_cast<std::size_t>(i)] * pair.dv[at] * pair.dv[at];
      plain += pair.dq[at] * pair.dq[at];
    }
  CHECK(joint_error(s, state, reference, weight) == Approx(turned).epsilon(1e-10));
  CHECK(joint_velocity_error(s, state, reference, weight) == Approx(spun).epsilon(1e-10));
  CHECK(joint_error(s, state, reference) == Approx(plain).epsilon(1e-10));
}

TEST_CASE("root errors are those of the displacement's root part") {
  const Pair pair(2);
  const RootError<double> error(pair.off(1, 1), pair.reference());
  CHECK(error.position == Approx(pair.dq.head(3).squaredNorm()).epsilon(1e-10));
  CHECK(error.rotation == Approx(pair.dq.segment(3, 3).squaredNorm()).epsilon(1e-10));
  CHECK(error.velocity == Approx(pair.dv.head(3).squaredNorm()).epsilon(1e-10));
  CHECK(error.angular_velocity == Approx(pair.dv.segment(3, 3).squaredNorm()).epsilon(1e-10));
}

TEST_CASE("a shift of everything shows in the world and not as seen from the root") {
  Pair pair(3);
  pair.dq.setZero();
  pair.dq.head(3) << 0.1, 0.2, 0.2;
  const std::vector<int> bodies{3, 5, 6};
  CHECK(place_error<double>(pair.off(1, 0), pair.reference(), bodies) == Approx(3 * 0.09));
  CHECK(relative_place_error<double>(pair.off(1, 0), pair.reference(), bodies) < 1e-20);
}

TEST_CASE("the root of zero has the derivative zero") {
  CHECK(safe_root(0.0) == 0);
  CHECK(safe_root(9.0) == 3);
}
