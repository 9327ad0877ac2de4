// SPDX-License-Identifier: MIT
#pragma once

#include "traceur/sim/ground.hpp"
#include "traceur/terrain/box_scene.hpp"

namespace traceur::sim {

/// What characters move about in: ground, and solid boxes on it. Any engine is given the same one.
struct Scene {
  Ground<double> ground;
  terrain::BoxScene boxes;
};

}  // namespace traceur::sim
