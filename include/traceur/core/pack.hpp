// SPDX-License-Identifier: MIT
#pragma once

#if defined(__SSE2__)
#include <immintrin.h>
#endif

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "traceur/core/scalar.hpp"

namespace traceur::core {

/// The number of elements of type `T` in the widest vector register of the target.
template <class T>
inline constexpr int native_width =
#if defined(__AVX512F__)
    64 / static_cast<int>(sizeof(T));
#elif defined(__AVX__)
    32 / static_cast<int>(sizeof(T));
#else
    16 / static_cast<int>(sizeof(T));
#endif

namespace detail {

/// Of N numbers of type `T`: no more than of the widest register, for which Eigen aligns what it stores.
template <class T, int N>
inline constexpr std::size_t pack_alignment = sizeof(T) * static_cast<std::size_t>(N < native_width<T> ? N : native_width<T>);

}  // namespace detail

template <class T, int N>
struct Mask;

/// `N` numbers of type `T` worked on at once, each a lane of its own. A model of `Scalar`.
///
/// N is a power of two; a width beyond the target's registers is correct but slow. Masks do not convert to `bool`, so code
/// that forgets that lanes may disagree does not compile.
template <class T, int N = native_width<T>>
struct Pack {
  static_assert(std::is_floating_point_v<T> && N > 0 && (N & (N - 1)) == 0);
  typedef T Vector __attribute__((vector_size(N * sizeof(T)), aligned(detail::pack_alignment<T, N>)));
  static constexpr int width = N;

  Vector v;

  Pack() = default;
  [[gnu::always_inline]] explicit Pack(const Vector& vector) : v(vector) {}
  /// The same value in every lane. (Compilers leave out the subtraction; an addition would turn -0 into 0.)
  template <class U>
    requires std::is_arithmetic_v<U>
  [[gnu::always_inline]] Pack(U value) : v(static_cast<T>(value) - Vector{}) {}

  /// One lane; `lane` is in [0, N).
  [[gnu::always_inline]] T operator[](int lane) const { return v[lane]; }
  /// Replaces one lane.
  [[gnu::always_inline]] void set(int lane, T value) { v[lane] = value; }

  /// Reads N numbers from memory that need not be aligned.
  [[gnu::always_inline]] static Pack load(const T* from) {
    Pack p;
    std::memcpy(&p.v, from, sizeof(Vector));
    return p;
  }
  [[gnu::always_inline]] void store(T* to) const { std::memcpy(to, &v, sizeof(Vector)); }

  [[gnu::always_inline]] Pack& operator+=(const Pack& o) { v += o.v; return *this; }
  [[gnu::always_inline]] Pack& operator-=(const Pack& o) { v -= o.v; return *this; }
  [[gnu::always_inline]] Pack& operator*=(const Pack& o) { v *= o.v; return *this; }
  [[gnu::always_inline]] Pack& operator/=(const Pack& o) { v /= o.v; return *this; }

  [[gnu::always_inline]] friend Pack operator+(const Pack& a, const Pack& b) { return Pack(Vector(a.v + b.v)); }
  [[gnu::always_inline]] friend Pack operator-(const Pack& a, const Pack& b) { return Pack(Vector(a.v - b.v)); }
  [[gnu::always_inline]] friend Pack operator*(const Pack& a, const Pack& b) { return Pack(Vector(a.v * b.v)); }
  [[gnu::always_inline]] friend Pack operator/(const Pack& a, const Pack& b) { return Pack(Vector(a.v / b.v)); }
  [[gnu::always_inline]] friend Pack operator-(const Pack& a) { return Pack(Vector(-a.v)); }

  [[gnu::always_inline]] friend Mask<T, N> operator<(const Pack& a, const Pack& b) { return Mask<T, N>{a.v < b.v}; }
  [[gnu::always_inline]] friend Mask<T, N> operator<=(const Pack& a, const Pack& b) { return Mask<T, N>{a.v <= b.v}; }
  [[gnu::always_inline]] friend Mask<T, N> operator>(const Pack& a, const Pack& b) { return Mask<T, N>{a.v > b.v}; }
  [[gnu::always_inline]] friend Mask<T, N> operator>=(const Pack& a, const Pack& b) { return Mask<T, N>{a.v >= b.v}; }
  [[gnu::always_inline]] friend Mask<T, N> operator==(const Pack& a, const Pack& b) { return Mask<T, N>{a.v == b.v}; }
  [[gnu::always_inline]] friend Mask<T, N> operator!=(const Pack& a, const Pack& b) { return Mask<T, N>{a.v != b.v}; }
};

/// One truth value for each lane of a `Pack<T, N>`; all bits of a lane are set or none.
template <class T, int N>
struct Mask {
  using Integer = std::conditional_t<sizeof(T) == 4, std::int32_t, std::int64_t>;
  typedef Integer Vector __attribute__((vector_size(N * sizeof(Integer))));

  Vector m;

  [[gnu::always_inline]] bool operator[](int lane) const { return m[lane] != 0; }
  [[gnu::always_inline]] void set(int lane, bool value) { m[lane] = value ? Integer{-1} : Integer{0}; }
  [[gnu::always_inline]] static Mask none() { return Mask{Vector{}}; }
  [[gnu::always_inline]] friend Mask operator&(const Mask& a, const Mask& b) { return Mask{a.m & b.m}; }
  [[gnu::always_inline]] friend Mask operator|(const Mask& a, const Mask& b) { return Mask{a.m | b.m}; }
  [[gnu::always_inline]] friend Mask operator!(const Mask& a) { return Mask{~a.m}; }
};

template <class T, int N>
[[gnu::always_inline]] inline bool any(const Mask<T, N>& mask) {
#if defined(__AVX512F__)
  if constexpr (sizeof(mask.m) == 64) {
    const auto bits = reinterpret_cast<__m512i>(mask.m);
    return _mm512_test_epi64_mask(bits, bits) != 0;
  }
#endif
#if defined(__AVX__)
  if constexpr (sizeof(mask.m) == 32) {
    const auto bits = reinterpret_cast<__m256i>(mask.m);
    return _mm256_testz_si256(bits, bits) == 0;
  }
#endif
  typename Mask<T, N>::Integer bits = 0;
  for (int i = 0; i < N; ++i) bits |= mask.m[i];
  return bits != 0;
}

template <class T, int N>
[[gnu::always_inline]] inline bool all(const Mask<T, N>& mask) {
  return !any(!mask);
}

template <class T, int N>
[[gnu::always_inline]] inline Pack<T, N> select(const Mask<T, N>& mask, const Pack<T, N>& a, const Pack<T, N>& b) {
  return Pack<T, N>(typename Pack<T, N>::Vector(mask.m ? a.v : b.v));
}

template <class T, int N>
struct ElementType<Pack<T, N>> {
  using type = T;
};

/// The number of lanes of a scalar: 1 for plain numbers.
template <class S>
inline constexpr int lane_count = 1;
template <class T, int N>
inline constexpr int lane_count<Pack<T, N>> = N;

/// The mask type that comparing two scalars yields.
template <class S>
using MaskOf = decltype(std::declval<S>() < std::declval<S>());

/// Reads one lane of a scalar; plain numbers have lane 0 only.
template <class S>
[[gnu::always_inline]] inline Element<S> lane_of(const S& x, int lane) {
  if constexpr (lane_count<S> == 1 && std::is_same_v<S, Element<S>>) {
    return x;
  } else {
    return x[lane];
  }
}

/// Writes one lane of a scalar.
template <class S>
[[gnu::always_inline]] inline void set_lane(S& x, int lane, Element<S> value) {
  if constexpr (std::is_same_v<S, Element<S>>) {
    x = value;
  } else {
    x.set(lane, value);
  }
}

/// Reads one lane of a mask.
template <class M>
[[gnu::always_inline]] inline bool mask_lane(const M& mask, int lane) {
  if constexpr (std::is_same_v<M, bool>) {
    return mask;
  } else {
    return mask[lane];
  }
}

template <class T, int N>
[[gnu::always_inline]] inline Pack<T, N> sqrt(const Pack<T, N>& x) {
  using Vector = typename Pack<T, N>::Vector;
#if defined(__AVX512F__)
  // The unmasked intrinsics read an undefined register on purpose, which g++ 12 warns about in user code.
  if constexpr (sizeof(Vector) == 64 && sizeof(T) == 4) {
    return Pack<T, N>(Vector(_mm512_maskz_sqrt_ps(0xFFFF, reinterpret_cast<__m512>(x.v))));
  } else if constexpr (sizeof(Vector) == 64) {
    return Pack<T, N>(Vector(_mm512_maskz_sqrt_pd(0xFF, reinterpret_cast<__m512d>(x.v))));
  }
#endif
#if defined(__AVX__)
  if constexpr (sizeof(Vector) == 32 && sizeof(T) == 4) {
    return Pack<T, N>(Vector(_mm256_sqrt_ps(reinterpret_cast<__m256>(x.v))));
  } else if constexpr (sizeof(Vector) == 32) {
    return Pack<T, N>(Vector(_mm256_sqrt_pd(reinterpret_cast<__m256d>(x.v))));
  }
#endif
#if defined(__SSE2__)
  if constexpr (sizeof(Vector) == 16 && sizeof(T) == 4) {
    return Pack<T, N>(Vector(_mm_sqrt_ps(reinterpret_cast<__m128>(x.v))));
  } else if constexpr (sizeof(Vector) == 16) {
    return Pack<T, N>(Vector(_mm_sqrt_pd(reinterpret_cast<__m128d>(x.v))));
  }
#endif
  Pack<T, N> r;
  for (int i = 0; i < N; ++i) r.v[i] = std::sqrt(x.v[i]);
  return r;
}

template <class T, int N>
[[gnu::always_inline]] inline Pack<T, N> abs(const Pack<T, N>& x) {
  return select(x < Pack<T, N>(0), -x, x);
}

/// Nearest integer of each lane, ties to even, for |x| < 2^22 (float) or 2^51 (double).
template <class T, int N>
[[gnu::always_inline]] inline Pack<T, N> round(const Pack<T, N>& x) {
  // Adding 1.5 x 2^(mantissa bits) leaves no bits for the fraction, so the sum itself rounds; needs no vector rounding call.
  const Pack<T, N> shift(sizeof(T) == 4 ? 12582912.0 : 6755399441055744.0);
  return (x + shift) - shift;
}

template <class T, int N>
struct SinCos {
  Pack<T, N> sin, cos;
};

/// Sine and cosine of each lane by Cody-Waite reduction to [-pi/4, pi/4] and Taylor polynomials. Absolute error below
/// 2e-7 (float) and 1e-14 (double) for |x| <= 1000 rad.
template <class T, int N>
[[gnu::always_inline]] inline SinCos<T, N> sin_cos(const Pack<T, N>& x) {
  using P = Pack<T, N>;
  const P quadrant = round(x * P(0.63661977236758134308));
  P r;
  if constexpr (sizeof(T) == 4) {
    r = ((x - quadrant * P(1.5703125)) - quadrant * P(4.837512969970703125e-4)) - quadrant * P(7.54978995489188216e-8);
  } else {
    r = ((x - quadrant * P(1.57079632673412561417)) - quadrant * P(6.07710050630396597660e-11)) -
        quadrant * P(2.02226624879595063154e-21);
  }
  const P z = r * r;
  P s, c;
  if constexpr (sizeof(T) == 4) {
    s = r + r * z * (P(-1.0 / 6) + z * (P(1.0 / 120) + z * (P(-1.0 / 5040) + z * P(1.0 / 362880))));
    c = P(1) + z * (P(-0.5) + z * (P(1.0 / 24) + z * (P(-1.0 / 720) + z * (P(1.0 / 40320) - z * P(1.0 / 3628800)))));
  } else {
    s = r + r * z *
                (P(-1.0 / 6) +
                 z * (P(1.0 / 120) +
                      z * (P(-1.0 / 5040) +
                           z * (P(1.0 / 362880) +
                                z * (P(-1.0 / 39916800) + z * (P(1.0 / 6227020800.0) - z * P(1.0 / 1307674368000.0)))))));
    c = P(1) +
        z * (P(-0.5) +
             z * (P(1.0 / 24) +
                  z * (P(-1.0 / 720) +
                       z * (P(1.0 / 40320) +
                            z * (P(-1.0 / 3628800) +
                                 z * (P(1.0 / 479001600.0) +
                                      z * (P(-1.0 / 87178291200.0) + z * P(1.0 / 20922789888000.0))))))));
  }
  // quadrant mod 4 in {-2, ..., 2}; odd quadrants swap sine and cosine, and the signs follow from the quadrant's place.
  const P turn = quadrant - P(4) * round(quadrant * P(0.25));
  const auto odd = (turn == P(1)) | (turn == P(-1));
  const auto flip_sin = (turn == P(2)) | (turn == P(-2)) | (turn == P(-1));
  const auto flip_cos = (turn == P(2)) | (turn == P(-2)) | (turn == P(1));
  const P sine = select(odd, c, s);
  const P cosine = select(odd, s, c);
  return {select(flip_sin, -sine, sine), select(flip_cos, -cosine, cosine)};
}

template <class T, int N>
[[gnu::always_inline]] inline Pack<T, N> sin(const Pack<T, N>& x) {
  return sin_cos(x).sin;
}
template <class T, int N>
[[gnu::always_inline]] inline Pack<T, N> cos(const Pack<T, N>& x) {
  return sin_cos(x).cos;
}

// The functions below are not used inside a simulation step, so one call per lane is enough.
template <class T, int N>
inline Pack<T, N> exp(const Pack<T, N>& x) {
  Pack<T, N> r;
  for (int i = 0; i < N; ++i) r.set(i, std::exp(x[i]));
  return r;
}
template <class T, int N>
inline Pack<T, N> log(const Pack<T, N>& x) {
  Pack<T, N> r;
  for (int i = 0; i < N; ++i) r.set(i, std::log(x[i]));
  return r;
}
template <class T, int N>
inline Pack<T, N> atan2(const Pack<T, N>& y, const Pack<T, N>& x) {
  Pack<T, N> r;
  for (int i = 0; i < N; ++i) r.set(i, std::atan2(y[i], x[i]));
  return r;
}
template <class T, int N>
inline Pack<T, N> floor(const Pack<T, N>& x) {
  Pack<T, N> r;
  for (int i = 0; i < N; ++i) r.set(i, std::floor(x[i]));
  return r;
}

}  // namespace traceur::core
