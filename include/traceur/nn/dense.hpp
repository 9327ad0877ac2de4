// SPDX-License-Identifier: MIT
#pragma once

#include <cassert>
#include <cmath>
#include <concepts>
#include <string_view>
#include <type_traits>

#include <Eigen/Core>

#include <traceur/core/random.hpp>
#include <traceur/nn/activation.hpp>
#include <traceur/nn/initializers.hpp>
#include <traceur/nn/module.hpp>
#include <traceur/nn/product.hpp>

namespace traceur::nn {

namespace detail {

template <class S>
using Storage = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;

template <class S>
using FlatStorage = Eigen::Matrix<S, Eigen::Dynamic, 1>;

template <class S>
ConstMatrix<S> weight_matrix(const S* weight, Eigen::Index rows, Eigen::Index cols) noexcept {
  return Eigen::Map<const Storage<S>>(weight, rows, cols);
}

template <class S>
Matrix<S> weight_matrix(S* weight, Eigen::Index rows, Eigen::Index cols) noexcept {
  return Eigen::Map<Storage<S>>(weight, rows, cols);
}

/// sums += the sum of the columns, in their order.
template <class S>
void add_columns(ConstMatrix<S> m, S* sums) noexcept {
  constexpr Eigen::Index w = lanes<S>;
  const auto rows_of = [&](auto vectors, Eigen::Index row) {
    constexpr int n = decltype(vectors)::value;
    VectorOf<S> sum[n];
    unroll<n>([&](auto v) __attribute__((always_inline)) { sum[v] = load<S>(sums + row + v * w); });
    const S* from = m.data() + row;
    for (Eigen::Index j = 0; j < m.cols(); ++j, from += m.outerStride()) {
      unroll<n>([&](auto v) __attribute__((always_inline)) { sum[v] += load<S>(from + v * w); });
    }
    unroll<n>([&](auto v) __attribute__((always_inline)) { store<S>(sums + row + v * w, sum[v]); });
  };
  Eigen::Index row = 0;
  for (; row + 8 * w <= m.rows(); row += 8 * w) rows_of(std::integral_constant<int, 8>{}, row);
  for (; row + 4 * w <= m.rows(); row += 4 * w) rows_of(std::integral_constant<int, 4>{}, row);
  for (; row + w <= m.rows(); row += w) rows_of(std::integral_constant<int, 1>{}, row);
  if (const Eigen::Index left = m.rows() - row; left > 0) {
    VectorOf<S> sum = load_part<S>(sums + row, left);
    const S* from = m.data() + row;
    for (Eigen::Index j = 0; j < m.cols(); ++j, from += m.outerStride()) sum += load_part<S>(from, left);
    store_part<S>(sums + row, sum, left);
  }
}

/// y = A(w x + bias). `kept` gets what A's derivative reads, if `Keep`: it may be y itself if that is the output, and
/// must not be if it is not.
template <class A, bool Keep, class S>
void dense_forward(ConstMatrix<S> weight, const S* bias, ConstMatrix<S> x, Matrix<S> kept, Matrix<S> y,
                   S* scratch) noexcept {
  const Start<S> start{bias, 0};
  constexpr bool through = Keep && !A::reads_output;
  Matrix<S> z = through ? kept : y;
  const auto after = [&](Eigen::Index first, Eigen::Index count) {
    if constexpr (!std::same_as<A, Identity>) {
      activate<A, S>(z.middleCols(first, count), y.middleCols(first, count));
    } else {
      static_cast<void>(first), static_cast<void>(count);
    }
  };
  if constexpr (is_brief<A> && !through) {
    product_by_strips<S>(weight, x, start, z, scratch, after, Activated<A>{});
  } else {
    product_by_strips<S>(weight, x, start, z, scratch, after);
  }
}

/// Adds to the gradients of weight and bias (null for none), and writes dx unless it has no columns. `dz` is the
/// gradient before the activation; `end` is what becomes of dx.
template <class S, class End = AsTheyAre>
void dense_backward(ConstMatrix<S> weight, ConstMatrix<S> x, ConstMatrix<S> dz, Matrix<S> dweight, S* dbias,
                    Matrix<S> dx, S* scratch, const End& end = {}) noexcept {
  outer_product<S>(dz, x, dweight, scratch);
  if (dbias != nullptr) add_columns<S>(dz, dbias);
  if (dx.cols() > 0) transposed_product<S>(weight, dz, dx, scratch, Into::set, end);
}

}  // namespace detail

/// y = A(W x + b) for every column x: W (outputs x inputs) and b (outputs, optional), A an activation.
template <Activation A = Identity>
class Dense {
public:
  template <class S>
  struct Workspace {
    detail::FlatStorage<S> scratch;
    detail::Storage<S> kept;  ///< outputs or values before the activation, whichever its derivative reads
    detail::Storage<S> dz;
  };

  /// Throws Error unless both widths are at least 1.
  Dense(Eigen::Index inputs, Eigen::Index outputs, bool bias = true) : inputs_(inputs), outputs_(outputs), bias_(bias) {
    detail::check_positive("dense", "input", inputs);
    detail::check_positive("dense", "output", outputs);
  }

  Eigen::Index inputs() const noexcept { return inputs_; }
  Eigen::Index outputs() const noexcept { return outputs_; }
  Eigen::Index parameters() const noexcept { return outputs_ * (inputs_ + (bias_ ? 1 : 0)); }
  bool has_bias() const noexcept { return bias_; }

  template <class S>
  Workspace<S> workspace(Eigen::Index max_columns) const {
    detail::check_positive("dense workspace", "column", max_columns);
    Workspace<S> w;
    w.scratch.resize(product_scratch<S>(outputs_, inputs_));
    if constexpr (!linear) {
      w.kept.resize(outputs_, max_columns);
      w.dz.resize(outputs_, max_columns);
    }
    return w;
  }

  template <class S>
  void forward(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    if constexpr (linear) {
      infer<S>(theta, x, w, y);
    } else {
      assert(x.cols() <= w.kept.cols());
      auto kept = w.kept.leftCols(x.cols());
      detail::dense_forward<A, true, S>(weight(theta), bias(theta), x, kept, y, w.scratch.data());
      if constexpr (A::reads_output) kept = y;
    }
  }

  template <class S>
  void infer(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    detail::dense_forward<A, false, S>(weight(theta), bias(theta), x, y, y, w.scratch.data());
  }

  template <class S>
  void backward(const S* theta, ConstMatrix<S> x, ConstMatrix<S> dy, Workspace<S>& w, S* dtheta,
                Matrix<S> dx) const noexcept {
    const Matrix<S> dweight = detail::weight_matrix<S>(dtheta, outputs_, inputs_);
    S* const dbias = bias_ ? dtheta + outputs_ * inputs_ : nullptr;
    if constexpr (linear) {
      detail::dense_backward<S>(weight(theta), x, dy, dweight, dbias, dx, w.scratch.data());
    } else {
      const Eigen::Index n = x.cols();
      activate_backward<A, S>(w.kept.leftCols(n), dy, w.dz.leftCols(n));
      detail::dense_backward<S>(weight(theta), x, w.dz.leftCols(n), dweight, dbias, dx, w.scratch.data());
    }
  }

  /// Weights and biases uniform in +-1 / sqrt(inputs).
  template <class S>
  void initialize(S* theta, core::RandomStream& random) const {
    UniformFanIn{}(theta, outputs_, inputs_, random);
    if (bias_)
      detail::fill_uniform(theta + outputs_ * inputs_, outputs_, 1.0 / std::sqrt(static_cast<double>(inputs_)), random);
  }

  /// Weights by `initializer`, biases zero.
  template <class S, Initializer<S> I>
  void initialize(S* theta, core::RandomStream& random, const I& initializer) const {
    initializer(theta, outputs_, inputs_, random);
    if (bias_) Eigen::Map<detail::FlatStorage<S>>(theta + outputs_ * inputs_, outputs_).setZero();
  }

  /// `weight` and `bias`.
  template <class F>
  void for_each_parameter(F&& f) const {
    f(std::string_view("weight"), Eigen::Index{0}, outputs_, inputs_);
    if (bias_) f(std::string_view("bias"), outputs_ * inputs_, outputs_, Eigen::Index{1});
  }

private:
  static constexpr bool linear = std::same_as<A, Identity>;

  template <class S>
  ConstMatrix<S> weight(const S* theta) const noexcept {
    return detail::weight_matrix<S>(theta, outputs_, inputs_);
  }
  template <class S>
  const S* bias(const S* theta) const noexcept {
    return bias_ ? theta + outputs_ * inputs_ : nullptr;
  }

  Eigen::Index inputs_, outputs_;
  bool bias_;
};

}  // namespace traceur::nn
