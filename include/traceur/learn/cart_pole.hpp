// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <numbers>
#include <vector>

#include "traceur/core/pack.hpp"
#include "traceur/core/random.hpp"
#include "traceur/learn/environment.hpp"

namespace traceur::learn {

/// The constants of Gym's CartPole-v1.
struct CartPoleParameters {
  double dt = 0.02;                                  ///< s
  double gravity = 9.8;                              ///< m/s^2
  double cart_mass = 1;                              ///< kg
  double pole_mass = 0.1;                            ///< kg
  double half_length = 0.5;                          ///< of the pole, m
  double max_force = 10;                             ///< N
  double max_angle = 12 * std::numbers::pi / 180;    ///< rad; beyond it the pole has fallen
  double max_position = 2.4;                         ///< m; beyond it the cart has left the track
  int episode_steps = 500;                           ///< then the episode times out
};

/// Poles hinged on carts that have to be balanced: equations, rewards and start states of Gym's CartPole-v1, many at a time.
///
/// An observation is (m, m/s, rad, rad/s), the angle from the upright; every step begun upright earns 1. The action is the
/// force on the cart in units of `max_force`, cut at +-1, where Gym knows the two actions -1 and +1 only.
template <class S = float>
class CartPole {
 public:
  /// Throws Error unless there is at least one environment and the constants are positive.
  explicit CartPole(Eigen::Index environments, const CartPoleParameters& parameters = {})
      : parameters_(parameters), environments_(environments) {
    detail::check_at_least_one("cart-pole", "environment", environments);
    detail::check_at_least_one("cart-pole", "step in an episode", parameters.episode_steps);
    const CartPoleParameters& p = parameters;
    if (!(p.dt > 0 && p.gravity > 0 && p.cart_mass > 0 && p.pole_mass > 0 && p.half_length > 0 && p.max_force > 0 &&
          p.max_angle > 0 && p.max_position > 0))
      throw Error("cart-pole: expected positive constants");
    state_.assign(static_cast<std::size_t>((environments + P::width - 1) / P::width), {P(0), P(0), P(0), P(0)});
    age_.setZero(environments);
    episode_.setZero(environments);
    reset(0);
  }

  Eigen::Index environments() const noexcept { return environments_; }
  Eigen::Index observations() const noexcept { return 4; }
  Eigen::Index actions() const noexcept { return 1; }
  const CartPoleParameters& parameters() const noexcept { return parameters_; }

  void reset(std::uint64_t seed) noexcept {
    seed_ = seed;
    episode_.setZero();
    for (Eigen::Index e = 0; e < environments_; ++e) restart(e);
  }

  /// All four numbers uniform in +-0.05.
  void restart(Eigen::Index e) noexcept {
    core::RandomStream random(seed_, static_cast<std::uint64_t>(e), static_cast<std::uint64_t>(episode_[e]++));
    double s[4];
    for (double& x : s) x = random.uniform(-0.05, 0.05);
    place(e, s[0], s[1], s[2], s[3]);
  }

  /// Puts environment e into a state at the start of an episode: m, m/s, rad, rad/s.
  void place(Eigen::Index e, double position, double velocity, double angle, double rate) noexcept {
    const int lane = static_cast<int>(e % P::width);
    State& s = state_[static_cast<std::size_t>(e / P::width)];
    s.position.set(lane, static_cast<S>(position));
    s.velocity.set(lane, static_cast<S>(velocity));
    s.angle.set(lane, static_cast<S>(angle));
    s.rate.set(lane, static_cast<S>(rate));
    age_[e] = 0;
  }

  void observe(Columns<S> out) const noexcept {
    for (Eigen::Index e = 0; e < environments_; ++e) {
      const int lane = static_cast<int>(e % P::width);
      const State& s = state_[static_cast<std::size_t>(e / P::width)];
      out(0, e) = s.position[lane];
      out(1, e) = s.velocity[lane];
      out(2, e) = s.angle[lane];
      out(3, e) = s.rate[lane];
    }
  }

  /// Explicit Euler, as Gym's default.
  void step(ConstColumns<S> actions, StepResult<S>& result) noexcept {
    const CartPoleParameters& p = parameters_;
    const auto constant = [](double x) { return P(static_cast<S>(x)); };
    const P dt = constant(p.dt), share = constant(p.pole_mass / (p.cart_mass + p.pole_mass));
    const P moment = constant(p.pole_mass * p.half_length), inverse_mass = constant(1 / (p.cart_mass + p.pole_mass));
    for (std::size_t k = 0; k < state_.size(); ++k) {
      const Eigen::Index first = static_cast<Eigen::Index>(k) * P::width;
      const int used = static_cast<int>(std::min<Eigen::Index>(P::width, environments_ - first));
      P force(0);
      for (int i = 0; i < used; ++i) force.set(i, actions(0, first + i));
      force = constant(p.max_force) * core::clamp(force, P(-1), P(1));
      State& s = state_[k];
      const auto [sine, cosine] = core::sin_cos(s.angle);
      const P pushed = (force + moment * s.rate * s.rate * sine) * inverse_mass;
      const P turning = (constant(p.gravity) * sine - cosine * pushed) /
                        (constant(p.half_length) * (constant(4.0 / 3) - share * cosine * cosine));
      const P driving = pushed - moment * inverse_mass * turning * cosine;
      s.position += dt * s.velocity;
      s.velocity += dt * driving;
      s.angle += dt * s.rate;
      s.rate += dt * turning;
      const auto over =
          (core::abs(s.position) > constant(p.max_position)) | (core::abs(s.angle) > constant(p.max_angle));
      for (int i = 0; i < used; ++i) {
        const Eigen::Index e = first + i;
        result.reward[e] = S(1);
        if (++age_[e] >= p.episode_steps) result.end[e] = End::timed_out;
        if (over[i]) result.end[e] = End::terminated;
      }
    }
  }

 private:
  using P = core::Pack<S>;
  struct State {
    P position, velocity, angle, rate;
  };

  CartPoleParameters parameters_;
  Eigen::Index environments_;
  std::uint64_t seed_ = 0;
  std::vector<State> state_;
  Eigen::VectorXi age_, episode_;
};

}  // namespace traceur::learn
