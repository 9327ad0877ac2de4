// SPDX-License-Identifier: MIT
#include "traceur/backends/bullet.hpp"

#include "adaptor.hpp"

example::PlainSimulator* example::make_bullet(const EngineRequest& request, char* fault, int size) {
  return make_plain<Plain<traceur::backends::Bullet>>(request, fault, size);
}
