// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <vector>

#include "traceur/learn/activation_curvature.hpp"
#include "traceur/nn/mlp.hpp"
#include "traceur/nn/optimizer.hpp"

namespace traceur::learn {

/// The squared length of the gradient of a network's one output D with respect to its input, and the exact gradient of
/// that with respect to the parameters (Gulrajani et al. 2017, arXiv:1704.00028, with target 0; the last term of HIL,
/// Eq. 3). With layers z_l = W_l a_{l-1} + b_l, a_l = s(z_l), D = z_L:
///
///     g_{L-1} = W_L^T,  d_l = s'(z_l) g_l,  g_{l-1} = W_l^T d_l,  P = sum over samples of |g_0|^2
///
/// is differentiated in turn: with u_0 = 2 g_0 going up, W_l += d_l u_{l-1}^T, t_l = W_l u_{l-1}, u_l = s'(z_l) t_l,
/// W_L += u_{L-1}^T, and what reaches z_l itself, s''(z_l) g_l t_l, goes down again as any gradient does. For piecewise
/// linear activations that last part is zero, and left out.
template <TwiceDifferentiable Hidden = nn::Relu>
class GradientPenalty {
 public:
  using Network = nn::Mlp<Hidden>;
  static constexpr bool curved = ActivationCurvature<Hidden>::curved;

  template <class S>
  struct Workspace {
    using Matrix = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;
    std::vector<Matrix> delta;     ///< d_l
    std::vector<Matrix> gradient;  ///< g_l, where the activation is curved
    std::vector<Matrix> extra;     ///< what reaches z_l, where the activation is curved
    Matrix up[2];
    Matrix input;  ///< g_0 of each sample
    Eigen::Matrix<S, Eigen::Dynamic, 1> scratch;
  };

  /// Throws Error unless the network has one output.
  explicit GradientPenalty(const Network& network) : widths_(network.widths()) {
    if (network.outputs() != 1)
      throw Error("gradient penalty: expected a network of one output, got " + std::to_string(network.outputs()));
    Eigen::Index offset = 0;
    for (std::size_t i = 0; i + 1 < widths_.size(); ++i) {
      offsets_.push_back(offset);
      offset += widths_[i + 1] * (widths_[i] + 1);
    }
  }

  template <class S>
  Workspace<S> workspace(Eigen::Index max_columns) const {
    Workspace<S> w;
    Eigen::Index scratch = 0, widest = 1;
    for (std::size_t i = 0; i < offsets_.size(); ++i) {
      scratch = std::max(scratch, nn::product_scratch<S>(widths_[i + 1], widths_[i]));
      widest = std::max(widest, widths_[i]);
      if (i + 1 == offsets_.size()) break;
      w.delta.emplace_back(widths_[i + 1], max_columns);
      if constexpr (curved) {
        w.gradient.emplace_back(widths_[i + 1], max_columns);
        w.extra.emplace_back(widths_[i + 1], max_columns);
      }
    }
    for (auto& up : w.up) up.resize(widest, max_columns);
    w.input.resize(widths_.front(), max_columns);
    w.scratch.resize(scratch);
    return w;
  }

  /// P of the samples x, unscaled; adds `scale` times its gradient to `dtheta`. Follows a `forward` of the same theta and x
  /// with `kept`. Allocates nothing.
  template <class S>
  double accumulate(const S* theta, nn::ConstMatrix<S> x, const typename Network::template Workspace<S>& kept, S scale,
                    Workspace<S>& w, S* dtheta) const noexcept {
    const Eigen::Index n = x.cols();
    const std::size_t hidden = offsets_.size() - 1;
    assert(n <= w.input.cols());
    const auto weight = [&](std::size_t i) { return nn::detail::weight_matrix<S>(theta + offsets_[i], widths_[i + 1], widths_[i]); };
    const auto dweight = [&](std::size_t i) { return nn::detail::weight_matrix<S>(dtheta + offsets_[i], widths_[i + 1], widths_[i]); };
    const auto read = [&](std::size_t i) -> nn::ConstMatrix<S> { return (Hidden::reads_output ? kept.hidden : kept.before)[i].leftCols(n); };
    // Where g of layer i comes to lie: it is kept only where s'' needs it.
    const auto gradient = [&](std::size_t i) -> nn::Matrix<S> {
      if constexpr (curved)
        return w.gradient[i].leftCols(n);
      else
        return w.delta[i].leftCols(n);
    };

    const S* const last = theta + offsets_[hidden];
    nn::Matrix<S> top = hidden > 0 ? gradient(hidden - 1) : nn::Matrix<S>(w.input.leftCols(n));
    for (Eigen::Index j = 0; j < n; ++j) std::copy_n(last, widths_[hidden], &top(0, j));
    for (std::size_t i = hidden; i-- > 0;) {
      nn::activate_backward<Hidden, S>(read(i), gradient(i), w.delta[i].leftCols(n));
      nn::transposed_product<S>(weight(i), w.delta[i].leftCols(n), i == 0 ? nn::Matrix<S>(w.input.leftCols(n)) : gradient(i - 1),
                                w.scratch.data());
    }
    double sum = 0;
    for (Eigen::Index j = 0; j < n; ++j) {
      const double length = nn::global_norm(&w.input(0, j), w.input.rows());
      sum += length * length;
    }

    Eigen::Map<typename Workspace<S>::Matrix> up(w.up[0].data(), widths_.front(), n);
    up = (S(2) * scale) * w.input.leftCols(n);
    for (std::size_t i = 0; i < hidden; ++i) {
      const Eigen::Map<typename Workspace<S>::Matrix> from(w.up[i % 2].data(), widths_[i], n);
      Eigen::Map<typename Workspace<S>::Matrix> to(w.up[(i + 1) % 2].data(), widths_[i + 1], n);
      nn::outer_product<S>(w.delta[i].leftCols(n), from, dweight(i), w.scratch.data());
      nn::product<S>(weight(i), from, to, w.scratch.data());
      if constexpr (curved) bend<S>(read(i), gradient(i), to, w.extra[i].leftCols(n));
      nn::activate_backward<Hidden, S>(read(i), to, to);
    }
    const S* const out = w.up[hidden % 2].data();
    S* const dlast = dtheta + offsets_[hidden];
    for (Eigen::Index j = 0; j < n; ++j)
      for (Eigen::Index k = 0; k < widths_[hidden]; ++k) dlast[k] += out[j * widths_[hidden] + k];
    if constexpr (curved) descend<S>(theta, x, kept, w, dtheta);
    return sum;
  }

 private:
  /// to = s''(z) g t
  template <class S>
  static void bend(nn::ConstMatrix<S> read, nn::ConstMatrix<S> gradient, nn::ConstMatrix<S> t, nn::Matrix<S> to) noexcept {
    using P = core::Pack<S>;
    for (Eigen::Index j = 0; j < to.cols(); ++j)
      nn::detail::for_each_register<S>(to.rows(), [&](auto load, auto store) __attribute__((always_inline)) {
        const P second = ActivationCurvature<Hidden>::second(load(read.data() + j * read.outerStride()));
        store(to.data() + j * to.outerStride(), second * load(gradient.data() + j * gradient.outerStride()) *
                                                    load(t.data() + j * t.outerStride()));
      });
  }

  /// Takes what reached the z_l down to the parameters.
  template <class S>
  void descend(const S* theta, nn::ConstMatrix<S> x, const typename Network::template Workspace<S>& kept, Workspace<S>& w,
               S* dtheta) const noexcept {
    const Eigen::Index n = x.cols();
    for (std::size_t i = offsets_.size() - 1; i-- > 0;) {
      nn::Matrix<S> dz = w.extra[i].leftCols(n);
      if (i + 2 < offsets_.size()) {
        nn::transposed_product<S>(nn::detail::weight_matrix<S>(theta + offsets_[i + 1], widths_[i + 2], widths_[i + 1]),
                                  w.extra[i + 1].leftCols(n), w.delta[i].leftCols(n), w.scratch.data());
        nn::activate_backward<Hidden, S>((Hidden::reads_output ? kept.hidden : kept.before)[i].leftCols(n), w.delta[i].leftCols(n),
                                         w.delta[i].leftCols(n));
        dz += w.delta[i].leftCols(n);
      }
      nn::outer_product<S>(dz, i == 0 ? x : nn::ConstMatrix<S>(kept.hidden[i - 1].leftCols(n)),
                           nn::detail::weight_matrix<S>(dtheta + offsets_[i], widths_[i + 1], widths_[i]), w.scratch.data());
      nn::detail::add_columns<S>(dz, dtheta + offsets_[i] + widths_[i + 1] * widths_[i]);
    }
  }

  std::vector<Eigen::Index> widths_, offsets_;
};

}  // namespace traceur::learn
