// SPDX-License-Identifier: MIT
#include <traceur/backends/mujoco.hpp>

#include "conformance.hpp"

TEST_CASE("MuJoCo is a simulator") {
  conformance::Bounds bounds;
  // Its Euler step lets what a body does within itself move the whole a little.
  bounds.fall = 0.002;
  conformance::conforms<traceur::backends::Mujoco>(bounds);
}
