// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <type_traits>

#include <Eigen/Core>

#include <traceur/nn/product.hpp>

namespace traceur::nn::detail {

// Products with the matrix of all patches of an image, which is never written down: row k of it is the image itself, shifted
// by offsets[k], and its columns are the places of the kernel, `width` to an output row. An offset is that of number
// (c, i, j) under the kernel from number (0, 0, 0).

/// An image with its border, its output places, and where they begin.
struct Places {
  Eigen::Index rows, width;          // of places
  Eigen::Index row_stride, stride;   // numbers of the image from place to place
};

/// Calls f(constant, first) for pieces of 6, 4, 2 and 1 of n.
template <class F>
[[gnu::always_inline]] inline void for_each_tile(Eigen::Index n, F&& f) noexcept {
  Eigen::Index first = 0;
  for (; first + 6 <= n; first += 6) f(std::integral_constant<int, 6>{}, first);
  for (; first + 4 <= n; first += 4) f(std::integral_constant<int, 4>{}, first);
  for (; first + 2 <= n; first += 2) f(std::integral_constant<int, 2>{}, first);
  if (first < n) f(std::integral_constant<int, 1>{}, first);
}

/// Calls f(constant, first) for panels of `tile_vectors` registers of rows, and a last one of what remains.
template <class S, class F>
[[gnu::always_inline]] inline void for_each_panel(Eigen::Index rows, F&& f) noexcept {
  const Eigen::Index vectors = padded_rows<S>(rows) / lanes<S>;
  Eigen::Index v = 0;
  for (; v + tile_vectors <= vectors; v += tile_vectors) f(std::integral_constant<int, tile_vectors>{}, v * lanes<S>);
  if constexpr (tile_vectors > 2) {
    for (; v + 2 <= vectors; v += 2) f(std::integral_constant<int, 2>{}, v * lanes<S>);
  }
  for (; v < vectors; ++v) f(std::integral_constant<int, 1>{}, v * lanes<S>);
}

/// Numbers of the packed form of a matrix: a column for where sums start, and the panels.
template <class S>
constexpr Eigen::Index packed_size(Eigen::Index rows, Eigen::Index depth) noexcept {
  return padded_rows<S>(rows) * (depth + 1);
}

/// Packs the matrix at(row, k) and the column start(row); rows are filled up with zeros.
template <class S, class At, class First>
void pack_rows(Eigen::Index rows, Eigen::Index depth, At&& at, First&& start, S* to) noexcept {
  for (Eigen::Index row = 0; row < padded_rows<S>(rows); ++row) *to++ = row < rows ? start(row) : S(0);
  for_each_panel<S>(rows, [&](auto vectors, Eigen::Index first) {
    const Eigen::Index height = vectors * lanes<S>;
    for (Eigen::Index k = 0; k < depth; ++k) {
      for (Eigen::Index i = 0; i < height; ++i) *to++ = first + i < rows ? at(first + i, k) : S(0);
    }
  });
}

template <class S, int V, int N>
[[gnu::noinline]] void shifted_tile(Eigen::Index depth, const S* panel, const int* offsets, const S* image,
                                    Eigen::Index stride, const S* start, Eigen::Index start_stride, S* out,
                                    Eigen::Index out_stride) noexcept {
  using Vector = VectorOf<S>;
  constexpr int w = lanes<S>;
  Vector sum[N][V];
  unroll<N>([&](auto n) __attribute__((always_inline)) {
    unroll<V>([&](auto v) __attribute__((always_inline)) { sum[n][v] = load<S>(start + n * start_stride + v * w); });
  });
  for (Eigen::Index k = 0; k < depth; ++k, panel += V * w) {
    const S* const from = image + offsets[k];
    Vector left[V];
    unroll<V>([&](auto v) __attribute__((always_inline)) { left[v] = load<S>(panel + v * w); });
    unroll<N>([&](auto n) __attribute__((always_inline)) {
      const Vector factor = from[n * stride] - Vector{};
      unroll<V>([&](auto v) __attribute__((always_inline)) { sum[n][v] = sum[n][v] + left[v] * factor; });
    });
  }
  unroll<N>([&](auto n) __attribute__((always_inline)) {
    unroll<V>([&](auto v) __attribute__((always_inline)) { store<S>(out + n * out_stride + v * w, sum[n][v]); });
  });
}

/// out (padded rows x places) = start + packed matrix times patches.
template <class S>
void shifted_product(Eigen::Index rows, Eigen::Index depth, const S* packed, const int* offsets, const S* image,
                     const Places& places, S* out) noexcept {
  const Eigen::Index padded = padded_rows<S>(rows);
  const S* panels = packed + padded;
  for_each_panel<S>(rows, [&](auto vectors, Eigen::Index first) {
    constexpr int v = decltype(vectors)::value;
    // So much of a panel stays in the first-level cache.
    constexpr Eigen::Index block = 24576 / static_cast<Eigen::Index>(sizeof(S)) / (v * lanes<S>);
    for (Eigen::Index k = 0; k < depth; k += block) {
      for (Eigen::Index r = 0; r < places.rows; ++r) {
        for_each_tile(places.width, [&](auto columns, Eigen::Index q) {
          constexpr int n = decltype(columns)::value;
          S* const to = out + (r * places.width + q) * padded + first;
          shifted_tile<S, v, n>(std::min(block, depth - k), panels + k * v * lanes<S>, offsets + k,
                                image + r * places.row_stride + q * places.stride, places.stride,
                                k == 0 ? packed + first : to, k == 0 ? 0 : padded, to, padded);
        });
      }
    }
    panels += v * lanes<S> * depth;
  });
}

template <class S, int V, int N>
[[gnu::noinline]] void shifted_outer_tile(Eigen::Index rows, const S* left, Eigen::Index left_step, const int* offsets,
                                          const S* image, const Places& places, S* to, Eigen::Index to_stride) noexcept {
  using Vector = VectorOf<S>;
  constexpr int w = lanes<S>;
  Vector sum[N][V];
  unroll<N * V>([&](auto i) __attribute__((always_inline)) { sum[i / V][i % V] = Vector{}; });
  const S* from[N];
  for (Eigen::Index r = 0; r < places.rows; ++r) {
    unroll<N>([&](auto n) __attribute__((always_inline)) { from[n] = image + offsets[n] + r * places.row_stride; });
    for (Eigen::Index q = 0; q < places.width; ++q, left += left_step) {
      Vector l[V];
      unroll<V>([&](auto v) __attribute__((always_inline)) { l[v] = load<S>(left + v * w); });
      unroll<N>([&](auto n) __attribute__((always_inline)) {
        const Vector factor = from[n][q * places.stride] - Vector{};
        unroll<V>([&](auto v) __attribute__((always_inline)) { sum[n][v] = sum[n][v] + l[v] * factor; });
      });
    }
  }
  const Eigen::Index last = rows - (V - 1) * w;
  unroll<N>([&](auto n) __attribute__((always_inline)) {
    unroll<V>([&](auto v) __attribute__((always_inline)) {
      S* const at = to + n * to_stride + v * w;
      if (v + 1 < V || last >= w) {
        store<S>(at, load<S>(at) + sum[n][v]);
      } else {
        store_part<S>(at, load_part<S>(at, last) + sum[n][v], last);
      }
    });
  });
}

/// to (rows x depth) += left (padded rows x places) times the transpose of the patches.
template <class S>
void shifted_outer_product(Eigen::Index rows, Eigen::Index depth, const S* left, const int* offsets, const S* image,
                           const Places& places, S* to) noexcept {
  const Eigen::Index padded = padded_rows<S>(rows);
  for_each_panel<S>(rows, [&](auto vectors, Eigen::Index first) {
    constexpr int v = decltype(vectors)::value;
    for_each_tile(depth, [&](auto columns, Eigen::Index k) {
      constexpr int n = decltype(columns)::value;
      shifted_outer_tile<S, v, n>(rows - first, left + first, padded, offsets + k, image, places, to + first + k * rows,
                                  rows);
    });
  });
}

}  // namespace traceur::nn::detail
