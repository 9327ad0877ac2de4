// SPDX-License-Identifier: MIT
#pragma once

#include <cassert>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <numbers>
#include <ratio>
#include <type_traits>

#include <Eigen/Core>

#include <traceur/core/pack.hpp>
#include <traceur/nn/module.hpp>
#include <traceur/nn/product.hpp>

namespace traceur::nn {

/// A function applied to every element, as a type without state. `value(z)` maps packs of numbers; `derivative(kept)`
/// is d value / d z, read from the output value(z) if `reads_output`, else from z itself. NaN stays NaN in both. One of
/// few instructions may say `brief = true`: then its value is found where the sums of a product are.
template <class A, class S = float>
concept Activation = requires(const core::Pack<S>& z) {
  { A::reads_output } -> std::convertible_to<bool>;
  { A::value(z) } -> std::same_as<core::Pack<S>>;
  { A::derivative(z) } -> std::same_as<core::Pack<S>>;
};

/// exp(x) of each lane for x clamped to [-87, 88] (float) or [-708, 709] (double). Relative error below 2e-7 and 4e-16:
/// Cody-Waite reduction to |r| <= ln(2) / 2 and the Taylor polynomial of degree 7 and 13.
template <class T, int N>
[[gnu::always_inline]] inline core::Pack<T, N> bounded_exp(const core::Pack<T, N>& x) {
  using P = core::Pack<T, N>;
  using Integer = std::conditional_t<sizeof(T) == 4, std::uint32_t, std::uint64_t>;
  typedef Integer Bits __attribute__((vector_size(N * sizeof(T))));
  constexpr bool single = sizeof(T) == 4;
  const P low(single ? -87.0 : -708.0), high(single ? 88.0 : 709.0);
  const P bounded = select(x < low, low, select(x > high, high, x));
  // Adding 1.5 times the number of representable integers rounds, and leaves the integer in the lowest bits.
  const P rounder(single ? 0x1.8p23 : 0x1.8p52);
  const P shifted = bounded * P(std::numbers::log2e) + rounder;
  const P n = shifted - rounder;
  const P r = single ? (bounded - n * P(0.693359375)) - n * P(-2.12194440054690583e-4)
                     : (bounded - n * P(0x1.62e42fee00000p-1)) - n * P(1.90821492927058770002e-10);
  P p;
  if constexpr (single) {
    p = P(1) + r * (P(1) + r * (P(1.0 / 2) +
                                r * (P(1.0 / 6) +
                                     r * (P(1.0 / 24) + r * (P(1.0 / 120) + r * (P(1.0 / 720) + r * P(1.0 / 5040)))))));
  } else {
    const P tail = P(1.0 / 5040) +
                   r * (P(1.0 / 40320) +
                        r * (P(1.0 / 362880) +
                             r * (P(1.0 / 3628800) +
                                  r * (P(1.0 / 39916800) + r * (P(1.0 / 479001600.0) + r * P(1.0 / 6227020800.0))))));
    p = P(1) +
        r * (P(1) + r * (P(1.0 / 2) +
                         r * (P(1.0 / 6) + r * (P(1.0 / 24) + r * (P(1.0 / 120) + r * (P(1.0 / 720) + r * tail))))));
  }
  const Bits exponent = reinterpret_cast<Bits>(shifted.v) << (single ? 23 : 52);
  return P(reinterpret_cast<typename P::Vector>(reinterpret_cast<Bits>(p.v) + exponent));
}

/// tanh(x) of each lane. Relative error below 5e-7 (float) and 1e-15 (double): a convergent of Lambert's continued
/// fraction x / (1 + x^2 / (3 + x^2 / (5 + ...))) for |x| < 0.55, (e^2x - 1) / (e^2x + 1) above.
template <class T, int N>
[[gnu::always_inline]] inline core::Pack<T, N> tanh(const core::Pack<T, N>& x) {
  using P = core::Pack<T, N>;
  const auto negative = x < P(0);
  const P size = select(negative, -x, x);
  const P e = bounded_exp(size + size);
  const P q = x * x;
  P top, bottom;
  if constexpr (sizeof(T) == 4) {
    top = P(10395) + q * (P(1260) + q * P(21));
    bottom = P(10395) + q * (P(4725) + q * (P(210) + q));
  } else {
    top = P(2027025) + q * (P(270270) + q * (P(6930) + q * P(36)));
    bottom = P(2027025) + q * (P(945945) + q * (P(51975) + q * (P(630) + q)));
  }
  const auto small = size < P(0.55);
  const P large = select(negative, P(1) - e, e - P(1));
  return select(small, x * top, large) / select(small, bottom, e + P(1));
}

/// 1 / (1 + e^-x) of each lane; relative error below 5e-7 (float) and 1e-15 (double) for x > -87 and x > -708.
template <class T, int N>
[[gnu::always_inline]] inline core::Pack<T, N> logistic(const core::Pack<T, N>& x) {
  using P = core::Pack<T, N>;
  return P(1) / (P(1) + bounded_exp(-x));
}

namespace detail {

template <class P>
struct NormalCurve {
  P density, below;  ///< the standard normal density and its integral up to z
};

/// Absolute error of `below` under 2.5e-7 for float; the C library's erfc, lane by lane, for double.
template <class T, int N>
[[gnu::always_inline]] inline NormalCurve<core::Pack<T, N>> normal_curve(const core::Pack<T, N>& z) {
  using P = core::Pack<T, N>;
  const P bell = bounded_exp(P(-0.5) * z * z);
  const P density = bell * P(0.39894228040143267794);
  if constexpr (sizeof(T) == 4) {
    // The integral beyond |z| over the bell is smooth in 1 / (1 + p |z|); fitted for the least largest error of
    // `below`.
    const auto positive = z > P(0);
    const P size = select(positive, z, -z);
    const P t = P(1) / (P(1) + P(0.28) * size);
    const P tail =
        bell * t *
        (P(0.1165205509) +
         t * (P(0.06749822483) +
              t * (P(0.2689063953) + t * (P(-0.2369886877) + t * (P(0.3898709925) + t * P(-0.1058074851))))));
    return {density, select(positive, P(1) - tail, tail)};
  } else {
    P below;
    for (int lane = 0; lane < N; ++lane) below.set(lane, 0.5 * std::erfc(-z[lane] * (0.5 * std::numbers::sqrt2)));
    return {density, below};
  }
}

}  // namespace detail

/// z
struct Identity {
  static constexpr bool reads_output = true;
  template <class P>
  [[gnu::always_inline]] static P value(const P& z) {
    return z;
  }
  template <class P>
  [[gnu::always_inline]] static P derivative(const P&) {
    return P(1);
  }
};

/// max(0, z); its derivative at 0 is 0.
struct Relu {
  static constexpr bool reads_output = true, brief = true;
  template <class P>
  [[gnu::always_inline]] static P value(const P& z) {
    return select(z < P(0), P(0), z);
  }
  template <class P>
  [[gnu::always_inline]] static P derivative(const P& y) {
    return select(y > P(0), P(1), P(0));
  }
};

/// z for z > 0, `Slope` z elsewhere; Slope > 0, a `std::ratio`.
template <class Slope = std::ratio<1, 100>>
struct LeakyRelu {
  static_assert(Slope::num > 0 && Slope::den > 0, "the sign of z is read from the output");
  static constexpr bool reads_output = true, brief = true;
  static constexpr double slope = static_cast<double>(Slope::num) / static_cast<double>(Slope::den);
  template <class P>
  [[gnu::always_inline]] static P value(const P& z) {
    return select(z < P(0), z * P(slope), z);
  }
  template <class P>
  [[gnu::always_inline]] static P derivative(const P& y) {
    return select(y > P(0), P(1), P(slope));
  }
};

struct Tanh {
  static constexpr bool reads_output = true;
  template <class P>
  [[gnu::always_inline]] static P value(const P& z) {
    return tanh(z);
  }
  template <class P>
  [[gnu::always_inline]] static P derivative(const P& y) {
    return P(1) - y * y;
  }
};

/// 1 / (1 + e^-z)
struct Sigmoid {
  static constexpr bool reads_output = true;
  template <class P>
  [[gnu::always_inline]] static P value(const P& z) {
    return logistic(z);
  }
  template <class P>
  [[gnu::always_inline]] static P derivative(const P& y) {
    return y * (P(1) - y);
  }
};

/// z / (1 + e^-z): Elfwing, Uchibe and Doya 2018; also known as swish.
struct Silu {
  static constexpr bool reads_output = false;
  template <class P>
  [[gnu::always_inline]] static P value(const P& z) {
    return z * logistic(z);
  }
  template <class P>
  [[gnu::always_inline]] static P derivative(const P& z) {
    const P s = logistic(z);
    return s + z * s * (P(1) - s);
  }
};

/// z times the standard normal distribution function of z: Hendrycks and Gimpel 2016, the exact form with erf.
struct Gelu {
  static constexpr bool reads_output = false;
  template <class P>
  [[gnu::always_inline]] static P value(const P& z) {
    return z * detail::normal_curve(z).below;
  }
  template <class P>
  [[gnu::always_inline]] static P derivative(const P& z) {
    const auto curve = detail::normal_curve(z);
    return curve.below + z * curve.density;
  }
};

/// The tanh form of GELU, z / 2 (1 + tanh(sqrt(2 / pi) (z + 0.044715 z^3))); within 5e-4 of the exact one.
struct GeluTanh {
  static constexpr bool reads_output = false;
  template <class P>
  [[gnu::always_inline]] static P value(const P& z) {
    return P(0.5) * z * (P(1) + tanh(bend(z)));
  }
  template <class P>
  [[gnu::always_inline]] static P derivative(const P& z) {
    // Beyond 10 the slope is 0 or 1 to the last bit, and the cube would overflow.
    const P u = select(z < P(-10), P(-10), select(z > P(10), P(10), z));
    const P t = tanh(bend(u));
    return P(0.5) * (P(1) + t) + P(0.5) * u * (P(1) - t * t) * (P(factor) + P(3 * factor * cubic) * u * u);
  }

private:
  static constexpr double factor = 0.79788456080286535588, cubic = 0.044715;
  template <class P>
  [[gnu::always_inline]] static P bend(const P& z) {
    return P(factor) * (z + P(cubic) * z * z * z);
  }
};

namespace detail {

template <class S>
[[gnu::always_inline]] inline core::Pack<S> load_pack_part(const S* from, Eigen::Index count) noexcept {
  return core::Pack<S>(load_part<S>(from, count));
}

/// Whether a value takes so few instructions that it is best found while z is in a register.
template <class A>
inline constexpr bool is_brief = requires { requires A::brief; };

/// A product ends with the activation of its sums.
template <class A>
struct Activated {
  template <int V, bool Part, class S>
  [[gnu::always_inline]] void finish(VectorOf<S> (&sum)[V], const S* /*to*/, Eigen::Index /*last*/) const noexcept {
    unroll<V>([&](auto v) __attribute__((always_inline)) { sum[v] = A::value(core::Pack<S>(sum[v])).v; });
  }
};

/// A product that is the gradient with respect to outputs of A, `to`, ends as that with respect to what A was given.
/// `kept` is what the derivative reads, with the column stride of `to`.
template <class A, class S>
struct TimesSlope {
  const S* kept;
  const S* to;

  template <int V, bool Part, class>
  [[gnu::always_inline]] void finish(VectorOf<S> (&sum)[V], const S* at, Eigen::Index last) const noexcept {
    VectorOf<S> read[V];
    load_rows<S, V, Part>(kept + (at - to), last, read);
    unroll<V>([&](auto v) __attribute__((always_inline)) {
      sum[v] = (core::Pack<S>(sum[v]) * A::derivative(core::Pack<S>(read[v]))).v;
    });
  }
};

}  // namespace detail

/// y_i = A(z_i) for i < n; y may be z.
template <class A, class S>
requires Activation<A, S>
void activate(Eigen::Index n, const S* z, S* y) noexcept {
  using P = core::Pack<S>;
  Eigen::Index i = 0;
  for (; i + P::width <= n; i += P::width) A::value(P::load(z + i)).store(y + i);
  if (i < n) detail::store_part<S>(y + i, A::value(detail::load_pack_part<S>(z + i, n - i)).v, n - i);
}

/// dz_i = A'_i dy_i for i < n, with A' from what the activation reads, the output or z; dz may be dy.
template <class A, class S>
requires Activation<A, S>
void activate_backward(Eigen::Index n, const S* kept, const S* dy, S* dz) noexcept {
  using P = core::Pack<S>;
  Eigen::Index i = 0;
  for (; i + P::width <= n; i += P::width) (P::load(dy + i) * A::derivative(P::load(kept + i))).store(dz + i);
  if (i < n) {
    const Eigen::Index left = n - i;
    const P slope = A::derivative(detail::load_pack_part<S>(kept + i, left));
    detail::store_part<S>(dz + i, (detail::load_pack_part<S>(dy + i, left) * slope).v, left);
  }
}

/// The same for matrices of equal shape.
template <class A, class S>
void activate(ConstMatrix<S> z, Matrix<S> y) noexcept {
  assert(z.rows() == y.rows() && z.cols() == y.cols());
  if (z.outerStride() == z.rows() && y.outerStride() == y.rows()) return activate<A>(z.size(), z.data(), y.data());
  for (Eigen::Index j = 0; j < z.cols(); ++j) {
    activate<A>(z.rows(), z.data() + j * z.outerStride(), y.data() + j * y.outerStride());
  }
}

template <class A, class S>
void activate_backward(ConstMatrix<S> kept, ConstMatrix<S> dy, Matrix<S> dz) noexcept {
  assert(kept.rows() == dy.rows() && kept.cols() == dy.cols() && dy.rows() == dz.rows() && dy.cols() == dz.cols());
  const Eigen::Index rows = dy.rows();
  if (kept.outerStride() == rows && dy.outerStride() == rows && dz.outerStride() == rows) {
    return activate_backward<A>(dy.size(), kept.data(), dy.data(), dz.data());
  }
  for (Eigen::Index j = 0; j < dy.cols(); ++j) {
    activate_backward<A>(rows, kept.data() + j * kept.outerStride(), dy.data() + j * dy.outerStride(),
                         dz.data() + j * dz.outerStride());
  }
}

}  // namespace traceur::nn
