// SPDX-License-Identifier: MIT
#include <traceur/learn/pendulum.hpp>

#include <cmath>
#include <numbers>

#include <doctest/doctest.h>

using namespace traceur::learn;
using doctest::Approx;
using traceur::core::RandomStream;

namespace {

constexpr double pi = std::numbers::pi;

/// Gym's Pendulum-v1, one at a time, as its documentation writes it.
struct Plain {
  double angle, speed;
  double step(double action) {
    const double torque = 2 * std::min(1.0, std::max(-1.0, action));
    const double wrapped = std::remainder(angle, 2 * pi);
    const double cost = wrapped * wrapped + 0.1 * speed * speed + 0.001 * torque * torque;
    speed += (3 * 10.0 / 2 * std::sin(angle) + 3 * torque) * 0.05;
    speed = std::min(8.0, std::max(-8.0, speed));
    angle += 0.05 * speed;
    return -cost;
  }
};

}  // namespace

TEST_CASE("each environment of a batch follows the plain equations") {
  for (const Eigen::Index environments : {1, 5, 16, 37}) {
    Pendulum<double> batch(environments);
    std::vector<Plain> plain;
    for (Eigen::Index e = 0; e < environments; ++e) {
      plain.push_back({0.3 * static_cast<double>(e) - 2, 0.1 * static_cast<double>(e)});
      batch.place(e, plain.back().angle, plain.back().speed);
    }
    RandomStream random(3);
    StepResult<double> result(environments);
    Eigen::MatrixXd action(1, environments), seen(3, environments);
    for (int t = 0; t < 150; ++t) {
      for (Eigen::Index e = 0; e < environments; ++e) action(e) = random.normal();
      result.clear();
      batch.step(action, result);
      batch.observe(seen);
      for (Eigen::Index e = 0; e < environments; ++e) {
        Plain& p = plain[static_cast<std::size_t>(e)];
        // Chaos lets rounding grow; it starts at 1e-14.
        CHECK(result.reward[e] == Approx(p.step(action(e))).epsilon(1e-6));
        CHECK(std::abs(seen(0, e) - std::cos(p.angle)) < 1e-6);
        CHECK(std::abs(seen(1, e) - std::sin(p.angle)) < 1e-6);
        CHECK(std::abs(seen(2, e) - p.speed) < 1e-6);
      }
    }
  }
}

TEST_CASE("hanging still earns the worst pose's reward, standing still none") {
  Pendulum<float> batch(2);
  batch.place(0, 0, 0);
  batch.place(1, 3 * pi, 0);
  StepResult<float> result(2);
  const Eigen::MatrixXf action = Eigen::MatrixXf::Zero(1, 2);
  batch.step(action, result);
  CHECK(result.reward[0] == 0);
  CHECK(result.reward[1] == Approx(-pi * pi).epsilon(1e-5));
}

TEST_CASE("episodes time out after 200 steps and never end otherwise") {
  Pendulum<float> batch(3);
  StepResult<float> result(3);
  const Eigen::MatrixXf action = Eigen::MatrixXf::Constant(1, 3, 0.5f);
  for (int t = 1; t <= 200; ++t) {
    if (t == 150) batch.restart(1);
    result.clear();
    batch.step(action, result);
    CHECK(result.end[0] == (t == 200 ? End::timed_out : End::running));
    CHECK(result.end[1] == End::running);
  }
}

TEST_CASE("starts depend on seed, environment and episode, not on how many environments there are") {
  Pendulum<float> few(2), many(40);
  few.reset(7);
  many.reset(7);
  for (int episode = 0; episode < 3; ++episode) {
    CHECK(few.angle(1) == many.angle(1));
    CHECK(few.speed(1) == many.speed(1));
    CHECK(few.angle(0) != few.angle(1));
    const float before = few.angle(1);
    few.restart(1);
    many.restart(1);
    CHECK(few.angle(1) != before);
  }
  few.reset(8);
  many.reset(7);
  CHECK(few.angle(0) != many.angle(0));
  float low = 10, high = -10, fastest = 0;
  Pendulum<float> crowd(2000);
  for (Eigen::Index e = 0; e < 2000; ++e) {
    low = std::min(low, crowd.angle(e));
    high = std::max(high, crowd.angle(e));
    fastest = std::max(fastest, std::abs(crowd.speed(e)));
  }
  CHECK(low < -3.1f);
  CHECK(high > 3.1f);
  CHECK(fastest <= 1.0f);
  CHECK(fastest > 0.99f);
}

TEST_CASE("senseless sizes and constants are refused") {
  CHECK_THROWS_WITH_AS(Pendulum<float>(0), "pendulum: expected at least one environment, got 0", traceur::Error);
  PendulumParameters p;
  p.mass = 0;
  CHECK_THROWS_WITH_AS(Pendulum<float>(1, p), "pendulum: expected positive constants", traceur::Error);
}
