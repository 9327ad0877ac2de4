// SPDX-License-Identifier: MIT
#include <traceur/learn/gae.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/random.hpp>

using namespace traceur::learn;
using doctest::Approx;
using traceur::core::RandomStream;

namespace {

using Matrix = Eigen::MatrixXd;
using Ends = Eigen::Matrix<End, Eigen::Dynamic, Eigen::Dynamic>;

struct Data {
  Matrix reward, rate, duration, value, timed_out, last;
  Ends end;

  Data(Eigen::Index steps, Eigen::Index environments)
      : reward(Matrix::Zero(steps, environments)),
        rate(reward),
        duration(Matrix::Ones(steps, environments)),
        value(reward),
        timed_out(reward),
        last(Matrix::Zero(1, environments)),
        end(Ends::Constant(steps, environments, End::running)) {}

  Trajectories<double> all() const { return {reward, rate, duration, value, timed_out, last, end}; }
  Matrix advantage(const Discount& d) const {
    Matrix a = value;
    generalized_advantage<double>(d, all(), a);
    return a;
  }
  Matrix target(const Discount& d) const {
    Matrix g = value;
    lambda_return<double>(d, all(), g);
    return g;
  }
};

/// Every kind of end, steps of many lengths.
Data any_data(Eigen::Index steps, Eigen::Index environments) {
  Data d(steps, environments);
  RandomStream random(5);
  for (Matrix* m : {&d.reward, &d.rate, &d.value, &d.timed_out, &d.last})
    for (double& x : m->reshaped()) x = random.normal();
  for (double& x : d.duration.reshaped()) x = random.uniform(0.2, 3.0);
  for (Eigen::Index i = 0; i < d.end.size(); ++i) {
    const double u = random.uniform();
    d.end.data()[i] = u < 0.1 ? End::terminated : u < 0.2 ? End::timed_out : u < 0.25 ? End::failed : End::running;
  }
  return d;
}

}  // namespace

TEST_CASE("a table worked by hand: termination, time-out, the end of the rows") {
  // gamma = 1/2, lambda = 1/2. Left: the second step terminates. Right: it times out at a state worth 8.
  Data d(3, 2);
  d.reward << 1, 1, 2, 2, 3, 3;
  d.value << 4, 4, 6, 6, 2, 2;
  d.last << 10, 10;
  d.timed_out.setConstant(1000);
  d.timed_out(1, 1) = 8;
  d.end(1, 0) = End::terminated;
  d.end(1, 1) = End::timed_out;
  const Matrix a = d.advantage({0.5, 0.5}), g = d.target({0.5, 0.5});
  // Third row: 3 + 0.5 * 10 - 2 = 6. Second: 2 - 6 = -4, or 2 + 0.5 * 8 - 6 = 0. First: 1 + 0.5 * 6 - 4 = 0, plus a
  // quarter of the row below.
  Matrix expected(3, 2);
  expected << -1, 0, -4, 0, 6, 6;
  CHECK((a - expected).norm() == 0);
  CHECK((g - expected - d.value).norm() == 0);
}

TEST_CASE("a table worked by hand: varying steps, spikes and rates") {
  // gamma = 1/4, lambda = 1/9: a step of a half has discounts 1/2 and 1/3, a step of two 1/16 and 1/81.
  Data d(2, 1);
  d.duration << 0.5, 2;
  d.reward << 1, 2;
  d.rate << std::log(4.0), 16 * std::log(4.0);
  d.value << 3, 8;
  d.last << 32;
  // The integral of gamma^u is (1 - 1/2) / ln 4 over the first step and (1 - 1/16) / ln 4 over the second.
  const double second = 15 + 2 + 32.0 / 16 - 8, first = 0.5 + 1 + 8.0 / 2 - 3;
  const Matrix a = d.advantage({1.0 / 4, 1.0 / 9});
  CHECK(a(1) == Approx(second).epsilon(1e-14));
  CHECK(a(0) == Approx(first + second / 6).epsilon(1e-14));
}

TEST_CASE("the integral of the discount is exact") {
  CHECK(discounted_duration(0.8, 0) == 0);
  CHECK(discounted_duration(1, 3.5) == 3.5);
  CHECK(discounted_duration(0.8, 6) == Approx((1 - std::pow(0.8, 6)) / -std::log(0.8)).epsilon(1e-15));
  // Next to gamma = 1 the series has to hold to the last digit: x - k x^2 / 2.
  CHECK(discounted_duration(1 - 1e-12, 2) == Approx(2 - 2e-12).epsilon(1e-15));
  double sum = 0;
  const int n = 100000;
  for (int i = 0; i < n; ++i) sum += std::pow(0.7, (i + 0.5) * 2.5 / n) * 2.5 / n;
  CHECK(discounted_duration(0.7, 2.5) == Approx(sum).epsilon(1e-10));
}

TEST_CASE("Lee et al. 2021, Fig. 4: returns do not depend on how time is cut into steps") {
  // R = 1, gamma = 0.8, Phi = 6: once as a reward received at 6, once as one received all along.
  const double gamma = 0.8, whole = 6;
  const auto value = [](double phi) { return 2 + std::sin(phi); };
  RandomStream random(4);
  for (int trial = 0; trial < 40; ++trial) {
    const int steps = 1 + trial;
    std::vector<double> cut{0, whole};
    for (int i = 1; i < steps; ++i) cut.push_back(trial % 2 == 0 ? whole * i / steps : random.uniform(0.0, whole));
    std::sort(cut.begin(), cut.end());
    Data spike(steps + 1, 1), continuous(steps, 1);
    for (int i = 0; i < steps; ++i) {
      spike.duration(i) = continuous.duration(i) = cut[static_cast<std::size_t>(i) + 1] - cut[static_cast<std::size_t>(i)];
      spike.value(i) = continuous.value(i) = value(cut[static_cast<std::size_t>(i)]);
    }
    spike.value(steps) = value(whole);
    spike.reward(steps) = 1;
    spike.end(steps) = End::terminated;
    continuous.rate.setOnes();
    continuous.last << value(whole);

    const double at_end = std::pow(gamma, whole), all_along = (1 - at_end) / -std::log(gamma);
    const Discount exact{gamma, 1};
    CHECK(std::abs(spike.target(exact)(0) - at_end) < 1e-10);
    CHECK(std::abs(spike.advantage(exact)(0) - (at_end - value(0))) < 1e-10);
    CHECK(std::abs(continuous.target(exact)(0) - (all_along + at_end * value(whole))) < 1e-10);
    CHECK(std::abs(continuous.advantage(exact)(0) - (all_along + at_end * value(whole) - value(0))) < 1e-10);

    // With the values of the policy's true future, nothing is gained or lost in any step, for every lambda.
    Data fair = continuous;
    for (int i = 0; i < steps; ++i) {
      const double left = std::pow(gamma, whole - cut[static_cast<std::size_t>(i)]);
      fair.value(i) = (1 - left) / -std::log(gamma) + 5 * left;
    }
    fair.last << 5;
    CHECK(fair.advantage({gamma, 0.6}).cwiseAbs().maxCoeff() < 1e-10);

    // A spike at the end reaches back by (gamma lambda)^6, however many steps lie between.
    Data late = spike;
    late.value.setZero();
    CHECK(std::abs(late.advantage({gamma, 0.6})(0) - std::pow(0.6 * gamma, whole)) < 1e-10);
  }
}

TEST_CASE("short steps tend to the integral of the discounted rate") {
  const double gamma = 0.8, lambda = 0.6, whole = 6;
  const double limit = (1 - std::pow(gamma * lambda, whole)) / -std::log(gamma * lambda);
  double before = 1e9;
  for (const int steps : {10, 100, 1000}) {
    Data d(steps, 1);
    d.rate.setOnes();
    d.duration.setConstant(whole / steps);
    d.end(steps - 1) = End::terminated;
    const double off = std::abs(d.advantage({gamma, lambda})(0) - limit);
    CHECK(off < before / 9);
    before = off;
  }
}

TEST_CASE("equal steps of length one give the textbook's sum") {
  const Discount discount{0.97, 0.9};
  Data d = any_data(40, 3);
  d.duration.setOnes();
  d.rate.setZero();
  const Matrix a = d.advantage(discount);
  for (Eigen::Index e = 0; e < 3; ++e)
    for (Eigen::Index t = 0; t < 40; ++t) {
      double sum = 0, weight = 1;
      for (Eigen::Index k = t; k < 40; ++k) {
        if (d.end(k, e) == End::failed) break;
        const double next = d.end(k, e) == End::terminated  ? 0.0
                            : d.end(k, e) == End::timed_out ? d.timed_out(k, e)
                            : k == 39                       ? d.last(e)
                                                            : d.value(k + 1, e);
        sum += weight * (d.reward(k, e) + discount.gamma * next - d.value(k, e));
        weight *= discount.gamma * discount.lambda;
        if (d.end(k, e) != End::running) break;
      }
      CHECK(a(t, e) == Approx(sum).epsilon(1e-12));
    }
}

TEST_CASE("the lambda-return is value plus advantage") {
  const Data d = any_data(50, 4);
  for (const double lambda : {0.0, 0.3, 0.95, 1.0}) {
    const Discount discount{0.9, lambda};
    CHECK((d.target(discount) - d.value - d.advantage(discount)).cwiseAbs().maxCoeff() < 1e-12);
  }
}

TEST_CASE("a failed step is neither sought nor shunned") {
  Data d = any_data(20, 1);
  d.end.setConstant(End::running);
  d.end(10) = End::failed;
  CHECK(d.advantage({0.9, 0.8})(10) == 0);
  CHECK(d.target({0.9, 0.8})(10) == d.value(10));
  // What comes after it is another episode.
  Data other = d;
  other.reward.bottomRows(9).setConstant(100);
  CHECK((other.advantage({0.9, 0.8}) - d.advantage({0.9, 0.8})).topRows(11).norm() == 0);
}

TEST_CASE("matrices left out stand for their defaults, in float as in double") {
  Data d = any_data(30, 2);
  d.duration.setOnes();
  d.rate.setZero();
  Matrix a(30, 2);
  generalized_advantage<double>({0.95, 0.9},
                                {d.reward, none<double>(), none<double>(), d.value, d.timed_out, d.last, d.end}, a);
  CHECK((a - d.advantage({0.95, 0.9})).norm() == 0);

  const Eigen::MatrixXf reward = d.reward.cast<float>(), value = d.value.cast<float>(), last = d.last.cast<float>(),
                        timed_out = d.timed_out.cast<float>();
  Eigen::MatrixXf single(30, 2);
  generalized_advantage<float>({0.95, 0.9}, {reward, none<float>(), none<float>(), value, timed_out, last, d.end}, single);
  CHECK((single.cast<double>() - a).cwiseAbs().maxCoeff() < 1e-5);
}
