// SPDX-License-Identifier: MIT
#include "support.hpp"

#include <traceur/io/mjcf.hpp>

template void traceur::sim::Lanes<double>::step(int) noexcept;
template void traceur::sim::Lanes<traceur::core::Pack<float>>::step(int) noexcept;
template void traceur::sim::Lanes<traceur::core::Pack<float, 4>>::step(int) noexcept;
template void traceur::sim::Lanes<traceur::core::Pack<double, 2>>::step(int) noexcept;

namespace figures {

const Figure& humanoid() {
  static const Figure figure(traceur::io::read_mjcf(TRACEUR_SOURCE_DIR "/examples/characters/humanoid.xml"));
  return figure;
}

}  // namespace figures
