// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "traceur/core/error.hpp"

namespace traceur::evaluate {

/// Where the heavily visited part of a task space begins: density above D (Lee et al. 2021, s6.2).
inline constexpr double heavily_visited = 0.8;

/// The share of a box-shaped task space that has been visited heavily (Lee et al. 2021, s7.1, "exploration ratio" ER):
/// where `density`, a callable const Eigen::VectorXd& -> double, exceeds `threshold`. Counted at the middles of
/// `per_axis` cells along each axis, per_axis^n evaluations; off by some 1 / per_axis of the region's extent at most.
/// An axis of no width counts as one cell. Throws Error if the bounds do not match or there are more than 10^8 cells.
template <class Density>
inline double exploration_ratio(Density&& density, const Eigen::VectorXd& lower, const Eigen::VectorXd& upper,
                                double threshold = heavily_visited, int per_axis = 50) {
  const Eigen::Index n = lower.size();
  if (n == 0 || upper.size() != n)
    throw Error("exploration ratio: expected a lower and an upper bound for each parameter");
  if (per_axis < 1) throw Error("exploration ratio: expected at least one cell per axis");
  double cells = 1;
  std::vector<int> counts;
  for (Eigen::Index k = 0; k < n; ++k) {
    if (!(lower[k] <= upper[k]) || !std::isfinite(lower[k]) || !std::isfinite(upper[k]))
      throw Error("exploration ratio: expected finite bounds with lower <= upper for parameter " + std::to_string(k));
    counts.push_back(lower[k] == upper[k] ? 1 : per_axis);
    cells *= counts.back();
  }
  if (cells > 1e8) throw Error("exploration ratio: expected at most 10^8 cells; take fewer per axis");
  std::vector<int> at(counts.size(), 0);
  Eigen::VectorXd place(n);
  std::int64_t visited = 0;
  for (;;) {
    for (Eigen::Index k = 0; k < n; ++k) {
      const auto axis = static_cast<std::size_t>(k);
      place[k] = lower[k] + (upper[k] - lower[k]) * (at[axis] + 0.5) / counts[axis];
    }
    if (density(static_cast<const Eigen::VectorXd&>(place)) > threshold) ++visited;
    std::size_t axis = 0;
    while (axis < at.size() && ++at[axis] == counts[axis]) at[axis++] = 0;
    if (axis == at.size()) break;
  }
  return static_cast<double>(visited) / cells;
}

/// How often each of a number of things was done: skills over obstacles (HIL Figure 6), task parameters over bins.
class CoverageHistogram {
public:
  /// Throws Error without anything to count.
  explicit CoverageHistogram(int kinds) : counts_(static_cast<std::size_t>(std::max(kinds, 0)), 0) {
    if (kinds < 1) throw Error("coverage histogram: expected at least one kind");
  }

  int kinds() const { return static_cast<int>(counts_.size()); }
  std::int64_t total() const { return total_; }
  std::int64_t count(int kind) const { return counts_[static_cast<std::size_t>(kind)]; }

  /// Throws Error on a kind that there is not.
  void add(int kind) {
    if (kind < 0 || kind >= kinds())
      throw Error("coverage histogram: expected a kind below " + std::to_string(kinds()) + ", found " +
                  std::to_string(kind));
    ++counts_[static_cast<std::size_t>(kind)];
    ++total_;
  }

  /// The share of all that was of a kind; 0 as long as nothing was counted.
  double share(int kind) const {
    return total_ == 0 ? 0 : static_cast<double>(count(kind)) / static_cast<double>(total_);
  }

  /// The share of the kinds that came up at least `least` times.
  double covered(std::int64_t least = 1) const {
    return static_cast<double>(
               std::count_if(counts_.begin(), counts_.end(), [&](std::int64_t c) { return c >= least; })) /
           kinds();
  }

  /// The entropy of the shares over that of equal ones: 1 when all kinds are as frequent, 0 when there is one (mode
  /// collapse). 0 with nothing counted, 1 for a single kind that was.
  double evenness() const {
    if (total_ == 0) return 0;
    if (kinds() == 1) return 1;
    double entropy = 0;
    for (int k = 0; k < kinds(); ++k)
      if (count(k) > 0) entropy -= share(k) * std::log(share(k));
    return entropy / std::log(static_cast<double>(kinds()));
  }

  /// Half the sum of the differences of shares from another's (total variation): 0 when they agree, 1 when no kind is
  /// in both. Throws Error if the other counts other kinds.
  double distance(const CoverageHistogram& other) const {
    if (other.kinds() != kinds()) throw Error("coverage histogram: expected histograms of as many kinds");
    double sum = 0;
    for (int k = 0; k < kinds(); ++k) sum += std::abs(share(k) - other.share(k));
    return 0.5 * sum;
  }

private:
  std::vector<std::int64_t> counts_;
  std::int64_t total_ = 0;
};

}  // namespace traceur::evaluate
