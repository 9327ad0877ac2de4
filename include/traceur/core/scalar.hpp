// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <concepts>
#include <type_traits>

namespace traceur::core {

/// `mask ? a : b`, element by element. The form for plain scalars and dual numbers, whose comparison yields `bool`, and for
/// vectors and quaternions of them.
template <class S>
[[gnu::always_inline]] inline S select(bool mask, const S& a, const S& b) {
  return mask ? a : b;
}

/// True when any element of the mask is set; a `bool` is a mask of one element.
[[gnu::always_inline]] inline bool any(bool mask) { return mask; }

/// True when every element of the mask is set; a `bool` is a mask of one element.
[[gnu::always_inline]] inline bool all(bool mask) { return mask; }

/// What an algorithm may ask of its scalar type. `float`, `double`, `ceres::Jet` and `Pack` are models.
///
/// Laws: `select(a < b, x, y)` is `x` in every element where `a < b` and `y` elsewhere; a NaN compares false. Code that
/// must branch per element uses `select`; code that branches for all of them asks `any(mask)` or `all(mask)`.
template <class S>
concept Scalar = std::copyable<S> && std::constructible_from<S, double> && requires(S a, const S b) {
  { b + b } -> std::convertible_to<S>;
  { b - b } -> std::convertible_to<S>;
  { b* b } -> std::convertible_to<S>;
  { b / b } -> std::convertible_to<S>;
  { -b } -> std::convertible_to<S>;
  a += b;
  a -= b;
  a *= b;
  a /= b;
  { select(b < b, b, b) } -> std::convertible_to<S>;
  { any(b < b) } -> std::same_as<bool>;
  { all(b <= b) } -> std::same_as<bool>;
};

/// The type of one element: `float` for `Pack<float, 16>`, the type itself otherwise.
template <class S>
struct ElementType {
  using type = S;
};
template <class S>
using Element = typename ElementType<S>::type;

/// The smaller of two, element by element; `b` where they do not compare.
template <Scalar S>
[[gnu::always_inline]] inline S min(const S& a, const S& b) {
  return select(a < b, a, b);
}

/// The larger of two, element by element; `b` where they do not compare.
template <Scalar S>
[[gnu::always_inline]] inline S max(const S& a, const S& b) {
  return select(b < a, a, b);
}

/// `x` limited to [low, high]; a NaN becomes `high`, so that a clamped value is always a safe index.
template <Scalar S>
[[gnu::always_inline]] inline S clamp(const S& x, const S& low, const S& high) {
  return max(min(x, high), low);
}

/// The plain part of a value: itself for a floating-point number, `.a` of a dual number.
template <class S>
[[gnu::always_inline]] inline auto plain(const S& x) {
  if constexpr (requires { x.a; }) {
    return plain(x.a);
  } else {
    return x;
  }
}

}  // namespace traceur::core
