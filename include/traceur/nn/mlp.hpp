// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cassert>
#include <concepts>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <traceur/core/error.hpp>
#include <traceur/core/random.hpp>
#include <traceur/nn/activation.hpp>
#include <traceur/nn/dense.hpp>
#include <traceur/nn/initializers.hpp>
#include <traceur/nn/module.hpp>
#include <traceur/nn/product.hpp>

namespace traceur::nn {

/// A multi-layer perceptron: dense layers with biases, each followed by the activation `Hidden` but the last, by
/// `Output`. Its parameters are those of the layers in order: `layers.0.weight`, `layers.0.bias`, `layers.1.weight` and
/// so on.
template <Activation Hidden = Relu, Activation Output = Identity>
class Mlp {
public:
  template <class S>
  struct Workspace {
    detail::FlatStorage<S> scratch;
    std::vector<detail::Storage<S>> hidden;  ///< outputs of the hidden layers
    std::vector<detail::Storage<S>>
        before;                   ///< values before their activations, if those are what the derivative reads
    detail::Storage<S> kept;      ///< what the derivative of `Output` reads
    detail::Storage<S> delta[2];  ///< gradients on their way back; activations of `infer`
  };

  /// `widths`: inputs, hidden widths, outputs. Throws Error unless there are at least two, each at least 1.
  explicit Mlp(std::vector<Eigen::Index> widths) : widths_(std::move(widths)) {
    if (widths_.size() < 2) {
      throw Error("mlp: expected at least the widths of input and output, got " + std::to_string(widths_.size()));
    }
    for (std::size_t i = 0; i < widths_.size(); ++i) {
      if (widths_[i] < 1) {
        throw Error("mlp: width " + std::to_string(i) + ": expected at least 1, got " + std::to_string(widths_[i]));
      }
    }
    for (std::size_t i = 0; i + 1 < widths_.size(); ++i) {
      offsets_.push_back(parameters_);
      parameters_ += widths_[i + 1] * (widths_[i] + 1);
    }
  }

  Eigen::Index inputs() const noexcept { return widths_.front(); }
  Eigen::Index outputs() const noexcept { return widths_.back(); }
  Eigen::Index parameters() const noexcept { return parameters_; }
  std::size_t layers() const noexcept { return offsets_.size(); }
  const std::vector<Eigen::Index>& widths() const noexcept { return widths_; }

  template <class S>
  Workspace<S> workspace(Eigen::Index max_columns) const {
    detail::check_positive("mlp workspace", "column", max_columns);
    Workspace<S> w;
    Eigen::Index scratch = 0, widest = 1;
    for (std::size_t i = 0; i < layers(); ++i) {
      scratch = std::max(scratch, product_scratch<S>(widths_[i + 1], widths_[i]));
      if (i + 1 == layers()) break;
      widest = std::max(widest, widths_[i + 1]);
      w.hidden.emplace_back(widths_[i + 1], max_columns);
      if constexpr (!Hidden::reads_output) w.before.emplace_back(widths_[i + 1], max_columns);
    }
    w.scratch.resize(scratch);
    if constexpr (!linear_output) w.kept.resize(outputs(), max_columns);
    for (auto& delta : w.delta) delta.resize(std::max(widest, linear_output ? 1 : outputs()), max_columns);
    return w;
  }

  template <class S>
  void forward(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    assert(x.cols() <= w.delta[0].cols());
    for_each_part(x.cols(),
                  [&](Eigen::Index first, Eigen::Index count) { forward_part<S>(theta, x, w, y, first, count); });
  }

  /// Leaves what a `forward` has kept in the workspace as it is.
  template <class S>
  void infer(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    assert(x.cols() <= w.delta[0].cols());
    const Eigen::Index n = x.cols();
    const std::size_t last = layers() - 1;
    const auto from = [&](std::size_t i) { return i == 0 ? x : ConstMatrix<S>(delta<S>(w, i - 1, n)); };
    for (std::size_t i = 0; i < last; ++i) {
      auto to = delta<S>(w, i, n);
      detail::dense_forward<Hidden, false, S>(weight(theta, i), bias(theta, i), from(i), to, to, w.scratch.data());
    }
    detail::dense_forward<Output, false, S>(weight(theta, last), bias(theta, last), from(last), y, y, w.scratch.data());
  }

  template <class S>
  void backward(const S* theta, ConstMatrix<S> x, ConstMatrix<S> dy, Workspace<S>& w, S* dtheta,
                Matrix<S> dx) const noexcept {
    for_each_part(x.cols(), [&](Eigen::Index first, Eigen::Index count) {
      backward_part<S>(theta, x, dy, w, dtheta, dx, first, count);
    });
  }

  /// Weights and biases of every layer uniform in +-1 / sqrt(inputs of the layer).
  template <class S>
  void initialize(S* theta, core::RandomStream& random) const {
    for (std::size_t i = 0; i < layers(); ++i) {
      Dense<>(widths_[i], widths_[i + 1]).template initialize<S>(theta + offsets_[i], random);
    }
  }

  /// Weights of the last layer by `output`, those of the others by `hidden`; biases zero.
  template <class S, Initializer<S> HiddenInitializer, Initializer<S> OutputInitializer>
  void initialize(S* theta, core::RandomStream& random, const HiddenInitializer& hidden,
                  const OutputInitializer& output) const {
    for (std::size_t i = 0; i < layers(); ++i) {
      const Dense<> layer(widths_[i], widths_[i + 1]);
      if (i + 1 < layers()) {
        layer.initialize(theta + offsets_[i], random, hidden);
      } else {
        layer.initialize(theta + offsets_[i], random, output);
      }
    }
  }

  template <class F>
  void for_each_parameter(F&& f) const {
    for (std::size_t i = 0; i < layers(); ++i) {
      for_each_parameter_of(Dense<>(widths_[i], widths_[i + 1]), "layers." + std::to_string(i), offsets_[i], f);
    }
  }

private:
  static constexpr bool linear_output = std::same_as<Output, Identity>;

  Eigen::Index bias_offset(std::size_t i) const noexcept { return offsets_[i] + widths_[i + 1] * widths_[i]; }

  template <class S>
  ConstMatrix<S> weight(const S* theta, std::size_t i) const noexcept {
    return detail::weight_matrix<S>(theta + offsets_[i], widths_[i + 1], widths_[i]);
  }
  template <class S>
  const S* bias(const S* theta, std::size_t i) const noexcept {
    return theta + bias_offset(i);
  }
  /// A large batch goes through all layers a part at a time, so that what lies between them stays in the
  /// cache.
  template <class F>
  static void for_each_part(Eigen::Index columns, F&& f) noexcept {
    constexpr Eigen::Index part = detail::outer_depth;
    for (Eigen::Index first = 0; first < columns; first += part) f(first, std::min(part, columns - first));
  }

  template <class S>
  void forward_part(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> all, Eigen::Index first,
                    Eigen::Index n) const noexcept {
    Matrix<S> y = all.middleCols(first, n);
    const std::size_t last = layers() - 1;
    for (std::size_t i = 0; i < last; ++i) {
      auto& kept = (Hidden::reads_output ? w.hidden : w.before)[i];
      detail::dense_forward<Hidden, true, S>(weight(theta, i), bias(theta, i), input<S>(x, w, i, first, n),
                                             kept.middleCols(first, n), w.hidden[i].middleCols(first, n),
                                             w.scratch.data());
    }
    if constexpr (linear_output) {
      detail::dense_forward<Output, false, S>(weight(theta, last), bias(theta, last), input<S>(x, w, last, first, n), y,
                                              y, w.scratch.data());
    } else {
      auto kept = w.kept.middleCols(first, n);
      detail::dense_forward<Output, true, S>(weight(theta, last), bias(theta, last), input<S>(x, w, last, first, n),
                                             kept, y, w.scratch.data());
      if constexpr (Output::reads_output) kept = y;
    }
  }

  template <class S>
  void backward_part(const S* theta, ConstMatrix<S> x, ConstMatrix<S> all_dy, Workspace<S>& w, S* dtheta,
                     Matrix<S> all_dx, Eigen::Index first, Eigen::Index n) const noexcept {
    const ConstMatrix<S> dy = all_dy.middleCols(first, n);
    Matrix<S> dx = all_dx.cols() == 0 ? all_dx : Matrix<S>(all_dx.middleCols(first, n));
    const std::size_t last = layers() - 1;
    if constexpr (!linear_output) activate_backward<Output, S>(w.kept.middleCols(first, n), dy, delta<S>(w, last, n));
    for (std::size_t i = layers(); i-- > 0;) {
      const ConstMatrix<S> dz = linear_output && i == last ? dy : ConstMatrix<S>(delta<S>(w, i, n));
      const auto back = [&](Matrix<S> to, const auto&... end) {
        detail::dense_backward<S>(weight(theta, i), input<S>(x, w, i, first, n), dz,
                                  detail::weight_matrix<S>(dtheta + offsets_[i], widths_[i + 1], widths_[i]),
                                  dtheta + bias_offset(i), to, w.scratch.data(), end...);
      };
      if (i == 0) return back(dx);
      auto before = delta<S>(w, i - 1, n);
      if constexpr (Hidden::reads_output) {
        back(before, detail::TimesSlope<Hidden, S>{w.hidden[i - 1].col(first).data(), before.data()});
      } else {
        back(before);
        activate_backward<Hidden, S>(w.before[i - 1].middleCols(first, n), before, before);
      }
    }
  }

  /// Columns [first, first + n) of what layer i reads.
  template <class S>
  ConstMatrix<S> input(ConstMatrix<S> x, const Workspace<S>& w, std::size_t i, Eigen::Index first,
                       Eigen::Index n) const noexcept {
    return i == 0 ? ConstMatrix<S>(x.middleCols(first, n)) : ConstMatrix<S>(w.hidden[i - 1].middleCols(first, n));
  }
  /// What belongs to the output of layer i; that of layer i + 1 lies elsewhere.
  template <class S>
  Eigen::Map<detail::Storage<S>> delta(Workspace<S>& w, std::size_t i, Eigen::Index columns) const noexcept {
    return {w.delta[i % 2].data(), widths_[i + 1], columns};
  }

  std::vector<Eigen::Index> widths_, offsets_;
  Eigen::Index parameters_ = 0;
};

}  // namespace traceur::nn
