// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <concepts>

#include <Eigen/Core>

#include <traceur/core/random.hpp>

namespace traceur::nn {

/// Fills the weights of a layer, column-major, rows = outputs (fan out), cols = inputs (fan in), from a random stream.
/// May allocate.
template <class I, class S = float>
concept Initializer = requires(const I& initializer, S* weights, Eigen::Index rows, Eigen::Index cols,
                               core::RandomStream& random) {
  { initializer(weights, rows, cols, random) } -> std::same_as<void>;
};

namespace detail {

template <class S>
void fill_uniform(S* values, Eigen::Index count, double bound, core::RandomStream& random) noexcept {
  for (Eigen::Index i = 0; i < count; ++i) values[i] = static_cast<S>(random.uniform(-bound, bound));
}

template <class S>
void fill_normal(S* values, Eigen::Index count, double deviation, core::RandomStream& random) noexcept {
  for (Eigen::Index i = 0; i < count; ++i) values[i] = static_cast<S>(random.normal(0.0, deviation));
}

}  // namespace detail

/// All zeros.
struct Zeros {
  template <class S>
  void operator()(S* weights, Eigen::Index rows, Eigen::Index cols, core::RandomStream&) const noexcept {
    for (Eigen::Index i = 0; i < rows * cols; ++i) weights[i] = S(0);
  }
};

/// Normal with a given standard deviation: small, to start an output layer near zero.
struct Normal {
  double deviation = 0.01;
  template <class S>
  void operator()(S* weights, Eigen::Index rows, Eigen::Index cols, core::RandomStream& random) const noexcept {
    detail::fill_normal(weights, rows * cols, deviation, random);
  }
};

/// Uniform in +-1 / sqrt(fan in): what PyTorch starts linear layers with, there for weights and biases alike.
struct UniformFanIn {
  template <class S>
  void operator()(S* weights, Eigen::Index rows, Eigen::Index cols, core::RandomStream& random) const noexcept {
    detail::fill_uniform(weights, rows * cols, 1.0 / std::sqrt(static_cast<double>(cols)), random);
  }
};

/// Variance 1 / fan in: LeCun, Bottou, Orr and Mueller, "Efficient BackProp" (1998), eq. 16. For tanh-like activations
/// and those scaled to unit gain.
struct LeCun {
  double gain = 1.0;
  template <class S>
  void operator()(S* weights, Eigen::Index rows, Eigen::Index cols, core::RandomStream& random) const noexcept {
    detail::fill_normal(weights, rows * cols, gain / std::sqrt(static_cast<double>(cols)), random);
  }
};

/// Uniform of variance 2 / (fan in + fan out): Glorot and Bengio, "Understanding the difficulty of training deep
/// feedforward neural networks" (2010), eq. 16; also named after Xavier Glorot.
struct Glorot {
  double gain = 1.0;
  template <class S>
  void operator()(S* weights, Eigen::Index rows, Eigen::Index cols, core::RandomStream& random) const noexcept {
    detail::fill_uniform(weights, rows * cols, gain * std::sqrt(6.0 / static_cast<double>(rows + cols)), random);
  }
};

/// Normal of variance 2 / ((1 + slope^2) fan in): He, Zhang, Ren and Sun, "Delving Deep into Rectifiers" (2015), eqs.
/// 10 and 15, for rectifiers whose slope for negative numbers is `slope`.
struct He {
  double slope = 0.0;
  template <class S>
  void operator()(S* weights, Eigen::Index rows, Eigen::Index cols, core::RandomStream& random) const noexcept {
    const double variance = 2.0 / ((1.0 + slope * slope) * static_cast<double>(cols));
    detail::fill_normal(weights, rows * cols, std::sqrt(variance), random);
  }
};

/// `gain` times a matrix with orthonormal columns, or rows where those are fewer, uniform among all such: Saxe,
/// McClelland and Ganguli, "Exact solutions to the nonlinear dynamics of learning in deep linear neural networks"
/// (2014).
struct Orthogonal {
  double gain = 1.0;
  template <class S>
  void operator()(S* weights, Eigen::Index rows, Eigen::Index cols, core::RandomStream& random) const {
    const bool tall = rows >= cols;
    Eigen::MatrixXd q(tall ? rows : cols, tall ? cols : rows);
    for (Eigen::Index j = 0; j < q.cols(); ++j) {
      auto column = q.col(j);
      double left = 0.0;
      do {
        for (Eigen::Index i = 0; i < q.rows(); ++i) column[i] = random.normal();
        const double length = column.norm();
        // Twice is enough to lose nothing to rounding (Giraud, Langou and Rozloznik 2005).
        for (int pass = 0; pass < 2; ++pass) {
          for (Eigen::Index k = 0; k < j; ++k) column -= q.col(k).dot(column) * q.col(k);
        }
        left = column.norm() / length;
      } while (!(left > 1e-6));
      column /= column.norm();
    }
    for (Eigen::Index j = 0; j < cols; ++j) {
      for (Eigen::Index i = 0; i < rows; ++i) weights[i + j * rows] = static_cast<S>(gain * (tall ? q(i, j) : q(j, i)));
    }
  }
};

}  // namespace traceur::nn
