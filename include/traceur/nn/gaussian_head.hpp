// SPDX-License-Identifier: MIT
#pragma once

#include <cassert>
#include <cmath>
#include <string>
#include <string_view>
#include <utility>

#include <Eigen/Core>

#include <traceur/core/error.hpp>
#include <traceur/core/random.hpp>
#include <traceur/nn/module.hpp>
#include <traceur/nn/optimizer.hpp>

namespace traceur::nn {

/// Normal distributions with independent components, one for each column: the mean is a column of a network's output,
/// the standard deviations are the same for all columns, either fixed or parameters of their own (their logarithms), to
/// be learnt. What a policy draws its actions from.
///
/// With d components, mean m, deviations s and z = (a - m) / s,
///
///     log p(a) = -1/2 |z|^2 - sum log s - d/2 log(2 pi)
///     entropy  = sum log s + d/2 (1 + log(2 pi))
///     KL(p, q) = sum log(s_q / s_p) + (s_p^2 + (m_p - m_q)^2) / (2 s_q^2) - 1/2
///
/// `theta` is the head's slice of the parameters, `parameters()` long, and is not read while the deviations are fixed.
class GaussianHead {
public:
  enum class Deviation { fixed, learned };

  /// What a function needs of the deviations; filled by `prepare`.
  template <class S>
  struct Workspace {
    Eigen::Matrix<S, Eigen::Dynamic, 1> deviation, inverse;
    S sum_of_logs = 0;
  };

  /// `deviation` > 0 is the standard deviation of every component, at the start if it is learned. Throws Error
  /// otherwise, or for a dimension below 1.
  GaussianHead(Eigen::Index dimension, double deviation, Deviation kind = Deviation::fixed)
      : GaussianHead(Eigen::VectorXd::Constant(dimension < 1 ? 0 : dimension, deviation), kind) {}

  /// One deviation a component.
  explicit GaussianHead(Eigen::VectorXd deviations, Deviation kind = Deviation::fixed)
      : log_deviations_(std::move(deviations)), kind_(kind) {
    detail::check_positive("gaussian head", "component", log_deviations_.size());
    for (Eigen::Index i = 0; i < log_deviations_.size(); ++i) {
      const double deviation = log_deviations_[i];
      if (!(deviation > 0.0) || !std::isfinite(deviation)) {
        throw Error("gaussian head: deviation " + std::to_string(i) + " must be positive, got " +
                    std::to_string(deviation));
      }
      log_deviations_[i] = std::log(deviation);
    }
  }

  Eigen::Index dimension() const noexcept { return log_deviations_.size(); }
  /// The logarithms of the deviations, if they are learned.
  Eigen::Index parameters() const noexcept { return kind_ == Deviation::learned ? dimension() : 0; }

  template <class S>
  void initialize(S* theta) const noexcept {
    for (Eigen::Index i = 0; i < parameters(); ++i) theta[i] = static_cast<S>(log_deviations_[i]);
  }

  /// `log_deviation`, if it is learned.
  template <class F>
  void for_each_parameter(F&& f) const {
    if (parameters() > 0) f(std::string_view("log_deviation"), Eigen::Index{0}, dimension(), Eigen::Index{1});
  }

  template <class S>
  Workspace<S> workspace() const {
    Workspace<S> w;
    w.deviation.resize(dimension());
    w.inverse.resize(dimension());
    return w;
  }

  /// Takes the deviations from theta; to be called whenever theta has changed. The functions below read them from `w`.
  template <class S>
  void prepare(const S* theta, Workspace<S>& w) const noexcept {
    w.sum_of_logs = S(0);
    for (Eigen::Index i = 0; i < dimension(); ++i) {
      const S log_deviation = parameters() > 0 ? theta[i] : static_cast<S>(log_deviations_[i]);
      w.deviation[i] = std::exp(log_deviation);
      w.inverse[i] = std::exp(-log_deviation);
      w.sum_of_logs += log_deviation;
    }
  }

  /// actions = mean + deviation normal, drawn column by column. Give each actor its own stream and its own column, and
  /// what is drawn does not depend on which columns come together.
  template <class S>
  void sample(const Workspace<S>& w, ConstMatrix<S> mean, core::RandomStream& random,
              Matrix<S> actions) const noexcept {
    assert(mean.rows() == dimension() && actions.rows() == dimension() && mean.cols() == actions.cols());
    for (Eigen::Index j = 0; j < mean.cols(); ++j) {
      for (Eigen::Index i = 0; i < dimension(); ++i) {
        actions(i, j) = mean(i, j) + w.deviation[i] * random.template normal<S>();
      }
    }
  }

  /// The logarithm of the density at each column of `actions`.
  template <class S>
  void log_probability(const Workspace<S>& w, ConstMatrix<S> mean, ConstMatrix<S> actions, Flat<S> to) const noexcept {
    assert(mean.rows() == dimension() && actions.rows() == dimension());
    assert(mean.cols() == actions.cols() && to.size() == mean.cols());
    const S constant = -w.sum_of_logs - static_cast<S>(dimension()) * half_log_two_pi<S>;
    for (Eigen::Index j = 0; j < mean.cols(); ++j) {
      S squares = S(0);
      for (Eigen::Index i = 0; i < dimension(); ++i) {
        const S z = (actions(i, j) - mean(i, j)) * w.inverse[i];
        squares += z * z;
      }
      to[j] = constant - S(0.5) * squares;
    }
  }

  /// With g the gradient with respect to each column's log-probability: writes that with respect to the means, and adds
  /// that with respect to theta.
  template <class S>
  void log_probability_backward(const Workspace<S>& w, ConstMatrix<S> mean, ConstMatrix<S> actions, ConstFlat<S> g,
                                Matrix<S> dmean, S* dtheta) const noexcept {
    assert(mean.rows() == dimension() && actions.rows() == dimension() && dmean.rows() == dimension());
    assert(mean.cols() == actions.cols() && g.size() == mean.cols() && dmean.cols() == mean.cols());
    for (Eigen::Index j = 0; j < mean.cols(); ++j) {
      for (Eigen::Index i = 0; i < dimension(); ++i) {
        const S z = (actions(i, j) - mean(i, j)) * w.inverse[i];
        dmean(i, j) = g[j] * z * w.inverse[i];
        if (parameters() > 0) dtheta[i] += g[j] * (z * z - S(1));
      }
    }
  }

  /// The entropy of each column, the same for all.
  template <class S>
  S entropy(const Workspace<S>& w) const noexcept {
    return w.sum_of_logs + static_cast<S>(dimension()) * (S(0.5) + half_log_two_pi<S>);
  }

  /// With g the gradient with respect to the entropy: adds that with respect to theta.
  template <class S>
  void entropy_backward(S g, S* dtheta) const noexcept {
    for (Eigen::Index i = 0; i < parameters(); ++i) dtheta[i] += g;
  }

  /// KL(p, q) of each column.
  template <class S>
  void divergence(const Workspace<S>& p, ConstMatrix<S> mean_p, const Workspace<S>& q, ConstMatrix<S> mean_q,
                  Flat<S> to) const noexcept {
    assert(mean_p.rows() == dimension() && mean_q.rows() == dimension());
    assert(mean_p.cols() == mean_q.cols() && to.size() == mean_p.cols());
    for (Eigen::Index j = 0; j < mean_p.cols(); ++j) {
      S sum = q.sum_of_logs - p.sum_of_logs;
      for (Eigen::Index i = 0; i < dimension(); ++i) {
        const S ratio = p.deviation[i] * q.inverse[i], way = (mean_p(i, j) - mean_q(i, j)) * q.inverse[i];
        sum += S(0.5) * (ratio * ratio + way * way - S(1));
      }
      to[j] = sum;
    }
  }

private:
  template <class S>
  static constexpr S half_log_two_pi = static_cast<S>(0.91893853320467274178);

  Eigen::VectorXd log_deviations_;
  Deviation kind_;
};

}  // namespace traceur::nn
