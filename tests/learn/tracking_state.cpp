// SPDX-License-Identifier: MIT
#include <traceur/learn/tracking_state.hpp>

#include <doctest/doctest.h>

#include <traceur/core/pack.hpp>

#include "support.hpp"

using namespace learn_test;

TEST_CASE("a new state stands in the neutral pose at rest") {
  const Character c = creature();
  const TrackingState<double> s(c), same = at(c, c.skeleton.neutral_pose(), Eigen::VectorXd::Zero(c.skeleton.nv()));
  CHECK(s.q == same.q);
  CHECK(norm(s.center_of_mass - same.center_of_mass) == 0);
  CHECK(norm(s.center_velocity) == 0);
}

TEST_CASE("the centre's velocity is how the centre moves") {
  const Pair pair(3);
  const double h = 1e-6;
  const Eigen::VectorXd d = h * pair.v;
  Eigen::VectorXd later = pair.q;
  traceur::body::displace(pair.character.skeleton, pair.q.data(), d.data(), later.data());
  const auto before = pair.reference(), after = at(pair.character, later, pair.v);
  CHECK(norm((1 / h) * (after.center_of_mass - before.center_of_mass) - before.center_velocity) < 1e-4);
}

TEST_CASE("lanes of a pack are states of their own") {
  using P = traceur::core::Pack<double>;
  const Pair pair(4);
  TrackingState<P> s = wide<P>(pair.character, pair.reference());
  const auto other = pair.off(1, 1);
  for (std::size_t i = 0; i < s.q.size(); ++i) s.q[i].set(1, other.q[i]);
  for (std::size_t i = 0; i < s.v.size(); ++i) s.v[i].set(1, other.v[i]);
  s.measure(pair.character);
  CHECK(s.center_of_mass.x[0] == doctest::Approx(pair.reference().center_of_mass.x));
  CHECK(s.center_of_mass.x[1] == doctest::Approx(other.center_of_mass.x));
  CHECK(s.center_velocity.z[1] == doctest::Approx(other.center_velocity.z));
}
