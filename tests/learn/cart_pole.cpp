// SPDX-License-Identifier: MIT
#include <traceur/learn/cart_pole.hpp>

#include <cmath>

#include <doctest/doctest.h>

using namespace traceur::learn;
using doctest::Approx;
using traceur::core::RandomStream;

namespace {

/// Forces that the equations of motion of cart and pole leave over: the derivation from Newton's laws, not the solved form.
void check_newton(double before[4], double after[4], double force) {
  const double dt = 0.02, g = 9.8, cart = 1, pole = 0.1, half = 0.5;
  const double acceleration = (after[1] - before[1]) / dt, turning = (after[3] - before[3]) / dt;
  const double s = std::sin(before[2]), c = std::cos(before[2]), rate = before[3];
  // Horizontal momentum of both; angular momentum of a uniform rod about the hinge, which accelerates.
  CHECK((cart + pole) * acceleration + pole * half * (turning * c - rate * rate * s) == Approx(force).epsilon(1e-9));
  CHECK(4.0 / 3 * half * turning + acceleration * c == Approx(g * s).epsilon(1e-9));
  CHECK(after[0] == Approx(before[0] + dt * before[1]).epsilon(1e-12));
  CHECK(after[2] == Approx(before[2] + dt * before[3]).epsilon(1e-12));
}

}  // namespace

TEST_CASE("each environment of a batch obeys Newton's laws") {
  const Eigen::Index environments = 21;
  CartPole<double> batch(environments);
  RandomStream random(2);
  StepResult<double> result(environments);
  Eigen::MatrixXd action(1, environments), before(4, environments), after(4, environments);
  for (Eigen::Index e = 0; e < environments; ++e)
    batch.place(e, random.uniform(-1.0, 1.0), random.normal(), random.uniform(-3.0, 3.0), random.normal());
  for (int t = 0; t < 10; ++t) {
    for (Eigen::Index e = 0; e < environments; ++e) action(e) = random.uniform(-2.0, 2.0);
    batch.observe(before);
    batch.step(action, result);
    batch.observe(after);
    for (Eigen::Index e = 0; e < environments; ++e)
      check_newton(before.col(e).data(), after.col(e).data(), 10 * std::min(1.0, std::max(-1.0, action(e))));
  }
}

TEST_CASE("a pole past 12 degrees or a cart off the track ends an episode, 500 steps time it out") {
  CartPole<float> batch(4);
  StepResult<float> result(4);
  Eigen::MatrixXf action = Eigen::MatrixXf::Zero(1, 4);
  batch.place(0, 0, 0, 0.2094, 0.1);
  batch.place(1, 2.39, 1, 0, 0);
  batch.place(2, -2.39, -1, 0, 0);
  batch.place(3, 0, 0, 0, 0);
  batch.step(action, result);
  for (Eigen::Index e = 0; e < 3; ++e) CHECK(result.end[e] == End::terminated);
  CHECK(result.reward[0] == 1);
  for (int t = 2; t <= 500; ++t) {
    CHECK(result.end[3] == End::running);
    result.clear();
    batch.step(action, result);
  }
  CHECK(result.end[3] == End::timed_out);
}

TEST_CASE("starts depend on seed, environment and episode, not on how many environments there are") {
  CartPole<float> few(2), many(40);
  few.reset(7);
  many.reset(7);
  Eigen::MatrixXf a(4, 2), b(4, 40);
  few.observe(a);
  many.observe(b);
  CHECK(a == b.leftCols(2));
  CHECK(b.cwiseAbs().maxCoeff() <= 0.05f);
  CHECK(b.cwiseAbs().maxCoeff() > 0.045f);
  few.restart(0);
  few.observe(a);
  CHECK(a.col(0) != b.col(0));
  CHECK(a.col(1) == b.col(1));
}

TEST_CASE("senseless sizes and constants are refused") {
  CHECK_THROWS_WITH_AS(CartPole<float>(0), "cart-pole: expected at least one environment, got 0", traceur::Error);
  CartPoleParameters p;
  p.max_force = -1;
  CHECK_THROWS_WITH_AS(CartPole<float>(1, p), "cart-pole: expected positive constants", traceur::Error);
}
