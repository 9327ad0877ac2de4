// SPDX-License-Identifier: MIT
#pragma once

#include "traceur/core/pack.hpp"
#include "traceur/sim/lanes.hpp"

namespace example {

/// What the programs simulate with: as many characters at once as the machine's registers hold.
using Lane = traceur::core::Pack<float>;

}  // namespace example

// Compiled once, in lane.cpp: a step takes a compiler long. One character alone is done sooner without lanes.
extern template void traceur::sim::Lanes<example::Lane>::step(int) noexcept;
extern template void traceur::sim::Lanes<float>::step(int) noexcept;
