// SPDX-License-Identifier: MIT
// The code of docs/sim.md.
#include <cmath>
#include <vector>

#include <doctest/doctest.h>

#include "support.hpp"
#include <traceur/body/proportions.hpp>
#include <traceur/io/mjcf.hpp>
#include <traceur/sim/world.hpp>

using namespace traceur;

TEST_CASE("docs/sim.md") {
  const char* path = TRACEUR_SOURCE_DIR "/examples/characters/humanoid.xml";
  const body::Character humanoid = io::read_mjcf(path);
  sim::Parameters parameters;
  parameters.friction = 0.8;
  sim::World<core::Pack<float>> world(humanoid, 64, parameters);

  Eigen::VectorXd q = humanoid.skeleton.neutral_pose();
  q[2] = 0.883;
  for (int lane = 0; lane < world.lanes(); ++lane) world.reset(lane, q, Eigen::VectorXd::Zero(humanoid.skeleton.nv()));

  Eigen::VectorXd target = q;
  target[humanoid.skeleton[humanoid.skeleton.find("left_elbow")].q_index] = 1.0;
  world.set_target(3, target);    // the others keep the pose they were put in
  world.push(5, 0, {200, 0, 0});  // N on the root's body, during the next call of step
  core::ThreadExecutor threads(2);
  world.step(16, threads);  // a thirtieth of a second
  const Eigen::VectorXd reached = world.pose(3);

  CHECK(reached[humanoid.skeleton[humanoid.skeleton.find("left_elbow")].q_index] > 0.1);
  CHECK(world.linear_momentum(5).x > 200 * 16 * world.dt() * 0.3);
  CHECK(std::abs(world.linear_momentum(4).x) < 1);

  sim::World<double> slope(humanoid, 1, {}, sim::Ground<double>::plane({-0.6, 0, 0.8}, 0));
  Eigen::MatrixXd heights = Eigen::MatrixXd::Zero(10, 10);
  heights(6, 5) = 0.3;
  sim::World<double> step(humanoid, 1, {}, terrain::HeightGrid(heights, 0.4));
  CHECK(step.ground().highest() == 0.3);
  CHECK(slope.ground().sample(core::Vector3<double>{0, 0, 1}).distance == doctest::Approx(0.8));

  std::vector<terrain::Box> boxes;
  for (int i = 0; i < 5; ++i) boxes.push_back({{1 + 0.3 * i, 0, 0.1 * (i + 1)}, {0.15, 1, 0.1 * (i + 1)}});
  sim::World<core::Pack<float>> stairs(humanoid, 64, parameters, sim::Scene{{}, terrain::BoxScene(boxes)});
  CHECK(stairs.lanes() == 64);

  sim::Extras extras;
  extras.objects.push_back({sim::ObjectShape::Kind::box, {0.2, 0.2, 0.4}, 15, {0.6, 0, 0.4}});
  extras.grips.push_back({humanoid.skeleton.find("right_elbow"), {0, 0, -0.26}, -1});
  extras.self_collisions.push_back({humanoid.skeleton.find("left_knee"), humanoid.skeleton.find("right_knee")});
  sim::World<core::Pack<float>> pushing(humanoid, 16, parameters, sim::Scene{}, extras);
  for (int lane = 0; lane < pushing.lanes(); ++lane) pushing.reset(lane, q, Eigen::VectorXd::Zero(humanoid.skeleton.nv()));
  pushing.refresh();
  pushing.hold(0, 0, 800);  // the hand holds on where it is, until 800 N
  pushing.step(16);
  pushing.object_impulse(0, 0);  // N s, from the character, in the last call of step
  pushing.grip_force(0, 0);      // N, on the character
  CHECK(pushing.holds(0, 0));
  CHECK_FALSE(pushing.holds(1, 0));

  std::vector<body::SegmentScale> scales(static_cast<std::size_t>(humanoid.skeleton.size()));
  scales[static_cast<std::size_t>(humanoid.skeleton.find("left_knee"))] = {1.2, 1.1, 1};
  pushing.set_body(2, body::with_proportions(humanoid, scales));
  pushing.set_gravity(3, 0.4 * 9.81);
  pushing.set_friction(4, 0.5);
  pushing.step(16);
  for (int lane = 0; lane < pushing.lanes(); ++lane) CHECK_FALSE(pushing.failed(lane));
}
