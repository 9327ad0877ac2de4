// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstdint>
#include <string>

#include <Eigen/Core>

#include <traceur/core/error.hpp>
#include <traceur/nn/module.hpp>

namespace traceur::nn {

struct NormalizerParameters {
  /// Normalised numbers are clamped to [-clip, clip]; > 0, may be infinite.
  double clip = 5.0;
  /// Standard deviations below this count as this, so that features which hardly vary are not blown up; > 0.
  double min_deviation = 1e-4;
  /// Learning ends by itself once so many samples were seen; 0 for never.
  std::int64_t max_samples = 0;
};

/// Mean and variance of each feature of all samples seen, and samples shifted and scaled by them. The statistics are
/// kept in double and merged batch by batch: Chan, Golub and LeVeque, "Updating Formulae and a Pairwise Algorithm for
/// Computing Sample Variances" (1979), eq. 2.1; with batches of one that is Welford's method. Before the first sample
/// the mean is 0 and the deviation 1.
class Normalizer {
public:
  /// Throws Error for a width below 1 or a parameter out of its range.
  explicit Normalizer(Eigen::Index features, NormalizerParameters parameters = {}) : parameters_(parameters) {
    detail::check_positive("normalizer", "feature", features);
    if (!(parameters.clip > 0.0))
      throw Error("normalizer: clip must be positive, got " + std::to_string(parameters.clip));
    if (!(parameters.min_deviation > 0.0)) {
      throw Error("normalizer: min_deviation must be positive, got " + std::to_string(parameters.min_deviation));
    }
    if (parameters.max_samples < 0) {
      throw Error("normalizer: max_samples must be 0 or more, got " + std::to_string(parameters.max_samples));
    }
    state_.setZero(2 * features + 1);
    deviation_.setOnes(features);
    batch_mean_.setZero(features);
    batch_squares_.setZero(features);
  }

  Eigen::Index features() const noexcept { return deviation_.size(); }
  /// Samples learnt from.
  double samples() const noexcept { return state_[2 * features()]; }
  double mean(Eigen::Index feature) const noexcept { return state_[feature]; }
  /// The biased variance (a division by the number of samples); 1 before the first sample.
  double variance(Eigen::Index feature) const noexcept {
    return samples() > 0.0 ? state_[features() + feature] / samples() : 1.0;
  }
  /// What samples are divided by.
  double deviation(Eigen::Index feature) const noexcept { return deviation_[feature]; }

  /// Learns from the columns of x, features() x n; nothing while frozen. A column with a number that is not finite is
  /// left out. Returns how many were.
  template <class S>
  Eigen::Index observe(ConstMatrix<S> x) noexcept {
    assert(x.rows() == features());
    if (frozen()) return 0;
    const auto for_each_sample = [&](auto&& f) {
      Eigen::Index count = 0;
      for (Eigen::Index j = 0; j < x.cols(); ++j) {
        const S* sample = x.data() + j * x.outerStride();
        bool finite = true;
        for (Eigen::Index i = 0; i < features(); ++i) finite &= sample[i] - sample[i] == S(0);
        if (!finite) continue;
        ++count;
        for (Eigen::Index i = 0; i < features(); ++i) f(i, static_cast<double>(sample[i]));
      }
      return count;
    };
    batch_mean_.setZero();
    batch_squares_.setZero();
    double* const mean = batch_mean_.data();
    double* const squares = batch_squares_.data();
    const Eigen::Index count = for_each_sample([mean](Eigen::Index i, double value) { mean[i] += value; });
    if (count == 0) return x.cols();
    batch_mean_ /= static_cast<double>(count);
    for_each_sample([mean, squares](Eigen::Index i, double value) {
      const double way = value - mean[i];
      squares[i] += way * way;
    });
    add(batch_mean_.data(), batch_squares_.data(), static_cast<double>(count));
    return x.cols() - count;
  }

  /// Learns all that `other`, of as many features, has learnt; for samples gathered apart. Nothing while frozen.
  void merge(const Normalizer& other) noexcept {
    assert(other.features() == features());
    if (frozen() || other.samples() == 0.0) return;
    add(other.state_.data(), other.state_.data() + features(), other.samples());
  }

  /// y = clamp((x - mean) / max(deviation, min_deviation), -clip, clip) for columns; y may be x. NaN stays NaN.
  template <class S>
  void apply(ConstMatrix<S> x, Matrix<S> y) const noexcept {
    assert(x.rows() == features() && y.rows() == features() && x.cols() == y.cols());
    const S clip = static_cast<S>(parameters_.clip);
    for (Eigen::Index j = 0; j < x.cols(); ++j) {
      for (Eigen::Index i = 0; i < features(); ++i) {
        const S z = static_cast<S>((static_cast<double>(x(i, j)) - state_[i]) / deviation_[i]);
        y(i, j) = z < -clip ? -clip : z > clip ? clip : z;
      }
    }
  }

  /// x = y deviation + mean: what `apply` did, undone, but for the clamp.
  template <class S>
  void undo(ConstMatrix<S> y, Matrix<S> x) const noexcept {
    assert(x.rows() == features() && y.rows() == features() && x.cols() == y.cols());
    for (Eigen::Index j = 0; j < x.cols(); ++j) {
      for (Eigen::Index i = 0; i < features(); ++i) {
        x(i, j) = static_cast<S>(static_cast<double>(y(i, j)) * deviation_[i] + state_[i]);
      }
    }
  }

  /// Ends learning, or lets it go on.
  void freeze(bool frozen = true) noexcept { frozen_ = frozen; }
  bool frozen() const noexcept {
    return frozen_ || (parameters_.max_samples > 0 && samples() >= static_cast<double>(parameters_.max_samples));
  }

  /// 2 features() + 1 numbers: the means, the sums of squared distances from them, the number of samples.
  const Eigen::VectorXd& state() const noexcept { return state_; }
  /// Throws Error for a state of another length, or one that no samples could have led to.
  void restore(const Eigen::Ref<const Eigen::VectorXd>& state) {
    if (state.size() != state_.size()) {
      throw Error("normalizer state: expected " + std::to_string(state_.size()) + " numbers, got " +
                  std::to_string(state.size()));
    }
    for (Eigen::Index i = 0; i < state.size(); ++i) {
      if (!std::isfinite(state[i]) || (i >= features() && state[i] < 0.0)) {
        throw Error("normalizer state: number " + std::to_string(i) + ": expected a finite number" +
                    (i >= features() ? ", 0 or more" : ""));
      }
    }
    state_ = state;
    renew();
  }

private:
  void add(const double* mean, const double* squares, double count) noexcept {
    const double before = samples(), after = before + count;
    for (Eigen::Index i = 0; i < features(); ++i) {
      const double way = mean[i] - state_[i];
      state_[i] += way * count / after;
      state_[features() + i] += squares[i] + way * way * before * count / after;
    }
    state_[2 * features()] = after;
    renew();
  }

  void renew() noexcept {
    for (Eigen::Index i = 0; i < features(); ++i) {
      deviation_[i] = std::max(std::sqrt(variance(i)), parameters_.min_deviation);
    }
  }

  NormalizerParameters parameters_;
  Eigen::VectorXd state_, deviation_, batch_mean_, batch_squares_;
  bool frozen_ = false;
};

}  // namespace traceur::nn
