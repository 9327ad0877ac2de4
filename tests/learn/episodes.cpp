// SPDX-License-Identifier: MIT
#include <traceur/learn/episodes.hpp>

#include <numbers>

#include <doctest/doctest.h>

#include <traceur/learn/cart_pole.hpp>
#include <traceur/learn/pendulum.hpp>

using namespace traceur::learn;

namespace {

const auto idle = [](ConstColumns<double>, Columns<double> action) { action.setZero(); };

/// Environment e fails at its step e + 1, earning at once and over time until then.
struct Doomed {
  Eigen::VectorXi age = Eigen::VectorXi::Zero(4);
  Eigen::Index environments() const { return 4; }
  Eigen::Index observations() const { return 1; }
  Eigen::Index actions() const { return 1; }
  void reset(std::uint64_t) { age.setZero(); }
  void restart(Eigen::Index e) noexcept { age[e] = 0; }
  void observe(Columns<double> out) const noexcept { out.setZero(); }
  void step(ConstColumns<double>, StepResult<double>& result) noexcept {
    for (Eigen::Index e = 0; e < 4; ++e) {
      result.reward[e] = 1;
      result.reward_rate[e] = 4;
      result.duration[e] = 0.5;
      if (++age[e] == e + 1) result.end[e] = End::failed;
    }
  }
};

}  // namespace

TEST_CASE("hanging pendulums earn the same every step until time is out") {
  Pendulum<double> batch(3);
  for (Eigen::Index e = 0; e < 3; ++e) batch.place(e, std::numbers::pi, 0);
  const EpisodeReport report = play_episodes<double>(batch, idle, 1000);
  CHECK(report.steps == Eigen::Vector3i::Constant(200));
  CHECK(report.mean() == doctest::Approx(-200 * std::numbers::pi * std::numbers::pi).epsilon(1e-6));
  CHECK(report.end[2] == End::timed_out);
}

TEST_CASE("poles left alone fall, each in its time, and only first episodes count") {
  CartPole<double> batch(20);
  batch.reset(1);
  const EpisodeReport report = play_episodes<double>(batch, idle, 1000);
  CHECK(report.steps.minCoeff() < report.steps.maxCoeff());
  for (Eigen::Index e = 0; e < 20; ++e) {
    CHECK(report.end[e] == End::terminated);
    CHECK(report.earned[e] == report.steps[e]);
  }
}

TEST_CASE("the steps allowed cut episodes short, a failed step earns nothing") {
  Doomed batch;
  const EpisodeReport report = play_episodes<double>(batch, idle, 3);
  CHECK(report.steps == Eigen::Vector4i(1, 2, 3, 3));
  CHECK(report.earned == Eigen::Vector4d(0, 3, 6, 9));
  CHECK(report.end[2] == End::failed);
  CHECK(report.end[3] == End::running);
}
