// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>

#include "traceur/core/random.hpp"
#include "traceur/learn/environment.hpp"

namespace traceur::learn {

/// Samples of the past, one a column, so that a discriminator does not forget what policies before this one did. It holds
/// the last ones: when full, each new sample takes the place of the oldest.
template <class S = float>
class ReplayBuffer {
 public:
  using Matrix = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;

  /// Throws Error unless both are at least 1.
  ReplayBuffer(Eigen::Index features, Eigen::Index capacity) {
    detail::check_at_least_one("replay buffer", "feature", features);
    detail::check_at_least_one("replay buffer", "sample", capacity);
    samples_.setZero(features, capacity);
  }

  Eigen::Index features() const noexcept { return samples_.rows(); }
  Eigen::Index capacity() const noexcept { return samples_.cols(); }
  Eigen::Index size() const noexcept { return static_cast<Eigen::Index>(std::min<std::int64_t>(added_, samples_.cols())); }
  /// Samples ever added.
  std::int64_t added() const noexcept { return added_; }

  void add(const S* sample) noexcept {
    std::copy_n(sample, features(), samples_.data() + static_cast<Eigen::Index>(added_ % capacity()) * features());
    ++added_;
  }

  /// One of the samples, each equally likely. There is at least one.
  const S* sample(core::RandomStream& random) const noexcept {
    return samples_.data() + static_cast<Eigen::Index>(random.below(static_cast<std::uint32_t>(size()))) * features();
  }

  /// All there is to save, with `added`: the columns in use.
  auto state() const noexcept { return samples_.leftCols(size()); }
  /// Throws Error for samples that the buffer cannot have come to hold.
  void restore(const Eigen::Ref<const Matrix>& samples, std::int64_t added) {
    if (added < 0 || samples.cols() != static_cast<Eigen::Index>(std::min<std::int64_t>(added, capacity())) ||
        (samples.cols() > 0 && samples.rows() != features()))
      throw Error("replay buffer: expected " + std::to_string(features()) + " features and up to " + std::to_string(capacity()) +
                  " samples, got " + std::to_string(samples.rows()) + " and " + std::to_string(samples.cols()));
    if (!samples.allFinite()) throw Error("replay buffer: a sample is not finite");
    samples_.leftCols(samples.cols()) = samples;
    added_ = added;
  }

 private:
  Matrix samples_;
  std::int64_t added_ = 0;
};

}  // namespace traceur::learn
