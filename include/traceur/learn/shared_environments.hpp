// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "traceur/learn/environment.hpp"
#include "traceur/learn/process_group.hpp"

namespace traceur::learn {

/// A task shared out over a group of processes: each steps its own part of the environments, and every process sees all of
/// them, one part after the other in order of rank. A model of `Environments` wherever the part is one.
///
/// For the same results whatever the number of processes, the part of rank r must behave as environments r n, r n + 1, ... of
/// a whole task do (`Tracking` and `Locomotion` have a setting for it); where environments learn from each other's ends, as
/// with prioritised motions, the part has `outcome(e)` and `witness(outcome)` beside `restart(e)`.
template <class E, class S = float>
  requires Environments<E, S>
class SharedEnvironments {
 public:
  /// `own`: this process's part. Both must outlive this. Throws Error unless all parts are of the same size.
  SharedEnvironments(E& own, ProcessGroup& group)
      : own_(&own), group_(&group), count_(own.environments()), told_(static_cast<std::size_t>(count_ * group.size())), own_result_(count_) {
    // All are heard before one complains, so that no process waits for another that has left.
    Eigen::Index other = count_;
    for (int rank = 0; rank < group.size(); ++rank) {
      Eigen::Index theirs = count_;
      group.broadcast(rank, std::as_writable_bytes(std::span(&theirs, 1)));
      if (theirs != count_) other = theirs;
    }
    if (other != count_)
      throw Error("shared environments: expected parts of one size, got " + std::to_string(count_) + " and " + std::to_string(other));
    seen_.setZero(own.observations(), environments());
    if constexpr (styled) style_.setZero(own.style_features(), environments());
  }

  Eigen::Index environments() const noexcept { return count_ * group_->size(); }
  Eigen::Index observations() const noexcept { return own_->observations(); }
  Eigen::Index actions() const noexcept { return own_->actions(); }
  Eigen::Index style_features() const noexcept
    requires requires(const E& e) { e.style_features(); }
  {
    return own_->style_features();
  }

  void reset(std::uint64_t seed) { own_->reset(seed); }

  void observe(Columns<S> out) const {
    own_->observe(seen_.middleCols(first(), count_));
    gather(seen_);
    out = seen_;
  }
  void observe_style(Columns<S> out) const
    requires requires(const E& e, Columns<S> to) { e.observe_style(to); }
  {
    own_->observe_style(style_.middleCols(first(), count_));
    gather(style_);
    out = style_;
  }

  void step(ConstColumns<S> actions, StepResult<S>& result) {
    own_result_.clear();
    own_->step(actions.middleCols(first(), count_), own_result_);
    for (Eigen::Index e = 0; e < count_; ++e) {
      Told& t = told_[static_cast<std::size_t>(first() + e)];
      t = {own_result_.reward[e], own_result_.reward_rate[e], own_result_.duration[e], own_result_.end[e], -1};
      if constexpr (witnesses) t.outcome = own_->outcome(e);
    }
    for (int rank = 0; rank < group_->size(); ++rank)
      group_->broadcast(rank, std::as_writable_bytes(std::span(told_).subspan(static_cast<std::size_t>(rank * count_), static_cast<std::size_t>(count_))));
    for (Eigen::Index e = 0; e < environments(); ++e) {
      const Told& t = told_[static_cast<std::size_t>(e)];
      result.reward[e] = t.reward;
      result.reward_rate[e] = t.rate;
      result.duration[e] = t.duration;
      result.end[e] = t.end;
    }
  }

  void restart(Eigen::Index e) noexcept {
    if (e >= first() && e < first() + count_) return own_->restart(e - first());
    if constexpr (witnesses) own_->witness(told_[static_cast<std::size_t>(e)].outcome);
  }

 private:
  static constexpr bool styled = requires(const E& e, Columns<S> to) { e.observe_style(to); };
  static constexpr bool witnesses = requires(E& e) { e.witness(e.outcome(Eigen::Index{0})); };

  /// What all processes are told of a step of an environment.
  struct Told {
    S reward = 0, rate = 0, duration = 1;
    End end = End::running;
    std::int32_t outcome = -1;
  };

  Eigen::Index first() const noexcept { return group_->rank() * count_; }
  void gather(Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>& all) const {
    for (int rank = 0; rank < group_->size(); ++rank)
      group_->broadcast(rank, std::as_writable_bytes(std::span(all.data() + rank * count_ * all.rows(), static_cast<std::size_t>(count_ * all.rows()))));
  }

  E* own_;
  ProcessGroup* group_;
  Eigen::Index count_;
  std::vector<Told> told_;
  StepResult<S> own_result_;
  mutable Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> seen_, style_;  ///< of all, to be told
};

}  // namespace traceur::learn
