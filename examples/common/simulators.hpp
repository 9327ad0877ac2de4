// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "engines/plain.hpp"

namespace example {

/// A choice of --simulator.
struct SimulatorChoice {
  std::string name;
  EngineFactory* factory = nullptr;  ///< null: the bundled simulator, or an engine that is not in this build
  const char* package = nullptr;     ///< of Debian and Ubuntu; null: the bundled simulator
};

/// All choices, the default first.
std::vector<SimulatorChoice> simulators();
/// Throws traceur::Error when there is none of that name, or when it is not in this build.
SimulatorChoice find_simulator(const std::string& name);

}  // namespace example
