// SPDX-License-Identifier: MIT
#include "lane.hpp"

#include "traceur/sim/lanes.hpp"

template void traceur::sim::Lanes<example::Lane>::step(int) noexcept;
template void traceur::sim::Lanes<float>::step(int) noexcept;
