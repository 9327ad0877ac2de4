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

/// An engine for a pack of lanes, null for the bundled simulator, which needs none; `name` as --simulator has it, `character`
/// the text of an MJCF file, `model` what was made of it, `terrain` of each lane, null for level ground; lanes beyond have the
/// last one's. It steps at 960 Hz or, of the time step in `parameters`, the next whole part below that. Throws traceur::Error
/// when the engine refuses the character or a terrain.
std::shared_ptr<Engine> make_engine(const std::string& name, const std::string& character, const traceur::sim::Model& model,
                                    const std::vector<const traceur::terrain::HeightGrid*>& terrain, const traceur::sim::Parameters& parameters);

/// `count` of them, all on the same terrain; none for the bundled simulator.
std::vector<std::shared_ptr<Engine>> make_engines(const std::string& name, const std::string& character,
                                                  const traceur::sim::Model& model, const traceur::terrain::HeightGrid* terrain,
                                                  const traceur::sim::Parameters& parameters, int count);

}  // namespace example
