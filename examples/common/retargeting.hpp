// SPDX-License-Identifier: MIT
#pragma once

#include "traceur/body/character.hpp"
#include "traceur/motion/retarget.hpp"

namespace example {

/// motion::retarget, which takes a compiler long, compiled once.
traceur::motion::Retargeted retarget(const traceur::motion::Clip& clip, const traceur::body::Character& character,
                                     const traceur::motion::RetargetOptions& options = {});

}  // namespace example
