// SPDX-License-Identifier: MIT
#pragma once

#include <traceur/core/random.hpp>
#include <traceur/terrain/generators.hpp>

/// 32 by 32 cells with 40 random boxes between -2 and 2 m.
inline traceur::terrain::HeightGrid rough_ground() {
  traceur::terrain::RandomBoxes p;
  p.nx = p.ny = 32;
  p.boxes = 40;
  traceur::core::RandomStream random(3);
  return traceur::terrain::random_boxes(p, random);
}
