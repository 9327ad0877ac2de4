// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Core>

#include <traceur/core/detail/tiles.hpp>

namespace traceur::parameterize::detail {

using core::detail::lanes;
using core::detail::multiply_panels;
using core::detail::pack_panels;
using core::detail::padded_rows;
using core::detail::Right;
using core::detail::Start;
using core::detail::unroll;

/// Cholesky's factorisation of a symmetric, positive definite matrix and the solution of systems with it. The matrix is
/// the lower triangle of `size` columns, `stride` apart; each has memory for `size` rows filled up to a whole number of
/// registers, of which the last rows are not read for what they hold.
///
/// Columns are finished `narrow` at a time: first all that finished columns take away from them, as one product, then
/// their own triangle, in registers. Large matrices are cut into blocks of `wide` columns, which are taken away from
/// all columns to their right at once, so that what is multiplied stays in a near cache.
class Definite {
public:
  using Index = Eigen::Index;

  /// Keeps a view of the matrix.
  Definite(double* matrix, Index stride, Index size) : a_(matrix), stride_(stride), size_(size) {}

  /// Leaves the factor in the lower triangle; false where the matrix is not definite to rounding.
  bool factorize() {
    const Index step = size_ <= 2 * wide ? size_ : wide;
    std::vector<double> right(
        static_cast<std::size_t>(std::max(narrow, strip) * std::min(size_, std::max(wide, step)))),
        panels;
    for (Index first = 0; first < size_; first += step) {
      const Index end = std::min(first + step, size_);
      for (Index j = first; j < end; j += narrow) {
        const Index count = std::min(narrow, end - j);
        negative_rows(j, count, first, j - first, right.data());
        multiply_panels<double>(padded_rows<double>(size_ - j), count, j - first, at(j, first), stride_,
                                {right.data(), count, 1}, {at(j, j), stride_}, at(j, j), stride_);
        if (!finish(j, count)) return false;
      }
      if (end == size_) break;
      const Index rows = size_ - end, depth = end - first;
      panels.resize(static_cast<std::size_t>(padded_rows<double>(rows) * depth));
      pack_panels<double>(rows, depth, at(end, first), stride_, panels.data());
      for (Index j = end; j < size_; j += strip) {
        const Index count = std::min(strip, size_ - j);
        negative_rows(j, count, first, depth, right.data());
        multiply_panels<double>(size_ - j, count, depth, panels.data() + (j - end) * depth, 0, {right.data(), count, 1},
                                {at(j, j), stride_}, at(j, j), stride_);
      }
    }
    return true;
  }

  /// Every row y of `rows` (rows x size, a whole number of registers of rows) becomes the x of matrix x = y.
  void solve(double* rows, Index count) const {
    if (size_ == 0) return;
    // Finished columns have the other sign than those to come, so that products add; the two passes bring it back.
    for (Index j = 0; j < size_; j += narrow) {
      const Index width = std::min(narrow, size_ - j);
      double* to = rows + j * count;
      multiply_panels<double>(count, width, j, rows, count, {at(j, 0), stride_, 1}, {to, count}, to, count);
      const Triangle t(at(j, j), stride_, width);
      for (Index r = 0; r < count; r += lanes<double>) t.divide<false>(to + r, count, width);
      for (Index i = 0; i < width * count; ++i) to[i] = -to[i];
    }
    for (Index j = (size_ - 1) / narrow * narrow; j >= 0; j -= narrow) {
      const Index width = std::min(narrow, size_ - j), next = j + width;
      double* to = rows + j * count;
      multiply_panels<double>(count, width, size_ - next, rows + next * count, count, {at(next, j), 1, stride_},
                              {to, count}, to, count);
      const Triangle t(at(j, j), stride_, width);
      for (Index r = 0; r < count; r += lanes<double>) t.divide<true>(to + r, count, width);
      for (Index i = 0; i < width * count; ++i) to[i] = -to[i];
    }
  }

private:
  // A multiple of the lanes; a strip is one of a tile's columns and of a panel's rows as well.
  static constexpr Index narrow = 16, wide = 128, strip = 96;

  /// A triangle of the factor, filled up to `narrow` with that of the identity.
  struct Triangle {
    double entry[narrow][narrow] = {};  // [column][row]
    double inverse[narrow];

    Triangle(const double* from, Index stride, Index width) {
      for (Index c = 0; c < narrow; ++c) {
        for (Index r = c; r < width && c < width; ++r) entry[c][r] = from[r + c * stride];
        inverse[c] = c < width ? 1.0 / entry[c][c] : 1.0;
      }
    }

    /// A register of rows times the inverse of this, or of its transpose as `Plain` is not set, from the right.
    template <bool Plain>
    void divide(double* rows, Index stride, Index width) const {
      core::detail::VectorOf<double> x[narrow];
      constexpr int n = static_cast<int>(narrow);
      unroll<n>([&](auto c) __attribute__((always_inline)) {
        x[c] = c < width ? core::detail::load<double>(rows + c * stride) : core::detail::VectorOf<double>{};
      });
      unroll<n>([&](auto done) __attribute__((always_inline)) {
        constexpr int c = Plain ? n - 1 - decltype(done)::value : decltype(done)::value;
        x[c] = x[c] * inverse[c];
        unroll<n - 1 - decltype(done)::value>([&](auto left) __attribute__((always_inline)) {
          constexpr int to = Plain ? decltype(left)::value : c + 1 + decltype(left)::value;
          x[to] = x[to] - x[c] * (Plain ? entry[to][c] : entry[c][to]);
        });
      });
      unroll<n>([&](auto c) __attribute__((always_inline)) {
        if (c < width) core::detail::store<double>(rows + c * stride, x[c]);
      });
    }
  };

  double* at(Index i, Index j) const noexcept { return a_ + i + j * stride_; }

  // Rows [j, j + count) of `depth` columns from `first` on, negative, a row's numbers `count` apart.
  void negative_rows(Index j, Index count, Index first, Index depth, double* to) const {
    for (Index k = 0; k < depth; ++k) {
      const double* from = at(j, first + k);
      for (Index c = 0; c < count; ++c) *to++ = -from[c];
    }
  }

  // Columns [j, j + count) from the values that earlier columns have left there.
  bool finish(Index j, Index count) {
    double* corner = at(j, j);
    for (Index c = 0; c < count; ++c) {
      double* column = corner + c * stride_;
      const double square = column[c];
      if (!(square > 0.0) || !std::isfinite(square)) return false;
      const double root = std::sqrt(square);
      column[c] = root;
      for (Index r = c + 1; r < count; ++r) column[r] /= root;
      for (Index k = c + 1; k < count; ++k) {
        double* other = corner + k * stride_;
        for (Index r = k; r < count; ++r) other[r] -= column[r] * column[k];
      }
    }
    const Triangle t(corner, stride_, count);
    // Rows below a triangle that ends the matrix are nobody's.
    for (Index r = count; r < size_ - j; r += lanes<double>) t.divide<false>(corner + r, stride_, count);
    return true;
  }

  double* a_;
  Index stride_, size_;
};

}  // namespace traceur::parameterize::detail
