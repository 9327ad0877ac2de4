// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "traceur/core/error.hpp"
#include "traceur/core/random.hpp"

namespace traceur::evaluate {

/// A number found in an experiment and the interval that is to hold the true one.
struct Interval {
  double estimate = 0;
  double low = 0, high = 0;
};

namespace detail {

inline void require_level(double level) {
  if (!(level > 0 && level < 1)) throw Error("confidence: expected a level between 0 and 1");
}

/// The share q of the way through sorted values, linear between them.
inline double quantile(std::span<const double> sorted, double q) {
  const double at = q * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<std::size_t>(at);
  const std::size_t above = std::min(below + 1, sorted.size() - 1);
  return sorted[below] + (at - static_cast<double>(below)) * (sorted[above] - sorted[below]);
}

}  // namespace detail

/// The z with which a standard normal number is below z with probability p in (0, 1). Error below 1e-12 for p in
/// [1e-12, 1 - 1e-12].
inline double normal_quantile(double p) {
  if (!(p > 0 && p < 1)) throw Error("normal quantile: expected a probability between 0 and 1");
  // By symmetry in the tail that keeps its digits.
  const bool upper = p > 0.5;
  const double tail = upper ? 1 - p : p;
  double low = 0, high = 40;
  for (int k = 0; k < 80; ++k) {
    const double middle = 0.5 * (low + high);
    (0.5 * std::erfc(middle / std::numbers::sqrt2) > tail ? low : high) = middle;
  }
  return upper ? low : -low;
}

/// Wilson's score interval for a proportion (Wilson 1927): the p at which the share seen is z standard errors off,
///
///     (s + z^2 / 2 +- z sqrt(s (n - s) / n + z^2 / 4)) / (n + z^2).
///
/// Unlike the textbook's p +- z sqrt(p (1 - p) / n) it stays within [0, 1], is not empty for 0 or n successes and holds
/// the true share about as often as it says from a few trials on. Throws Error without trials or with more successes
/// than trials.
inline Interval wilson_interval(std::int64_t successes, std::int64_t trials, double level = 0.95) {
  detail::require_level(level);
  if (trials < 1 || successes < 0 || successes > trials)
    throw Error("Wilson interval: expected 0 <= successes <= trials and at least one trial, found " +
                std::to_string(successes) + " of " + std::to_string(trials));
  const double z = normal_quantile(0.5 + 0.5 * level);
  const double s = static_cast<double>(successes), n = static_cast<double>(trials);
  const double middle = s + 0.5 * z * z, half = z * std::sqrt(s * (n - s) / n + 0.25 * z * z);
  return {s / n, successes == 0 ? 0 : std::max((middle - half) / (n + z * z), 0.0),
          successes == trials ? 1 : std::min((middle + half) / (n + z * z), 1.0)};
}

/// How a bootstrap is done.
struct Bootstrap {
  double level = 0.95;
  int resamples = 2000;
  std::uint64_t seed = 0;
};

/// The percentile bootstrap (Efron 1979) of any statistic of a sample, a callable std::span<const double> -> double:
/// the statistic of samples of the same size drawn from the values with replacement, and of those the middle `level`.
/// Resample r draws from stream r of the seed, so the interval is a function of values, statistic and parameters.
///
/// With fewer than some ten values it is too narrow. Throws Error on an empty sample, a value that is not finite, or
/// fewer than two resamples.
template <class Statistic>
inline Interval bootstrap_interval(std::span<const double> values, Statistic&& statistic, const Bootstrap& p = {}) {
  detail::require_level(p.level);
  if (values.empty()) throw Error("bootstrap: expected at least one value");
  if (p.resamples < 2) throw Error("bootstrap: expected at least two resamples");
  for (std::size_t k = 0; k < values.size(); ++k)
    if (!std::isfinite(values[k])) throw Error("bootstrap: value " + std::to_string(k) + " is not finite");
  std::vector<double> sample(values.size()), found(static_cast<std::size_t>(p.resamples));
  const auto n = static_cast<std::uint32_t>(values.size());
  for (std::size_t r = 0; r < found.size(); ++r) {
    core::RandomStream random(p.seed, r);
    for (double& x : sample) x = values[random.below(n)];
    found[r] = statistic(std::span<const double>(sample));
  }
  std::sort(found.begin(), found.end());
  return {statistic(values), detail::quantile(found, 0.5 - 0.5 * p.level),
          detail::quantile(found, 0.5 + 0.5 * p.level)};
}

/// The mean of values and its percentile bootstrap interval.
inline Interval mean_interval(std::span<const double> values, const Bootstrap& p = {}) {
  return bootstrap_interval(
      values,
      [](std::span<const double> x) {
        double sum = 0;
        for (const double value : x) sum += value;
        return sum / static_cast<double>(x.size());
      },
      p);
}

}  // namespace traceur::evaluate
