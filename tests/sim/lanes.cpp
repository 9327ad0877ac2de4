// SPDX-License-Identifier: MIT
// What lanes promise each other: independence to the bit, exact save and restore, no allocation, survival.
#include <traceur/sim/lanes.hpp>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <new>
#include <vector>

#include <doctest/doctest.h>

#include "support.hpp"

namespace {
std::atomic<long> allocations{0};

void* counted(std::size_t size, std::size_t alignment) {
  ++allocations;
  // aligned_alloc wants a whole number of alignments.
  void* p = std::aligned_alloc(alignment, (std::max<std::size_t>(size, 1) + alignment - 1) / alignment * alignment);
  if (!p) throw std::bad_alloc();
  return p;
}
}  // namespace

void* operator new(std::size_t size) { return counted(size, alignof(std::max_align_t)); }
void* operator new(std::size_t size, std::align_val_t alignment) {
  return counted(size, static_cast<std::size_t>(alignment));
}
void operator delete(void* p) noexcept { std::free(p); }
void operator delete(void* p, std::size_t) noexcept { std::free(p); }
void operator delete(void* p, std::align_val_t) noexcept { std::free(p); }
void operator delete(void* p, std::size_t, std::align_val_t) noexcept { std::free(p); }

namespace {

using scene::Character;
using scene::Vector;
using traceur::core::Pack;
using traceur::core::RandomStream;
using traceur::sim::World;
using Wide = Pack<float>;

template <class S>
std::vector<traceur::core::Element<S>> state_of(const World<S>& world, int lane) {
  std::vector<traceur::core::Element<S>> state(static_cast<std::size_t>(world.state_size()));
  world.save(lane, state.data());
  return state;
}

/// Lane `lane` falls onto the ground from a pose of its own and follows targets of its own, which are a function of
/// `who`.
template <class S>
void start(World<S>& world, int lane, std::uint64_t who) {
  RandomStream random(31, who);
  const Character& c = world.character();
  Eigen::VectorXd q = scene::random_pose(c, random, 0.7);
  q[2] = 0.9 + 0.3 * random.uniform();
  world.reset(lane, q, scene::random_velocity(c, random, 2));
}

template <class S>
void direct(World<S>& world, int lane, std::uint64_t who, int moment, double angle = 1.0) {
  RandomStream random(32, who, static_cast<std::uint64_t>(moment));
  world.set_target(lane, scene::random_target(world.character(), random, angle));
}

/// One second with new targets every tenth.
template <class S>
void run(World<S>& world, const std::vector<std::uint64_t>& who) {
  for (int moment = 0; moment < 10; ++moment) {
    for (int lane = 0; lane < world.lanes(); ++lane) direct(world, lane, who[static_cast<std::size_t>(lane)], moment);
    world.step(48);
  }
}

template <class S>
void check_independence() {
  const int n = traceur::core::lane_count<S>;
  World<S> together(scene::humanoid(), n), moved(scene::humanoid(), n);
  std::vector<std::uint64_t> who(static_cast<std::size_t>(n)), other(static_cast<std::size_t>(n));
  for (int l = 0; l < n; ++l) {
    const auto k = static_cast<std::size_t>(l);
    who[k] = static_cast<std::uint64_t>(l);
    // The first lane's motion in the last lane, among strangers that sit high above the ground.
    other[k] = l == n - 1 ? 0 : 100 + static_cast<std::uint64_t>(l);
    start(together, l, who[k]);
    start(moved, l, other[k]);
    if (l < n - 1) {
      Eigen::VectorXd q = moved.pose(l);
      q[2] += 50;
      moved.reset(l, q, moved.velocity(l));
    }
  }
  run(together, who);
  run(moved, other);
  CHECK(state_of(together, 0) == state_of(moved, n - 1));
}

/// Largest difference of any pose number from a double world, after 0.25 s.
template <class S>
double difference_from_double(bool standing) {
  const Character& c = scene::humanoid();
  World<double> reference(c, 1);
  World<S> world(c, 1);
  RandomStream random(33);
  Eigen::VectorXd q = scene::standing_pose(), v = scene::at_rest();
  if (!standing) {
    q = scene::random_pose(c, random, 0.6);
    q[2] = 5;
    v = scene::random_velocity(c, random, 5);
  }
  reference.reset(0, q, v);
  world.reset(0, q, v);
  reference.step(120);
  world.step(120);
  return (reference.pose(0) - world.pose(0)).cwiseAbs().maxCoeff();
}

}  // namespace

TEST_CASE("a lane's bits depend on neither its place nor its neighbours") {
  check_independence<Wide>();
  check_independence<Pack<float, 4>>();
}

TEST_CASE("a step allocates nothing") {
  World<Wide> packs(scene::humanoid(), 20);
  World<double> doubles(scene::humanoid(), 2);
  for (int l = 0; l < 20; ++l) start(packs, l, static_cast<std::uint64_t>(l));
  for (int l = 0; l < 2; ++l) start(doubles, l, static_cast<std::uint64_t>(l));
  const Eigen::VectorXd target = scene::standing_pose();
  std::vector<float> state(static_cast<std::size_t>(packs.state_size()));
  Eigen::VectorXd q(target.size());
  const long before = allocations;
  packs.set_target(0, target);
  packs.push(0, 3, {10, 0, 0});
  packs.step(480);
  packs.save(3, state.data());
  packs.restore(4, state.data());
  packs.pose(3, q);
  doubles.step(480);
  CHECK(allocations == before);
}

TEST_CASE("save and restore continue to the same bits, in contact and in any lane") {
  World<Wide> world(scene::humanoid(), Wide::width);
  for (int l = 0; l < Wide::width; ++l) start(world, l, static_cast<std::uint64_t>(l));
  world.step(400);
  const int from = 1, to = Wide::width - 1;
  direct(world, from, 7, 0);
  const auto middle = state_of(world, from);
  double touching = 0;
  for (std::size_t b = 0; b < world.model().bodies.size(); ++b)
    touching += norm(world.contact_force(from, static_cast<int>(b)));
  CHECK(touching > 10);
  world.step(100);
  const auto end = state_of(world, from);

  // Into a world that has seen nothing, and whose lanes are all in the air.
  World<Wide> fresh(scene::humanoid(), Wide::width);
  Eigen::VectorXd high = scene::standing_pose();
  high[2] = 30;
  for (int l = 0; l < Wide::width; ++l) fresh.reset(l, high, scene::at_rest());
  fresh.step(3);
  direct(fresh, to, 7, 0);
  fresh.restore(to, middle.data());
  fresh.step(100);
  CHECK(state_of(fresh, to) == end);
}

TEST_CASE("resetting one lane leaves the others and forgets its past") {
  const int n = Wide::width;
  World<Wide> world(scene::humanoid(), n), undisturbed(scene::humanoid(), n);
  for (int l = 0; l < n; ++l) {
    start(world, l, static_cast<std::uint64_t>(l));
    start(undisturbed, l, static_cast<std::uint64_t>(l));
  }
  world.step(300);
  undisturbed.step(300);
  start(world, 0, 55);
  world.step(200);
  undisturbed.step(200);
  for (int l = 1; l < n; ++l) CHECK(state_of(world, l) == state_of(undisturbed, l));
  World<Wide> fresh(scene::humanoid(), n);
  start(fresh, 0, 55);
  fresh.step(200);
  CHECK(state_of(world, 0) == state_of(fresh, 0));
}

TEST_CASE("a lane that is not finite fails alone") {
  const int n = Wide::width;
  World<Wide> world(scene::humanoid(), n), healthy(scene::humanoid(), n);
  for (int l = 0; l < n; ++l) {
    start(world, l, static_cast<std::uint64_t>(l));
    start(healthy, l, static_cast<std::uint64_t>(l));
  }
  world.step(200);
  healthy.step(200);
  const int sick = 2;
  Eigen::VectorXd q = world.pose(sick), v = world.velocity(sick);
  v[8] = std::numeric_limits<double>::quiet_NaN();
  world.reset(sick, q, v);
  CHECK(!world.failed(sick));
  world.step(48);
  healthy.step(48);
  CHECK(world.failed(sick));
  CHECK(world.pose(sick).allFinite());
  world.step(200);
  healthy.step(200);
  CHECK(world.failed(sick));
  CHECK(world.pose(sick).allFinite());
  for (int l = 0; l < n; ++l) {
    if (l == sick) continue;
    CHECK(!world.failed(l));
    CHECK(state_of(world, l) == state_of(healthy, l));
  }
  // The same by way of a target, and infinity as well as NaN; a reset makes the lane whole.
  start(world, sick, 9);
  CHECK(!world.failed(sick));
  Eigen::VectorXd target = q;
  target[10] = std::numeric_limits<double>::infinity();
  world.set_target(sick, target);
  world.step(1);
  CHECK(world.failed(sick));
  start(world, sick, 9);
  World<Wide> fresh(scene::humanoid(), n);
  start(fresh, sick, 9);
  world.step(48);
  fresh.step(48);
  CHECK(!world.failed(sick));
  CHECK(state_of(world, sick) == state_of(fresh, sick));
}

TEST_CASE("threads do not change a bit") {
  const int n = 4 * Wide::width + 1;
  World<Wide> alone(scene::humanoid(), n), shared(scene::humanoid(), n);
  for (int l = 0; l < n; ++l) {
    start(alone, l, static_cast<std::uint64_t>(l));
    start(shared, l, static_cast<std::uint64_t>(l));
  }
  traceur::core::ThreadExecutor threads(2);
  traceur::core::SerialExecutor serial;
  for (int k = 0; k < 5; ++k) {
    alone.step(48, serial);
    shared.step(48, threads);
  }
  for (int l = 0; l < n; ++l) CHECK(state_of(alone, l) == state_of(shared, l));
}

TEST_CASE("float stays close to double for a quarter of a second") {
  const double flight = difference_from_double<float>(false), stand = difference_from_double<float>(true);
  const double flight_pack = difference_from_double<Wide>(false), stand_pack = difference_from_double<Wide>(true);
  const double exact = difference_from_double<Pack<double, 4>>(false);
  MESSAGE("after 0.25 s from double: float " << flight << " (flight) " << stand << " (standing), pack " << flight_pack
                                             << " " << stand_pack << ", pack of double " << exact);
  CHECK(flight < 2e-5);
  CHECK(flight_pack < 2e-5);
  CHECK(stand < 2e-5);
  CHECK(stand_pack < 2e-5);
  CHECK(exact < 1e-9);
}

TEST_CASE("motors of packs never pass their torque limits") {
  const Character& c = scene::humanoid();
  World<Wide> world(c, Wide::width);
  for (int l = 0; l < world.lanes(); ++l) start(world, l, static_cast<std::uint64_t>(l));
  float worst = 0;
  for (int n = 0; n < 9600; ++n) {
    if (n % 48 == 0)
      for (int l = 0; l < world.lanes(); ++l) direct(world, l, static_cast<std::uint64_t>(l), n, 3.0);
    world.step(1);
    const auto& work = world.group_lanes(0).work();
    for (std::size_t b = 0; b < world.model().bodies.size(); ++b) {
      const auto limit = static_cast<float>(world.model().bodies[b].actuator.torque_limit);
      if (!std::isfinite(limit)) continue;
      const Wide size = norm(work.bodies[b].torque);
      for (int l = 0; l < Wide::width; ++l) worst = std::max(worst, size[l] / limit);
    }
  }
  MESSAGE("largest torque " << worst << " of the limit");
  CHECK(worst < 1.001f);
}

TEST_CASE("violent targets for 20 s leave every number finite") {
  World<Wide> world(scene::humanoid(), 64);
  for (int l = 0; l < 64; ++l) start(world, l, static_cast<std::uint64_t>(l));
  double fastest = 0, highest = 0, lowest = 1;
  for (int moment = 0; moment < 200; ++moment) {
    for (int l = 0; l < 64; ++l) direct(world, l, static_cast<std::uint64_t>(l), moment, 3.1);
    world.step(48);
    for (int l = 0; l < 64; ++l) {
      REQUIRE(!world.failed(l));
      const Eigen::VectorXd v = world.velocity(l);
      fastest = std::max(fastest, v.head(3).norm());
      highest = std::max(highest, static_cast<double>(world.center_of_mass(l).z));
      lowest = std::min(lowest, static_cast<double>(world.center_of_mass(l).z));
    }
  }
  MESSAGE("root at most " << fastest << " m/s, centre of mass between " << lowest << " and " << highest << " m");
  CHECK(fastest < 30);
  CHECK(highest < 5);
  CHECK(lowest > 0);
}

TEST_CASE("dropped in any pose the humanoid comes to rest on the ground") {
  const Character& c = scene::humanoid();
  const int n = 2 * Wide::width;
  World<Wide> world(c, n);
  std::vector<double> energy(static_cast<std::size_t>(n));
  const double weight = 9.81 * c.total_mass();
  for (int l = 0; l < n; ++l) {
    RandomStream random(41, static_cast<std::uint64_t>(l));
    Eigen::VectorXd q = scene::random_target(c, random, 0.5);
    world.reset(l, q, scene::at_rest());
    // The lowest contact hangs 0.2 to 2 m above the ground.
    traceur::body::Frames<double> frames(c.skeleton);
    forward_kinematics(c.skeleton, q.data(), frames);
    double lowest = 1e9;
    for (const auto& s : world.model().contacts) {
      const auto& body = world.model().bodies[static_cast<std::size_t>(s.body)];
      lowest = std::min(lowest, frames.point(body.joint, s.center).z - s.radius);
    }
    q[2] = -lowest + 0.2 + 1.8 * l / (n - 1);
    world.reset(l, q, scene::at_rest());
    energy[static_cast<std::size_t>(l)] = scene::momentum_of(c, q, scene::at_rest()).center_of_mass.z * weight;
  }
  double gained = -1e9;
  for (int k = 0; k < 120; ++k) {
    world.step(24);
    for (int l = 0; l < n; ++l) {
      const auto m = scene::momentum_of(c, world.pose(l), world.velocity(l));
      gained = std::max(gained, m.kinetic_energy + weight * m.center_of_mass.z - energy[static_cast<std::size_t>(l)]);
    }
  }
  MESSAGE("energy above that of the drop: " << gained << " J");
  CHECK(gained < 20);
  double deepest = 0, fastest = 0;
  for (int l = 0; l < n; ++l) {
    REQUIRE(!world.failed(l));
    fastest = std::max(fastest, world.velocity(l).cwiseAbs().maxCoeff());
    for (const auto& s : world.model().contacts) {
      const Vector at =
          world.body_position(l, s.body).template cast<double>() +
          Vector::from((world.body_rotation(l, s.body).eigen().template cast<double>() * s.center.eigen()).eval());
      deepest = std::max(deepest, s.radius - at.z);
    }
  }
  MESSAGE("after 6 s: fastest number of the velocities " << fastest << ", deepest contact " << deepest * 1e3 << " mm");
  CHECK(deepest < 5e-3);
  CHECK(fastest < 0.1);
}
