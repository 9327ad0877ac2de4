// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "engines/plain.hpp"
#include "traceur/core/error.hpp"

namespace example {

/// A choice of --simulator.
struct SimulatorChoice {
  std::string name;
  EngineFactory* factory = nullptr;  ///< null: the bundled simulator, or an engine that is not in this build
  const char* package = nullptr;     ///< of Debian and Ubuntu; null: the bundled simulator
};

/// All choices, the default first.
std::vector<SimulatorChoice> simulators();

/// The choice of that name. Throws traceur::Error that tells the names there are, or which package an engine was built without.
inline SimulatorChoice find_simulator(const std::string& name, const std::vector<SimulatorChoice>& choices) {
  std::string names;
  for (const SimulatorChoice& s : choices) {
    names += (names.empty() ? "" : ", ") + s.name;
    if (s.name != name) continue;
    if (s.package && !s.factory)
      throw traceur::Error("--simulator " + name + ": not in this build; install " + s.package +
                           " (Debian, Ubuntu) and build again");
    return s;
  }
  throw traceur::Error("--simulator: expected one of " + names + ", got '" + name + "'");
}
/// The same of all choices.
SimulatorChoice find_simulator(const std::string& name);

}  // namespace example
