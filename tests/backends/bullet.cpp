// SPDX-License-Identifier: MIT
#include <traceur/backends/bullet.hpp>

#include "conformance.hpp"

TEST_CASE("Bullet is a simulator") {
  conformance::Bounds bounds;
  bounds.fall = 0.002;
  // On boxes its contact points jump about while the body still sways.
  bounds.creep = 0.004;
  conformance::conforms<traceur::backends::Bullet>(bounds);
}
