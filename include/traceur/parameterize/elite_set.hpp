// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <traceur/core/error.hpp>
#include <traceur/parameterize/kd_tree.hpp>

namespace traceur::parameterize {

struct EliteSetParameters {
  /// The unit of each task parameter, > 0 (none for all 1): A = diag(1 / unit^2) of Lee et al. 2021, Eq. 13.
  Eigen::VectorXd unit;
  /// r: no two elites are nearer than this, in units.
  double radius = 0.1;
  /// Only a fitness above this is let in.
  double threshold = 0.1;
  /// How much better than the elites it replaces a new one must be to count as a discovery (s6.1).
  double margin = 0.02;
};

/// What became of an episode offered to an `EliteSet`.
struct EliteOutcome {
  bool accepted = false;
  /// Accepted into empty surroundings or clearly better than what it replaced: what the exploration rate counts.
  bool discovery = false;
  /// The number of elites it replaced.
  int replaced = 0;
};

/// The best episode of every neighbourhood of a task space, Lee et al. 2021, s5.2 and Eq. 13. An episode with task
/// parameters a and fitness F is let in if F exceeds the threshold and the fitness of every elite a' with
/// (a - a')^T A (a - a') < r^2, all of which it then replaces. Hence no two elites are ever nearer than r, and none
/// leaves but for a better one.
///
/// A `Payload` comes with each, such as the motion's displacements as a vector. Elites are numbered 0 to size() - 1; an
/// insertion may renumber them. A model of `NeighborSource`.
template <class Payload = Eigen::VectorXd>
class EliteSet {
public:
  /// Throws Error that names the parameter.
  explicit EliteSet(Eigen::Index dimension, const EliteSetParameters& parameters = {})
      : parameters_(parameters), tree_(dimension, parameters.unit) {
    const auto require = [](bool holds, const char* what) {
      if (!holds) throw Error(std::string("EliteSet: ") + what);
    };
    require(std::isfinite(parameters.radius) && parameters.radius > 0.0, "radius: expected a finite number above 0");
    require(std::isfinite(parameters.threshold), "threshold: expected a finite number");
    require(parameters.margin >= 0.0, "margin: expected 0 or more");
  }

  Eigen::Index dimension() const noexcept { return tree_.dimension(); }
  int size() const noexcept { return tree_.size(); }
  const Eigen::VectorXd& unit() const noexcept { return tree_.unit(); }
  const EliteSetParameters& parameters() const noexcept { return parameters_; }

  /// The task parameters (n) of elite `i`, its fitness and what came with it.
  const Eigen::VectorXd& parameter(int i) const noexcept { return elites_[static_cast<std::size_t>(i)].parameter; }
  double fitness(int i) const noexcept { return elites_[static_cast<std::size_t>(i)].fitness; }
  const Payload& payload(int i) const noexcept { return elites_[static_cast<std::size_t>(i)].payload; }

  /// Offers an episode. A fitness that is not a number is refused. Throws Error if `a` (n) has another size or is not
  /// finite.
  EliteOutcome insert(const Eigen::Ref<const Eigen::VectorXd>& a, double fitness, Payload payload = {}) {
    EliteOutcome outcome;
    if (!(fitness > parameters_.threshold)) return outcome;
    inferior_.clear();
    bool best = true;
    double displaced = -std::numeric_limits<double>::infinity();
    tree_.for_each_within(a, parameters_.radius, [&](int i, double) {
      best = fitness > this->fitness(i);
      displaced = std::max(displaced, this->fitness(i));
      inferior_.push_back(i);
      return best;
    });
    if (!best) return outcome;
    // From the highest number down, so that none of those to go is renumbered by one that goes.
    std::sort(inferior_.begin(), inferior_.end(), std::greater<>());
    for (const int i : inferior_) {
      tree_.remove(i);
      if (static_cast<std::size_t>(i) + 1 < elites_.size())
        elites_[static_cast<std::size_t>(i)] = std::move(elites_.back());
      elites_.pop_back();
    }
    tree_.insert(a);
    elites_.push_back({a, fitness, std::move(payload)});
    outcome.accepted = true;
    outcome.replaced = static_cast<int>(inferior_.size());
    outcome.discovery = inferior_.empty() || fitness > displaced + parameters_.margin;
    return outcome;
  }

  /// See `NeighborSource`.
  template <class F>
  void for_each_within(const Eigen::Ref<const Eigen::VectorXd>& a, double radius, F&& f) const {
    tree_.for_each_within(a, radius, std::forward<F>(f));
  }
  int nearest(const Eigen::Ref<const Eigen::VectorXd>& a, std::span<Neighbor> out) const {
    return tree_.nearest(a, out);
  }

private:
  struct Elite {
    Eigen::VectorXd parameter;
    double fitness;
    Payload payload;
  };

  EliteSetParameters parameters_;
  KdTree tree_;
  std::vector<Elite> elites_;
  std::vector<int> inferior_;
};

}  // namespace traceur::parameterize
