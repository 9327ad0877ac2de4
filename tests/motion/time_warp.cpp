// SPDX-License-Identifier: MIT
#include <traceur/motion/time_warp.hpp>

#include <doctest/doctest.h>

#include "figure.hpp"

using namespace traceur;
using namespace figure;
using motion::TimeWarp;

namespace {

Vec random_tau(std::mt19937_64& rng, int n, double size) {
  Vec tau(n);
  for (int i = 0; i < n; ++i) tau[i] = uniform(rng, -size, size);
  return tau;
}

template <class S>
void check_laws() {
  std::mt19937_64 rng(11);
  Eigen::Matrix<S, Eigen::Dynamic, 1> tau(9);
  for (int i = 0; i < 9; ++i) tau[i] = S(uniform(rng, -2, 2));
  const TimeWarp<S> w(tau, 0.1);
  const TimeWarp<S> back = w.inverse();
  double previous = -1e9;
  for (double t = -0.5; t < 1.5; t += 0.013) {
    const S phi = w.phase(S(t));
    CHECK(core::plain(phi) > previous);
    previous = static_cast<double>(core::plain(phi));
    CHECK(core::plain(w.time(phi)) == doctest::Approx(t).epsilon(1e-5).scale(1.0));
    CHECK(core::plain(back.phase(phi)) == doctest::Approx(t).epsilon(1e-5).scale(1.0));
  }
  for (int i = 0; i < 9; ++i) CHECK(core::plain(w.log_rates()[i]) == doctest::Approx(core::plain(tau[i])).epsilon(1e-4));
}

}  // namespace

TEST_CASE("a warp increases strictly and its inverse undoes it, for every scalar") {
  check_laws<double>();
  check_laws<float>();
}

TEST_CASE("knots are the running sum of exp(tau)") {
  Vec tau(3);
  tau << 0.0, std::log(2.0), -std::log(4.0);
  const TimeWarp<> w(tau, 0.5);
  CHECK(w.phase(0.0) == 0.0);
  CHECK(w.phase(0.5) == doctest::Approx(0.5));
  CHECK(w.phase(1.0) == doctest::Approx(1.5));
  CHECK(w.phase(1.5) == doctest::Approx(1.625));
  CHECK(w.phase(0.75) == doctest::Approx(1.0));
  CHECK(w.phase(2.5) == doctest::Approx(1.875));
  CHECK(w.phase(-1.0) == doctest::Approx(-1.0));
}

TEST_CASE("a warped clip is the composition, exactly") {
  std::mt19937_64 rng(13);
  const auto clip = random_clip(rng, 8);
  const TimeWarp<> w(random_tau(rng, 12, 1.2), clip.duration() / 12);
  const auto warped = motion::warp(clip, w);
  CHECK_NOTHROW(warped.check());
  for (double t = 0; t <= w.duration(); t += 0.007)
    CHECK(distance(clip.skeleton, warped.sample(t), clip.sample(w.phase(t))) < 1e-9);
}

TEST_CASE("warping there and back gives the clip") {
  std::mt19937_64 rng(14);
  const auto clip = random_clip(rng, 6);
  Vec times(4), phases(4);
  times << 0, 0.2, 0.9, 1.4;
  phases << 0, 0.5 * clip.duration(), 0.7 * clip.duration(), clip.duration();
  const auto w = TimeWarp<>::through(times, phases);
  const auto back = motion::warp(motion::warp(clip, w), w.inverse());
  CHECK(back.duration() == doctest::Approx(clip.duration()));
  for (double t = 0; t <= clip.duration(); t += 0.01)
    CHECK(distance(clip.skeleton, back.sample(t), clip.sample(t)) < 1e-9);
}

TEST_CASE("a cyclic clip stays cyclic when the warp spans whole cycles") {
  Gait g;
  g.turn = 0.4;
  const auto clip = gait(g, g.period, 25, true);
  const auto spanning = [&](double cycles) {
    Vec times(3), phases(3);
    times << 0, 1, 2;
    phases << 0, 0.3 * cycles * g.period, cycles * g.period;
    return TimeWarp<>::through(times, phases);
  };
  for (const double cycles : {1.0, 2.0}) {
    const auto warped = motion::warp(clip, spanning(cycles));
    CHECK(warped.cyclic);
    for (double t = -2.9; t < 5; t += 0.11) {
      const double wrapped = t - 2 * std::floor(t / 2);
      Vec expected = clip.sample(spanning(cycles).phase(wrapped));
      clip.carry_root(cycles * std::floor(t / 2), expected);
      CHECK(distance(clip.skeleton, warped.sample(t), expected) < 1e-8);
    }
  }
  CHECK(!motion::warp(clip, spanning(1.5)).cyclic);
}

TEST_CASE("warps that stall, run backwards or overflow are refused by number") {
  Vec tau = Vec::Zero(4);
  tau[2] = 800;
  CHECK(fails_with([&] { TimeWarp<>(tau, 0.1); }, "time warp: increment 2"));
  tau[2] = -800;
  CHECK(fails_with([&] { TimeWarp<>(tau, 0.1); }, "time warp: increment 2"));
  CHECK(fails_with([&] { TimeWarp<>(Vec(), 0.1); }, "at least one"));
  CHECK(fails_with([&] { TimeWarp<>(Vec::Zero(2), 0.0); }, "positive step"));
  Vec times(3), phases(3);
  times << 0, 1, 2;
  phases << 0, 1, 1;
  CHECK(fails_with([&] { TimeWarp<>::through(times, phases); }, "increment 1"));
}
