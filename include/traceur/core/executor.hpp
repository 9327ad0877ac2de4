// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <atomic>
#include <concepts>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <mutex>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include <traceur/core/error.hpp>

namespace traceur::core {

/// What an executor runs: `f(i)`, or `f(i, worker)` where the job wants scratch memory of its worker's own. A callable
/// that takes both is called with two arguments.
template <class F>
concept Job = std::invocable<F&, int> || std::invocable<F&, int, int>;

namespace detail {

struct AnyJob {
  void operator()(int) const {}
};

struct AnyWorkerJob {
  void operator()(int, int) const {}
};

template <Job F>
void call(F& f, int i, int worker) {
  if constexpr (std::invocable<F&, int, int>) {
    f(i, worker);
  } else {
    f(i);
  }
}

}  // namespace detail

/// Runs n independent jobs. Laws the compiler cannot check:
/// - `run(n, f)` returns after f was called exactly once for every i in [0, n), in any order, on any threads; what the
///   jobs wrote is visible to the caller then.
/// - `worker` is in [0, concurrency()), and calls of one run that overlap in time never get the same one.
/// - If jobs throw, `run` rethrows what the lowest throwing i threw, so the error too is independent of the threads;
///   jobs above that i may be left out.
/// - A job may call `run` on its own executor.
///
/// Jobs that write only to what belongs to their i therefore give the same bits on every executor.
template <class E>
concept Executor = requires(E& executor, const E& constant, int n, detail::AnyJob job,
                            detail::AnyWorkerJob worker_job) {
  { constant.concurrency() } -> std::same_as<int>;
  { executor.run(n, job) } -> std::same_as<void>;
  { executor.run(n, worker_job) } -> std::same_as<void>;
};

/// Runs the jobs one after the other on the calling thread.
class SerialExecutor {
public:
  int concurrency() const noexcept { return 1; }

  template <Job F>
  void run(int n, F&& f) const {
    for (int i = 0; i < n; ++i) detail::call(f, i, 0);
  }
};

/// Runs the jobs on a pool of threads that lives as long as the executor. The calling thread works too, so
/// `ThreadExecutor(1)` starts no thread. Each worker begins with a part of the indices of its own, the same in every run
/// of as many, so that data that belongs to an index stays with one core; who is done helps the others, which evens out
/// jobs of unequal length. `run` allocates nothing.
///
/// One `run` uses the pool at a time. A `run` that finds it taken, from inside a job or from another thread, is carried
/// out serially by the thread that called it: never a deadlock, at worst no speed-up. From inside a job, its worker
/// index is that of the job.
class ThreadExecutor {
public:
  /// `threads` workers in all, 0 for as many as the machine has. Throws Error if negative or if the system refuses.
  explicit ThreadExecutor(int threads = 0) {
    if (threads < 0) throw Error("ThreadExecutor: threads must be 0 (all) or more, got " + std::to_string(threads));
    if (threads == 0) threads = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
    threads_.reserve(static_cast<std::size_t>(threads - 1));
    shares_ = std::vector<Share>(static_cast<std::size_t>(threads));
    try {
      for (int worker = 1; worker < threads; ++worker) {
        threads_.emplace_back([this, worker] { serve(worker); });
      }
    } catch (const std::system_error& error) {
      const std::string started = std::to_string(threads_.size() + 1);
      stop();
      throw Error("ThreadExecutor: the system gave " + started + " of " + std::to_string(threads) +
                  " threads: " + error.what());
    }
  }

  ~ThreadExecutor() { stop(); }
  ThreadExecutor(const ThreadExecutor&) = delete;
  ThreadExecutor& operator=(const ThreadExecutor&) = delete;

  int concurrency() const noexcept { return static_cast<int>(threads_.size()) + 1; }

  template <Job F>
  void run(int n, F&& f) {
    if (n <= 0) return;
    if (n == 1 || threads_.empty()) {
      // Leaves the pool free for whatever the job itself has to run.
      const int worker = own_index();
      for (int i = 0; i < n; ++i) detail::call(f, i, worker);
      return;
    }
    if (busy_.exchange(true, std::memory_order_acquire)) {
      const int worker = own_index();
      for (int i = 0; i < n; ++i) detail::call(f, i, worker);
      return;
    }
    caller_.store(std::this_thread::get_id(), std::memory_order_relaxed);
    const Release release{*this};

    auto job = [&f](int i, int worker) { detail::call(f, i, worker); };
    {
      const std::lock_guard lock(mutex_);
      call_ = [](void* callable, int i, int worker) { (*static_cast<decltype(job)*>(callable))(i, worker); };
      callable_ = &job;
      const auto all = static_cast<std::uint64_t>(n), workers = static_cast<std::uint64_t>(shares_.size());
      for (std::uint64_t w = 0; w < workers; ++w) {
        shares_[w].left.store(Share::of(w * all / workers, (w + 1) * all / workers), std::memory_order_relaxed);
      }
      failed_index_.store(n, std::memory_order_relaxed);
      working_.store(static_cast<int>(threads_.size()), std::memory_order_relaxed);
      round_.fetch_add(1, std::memory_order_relaxed);
    }
    wake_.notify_all();
    work(0);
    linger([this] { return working_.load(std::memory_order_relaxed) == 0; });
    std::exception_ptr failure;
    {
      std::unique_lock lock(mutex_);
      done_.wait(lock, [this] { return working_ == 0; });
      failure = std::exchange(failure_, nullptr);
    }
    if (failure) std::rethrow_exception(failure);
  }

private:
  struct Release {
    ThreadExecutor& executor;
    ~Release() {
      executor.caller_.store(std::thread::id{}, std::memory_order_relaxed);
      executor.busy_.store(false, std::memory_order_release);
    }
  };

  // A thread outside the pool is nobody's worker; with the pool taken it runs its own jobs alone, so 0 is free for it.
  int own_index() const noexcept {
    const std::thread::id self = std::this_thread::get_id();
    if (caller_.load(std::memory_order_relaxed) == self) return 0;
    for (std::size_t i = 0; i < threads_.size(); ++i) {
      if (threads_[i].get_id() == self) return static_cast<int>(i) + 1;
    }
    return 0;
  }

  // Rounds follow each other closely, and to wake a thread that sleeps takes longer than many a job: whoever waits looks
  // around for some tens of microseconds first, with the core on offer to others.
  template <class Ready>
  static void linger(Ready&& ready) {
    for (int looks = 0; looks < 100 && !ready(); ++looks) std::this_thread::yield();
  }

  void serve(int worker) {
    unsigned long seen = 0;
    std::unique_lock lock(mutex_);
    for (;;) {
      lock.unlock();
      linger([&] { return round_.load(std::memory_order_relaxed) != seen; });
      lock.lock();
      wake_.wait(lock, [&] { return stopping_ || round_ != seen; });
      if (stopping_) return;
      seen = round_;
      lock.unlock();
      work(worker);
      lock.lock();
      if (--working_ == 0) done_.notify_one();
    }
  }

  // The indices of a run that a worker has not begun: [begin, end), in one word so that owner and helpers agree on it.
  struct alignas(64) Share {
    static std::uint64_t of(std::uint64_t begin, std::uint64_t end) { return end << 32 | begin; }

    /// Takes its first index or, for others, its last; -1 if none is left.
    int take(bool first) {
      std::uint64_t now = left.load(std::memory_order_relaxed);
      for (;;) {
        const std::uint64_t begin = now & 0xffffffffU, end = now >> 32;
        if (begin == end) return -1;
        const std::uint64_t rest = first ? of(begin + 1, end) : of(begin, end - 1);
        if (left.compare_exchange_weak(now, rest, std::memory_order_relaxed)) return static_cast<int>(first ? begin : end - 1);
      }
    }

    std::atomic<std::uint64_t> left{0};
  };

  /// The next index for a worker, -1 when all are taken.
  int next(int worker) {
    const std::size_t n = shares_.size();
    for (std::size_t k = 0; k < n; ++k)
      if (const int i = shares_[(static_cast<std::size_t>(worker) + k) % n].take(k == 0); i >= 0) return i;
    return -1;
  }

  void work(int worker) {
    for (int i = next(worker); i >= 0; i = next(worker)) {
      // Every index below the lowest failure so far still runs, so that the lowest of all is found.
      if (i > failed_index_.load(std::memory_order_relaxed)) continue;
      try {
        call_(callable_, i, worker);
      } catch (...) {
        const std::lock_guard lock(mutex_);
        if (i < failed_index_.load(std::memory_order_relaxed)) {
          failed_index_.store(i, std::memory_order_relaxed);
          failure_ = std::current_exception();
        }
      }
    }
  }

  void stop() {
    {
      const std::lock_guard lock(mutex_);
      stopping_ = true;
    }
    wake_.notify_all();
    for (std::thread& thread : threads_) thread.join();
  }

  std::vector<Share> shares_;  // of each worker
  std::vector<std::thread> threads_;
  std::atomic<bool> busy_{false};
  std::atomic<std::thread::id> caller_{};
  std::mutex mutex_;
  std::condition_variable wake_;
  std::condition_variable done_;
  std::atomic<unsigned long> round_{0};  // written under the mutex, as is working_; watched without it
  std::atomic<int> working_{0};
  bool stopping_ = false;

  // The run in progress; written under the mutex before a round starts, read by the workers during it.
  void (*call_)(void*, int, int) = nullptr;
  void* callable_ = nullptr;
  std::atomic<int> failed_index_{0};
  std::exception_ptr failure_;
};

}  // namespace traceur::core
