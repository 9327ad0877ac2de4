// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cassert>
#include <cstdint>
#include <type_traits>
#include <utility>

#include <Eigen/Core>

#include <traceur/core/detail/tiles.hpp>
#include <traceur/core/pack.hpp>
#include <traceur/nn/module.hpp>

namespace traceur::nn {

/// Whether a product replaces what is in its destination or is added to it.
enum class Into { set, add };

namespace detail {

// Products go by panels and tiles, see core/detail/tiles.hpp. Matrices of a few rows, which would leave most of a
// register empty, are multiplied along the depth instead, again in an order that nothing but the depth decides. Hence
// the law that a column has the same bits alone and in any batch.
using core::detail::AsTheyAre;
using core::detail::lanes;
using core::detail::load;
using core::detail::load_part;
using core::detail::load_rows;
using core::detail::masked;
using core::detail::multiply_panel;
using core::detail::multiply_panels;
using core::detail::pack_panels;
using core::detail::pack_tiles;
using core::detail::PackedRight;
using core::detail::padded_rows;
using core::detail::panel_vectors;
using core::detail::Right;
using core::detail::Start;
using core::detail::store;
using core::detail::store_part;
using core::detail::store_rows;
using core::detail::tile_columns;
using core::detail::tile_vectors;
using core::detail::unroll;
using core::detail::VectorOf;

// Terms of an outer product summed at a time: their operands stay in a near cache.
inline constexpr Eigen::Index outer_depth = 256;
// An outer product reads its right operand across columns, of which a cache may hold few if their stride is a power of
// two. From so many registers of rows on a copy pays, of so many columns of the result at a time.
inline constexpr Eigen::Index outer_copied = 24, outer_columns = 16 * tile_columns;
// Columns of a product finished at a time, and handed on while they are still in a near cache. A left operand that does
// not stay there itself is fetched anew for each strip.
constexpr Eigen::Index strip_columns(Eigen::Index size) noexcept { return (size > 1 << 17 ? 32 : 8) * tile_columns; }

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
    for (Eigen::Index k = 0; k < depth; k += w) {
      const Eigen::Index count = std::min(w, depth - k);
      for (int i = 0; i < taken; ++i) {
        const Eigen::Index row = (v + i) * w, columns = std::min(w, rows - row);
        const S* from = a + row * stride + k;
        S* panel = to + k * taken * w + i * w;
        VectorOf<S> block[lanes<S>];
        if (columns == w && count == w) {
          unroll<lanes<S>>([&](auto n) __attribute__((always_inline)) { block[n] = load<S>(from + n * stride); });
          transpose<S>(block);
          unroll<lanes<S>>([&](auto n) __attribute__((always_inline)) { store<S>(panel + n * taken * w, block[n]); });
        } else {
          unroll<lanes<S>>([&](auto n) __attribute__((always_inline)) {
            block[n] = n < columns ? load_part<S>(from + n * stride, count) : VectorOf<S>{};
          });
          transpose<S>(block);
          unroll<lanes<S>>([&](auto n) __attribute__((always_inline)) {
            if (n < count) store<S>(panel + n * taken * w, block[n]);
          });
        }
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

// A matrix of more numbers than this is fetched from a far cache for every single column, so columns of it that meet a
// zero are worth finding.
inline constexpr Eigen::Index sparing_size = 1 << 15;

/// V registers of rows of y = start + w x for a single column, of the last one only `last` rows if `Part`. If
/// `Sparing`, only the `depth` columns of w that `columns` lists.
template <class S, int V, bool Sparing, bool Part>
[[gnu::noinline]] void multiply_column(Eigen::Index depth, const S* a, Eigen::Index a_step, const S* x,
                                       const std::int32_t* columns, const S* start, S* y, Eigen::Index last) noexcept {
  using Vector = VectorOf<S>;
  Vector sum[V] = {};
  if (start != nullptr) load_rows<S, V, Part>(start, last, sum);
  for (Eigen::Index i = 0; i < depth; ++i) {
    const Eigen::Index k = Sparing ? Eigen::Index{columns[i]} : i;
    Vector left[V];
    load_rows<S, V, Part>(a + k * a_step, last, left);
    const Vector factor = x[k] - Vector{};
    unroll<V>([&](auto v) __attribute__((always_inline)) { sum[v] = sum[v] + left[v] * factor; });
  }
  store_rows<S, V, Part>(y, last, sum);
}

template <class S, bool Sparing>
void multiply_column(Eigen::Index rows, Eigen::Index depth, const S* a, Eigen::Index a_step, const S* x,
                     const std::int32_t* columns, const S* start, S* y) noexcept {
  constexpr Eigen::Index w = lanes<S>;
  const Eigen::Index vectors = padded_rows<S>(rows) / w;
  Eigen::Index v = 0;
  while (v < vectors) {
    const auto go = [&](auto taken) {
      constexpr int n = decltype(taken)::value;
      if (vectors - v < n) return false;
      const Eigen::Index row = v * w, last = std::min(w, rows - row - (n - 1) * w);
      const auto multiply = [&](auto part) {
        multiply_column<S, n, Sparing, decltype(part)::value>(depth, a + row, a_step, x, columns,
                                                              start ? start + row : nullptr, y + row, last);
      };
      if (masked<S> || last < w) {
        multiply(std::true_type{});
      } else {
        multiply(std::false_type{});
      }
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

/// y = start + w x for a single column, straight from w. Columns of a large matrix that meet an exact zero, as a ReLU
/// leaves many, are not read: a sum does not change by them, unless they are not finite. `scratch` as for `product`.
template <class S>
void multiply_column(Eigen::Index rows, Eigen::Index depth, const S* a, Eigen::Index a_step, const S* x, const S* start,
                     S* y, S* scratch) noexcept {
  if (rows * depth <= sparing_size || rows < lanes<S>) {
    return multiply_column<S, false>(rows, depth, a, a_step, x, nullptr, start, y);
  }
  auto* const columns = reinterpret_cast<std::int32_t*>(scratch);
  Eigen::Index count = 0;
  for (Eigen::Index k = 0; k < depth; ++k) {
    columns[count] = static_cast<std::int32_t>(k);
    count += x[k] != S(0) ? 1 : 0;
  }
  multiply_column<S, true>(rows, count, a, a_step, x, columns, start, y);
}

/// As `product`, and calls `after(first, count)` for the columns [first, first + count) of y when they are done, each
/// once. If `end` does something, it does so instead of `after` where sums are in tiles.
template <class S, class After, class End = AsTheyAre>
void product_by_strips(ConstMatrix<S> w, ConstMatrix<S> x, Start<S> start, Matrix<S> y, S* scratch, After&& after,
                       const End& end = {}) noexcept {
  assert(w.cols() == x.rows() && w.rows() == y.rows() && x.cols() == y.cols());
  const Eigen::Index rows = w.rows(), depth = w.cols(), columns = x.cols();
  if (is_narrow<S>(rows)) {
    multiply_narrow<S>(w, x, start, y, scratch);
    after(Eigen::Index{0}, columns);
    return;
  }
  if (columns == 1) {
    multiply_column<S>(rows, depth, w.data(), w.outerStride(), x.data(), start.from, y.data(), scratch);
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
                       y.data() + first * y.outerStride(), y.outerStride(), end);
    if constexpr (std::is_same_v<End, AsTheyAre>) after(first, count);
  }
}

template <class S, class End = AsTheyAre>
void transposed_product(ConstMatrix<S> w, ConstMatrix<S> y, Matrix<S> x, S* scratch, Into into,
                        const End& end = {}) noexcept {
  assert(w.rows() == y.rows() && w.cols() == x.rows() && x.cols() == y.cols());
  const Eigen::Index rows = w.cols(), depth = w.rows(), columns = y.cols();
  pack_transposed_panels<S>(rows, depth, w.data(), w.outerStride(), scratch);
  const Eigen::Index strip = strip_columns(rows * depth);
  for (Eigen::Index first = 0; first < columns; first += strip) {
    S* to = x.data() + first * x.outerStride();
    multiply_panels<S>(rows, std::min(strip, columns - first), depth, scratch, 0,
                       {y.data() + first * y.outerStride(), 1, y.outerStride()},
                       {into == Into::add ? to : nullptr, x.outerStride()}, to, x.outerStride(), end);
  }
}

}  // namespace detail

/// How many numbers of scratch memory the products below need for a matrix w of `rows` x `cols`, with any number of
/// columns.
template <class S>
Eigen::Index product_scratch(Eigen::Index rows, Eigen::Index cols) noexcept {
  using detail::padded_rows;
  const Eigen::Index forward = padded_rows<S>(rows) * padded_rows<S>(cols), backward = padded_rows<S>(cols) * rows;
  const Eigen::Index outer = (padded_rows<S>(rows) + detail::outer_columns) * detail::outer_depth;
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
  detail::transposed_product<S>(w, y, x, scratch, into);
}

/// w += y x^T, with y (m x n), x (k x n), w (m x k): the sum over columns of outer products, in their order. `scratch`
/// as for `product`.
template <class S>
void outer_product(ConstMatrix<S> y, ConstMatrix<S> x, Matrix<S> w, S* scratch) noexcept {
  assert(w.rows() == y.rows() && w.cols() == x.rows() && x.cols() == y.cols());
  using detail::lanes, detail::outer_columns, detail::outer_copied, detail::outer_depth, detail::padded_rows;
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
  for (Eigen::Index first = 0; first < columns; first += outer_depth) {
    const Eigen::Index depth = std::min(outer_depth, columns - first);
    detail::pack_panels<S>(rows, depth, y.data() + first * y.outerStride(), y.outerStride(), scratch);
    const S* const right = x.data() + first * x.outerStride();
    if (padded_rows<S>(rows) < outer_copied * lanes<S>) {
      detail::multiply_panels<S>(rows, cols, depth, scratch, 0, {right, x.outerStride(), 1},
                                 {w.data(), w.outerStride()}, w.data(), w.outerStride());
      continue;
    }
    S* const tiles = scratch + padded_rows<S>(rows) * depth;
    for (Eigen::Index j = 0; j < cols; j += outer_columns) {
      const Eigen::Index count = std::min(outer_columns, cols - j);
      detail::pack_tiles<S>(count, depth, right + j, x.outerStride(), tiles);
      S* const to = w.data() + j * w.outerStride();
      detail::multiply_panels<S>(rows, count, depth, scratch, 0, detail::PackedRight<S>{tiles, depth},
                                 {to, w.outerStride()}, to, w.outerStride());
    }
  }
}

}  // namespace traceur::nn
