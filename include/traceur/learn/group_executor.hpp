// SPDX-License-Identifier: MIT
#pragma once

#include <utility>

#include "traceur/core/executor.hpp"
#include "traceur/learn/process_group.hpp"
#include "traceur/nn/data_parallel.hpp"

namespace traceur::learn {

/// An executor over several processes that hold the same data. `run` is of this process alone. `share` does every job in one
/// process only, job i in process i modulo their number, and then tells all of them what came of it: gradients are worked out
/// in parts, and added up everywhere in the same order, so the bits depend on neither the processes nor their threads.
template <core::Executor Local>
class GroupExecutor {
 public:
  /// Both must outlive this.
  GroupExecutor(ProcessGroup& group, Local& local) : group_(&group), local_(&local) {}

  ProcessGroup& group() const noexcept { return *group_; }
  int concurrency() const noexcept { return local_->concurrency(); }

  template <core::Job F>
  void run(int n, F&& f) {
    local_->run(n, std::forward<F>(f));
  }

  /// `memory(i)` is what job i writes, a span of bytes of the same length in every process. Jobs must not throw: the others
  /// would wait for them for ever.
  template <core::Job F, class Memory>
  void share(int n, F&& f, Memory&& memory) {
    const int rank = group_->rank(), size = group_->size();
    if (size == 1) return local_->run(n, std::forward<F>(f));
    const int own = (n - rank + size - 1) / size;
    local_->run(own, [&](int k, int worker) { core::detail::call(f, rank + k * size, worker); });
    for (int i = 0; i < n; ++i) group_->broadcast(i % size, memory(i));
  }

 private:
  ProcessGroup* group_;
  Local* local_;
};

}  // namespace traceur::learn
