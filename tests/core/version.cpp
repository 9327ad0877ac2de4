// SPDX-License-Identifier: MIT
#include <traceur/core/version.hpp>

#include <string>

#include <doctest/doctest.h>

using traceur::core::Version;

namespace {

std::string spell(const Version& v) {
  return std::to_string(v.major) + '.' + std::to_string(v.minor) + '.' + std::to_string(v.patch);
}

}  // namespace

TEST_CASE("the numbers, the string and the build's version are one") {
  CHECK(spell(traceur::core::version) == traceur::core::version_string);
  CHECK(traceur::core::version_string == TRACEUR_PROJECT_VERSION);
}

TEST_CASE("versions are ordered by major, then minor, then patch") {
  static_assert(Version{0, 1, 9} < Version{0, 2, 0});
  static_assert(Version{0, 9, 9} < Version{1, 0, 0});
  static_assert(Version{1, 2, 3} == Version{1, 2, 3});
  static_assert(Version{1, 2, 4} > Version{1, 2, 3});
}
