// SPDX-License-Identifier: MIT
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "../common/engines.hpp"
#include "preparation.hpp"

namespace perform {

using example::Engine;
using example::Lane;

/// One engine for each of `count` workers, as example::make_engines makes them.
inline std::vector<std::shared_ptr<Engine>> make_engines(const std::string& name, const Scene& scene,
                                                         const traceur::sim::Parameters& parameters, int count) {
  return example::make_engines(name, scene.character_text, scene.model, scene.terrain ? &*scene.terrain : nullptr, parameters, count);
}

}  // namespace perform
