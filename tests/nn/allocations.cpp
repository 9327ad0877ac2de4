// SPDX-License-Identifier: MIT
#include "allocations.hpp"

#include <atomic>
#include <cstdlib>
#include <memory>

#include <doctest/doctest.h>

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define TRACEUR_TEST_SANITIZED
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define TRACEUR_TEST_SANITIZED
#endif
#endif

namespace {
std::atomic<long> taken{0};
}

// Eigen calls malloc itself, so counting operator new would miss it.
#if defined(__GLIBC__) && !defined(TRACEUR_TEST_SANITIZED)
extern "C" void* __libc_malloc(std::size_t size);
extern "C" void* malloc(std::size_t size) noexcept {
  taken.fetch_add(1, std::memory_order_relaxed);
  return __libc_malloc(size);
}
bool counts_allocations() noexcept { return true; }
#else
bool counts_allocations() noexcept { return false; }
#endif

long allocations() noexcept { return taken.load(std::memory_order_relaxed); }

TEST_CASE("allocations are counted") {
  const long before = allocations();
  const auto number = std::make_unique<int>(1);
  CHECK(*number == 1);
  CHECK((allocations() > before) == counts_allocations());
}
