// SPDX-License-Identifier: MIT
#include "simulators.hpp"

namespace example {

std::vector<SimulatorChoice> simulators() {
  std::vector<SimulatorChoice> all{{"bundled", nullptr, nullptr},
                                   {"mujoco", nullptr, "libmujoco-dev"},
                                   {"dart", nullptr, "libdart-dev"},
                                   {"ode", nullptr, "libode-dev"},
                                   {"bullet", nullptr, "libbullet-dev"}};
#ifdef EXAMPLES_WITH_MUJOCO
  all[1].factory = make_mujoco;
#endif
#ifdef EXAMPLES_WITH_DART
  all[2].factory = make_dart;
#endif
#ifdef EXAMPLES_WITH_ODE
  all[3].factory = make_ode;
#endif
#ifdef EXAMPLES_WITH_BULLET
  all[4].factory = make_bullet;
#endif
  return all;
}

SimulatorChoice find_simulator(const std::string& name) { return find_simulator(name, simulators()); }

}  // namespace example
