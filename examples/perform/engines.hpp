// SPDX-License-Identifier: MIT
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "preparation.hpp"
#include "traceur/control/engine.hpp"
#include "traceur/core/pack.hpp"

namespace perform {

/// As many characters at once as the machine's registers hold.
using Lane = traceur::core::Pack<float>;
using Engine = traceur::control::Engine<Lane>;

/// One engine for each of `count` workers; `name` as in options. They step at 960 Hz or, of the time step in `parameters`,
/// the next whole part below that. The bundled simulator needs none. Throws traceur::Error when the engine refuses the
/// character or the terrain.
std::vector<std::shared_ptr<Engine>> make_engines(const std::string& name, const Scene& scene,
                                                  const traceur::sim::Parameters& parameters, int count);

}  // namespace perform
