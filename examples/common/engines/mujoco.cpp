// SPDX-License-Identifier: MIT
#include "traceur/backends/mujoco.hpp"

#include "adaptor.hpp"

example::PlainSimulator* example::make_mujoco(const EngineRequest& request, char* fault, int size) {
  return make_plain<Plain<traceur::backends::Mujoco>>(request, fault, size);
}
