// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <chrono>
#include <vector>

#include <benchmark/benchmark.h>

/// Times `ours` and `peer` in turn, `repeats` calls each, and counts as `ratio` the median of how often ours goes into the peer's
/// time; `lanes` is how much more one call of ours does.
template <class Ours, class Peer>
void in_turn(benchmark::State& state, int repeats, int lanes, Ours&& ours, Peer&& peer) {
  using Clock = std::chrono::steady_clock;
  std::vector<double> ratios;
  for (auto _ : state) {
    const auto begin = Clock::now();
    for (int i = 0; i < repeats; ++i) ours();
    const auto middle = Clock::now();
    for (int i = 0; i < repeats; ++i) peer();
    const auto end = Clock::now();
    ratios.push_back(static_cast<double>((end - middle).count()) * lanes / static_cast<double>((middle - begin).count()));
  }
  const auto median = ratios.begin() + static_cast<std::ptrdiff_t>(ratios.size() / 2);
  std::nth_element(ratios.begin(), median, ratios.end());
  state.counters["ratio"] = *median;
}
