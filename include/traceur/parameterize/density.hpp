// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <numbers>
#include <string>

#include <Eigen/Core>

#include <traceur/core/error.hpp>
#include <traceur/parameterize/kd_tree.hpp>

namespace traceur::parameterize {

/// How densely points lie around a task parameter a: kernel density estimation, Lee et al. 2021, Eq. 15,
///
///     density(a) = peak * sum over |a_k - a| < reach of exp(-(a_k - a)^T A (a_k - a) / bandwidth^2)
///
/// The paper leaves factor and width open. With `peak` = 1 a lone point has density 1 at itself, 0.8 at 0.47 and 0.2
/// at 1.27 bandwidths, which gives the paper's thresholds 0.8 and 0.2 a meaning.
class KernelDensity {
public:
  struct Parameters {
    /// Width of the kernel, in units of the points. The default suits elites of radius 0.1: whatever is within the
    /// radius of one, so that no other fits in, has a density above 0.8, and a region full of elites has no holes.
    double bandwidth = 0.212;
    double peak = 1.0;
    /// Where the kernel is cut off, in bandwidths; at 3 it has fallen to 1e-4.
    double reach = 3.0;
  };

  /// Throws Error that names the parameter.
  KernelDensity() : KernelDensity(Parameters{}) {}
  explicit KernelDensity(const Parameters& parameters) : parameters_(parameters) {
    const auto require = [](double value, const char* name) {
      if (!(std::isfinite(value) && value > 0.0)) {
        throw Error(std::string("KernelDensity: ") + name + ": expected a finite number above 0");
      }
    };
    require(parameters.bandwidth, "bandwidth");
    require(parameters.peak, "peak");
    require(parameters.reach, "reach");
  }

  const Parameters& parameters() const noexcept { return parameters_; }

  /// Eq. 15 at `a` (n). Sums in the order in which the points are found, so it is exact to rounding only.
  template <NeighborSource P>
  double operator()(const P& points, const Eigen::Ref<const Eigen::VectorXd>& a) const {
    double sum = 0.0;
    const double scale = -1.0 / (parameters_.bandwidth * parameters_.bandwidth);
    points.for_each_within(a, parameters_.reach * parameters_.bandwidth, [&](int, double squared) {
      sum += std::exp(scale * squared);
      return true;
    });
    return parameters_.peak * sum;
  }

  /// The estimate of the density from which the points were drawn: Eq. 15 with the factor that makes its integral over
  /// R^n 1 (but for what is cut off), so per product of the parameters' units as they are, not divided by `unit`. 0
  /// without points.
  template <NeighborSource P>
  double probability(const P& points, const Eigen::Ref<const Eigen::VectorXd>& a) const {
    if (points.size() == 0) return 0.0;
    double volume = points.unit().prod();
    const double width = parameters_.bandwidth * std::sqrt(std::numbers::pi);
    for (Eigen::Index d = 0; d < points.dimension(); ++d) volume *= width;
    return (*this)(points, a) / (parameters_.peak * volume * points.size());
  }

private:
  Parameters parameters_;
};

}  // namespace traceur::parameterize
