// SPDX-License-Identifier: MIT
#pragma once

#if defined(__AVX512F__)
#include <immintrin.h>
#endif

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <type_traits>
#include <utility>

#include <Eigen/Core>

#include "traceur/core/pack.hpp"

namespace traceur::core::detail {

// How a product goes. The left operand is cut into panels of up to `tile_vectors` registers of rows, the right one into
// tiles of `tile_columns` columns; a panel times a tile stays in registers for the whole depth:
//
//                        tile: 6 columns
//                     +------+
//      depth          |      | one number at a time,
//    +---------+      |      | spread over a register
//    |  panel  |  x   |      |   =   6 x 4 registers
//    +---------+      +------+
//
// Every element is thus the sum over the depth in order, one multiply-add a term, wherever its row and column lie and
// whatever else is computed with it.

template <class S>
using VectorOf = typename Pack<S>::Vector;

template <class S>
inline constexpr int lanes = native_width<S>;

#if defined(__AVX512F__) || defined(__aarch64__)
inline constexpr int tile_vectors = 4;  // 24 of 32 registers hold sums
#else
inline constexpr int tile_vectors = 2;  // 12 of 16
#endif
inline constexpr int tile_columns = 6;

template <int N, class F>
[[gnu::always_inline]] inline void unroll(F&& f) {
  [&]<int... i>(std::integer_sequence<int, i...>) __attribute__((always_inline)) {
    (f(std::integral_constant<int, i>{}), ...);
  }
  (std::make_integer_sequence<int, N>{});
}

template <class S>
[[gnu::always_inline]] inline VectorOf<S> load(const S* from) noexcept {
  VectorOf<S> v;
  std::memcpy(&v, from, sizeof v);
  return v;
}

template <class S>
[[gnu::always_inline]] inline void store(S* to, const VectorOf<S>& v) noexcept {
  std::memcpy(to, &v, sizeof v);
}

#if defined(__AVX512F__)
template <class S>
inline constexpr bool masked = sizeof(VectorOf<S>) == 64;
#else
template <class S>
inline constexpr bool masked = false;
#endif

/// The first `count` lanes from memory, 0 < count <= lanes; zero in the others, whose memory is not touched.
template <class S>
[[gnu::always_inline]] inline VectorOf<S> load_part(const S* from, Eigen::Index count) noexcept {
#if defined(__AVX512F__)
  const unsigned mask = (1u << count) - 1u;
  if constexpr (sizeof(S) == 4) {
    return VectorOf<S>(_mm512_maskz_loadu_ps(static_cast<__mmask16>(mask), from));
  } else {
    return VectorOf<S>(_mm512_maskz_loadu_pd(static_cast<__mmask8>(mask), from));
  }
#else
  S part[lanes<S>] = {};
  for (Eigen::Index i = 0; i < count; ++i) part[i] = from[i];
  return load<S>(part);
#endif
}

template <class S>
[[gnu::always_inline]] inline void store_part(S* to, const VectorOf<S>& v, Eigen::Index count) noexcept {
#if defined(__AVX512F__)
  const unsigned mask = (1u << count) - 1u;
  if constexpr (sizeof(S) == 4) {
    _mm512_mask_storeu_ps(to, static_cast<__mmask16>(mask), reinterpret_cast<__m512>(v));
  } else {
    _mm512_mask_storeu_pd(to, static_cast<__mmask8>(mask), reinterpret_cast<__m512d>(v));
  }
#else
  S part[lanes<S>];
  store<S>(part, v);
  for (Eigen::Index i = 0; i < count; ++i) to[i] = part[i];
#endif
}

/// V registers of numbers, of the last one only `last` if `part`.
template <class S, int V>
[[gnu::always_inline]] inline void load_rows(const S* from, bool part, Eigen::Index last,
                                             VectorOf<S> (&to)[V]) noexcept {
  unroll<V - 1>([&](auto v) __attribute__((always_inline)) { to[v] = load<S>(from + v * lanes<S>); });
  constexpr int at = (V - 1) * lanes<S>;
  to[V - 1] = part ? load_part<S>(from + at, last) : load<S>(from + at);
}

template <class S, int V>
[[gnu::always_inline]] inline void store_rows(S* to, bool part, Eigen::Index last,
                                              const VectorOf<S> (&from)[V]) noexcept {
  unroll<V - 1>([&](auto v) __attribute__((always_inline)) { store<S>(to + v * lanes<S>, from[v]); });
  constexpr int at = (V - 1) * lanes<S>;
  if (part) {
    store_part<S>(to + at, from[V - 1], last);
  } else {
    store<S>(to + at, from[V - 1]);
  }
}

template <class S>
constexpr Eigen::Index padded_rows(Eigen::Index rows) noexcept {
  return (rows + lanes<S> - 1) / lanes<S> * lanes<S>;
}

/// Registers of the next panel when `left` remain: no panel of one register where two panels can share evenly.
constexpr int panel_vectors(Eigen::Index left) noexcept {
  if (tile_vectors == 4 && left == 5) return 3;
  return static_cast<int>(std::min<Eigen::Index>(left, tile_vectors));
}

/// Where a sum starts: at `from[row + column * stride]`, or at zero if there is no `from`.
template <class S>
struct Start {
  const S* from;
  Eigen::Index stride;
};

/// The right operand: element (k, column) at `from[k * step + column * stride]`.
template <class S>
struct Right {
  const S* from;
  Eigen::Index step, stride;
};

/// c(rows, N) = start + a b over the depth, for (V - 1) registers of rows < rows <= V registers. Column k of the panel
/// is at a + k * a_step and is read to a whole number of registers.
template <class S, int V, int N>
[[gnu::noinline]] void multiply_tile(Eigen::Index depth, Eigen::Index rows, const S* a, Eigen::Index a_step, Right<S> b,
                                     Start<S> start, S* c, Eigen::Index c_stride) noexcept {
  using Vector = VectorOf<S>;
  constexpr int w = lanes<S>;
  const Eigen::Index last = rows - (V - 1) * w;
  // Processors with masks store a full register through one as fast as without.
  const bool part = masked<S> || last < w;
  Vector sum[N][V];
  if (start.from == nullptr) {
    unroll<N * V>([&](auto i) __attribute__((always_inline)) { sum[i / V][i % V] = Vector{}; });
  } else {
    unroll<N>([&](auto n) __attribute__((always_inline)) {
      load_rows<S, V>(start.from + n * start.stride, part, last, sum[n]);
    });
  }
  const S* right = b.from;
  for (Eigen::Index k = 0; k < depth; ++k) {
    Vector left[V];
    unroll<V>([&](auto v) __attribute__((always_inline)) { left[v] = load<S>(a + v * w); });
    unroll<N>([&](auto n) __attribute__((always_inline)) {
      // Subtracting zero spreads a number over the lanes and is folded away, as adding zero is not.
      const Vector factor = right[n * b.stride] - Vector{};
      unroll<V>([&](auto v) __attribute__((always_inline)) { sum[n][v] = sum[n][v] + left[v] * factor; });
    });
    a += a_step;
    right += b.step;
  }
  unroll<N>([&](auto n) __attribute__((always_inline)) { store_rows<S, V>(c + n * c_stride, part, last, sum[n]); });
}

/// A panel times all columns.
template <class S, int V>
void multiply_panel(Eigen::Index columns, Eigen::Index depth, Eigen::Index rows, const S* a, Eigen::Index a_step,
                    Right<S> b, Start<S> start, S* c, Eigen::Index c_stride) noexcept {
  const auto tiles = [&](auto width) {
    constexpr int n = decltype(width)::value;
    for (; columns >= n; columns -= n) {
      multiply_tile<S, V, n>(depth, rows, a, a_step, b, start, c, c_stride);
      b.from += n * b.stride;
      if (start.from != nullptr) start.from += n * start.stride;
      c += n * c_stride;
    }
  };
  tiles(std::integral_constant<int, tile_columns>{});
  tiles(std::integral_constant<int, 4>{});
  tiles(std::integral_constant<int, 2>{});
  tiles(std::integral_constant<int, 1>{});
}

template <class S>
void multiply_panel(int vectors, Eigen::Index columns, Eigen::Index depth, Eigen::Index rows, const S* a,
                    Eigen::Index a_step, Right<S> b, Start<S> start, S* c, Eigen::Index c_stride) noexcept {
  if constexpr (tile_vectors == 4) {
    if (vectors == 4) return multiply_panel<S, 4>(columns, depth, rows, a, a_step, b, start, c, c_stride);
    if (vectors == 3) return multiply_panel<S, 3>(columns, depth, rows, a, a_step, b, start, c, c_stride);
  }
  if (vectors == 2) return multiply_panel<S, 2>(columns, depth, rows, a, a_step, b, start, c, c_stride);
  multiply_panel<S, 1>(columns, depth, rows, a, a_step, b, start, c, c_stride);
}

/// c = start + a b for all rows, `a` in packed panels, or as a matrix of column stride `a_step` if that is not 0. In a
/// matrix the last register of rows overlaps the one before it rather than reach beyond the last row: rows >= lanes
/// then.
template <class S>
void multiply_panels(Eigen::Index rows, Eigen::Index columns, Eigen::Index depth, const S* a, Eigen::Index a_step,
                     Right<S> b, Start<S> start, S* c, Eigen::Index c_stride) noexcept {
  constexpr Eigen::Index w = lanes<S>;
  const bool packed = a_step == 0;
  const Eigen::Index vectors = packed ? padded_rows<S>(rows) / w : rows / w;
  const auto from = [&](Eigen::Index row) { return Start<S>{start.from ? start.from + row : nullptr, start.stride}; };
  for (Eigen::Index v = 0; v < vectors;) {
    const int taken = panel_vectors(vectors - v);
    const Eigen::Index row = v * w;
    multiply_panel<S>(taken, columns, depth, std::min(rows - row, taken * w), packed ? a + row * depth : a + row,
                      packed ? taken * w : a_step, b, from(row), c + row, c_stride);
    v += taken;
  }
  if (!packed && rows % w != 0) {
    const Eigen::Index row = rows - w;
    multiply_panel<S, 1>(columns, depth, w, a + row, a_step, b, from(row), c + row, c_stride);
  }
}

/// Copies a matrix (rows x depth, column stride `stride`) into panels, the last register of rows filled up with zeros.
template <class S>
void pack_panels(Eigen::Index rows, Eigen::Index depth, const S* a, Eigen::Index stride, S* to) noexcept {
  constexpr Eigen::Index w = lanes<S>;
  const Eigen::Index vectors = padded_rows<S>(rows) / w;
  for (Eigen::Index v = 0; v < vectors;) {
    const int taken = panel_vectors(vectors - v);
    const Eigen::Index row = v * w, full = std::min<Eigen::Index>(taken, rows / w - v), last = rows - row - full * w;
    const S* from = a + row;
    for (Eigen::Index k = 0; k < depth; ++k, from += stride) {
      for (Eigen::Index i = 0; i < full; ++i, to += w) store<S>(to, load<S>(from + i * w));
      if (full < taken) {
        store<S>(to, load_part<S>(from + full * w, last));
        to += w;
      }
    }
    v += taken;
  }
}

}  // namespace traceur::core::detail
