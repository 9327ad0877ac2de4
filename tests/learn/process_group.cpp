// SPDX-License-Identifier: MIT
#include <traceur/learn/process_group.hpp>

#include <algorithm>
#include <cstdint>
#include <exception>
#include <string>
#include <type_traits>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/error.hpp>
#include <traceur/learn/single_process.hpp>

using namespace traceur;
using namespace traceur::learn;

namespace {

/// One of two processes. What the first tells is kept; the second is told it, in the same order.
class Pair final : public ProcessGroup {
 public:
  Pair(int rank, std::vector<std::byte>& line) : rank_(rank), line_(&line) {}
  int rank() const noexcept override { return rank_; }
  int size() const noexcept override { return 2; }
  void broadcast(int root, std::span<std::byte> memory) override {
    roots.push_back(root);
    if (root == rank_) {
      line_->insert(line_->end(), memory.begin(), memory.end());
    } else {
      if (line_->size() < memory.size()) throw Error("pair: the other said less");
      std::copy_n(line_->begin(), memory.size(), memory.begin());
      line_->erase(line_->begin(), line_->begin() + static_cast<std::ptrdiff_t>(memory.size()));
    }
  }
  [[noreturn]] void abort(int) override { std::terminate(); }

  std::vector<int> roots;

 private:
  int rank_;
  std::vector<std::byte>* line_;
};

struct Place {
  double x;
  std::int32_t n;
  bool here;
};

template <class T>
concept Agreeable = requires(ProcessGroup& group, T mine) { agreed(group, mine); };

static_assert(Agreeable<double> && Agreeable<bool> && Agreeable<Place>);
static_assert(!Agreeable<std::string> && !Agreeable<std::vector<int>>);
static_assert(std::is_abstract_v<ProcessGroup> && std::has_virtual_destructor_v<ProcessGroup>);
static_assert(!std::is_copy_constructible_v<SingleProcess> && !std::is_copy_assignable_v<SingleProcess>);

}  // namespace

TEST_CASE("what is agreed on is what process 0 says, of any plain type") {
  std::vector<std::byte> line;
  Pair first(0, line), second(1, line);
  CHECK(agreed(first, 0.1) == 0.1);
  CHECK(agreed(first, true));
  CHECK(agreed(first, Place{-2.5, 7, true}).n == 7);
  // Bytes, and no more of them than there are.
  CHECK(line.size() == sizeof(double) + sizeof(bool) + sizeof(Place));

  CHECK(agreed(second, 0.9) == 0.1);
  CHECK(agreed(second, false));
  const Place told = agreed(second, Place{0, 0, false});
  CHECK(told.x == -2.5);
  CHECK(told.n == 7);
  CHECK(told.here);
  CHECK(line.empty());
  CHECK(first.roots == std::vector<int>{0, 0, 0});
  CHECK(second.roots == first.roots);
}

TEST_CASE("a process that is told nothing says so") {
  std::vector<std::byte> line;
  Pair second(1, line);
  CHECK_THROWS_WITH_AS(agreed(second, 1), "pair: the other said less", Error);
}

TEST_CASE("one process alone agrees with itself") {
  SingleProcess alone;
  ProcessGroup& group = alone;
  CHECK(group.rank() == 0);
  CHECK(group.size() == 1);
  CHECK(agreed(group, 42) == 42);
}
