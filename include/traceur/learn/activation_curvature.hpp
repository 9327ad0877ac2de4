// SPDX-License-Identifier: MIT
#pragma once

#include <concepts>
#include <ratio>

#include "traceur/nn/activation.hpp"

namespace traceur::learn {

/// The second derivative of an activation, for gradients of gradients: `curved` tells whether it is ever other than zero,
/// `second(kept)` gives it for packs from what the activation's `derivative` reads, the output or the value before.
template <class A>
struct ActivationCurvature;

namespace detail {

struct Straight {
  static constexpr bool curved = false;
  template <class P>
  [[gnu::always_inline]] static P second(const P&) {
    return P(0);
  }
};

}  // namespace detail

template <>
struct ActivationCurvature<nn::Identity> : detail::Straight {};
/// Almost everywhere; the kink has no weight.
template <>
struct ActivationCurvature<nn::Relu> : detail::Straight {};
template <class Slope>
struct ActivationCurvature<nn::LeakyRelu<Slope>> : detail::Straight {};

template <>
struct ActivationCurvature<nn::Tanh> {
  static constexpr bool curved = true;
  template <class P>
  [[gnu::always_inline]] static P second(const P& y) {
    return P(-2) * y * (P(1) - y * y);
  }
};

template <>
struct ActivationCurvature<nn::Sigmoid> {
  static constexpr bool curved = true;
  template <class P>
  [[gnu::always_inline]] static P second(const P& y) {
    return y * (P(1) - y) * (P(1) - y - y);
  }
};

template <>
struct ActivationCurvature<nn::Silu> {
  static constexpr bool curved = true;
  template <class P>
  [[gnu::always_inline]] static P second(const P& z) {
    const P s = nn::logistic(z);
    return s * (P(1) - s) * (P(2) + z * (P(1) - s - s));
  }
};

template <>
struct ActivationCurvature<nn::Gelu> {
  static constexpr bool curved = true;
  template <class P>
  [[gnu::always_inline]] static P second(const P& z) {
    return nn::bounded_exp(P(-0.5) * z * z) * P(0.39894228040143267794) * (P(2) - z * z);
  }
};

/// What the gradient of a gradient can be taken through.
template <class A, class S = float>
concept TwiceDifferentiable = nn::Activation<A, S> && requires(const core::Pack<S>& z) {
  { ActivationCurvature<A>::curved } -> std::convertible_to<bool>;
  { ActivationCurvature<A>::second(z) } -> std::same_as<core::Pack<S>>;
};

}  // namespace traceur::learn
