// SPDX-License-Identifier: MIT
#pragma once

#if defined(__AVX__)
#include <immintrin.h>
#endif

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
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

#if defined(__AVX__) && !defined(__AVX512F__)
/// As many set lanes as there are in a register, then as many empty ones.
template <class S>
inline constexpr auto first_lanes = [] {
  std::array<std::conditional_t<sizeof(S) == 4, std::int32_t, std::int64_t>, 2 * lanes<S>> mask{};
  for (std::size_t i = 0; i < lanes<S>; ++i) mask[i] = -1;
  return mask;
}();
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
#elif defined(__AVX__)
  __m256i mask;
  std::memcpy(&mask, first_lanes<S>.data() + lanes<S> - count, sizeof mask);
  if constexpr (sizeof(S) == 4) {
    return VectorOf<S>(_mm256_maskload_ps(from, mask));
  } else {
    return VectorOf<S>(_mm256_maskload_pd(from, mask));
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

/// V registers of numbers, of the last one only `last` if `Part`.
template <class S, int V, bool Part>
[[gnu::always_inline]] inline void load_rows(const S* from, Eigen::Index last, VectorOf<S> (&to)[V]) noexcept {
  unroll<V - 1>([&](auto v) __attribute__((always_inline)) { to[v] = load<S>(from + v * lanes<S>); });
  constexpr int at = (V - 1) * lanes<S>;
  to[V - 1] = Part ? load_part<S>(from + at, last) : load<S>(from + at);
}

template <class S, int V, bool Part>
[[gnu::always_inline]] inline void store_rows(S* to, Eigen::Index last, const VectorOf<S> (&from)[V]) noexcept {
  unroll<V - 1>([&](auto v) __attribute__((always_inline)) { store<S>(to + v * lanes<S>, from[v]); });
  constexpr int at = (V - 1) * lanes<S>;
  if constexpr (Part) {
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

/// Calls f with `vectors`, at most `tile_vectors`, as a constant.
template <class F>
void for_vectors(int vectors, F&& f) {
  if constexpr (tile_vectors == 4) {
    if (vectors == 4) return f(std::integral_constant<int, 4>{});
    if (vectors == 3) return f(std::integral_constant<int, 3>{});
  }
  if (vectors == 2) return f(std::integral_constant<int, 2>{});
  f(std::integral_constant<int, 1>{});
}

template <class S>
alignas(64) inline constexpr S zeros[tile_vectors * lanes<S>] = {};

/// Where a sum starts: at `from[row + column * stride]`, or at zero if there is no `from`.
template <class S>
struct Start {
  const S* from;
  Eigen::Index stride;
};

/// The right operand where it lies: element (k, column) at `from[k * step + column * stride]`.
template <class S>
struct Right {
  const S* from;
  Eigen::Index step, stride;

  template <int N>
  [[gnu::always_inline]] Right tile() const noexcept {
    return *this;
  }
  [[gnu::always_inline]] void advance(Eigen::Index columns) noexcept { from += columns * stride; }
};

/// The right operand as a copy: tile after tile, of each the columns side by side.
template <class S>
struct PackedRight {
  const S* from;
  Eigen::Index depth;

  template <int N>
  [[gnu::always_inline]] Right<S> tile() const noexcept {
    return {from, N, 1};
  }
  [[gnu::always_inline]] void advance(Eigen::Index columns) noexcept { from += columns * depth; }
};

/// Calls f(width) for each tile of so many columns: full ones, then one of those that remain. Widths are constants.
template <class F>
[[gnu::always_inline]] inline void for_each_tile(Eigen::Index columns, F&& f) noexcept {
  for (; columns >= tile_columns; columns -= tile_columns) f(std::integral_constant<int, tile_columns>{});
  unroll<tile_columns - 1>([&](auto before) __attribute__((always_inline)) {
    constexpr int width = decltype(before)::value + 1;
    if (columns == width) f(std::integral_constant<int, width>{});
  });
}

/// What a product does to its sums while they are in registers: nothing. `finish` is given V registers of rows that
/// will be stored at `to`, of the last one only `last` rows if `Part`. It may be called twice for an element, each time
/// with the sum.
struct AsTheyAre {
  template <int V, bool Part, class S>
  [[gnu::always_inline]] void finish(VectorOf<S> (&)[V], const S* /*to*/, Eigen::Index /*last*/) const noexcept {}
};

/// c = start + a b over a depth of at least 1, for N columns and V registers of rows, of the last one only `last` rows
/// if `Part`. Column k of the panel is at a + k * a_step and is read to a whole number of registers.
template <class S, int V, int N, bool Part, class End>
[[gnu::always_inline]] inline void multiply_tile(Eigen::Index depth, Eigen::Index last, const S* a, Eigen::Index a_step,
                                                 Right<S> b, Start<S> start, S* c, Eigen::Index c_stride,
                                                 const End& end) noexcept {
  using Vector = VectorOf<S>;
  Vector sum[N][V];
  unroll<N>([&](auto n)
                __attribute__((always_inline)) { load_rows<S, V, Part>(start.from + n * start.stride, last, sum[n]); });
  Eigen::Index k = 0;
  do {
    Vector left[V];
    unroll<V>([&](auto v) __attribute__((always_inline)) { left[v] = load<S>(a + v * lanes<S>); });
    unroll<N>([&](auto n) __attribute__((always_inline)) {
      // Subtracting zero spreads a number over the lanes and is folded away, as adding zero is not.
      const Vector factor = b.from[n * b.stride] - Vector{};
      unroll<V>([&](auto v) __attribute__((always_inline)) { sum[n][v] = sum[n][v] + left[v] * factor; });
    });
    a += a_step;
    b.from += b.step;
  } while (++k < depth);
  unroll<N>([&](auto n) __attribute__((always_inline)) {
    S* const to = c + n * c_stride;
    end.template finish<V, Part, S>(sum[n], to, last);
    store_rows<S, V, Part>(to, last, sum[n]);
  });
}

/// A panel times all columns; B is Right<S> or PackedRight<S>.
template <class S, int V, bool Part, class B, class End>
[[gnu::noinline]] void multiply_panel(Eigen::Index columns, Eigen::Index depth, Eigen::Index last, const S* a,
                                      Eigen::Index a_step, const B& right, const Start<S>& from, S* c,
                                      Eigen::Index c_stride, const End& end) noexcept {
  B b = right;
  Start<S> start = from.from == nullptr ? Start<S>{zeros<S>, 0} : from;
  for_each_tile(
      columns, [&](auto width) __attribute__((always_inline)) {
        constexpr int n = decltype(width)::value;
        multiply_tile<S, V, n, Part>(depth, last, a, a_step, b.template tile<n>(), start, c, c_stride, end);
        b.advance(n);
        start.from += n * start.stride;
        c += n * c_stride;
      });
}

/// (V - 1) registers of rows < rows <= V registers.
template <class S, int V, class B, class End>
void multiply_panel(Eigen::Index columns, Eigen::Index depth, Eigen::Index rows, const S* a, Eigen::Index a_step,
                    const B& b, const Start<S>& start, S* c, Eigen::Index c_stride, const End& end) noexcept {
  const Eigen::Index last = rows - (V - 1) * lanes<S>;
  // Processors with masks store a full register through one as fast as without.
  if constexpr (!masked<S>) {
    if (last == lanes<S>) {
      return multiply_panel<S, V, false>(columns, depth, last, a, a_step, b, start, c, c_stride, end);
    }
  }
  multiply_panel<S, V, true>(columns, depth, last, a, a_step, b, start, c, c_stride, end);
}

template <class S, class B, class End>
void multiply_panel(int vectors, Eigen::Index columns, Eigen::Index depth, Eigen::Index rows, const S* a,
                    Eigen::Index a_step, const B& b, const Start<S>& start, S* c, Eigen::Index c_stride,
                    const End& end) noexcept {
  for_vectors(vectors, [&](auto v) {
    multiply_panel<S, decltype(v)::value>(columns, depth, rows, a, a_step, b, start, c, c_stride, end);
  });
}

template <class S>
void copy_start(Eigen::Index rows, Eigen::Index columns, const Start<S>& start, S* c, Eigen::Index c_stride) noexcept {
  for (Eigen::Index j = 0; j < columns; ++j) {
    for (Eigen::Index i = 0; i < rows; ++i) {
      c[i + j * c_stride] = start.from == nullptr ? S(0) : start.from[i + j * start.stride];
    }
  }
}

/// c = start + a b for all rows, `a` in packed panels, or as a matrix of column stride `a_step` if that is not 0. In a
/// matrix the last register of rows overlaps the one before it rather than reach beyond the last row: rows >= lanes
/// then. `end` is not for a depth of 0.
template <class S, class B = Right<S>, class End = AsTheyAre>
void multiply_panels(Eigen::Index rows, Eigen::Index columns, Eigen::Index depth, const S* a, Eigen::Index a_step,
                     const B& b, const Start<S>& start, S* c, Eigen::Index c_stride, const End& end = {}) noexcept {
  constexpr Eigen::Index w = lanes<S>;
  if (depth == 0) return copy_start(rows, columns, start, c, c_stride);
  const bool packed = a_step == 0;
  const Eigen::Index vectors = packed ? padded_rows<S>(rows) / w : rows / w;
  const auto from = [&](Eigen::Index row) { return Start<S>{start.from ? start.from + row : nullptr, start.stride}; };
  for (Eigen::Index v = 0; v < vectors;) {
    const int taken = panel_vectors(vectors - v);
    const Eigen::Index row = v * w;
    multiply_panel<S>(taken, columns, depth, std::min(rows - row, taken * w), packed ? a + row * depth : a + row,
                      packed ? taken * w : a_step, b, from(row), c + row, c_stride, end);
    v += taken;
  }
  if (!packed && rows % w != 0) {
    const Eigen::Index row = rows - w;
    multiply_panel<S, 1>(columns, depth, w, a + row, a_step, b, from(row), c + row, c_stride, end);
  }
}

// Matrices are copied so many columns at a time, from top to bottom: panels or tiles side by side share cache lines and
// pages.
inline constexpr Eigen::Index copied_columns = 8;

/// One panel of `pack_panels`, with V registers of rows, of the last one only `last` rows if `Part`.
template <class S, int V, bool Part>
void pack_panel(Eigen::Index depth, Eigen::Index last, const S* a, Eigen::Index stride, S* to) noexcept {
  for (Eigen::Index k = 0; k < depth; ++k, a += stride, to += V * lanes<S>) {
    VectorOf<S> column[V];
    load_rows<S, V, Part>(a, last, column);
    store_rows<S, V, false>(to, 0, column);
  }
}

/// Copies a matrix (rows x depth, column stride `stride`) into panels, the last register of rows filled up with zeros.
template <class S>
void pack_panels(Eigen::Index rows, Eigen::Index depth, const S* a, Eigen::Index stride, S* to) noexcept {
  constexpr Eigen::Index w = lanes<S>;
  for (Eigen::Index first = 0; first < depth; first += copied_columns) {
    const Eigen::Index count = std::min(copied_columns, depth - first);
    const S* from = a + first * stride;
    for (Eigen::Index row = 0; row < rows;) {
      const int taken = panel_vectors(padded_rows<S>(rows - row) / w);
      S* const panel = to + row * depth + first * taken * w;
      for_vectors(taken, [&](auto vectors) {
        constexpr int v = decltype(vectors)::value;
        if (rows - row >= v * w) {
          pack_panel<S, v, false>(count, w, from + row, stride, panel);
        } else {
          pack_panel<S, v, true>(count, rows - row - (v - 1) * w, from + row, stride, panel);
        }
      });
      row += taken * w;
    }
  }
}

/// Copies a right operand (depth x columns), element (k, column) at `b[k * step + column]`, for PackedRight: depth
/// times columns numbers.
template <class S>
void pack_tiles(Eigen::Index columns, Eigen::Index depth, const S* b, Eigen::Index step, S* to) noexcept {
  for (Eigen::Index first = 0; first < depth; first += copied_columns, b += copied_columns * step) {
    const Eigen::Index count = std::min(copied_columns, depth - first);
    const S* left = b;
    S* tile = to;
    for_each_tile(columns, [&](auto width) {
      constexpr int n = decltype(width)::value;
      for (Eigen::Index k = 0; k < count; ++k) {
        std::memcpy(tile + (first + k) * n, left + k * step, n * sizeof(S));
      }
      left += n;
      tile += n * depth;
    });
  }
}

}  // namespace traceur::core::detail
