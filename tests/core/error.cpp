// SPDX-License-Identifier: MIT
#include <traceur/core/error.hpp>

#include <stdexcept>
#include <string>
#include <type_traits>

#include <doctest/doctest.h>

static_assert(std::is_base_of_v<std::runtime_error, traceur::Error>);

TEST_CASE("error: keeps its line and is caught as what it is") {
  std::string what;
  try {
    throw traceur::Error("walk.bvh:12: expected 6 channels, found 5");
  } catch (const std::exception& e) {
    what = e.what();
  }
  CHECK(what == "walk.bvh:12: expected 6 channels, found 5");
}
