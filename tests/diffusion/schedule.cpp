// SPDX-License-Identifier: MIT
#include <traceur/diffusion/schedule.hpp>

#include <cmath>
#include <numbers>

#include <doctest/doctest.h>

using traceur::diffusion::Schedule;

TEST_CASE("the cosine schedule is its closed form where no limit acts") {
  const int steps = 21;
  const Schedule s = Schedule::cosine(steps);
  const auto f = [&](int k) {
    return std::pow(std::cos(0.5 * std::numbers::pi * (static_cast<double>(k) / steps + 0.008) / 1.008), 2);
  };
  CHECK(s.steps() == steps);
  CHECK(s.kept(0) == 1.0);
  for (int k = 1; k < steps; ++k) CHECK(s.kept(k) == doctest::Approx(f(k) / f(0)).epsilon(1e-12));
  // The last step would keep nothing at all; its beta is limited.
  CHECK(s.beta(steps) == 0.9999);
  CHECK(s.kept(steps) == doctest::Approx(s.kept(steps - 1) * 1e-4).epsilon(1e-12));
}

TEST_CASE("the linear schedule is the published one") {
  const Schedule s = Schedule::linear();
  CHECK(s.steps() == 1000);
  CHECK(s.beta(1) == 1e-4);
  CHECK(s.beta(1000) == doctest::Approx(0.02));
  CHECK(s.beta(500) - s.beta(499) == doctest::Approx((0.02 - 1e-4) / 999));
  double log_kept = 0;
  for (int k = 1; k <= 1000; ++k) log_kept += std::log1p(-s.beta(k));
  CHECK(s.kept(1000) == doctest::Approx(std::exp(log_kept)).epsilon(1e-10));
}

TEST_CASE("signal and noise keep the variance") {
  for (const Schedule& s : {Schedule::cosine(), Schedule::linear(50), Schedule::cosine(1), Schedule({0.5, 0.25})}) {
    CHECK(s.signal(0) == 1.0);
    CHECK(s.noise(0) == 0.0);
    for (int k = 1; k <= s.steps(); ++k) {
      CHECK(s.kept(k) < s.kept(k - 1));
      CHECK(s.signal(k) * s.signal(k) + s.noise(k) * s.noise(k) == doctest::Approx(1.0).epsilon(1e-14));
      CHECK(s.kept(k) == doctest::Approx(s.kept(k - 1) * (1 - s.beta(k))).epsilon(1e-14));
    }
  }
}

TEST_CASE_TEMPLATE("noised step by step or at once, the weights are the same", S, float, double) {
  // x_k = sqrt(1 - beta_k) x_{k-1} + sqrt(beta_k) eps_k: weights multiply and variances add.
  const Schedule s = Schedule::cosine(30);
  double signal = 1, variance = 0;
  for (int k = 1; k <= s.steps(); ++k) {
    signal *= std::sqrt(1 - s.beta(k));
    variance = (1 - s.beta(k)) * variance + s.beta(k);
    Eigen::Matrix<S, -1, -1> one = Eigen::Matrix<S, -1, -1>::Ones(1, 1), zero = one - one, x(1, 1);
    s.diffuse<S>(k, one, zero, x);
    CHECK(static_cast<double>(x(0)) == doctest::Approx(signal).epsilon(1e-6));
    s.diffuse<S>(k, zero, one, x);
    CHECK(static_cast<double>(x(0)) == doctest::Approx(std::sqrt(variance)).epsilon(1e-6));
  }
}

TEST_CASE("a schedule refuses numbers out of range") {
  CHECK_THROWS_WITH_AS(Schedule({0.1, 1.0}), "schedule: beta 2: expected more than 0 and less than 1, got 1.000000",
                       traceur::Error);
  CHECK_THROWS_AS(Schedule({}), traceur::Error);
  CHECK_THROWS_AS(Schedule({std::nan("")}), traceur::Error);
  CHECK_THROWS_AS(Schedule::cosine(0), traceur::Error);
  CHECK_THROWS_AS(Schedule::cosine(10, -1.0), traceur::Error);
  CHECK_THROWS_AS(Schedule::cosine(10, 0.0, 0.5, 0.2), traceur::Error);
  CHECK_THROWS_AS(Schedule::linear(10, 0.0), traceur::Error);
}
