// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "traceur/learn/environment.hpp"
#include "traceur/learn/gradient_penalty.hpp"

namespace traceur::learn {

/// log(1 + e^x), without overflow.
template <class S>
S softplus(S x) noexcept {
  return x > S(0) ? x + std::log1p(std::exp(-x)) : std::log1p(std::exp(x));
}

/// 1 / (1 + e^-x), without overflow.
template <class S>
S probability(S logit) noexcept {
  const S e = std::exp(-std::abs(logit));
  return (logit < S(0) ? e : S(1)) / (S(1) + e);
}

/// What looking real earns: -log(1 - D), D the probability that a discriminator gives to being real (HIL, section 5.2; Peng
/// et al. 2021, "AMP").
struct StyleReward {
  double scale = 1;         ///< AMP's released code has 2
  double least_doubt = 1e-4;  ///< 1 - D counts as no less, so that a reward is at most 9.2 times the scale

  template <class S>
  S operator()(S logit) const noexcept {
    const S most = static_cast<S>(-std::log(least_doubt)), earned = softplus(logit);
    return static_cast<S>(scale) * (earned < most ? earned : most);
  }
};

struct DiscriminatorParameters {
  double gradient_penalty = 5;      ///< w_gp of HIL, Eq. 3, which prints no number; DeepMimic's code has 10, ASE's 5
  double logit_regularizer = 0.01;  ///< times the squared length of the last layer's weights
  double weight_decay = 1e-4;       ///< times that of all weights, biases left out
};

/// How well a discriminator tells samples apart: sums over samples.
struct DiscriminatorTally {
  double loss = 0;     ///< cross-entropy
  double penalty = 0;  ///< squared lengths of input gradients, of real samples
  double right = 0;    ///< samples on the right side of a logit of zero
  double logit = 0;
  double samples = 0;

  DiscriminatorTally& operator+=(const DiscriminatorTally& o) noexcept {
    loss += o.loss;
    penalty += o.penalty;
    right += o.right;
    logit += o.logit;
    samples += o.samples;
    return *this;
  }
};

/// Tells motion of a data set from that of a policy: a network whose one output is the logit of D, the probability of being
/// real. Its loss (HIL, Eq. 3)
///
///     -E_real log D - E_fake log(1 - D) + w_gp E_real |grad_x logit|^2 + w_logit |W_L|^2 + w_decay sum |W_l|^2
///
/// has an exact gradient: the penalty's is taken by `GradientPenalty`. The penalty reads the logit, as released code does;
/// of D itself it would vanish where the discriminator is sure. Parameters are a flat vector of the caller's, as all
/// modules of nn have them; the samples of a batch may be cut into chunks with a workspace each.
template <TwiceDifferentiable Hidden = nn::Relu>
class Discriminator {
 public:
  using Network = nn::Mlp<Hidden>;

  template <class S>
  struct Workspace {
    typename Network::template Workspace<S> network;
    typename GradientPenalty<Hidden>::template Workspace<S> penalty;
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> logit;
  };

  /// Throws Error unless the network has one output and the weights are zero or more.
  explicit Discriminator(Network network, const DiscriminatorParameters& parameters = {})
      : parameters_(parameters), network_(std::move(network)), penalty_(network_) {
    for (const double w : {parameters.gradient_penalty, parameters.logit_regularizer, parameters.weight_decay})
      if (!(w >= 0) || !std::isfinite(w)) throw Error("discriminator: expected weights of zero or more");
    Eigen::Index offset = 0;
    for (std::size_t i = 0; i < network_.layers(); ++i) {
      const Eigen::Index weights = network_.widths()[i + 1] * network_.widths()[i];
      weights_.emplace_back(offset, weights);
      offset += weights + network_.widths()[i + 1];
    }
  }

  const Network& network() const noexcept { return network_; }
  const DiscriminatorParameters& settings() const noexcept { return parameters_; }
  Eigen::Index inputs() const noexcept { return network_.inputs(); }
  Eigen::Index parameters() const noexcept { return network_.parameters(); }

  template <class S>
  Workspace<S> workspace(Eigen::Index max_columns) const {
    Workspace<S> w{network_.template workspace<S>(max_columns), penalty_.template workspace<S>(max_columns), {}};
    w.logit.resize(1, max_columns);
    return w;
  }

  /// Logits of samples.
  template <class S>
  void infer(const S* theta, nn::ConstMatrix<S> x, Workspace<S>& w, nn::Matrix<S> logit) const noexcept {
    network_.template infer<S>(theta, x, w.network, logit);
  }

  /// Counts real samples, each with the weight `share` in the mean, and adds the gradient of their loss and penalty.
  template <class S>
  DiscriminatorTally accumulate_real(const S* theta, nn::ConstMatrix<S> x, S share, Workspace<S>& w, S* dtheta) const noexcept {
    DiscriminatorTally tally = accumulate<S>(theta, x, S(-1), share, w, dtheta);
    if (parameters_.gradient_penalty > 0)
      tally.penalty = penalty_.template accumulate<S>(theta, x, w.network, static_cast<S>(parameters_.gradient_penalty) * share,
                                                      w.penalty, dtheta);
    return tally;
  }

  /// The same for what a policy made.
  template <class S>
  DiscriminatorTally accumulate_fake(const S* theta, nn::ConstMatrix<S> x, S share, Workspace<S>& w, S* dtheta) const noexcept {
    return accumulate<S>(theta, x, S(1), share, w, dtheta);
  }

  /// The part of the loss that no sample has to do with; adds its gradient.
  template <class S>
  double regularize(const S* theta, S* dtheta) const noexcept {
    double sum = 0;
    for (std::size_t i = 0; i < weights_.size(); ++i) {
      const double factor = parameters_.weight_decay + (i + 1 == weights_.size() ? parameters_.logit_regularizer : 0.0);
      const auto [offset, count] = weights_[i];
      const double length = nn::global_norm(theta + offset, count);
      sum += factor * length * length;
      const S slope = static_cast<S>(2 * factor);
      for (Eigen::Index k = 0; k < count; ++k) dtheta[offset + k] += slope * theta[offset + k];
    }
    return sum;
  }

 private:
  /// `sign` is that of the logit in the loss, softplus(sign logit): -1 for real samples.
  template <class S>
  DiscriminatorTally accumulate(const S* theta, nn::ConstMatrix<S> x, S sign, S share, Workspace<S>& w, S* dtheta) const noexcept {
    auto logit = w.logit.leftCols(x.cols());
    network_.template forward<S>(theta, x, w.network, logit);
    DiscriminatorTally tally;
    for (Eigen::Index j = 0; j < x.cols(); ++j) {
      const S wrong = sign * logit(0, j);
      tally.loss += static_cast<double>(softplus(wrong));
      tally.right += wrong < S(0) ? 1 : 0;
      tally.logit += static_cast<double>(logit(0, j));
      logit(0, j) = share * sign * probability(wrong);
    }
    tally.samples = static_cast<double>(x.cols());
    network_.template backward<S>(theta, x, logit, w.network, dtheta, nn::no_gradient<S>());
    return tally;
  }

  DiscriminatorParameters parameters_;
  Network network_;
  GradientPenalty<Hidden> penalty_;
  std::vector<std::pair<Eigen::Index, Eigen::Index>> weights_;  ///< offset and number, by layer
};

}  // namespace traceur::learn
