// SPDX-License-Identifier: MIT
#include <traceur/learn/shared_environments.hpp>

#include <string>
#include <vector>

#include <doctest/doctest.h>

#include "group_support.hpp"
#include <traceur/learn/single_process.hpp>

using namespace traceur;
using namespace traceur::learn;
using namespace learn_test;

static_assert(StyledEnvironments<SharedEnvironments<Points>>);

TEST_CASE("a run is the same to the bit in one process and in several") {
  for (const bool with_style : {false, true}) {
    SingleProcess alone;
    const std::vector<float> whole = shared_run(alone, with_style);
    for (const int size : {2, 4}) {
      std::vector<std::vector<float>> parts(static_cast<std::size_t>(size));
      as_processes(size, [&](ProcessGroup& group) { parts[static_cast<std::size_t>(group.rank())] = shared_run(group, with_style); });
      for (const auto& part : parts) CHECK(part == whole);
    }
    // Some did fall, and their kind is known everywhere.
    CHECK(whole[whole.size() - 1] + whole[whole.size() - 2] + whole[whole.size() - 3] > 4);
  }
}

TEST_CASE("parts of different sizes are refused, by all") {
  std::vector<std::string> said(2);
  as_processes(2, [&](ProcessGroup& group) {
    Points own(4 + group.rank(), 0);
    try {
      SharedEnvironments<Points> shared(own, group);
    } catch (const Error& e) {
      said[static_cast<std::size_t>(group.rank())] = e.what();
    }
  });
  CHECK(said[0] == "shared environments: expected parts of one size, got 4 and 5");
  CHECK(said[1] == "shared environments: expected parts of one size, got 5 and 4");
}
