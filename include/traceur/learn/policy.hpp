// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <utility>

#include <Eigen/Core>

#include "traceur/learn/environment.hpp"
#include "traceur/nn/mlp.hpp"
#include "traceur/nn/normalizer.hpp"

namespace traceur::learn {

/// A trained policy as a game runs it: a normaliser of observations, frozen, and a network that gives the mean action.
template <class S = float, class Network = nn::Mlp<>>
class Policy {
 public:
  using Vector = Eigen::Matrix<S, Eigen::Dynamic, 1>;
  using Matrix = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;

  /// Throws Error unless network, parameters and normaliser fit together.
  Policy(Network network, Vector parameters, nn::Normalizer normalizer)
      : network_(std::move(network)),
        parameters_(std::move(parameters)),
        normalizer_(std::move(normalizer)),
        workspace_(network_.template workspace<S>(block)),
        seen_(network_.inputs(), block) {
    if (parameters_.size() != network_.parameters())
      throw Error("policy: expected " + std::to_string(network_.parameters()) + " parameters, got " +
                  std::to_string(parameters_.size()));
    if (normalizer_.features() != network_.inputs())
      throw Error("policy: expected a normalizer of " + std::to_string(network_.inputs()) + " observations, got " +
                  std::to_string(normalizer_.features()));
  }

  const Network& network() const noexcept { return network_; }
  const Vector& parameters() const noexcept { return parameters_; }
  const nn::Normalizer& normalizer() const noexcept { return normalizer_; }

  /// Mean actions of any number of observations, one column each. Allocates nothing.
  void act(ConstColumns<S> observation, Columns<S> action) noexcept {
    for (Eigen::Index from = 0; from < observation.cols(); from += block) {
      const Eigen::Index count = std::min(block, observation.cols() - from);
      auto seen = seen_.leftCols(count);
      normalizer_.template apply<S>(observation.middleCols(from, count), seen);
      network_.template infer<S>(parameters_.data(), seen, workspace_, action.middleCols(from, count));
    }
  }

 private:
  static constexpr Eigen::Index block = 64;

  Network network_;
  Vector parameters_;
  nn::Normalizer normalizer_;
  nn::WorkspaceOf<Network, S> workspace_;
  Matrix seen_;
};

}  // namespace traceur::learn
