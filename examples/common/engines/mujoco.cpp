// SPDX-License-Identifier: MIT
#include "traceur/backends/mujoco.hpp"

#include "adaptor.hpp"

namespace {

/// On the ground that the controller was learnt on, as far as MuJoCo has it: the one it would have by itself is harder.
class SoftMujoco : public traceur::backends::Mujoco {
public:
  SoftMujoco(const traceur::body::Character& character, int lanes, const traceur::sim::Parameters& parameters,
             const traceur::sim::Scene& scene)
      : Mujoco(character, lanes, parameters, scene, traceur::backends::MujocoGround::given) {}
};

}  // namespace

example::PlainSimulator* example::make_mujoco(const EngineRequest& request, char* fault, int size) {
  return make_plain<Plain<SoftMujoco>>(request, fault, size);
}
