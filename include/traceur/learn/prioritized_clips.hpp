// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "traceur/core/error.hpp"
#include "traceur/core/random.hpp"

namespace traceur::learn {

/// Which of many clips, or parts of clips, to practise next: each is drawn in proportion to how often it fails, but never less than a floor, so
/// that mastered ones are not forgotten (PARC, appendix F.2). A failure is an episode that ended early.
///
/// Failure rates are moving averages that start at 1: what has not been tried counts as not mastered. In training with
/// threads, record episodes in the order of environments, not of completion.
class PrioritizedClips {
 public:
  /// `floor`: least sampling weight, in (0, 1]. `memory`: weight of the newest episode in a clip's average, in (0, 1].
  explicit PrioritizedClips(int clips, double floor = 0.01, double memory = 0.01)
      : floor_(floor), memory_(memory) {
    if (clips < 1) throw Error("prioritized clips: expected at least one clip, got " + std::to_string(clips));
    if (!(floor > 0 && floor <= 1)) throw Error("prioritized clips: expected a floor in (0, 1]");
    if (!(memory > 0 && memory <= 1)) throw Error("prioritized clips: expected a memory in (0, 1]");
    failure_rate_.assign(static_cast<std::size_t>(clips), 1.0);
  }

  int clips() const noexcept { return static_cast<int>(failure_rate_.size()); }
  double failure_rate(int clip) const noexcept { return failure_rate_[static_cast<std::size_t>(clip)]; }

  /// The chance that `sample` gives this clip.
  double probability(int clip) const noexcept { return weight(failure_rate(clip)) / total(); }

  /// Counts an episode of a clip.
  void record(int clip, bool failed) noexcept {
    double& rate = failure_rate_[static_cast<std::size_t>(clip)];
    rate += memory_ * ((failed ? 1.0 : 0.0) - rate);
  }

  int sample(core::RandomStream& random) const noexcept {
    double left = total() * random.uniform();
    for (int i = 0; i + 1 < clips(); ++i) {
      left -= weight(failure_rate(i));
      if (left < 0) return i;
    }
    return clips() - 1;
  }

  /// All there is to save and restore.
  std::span<double> state() noexcept { return failure_rate_; }

 private:
  double weight(double rate) const noexcept { return std::max(rate, floor_); }
  double total() const noexcept {
    double sum = 0;
    for (const double rate : failure_rate_) sum += weight(rate);
    return sum;
  }

  double floor_, memory_;
  std::vector<double> failure_rate_;
};

}  // namespace traceur::learn
