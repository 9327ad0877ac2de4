// SPDX-License-Identifier: MIT
#include <traceur/learn/environment.hpp>

#include <limits>

#include <doctest/doctest.h>

#include <traceur/learn/cart_pole.hpp>
#include <traceur/learn/pendulum.hpp>

using traceur::Error;
using namespace traceur::learn;

namespace {

/// One number that an action moves; nothing ends.
struct Counter {
  Eigen::Index environments() const { return 1; }
  Eigen::Index observations() const { return 1; }
  Eigen::Index actions() const { return 1; }
  void reset(std::uint64_t) { x = 0; }
  void restart(Eigen::Index) noexcept { x = 0; }
  void observe(Columns<double> out) const noexcept { out(0, 0) = x; }
  void step(ConstColumns<double> actions, StepResult<double>& result) noexcept { result.reward[0] = x += actions(0, 0); }
  double x = 0;
};

struct NeverStarts : Counter {
  void restart(Eigen::Index) = delete;
};

struct Forgetful : Counter {
  void observe(Columns<double> out) noexcept { out(0, 0) = x++; }
};

static_assert(Environments<Pendulum<float>, float> && Environments<CartPole<double>, double>);
static_assert(Environments<Counter, double>);
static_assert(!Environments<Counter, float> && !Environments<NeverStarts, double> && !Environments<Forgetful, double>);

}  // namespace

TEST_CASE("a cleared result is plain steps of length one in which nothing is earned") {
  StepResult<float> result(3);
  result.reward.setConstant(2);
  result.reward_rate.setConstant(2);
  result.duration.setConstant(2);
  result.end.setConstant(End::failed);
  result.clear();
  CHECK(result.environments() == 3);
  for (Eigen::Index e = 0; e < 3; ++e) {
    CHECK(result.reward[e] == 0);
    CHECK(result.reward_rate[e] == 0);
    CHECK(result.duration[e] == 1);
    CHECK(result.end[e] == End::running);
  }
}

TEST_CASE("numbers that cannot be are refused by name") {
  for (const double good : {0.0, 1e-300, 1e300}) CHECK_NOTHROW(detail::check_zero_or_more("ppo", "clip", good));
  constexpr double inf = std::numeric_limits<double>::infinity();
  for (const double bad : {-1e-300, inf, -inf, std::numeric_limits<double>::quiet_NaN()})
    CHECK_THROWS_WITH_AS(detail::check_zero_or_more("ppo", "clip", bad), "ppo: clip must be zero or more", Error);
  CHECK_NOTHROW(detail::check_at_least_one("ppo", "step", 1));
  CHECK_THROWS_WITH_AS(detail::check_at_least_one("ppo", "step", 0), "ppo: expected at least one step, got 0", Error);
}
