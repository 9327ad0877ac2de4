// SPDX-License-Identifier: MIT
#include "../../examples/common/simulators.hpp"

#include <string>
#include <vector>

#include <doctest/doctest.h>

using namespace example;

namespace {

PlainSimulator* make_none(const EngineRequest&, char*, int) { return nullptr; }

/// A build that has found one engine of two.
const std::vector<SimulatorChoice> choices{{"bundled", nullptr, nullptr}, {"ready", make_none, "libready-dev"}, {"absent", nullptr, "libabsent-dev"}};

}  // namespace

TEST_CASE("a simulator is found by its name") {
  CHECK(!find_simulator("bundled", choices).factory);
  CHECK((find_simulator("ready", choices).factory == make_none));
}

TEST_CASE("an engine that this build has not is refused with the package to install") {
  CHECK_THROWS_WITH_AS(find_simulator("absent", choices),
                       "--simulator absent: not in this build; install libabsent-dev (Debian, Ubuntu) and build again", traceur::Error);
}

TEST_CASE("a name that is none is refused with those there are") {
  for (const std::string name : {"physix", "", "Ready", "ready "}) {
    const std::string said = "--simulator: expected one of bundled, ready, absent, got '" + name + "'";
    CHECK_THROWS_WITH_AS(find_simulator(name, choices), said.c_str(), traceur::Error);
  }
}
