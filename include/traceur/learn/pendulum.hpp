// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "traceur/core/pack.hpp"
#include "traceur/core/random.hpp"
#include "traceur/learn/environment.hpp"

namespace traceur::learn {

/// The constants of Gym's Pendulum-v1.
struct PendulumParameters {
  double dt = 0.05;         ///< s
  double gravity = 10;      ///< m/s^2
  double mass = 1;          ///< kg, a rod's
  double length = 1;        ///< m
  double max_torque = 2;    ///< N m; too weak to lift the rod without swinging
  double max_speed = 8;     ///< rad/s
  int episode_steps = 200;  ///< then the episode times out
};

/// Rods on motors that have to be swung up and held: equations, rewards and start states of Gym's Pendulum-v1, many at a
/// time. Angles are from the upright.
///
/// An observation is (cos, sin, rad/s); the action is the torque in units of `max_torque`, cut at +-1; a step earns
/// -(angle^2 + 0.1 speed^2 + 0.001 torque^2) of the state and torque it begins with. Episodes only ever time out.
template <class S = float>
class Pendulum {
 public:
  /// Throws Error unless there is at least one environment and the constants are positive.
  explicit Pendulum(Eigen::Index environments, const PendulumParameters& parameters = {})
      : parameters_(parameters), environments_(environments) {
    detail::check_at_least_one("pendulum", "environment", environments);
    detail::check_at_least_one("pendulum", "step in an episode", parameters.episode_steps);
    const PendulumParameters& p = parameters;
    if (!(p.dt > 0 && p.gravity > 0 && p.mass > 0 && p.length > 0 && p.max_torque > 0 && p.max_speed > 0))
      throw Error("pendulum: expected positive constants");
    packs_ = static_cast<std::size_t>((environments + P::width - 1) / P::width);
    for (auto* lanes : {&angle_, &speed_, &sin_, &cos_}) lanes->assign(packs_, P(0));
    age_.setZero(environments);
    episode_.setZero(environments);
    reset(0);
  }

  Eigen::Index environments() const noexcept { return environments_; }
  Eigen::Index observations() const noexcept { return 3; }
  Eigen::Index actions() const noexcept { return 1; }
  const PendulumParameters& parameters() const noexcept { return parameters_; }

  void reset(std::uint64_t seed) noexcept {
    seed_ = seed;
    episode_.setZero();
    for (Eigen::Index e = 0; e < environments_; ++e) restart(e);
  }

  /// Uniform over all angles, speed uniform in +-1 rad/s.
  void restart(Eigen::Index e) noexcept {
    core::RandomStream random(seed_, static_cast<std::uint64_t>(e), static_cast<std::uint64_t>(episode_[e]++));
    const double angle = random.uniform(-std::numbers::pi, std::numbers::pi);
    place(e, angle, random.uniform(-1.0, 1.0));
  }

  /// Puts environment e at an angle (rad) and speed (rad/s) at the start of an episode.
  void place(Eigen::Index e, double angle, double speed) noexcept {
    const auto [pack, lane] = at(e);
    angle_[pack].set(lane, static_cast<S>(std::remainder(angle, 2 * std::numbers::pi)));
    speed_[pack].set(lane, static_cast<S>(speed));
    sin_[pack].set(lane, static_cast<S>(std::sin(angle)));
    cos_[pack].set(lane, static_cast<S>(std::cos(angle)));
    age_[e] = 0;
  }

  S angle(Eigen::Index e) const noexcept { return angle_[at(e).pack][at(e).lane]; }
  S speed(Eigen::Index e) const noexcept { return speed_[at(e).pack][at(e).lane]; }

  void observe(Columns<S> out) const noexcept {
    for (Eigen::Index e = 0; e < environments_; ++e) {
      const auto [pack, lane] = at(e);
      out(0, e) = cos_[pack][lane];
      out(1, e) = sin_[pack][lane];
      out(2, e) = speed_[pack][lane];
    }
  }

  void step(ConstColumns<S> actions, StepResult<S>& result) noexcept {
    const PendulumParameters& p = parameters_;
    const S dt = static_cast<S>(p.dt), limit = static_cast<S>(p.max_torque);
    const P fall(static_cast<S>(1.5 * p.gravity / p.length * p.dt));
    const P push(static_cast<S>(3 / (p.mass * p.length * p.length) * p.dt));
    const P fastest(static_cast<S>(p.max_speed));
    const S turn = static_cast<S>(2 * std::numbers::pi);
    for (std::size_t k = 0; k < packs_; ++k) {
      const Eigen::Index first = static_cast<Eigen::Index>(k) * P::width;
      const int used = static_cast<int>(std::min<Eigen::Index>(P::width, environments_ - first));
      P torque(0);
      for (int i = 0; i < used; ++i) torque.set(i, actions(0, first + i));
      torque = P(limit) * core::clamp(torque, P(-1), P(1));
      const P cost = angle_[k] * angle_[k] + P(S(0.1)) * speed_[k] * speed_[k] + P(S(0.001)) * torque * torque;
      speed_[k] = core::clamp(speed_[k] + fall * sin_[k] + push * torque, -fastest, fastest);
      const P angle = angle_[k] + P(dt) * speed_[k];
      angle_[k] = angle - P(turn) * core::round(angle * P(S(1) / turn));
      const auto [sine, cosine] = core::sin_cos(angle_[k]);
      sin_[k] = sine;
      cos_[k] = cosine;
      for (int i = 0; i < used; ++i) result.reward[first + i] = -cost[i];
    }
    for (Eigen::Index e = 0; e < environments_; ++e)
      if (++age_[e] >= p.episode_steps) result.end[e] = End::timed_out;
  }

 private:
  using P = core::Pack<S>;
  struct Place {
    std::size_t pack;
    int lane;
  };
  static Place at(Eigen::Index e) noexcept {
    return {static_cast<std::size_t>(e / P::width), static_cast<int>(e % P::width)};
  }

  PendulumParameters parameters_;
  Eigen::Index environments_;
  std::size_t packs_ = 0;
  std::uint64_t seed_ = 0;
  std::vector<P> angle_, speed_, sin_, cos_;
  Eigen::VectorXi age_, episode_;
};

}  // namespace traceur::learn
