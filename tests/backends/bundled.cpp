// SPDX-License-Identifier: MIT
#include "conformance.hpp"

TEST_CASE("the bundled simulator is one") {
  conformance::Bounds bounds;
  conformance::conforms<traceur::sim::World<double>>(bounds);
}
