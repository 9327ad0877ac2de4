// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <limits>
#include <string>

#include <Eigen/Core>

#include <traceur/core/error.hpp>
#include <traceur/core/random.hpp>

namespace traceur::parameterize {

struct MetropolisParameters {
  /// Draws per chain that are kept, and how many are thrown away before.
  int draws = 100;
  int burn_in = 0;
  /// Standard deviation of a proposed step in each coordinate (n), > 0.
  Eigen::VectorXd step;
  std::uint64_t seed = 0;
  /// Sets runs of one seed apart.
  std::uint64_t run = 0;
};

/// Draws from a density known up to a factor by Metropolis' algorithm, one chain from each column of `starts` (n by
/// chains): the Markov chain Monte Carlo with several starting points of Lee et al. 2021, s6.2. `log_density(a)` is
/// minus infinity (or not a number) where there is nothing to draw; every start must lie where it is finite. Steps are
/// Gaussian, so where the density has islands apart, what each gets depends on the starts.
///
/// Returns n by draws * chains, chain after chain. Chain k draws from RandomStream(seed, k, run). Throws Error that
/// names the parameter or the start.
template <class F>
requires std::invocable<F&, const Eigen::VectorXd&> Eigen::MatrixXd metropolis(
    F&& log_density, const Eigen::Ref<const Eigen::MatrixXd>& starts, const MetropolisParameters& parameters) {
  const Eigen::Index n = starts.rows();
  if (parameters.draws < 1 || parameters.burn_in < 0)
    throw Error("metropolis: expected 1 or more draws and 0 or more burn_in");
  if (parameters.step.size() != n || !parameters.step.allFinite() || !(parameters.step.minCoeff() > 0.0)) {
    throw Error("metropolis: step: expected " + std::to_string(n) + " finite numbers above 0");
  }
  Eigen::MatrixXd drawn(n, parameters.draws * starts.cols());
  Eigen::VectorXd proposal(n);
  for (Eigen::Index chain = 0; chain < starts.cols(); ++chain) {
    core::RandomStream random(parameters.seed, static_cast<std::uint64_t>(chain), parameters.run);
    Eigen::VectorXd a = starts.col(chain);
    double height = static_cast<double>(log_density(a));
    if (!std::isfinite(height)) {
      throw Error("metropolis: start " + std::to_string(chain) + ": expected a density that is finite and not 0");
    }
    for (Eigen::Index i = -parameters.burn_in; i < parameters.draws; ++i) {
      for (Eigen::Index d = 0; d < n; ++d) proposal(d) = a(d) + parameters.step(d) * random.normal();
      const double next = static_cast<double>(log_density(proposal));
      // 1 - u is above 0, so its logarithm is finite.
      if (std::log(1.0 - random.uniform()) < next - height) {
        a = proposal;
        height = next;
      }
      if (i >= 0) drawn.col(chain * parameters.draws + i) = a;
    }
  }
  return drawn;
}

/// The logarithm of Lee et al. 2021, Eq. 17, p = exp(-k (V - mu) / mu): more draws where the marginal value V is below
/// its mean mu > 0.
inline double refinement_log_density(double value, double mean, double k = 10.0) noexcept {
  // Values that are not positive would turn the preference round; their magnitude is then the scale.
  return -k * (value - mean) / std::max(std::abs(mean), std::numeric_limits<double>::min());
}

}  // namespace traceur::parameterize
