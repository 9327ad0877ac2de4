// SPDX-License-Identifier: MIT
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "lane.hpp"
#include "traceur/control/engine.hpp"
#include "traceur/terrain/height_grid.hpp"

namespace example {

using Engine = traceur::control::Engine<Lane>;

/// `count` engines, each for a pack of lanes; `name` as --simulator has it, `character` the text of an MJCF file, `model` what
/// was made of it, `terrain` null for level ground. They step at 960 Hz or, of the time step in `parameters`, the next whole
/// part below that. The bundled simulator needs none. Throws traceur::Error when the engine refuses the character or the
/// terrain.
std::vector<std::shared_ptr<Engine>> make_engines(const std::string& name, const std::string& character,
                                                  const traceur::sim::Model& model, const traceur::terrain::HeightGrid* terrain,
                                                  const traceur::sim::Parameters& parameters, int count);

}  // namespace example
