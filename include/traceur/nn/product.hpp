// SPDX-License-Identifier: MIT
#pragma once

#if defined(__AVX512F__)
#include <immintrin.h>
#endif

#include <algorithm>
#include <cassert>
#include <cstring>
#include <type_traits>
#include <utility>

#include <Eigen/Core>

#include <traceur/core/pack.hpp>
#include <traceur/nn/module.hpp>

namespace traceur::nn {

/// Whether a product replaces what is in its destination or is added to it.
enum class Into { set, add };

namespace detail {

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
// whatever else is computed with it. Matrices of a few rows, which would leave most of a register empty, are multiplied
// along the depth instead, again in an order that nothing but the depth decides. Hence the law that a column has the
// same bits alone and in any batch.

template <class S>
using VectorOf = typename core::Pack<S>::Vector;

template <class S>
inline constexpr int lanes = core::native_width<S>;

#if defined(__AVX512F__) || defined(__aarch64__)
inline constexpr int tile_vectors = 4;  // 24 of 32 registers hold sums
#else
inline constexpr int tile_vectors = 2;  // 12 of 16
#endif
inline constexpr int tile_columns = 6;

// Terms of an outer product summed at a time: their operands stay in a near cache.
inline constexpr Eigen::Index outer_depth = 256;
// Columns of a product finished at a time, and handed on while they are still in a near cache. A left operand that does
// not stay there itself is fetched anew for each strip.
constexpr Eigen::Index strip_columns(Eigen::Index size) noexcept { return (size > 1 << 17 ? 32 : 8) * tile_columns; }

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

template <class Vector, int Step, int... lane>
[[gnu::always_inline]] inline void exchange(Vector& a, Vector& b, std::integer_sequence<int, lane...>) noexcept {
  constexpr int w = sizeof...(lane);
  const Vector low = __builtin_shufflevector(a, b, ((lane & Step) == 0 ? lane : w + lane - Step)...);
  const Vector high = __builtin_shufflevector(a, b, ((lane & Step) == 0 ? lane + Step : w + lane)...);
  a = low;
  b = high;
}

/// Transposes a square of registers by exchanging its off-diagonal blocks, at every block size.
template <class S, int Step = 1>
[[gnu::always_inline]] inline void transpose(VectorOf<S> (&block)[lanes<S>]) noexcept {
  constexpr int w = lanes<S>;
  if constexpr (Step < w) {
    unroll<w>([&](auto i) __attribute__((always_inline)) {
      constexpr int row = decltype(i)::value;
      if constexpr ((row & Step) == 0) {
        exchange<VectorOf<S>, Step>(block[row], block[row + Step], std::make_integer_sequence<int, w>{});
      }
    });
    transpose<S, 2 * Step>(block);
  }
}

/// Copies the transpose of a matrix (depth x rows, column stride `stride`) into panels of `rows`.
template <class S>
void pack_transposed_panels(Eigen::Index rows, Eigen::Index depth, const S* a, Eigen::Index stride, S* to) noexcept {
  constexpr Eigen::Index w = lanes<S>;
  const Eigen::Index vectors = padded_rows<S>(rows) / w;
  for (Eigen::Index v = 0; v < vectors;) {
    const int taken = panel_vectors(vectors - v);
    for (int i = 0; i < taken; ++i) {
      const Eigen::Index row = (v + i) * w, columns = std::min(w, rows - row);
      const S* from = a + row * stride;
      for (Eigen::Index k = 0; k < depth; k += w) {
        const Eigen::Index count = std::min(w, depth - k);
        VectorOf<S> block[lanes<S>];
        if (columns == w && count == w) {
          unroll<lanes<S>>([&](auto n) __attribute__((always_inline)) { block[n] = load<S>(from + n * stride + k); });
        } else {
          unroll<lanes<S>>([&](auto n) __attribute__((always_inline)) {
            block[n] = n < columns ? load_part<S>(from + n * stride + k, count) : VectorOf<S>{};
          });
        }
        transpose<S>(block);
        S* panel = to + k * taken * w + i * w;
        unroll<lanes<S>>([&](auto n) __attribute__((always_inline)) {
          if (n < count) store<S>(panel + n * taken * w, block[n]);
        });
      }
    }
    to += taken * w * depth;
    v += taken;
  }
}

/// Whether so few rows are best multiplied along the depth.
template <class S>
constexpr bool is_narrow(Eigen::Index rows) noexcept {
  return 4 * rows <= lanes<S>;
}

/// The sums over the lanes of each of `Columns` registers, in the lanes of the first: of as many as there are lanes, or
/// of one. The order of the sum is the same.
template <class S, int Step, int Columns>
[[gnu::always_inline]] inline void sum_lanes(VectorOf<S> (&block)[lanes<S>]) noexcept {
  constexpr int w = lanes<S>;
  if constexpr (Step < w) {
    unroll<Columns == 1 ? 1 : w / (2 * Step)>([&](auto i) __attribute__((always_inline)) {
      constexpr int at = 2 * Step * decltype(i)::value;
      VectorOf<S> other = block[Columns == 1 ? at : at + Step];
      exchange<VectorOf<S>, Step>(block[at], other, std::make_integer_sequence<int, w>{});
      block[at] += other;
    });
    sum_lanes<S, 2 * Step, Columns>(block);
  }
}

/// y = start + w x for few rows. `scratch` holds the rows of w, each padded to whole registers.
template <class S>
void multiply_narrow(ConstMatrix<S> w, ConstMatrix<S> x, Start<S> start, Matrix<S> y, S* scratch) noexcept {
  constexpr Eigen::Index l = lanes<S>;
  const Eigen::Index depth = w.cols(), padded = padded_rows<S>(depth), stride = x.outerStride();
  for (Eigen::Index i = 0; i < w.rows(); ++i) {
    S* row = scratch + i * padded;
    for (Eigen::Index k = 0; k < padded; ++k) row[k] = k < depth ? w(i, k) : S(0);
    for (Eigen::Index first = 0; first < x.cols(); first += l) {
      const Eigen::Index count = std::min(l, x.cols() - first);
      const S* from = x.data() + first * stride;
      const auto sum_columns = [&](auto columns) __attribute__((always_inline)) {
        constexpr int n_columns = decltype(columns)::value;
        VectorOf<S> sum[l] = {};
        const auto add = [&](const VectorOf<S>& factor, auto&& read) __attribute__((always_inline)) {
          unroll<n_columns>([&](auto n) __attribute__((always_inline)) {
            // Those beyond the last column repeat it.
            sum[n] = sum[n] + factor * read(from + std::min<Eigen::Index>(n, count - 1) * stride);
          });
        };
        Eigen::Index k = 0;
        for (; k + l <= depth; k += l) {
          add(
              load<S>(row + k), [&](const S* at) __attribute__((always_inline)) { return load<S>(at + k); });
        }
        if (k < depth) {
          add(
              load<S>(row + k), [&](const S* at)
                                    __attribute__((always_inline)) { return load_part<S>(at + k, depth - k); });
        }
        // One column may be summed as if it were all of them.
        sum_lanes<S, 1, n_columns>(sum);
        return sum[0];
      };
      const VectorOf<S> total = count == 1 ? sum_columns(std::integral_constant<int, 1>{})
                                           : sum_columns(std::integral_constant<int, lanes<S>>{});
      S sums[l];
      store<S>(sums, total);
      for (Eigen::Index j = 0; j < count; ++j) {
        const S before = start.from == nullptr ? S(0) : start.from[i + (first + j) * start.stride];
        y(i, first + j) = before + sums[j];
      }
    }
  }
}

/// V registers of rows of y = start + w x for a single column. The last register has `last` rows.
template <class S, int V>
[[gnu::noinline]] void multiply_column(Eigen::Index depth, const S* a, Eigen::Index a_step, const S* x, const S* start,
                                       S* y, Eigen::Index last) noexcept {
  using Vector = VectorOf<S>;
  const bool part = masked<S> || last < lanes<S>;
  Vector sum[V] = {};
  if (start != nullptr) load_rows<S, V>(start, part, last, sum);
  for (Eigen::Index k = 0; k < depth; ++k, a += a_step) {
    Vector left[V];
    load_rows<S, V>(a, part, last, left);
    const Vector factor = x[k] - Vector{};
    unroll<V>([&](auto v) __attribute__((always_inline)) { sum[v] = sum[v] + left[v] * factor; });
  }
  store_rows<S, V>(y, part, last, sum);
}

/// y = start + w x for a single column, straight from w.
template <class S>
void multiply_column(Eigen::Index rows, Eigen::Index depth, const S* a, Eigen::Index a_step, const S* x, const S* start,
                     S* y) noexcept {
  constexpr Eigen::Index w = lanes<S>;
  const Eigen::Index vectors = padded_rows<S>(rows) / w;
  Eigen::Index v = 0;
  while (v < vectors) {
    const auto go = [&](auto taken) {
      constexpr int n = decltype(taken)::value;
      if (vectors - v < n) return false;
      const Eigen::Index row = v * w;
      multiply_column<S, n>(depth, a + row, a_step, x, start ? start + row : nullptr, y + row,
                            std::min(w, rows - row - (n - 1) * w));
      v += n;
      return true;
    };
    if constexpr (tile_vectors == 4) {
      if (go(std::integral_constant<int, 16>{})) continue;
    }
    if (go(std::integral_constant<int, 8>{})) continue;
    if (go(std::integral_constant<int, 4>{})) continue;
    if (go(std::integral_constant<int, 2>{})) continue;
    go(std::integral_constant<int, 1>{});
  }
}

/// As `product`, and calls `after(first, count)` for the columns [first, first + count) of y when they are done, each
/// once.
template <class S, class After>
void product_by_strips(ConstMatrix<S> w, ConstMatrix<S> x, Start<S> start, Matrix<S> y, S* scratch,
                       After&& after) noexcept {
  assert(w.cols() == x.rows() && w.rows() == y.rows() && x.cols() == y.cols());
  const Eigen::Index rows = w.rows(), depth = w.cols(), columns = x.cols();
  if (is_narrow<S>(rows)) {
    multiply_narrow<S>(w, x, start, y, scratch);
    after(Eigen::Index{0}, columns);
    return;
  }
  if (columns == 1) {
    multiply_column<S>(rows, depth, w.data(), w.outerStride(), x.data(), start.from, y.data());
    after(Eigen::Index{0}, Eigen::Index{1});
    return;
  }
  // Copying pays when the copy is used often. Sums that start from y must not overlap.
  const bool direct = rows >= lanes<S> && columns <= 2 * tile_columns && start.from != y.data();
  if (!direct) pack_panels<S>(rows, depth, w.data(), w.outerStride(), scratch);
  const Eigen::Index strip = strip_columns(rows * depth);
  for (Eigen::Index first = 0; first < columns; first += strip) {
    const Eigen::Index count = std::min(strip, columns - first);
    multiply_panels<S>(rows, count, depth, direct ? w.data() : scratch, direct ? w.outerStride() : 0,
                       {x.data() + first * x.outerStride(), 1, x.outerStride()},
                       {start.from ? start.from + first * start.stride : nullptr, start.stride},
                       y.data() + first * y.outerStride(), y.outerStride());
    after(first, count);
  }
}

}  // namespace detail

/// How many numbers of scratch memory the products below need for a matrix w of `rows` x `cols`, with any number of
/// columns.
template <class S>
Eigen::Index product_scratch(Eigen::Index rows, Eigen::Index cols) noexcept {
  using detail::padded_rows;
  const Eigen::Index forward = padded_rows<S>(rows) * padded_rows<S>(cols), backward = padded_rows<S>(cols) * rows;
  const Eigen::Index outer = padded_rows<S>(rows) * detail::outer_depth;
  return std::max({forward, backward, outer});
}

/// y = w x (+ y), with w (m x k), x (k x n), y (m x n). `bias` (m) is added to every column where it is not null; it is
/// for `Into::set`. y overlaps neither operand. `scratch` holds product_scratch<S>(m, k) numbers, best aligned to 64
/// bytes.
template <class S>
void product(ConstMatrix<S> w, ConstMatrix<S> x, Matrix<S> y, S* scratch, Into into = Into::set,
             const S* bias = nullptr) noexcept {
  assert(into == Into::set || bias == nullptr);
  const detail::Start<S> start =
      into == Into::add ? detail::Start<S>{y.data(), y.outerStride()} : detail::Start<S>{bias, 0};
  detail::product_by_strips<S>(w, x, start, y, scratch, [](Eigen::Index, Eigen::Index) {});
}

/// x = w^T y (+ x), with w (m x k), y (m x n), x (k x n). `scratch` as for `product`.
template <class S>
void transposed_product(ConstMatrix<S> w, ConstMatrix<S> y, Matrix<S> x, S* scratch, Into into = Into::set) noexcept {
  assert(w.rows() == y.rows() && w.cols() == x.rows() && x.cols() == y.cols());
  const Eigen::Index rows = w.cols(), depth = w.rows(), columns = y.cols();
  detail::pack_transposed_panels<S>(rows, depth, w.data(), w.outerStride(), scratch);
  const Eigen::Index strip = detail::strip_columns(rows * depth);
  for (Eigen::Index first = 0; first < columns; first += strip) {
    S* to = x.data() + first * x.outerStride();
    detail::multiply_panels<S>(rows, std::min(strip, columns - first), depth, scratch, 0,
                               {y.data() + first * y.outerStride(), 1, y.outerStride()},
                               {into == Into::add ? to : nullptr, x.outerStride()}, to, x.outerStride());
  }
}

/// w += y x^T, with y (m x n), x (k x n), w (m x k): the sum over columns of outer products, in their order. `scratch`
/// as for `product`.
template <class S>
void outer_product(ConstMatrix<S> y, ConstMatrix<S> x, Matrix<S> w, S* scratch) noexcept {
  assert(w.rows() == y.rows() && w.cols() == x.rows() && x.cols() == y.cols());
  using detail::lanes, detail::outer_depth;
  const Eigen::Index rows = w.rows(), cols = w.cols(), columns = x.cols();
  if (detail::is_narrow<S>(rows) && cols >= lanes<S>) {
    // A few rows fill no register; the transpose does.
    detail::multiply_panels<S>(cols, rows, columns, x.data(), x.outerStride(), {y.data(), y.outerStride(), 1},
                               {nullptr, 0}, scratch, cols);
    for (Eigen::Index j = 0; j < cols; ++j) {
      for (Eigen::Index i = 0; i < rows; ++i) w(i, j) += scratch[j + i * cols];
    }
    return;
  }
  const detail::Start<S> start{w.data(), w.outerStride()};
  for (Eigen::Index first = 0; first < columns; first += outer_depth) {
    const Eigen::Index depth = std::min(outer_depth, columns - first);
    detail::pack_panels<S>(rows, depth, y.data() + first * y.outerStride(), y.outerStride(), scratch);
    detail::multiply_panels<S>(rows, cols, depth, scratch, 0, {x.data() + first * x.outerStride(), x.outerStride(), 1},
                               start, w.data(), w.outerStride());
  }
}

}  // namespace traceur::nn
