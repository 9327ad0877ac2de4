// SPDX-License-Identifier: MIT
#include "support.hpp"

#include <traceur/io/mjcf.hpp>

namespace figures {

const Figure& humanoid() {
  static const Figure figure(traceur::io::read_mjcf(TRACEUR_SOURCE_DIR "/examples/characters/humanoid.xml"));
  return figure;
}

}  // namespace figures
