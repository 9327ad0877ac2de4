// SPDX-License-Identifier: MIT
#include <traceur/evaluate/coverage.hpp>

#include <cmath>
#include <numbers>
#include <string>

#include <doctest/doctest.h>

#include "../error_message.hpp"

namespace {

using namespace traceur;
using evaluate::CoverageHistogram;
using evaluate::exploration_ratio;
using traceur_test::message;

}  // namespace

TEST_CASE("exploration ratio: volumes that are known") {
  const Eigen::VectorXd lower = Eigen::Vector2d(-1, 2), upper = Eigen::Vector2d(1, 4);
  const auto everywhere = [](const Eigen::VectorXd&) { return 1.0; };
  const auto half = [](const Eigen::VectorXd& x) { return x[0] < 0 ? 1.0 : 0.0; };
  const auto disc = [](const Eigen::VectorXd& x) { return std::hypot(x[0], x[1] - 3) < 0.8 ? 0.9 : 0.1; };
  CHECK(exploration_ratio(everywhere, lower, upper) == 1);
  CHECK(exploration_ratio(half, lower, upper) == 0.5);
  CHECK(exploration_ratio(disc, lower, upper, 0.8, 200) == doctest::Approx(std::numbers::pi * 0.64 / 4).epsilon(0.005));
  CHECK(exploration_ratio(disc, lower, upper, 0.95) == 0);
  // Heavily visited is above the threshold, not at it.
  CHECK(exploration_ratio([](const Eigen::VectorXd&) { return 0.8; }, lower, upper) == 0);
  // One axis, three axes, and one of no width.
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(1), one = Eigen::VectorXd::Ones(1);
  CHECK(exploration_ratio([](const Eigen::VectorXd& x) { return x[0] > 0.3 ? 1.0 : 0.0; }, zero, one, 0.8, 10) ==
        doctest::Approx(0.7));
  const Eigen::VectorXd zeros = Eigen::VectorXd::Zero(3), ones = Eigen::VectorXd::Ones(3);
  CHECK(exploration_ratio([](const Eigen::VectorXd& x) { return x.maxCoeff() < 0.5 ? 1.0 : 0.0; }, zeros, ones, 0.8,
                          20) == doctest::Approx(0.125));
  Eigen::VectorXd flat = ones;
  flat[1] = 0;
  int calls = 0;
  exploration_ratio(
      [&](const Eigen::VectorXd& x) {
        ++calls;
        CHECK(x[1] == 0);
        return 1.0;
      },
      zeros, flat, 0.8, 5);
  CHECK(calls == 25);
}

TEST_CASE("exploration ratio: bounds that make no sense are refused") {
  const auto f = [](const Eigen::VectorXd&) { return 1.0; };
  const Eigen::VectorXd zeros = Eigen::VectorXd::Zero(2), ones = Eigen::VectorXd::Ones(2),
                        many = Eigen::VectorXd::Ones(9);
  CHECK(message([&] { exploration_ratio(f, ones, zeros); }) ==
        "exploration ratio: expected finite bounds with lower <= upper for parameter 0");
  CHECK(message([&] { exploration_ratio(f, zeros, many); }) ==
        "exploration ratio: expected a lower and an upper bound for each parameter");
  CHECK(message([&] { exploration_ratio(f, Eigen::VectorXd::Zero(9), many); }) ==
        "exploration ratio: expected at most 10^8 cells; take fewer per axis");
}

TEST_CASE("histogram: shares, what was covered, how evenly") {
  CoverageHistogram h(4);
  CHECK(h.evenness() == 0);
  CHECK(h.share(2) == 0);
  CHECK(h.covered() == 0);
  for (const int kind : {0, 0, 0, 2}) h.add(kind);
  CHECK(h.total() == 4);
  CHECK(h.count(0) == 3);
  CHECK(h.share(0) == 0.75);
  CHECK(h.covered() == 0.5);
  CHECK(h.covered(2) == 0.25);
  CHECK(h.evenness() == doctest::Approx(-(0.75 * std::log(0.75) + 0.25 * std::log(0.25)) / std::log(4)));
  CoverageHistogram even(4), collapsed(4);
  for (int k = 0; k < 40; ++k) {
    even.add(k % 4);
    collapsed.add(1);
  }
  CHECK(even.evenness() == doctest::Approx(1));
  CHECK(collapsed.evenness() == 0);
  CHECK(even.distance(collapsed) == doctest::Approx(0.75));
  CHECK(h.distance(collapsed) == 1);
  CHECK(h.distance(h) == 0);
  CoverageHistogram single(1);
  single.add(0);
  CHECK(single.evenness() == 1);
}

TEST_CASE("histogram: kinds that there are not are refused") {
  CoverageHistogram h(2);
  CHECK(message([&] { h.add(2); }) == "coverage histogram: expected a kind below 2, found 2");
  CHECK(message([&] { h.add(-1); }) == "coverage histogram: expected a kind below 2, found -1");
  CHECK(message([&] { h.distance(CoverageHistogram(3)); }) ==
        "coverage histogram: expected histograms of as many kinds");
  CHECK(message([] { CoverageHistogram(0); }) == "coverage histogram: expected at least one kind");
}
