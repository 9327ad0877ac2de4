// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>

#include <traceur/nn/detail/runs.hpp>
#include <traceur/nn/module.hpp>

namespace traceur::nn {

/// Layer normalisation, column by column: y = weight * (x - mean(x)) / sqrt(var(x) + epsilon) + bias, with mean and (biased)
/// variance over the column's features. Ba, Kiros and Hinton, "Layer Normalization" (arXiv:1607.06450, 2016), eq. 4.
///
/// Tensors: `weight` and `bias`, one number a feature. They start at 1 and 0.
class LayerNorm {
public:
  /// What a column was shifted by and multiplied with.
  template <class S>
  struct Workspace {
    Eigen::Matrix<S, Eigen::Dynamic, 1> mean;
    Eigen::Matrix<S, Eigen::Dynamic, 1> scale;
  };

  /// Throws Error unless there is a feature and epsilon is finite and above 0.
  explicit LayerNorm(Eigen::Index features, double epsilon = 1e-5) : features_(features), epsilon_(epsilon) {
    detail::check_positive("layer norm", "feature", features);
    if (!(epsilon > 0) || !std::isfinite(epsilon)) throw Error("layer norm: expected a positive epsilon");
  }

  Eigen::Index inputs() const noexcept { return features_; }
  Eigen::Index outputs() const noexcept { return features_; }
  Eigen::Index parameters() const noexcept { return 2 * features_; }

  template <class S>
  Workspace<S> workspace(Eigen::Index max_columns) const {
    return {Eigen::Matrix<S, Eigen::Dynamic, 1>(max_columns), Eigen::Matrix<S, Eigen::Dynamic, 1>(max_columns)};
  }

  template <class S>
  void forward(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    using P = core::Pack<S>;
    const S share = S(1) / static_cast<S>(features_);
    for (Eigen::Index j = 0; j < x.cols(); ++j) {
      const S* const in = x.data() + j * x.outerStride();
      S* const out = y.data() + j * y.outerStride();
      P total(0);
      detail::for_each_run<S>(features_, [&](auto run) { total += run.load(in); });
      const S mean = detail::sum(total) * share;
      P squares(0);
      detail::for_each_run<S>(features_, [&](auto run) {
        const P away = run.inside(run.load(in) - P(mean));
        squares += away * away;
      });
      const S scale = S(1) / std::sqrt(detail::sum(squares) * share + static_cast<S>(epsilon_));
      w.mean(j) = mean;
      w.scale(j) = scale;
      detail::for_each_run<S>(features_, [&](auto run) {
        run.store(out, (run.load(in) - P(mean)) * P(scale) * run.load(theta) + run.load(theta + features_));
      });
    }
  }

  template <class S>
  void infer(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    forward(theta, x, w, y);
  }

  /// dx may be dy.
  template <class S>
  void backward(const S* theta, ConstMatrix<S> x, ConstMatrix<S> dy, Workspace<S>& w, S* dtheta,
                Matrix<S> dx) const noexcept {
    using P = core::Pack<S>;
    const S share = S(1) / static_cast<S>(features_);
    S* const dbias = dtheta + features_;
    for (Eigen::Index j = 0; j < x.cols(); ++j) {
      const S* const in = x.data() + j * x.outerStride();
      const S* const dout = dy.data() + j * dy.outerStride();
      const P mean(w.mean(j)), scale(w.scale(j));
      P by_mean(0), by_scale(0);
      detail::for_each_run<S>(features_, [&](auto run) {
        const P gradient = run.load(dout), normal = (run.load(in) - mean) * scale;
        const P weighted = gradient * run.load(theta);
        by_mean += weighted;
        by_scale += weighted * normal;
        run.store(dtheta, run.load(dtheta) + gradient * normal);
        run.store(dbias, run.load(dbias) + gradient);
      });
      if (dx.cols() == 0) continue;
      // The mean and the variance depend on every feature: what pushes along either of them is taken away.
      const P along_mean(detail::sum(by_mean) * share), along_scale(detail::sum(by_scale) * share);
      S* const din = dx.data() + j * dx.outerStride();
      detail::for_each_run<S>(features_, [&](auto run) {
        const P normal = (run.load(in) - mean) * scale;
        run.store(din, scale * (run.load(dout) * run.load(theta) - along_mean - normal * along_scale));
      });
    }
  }

  template <class S>
  void initialize(S* theta, core::RandomStream&) const {
    for (Eigen::Index i = 0; i < features_; ++i) {
      theta[i] = S(1);
      theta[features_ + i] = S(0);
    }
  }

  template <class F>
  void for_each_parameter(F&& f) const {
    f("weight", Eigen::Index{0}, features_, Eigen::Index{1});
    f("bias", features_, features_, Eigen::Index{1});
  }

private:
  Eigen::Index features_;
  double epsilon_;
};

}  // namespace traceur::nn
