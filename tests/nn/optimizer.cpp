// SPDX-License-Identifier: MIT
#include <traceur/nn/optimizer.hpp>

#include <cmath>
#include <limits>

#include <doctest/doctest.h>

#include <traceur/core/random.hpp>

#include "allocations.hpp"

using namespace traceur::nn;
using Eigen::VectorXd;
using Eigen::VectorXf;

static_assert(Optimizer<Sgd<float>> && Optimizer<Adam<float>> && Optimizer<Adam<double>, double>);
static_assert(!Optimizer<Adam<double>, float>);
static_assert(!Optimizer<ExponentialAverage<float>>);

namespace {

VectorXd random_vector(Eigen::Index size, unsigned seed) {
  traceur::core::RandomStream random(seed);
  VectorXd v(size);
  for (double& x : v) x = random.normal();
  return v;
}

/// What a saved and restored optimizer does is what the original goes on to do.
template <class O>
void check_restore(O original, O fresh) {
  const Eigen::Index n = original.size();
  VectorXd theta = random_vector(n, 1);
  for (unsigned k = 0; k < 5; ++k) original.step(theta, random_vector(n, 10 + k), 0.1);
  VectorXd copy = theta;
  fresh.restore(original.state(), original.steps());
  for (unsigned k = 0; k < 5; ++k) {
    original.step(theta, random_vector(n, 20 + k), 0.05);
    fresh.step(copy, random_vector(n, 20 + k), 0.05);
  }
  CHECK(theta == copy);
  CHECK(original.state() == fresh.state());
  CHECK(fresh.steps() == 10);
}

/// A parameter's way does not depend on its place or its neighbours.
template <class O>
void check_alone(O together, O alone) {
  const Eigen::Index n = together.size();
  VectorXd theta = VectorXd::Zero(n), one = VectorXd::Zero(1);
  for (int k = 1; k <= 4; ++k) {
    VectorXd gradient = random_vector(n, static_cast<unsigned>(k));
    gradient[n - 2] = 0.3 * k;
    together.step(theta, gradient, 0.01);
    alone.step(one, VectorXd::Constant(1, 0.3 * k), 0.01);
  }
  CHECK(theta[n - 2] == one[0]);
}

}  // namespace

TEST_CASE("momentum by hand") {
  Sgd<double> sgd(1, {.momentum = 0.5});
  VectorXd theta = VectorXd::Constant(1, 1.0);
  sgd.step(theta, VectorXd::Constant(1, 2.0), 0.1);
  CHECK(theta[0] == doctest::Approx(0.8));  // velocity 2
  sgd.step(theta, VectorXd::Constant(1, -1.0), 0.1);
  CHECK(theta[0] == doctest::Approx(0.8));  // velocity 0
  sgd.step(theta, VectorXd::Constant(1, 3.0), 0.2);
  CHECK(theta[0] == doctest::Approx(0.2));
  Sgd<double> decaying(1, {.momentum = 0.0, .weight_decay = 0.5});
  decaying.step(theta, VectorXd::Zero(1), 0.1);
  CHECK(theta[0] == doctest::Approx(0.2 * 0.95));
}

TEST_CASE("Adam by hand") {
  Adam<double> adam(1, {.beta1 = 0.5, .beta2 = 0.75, .epsilon = 0.1});
  VectorXd theta = VectorXd::Constant(1, 1.0);
  // t = 1: m = 1, v = 1; corrected m = 2, v = 4: a step of 0.1 * 2 / (2 + 0.1)
  adam.step(theta, VectorXd::Constant(1, 2.0), 0.1);
  CHECK(theta[0] == doctest::Approx(1.0 - 0.2 / 2.1).epsilon(1e-14));
  // t = 2: m = 0.5 + 0.5 = 1, v = 0.75 + 0.25 = 1; corrected m = 4/3, v = 16/7
  const double before = theta[0];
  adam.step(theta, VectorXd::Constant(1, 1.0), 0.1);
  CHECK(theta[0] == doctest::Approx(before - 0.1 * (4.0 / 3.0) / (std::sqrt(16.0 / 7.0) + 0.1)).epsilon(1e-14));
}

TEST_CASE("AdamW shrinks the parameters apart from the gradient") {
  AdamParameters decay;
  decay.weight_decay = 0.1;
  Adam<double> with(3, decay), without(3);
  VectorXd a(3), b(3), gradient(3);
  a << 1, -2, 3;
  b = a;
  gradient << 0.5, 1, -1;
  with.step(a, gradient, 0.01);
  without.step(b, gradient, 0.01);
  for (int i = 0; i < 3; ++i) CHECK(a[i] == doctest::Approx(b[i] - 0.01 * 0.1 * std::round(b[i])).epsilon(1e-12));
}

TEST_CASE("the first step of Adam is as long as the rate, whatever the gradient's scale") {
  for (const double scale : {1e-4, 1.0, 1e6}) {
    Adam<double> adam(2);
    VectorXd theta = VectorXd::Zero(2), gradient(2);
    gradient << scale, -scale;
    adam.step(theta, gradient, 0.01);
    CHECK(theta[0] == doctest::Approx(-0.01).epsilon(1e-3));
    CHECK(theta[1] == -theta[0]);
  }
}

TEST_CASE("they find the bottom of a bowl") {
  Adam<float> adam(20);
  Sgd<float> sgd(20);
  VectorXf a = VectorXf::Constant(20, 3.0f), b = a, goal = VectorXf::LinSpaced(20, -1.0f, 1.0f);
  for (int k = 0; k < 1500; ++k) {
    adam.step(a, VectorXf(a - goal), 0.05 * (1.0 - k / 1500.0));
    sgd.step(b, VectorXf(b - goal), 0.05);
  }
  CHECK((a - goal).norm() < 1e-3f);
  CHECK((b - goal).norm() < 1e-3f);
}

TEST_CASE("state goes on to the same bits") {
  check_restore(Adam<double>(37), Adam<double>(37));
  check_restore(Sgd<double>(5), Sgd<double>(5));
  check_alone(Adam<double>(37), Adam<double>(1));
  check_alone(Sgd<double>(37), Sgd<double>(1));
  Adam<double> adam(4);
  CHECK_THROWS_WITH_AS(adam.restore(VectorXd::Zero(7), 1), "adam state: expected 8 numbers, got 7", traceur::Error);
  CHECK_THROWS_WITH_AS(adam.restore(VectorXd::Zero(8), -1), "adam state: expected 0 steps or more, got -1",
                       traceur::Error);
  VectorXd bad = VectorXd::Zero(8);
  bad[5] = std::numeric_limits<double>::infinity();
  CHECK_THROWS_WITH_AS(adam.restore(bad, 1), "adam state: number 5 is not finite", traceur::Error);
}

TEST_CASE("settings out of range are refused") {
  CHECK_THROWS_AS(Adam<float>(0), traceur::Error);
  CHECK_THROWS_AS(Adam<float>(1, {.beta1 = 1.0}), traceur::Error);
  CHECK_THROWS_AS(Adam<float>(1, {.beta2 = -0.1}), traceur::Error);
  CHECK_THROWS_AS(Adam<float>(1, {.epsilon = 0.0}), traceur::Error);
  CHECK_THROWS_AS(Adam<float>(1, {.weight_decay = -1.0}), traceur::Error);
  CHECK_THROWS_AS(Sgd<float>(1, {.momentum = std::nan("")}), traceur::Error);
  CHECK_THROWS_AS(ExponentialAverage<float>(VectorXf::Zero(1), 1.0), traceur::Error);
}

TEST_CASE("clipping by length") {
  for (const Eigen::Index n : {1, 7, 8, 100}) {
    VectorXd g = random_vector(n, 4);
    const VectorXd before = g;
    CHECK(global_norm(g.data(), n) == doctest::Approx(before.norm()).epsilon(1e-14));
    CHECK(clip_global_norm(g.data(), n, 1e3) == doctest::Approx(before.norm()));
    CHECK(g == before);
    CHECK(clip_global_norm(g.data(), n, 0.01) == doctest::Approx(before.norm()));
    CHECK(g.norm() == doctest::Approx(0.01));
    CHECK((g.normalized() - before.normalized()).norm() < 1e-14);
  }
  VectorXf bad = VectorXf::Ones(3);
  bad[1] = std::nanf("");
  CHECK(std::isnan(clip_global_norm(bad.data(), 3, 1.0)));
  CHECK(bad[2] == 1.0f);
}

TEST_CASE("an average forgets at its pace") {
  VectorXd theta = VectorXd::Constant(19, 1.0);
  ExponentialAverage<double> average(theta, 0.75);
  theta.setConstant(5.0);
  for (int k = 1; k <= 10; ++k) {
    average.update(theta);
    CHECK(average.value()[18] == doctest::Approx(5.0 - 4.0 * std::pow(0.75, k)));
  }
  ExponentialAverage<double> other(VectorXd::Zero(19), 0.75);
  other.restore(average.value());
  CHECK(other.value() == average.value());
}

TEST_CASE("a step takes nothing from the heap") {
  Adam<float> adam(100);
  Sgd<float> sgd(100);
  VectorXf theta = VectorXf::Ones(100), gradient = VectorXf::Ones(100);
  ExponentialAverage<float> average(theta, 0.9);
  const long before = allocations();
  clip_global_norm(gradient.data(), 100, 1.0);
  adam.step(theta, gradient, 1e-3);
  sgd.step(theta, gradient, 1e-3);
  average.update(theta);
  CHECK(allocations() == before);
}
