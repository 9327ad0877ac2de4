// SPDX-License-Identifier: MIT
#include <traceur/evaluate/confidence.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include "../error_message.hpp"

namespace {

using namespace traceur;
using core::RandomStream;
using evaluate::Bootstrap;
using evaluate::Interval;
using evaluate::mean_interval;
using evaluate::normal_quantile;
using evaluate::wilson_interval;
using traceur_test::message;

}  // namespace

TEST_CASE("normal quantile: tabulated values, symmetric, the inverse of the distribution") {
  CHECK(normal_quantile(0.975) == doctest::Approx(1.959963984540054).epsilon(1e-13));
  CHECK(normal_quantile(0.95) == doctest::Approx(1.644853626951473).epsilon(1e-13));
  CHECK(normal_quantile(0.995) == doctest::Approx(2.575829303548901).epsilon(1e-13));
  CHECK(std::abs(normal_quantile(0.5)) < 1e-15);
  for (double p = 0.001; p < 1; p += 0.013) {
    CHECK(normal_quantile(p) == doctest::Approx(-normal_quantile(1 - p)).scale(1));
    CHECK(0.5 * std::erfc(-normal_quantile(p) / std::sqrt(2.0)) == doctest::Approx(p));
  }
  CHECK(normal_quantile(1e-12) == doctest::Approx(-7.034483825301131).epsilon(1e-9));
  CHECK(message([] { normal_quantile(1); }) == "normal quantile: expected a probability between 0 and 1");
}

TEST_CASE("Wilson: the intervals of Newcombe, Statistics in Medicine 17 (1998), table I, method 3") {
  struct Row {
    int successes, trials;
    double low, high;
  };
  for (const Row& r : {Row{81, 263, 0.2553, 0.3662}, Row{15, 148, 0.0624, 0.1605}, Row{0, 20, 0.0000, 0.1611},
                       Row{1, 29, 0.0061, 0.1718}}) {
    const Interval i = wilson_interval(r.successes, r.trials);
    CHECK(std::abs(i.low - r.low) < 5e-5);
    CHECK(std::abs(i.high - r.high) < 5e-5);
    CHECK(i.estimate == static_cast<double>(r.successes) / r.trials);
  }
}

TEST_CASE("Wilson: the ends are where the score test just does not reject") {
  for (const int n : {1, 7, 50, 3000})
    for (int s = 0; s <= n; s += std::max(1, n / 9))
      for (const double level : {0.8, 0.95, 0.99}) {
        const Interval i = wilson_interval(s, n, level);
        const double z = normal_quantile(0.5 + 0.5 * level), share = static_cast<double>(s) / n;
        CHECK(i.low >= 0);
        CHECK(i.high <= 1);
        CHECK(i.low <= share);
        CHECK(i.high >= share);
        for (const double p : {i.low, i.high})
          if (p > 0 && p < 1)
            CHECK(std::abs(share - p) / std::sqrt(p * (1 - p) / n) == doctest::Approx(z).epsilon(1e-6));
        // Failures are successes seen from the other side.
        const Interval other = wilson_interval(n - s, n, level);
        CHECK(other.low == doctest::Approx(1 - i.high).scale(1));
      }
}

TEST_CASE("Wilson: holds the true share about as often as it says") {
  // Exactly, by the binomial distribution, on average over shares.
  constexpr int n = 40;
  double covered = 0, cases = 0;
  for (double p = 0.05; p < 0.951; p += 0.01) {
    double probability = std::pow(1 - p, n), sum = 0;
    for (int s = 0; s <= n; ++s) {
      const Interval i = wilson_interval(s, n);
      if (i.low <= p && p <= i.high) sum += probability;
      probability *= (n - s) * p / ((s + 1) * (1 - p));
    }
    covered += sum;
    ++cases;
  }
  CHECK(covered / cases == doctest::Approx(0.95).epsilon(0.01));
}

TEST_CASE("bootstrap: of a mean, near the textbook's interval, and over the true mean as often as it says") {
  int held = 0;
  constexpr int experiments = 300;
  Bootstrap p;
  p.resamples = 400;
  for (std::uint64_t e = 0; e < experiments; ++e) {
    RandomStream random(71, e);
    std::vector<double> values(60);
    for (double& x : values) x = random.normal(3, 2);
    p.seed = e;
    const Interval i = mean_interval(values, p);
    CHECK(i.low < i.estimate);
    CHECK(i.high > i.estimate);
    held += i.low <= 3 && 3 <= i.high ? 1 : 0;
    if (e < 5) {
      double variance = 0;
      for (const double x : values) variance += (x - i.estimate) * (x - i.estimate) / 60;
      CHECK(i.high - i.low == doctest::Approx(2 * 1.96 * std::sqrt(variance / 60)).epsilon(0.12));
    }
  }
  CHECK(held > 0.90 * experiments);
  CHECK(held < 0.98 * experiments);
}

TEST_CASE("bootstrap: deterministic, wider for a higher level, exact for values that are all one") {
  RandomStream random(72);
  std::vector<double> values(30);
  for (double& x : values) x = random.uniform();
  Bootstrap p;
  const Interval a = mean_interval(values, p), b = mean_interval(values, p);
  CHECK(a.low == b.low);
  CHECK(a.high == b.high);
  p.level = 0.99;
  CHECK(mean_interval(values, p).low < a.low);
  p.level = 0.95;
  p.seed = 1;
  CHECK(mean_interval(values, p).low != a.low);
  const std::vector<double> same(10, 4.5), single(1, 2.0);
  CHECK(mean_interval(same).low == 4.5);
  CHECK(mean_interval(same).high == 4.5);
  CHECK(mean_interval(single).high == 2.0);
  // Any statistic.
  const Interval most = evaluate::bootstrap_interval(
      values, [](std::span<const double> x) { return *std::max_element(x.begin(), x.end()); });
  CHECK(most.estimate == *std::max_element(values.begin(), values.end()));
  CHECK(most.high == most.estimate);
  CHECK(most.low < most.estimate);
}

TEST_CASE("confidence: what says nothing is refused") {
  CHECK(message([] { wilson_interval(0, 0); }) ==
        "Wilson interval: expected 0 <= successes <= trials and at least one trial, found 0 of 0");
  CHECK(!message([] { wilson_interval(5, 4); }).empty());
  CHECK(message([] { wilson_interval(1, 4, 1.0); }) == "confidence: expected a level between 0 and 1");
  const std::vector<double> none, bad{1, std::numeric_limits<double>::quiet_NaN()};
  CHECK(message([&] { mean_interval(none); }) == "bootstrap: expected at least one value");
  CHECK(message([&] { mean_interval(bad); }) == "bootstrap: value 1 is not finite");
}
