// SPDX-License-Identifier: MIT
#include <traceur/learn/reference_motion.hpp>

#include <doctest/doctest.h>

#include "tracking_support.hpp"

using namespace traceur;
using namespace traceur::learn;
using namespace learn_test;

namespace {

ReferenceMotion made(const motion::Clip& clip, double rate = 30) { return make_reference_motion(humanoid(), roles(), clip, rate); }

}  // namespace

TEST_CASE("a reference begins above the origin heading along x, whatever the clip") {
  const ReferenceMotion m = made(wave(false, 1.5, 0.8, 0.4));
  CHECK(m.ticks == 30);
  CHECK_FALSE(m.cyclic);
  CHECK(m.poses.col(0).head(2).norm() < 1e-6f);
  const auto heading = core::heading(core::Quaternion<double>::from(m.poses.col(0).data() + 3));
  CHECK(std::abs(heading.z) < 1e-6);
  CHECK(m.poses(0, 30) > 1.2f);
}

TEST_CASE("velocities carry a reference from tick to tick") {
  const auto& skeleton = humanoid().character.skeleton;
  for (const bool cyclic : {false, true}) {
    const ReferenceMotion m = made(wave(cyclic, 1.5, 0.3, 0.5));
    double worst = 0;
    for (int t = 0; t < m.ticks; ++t) {
      const Eigen::VectorXd a = m.poses.col(t).cast<double>(), b = m.poses.col(t + 1).cast<double>();
      Eigen::VectorXd d(skeleton.nv());
      body::difference(skeleton, a.data(), b.data(), d.data());
      const Eigen::VectorXd mean = 0.5 * (m.velocities.col(t) + m.velocities.col(t + 1)).cast<double>();
      worst = std::max(worst, (d / m.tick - mean).cwiseAbs().maxCoeff());
    }
    // 1.2 rad of swing in a second: the trapezoid of a sine at 30 Hz.
    CHECK(worst < 0.15);
  }
}

TEST_CASE("a cycle is closed, does not turn and is a whole number of ticks") {
  motion::Clip clip = wave(true, 1.2, 0.5, 0.3);
  clip.times *= 1.013;
  const ReferenceMotion m = made(clip);
  CHECK(m.cyclic);
  CHECK(m.ticks == 30);
  CHECK((m.poses.col(30) - m.poses.col(0)).tail(humanoid().nq - 2).cwiseAbs().maxCoeff() < 1e-5f);
  CHECK((m.velocities.col(30) - m.velocities.col(0)).cwiseAbs().maxCoeff() < 0.1f);
  CHECK(std::hypot(m.carry[0], m.carry[1]) == doctest::Approx(1.2).epsilon(0.01));
}

TEST_CASE("a motion that lies on the ground may touch it with its trunk") {
  CHECK_FALSE(made(wave(false)).trunk_touches);
  CHECK(made(wave(false, 0, 0, 0, 0.04)).trunk_touches);
}

TEST_CASE("clips that cannot be tracked are refused") {
  motion::Clip brief = wave(false);
  brief.times *= 0.04;
  CHECK_THROWS_WITH_AS(made(brief), "clip 'wave': expected at least two ticks, found 0.040000 s", Error);
  CHECK_THROWS_WITH_AS(made(wave(false), 0), "clip 'wave': expected a positive rate of ticks", Error);
  motion::Clip other = wave(false);
  other.skeleton = body::Skeleton();
  CHECK_THROWS_AS(made(other), Error);
  motion::Clip broken = wave(false);
  broken.poses(8, 3) = std::numeric_limits<double>::quiet_NaN();
  CHECK_THROWS_AS(made(broken), Error);
}
