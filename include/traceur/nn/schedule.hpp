// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <numbers>

namespace traceur::nn {

/// The learning rate of each step, a pure function of the number of steps taken before it, >= 0.
template <class R>
concept Schedule = requires(const R& rate, std::int64_t step) {
  { rate(step) }
  noexcept->std::same_as<double>;
};

/// The same rate at every step.
struct ConstantRate {
  double rate = 1e-3;
  double operator()(std::int64_t) const noexcept { return rate; }
};

/// From `first` at step 0 along a line to `last` at `steps`, and `last` ever after.
struct LinearRate {
  double first = 1e-3;
  double last = 0.0;
  std::int64_t steps = 1;  ///< >= 1
  double operator()(std::int64_t step) const noexcept {
    const double part = static_cast<double>(std::clamp<std::int64_t>(step, 0, steps)) / static_cast<double>(steps);
    return first + (last - first) * part;
  }
};

/// From `first` at step 0 along half a cosine to `last` at `steps`, and `last` ever after: Loshchilov and Hutter,
/// "SGDR: Stochastic Gradient Descent with Warm Restarts" (2017), eq. 5, without restarts.
struct CosineRate {
  double first = 1e-3;
  double last = 0.0;
  std::int64_t steps = 1;  ///< >= 1
  double operator()(std::int64_t step) const noexcept {
    const double part = static_cast<double>(std::clamp<std::int64_t>(step, 0, steps)) / static_cast<double>(steps);
    return last + 0.5 * (first - last) * (1.0 + std::cos(std::numbers::pi * part));
  }
};

/// Another schedule after a ramp: step k < `steps` has the fraction (k + 1) / (steps + 1) of its first rate, then it
/// starts.
template <Schedule After>
struct WarmUp {
  std::int64_t steps = 0;
  After after;
  double operator()(std::int64_t step) const noexcept {
    if (step >= steps) return after(step - steps);
    return after(0) * static_cast<double>(std::max<std::int64_t>(step, 0) + 1) / static_cast<double>(steps + 1);
  }
};

template <class After>
WarmUp(std::int64_t, After) -> WarmUp<After>;

}  // namespace traceur::nn
