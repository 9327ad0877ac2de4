// SPDX-License-Identifier: MIT
#include <traceur/core/executor.hpp>

#include <atomic>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <doctest/doctest.h>

using traceur::core::Executor;
using traceur::core::SerialExecutor;
using traceur::core::ThreadExecutor;

namespace {

struct NoConcurrency {
  template <class F>
  void run(int n, F&& f) {
    for (int i = 0; i < n; ++i) f(i);
  }
};

struct NoWorkers {
  int concurrency() const { return 1; }
  template <std::invocable<int> F>
  void run(int n, F&& f) {
    for (int i = 0; i < n; ++i) f(i);
  }
};

static_assert(Executor<SerialExecutor>);
static_assert(Executor<const SerialExecutor>);
static_assert(Executor<ThreadExecutor>);
static_assert(!Executor<NoConcurrency>);
static_assert(!Executor<NoWorkers>);
static_assert(!Executor<const ThreadExecutor>);

template <class F>
void on_every_executor(F f) {
  SerialExecutor serial;
  f(serial);
  for (const int threads : {1, 2, 3, 7}) {
    ThreadExecutor executor(threads);
    CHECK(executor.concurrency() == threads);
    f(executor);
  }
}

int free_function_calls = 0;
void free_function(int) { ++free_function_calls; }

}  // namespace

TEST_SUITE("core/executor") {
  TEST_CASE("every index runs exactly once") {
    on_every_executor([](auto& executor) {
      for (const int n : {-1, 0, 1, 2, 5, 1000}) {
        std::vector<std::atomic<int>> calls(static_cast<std::size_t>(n > 0 ? n : 0));
        executor.run(n, [&](int i) { ++calls.at(static_cast<std::size_t>(i)); });
        for (const auto& count : calls) CHECK(count == 1);
      }
    });
  }

  TEST_CASE("what jobs wrote without synchronisation is there after the run, round after round") {
    on_every_executor([](auto& executor) {
      std::vector<int> values(64, 0);
      for (int round = 0; round < 500; ++round) {
        executor.run(64, [&](int i) { values[static_cast<std::size_t>(i)] += i; });
      }
      for (int i = 0; i < 64; ++i) CHECK(values[static_cast<std::size_t>(i)] == 500 * i);
    });
  }

  TEST_CASE("jobs at the same time have different workers, each within the concurrency") {
    on_every_executor([](auto& executor) {
      std::vector<std::atomic<bool>> taken(static_cast<std::size_t>(executor.concurrency()));
      std::atomic<int> faults{0};
      executor.run(200, [&](int, int worker) {
        if (worker < 0 || worker >= executor.concurrency()) {
          ++faults;
          return;
        }
        std::atomic<bool>& mine = taken[static_cast<std::size_t>(worker)];
        if (mine.exchange(true)) ++faults;
        std::this_thread::yield();
        mine.store(false);
      });
      CHECK(faults == 0);
    });
  }

  TEST_CASE("threads work at the same time") {
    ThreadExecutor executor(2);
    std::atomic<int> arrived{0};
    executor.run(2, [&](int) {
      ++arrived;
      while (arrived < 2) std::this_thread::yield();
    });
    CHECK(arrived == 2);
  }

  TEST_CASE("a worker begins with the same indices run after run") {
    ThreadExecutor executor(2);
    std::atomic<int> others{0};
    for (int round = 0; round < 200; ++round) {
      std::atomic<int> arrived{0};
      // Nobody is done before both have begun, so nobody helps.
      executor.run(2, [&](int i, int worker) {
        if (i != worker) ++others;
        ++arrived;
        while (arrived < 2) std::this_thread::yield();
      });
    }
    CHECK(others == 0);
  }

  TEST_CASE("who is done helps the others") {
    ThreadExecutor executor(2);
    std::atomic<int> done{0};
    std::atomic<bool> helped{false};
    executor.run(100, [&](int i, int worker) {
      if (i == 0) {
        while (done < 99) std::this_thread::yield();
        return;
      }
      if (i < 50 && worker == 1) helped = true;
      ++done;
    });
    CHECK(helped);
  }

  TEST_CASE("the exception of the lowest index comes out, and the executor still works") {
    on_every_executor([](auto& executor) {
      for (int repeat = 0; repeat < 50; ++repeat) {
        std::string message;
        std::vector<std::atomic<int>> calls(100);
        try {
          executor.run(100, [&](int i) {
            ++calls[static_cast<std::size_t>(i)];
            if (i == 20 && repeat % 2 == 0) std::this_thread::yield();
            if (i >= 20 && i % 4 == 0) throw std::runtime_error(std::to_string(i));
          });
        } catch (const std::runtime_error& error) {
          message = error.what();
        }
        CHECK(message == "20");
        for (std::size_t i = 0; i <= 20; ++i) CHECK(calls[i] == 1);
        std::atomic<int> count{0};
        executor.run(10, [&](int) { ++count; });
        CHECK(count == 10);
      }
    });
  }

  TEST_CASE("a job may run jobs on its own executor, and they keep its worker") {
    on_every_executor([](auto& executor) {
      std::vector<std::atomic<int>> calls(8 * 9);
      std::atomic<int> faults{0};
      executor.run(8, [&](int i, int outer) {
        executor.run(9, [&](int j, int inner) {
          ++calls[static_cast<std::size_t>(9 * i + j)];
          if (inner != outer) ++faults;
        });
        executor.run(1, [&](int, int inner) {
          if (inner != outer) ++faults;
        });
      });
      for (const auto& count : calls) CHECK(count == 1);
      CHECK(faults == 0);
    });
  }

  TEST_CASE("two threads may share an executor, and two executors may nest in each other") {
    ThreadExecutor a(2), b(2);
    std::atomic<int> count{0};
    std::thread other([&] {
      for (int i = 0; i < 50; ++i) b.run(4, [&](int) { a.run(4, [&](int) { ++count; }); });
    });
    for (int i = 0; i < 50; ++i) a.run(4, [&](int) { b.run(4, [&](int) { ++count; }); });
    other.join();
    CHECK(count == 2 * 50 * 16);
  }

  TEST_CASE("callables of every kind") {
    ThreadExecutor executor(2);
    free_function_calls = 0;
    executor.run(1, free_function);
    SerialExecutor().run(3, free_function);
    CHECK(free_function_calls == 4);
    std::atomic<int> count{0};
    const auto constant = [&](int) { ++count; };
    executor.run(5, constant);
    executor.run(5, [&count](int) mutable { ++count; });
    CHECK(count == 10);
  }

  TEST_CASE("bad numbers of threads are named") {
    CHECK_THROWS_WITH_AS(ThreadExecutor(-3), "ThreadExecutor: threads must be 0 (all) or more, got -3", traceur::Error);
    CHECK(ThreadExecutor(0).concurrency() >= 1);
  }
}
