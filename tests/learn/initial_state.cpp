// SPDX-License-Identifier: MIT
#include <traceur/learn/initial_state.hpp>

#include <cmath>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace learn_test;
using namespace traceur::learn;
using doctest::Approx;

namespace {

traceur::motion::Clip clip(bool cyclic) {
  traceur::motion::Clip c;
  c.name = "two seconds";
  c.skeleton = creature().skeleton;
  c.times = Eigen::Vector2d(0, 2);
  c.poses = c.skeleton.neutral_pose().replicate(1, 2);
  c.cyclic = cyclic;
  return c;
}

}  // namespace

TEST_CASE("reference times are uniform over the clip, short of the end by what must remain") {
  const auto cyclic = clip(true), once = clip(false);
  double sum = 0, latest = 0, latest_once = 0;
  for (std::uint64_t i = 0; i < 4000; ++i) {
    RandomStream a(1, i), b(1, i);
    const double t = reference_time(cyclic, a, 0.5);
    sum += t;
    latest = std::max(latest, t);
    latest_once = std::max(latest_once, reference_time(once, b, 0.5));
  }
  CHECK(sum / 4000 == Approx(1).epsilon(0.03));
  CHECK(latest > 1.99);
  CHECK(latest < 2);
  CHECK(latest_once > 1.49);
  CHECK(latest_once < 1.5);
  RandomStream random(2);
  CHECK(reference_time(once, random, 5) == 0);
}

TEST_CASE("noise has the deviations asked for, and rotations stay rotations") {
  const Pair pair(1);
  const Skeleton& s = pair.character.skeleton;
  Perturbation p;
  const int n = 4000;
  Eigen::VectorXd square = Eigen::VectorXd::Zero(s.nv()), square_v = square, scratch(s.nv());
  for (int i = 0; i < n; ++i) {
    Eigen::VectorXd q = pair.q, v = pair.v, d(s.nv());
    RandomStream random(3, static_cast<std::uint64_t>(i));
    perturb(s, p, random, q, v, scratch);
    traceur::body::difference(s, pair.q.data(), q.data(), d.data());
    square += d.cwiseAbs2() / n;
    square_v += (v - pair.v).cwiseAbs2() / n;
    if (i == 0) traceur::body::check_pose(s, q, "perturbed");
  }
  for (int i = 0; i < s.nv(); ++i) {
    CHECK(std::sqrt(square[i]) == Approx(i < 3 ? p.root_position : i < 6 ? p.root_rotation : p.joint_rotation).epsilon(0.06));
    CHECK(std::sqrt(square_v[i]) ==
          Approx(i < 3 ? p.root_velocity : i < 6 ? p.root_angular_velocity : p.joint_velocity).epsilon(0.06));
  }
}

TEST_CASE("no noise leaves the reference state") {
  const Pair pair(2);
  const Skeleton& s = pair.character.skeleton;
  Eigen::VectorXd q = pair.q, v = pair.v, scratch(s.nv());
  RandomStream random(3);
  perturb(s, Perturbation::none(), random, q, v, scratch);
  CHECK((q - pair.q).norm() < 1e-14);
  CHECK(v == pair.v);
}
