// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "traceur/core/random.hpp"
#include "traceur/learn/rollout.hpp"

namespace traceur::learn {

/// The samples of a rollout in random order, cut into batches whose sizes differ by one at most. Steps that failed are left
/// out. No allocation after construction.
class Minibatches {
 public:
  /// Room for `samples` samples in batches of at most `batch`. Throws Error unless both are at least 1.
  Minibatches(Eigen::Index samples, Eigen::Index batch) : batch_(batch) {
    detail::check_at_least_one("minibatches", "sample", samples);
    detail::check_at_least_one("minibatches", "sample in a batch", batch);
    order_.resize(static_cast<std::size_t>(samples));
  }

  /// Takes the samples that did not fail, in their own order. The rollout has the samples this was made for.
  template <class S>
  void select(const Rollout<S>& rollout) noexcept {
    used_ = 0;
    for (Eigen::Index i = 0; i < rollout.samples(); ++i)
      if (rollout.end.data()[i] != End::failed) order_[used_++] = static_cast<std::int32_t>(i);
  }

  /// Brings the selected samples into random order.
  void shuffle(core::RandomStream& random) noexcept { random.shuffle(std::span(order_.data(), used_)); }

  Eigen::Index samples() const noexcept { return static_cast<Eigen::Index>(used_); }
  /// Number of batches: the fewest whose sizes keep to the limit.
  Eigen::Index count() const noexcept { return (samples() + batch_ - 1) / batch_; }
  /// The samples of batch k, 0 <= k < count().
  std::span<const std::int32_t> operator[](Eigen::Index k) const noexcept {
    const auto begin = static_cast<std::size_t>(k * samples() / count());
    const auto end = static_cast<std::size_t>((k + 1) * samples() / count());
    return {order_.data() + begin, end - begin};
  }
  std::span<const std::int32_t> all() const noexcept { return {order_.data(), used_}; }

 private:
  Eigen::Index batch_;
  std::vector<std::int32_t> order_;
  std::size_t used_ = 0;
};

/// Copies the named columns of `from` side by side into the first columns of `to`; of each as many rows as `to` has.
template <class S>
void gather(const Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>& from, std::span<const std::int32_t> which,
            Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>& to) noexcept {
  S* out = to.data();
  for (const std::int32_t i : which) {
    const S* column = from.data() + i * from.rows();
    for (Eigen::Index r = 0; r < to.rows(); ++r) *out++ = column[r];
  }
}

}  // namespace traceur::learn
