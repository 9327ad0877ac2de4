// SPDX-License-Identifier: MIT
// The code of docs/backends.md.
#include <doctest/doctest.h>

#include <traceur/backends/mujoco.hpp>
#include <traceur/io/mjcf.hpp>

using namespace traceur;

TEST_CASE("docs/backends.md") {
  const char* path = TRACEUR_SOURCE_DIR "/examples/characters/humanoid.xml";
  const body::Character humanoid = io::read_mjcf(path);
  sim::Scene scene;
  scene.boxes = terrain::BoxScene({terrain::Box{{2, 0, 0.2}, {0.5, 0.5, 0.2}}});
  backends::Mujoco engine(humanoid, 2, sim::Parameters{}, scene);
  Eigen::VectorXd q = humanoid.skeleton.neutral_pose();
  q[2] = 0.883;
  for (int lane = 0; lane < engine.lanes(); ++lane) engine.reset(lane, q, Eigen::VectorXd::Zero(humanoid.skeleton.nv()));
  engine.push(1, 0, {200, 0, 0});  // N on the root's body, during the next call of step
  engine.step(16);
  Eigen::VectorXd v(humanoid.skeleton.nv());
  engine.velocity(1, v);
  CHECK(v[0] > 0.05);
}
