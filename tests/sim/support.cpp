// SPDX-License-Identifier: MIT
#include "support.hpp"

template void traceur::sim::Lanes<double>::step(int) noexcept;
template void traceur::sim::Lanes<float>::step(int) noexcept;
template void traceur::sim::Lanes<traceur::core::Pack<float>>::step(int) noexcept;
template void traceur::sim::Lanes<traceur::core::Pack<float, 4>>::step(int) noexcept;
template void traceur::sim::Lanes<traceur::core::Pack<double, 4>>::step(int) noexcept;
