// SPDX-License-Identifier: MIT
#include "retargeting.hpp"

#include "traceur/motion/retarget.hpp"

namespace example {

traceur::motion::Retargeted retarget(const traceur::motion::Clip& clip, const traceur::body::Character& character,
                                     const traceur::motion::RetargetOptions& options) {
  return traceur::motion::retarget(clip, character, options);
}

}  // namespace example
