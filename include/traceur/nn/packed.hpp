// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cassert>

#include <Eigen/Core>

#include <traceur/nn/module.hpp>
#include <traceur/nn/product.hpp>

namespace traceur::nn {

/// A matrix in the form that products work on, copied once for many of them. Worth it where weights stay the same and a
/// product has few columns: `product` copies the matrix each time. The bits are those of `product`, but for matrices of at
/// most a quarter of a register of rows, which that sums in another order.
template <class S>
class PackedMatrix {
public:
  PackedMatrix() = default;
  /// Room for a matrix of `rows` x `cols`. Throws Error unless both are at least 1.
  PackedMatrix(Eigen::Index rows, Eigen::Index cols) : rows_(rows), cols_(cols) {
    detail::check_positive("packed matrix", "row", rows);
    detail::check_positive("packed matrix", "column", cols);
    panels_.resize(detail::padded_rows<S>(rows) * cols);
  }

  Eigen::Index rows() const noexcept { return rows_; }
  Eigen::Index cols() const noexcept { return cols_; }

  /// Copies w, rows() x cols().
  void pack(ConstMatrix<S> w) noexcept {
    assert(w.rows() == rows_ && w.cols() == cols_);
    detail::pack_panels<S>(rows_, cols_, w.data(), w.outerStride(), panels_.data());
  }

  /// y = w x (+ y), with `bias` as `nn::product` has it. Calls `after(first, count)` for the columns [first, first + count)
  /// of y when they are done, each once and in order.
  template <class After>
  void multiply(ConstMatrix<S> x, Matrix<S> y, Into into, const S* bias, After&& after) const noexcept {
    assert(x.rows() == cols_ && y.rows() == rows_ && x.cols() == y.cols() && (into == Into::set || bias == nullptr));
    const Eigen::Index strip = detail::strip_columns(rows_ * cols_);
    for (Eigen::Index first = 0; first < x.cols(); first += strip) {
      const Eigen::Index count = std::min(strip, x.cols() - first);
      S* const to = y.data() + first * y.outerStride();
      detail::multiply_panels<S>(rows_, count, cols_, panels_.data(), 0,
                                 {x.data() + first * x.outerStride(), 1, x.outerStride()},
                                 into == Into::add ? detail::Start<S>{to, y.outerStride()} : detail::Start<S>{bias, 0}, to,
                                 y.outerStride());
      after(first, count);
    }
  }
  void multiply(ConstMatrix<S> x, Matrix<S> y, Into into = Into::set, const S* bias = nullptr) const noexcept {
    multiply(x, y, into, bias, [](Eigen::Index, Eigen::Index) {});
  }

private:
  Eigen::Index rows_ = 0, cols_ = 0;
  Eigen::Matrix<S, Eigen::Dynamic, 1> panels_;
};

}  // namespace traceur::nn
