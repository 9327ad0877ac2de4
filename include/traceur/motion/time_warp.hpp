// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "traceur/motion/clip.hpp"

namespace traceur::motion {

/// A strictly increasing, piecewise linear map from time t to reference time phi, both in s and both 0 at the start.
///
/// Built from time increments it is Lee et al. 2021, Eq. 3: phi_i = sum over k < i of exp(tau_k). The paper counts reference
/// time in control steps; here the sum is multiplied by the step, so that tau = 0 is the identity. exp keeps every increment
/// positive: no tau makes time stall or run backwards. Beyond its knots the warp goes on at the rate of its end intervals,
/// so it has an inverse everywhere. `S`: `double`, or a dual number for derivatives with respect to tau.
template <class S = double>
class TimeWarp {
 public:
  using Vector = Eigen::Matrix<S, Eigen::Dynamic, 1>;

  /// Knots every `dt` seconds. Throws Error that names the increment at fault if exp(tau_k) is so large or small that phi
  /// is no longer finite or no longer grows, if tau is empty, or if dt is not positive.
  TimeWarp(const Vector& tau, double dt) {
    if (tau.size() == 0) throw Error("time warp: expected at least one time increment");
    if (!(dt > 0) || !std::isfinite(dt)) throw Error("time warp: expected a positive step");
    using std::exp;
    times_.resize(tau.size() + 1);
    phases_.resize(tau.size() + 1);
    times_[0] = S(0.0);
    phases_[0] = S(0.0);
    for (Eigen::Index k = 0; k < tau.size(); ++k) {
      times_[k + 1] = S(dt * static_cast<double>(k + 1));
      phases_[k + 1] = phases_[k] + S(dt) * S(exp(tau[k]));
    }
    check();
  }

  /// The warp through the given knots; both start at 0 and increase strictly. Throws Error otherwise.
  static TimeWarp through(Vector times, Vector phases) {
    TimeWarp warp;
    warp.times_ = std::move(times);
    warp.phases_ = std::move(phases);
    warp.check();
    return warp;
  }

  const Vector& times() const { return times_; }
  const Vector& phases() const { return phases_; }
  S duration() const { return times_[times_.size() - 1]; }

  /// log of d phi / d t on each interval: the time increments tau of a warp built from them.
  Vector log_rates() const {
    using std::log;
    Vector tau(times_.size() - 1);
    for (Eigen::Index k = 0; k < tau.size(); ++k)
      tau[k] = log((phases_[k + 1] - phases_[k]) / (times_[k + 1] - times_[k]));
    return tau;
  }

  /// Reference time at time t.
  S phase(const S& t) const { return along(times_, phases_, t); }
  /// Time at reference time phi: the exact inverse of `phase`.
  S time(const S& phi) const { return along(phases_, times_, phi); }
  TimeWarp inverse() const { return through(phases_, times_); }

 private:
  TimeWarp() = default;

  void check() const {
    if (times_.size() != phases_.size() || times_.size() < 2)
      throw Error("time warp: expected as many phases as times, at least two of each");
    if (core::plain(times_[0]) != 0 || core::plain(phases_[0]) != 0)
      throw Error("time warp: expected time and phase to start at 0");
    for (Eigen::Index k = 0; k + 1 < times_.size(); ++k) {
      const double t = core::plain(times_[k + 1]), phi = core::plain(phases_[k + 1]);
      if (!std::isfinite(t) || !std::isfinite(phi) || !(t > core::plain(times_[k])) || !(phi > core::plain(phases_[k])))
        throw Error("time warp: increment " + std::to_string(k) + ": expected time and phase to be finite and to increase");
    }
  }

  static S along(const Vector& x, const Vector& y, const S& at) {
    const auto before = [](double value, const S& knot) { return value < core::plain(knot); };
    const S* upper = std::upper_bound(x.data() + 1, x.data() + x.size() - 1, core::plain(at), before);
    const Eigen::Index k = upper - x.data() - 1;
    return y[k] + (y[k + 1] - y[k]) * ((at - x[k]) / (x[k + 1] - x[k]));
  }

  Vector times_;
  Vector phases_;
};

/// The clip played along a warp, m(t) = clip(phi(t)) for t in [0, warp.duration()]. Exact: keys at the warp's knots and
/// where it passes the clip's keys, and both maps are linear in between. The result is cyclic when the clip is and the warp
/// spans a whole number of its cycles.
inline Clip warp(const Clip& clip, const TimeWarp<double>& w) {
  const double end = w.duration(), last_phase = w.phases()[w.phases().size() - 1], cycle = clip.duration();
  const double cycles = last_phase / cycle;
  if (!(cycles < 1e6)) throw Error(detail::where(clip) + ": time warp spans more than a million cycles");
  const double whole = std::round(cycles);
  const bool closes = clip.cyclic && whole >= 1 && std::abs(cycles - whole) < 1e-9 * whole;
  std::vector<double> times(w.times().data(), w.times().data() + w.times().size());
  const int repeats = clip.cyclic ? static_cast<int>(std::ceil(cycles)) : 1;
  for (int c = 0; c < repeats; ++c)
    for (int k = 0; k < clip.keys(); ++k) {
      const double phi = clip.times[k] + c * cycle;
      if (phi < last_phase) times.push_back(w.time(phi));
    }
  const Eigen::VectorXd keys = detail::key_times(std::move(times), end);
  Eigen::VectorXd phases(keys.size());
  for (Eigen::Index k = 0; k < keys.size(); ++k) phases[k] = w.phase(keys[k]);
  // One cycle ends on the clip's own last key rather than on the first key of the next.
  const bool wrap = clip.cyclic && !(closes && whole == 1);
  Clip out = detail::sampled(clip, keys, phases, wrap);
  out.cyclic = closes;
  return out;
}

}  // namespace traceur::motion
