// SPDX-License-Identifier: MIT
// Compiled once for the folder: a step takes a compiler long.
#include <traceur/sim/lanes.hpp>

template void traceur::sim::Lanes<traceur::core::Pack<float>>::step(int) noexcept;
