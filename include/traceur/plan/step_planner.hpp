// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <numbers>
#include <span>
#include <string>
#include <vector>

#include "traceur/core/error.hpp"

namespace traceur::plan {

/// How far a running step leads at speed v, l = slope v + offset (Terrain Runner s6, Figure 6; turning does not
/// matter).
template <std::floating_point S = double>
struct StepLength {
  S slope = S(0.2);    ///< m per m/s
  S offset = S(0.17);  ///< m

  S operator()(S speed) const { return slope * speed + offset; }

  /// The least-squares line through runs: speeds (m/s) and the mean lengths of their steps (m). Throws Error if the two
  /// differ in number, a number is not finite, or fewer than two speeds differ.
  static StepLength fit(std::span<const S> speeds, std::span<const S> lengths) {
    if (speeds.size() != lengths.size())
      throw Error("step length: expected a length for each of " + std::to_string(speeds.size()) + " speeds, found " +
                  std::to_string(lengths.size()));
    const S n = static_cast<S>(speeds.size());
    S mean_v = 0, mean_l = 0;
    for (std::size_t k = 0; k < speeds.size(); ++k) {
      if (!std::isfinite(speeds[k]) || !std::isfinite(lengths[k]))
        throw Error("step length: run " + std::to_string(k) + " is not finite");
      mean_v += speeds[k] / n;
      mean_l += lengths[k] / n;
    }
    S vv = 0, vl = 0, size = 0;
    for (std::size_t k = 0; k < speeds.size(); ++k) {
      const S v = speeds[k] - mean_v;
      vv += v * v;
      vl += v * (lengths[k] - mean_l);
      size += speeds[k] * speeds[k];
    }
    if (!(vv > S(1e-10) * size)) throw Error("step length: expected runs at two speeds or more");
    return {vl / vv, mean_l - vl / vv * mean_v};
  }

  /// Root mean square of what the line leaves of the runs it is given, m.
  S residual(std::span<const S> speeds, std::span<const S> lengths) const {
    S sum = 0;
    for (std::size_t k = 0; k < speeds.size(); ++k) {
      const S d = lengths[k] - (*this)(speeds[k]);
      sum += d * d;
    }
    return speeds.empty() ? S(0) : std::sqrt(sum / static_cast<S>(speeds.size()));
  }
};

/// What a manoeuvre wants of the run that leads up to it.
template <std::floating_point S = double>
struct Approach {
  S distance = 0;  ///< u_h, m, from the obstacle when the manoeuvre begins
  S speed = 0;     ///< v_in, m/s
};

/// The speeds of the steps up to an obstacle.
template <std::floating_point S = double>
struct StepPlan {
  std::span<const S> speeds;  ///< v_1 ... v_n, m/s; the last is the manoeuvre's
  S distance = 0;             ///< u, m, from the obstacle after the last step
  S cost = 0;                 ///< Eq. 15
};

/// Speeds for the steps up to the next obstacle (Terrain Runner s6), made anew at every step. The obstacles behind it
/// are not seen.
///
/// With n steps left, speed v_0 now and the distance d to the obstacle, Eq. 15 is
///
///     min  w_a (u - u_h)^2 + sum_i w_i (v_i - v_(i-1))^2,   u = d - sum_i l(v_i),   v_n = v_in,   i = 1 ... n.
///
/// In the changes x_i = v_i - v_(i-1), of which c_i = n - i + 1 steps feel the i-th, the constraint is sum x_i = v_in -
/// v_0 = D, and u - u_h = r - a sum c_i x_i with r = d - u_h - n (b + a v_0) for l = a v + b. The minimum is where x_i
/// = (m + s c_i) / w_i. With P_k = sum c_i^k / w_i,
///
///     s = w_a a (r - a D P_1 / P_0) / (1 + w_a a^2 (P_2 - P_1^2 / P_0)),   m = (D - s P_1) / P_0.
template <std::floating_point S = double>
class StepPlanner {
public:
  struct Parameters {
    StepLength<S> length;
    S distance_weight = S(1);  ///< w_a, 1/m^2
    S change_weight = S(1);    ///< w_i of all steps but the first, (s/m)^2
    S first_weight = S(1);     ///< w_1: more makes the next step more like the last
    int most_steps = 256;      ///< farther obstacles are approached as if this many steps away from them
  };

  StepPlanner() : StepPlanner(Parameters{}) {}

  /// Throws Error on a weight that is not positive (that of the distance may be zero) or a number of steps below one.
  explicit StepPlanner(const Parameters& parameters) : parameters_(parameters) {
    const Parameters& p = parameters_;
    if (!(p.distance_weight >= 0 && p.change_weight > 0 && p.first_weight > 0))
      throw Error("step planner: expected weights above zero");
    if (p.most_steps < 1) throw Error("step planner: expected room for at least one step");
    if (!std::isfinite(p.length.slope) || !std::isfinite(p.length.offset))
      throw Error("step planner: step length is not finite");
    speeds_.resize(static_cast<std::size_t>(p.most_steps));
  }

  const Parameters& parameters() const { return parameters_; }

  /// The number of steps that lead to the approach's distance at the mean of the speeds now and then, rounded; 0 where
  /// the next step would lead more than half its length too far. `distance` is from the obstacle now, m.
  int steps(S distance, S speed, const Approach<S>& approach) const noexcept {
    const S length = parameters_.length(S(0.5) * (speed + approach.speed));
    const S ratio = (distance - approach.distance) / length;
    if (!(ratio >= S(0.5)) || !(length > 0)) return 0;
    return ratio < static_cast<S>(parameters_.most_steps) ? static_cast<int>(std::lround(ratio))
                                                          : parameters_.most_steps;
  }

  /// The cheapest plan of the estimated number of steps; without steps, the manoeuvre is to begin. Valid until the
  /// next.
  StepPlan<S> plan(S distance, S speed, const Approach<S>& approach) noexcept {
    return plan(distance, speed, approach, steps(distance, speed, approach));
  }

  /// The cheapest plan of a given number of steps, at most most_steps.
  StepPlan<S> plan(S distance, S speed, const Approach<S>& approach, int steps) noexcept {
    const Parameters& p = parameters_;
    const int n = std::clamp(steps, 0, p.most_steps);
    const S a = p.length.slope;
    S p0 = 0, p1 = 0, p2 = 0;
    for (int i = 0; i < n; ++i) {
      const S c = static_cast<S>(n - i), w = weight(i);
      p0 += 1 / w;
      p1 += c / w;
      p2 += c * c / w;
    }
    S s = 0, m = 0;
    if (n > 0) {
      const S change = approach.speed - speed;
      const S off = distance - approach.distance - static_cast<S>(n) * p.length(speed);
      s = p.distance_weight * a * (off - a * change * p1 / p0) / (1 + p.distance_weight * a * a * (p2 - p1 * p1 / p0));
      m = (change - s * p1) / p0;
    }
    StepPlan<S> out{{speeds_.data(), static_cast<std::size_t>(n)}, distance, S(0)};
    S v = speed;
    for (int i = 0; i < n; ++i) {
      const S before = v;
      // The last is met exactly, whatever rounding did on the way.
      v = i == n - 1 ? approach.speed : v + (m + s * static_cast<S>(n - i)) / weight(i);
      speeds_[static_cast<std::size_t>(i)] = v;
      out.distance -= p.length(v);
      out.cost += weight(i) * (v - before) * (v - before);
    }
    out.cost += p.distance_weight * (out.distance - approach.distance) * (out.distance - approach.distance);
    return out;
  }

private:
  S weight(int i) const noexcept { return i == 0 ? parameters_.first_weight : parameters_.change_weight; }

  Parameters parameters_;
  std::vector<S> speeds_;
};

/// Turns a runner so that it meets an obstacle square on (Terrain Runner s6, which gives no formula): it heads for a
/// point on the line of approach `lookahead` metres ahead of where it is abreast, turning at most `most_turn` in one
/// step.
template <std::floating_point S = double>
struct DirectionTracker {
  S most_turn = static_cast<S>(6 * std::numbers::pi / 180);  ///< rad per step, the range of the running controllers
  S lookahead = S(3);                                        ///< m; infinity to turn square without seeking the line

  /// By how much to turn in the next step, rad, counter-clockwise. `heading` is the runner's, `approach` that of the
  /// line, rad; `offset` is how far the runner is to the left of the line, m.
  S turn(S heading, S approach, S offset) const noexcept {
    const S wanted = approach - (std::isinf(lookahead) ? S(0) : std::atan2(offset, lookahead));
    return std::clamp(std::remainder(wanted - heading, static_cast<S>(2 * std::numbers::pi)), -most_turn, most_turn);
  }
};

}  // namespace traceur::plan
