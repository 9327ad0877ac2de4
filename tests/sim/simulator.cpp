// SPDX-License-Identifier: MIT
#include <traceur/sim/simulator.hpp>

#include <cmath>

#include <doctest/doctest.h>

#include "support.hpp"
#include <traceur/sim/world.hpp>

namespace {

using traceur::body::Character;
using traceur::sim::Simulator;
using traceur::sim::World;

/// The least model: every lane is wherever it was told to be.
struct Puppets {
  Character made_of;
  Eigen::VectorXd at, speed;
  int lanes() const { return 1; }
  const Character& character() const { return made_of; }
  double dt() const { return 0.01; }
  void reset(int, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
    at = q;
    speed = v;
  }
  void set_target(int, const Eigen::VectorXd& q) { at = q; }
  void step(int) {}
  void pose(int, Eigen::VectorXd& out) const { out = at; }
  void velocity(int, Eigen::VectorXd& out) const { out = speed; }
  bool failed(int) const { return false; }
};

/// One that cannot tell that a lane has failed.
struct Careless : Puppets {
  bool failed(int) const = delete;
};

static_assert(Simulator<World<double>>);
static_assert(Simulator<World<float>>);
static_assert(Simulator<World<traceur::core::Pack<float>>>);
static_assert(Simulator<Puppets>);
static_assert(!Simulator<Careless>);
static_assert(!Simulator<Character>);

/// Where a simulator's lane is after `seconds`: what an algorithm against the concept looks like.
template <Simulator W>
Eigen::VectorXd after(W& world, const Eigen::VectorXd& q, const Eigen::VectorXd& v, double seconds) {
  world.reset(0, q, v);
  world.set_target(0, q);
  world.step(static_cast<int>(std::lround(seconds / world.dt())));
  Eigen::VectorXd out(q.size());
  world.pose(0, out);
  return out;
}

}  // namespace

TEST_CASE("an algorithm written against the concept runs on every model of it") {
  World<double> world(scene::humanoid(), 1);
  Puppets puppets;
  const Eigen::VectorXd q = scene::standing_pose();
  CHECK((after(world, q, scene::at_rest(), 0.5) - q).cwiseAbs().maxCoeff() < 0.05);
  CHECK(after(puppets, q, scene::at_rest(), 0.5) == q);
}

TEST_CASE("after a reset a lane is where it was put") {
  World<double> world(scene::humanoid(), 1);
  traceur::core::RandomStream random(51);
  const Eigen::VectorXd q = scene::random_pose(scene::humanoid(), random, 1);
  const Eigen::VectorXd v = scene::random_velocity(scene::humanoid(), random, 1);
  world.reset(0, q, v);
  CHECK(world.pose(0) == q);
  CHECK(world.velocity(0) == v);
}
