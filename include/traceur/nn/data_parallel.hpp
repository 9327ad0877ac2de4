// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cassert>
#include <concepts>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include <traceur/core/error.hpp>
#include <traceur/core/executor.hpp>
#include <traceur/nn/module.hpp>
#include <traceur/nn/optimizer.hpp>

namespace traceur::nn {

namespace detail {

struct AnyMemory {
  std::span<std::byte> operator()(int) const { return {}; }
};

}  // namespace detail

/// An executor over several processes that all hold the same data. `share(n, job, memory)` returns, in all of them, when
/// every job was done in at least one and the bytes `memory(i)`, which job i wrote, are there in all.
template <class E>
concept SharingExecutor = core::Executor<E> && requires(E& executor, int n, core::detail::AnyJob job, detail::AnyMemory memory) {
  { executor.share(n, job, memory) } -> std::same_as<void>;
};

/// Splits the samples of a batch into a fixed number of chunks, has each chunk's gradient computed by an executor, and
/// adds the gradients up in the order of the chunks. How the sum is grouped thus depends on the number of chunks alone:
/// the same bits on any number of threads.
///
/// As many chunks as threads are enough to keep them busy; a few times as many even out jobs of unequal length. Each
/// chunk costs a gradient to add up, and its products a copy of the weights.
template <class S>
class DataParallel {
public:
  /// For gradients of `parameters` numbers. Throws Error for less than one of either.
  DataParallel(Eigen::Index parameters, int chunks) {
    detail::check_positive("data parallel", "parameter", parameters);
    detail::check_positive("data parallel", "chunk", chunks);
    gradients_.resize(parameters, chunks);
  }

  Eigen::Index parameters() const noexcept { return gradients_.rows(); }
  int chunks() const noexcept { return static_cast<int>(gradients_.cols()); }
  /// The first sample of a chunk when there are `samples`; chunk `chunks()` would begin where the last one ends.
  Eigen::Index first(int chunk, Eigen::Index samples) const noexcept { return samples * chunk / chunks(); }
  /// The most samples a chunk has: what its workspace must hold.
  Eigen::Index largest(Eigen::Index samples) const noexcept { return (samples + chunks() - 1) / chunks(); }

  /// Calls `f(chunk, first, count, gradient)` for every chunk that has samples, on any thread (or, with a
  /// SharingExecutor, in any process, whose other writes the others do not see): it is to ADD the
  /// gradient over the samples [first, first + count) to `gradient` (S*, zero before), and may write to what belongs to
  /// these samples or to this chunk. Then adds the sum over the chunks to `total`. If a call throws, `total` is left as
  /// it was.
  template <core::Executor E, class F>
  void run(E& executor, Eigen::Index samples, Flat<S> total, F&& f) {
    assert(total.size() == parameters());
    const auto job = [&](int chunk) {
      const Eigen::Index from = first(chunk, samples), count = first(chunk + 1, samples) - from;
      if (count == 0) return;
      auto gradient = gradients_.col(chunk);
      gradient.setZero();
      f(chunk, from, count, gradient.data());
    };
    if constexpr (SharingExecutor<E>) {
      executor.share(chunks(), job, [&](int chunk) {
        return std::as_writable_bytes(std::span(gradients_.col(chunk).data(), static_cast<std::size_t>(parameters())));
      });
    } else {
      executor.run(chunks(), job);
    }
    const Eigen::Index pieces = (parameters() + piece - 1) / piece;
    executor.run(static_cast<int>(pieces), [&](int i) {
      const Eigen::Index from = i * piece, count = std::min(piece, parameters() - from);
      for (int chunk = 0; chunk < chunks(); ++chunk) {
        if (first(chunk, samples) == first(chunk + 1, samples)) continue;
        const S* const part = gradients_.data() + chunk * parameters() + from;
        S* const to = total.data() + from;
        detail::for_each_register<S>(
            count, [&](auto load, auto store) __attribute__((always_inline)) { store(to, load(to) + load(part)); });
      }
    });
  }

  /// The same without gradients: `f(chunk, first, count)`.
  template <core::Executor E, class F>
  void run(E& executor, Eigen::Index samples, F&& f) const {
    executor.run(chunks(), [&](int chunk) {
      const Eigen::Index from = first(chunk, samples), count = first(chunk + 1, samples) - from;
      if (count > 0) f(chunk, from, count);
    });
  }

  /// A workspace of `module` for each chunk of up to `samples` samples.
  template <Module<S> M>
  std::vector<WorkspaceOf<M, S>> workspaces(const M& module, Eigen::Index samples) const {
    std::vector<WorkspaceOf<M, S>> all;
    all.reserve(static_cast<std::size_t>(chunks()));
    for (int i = 0; i < chunks(); ++i) all.push_back(module.template workspace<S>(largest(samples)));
    return all;
  }

private:
  static constexpr Eigen::Index piece = 4096;
  Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> gradients_;
};

}  // namespace traceur::nn
