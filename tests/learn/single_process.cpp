// SPDX-License-Identifier: MIT
#include <traceur/learn/single_process.hpp>

#include <doctest/doctest.h>

using namespace traceur::learn;

TEST_CASE("one process alone agrees with itself") {
  SingleProcess alone;
  CHECK(alone.rank() == 0);
  CHECK(alone.size() == 1);
  CHECK(agreed(alone, 7.5) == 7.5);
  CHECK(agreed(alone, true));
}
