// SPDX-License-Identifier: MIT
#include <traceur/learn/prioritized_clips.hpp>

#include <algorithm>
#include <cmath>

#include <doctest/doctest.h>

using namespace traceur::learn;
using doctest::Approx;
using traceur::core::RandomStream;

TEST_CASE("clips that have not been tried are drawn evenly") {
  const PrioritizedClips clips(4);
  for (int i = 0; i < 4; ++i) CHECK(clips.probability(i) == Approx(0.25));
}

TEST_CASE("a failure rate is a moving average of weight 0.01") {
  PrioritizedClips clips(2);
  for (int i = 0; i < 50; ++i) clips.record(1, false);
  CHECK(clips.failure_rate(0) == 1);
  CHECK(clips.failure_rate(1) == Approx(std::pow(0.99, 50)));
  clips.record(1, true);
  CHECK(clips.failure_rate(1) == Approx(0.99 * std::pow(0.99, 50) + 0.01));
}

TEST_CASE("a mastered clip keeps the floor's weight") {
  PrioritizedClips clips(2);
  for (int i = 0; i < 5000; ++i) clips.record(0, false);
  CHECK(clips.failure_rate(0) < 1e-10);
  CHECK(clips.probability(0) == Approx(0.01 / 1.01));
}

TEST_CASE("clips come up as often as their probability says") {
  PrioritizedClips clips(3, 0.01, 0.5);
  clips.record(0, false);
  for (int i = 0; i < 10; ++i) clips.record(1, false);
  int count[3] = {0, 0, 0};
  const int n = 20000;
  for (int i = 0; i < n; ++i) {
    RandomStream random(1, static_cast<std::uint64_t>(i));
    ++count[clips.sample(random)];
  }
  for (int i = 0; i < 3; ++i) {
    const double p = clips.probability(i);
    CHECK(std::abs(count[i] / static_cast<double>(n) - p) < 4 * std::sqrt(p * (1 - p) / n));
  }
}

TEST_CASE("the state restores the sampler") {
  PrioritizedClips clips(3), other(3);
  clips.record(1, false);
  std::copy(clips.state().begin(), clips.state().end(), other.state().begin());
  CHECK(other.probability(1) == clips.probability(1));
}

TEST_CASE("senseless settings are refused") {
  CHECK_THROWS_WITH_AS(PrioritizedClips(0), "prioritized clips: expected at least one clip, got 0", traceur::Error);
  CHECK_THROWS_AS(PrioritizedClips(2, 0), traceur::Error);
  CHECK_THROWS_AS(PrioritizedClips(2, 0.01, 2), traceur::Error);
}
