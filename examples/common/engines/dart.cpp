// SPDX-License-Identifier: MIT
//
// A library of its own, since DART dictates flags: nothing but the factory is seen from outside.
#include "traceur/backends/dart.hpp"

#include "adaptor.hpp"

[[gnu::visibility("default")]] example::PlainSimulator* example::make_dart(const EngineRequest& request, char* fault,
                                                                          int size) {
  return make_plain<Plain<traceur::backends::Dart>>(request, fault, size);
}
