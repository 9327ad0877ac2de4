// SPDX-License-Identifier: MIT
#include <traceur/learn/group_executor.hpp>

#include <atomic>
#include <vector>

#include <doctest/doctest.h>

#include "group_support.hpp"
#include <traceur/learn/single_process.hpp>

using namespace traceur;
using namespace traceur::learn;
using namespace learn_test;

static_assert(core::Executor<GroupExecutor<core::SerialExecutor>>);
static_assert(nn::SharingExecutor<GroupExecutor<core::ThreadExecutor>>);
static_assert(!nn::SharingExecutor<core::ThreadExecutor>);

TEST_CASE("every job is done once, wherever, and its memory is told to all") {
  for (const int size : {1, 2, 3, 5}) {
    std::atomic<int> done{0}, wrong{0};
    as_processes(size, [&](ProcessGroup& group) {
      core::ThreadExecutor local(1);
      GroupExecutor<core::ThreadExecutor> executor(group, local);
      std::vector<int> results(7, -1);
      executor.share(7, [&](int i) {
        results[static_cast<std::size_t>(i)] = i * i;
        ++done;
      }, [&](int i) { return std::as_writable_bytes(std::span(&results[static_cast<std::size_t>(i)], 1)); });
      for (int i = 0; i < 7; ++i) wrong += results[static_cast<std::size_t>(i)] != i * i;
      int here = 0;
      executor.run(4, [&](int) { ++here; });
      wrong += here != 4;
      wrong += agreed(group, group.rank()) != 0;
    });
    CHECK(done == 7);
    CHECK(wrong == 0);
  }
}
