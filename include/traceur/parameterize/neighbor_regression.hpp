// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <span>
#include <string>

#include <Eigen/Core>

#include <traceur/core/error.hpp>
#include <traceur/core/random.hpp>
#include <traceur/parameterize/kd_tree.hpp>

namespace traceur::parameterize {

/// Points with a fitness each.
template <class P>
concept RatedPoints = NeighborSource<P> && requires(const P& points, int i) {
  { points.fitness(i) } -> std::convertible_to<double>;
};

/// Points with a fitness and a vector each, all vectors of one size; `EliteSet<Eigen::VectorXd>` is a model.
template <class P>
concept RatedVectors = RatedPoints<P> && requires(const P& points, int i) {
  { points.payload(i) } -> std::convertible_to<const Eigen::VectorXd&>;
};

/// The mean of the k elites nearest to a task parameter a, weighted by Lee et al. 2021, Eq. 14:
///
///     w_k = F_k exp(-(a_k - a)^T A (a_k - a) / sigma^2)
///
/// All that goes into it is of good quality, so it stands in for a regression network that is not yet trained.
class NeighborRegression {
public:
  static constexpr int max_neighbors = 64;

  struct Parameters {
    int neighbors = 5;    ///< k
    double sigma = 0.28;  ///< of the kernel, in units of the elites
  };

  /// Throws Error that names the parameter.
  NeighborRegression() : NeighborRegression(Parameters{}) {}
  explicit NeighborRegression(const Parameters& parameters) : parameters_(parameters) {
    if (parameters.neighbors < 1 || parameters.neighbors > max_neighbors) {
      throw Error("NeighborRegression: neighbors: expected 1 to " + std::to_string(max_neighbors) + ", got " +
                  std::to_string(parameters.neighbors));
    }
    if (!(std::isfinite(parameters.sigma) && parameters.sigma > 0.0)) {
      throw Error("NeighborRegression: sigma: expected a finite number above 0");
    }
  }

  const Parameters& parameters() const noexcept { return parameters_; }

  /// Writes the k nearest elites of `a` (n) to `neighbors` and their weights, which sum to 1, to `weights`; returns how
  /// many there are. Both have room for k. Far from all elites, where every factor of Eq. 14 underflows, the weights
  /// keep their ratios. Fitness must be positive.
  template <RatedPoints E>
  int weigh(const E& elites, const Eigen::Ref<const Eigen::VectorXd>& a, std::span<Neighbor> neighbors,
            std::span<double> weights) const {
    const auto k = static_cast<std::size_t>(parameters_.neighbors);
    if (neighbors.size() < k || weights.size() < k) {
      throw Error("NeighborRegression: expected room for " + std::to_string(k) + " neighbors and weights");
    }
    const int found = elites.nearest(a, neighbors.first(k));
    double sum = 0.0;
    for (int i = 0; i < found; ++i) {
      const Neighbor& neighbor = neighbors[static_cast<std::size_t>(i)];
      // A factor common to all weights makes no difference; this one keeps the nearest at 1.
      const double beyond = neighbor.squared_distance - neighbors[0].squared_distance;
      const double weight =
          elites.fitness(neighbor.index) * std::exp(-beyond / (parameters_.sigma * parameters_.sigma));
      weights[static_cast<std::size_t>(i)] = weight;
      sum += weight;
    }
    for (int i = 0; i < found; ++i) weights[static_cast<std::size_t>(i)] /= sum;
    return found;
  }

  /// The weighted mean of the payloads. Throws Error if there are no elites.
  template <RatedVectors E>
  Eigen::VectorXd operator()(const E& elites, const Eigen::Ref<const Eigen::VectorXd>& a) const {
    std::array<Neighbor, max_neighbors> neighbors;
    std::array<double, max_neighbors> weights;
    const int found = weigh(elites, a, neighbors, weights);
    if (found == 0) throw Error("NeighborRegression: expected one or more elites, got none");
    Eigen::VectorXd mean = weights[0] * elites.payload(neighbors[0].index);
    for (std::size_t i = 1; i < static_cast<std::size_t>(found); ++i) {
      mean += weights[i] * elites.payload(neighbors[i].index);
    }
    return mean;
  }

private:
  Parameters parameters_;
};

/// When to use the regression instead of the network it stands in for (Lee et al. 2021, s5.3): always, until the
/// network's loss has once come below a threshold; from then on at random.
class ProxySwitch {
public:
  /// `probability`: of the regression, once the network is trained. Throws Error if it is not one, or the threshold not
  /// above 0.
  explicit ProxySwitch(double loss_threshold, double probability = 0.5)
      : loss_threshold_(loss_threshold), probability_(probability) {
    if (!(loss_threshold > 0.0)) throw Error("ProxySwitch: loss_threshold: expected a number above 0");
    if (!(probability >= 0.0 && probability <= 1.0)) throw Error("ProxySwitch: probability: expected 0 to 1");
  }

  void report(double loss) noexcept { trained_ = trained_ || loss < loss_threshold_; }
  bool trained() const noexcept { return trained_; }
  bool use_regression(core::RandomStream& random) const noexcept { return !trained_ || random.bernoulli(probability_); }

private:
  double loss_threshold_;
  double probability_;
  bool trained_ = false;
};

}  // namespace traceur::parameterize
