// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <traceur/core/error.hpp>
#include <traceur/core/executor.hpp>
#include <traceur/diffusion/denoiser.hpp>
#include <traceur/nn/module.hpp>

namespace traceur::diffusion {

/// A network with its parameters as a Denoiser, the samples of a batch split over an executor. Blends by itself
/// (BlendedDenoiser): what depends on the condition alone is computed once for both estimates and all steps, and the two
/// estimates of a sample are separate jobs, so that one sample occupies two threads.
///
/// A sample's bits depend neither on the executor nor on the rest of the batch.
template <class S, DenoisingNetwork<S> N, core::Executor E>
class NetworkDenoiser {
public:
  /// Keeps references to all three; `theta` may change between two uses. For up to `max_samples` samples, of which a job
  /// takes `samples_per_job`. Throws Error for a number below 1.
  NetworkDenoiser(const N& net, const S* theta, E& executor, Eigen::Index max_samples, Eigen::Index samples_per_job = 4)
      : net_(net), theta_(theta), executor_(executor), per_job_(samples_per_job), max_(max_samples) {
    nn::detail::check_positive("network denoiser", "sample", max_samples);
    nn::detail::check_positive("network denoiser", "sample in a job", samples_per_job);
    per_job_ = std::min(per_job_, max_);
    prepared_ = std::make_unique<Prepared>(net.template prepared<S>(max_samples));
    other_.resize(net.features(), max_samples);
    for (int i = 0; i < executor.concurrency(); ++i) scratch_.push_back(net.template scratch<S>(per_job_));
  }

  Eigen::Index features() const noexcept { return net_.features(); }
  Eigen::Index condition_features() const noexcept { return net_.condition_features(); }
  Eigen::Index max_samples() const noexcept { return max_; }

  void begin(const Condition<S>& condition) { begin(condition, Blend{}); }

  void begin(const Condition<S>& condition, Blend blend) {
    samples_ = condition.values.cols();
    assert(samples_ <= max_ && condition.values.rows() == condition_features());
    blend_ = blend;
    net_.load(theta_, *prepared_);
    executor_.run(jobs(), [&](int job, int worker) {
      const auto [first, count] = range(job);
      net_.prepare(theta_, condition.columns(first, count), first, scratch_[static_cast<std::size_t>(worker)], *prepared_);
    });
  }

  void denoise(int step, nn::ConstMatrix<S> noisy, nn::Matrix<S> clean) {
    assert(noisy.cols() == samples_ && clean.cols() == samples_);
    const bool blended = blend_.share != 0.0 && blend_.without != 0;
    const int chunks = jobs();
    executor_.run(blended ? 2 * chunks : chunks, [&](int job, int worker) {
      const bool second = job >= chunks;
      const auto [first, count] = range(second ? job - chunks : job);
      net_.infer(theta_, step, noisy.middleCols(first, count), *prepared_, first, second ? blend_.without : Parts{0},
                 scratch_[static_cast<std::size_t>(worker)],
                 second ? nn::Matrix<S>(other_.middleCols(first, count)) : nn::Matrix<S>(clean.middleCols(first, count)));
    });
    if (blended) {
      const S share = static_cast<S>(blend_.share);
      clean = share * other_.leftCols(samples_) + (S(1) - share) * clean;
    }
  }

private:
  using Prepared = typename N::template Prepared<S>;

  int jobs() const noexcept { return static_cast<int>((samples_ + per_job_ - 1) / per_job_); }
  std::pair<Eigen::Index, Eigen::Index> range(int job) const noexcept {
    const Eigen::Index first = job * per_job_;
    return {first, std::min(per_job_, samples_ - first)};
  }

  const N& net_;
  const S* theta_;
  E& executor_;
  Eigen::Index per_job_;
  Eigen::Index max_;
  Eigen::Index samples_ = 0;
  Blend blend_;
  std::unique_ptr<Prepared> prepared_;
  std::vector<typename N::template Scratch<S>> scratch_;  // one for each worker
  Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> other_;
};

}  // namespace traceur::diffusion
