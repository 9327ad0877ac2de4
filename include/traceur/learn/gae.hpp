// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>

#include "traceur/learn/environment.hpp"

namespace traceur::learn {

/// How the future counts. Both factors are per unit of the steps' duration: over a step of length d the future shrinks by
/// gamma^d and the look-ahead of the estimator by lambda^d (Lee et al. 2021, section 4.3).
struct Discount {
  double gamma = 0.99;   ///< in (0, 1]
  double lambda = 0.95;  ///< in [0, 1]: 0 trusts the value function, 1 trusts what was earned
};

/// The integral of gamma^u over u in [0, duration]: what a reward rate of 1 is worth at the start of the step. Exact also
/// where gamma is 1 or close to it.
inline double discounted_duration(double gamma, double duration) noexcept {
  const double rate = -std::log(gamma);
  return rate > 0 ? -std::expm1(-rate * duration) / rate : duration;
}

/// Steps of several environments: rows are steps in time order, columns environments. A matrix without columns stands for
/// its default, so plain fixed-step learning needs only `reward`, `value` and `end`.
template <class S>
struct Trajectories {
  ConstColumns<S> reward;           ///< spikes, earned at once at the start of the step
  ConstColumns<S> reward_rate;      ///< earned all through the step, per unit of duration; default 0
  ConstColumns<S> duration;         ///< default 1
  ConstColumns<S> value;            ///< estimated value of the state in which the step begins
  ConstColumns<S> timed_out_value;  ///< value of the state after a step that timed out; not read elsewhere
  ConstColumns<S> last_value;       ///< 1 x environments: value of the state after the last row; not read where that ended
  Eigen::Ref<const Eigen::Matrix<End, Eigen::Dynamic, Eigen::Dynamic>> end;
};

/// No entries: stands for the default of one of the `Trajectories`.
template <class S>
ConstColumns<S> none() noexcept {
  return ConstColumns<S>(Eigen::Map<const Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>>(nullptr, 0, 0));
}

namespace detail {

/// One step of one environment as the backward recursions need it.
struct StepTerms {
  double earned;      ///< discounted to the start of the step
  double gamma;       ///< over the step
  double lambda;      ///< over the step
  double value_next;  ///< of the state after it
  bool goes_on;       ///< whether the next row continues the episode
};

class StepReader {
 public:
  explicit StepReader(const Discount& discount)
      : discount_(discount), whole_(discounted_duration(discount.gamma, 1.0)) {}

  template <class S>
  StepTerms operator()(const Trajectories<S>& steps, Eigen::Index t, Eigen::Index e) const noexcept {
    StepTerms r{static_cast<double>(steps.reward(t, e)), discount_.gamma, discount_.lambda, 0.0, false};
    double whole = whole_;
    if (steps.duration.cols() != 0 && steps.duration(t, e) != S(1)) {
      const auto length = static_cast<double>(steps.duration(t, e));
      r.gamma = std::pow(discount_.gamma, length);
      r.lambda = std::pow(discount_.lambda, length);
      whole = discounted_duration(discount_.gamma, length);
    }
    if (steps.reward_rate.cols() != 0) r.earned += whole * static_cast<double>(steps.reward_rate(t, e));
    switch (steps.end(t, e)) {
      case End::running:
        r.goes_on = t + 1 < steps.value.rows();
        r.value_next = static_cast<double>(r.goes_on ? steps.value(t + 1, e) : steps.last_value(0, e));
        break;
      case End::timed_out:
        r.value_next = static_cast<double>(steps.timed_out_value(t, e));
        break;
      case End::terminated:
      case End::failed:
        break;
    }
    return r;
  }

 private:
  Discount discount_;
  double whole_;
};

}  // namespace detail

/// Generalised advantage estimation with steps of any length, Lee et al. 2021, Eq. 9:
///
///     delta = integral over the step of gamma^u R_c + R_s + gamma^d V' - V,   A = delta + (gamma lambda)^d A',
///
/// with R_c constant within a step. Equal steps of length 1 give Schulman et al. 2016, Eq. 16. A' is zero and V' is zero
/// after a termination, A' is zero and V' the value of the last state after a time-out and after the last row. A failed
/// step has A = 0: neither sought nor shunned. `advantage` has the shape of `steps.value` and may not be any of the inputs.
template <class S>
void generalized_advantage(const Discount& discount, const Trajectories<S>& steps, Columns<S> advantage) noexcept {
  const detail::StepReader read(discount);
  for (Eigen::Index e = 0; e < steps.value.cols(); ++e) {
    double next = 0;
    for (Eigen::Index t = steps.value.rows() - 1; t >= 0; --t) {
      const detail::StepTerms s = read(steps, t, e);
      const double delta = s.earned + s.gamma * s.value_next - static_cast<double>(steps.value(t, e));
      next = delta + (s.goes_on ? s.gamma * s.lambda * next : 0.0);
      if (steps.end(t, e) == End::failed) next = 0;
      advantage(t, e) = static_cast<S>(next);
    }
  }
}

/// The TD(lambda) return of every step, what the value function is fitted to:
///
///     G = integral over the step of gamma^u R_c + R_s + gamma^d ((1 - lambda^d) V' + lambda^d G'),
///
/// with V' alone after a time-out and after the last row, nothing after a termination, and G = V at a failed step. It is
/// A + V with the A of the same discount. lambda = 1 gives the discounted return.
template <class S>
void lambda_return(const Discount& discount, const Trajectories<S>& steps, Columns<S> target) noexcept {
  const detail::StepReader read(discount);
  for (Eigen::Index e = 0; e < steps.value.cols(); ++e) {
    double next = 0;
    for (Eigen::Index t = steps.value.rows() - 1; t >= 0; --t) {
      const detail::StepTerms s = read(steps, t, e);
      const double ahead = s.goes_on ? (1 - s.lambda) * s.value_next + s.lambda * next : s.value_next;
      next = steps.end(t, e) == End::failed ? static_cast<double>(steps.value(t, e)) : s.earned + s.gamma * ahead;
      target(t, e) = static_cast<S>(next);
    }
  }
}

}  // namespace traceur::learn
