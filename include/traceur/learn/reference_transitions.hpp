// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <span>
#include <vector>

#include "traceur/core/random.hpp"
#include "traceur/learn/discriminator_features.hpp"
#include "traceur/learn/environment.hpp"
#include "traceur/learn/reference_motion.hpp"

namespace traceur::learn {

/// The histories of a data set: the features of n steps in a row, the oldest first, for every tick of every motion. One
/// motion's steps lie one after the other in memory, so a history is a place in it and no history is stored twice.
class ReferenceTransitions {
 public:
  /// Histories of `steps` ticks. Throws Error when there is no motion, one is of another character, or `steps` < 1.
  ReferenceTransitions(const body::Character& character, const DiscriminatorFeatures& features,
                       const std::vector<ReferenceMotion>& motions, int steps)
      : features_(features.size()), steps_(steps) {
    if (motions.empty()) throw Error("reference transitions: expected a motion");
    if (steps < 1) throw Error("reference transitions: expected at least one step, got " + std::to_string(steps));
    TrackingState<double> state(character);
    for (const ReferenceMotion& m : motions) {
      if (m.poses.rows() != character.skeleton.nq())
        throw Error("reference transitions: motion '" + m.name + "' is of another character");
      Motion& to = motions_.emplace_back();
      to.ticks = m.ticks;
      // What is done once has no past before its first tick; a cycle has.
      to.first = m.cyclic ? 0 : std::min(steps - 1, m.ticks);
      to.features.resize(features_, m.ticks + steps);
      for (int k = 0; k < m.ticks + steps; ++k) {
        int t = k - (steps - 1);
        if (m.cyclic) t = (t % m.ticks + m.ticks) % m.ticks;
        t = std::clamp(t, 0, m.ticks);
        for (int i = 0; i < character.skeleton.nq(); ++i) state.q[static_cast<std::size_t>(i)] = static_cast<double>(m.poses(i, t));
        for (int i = 0; i < character.skeleton.nv(); ++i) state.v[static_cast<std::size_t>(i)] = static_cast<double>(m.velocities(i, t));
        state.measure(character);
        FeatureWriter<double, float> write(to.features.col(k).data(), features_);
        features.write(state, write);
        for (; write.rows() < features_;) write.put(0.0);
      }
    }
  }

  int steps() const noexcept { return steps_; }
  /// Numbers in one step, and in a history.
  Eigen::Index features() const noexcept { return features_; }
  Eigen::Index size() const noexcept { return features_ * steps_; }
  int motions() const noexcept { return static_cast<int>(motions_.size()); }
  /// The first tick of a motion whose whole past is in it.
  int first(int motion) const noexcept { return motions_[static_cast<std::size_t>(motion)].first; }

  /// The history up to a tick, 0 <= tick <= ticks of the motion: size() numbers. Before the first tick of what is done once
  /// that tick is repeated.
  std::span<const float> history(int motion, int tick) const noexcept {
    const Motion& m = motions_[static_cast<std::size_t>(motion)];
    return {m.features.data() + tick * features_, static_cast<std::size_t>(size())};
  }

  /// A history at random: every motion as often as any other, and so its ticks.
  std::span<const float> sample(core::RandomStream& random) const noexcept {
    const auto motion = static_cast<int>(random.below(static_cast<std::uint32_t>(motions_.size())));
    const Motion& m = motions_[static_cast<std::size_t>(motion)];
    const int last = std::max(m.first, m.ticks - 1);
    return history(motion, m.first + static_cast<int>(random.below(static_cast<std::uint32_t>(last - m.first + 1))));
  }

 private:
  struct Motion {
    int ticks = 0, first = 0;
    Eigen::MatrixXf features;  ///< one column a tick, `steps` - 1 before the first
  };

  Eigen::Index features_;
  int steps_;
  std::vector<Motion> motions_;
};

/// The last n steps of each of many environments, as one column of all of them, the oldest step first.
class FeatureHistory {
 public:
  /// Throws Error unless all are at least 1.
  FeatureHistory(Eigen::Index features, int steps, Eigen::Index environments) : features_(features) {
    detail::check_at_least_one("feature history", "feature", features);
    detail::check_at_least_one("feature history", "step", steps);
    detail::check_at_least_one("feature history", "environment", environments);
    columns_.setZero(features * steps, environments);
  }

  const Eigen::MatrixXf& columns() const noexcept { return columns_; }

  /// Forgets the oldest step of an environment and gives where the newest is to be written.
  float* push(Eigen::Index environment) noexcept {
    float* const column = columns_.data() + environment * columns_.rows();
    std::copy(column + features_, column + columns_.rows(), column);
    return column + columns_.rows() - features_;
  }
  /// Replaces an environment's whole past.
  void fill(Eigen::Index environment, std::span<const float> history) noexcept {
    std::copy(history.begin(), history.end(), columns_.data() + environment * columns_.rows());
  }

 private:
  Eigen::Index features_;
  Eigen::MatrixXf columns_;
};

}  // namespace traceur::learn
