// SPDX-License-Identifier: MIT
#include <traceur/learn/rollout.hpp>

#include <limits>

#include <doctest/doctest.h>

using namespace traceur::learn;

TEST_CASE("the columns of a step are those of its samples") {
  Rollout<float> r(3, 2, 4, 5);
  CHECK(r.samples() == 20);
  for (Eigen::Index t = 0; t < 5; ++t) {
    Columns<float> now = r.at_step(r.observation, t);
    CHECK(now.cols() == 4);
    for (Eigen::Index e = 0; e < 4; ++e) now.col(e).setConstant(static_cast<float>(10 * t + e));
    r.reward.row(t).setLinSpaced(static_cast<float>(10 * t), static_cast<float>(10 * t + 3));
  }
  for (Eigen::Index t = 0; t < 5; ++t)
    for (Eigen::Index e = 0; e < 4; ++e) {
      const Eigen::Index i = r.sample(t, e);
      CHECK(r.observation.col(i) == Eigen::Vector3f::Constant(static_cast<float>(10 * t + e)));
      CHECK(r.reward.data()[i] == static_cast<float>(10 * t + e));
    }
}

TEST_CASE("a step that is not finite is recorded as failed and earns nothing") {
  Rollout<double> r(1, 1, 6, 2);
  StepResult<double> result(6);
  result.reward << 1, std::numeric_limits<double>::quiet_NaN(), 1, 1, 1, 1;
  result.reward_rate[2] = std::numeric_limits<double>::infinity();
  result.duration[3] = 0;
  result.end[4] = End::failed;
  result.end[5] = End::timed_out;
  r.record(1, result);
  CHECK(r.end(1, 0) == End::running);
  CHECK(r.end(1, 5) == End::timed_out);
  for (Eigen::Index e = 1; e < 5; ++e) {
    CHECK(r.end(1, e) == End::failed);
    CHECK(r.reward(1, e) == 0);
    CHECK(r.reward_rate(1, e) == 0);
    CHECK(r.duration(1, e) == 1);
  }
  CHECK(r.trajectories().reward(1, 0) == 1);
}

TEST_CASE("sizes are checked") {
  CHECK_THROWS_WITH_AS(Rollout<float>(3, 1, 0, 5), "rollout: expected at least one environment, got 0", traceur::Error);
}
