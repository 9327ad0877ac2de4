// SPDX-License-Identifier: MIT
#pragma once

#include <cassert>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <limits>
#include <string>
#include <type_traits>

#include <Eigen/Core>

#include <traceur/core/error.hpp>
#include <traceur/core/pack.hpp>
#include <traceur/nn/module.hpp>
#include <traceur/nn/product.hpp>

namespace traceur::nn {

/// Parameters, gradients and the like: one number after the other. A view onto an Eigen vector or a map.
template <class S>
using Flat = std::type_identity_t<Eigen::Ref<Eigen::Matrix<S, Eigen::Dynamic, 1>>>;

template <class S>
using ConstFlat = std::type_identity_t<Eigen::Ref<const Eigen::Matrix<S, Eigen::Dynamic, 1>>>;

/// Moves parameters against their gradient. Laws the compiler cannot check: a step allocates nothing, is a function of
/// (theta, gradient, rate, state) alone, and treats every parameter the same whatever the others are. `state()` and
/// `steps()` are all there is to save; after `restore`, which throws Error for a state of the wrong length or with a
/// number that is not finite, the optimizer goes on to the same bits.
template <class O, class S = float>
concept Optimizer = requires(O& optimizer, const O& constant, Flat<S> theta, ConstFlat<S> gradient, double rate) {
  { optimizer.step(theta, gradient, rate) } -> std::same_as<void>;
  { constant.size() }
  noexcept->std::same_as<Eigen::Index>;
  { constant.steps() }
  noexcept->std::same_as<std::int64_t>;
  { constant.state() } -> std::convertible_to<ConstFlat<S>>;
  { optimizer.restore(gradient, constant.steps()) } -> std::same_as<void>;
};

namespace detail {

/// Calls f(load, store) for every register of n numbers: `load(from)` reads there, `store(to, pack)` writes there.
template <class S, class F>
[[gnu::always_inline]] inline void for_each_register(Eigen::Index n, F&& f) noexcept {
  using P = core::Pack<S>;
  Eigen::Index i = 0;
  for (; i + P::width <= n; i += P::width) {
    f(
        [i](const S* from) __attribute__((always_inline)) { return P::load(from + i); },
        [i](S * to, const P& p) __attribute__((always_inline)) { p.store(to + i); });
  }
  if (const Eigen::Index left = n - i; left > 0) {
    f(
        [ i, left ](const S* from) __attribute__((always_inline)) { return P(load_part<S>(from + i, left)); },
        [ i, left ](S * to, const P& p) __attribute__((always_inline)) { store_part<S>(to + i, p.v, left); });
  }
}

template <class S>
void restore_state(const char* what, Flat<S> state, ConstFlat<S> from, std::int64_t steps) {
  if (from.size() != state.size()) {
    throw Error(std::string(what) + " state: expected " + std::to_string(state.size()) + " numbers, got " +
                std::to_string(from.size()));
  }
  if (steps < 0) throw Error(std::string(what) + " state: expected 0 steps or more, got " + std::to_string(steps));
  for (Eigen::Index i = 0; i < from.size(); ++i) {
    if (!std::isfinite(from[i]))
      throw Error(std::string(what) + " state: number " + std::to_string(i) + " is not finite");
  }
  state = from;
}

inline void check_range(const char* what, double value, double low, double high) {
  if (!(value >= low && value < high)) {
    throw Error(std::string(what) + ": expected at least " + std::to_string(low) + " and less than " +
                std::to_string(high) + ", got " + std::to_string(value));
  }
}

}  // namespace detail

struct SgdParameters {
  double momentum = 0.9;      ///< in [0, 1)
  double weight_decay = 0.0;  ///< >= 0, added to the gradient times theta (L2 regularisation)
};

/// Gradient descent with momentum: v <- momentum v + g, theta <- theta - rate v.
template <class S>
class Sgd {
public:
  /// For `size` parameters. Throws Error if a setting is out of its range.
  explicit Sgd(Eigen::Index size, SgdParameters parameters = {}) : parameters_(parameters) {
    detail::check_positive("sgd", "parameter", size);
    detail::check_range("sgd momentum", parameters.momentum, 0.0, 1.0);
    detail::check_range("sgd weight decay", parameters.weight_decay, 0.0, 1e30);
    velocity_.setZero(size);
  }

  void step(Flat<S> theta, ConstFlat<S> gradient, double rate) noexcept {
    assert(theta.size() == size() && gradient.size() == size());
    using P = core::Pack<S>;
    const P momentum(parameters_.momentum), decay(parameters_.weight_decay), r(rate);
    S* const v = velocity_.data();
    detail::for_each_register<S>(
        size(), [&](auto load, auto store) __attribute__((always_inline)) {
          const P x = load(theta.data());
          const P velocity = momentum * load(v) + (load(gradient.data()) + decay * x);
          store(v, velocity);
          store(theta.data(), x - r * velocity);
        });
    ++steps_;
  }

  Eigen::Index size() const noexcept { return velocity_.size(); }
  std::int64_t steps() const noexcept { return steps_; }
  const Eigen::Matrix<S, Eigen::Dynamic, 1>& state() const noexcept { return velocity_; }
  void restore(ConstFlat<S> state, std::int64_t steps) {
    detail::restore_state<S>("sgd", velocity_, state, steps);
    steps_ = steps;
  }

private:
  SgdParameters parameters_;
  Eigen::Matrix<S, Eigen::Dynamic, 1> velocity_;
  std::int64_t steps_ = 0;
};

struct AdamParameters {
  double beta1 = 0.9;         ///< memory of the mean of the gradient, in [0, 1)
  double beta2 = 0.999;       ///< memory of its mean square, in [0, 1)
  double epsilon = 1e-8;      ///< > 0, added to the root of the mean square
  double weight_decay = 0.0;  ///< >= 0; theta shrinks by rate * weight_decay a step, decoupled from the gradient
};

/// Adam: Kingma and Ba, "Adam: A Method for Stochastic Optimization" (2015), algorithm 1. With `weight_decay` > 0
/// AdamW: Loshchilov and Hutter, "Decoupled Weight Decay Regularization" (2019), algorithm 2. On theta, gradient g and
/// step t >= 1:
///
///     m <- beta1 m + (1 - beta1) g,  v <- beta2 v + (1 - beta2) g^2
///     theta <- theta - rate (m / (1 - beta1^t) / (sqrt(v / (1 - beta2^t)) + epsilon) + weight_decay theta)
template <class S>
class Adam {
public:
  /// For `size` parameters. Throws Error if a setting is out of its range.
  explicit Adam(Eigen::Index size, AdamParameters parameters = {}) : parameters_(parameters) {
    detail::check_positive("adam", "parameter", size);
    detail::check_range("adam beta1", parameters.beta1, 0.0, 1.0);
    detail::check_range("adam beta2", parameters.beta2, 0.0, 1.0);
    if (!(parameters.epsilon > 0.0))
      throw Error("adam epsilon: expected more than 0, got " + std::to_string(parameters.epsilon));
    detail::check_range("adam weight decay", parameters.weight_decay, 0.0, 1e30);
    moments_.setZero(2 * size);
  }

  void step(Flat<S> theta, ConstFlat<S> gradient, double rate) noexcept {
    assert(theta.size() == size() && gradient.size() == size());
    using P = core::Pack<S>;
    ++steps_;
    const double t = static_cast<double>(steps_);
    const double correction1 = 1.0 - std::pow(parameters_.beta1, t), correction2 = 1.0 - std::pow(parameters_.beta2, t);
    const P beta1(parameters_.beta1), rest1(1.0 - parameters_.beta1);
    const P beta2(parameters_.beta2), rest2(1.0 - parameters_.beta2);
    // The corrections are moved out of the loop: both sides of the fraction are multiplied by sqrt(1 - beta2^t).
    const P scale(rate * std::sqrt(correction2) / correction1), epsilon(parameters_.epsilon * std::sqrt(correction2));
    const P keep(1.0 - rate * parameters_.weight_decay);
    // The moments of a unit that is never active fade into denormal numbers, which processors work on slowly.
    const P least(1e8 * static_cast<double>(std::numeric_limits<S>::min())), none(0.0);
    S* const first = moments_.data();
    S* const second = first + size();
    detail::for_each_register<S>(
        size(), [&](auto load, auto store) __attribute__((always_inline)) {
          const P g = load(gradient.data());
          P m = beta1 * load(first) + rest1 * g;
          P v = beta2 * load(second) + rest2 * g * g;
          m = select((m < least) & (-m < least), none, m);
          v = select(v < least, none, v);
          store(first, m);
          store(second, v);
          store(theta.data(), keep * load(theta.data()) - scale * m / (sqrt(v) + epsilon));
        });
  }

  Eigen::Index size() const noexcept { return moments_.size() / 2; }
  std::int64_t steps() const noexcept { return steps_; }
  /// The means, then the mean squares.
  const Eigen::Matrix<S, Eigen::Dynamic, 1>& state() const noexcept { return moments_; }
  void restore(ConstFlat<S> state, std::int64_t steps) {
    detail::restore_state<S>("adam", moments_, state, steps);
    steps_ = steps;
  }

private:
  AdamParameters parameters_;
  Eigen::Matrix<S, Eigen::Dynamic, 1> moments_;
  std::int64_t steps_ = 0;
};

/// The Euclidean length of `size` numbers, summed in double in a fixed order, whatever their alignment.
template <class S>
double global_norm(const S* values, Eigen::Index size) noexcept {
  double sums[8] = {};
  Eigen::Index i = 0;
  for (; i + 8 <= size; i += 8) {
    for (int k = 0; k < 8; ++k) sums[k] += static_cast<double>(values[i + k]) * static_cast<double>(values[i + k]);
  }
  for (; i < size; ++i) sums[i % 8] += static_cast<double>(values[i]) * static_cast<double>(values[i]);
  return std::sqrt(((sums[0] + sums[4]) + (sums[2] + sums[6])) + ((sums[1] + sums[5]) + (sums[3] + sums[7])));
}

/// Scales a gradient down to a length of `max_norm` > 0 if it is longer (Pascanu, Mikolov and Bengio 2013, algorithm
/// 1), and returns the length it had. If that is not finite the gradient is left as it is, and is not fit for a step.
template <class S>
double clip_global_norm(S* gradient, Eigen::Index size, double max_norm) noexcept {
  const double length = global_norm(gradient, size);
  if (!(length > max_norm) || !std::isfinite(length)) return length;
  const S scale = static_cast<S>(max_norm / length);
  for (Eigen::Index i = 0; i < size; ++i) gradient[i] *= scale;
  return length;
}

/// An exponential moving average of parameters, a <- decay a + (1 - decay) theta, smoother than the last ones.
template <class S>
class ExponentialAverage {
public:
  /// Starts at `theta`. Throws Error unless 0 <= decay < 1.
  ExponentialAverage(ConstFlat<S> theta, double decay) : average_(theta), decay_(decay) {
    detail::check_range("exponential average decay", decay, 0.0, 1.0);
  }

  void update(ConstFlat<S> theta) noexcept {
    assert(theta.size() == average_.size());
    using P = core::Pack<S>;
    const P rest(1.0 - decay_);
    S* const a = average_.data();
    detail::for_each_register<S>(
        average_.size(), [&](auto load, auto store) __attribute__((always_inline)) {
          const P old = load(a);
          store(a, old + rest * (load(theta.data()) - old));
        });
  }

  const Eigen::Matrix<S, Eigen::Dynamic, 1>& value() const noexcept { return average_; }
  void restore(ConstFlat<S> value) { detail::restore_state<S>("exponential average", average_, value, 0); }

private:
  Eigen::Matrix<S, Eigen::Dynamic, 1> average_;
  double decay_;
};

}  // namespace traceur::nn
