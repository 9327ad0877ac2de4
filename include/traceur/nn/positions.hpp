// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>

#include <traceur/nn/module.hpp>

namespace traceur::nn {

namespace detail {

/// Angular frequency of the features 2i and 2i + 1 of a sinusoidal embedding.
inline double sinusoid_frequency(Eigen::Index feature, Eigen::Index width) {
  return std::pow(10000.0, -static_cast<double>(feature - feature % 2) / static_cast<double>(width));
}

inline void check_sinusoid_width(const char* module, Eigen::Index width) {
  check_positive(module, "feature", width);
  if (width % 2 != 0) {
    throw Error(std::string(module) + ": expected an even number of features, got " + std::to_string(width));
  }
}

}  // namespace detail

/// Feature i of the embedding of a position in `width` numbers, sine and cosine in turn:
///
///     e_2i = sin(position / 10000^(2i / width)),   e_2i+1 = cos(position / 10000^(2i / width))
///
/// Vaswani et al., "Attention Is All You Need" (NeurIPS 2017), section 3.5. A shift of the position rotates each pair, and
/// the product of two embeddings depends on the distance between their positions alone.
inline double sinusoid(double position, Eigen::Index feature, Eigen::Index width) {
  const double angle = position * detail::sinusoid_frequency(feature, width);
  return feature % 2 == 0 ? std::sin(angle) : std::cos(angle);
}

/// Tells tokens where they stand: adds `sinusoid(t)` to token t of every sample. Columns are tokens, sample after sample. No
/// parameters.
class SinusoidalPositions {
public:
  template <class S>
  struct Workspace {
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> table;
  };

  /// Throws Error unless the width is even and there is a token.
  SinusoidalPositions(Eigen::Index width, Eigen::Index tokens) : table_(width, tokens) {
    detail::check_sinusoid_width("sinusoidal positions", width);
    detail::check_positive("sinusoidal positions", "token", tokens);
    for (Eigen::Index t = 0; t < tokens; ++t) {
      for (Eigen::Index i = 0; i < width; ++i) table_(i, t) = sinusoid(static_cast<double>(t), i, width);
    }
  }

  Eigen::Index inputs() const noexcept { return table_.rows(); }
  Eigen::Index outputs() const noexcept { return table_.rows(); }
  Eigen::Index parameters() const noexcept { return 0; }
  /// Columns of a sample.
  Eigen::Index tokens() const noexcept { return table_.cols(); }

  template <class S>
  Workspace<S> workspace(Eigen::Index) const {
    return {table_.cast<S>()};
  }

  template <class S>
  void forward(const S*, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    for (Eigen::Index j = 0; j < x.cols(); ++j) y.col(j) = x.col(j) + w.table.col(j % tokens());
  }

  template <class S>
  void infer(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    forward(theta, x, w, y);
  }

  template <class S>
  void backward(const S*, ConstMatrix<S>, ConstMatrix<S> dy, Workspace<S>&, S*, Matrix<S> dx) const noexcept {
    if (dx.cols() > 0) dx = dy;
  }

  template <class S>
  void initialize(S*, core::RandomStream&) const {}

  template <class F>
  void for_each_parameter(F&&) const {}

private:
  Eigen::MatrixXd table_;
};

/// Adds a learned column to token t of every sample. Columns are tokens, sample after sample. What tells apart tokens that
/// are a set rather than a sequence: an observation, a goal, a noise flag.
///
/// Tensor: `weight`, features by tokens. It starts normal with deviation 0.02.
class LearnedPositions {
public:
  template <class S>
  struct Workspace {};

  /// Throws Error unless there is a feature and a token.
  LearnedPositions(Eigen::Index width, Eigen::Index tokens) : width_(width), tokens_(tokens) {
    detail::check_positive("learned positions", "feature", width);
    detail::check_positive("learned positions", "token", tokens);
  }

  Eigen::Index inputs() const noexcept { return width_; }
  Eigen::Index outputs() const noexcept { return width_; }
  Eigen::Index parameters() const noexcept { return width_ * tokens_; }
  /// Columns of a sample.
  Eigen::Index tokens() const noexcept { return tokens_; }

  template <class S>
  Workspace<S> workspace(Eigen::Index) const {
    return {};
  }

  template <class S>
  void forward(const S* theta, ConstMatrix<S> x, Workspace<S>&, Matrix<S> y) const noexcept {
    const Eigen::Map<const Table<S>> table(theta, width_, tokens_);
    for (Eigen::Index j = 0; j < x.cols(); ++j) y.col(j) = x.col(j) + table.col(j % tokens_);
  }

  template <class S>
  void infer(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    forward(theta, x, w, y);
  }

  template <class S>
  void backward(const S*, ConstMatrix<S>, ConstMatrix<S> dy, Workspace<S>&, S* dtheta, Matrix<S> dx) const noexcept {
    Eigen::Map<Table<S>> dtable(dtheta, width_, tokens_);
    for (Eigen::Index j = 0; j < dy.cols(); ++j) dtable.col(j % tokens_) += dy.col(j);
    if (dx.cols() > 0) dx = dy;
  }

  template <class S>
  void initialize(S* theta, core::RandomStream& random) const {
    for (Eigen::Index i = 0; i < parameters(); ++i) theta[i] = random.normal<S>(0, S(0.02));
  }

  template <class F>
  void for_each_parameter(F&& f) const {
    f("weight", Eigen::Index{0}, width_, tokens_);
  }

private:
  template <class S>
  using Table = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;

  Eigen::Index width_;
  Eigen::Index tokens_;
};

/// One number a column, the step of a diffusion process (any real number of 0 or more), as `width` numbers: its `sinusoid`.
/// Follow it by a small MLP. Ho, Jain and Abbeel, "Denoising Diffusion Probabilistic Models" (NeurIPS 2020), appendix B. No
/// parameters; the gradient with respect to the step is that of the formula.
class StepEmbedding {
public:
  /// The derivatives of the features by the step.
  template <class S>
  struct Workspace {
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> slope;
  };

  /// Throws Error unless the width is even.
  explicit StepEmbedding(Eigen::Index width) : frequencies_(width) {
    detail::check_sinusoid_width("step embedding", width);
    for (Eigen::Index i = 0; i < width; ++i) frequencies_(i) = detail::sinusoid_frequency(i, width);
  }

  Eigen::Index inputs() const noexcept { return 1; }
  Eigen::Index outputs() const noexcept { return frequencies_.size(); }
  Eigen::Index parameters() const noexcept { return 0; }

  template <class S>
  Workspace<S> workspace(Eigen::Index max_columns) const {
    return {Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>(outputs(), max_columns)};
  }

  /// Angles in double: a float has too few digits left for the fast features of a large step.
  template <class S>
  void forward(const S*, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    for (Eigen::Index j = 0; j < x.cols(); ++j) {
      for (Eigen::Index i = 0; i < outputs(); i += 2) {
        const double angle = static_cast<double>(x(0, j)) * frequencies_(i);
        const double sine = std::sin(angle), cosine = std::cos(angle);
        y(i, j) = static_cast<S>(sine);
        y(i + 1, j) = static_cast<S>(cosine);
        w.slope(i, j) = static_cast<S>(frequencies_(i) * cosine);
        w.slope(i + 1, j) = static_cast<S>(-frequencies_(i) * sine);
      }
    }
  }

  template <class S>
  void infer(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    forward(theta, x, w, y);
  }

  template <class S>
  void backward(const S*, ConstMatrix<S>, ConstMatrix<S> dy, Workspace<S>& w, S*, Matrix<S> dx) const noexcept {
    for (Eigen::Index j = 0; j < dx.cols(); ++j) {
      S sum = 0;
      for (Eigen::Index i = 0; i < outputs(); ++i) sum += w.slope(i, j) * dy(i, j);
      dx(0, j) = sum;
    }
  }

  template <class S>
  void initialize(S*, core::RandomStream&) const {}

  template <class F>
  void for_each_parameter(F&&) const {}

private:
  Eigen::VectorXd frequencies_;
};

}  // namespace traceur::nn
