// SPDX-License-Identifier: MIT
#include <traceur/learn/target_speed.hpp>

#include <cmath>

#include <doctest/doctest.h>

#include <traceur/learn/hil_reward.hpp>

using namespace traceur;
using namespace traceur::learn;
using doctest::Approx;
using core::Vector3;

TEST_CASE("the reward is that of HIL's heading task, and turning the world changes nothing") {
  const TargetSpeed task;
  const HilHeadingReward hil{0.7, 0.3, 0.25, 2.1};
  for (const double turn : {0.0, 0.7, -2.9}) {
    const double c = std::cos(turn), s = std::sin(turn);
    const auto world = [&](double x, double y) { return Vector3<double>{c * x - s * y, s * x + c * y, 0.1}; };
    const auto facing = terrain::HeadingFrame<double>::at({5, 2, 1}, turn + 0.4);
    CHECK(task.reward<double>(world(1.5, 0.6), facing, 2.1, c, s) == Approx(hil(1.5, std::cos(0.4))).epsilon(1e-12));
  }
  TargetSpeed strict;
  strict.sideways = 1;
  const auto ahead = terrain::HeadingFrame<double>::at({0, 0, 0}, 0);
  CHECK(strict.reward<double>({2, 0, 0}, ahead, 2, 1, 0) == Approx(1));
  CHECK(strict.reward<double>({2, 1, 0}, ahead, 2, 1, 0) == Approx(0.7 * std::exp(-0.25) + 0.3));
}

TEST_CASE("goals are seen from the character") {
  const double heading = 1.1, goal = -0.4;
  const auto frame = terrain::HeadingFrame<double>::at({9, 9, 9}, heading);
  double seen[3];
  FeatureWriter<double, double> to(seen, 0);
  TargetSpeed::observe<double, double>(frame, 2.5, std::cos(goal), std::sin(goal), to);
  CHECK(to.rows() == TargetSpeed::observations);
  CHECK(std::atan2(seen[1], seen[0]) == Approx(goal - heading));
  CHECK(seen[2] == 2.5);
}

TEST_CASE("goals are drawn from their ranges") {
  TargetSpeed task;
  task.slowest = 1.5;
  task.fastest = 2;
  task.turn = 0.3;
  core::RandomStream random(4);
  double low = 9, high = 0, left = 9, right = -9;
  for (int k = 0; k < 500; ++k) {
    const MovingGoal g = task.draw(2.0f, random);
    low = std::min<double>(low, g.speed);
    high = std::max<double>(high, g.speed);
    left = std::min<double>(left, g.heading);
    right = std::max<double>(right, g.heading);
    CHECK(g.left_s >= 2);
    CHECK(g.left_s <= 6);
  }
  CHECK(low > 1.49);
  CHECK(low < 1.52);
  CHECK(high < 2.001);
  CHECK(high > 1.98);
  CHECK(left > 1.69);
  CHECK(right < 2.31);
  CHECK(right - left > 0.55);
}

TEST_CASE("ranges that cannot be are refused") {
  TargetSpeed task;
  task.fastest = 0.5;
  CHECK_THROWS_WITH_AS(task.check(), "target speed: expected 0 <= slowest <= fastest", Error);
  task = {};
  task.least_s = 0;
  CHECK_THROWS_AS(task.check(), Error);
  task = {};
  task.decay = -1;
  CHECK_THROWS_AS(task.check(), Error);
  task = {};
  task.turn = NAN;
  CHECK_THROWS_AS(task.check(), Error);
  CHECK_NOTHROW(TargetSpeed{}.check());
}
