// SPDX-License-Identifier: MIT
// The laws of mechanics that a simulated character obeys, in double precision unless a case says otherwise.
#include <traceur/sim/world.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include "support.hpp"

namespace {

using scene::Character;
using scene::JointType;
using scene::Quaternion;
using scene::Vector;
using traceur::core::RandomStream;
using traceur::sim::Ground;
using traceur::sim::Parameters;
using traceur::sim::World;

constexpr double dt = 1.0 / 480;

Character ragdoll() {
  Character c = scene::humanoid();
  for (auto& a : c.actuators) a.stiffness = a.damping = 0;
  return c;
}

/// What went wrong in one second of flight from joint speeds up to 5 rad/s.
struct FlightErrors {
  double linear = 0;   ///< kg m/s
  double angular = 0;  ///< relative
  double path = 0;     ///< of the centre of mass, m
};

/// `most` rad is how far the targets of the motors go.
template <class S>
FlightErrors flight(const Character& c, double most) {
  RandomStream random(21);
  World<S> world(c, 1);
  Eigen::VectorXd q = scene::random_pose(c, random, 0.6);
  q[2] = 20;
  Eigen::VectorXd v = scene::random_velocity(c, random, 5);
  v.head(3) = Eigen::Vector3d(1, -2, 3);
  world.reset(0, q, v);
  const auto start = scene::momentum_of(c, q, v);
  FlightErrors e;
  for (int n = 1; n <= 480; ++n) {
    if (most > 0 && n % 48 == 1) world.set_target(0, scene::random_target(c, random, most));
    world.step(1);
    const auto now = scene::momentum_of(c, world.pose(0), world.velocity(0));
    const double t = n * dt;
    const Vector expected = start.linear - Vector{0, 0, start.mass * 9.81 * t};
    e.linear = std::max(e.linear, norm(now.linear - expected));
    e.angular = std::max(e.angular, norm(now.angular - start.angular) / norm(start.angular));
    // The parabola as steps of dt draw it: velocity first, then position.
    const Vector center = start.center_of_mass + t * start.velocity() - Vector{0, 0, 0.5 * 9.81 * t * (t + dt)};
    e.path = std::max(e.path, norm(now.center_of_mass - center));
  }
  MESSAGE("flight: linear momentum off by " << e.linear << " kg m/s, angular by " << e.angular << " of itself, path by "
                                            << e.path << " m");
  return e;
}

void check_flight(const Character& c, double most) {
  const FlightErrors e = flight<double>(c, most);
  CHECK(e.linear < 1e-10);
  CHECK(e.angular < 1e-10);
  CHECK(e.path < 1e-10);
  const FlightErrors single = flight<float>(c, most);
  // 45 kg fall at up to 13 m/s.
  CHECK(single.linear < 1e-3 * 45 * 13);
  CHECK(single.angular < 1e-3);
  CHECK(single.path < 1e-3);
}

/// The ragdoll with nothing in its joints that could take or give energy.
Character loose_ragdoll() {
  Character c = ragdoll();
  for (auto& a : c.actuators) {
    a.limited = false;
    a.cone = std::numeric_limits<double>::infinity();
    a.armature = 0;
  }
  return c;
}

struct Tumble {
  double energy = 0;        ///< J after over J before
  Eigen::VectorXd pose;
};

/// Weightless and limp for `seconds`. Loose limbs whirl at more than what joints are clamped to, so they are not clamped.
Tumble tumble(const Character& c, std::uint64_t seed, double seconds, double step) {
  Parameters p;
  p.gravity = 0;
  p.dt = step;
  p.joint_speed_limit = 1e6;
  RandomStream random(seed);
  World<double> world(c, 1, p);
  Eigen::VectorXd q = scene::random_pose(c, random, 0.5);
  q[2] = 20;
  const Eigen::VectorXd v = scene::random_velocity(c, random, 5);
  world.reset(0, q, v);
  const double before = scene::momentum_of(c, q, v).kinetic_energy;
  world.step(static_cast<int>(std::lround(seconds / step)));
  return {scene::momentum_of(c, world.pose(0), world.velocity(0)).kinetic_energy / before, world.pose(0)};
}

/// The box on a slope that rises along +x, at rest on its face.
World<double> box_on_slope(double angle, double friction) {
  const Vector half{0.2, 0.15, 0.1};
  const Vector normal{-std::sin(angle), 0, std::cos(angle)};
  Parameters p;
  p.friction = friction;
  World<double> world(scene::box(half, 10), 1, p, Ground<double>::plane(normal, 0));
  Eigen::VectorXd q = Eigen::VectorXd::Zero(7);
  const double sink = 10 * 9.81 * std::cos(angle) / (4 * p.contact_stiffness);
  ((half.z - sink) * normal).store(q.data());
  about_axis(Vector{0, 1, 0}, -angle).store(q.data() + 3);
  world.reset(0, q, Eigen::VectorXd::Zero(6));
  return world;
}

}  // namespace

TEST_CASE("flight conserves momenta, limp") { check_flight(ragdoll(), 0); }
TEST_CASE("flight conserves momenta, motors at work") { check_flight(scene::humanoid(), 1); }
TEST_CASE("flight conserves momenta, motors at their limits") { check_flight(scene::humanoid(), 2.5); }

TEST_CASE("flight: energy of a limp body in weightlessness") {
  const Character c = loose_ragdoll();
  for (std::uint64_t seed = 22; seed < 34; ++seed) {
    const double energy = tumble(c, seed, 1, dt).energy;
    MESSAGE("tumbling for 1 s: energy times " << energy);
    CHECK(energy == doctest::Approx(1).epsilon(0.01));
  }
}

TEST_CASE("errors fall with the first power of the time step") {
  const Character c = loose_ragdoll();
  const double seconds = 0.25;
  const Eigen::VectorXd exact = tumble(c, 22, seconds, 1.0 / 61440).pose;
  double last = 0;
  for (const int rate : {240, 480, 960, 1920, 3840}) {
    const double error = (tumble(c, 22, seconds, 1.0 / rate).pose - exact).tail(exact.size() - 3).norm();
    const double order = std::log2(last / error);
    MESSAGE("step 1/" << rate << " s: off by " << error << ", order " << order);
    if (last > 0) CHECK(order == doctest::Approx(1).epsilon(0.15));
    last = error;
  }
}

TEST_CASE("a push in flight changes momentum by its impulse") {
  const Character& c = scene::humanoid();
  RandomStream random(23);
  Eigen::VectorXd q = scene::random_pose(c, random, 0.5);
  q[2] = 20;
  const Eigen::VectorXd v = scene::random_velocity(c, random, 3);
  World<double> world(c, 2);
  world.reset(0, q, v);
  world.reset(1, q, v);
  const Vector force{300, -200, 150};
  const int hand = c.skeleton.find_body("left_hand");
  const Vector local{0.01, 0.02, -0.05};
  traceur::body::Frames<double> frames(c.skeleton);
  forward_kinematics(c.skeleton, q.data(), frames);
  const auto before = scene::momentum_of(c, q, v);
  world.push(0, hand, force, local);
  world.step(1);
  const auto pushed = scene::momentum_of(c, world.pose(0), world.velocity(0));
  const auto still = scene::momentum_of(c, world.pose(1), world.velocity(1));
  CHECK(norm(pushed.linear - still.linear - dt * force) < 1e-10);
  const Vector arm = frames.point(hand, local) - before.center_of_mass;
  CHECK(norm(pushed.angular - still.angular - dt * cross(arm, force)) < 1e-9);
  // It acts during one call of step only, and throughout that one.
  world.step(10);
  CHECK(norm(Vector(world.linear_momentum(0)) - Vector(world.linear_momentum(1)) - dt * force) < 1e-9);
  world.push(0, 0, force);
  world.step(10);
  CHECK(norm(Vector(world.linear_momentum(0)) - Vector(world.linear_momentum(1)) - (11 * dt) * force) < 1e-9);
}

TEST_CASE("a box holds below the friction angle") {
  for (const double friction : {0.3, 1.0}) {
    auto world = box_on_slope(0.95 * std::atan(friction), friction);
    const Eigen::VectorXd start = world.pose(0);
    double moved = 0;
    for (int n = 0; n < 480; ++n) {
      world.step(10);
      moved = std::max(moved, (world.pose(0).head(3) - start.head(3)).norm());
    }
    MESSAGE("friction " << friction << ": moved " << moved * 1e3 << " mm in 10 s");
    CHECK(moved < 1e-3);
  }
}

TEST_CASE("a box slides beyond the friction angle as Coulomb says") {
  for (const double friction : {0.3, 1.0}) {
    const double angle = 1.05 * std::atan(friction);
    auto world = box_on_slope(angle, friction);
    world.step(240);
    const Eigen::VectorXd v0 = world.velocity(0);
    world.step(960);
    const Eigen::VectorXd v1 = world.velocity(0);
    const double expected = 9.81 * (std::sin(angle) - friction * std::cos(angle));
    const double found = -(v1[0] - v0[0]) * std::cos(angle) / 2 - (v1[2] - v0[2]) * std::sin(angle) / 2;
    MESSAGE("friction " << friction << ": slides at " << found << " m/s^2, Coulomb " << expected);
    CHECK(found == doctest::Approx(expected).epsilon(0.03));
  }
}

TEST_CASE("the edge that a box tips over, and the toes that a heel rises over, stay where they are") {
  Parameters p;
  p.dt = 1.0 / 240;
  p.friction = 2;
  const Vector half{0.1, 0.15, 0.3};
  World<double> block(scene::box(half, 20), 1, p);
  const auto turned = [](double angle) { return about_axis(Vector{0, 1, 0}, angle); };
  const double angle = 0.3;
  Eigen::VectorXd q = Eigen::VectorXd::Zero(7), v = Eigen::VectorXd::Zero(6);
  const Vector center = turned(angle).rotate({-half.x, 0, half.z});
  (center - Vector{0, 0, 5e-4}).store(q.data());
  turned(angle).store(q.data() + 3);
  v[4] = 2;
  cross(Vector{0, v[4], 0}, center).store(v.data());
  block.reset(0, q, v);
  double edge = 0;
  for (int n = 0; n < 60; ++n) {
    block.step(1);
    const Eigen::VectorXd now = block.pose(0);
    const Vector corner = Vector::from(now.data()) + Quaternion::from(now.data() + 3).rotate({half.x, 0, -half.z});
    edge = std::max(edge, std::abs(corner.x));
  }
  const double turn = block.velocity(0)[4];
  MESSAGE("turning at " << turn << " rad/s, the edge has moved " << edge * 1e3 << " mm in 0.25 s");
  CHECK(turn > 3);
  CHECK(edge < 1e-4);

  // Of a step's way, half dt w^2 r sideways is what velocities at the end of steps leave out.
  World<double> man(scene::humanoid(), 1, p);
  Eigen::VectorXd target = scene::standing_pose();
  const auto& skeleton = scene::humanoid().skeleton;
  man.reset(0, target, scene::at_rest());
  man.step(240);
  for (const char* ankle : {"right_ankle", "left_ankle"}) {
    double* at = target.data() + skeleton[skeleton.find(ankle)].q_index;
    (Quaternion::from(at) * turned(0.7)).store(at);
  }
  man.set_target(0, target);
  const auto& model = man.model();
  const int foot = skeleton.find("right_ankle");
  const auto& moving = model.bodies[static_cast<std::size_t>(model.moving_of_joint[static_cast<std::size_t>(foot)])];
  const auto toes = [&] {
    traceur::body::Frames<double> frames(skeleton);
    const Eigen::VectorXd now = man.pose(0);
    forward_kinematics(skeleton, now.data(), frames);
    Vector lowest{0, 0, 1};
    for (int c = 0; c < moving.contacts; ++c) {
      const Vector at = frames.point(foot, model.contacts[static_cast<std::size_t>(moving.first_contact + c)].center);
      if (at.x > frames.position[static_cast<std::size_t>(foot)].x && at.z < lowest.z) lowest = at;
    }
    return lowest;
  };
  const Vector before = toes();
  double raised = 0, slid = 0;
  for (int n = 0; n < 36; ++n) {
    man.step(1);
    raised = std::max(raised, std::abs(man.velocity(0)[skeleton[foot].v_index + 1]));
    const Vector way = toes() - before;
    if (way.z < 5e-4) slid = std::max(slid, std::hypot(way.x, way.y));
  }
  MESSAGE("heels rising at " << raised << " rad/s, toes have slid " << slid * 1e3 << " mm in 0.15 s");
  CHECK(raised > 3);
  CHECK(slid < 1e-4);
}

TEST_CASE("a terrain of one height is level ground, and a step carries") {
  const Vector half{0.2, 0.15, 0.1};
  const Character c = scene::box(half, 10);
  Eigen::VectorXd q = Eigen::VectorXd::Zero(7);
  q[6] = 1;
  q[2] = 0.6;
  Eigen::VectorXd v = Eigen::VectorXd::Zero(6);
  v[4] = 2;
  World<double> level(c, 1), flat(c, 1, {}, traceur::terrain::HeightGrid::flat(0));
  level.reset(0, q, v);
  flat.reset(0, q, v);
  level.step(960);
  flat.step(960);
  CHECK((level.pose(0) - flat.pose(0)).cwiseAbs().maxCoeff() < 1e-12);

  Eigen::MatrixXd heights = Eigen::MatrixXd::Zero(5, 5);
  heights(2, 2) = 0.5;
  World<double> step(c, 1, {}, traceur::terrain::HeightGrid(heights, 1.0, -2.5, -2.5));
  q[2] = 1;
  step.reset(0, q, Eigen::VectorXd::Zero(6));
  step.step(1440);
  CHECK(step.pose(0)[2] == doctest::Approx(0.6).epsilon(0.002));
  CHECK(step.velocity(0).norm() < 1e-3);
}

TEST_CASE("the humanoid stands") {
  World<double> world(scene::humanoid(), 1);
  world.reset(0, scene::standing_pose(), scene::at_rest());
  world.step(960);
  const auto& model = world.model();
  const int feet[2] = {
      model.moving_of_joint[static_cast<std::size_t>(scene::humanoid().skeleton.find_body("left_foot"))],
      model.moving_of_joint[static_cast<std::size_t>(scene::humanoid().skeleton.find_body("right_foot"))]};
  Vector start[2] = {world.body_position(0, feet[0]), world.body_position(0, feet[1])};
  double drift = 0;
  for (int n = 0; n < 480; ++n) {
    world.step(10);
    for (int f = 0; f < 2; ++f) drift = std::max(drift, norm(world.body_position(0, feet[f]) - start[f]));
  }
  MESSAGE("feet drift " << drift * 1e3 << " mm in 10 s");
  CHECK(drift < 1e-3);
  CHECK(world.pose(0)[2] > 0.85);
  CHECK(world.velocity(0).cwiseAbs().maxCoeff() < 1e-2);
  Vector carried = Vector::zero();
  for (int b = 0; b < static_cast<int>(model.bodies.size()); ++b) carried += world.contact_force(0, b);
  CHECK(norm(carried - Vector{0, 0, 9.81 * model.total_mass}) < 0.01 * 9.81 * model.total_mass);
}

TEST_CASE("motors never pass their torque limits") {
  const Character& c = scene::humanoid();
  World<double> world(c, 1);
  Eigen::VectorXd q = scene::standing_pose();
  world.reset(0, q, scene::at_rest());
  RandomStream random(24);
  double worst = 0;
  int saturated = 0;
  for (int n = 0; n < 9600; ++n) {
    if (n % 24 == 0) world.set_target(0, scene::random_target(c, random, 3.0));
    world.step(1);
    for (std::size_t b = 0; b < world.model().bodies.size(); ++b) {
      const auto& actuator = world.model().bodies[b].actuator;
      if (!std::isfinite(actuator.torque_limit)) continue;
      const double share = norm(world.joint_torque(0, static_cast<int>(b))) / actuator.torque_limit;
      worst = std::max(worst, share);
      saturated += share > 0.99;
    }
  }
  MESSAGE("largest torque " << worst << " of the limit; saturated " << saturated << " of " << 9600 * 12);
  CHECK(worst < 1.001);
  CHECK(saturated > 1000);
  CHECK(!world.failed(0));
}

TEST_CASE("stops hold against the motors") {
  Parameters p;
  p.gravity = 0;
  const Character& c = scene::humanoid();
  World<double> world(c, 1, p);
  Eigen::VectorXd q = c.skeleton.neutral_pose();
  q[2] = 5;
  const auto at = [&](const char* joint) { return c.skeleton[c.skeleton.find(joint)].q_index; };
  world.reset(0, q, scene::at_rest());
  Eigen::VectorXd target = q;
  target[at("left_knee")] = -2;
  target[at("right_elbow")] = 5;
  about_axis(Vector{0, 1, 0}, 2.5).store(target.data() + at("abdomen"));
  world.set_target(0, target);
  world.step(960);
  const Eigen::VectorXd reached = world.pose(0);
  // At rest a stop yields by the motor's torque over its stiffness.
  const auto slack = [&](const char* joint) {
    return c.actuators[static_cast<std::size_t>(c.skeleton.find(joint))].torque_limit / p.stop_stiffness + 0.02;
  };
  CHECK(reached[at("left_knee")] > 0 - slack("left_knee"));
  CHECK(reached[at("left_knee")] < 0);
  CHECK(reached[at("right_elbow")] < 160 * std::numbers::pi / 180 + slack("right_elbow"));
  CHECK(reached[at("right_elbow")] > 2);
  const Vector abdomen = log_map(scene::Quaternion::from(reached.data() + at("abdomen")));
  CHECK(abdomen.y < 90 * std::numbers::pi / 180 + slack("abdomen"));
  CHECK(abdomen.y > 1.4);
  CHECK(world.velocity(0).tail(28).cwiseAbs().maxCoeff() < 0.5);
}

TEST_CASE("world: refuses what cannot be simulated") {
  const Character& c = scene::humanoid();
  CHECK_THROWS_AS(World<double>(c, 0), traceur::Error);
  Parameters p;
  p.dt = 0;
  CHECK_THROWS_AS(World<double>(c, 1, p), traceur::Error);
  Character broken = c;
  broken.inertias.pop_back();
  CHECK_THROWS_AS(World<double>(broken, 1), traceur::Error);
}
