// SPDX-License-Identifier: MIT
#include <traceur/sim/numbers.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include "support.hpp"
#include <traceur/sim/world.hpp>

namespace {

using scene::Character;
using scene::JointType;
using scene::Vector;
using traceur::Error;
using traceur::body::Shape;
using traceur::core::Pack;
using traceur::core::RandomStream;
using traceur::sim::check_same_build;
using traceur::sim::make_model;
using traceur::sim::Model;
using traceur::sim::Numbers;
using traceur::sim::World;

/// The humanoid with lengths, masses, gains and torque limits of its own; lengths within `spread` of one, the rest more.
Character another(std::uint64_t seed, double spread = 0.15) {
  RandomStream random(700 + seed);
  const Character& from = scene::humanoid();
  Character c = from;
  c.name = "humanoid " + std::to_string(seed);
  traceur::body::Skeleton skeleton;
  for (traceur::body::Joint j : from.skeleton.joints()) {
    j.offset = random.uniform(1 - spread, 1 + spread) * j.offset;
    skeleton.add(j);
  }
  c.skeleton = skeleton;
  for (auto& in : c.inertias) {
    const double scale = random.uniform(0.6, 1.6);
    in.mass *= scale;
    in.about_center = scale * in.about_center;
    in.center = random.uniform(0.9, 1.1) * in.center;
  }
  for (auto& a : c.actuators) {
    a.stiffness *= random.uniform(0.5, 1.5);
    a.damping *= random.uniform(0.5, 1.5);
    if (std::isfinite(a.torque_limit)) a.torque_limit *= random.uniform(0.3, 1.2);
  }
  for (auto& s : c.shapes) {
    s.size = random.uniform(0.8, 1.2) * s.size;
    s.position = random.uniform(0.9, 1.1) * s.position;
  }
  return c;
}

/// The humanoid with torque limits that its motors meet.
Character weak(std::uint64_t seed) {
  Character c = seed == 0 ? scene::humanoid() : another(seed);
  for (auto& a : c.actuators) a.torque_limit = 40 + 10 * static_cast<double>(seed);
  return c;
}

std::string refusal(const Character& a, const Character& b) {
  try {
    check_same_build(make_model(a), make_model(b));
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

/// A quarter of a second of landing on their feet and struggling, in one world and in one world each.
template <class S>
void check_lanes(double tolerance) {
  using T = traceur::core::Element<S>;
  constexpr int lanes = 6;
  World<S> packed(weak(0), lanes);
  std::vector<World<T>> single;
  for (int l = 0; l < lanes; ++l) {
    const Character c = weak(static_cast<std::uint64_t>(l));
    if (l > 0) packed.set_body(l, c);
    single.emplace_back(c, 1);
    RandomStream random(720 + static_cast<std::uint64_t>(l));
    Eigen::VectorXd q = scene::standing_pose();
    q[2] += 0.15;
    const Eigen::VectorXd v = scene::random_velocity(c, random, 0.5);
    packed.reset(l, q, v);
    single.back().reset(0, q, v);
    const Eigen::VectorXd target = scene::random_target(c, random, 0.3);
    packed.set_target(l, target);
    single.back().set_target(0, target);
  }
  bool touched = false;
  double worst = 0;
  for (int n = 0; n < 12; ++n) {
    packed.step(10);
    for (int l = 0; l < lanes; ++l) {
      World<T>& one = single[static_cast<std::size_t>(l)];
      one.step(10);
      worst = std::max({worst, static_cast<double>((packed.pose(l) - one.pose(0)).cwiseAbs().maxCoeff()),
                        0.01 * static_cast<double>((packed.velocity(l) - one.velocity(0)).cwiseAbs().maxCoeff()),
                        static_cast<double>(norm(packed.center_of_mass(l) - one.center_of_mass(0)))});
      for (std::size_t b = 0; b < one.model().bodies.size(); ++b) {
        touched = touched || one.contact_label(0, static_cast<int>(b));
        CHECK(std::abs(packed.kinetic_energy(l, static_cast<int>(b)) - one.kinetic_energy(0, static_cast<int>(b))) <
              100 * tolerance * (1 + one.kinetic_energy(0, static_cast<int>(b))));
      }
    }
  }
  MESSAGE("lanes with bodies of their own: off by up to " << worst << " from worlds of their own");
  CHECK(worst < tolerance);
  CHECK(touched);
  // The bodies do differ.
  CHECK((packed.pose(0) - packed.pose(1)).norm() > 0.01);
}

}  // namespace

TEST_CASE("numbers: each lane has those of its model, set one by one") {
  using P = Pack<double, 4>;
  std::vector<Model> models;
  for (std::uint64_t k = 0; k < 4; ++k) models.push_back(make_model(another(k)));
  Numbers<P> numbers(models[0]);
  for (int l = 3; l > 0; --l) numbers.set(l, models[static_cast<std::size_t>(l)]);
  for (int l = 0; l < 4; ++l) {
    const Model& m = models[static_cast<std::size_t>(l)];
    const Numbers<double> one(m);
    CHECK(numbers.total_mass[l] == doctest::Approx(another(static_cast<std::uint64_t>(l)).total_mass()));
    CHECK(numbers.total_mass[l] * numbers.inverse_mass[l] == doctest::Approx(1));
    REQUIRE(numbers.bodies.size() == m.bodies.size());
    for (std::size_t b = 0; b < m.bodies.size(); ++b) {
      const auto& x = numbers.bodies[b];
      const auto& y = m.bodies[b];
      const auto& z = one.bodies[b];
      CHECK(norm(Vector{x.offset.x[l], x.offset.y[l], x.offset.z[l]} - y.offset) == 0);
      CHECK(norm(Vector{x.first_moment.x[l], x.first_moment.y[l], x.first_moment.z[l]} - y.first_moment) == 0);
      const Vector probe{0.3, -1.1, 0.7};
      const auto turned = x.inertia * probe.cast<P>();
      CHECK(norm(Vector{turned.x[l], turned.y[l], turned.z[l]} - y.inertia * probe) < 1e-15);
      CHECK(norm(z.inertia * probe - y.inertia * probe) == 0);
      for (const auto& [found, expected, alone] :
           {std::array<double, 3>{x.mass[l], y.mass, z.mass}, {x.stiffness[l], y.actuator.stiffness, z.stiffness},
            {x.damping[l], y.actuator.damping, z.damping}, {x.torque_limit[l], y.actuator.torque_limit, z.torque_limit},
            {x.reach[l], y.reach, z.reach}}) {
        CHECK(found == expected);
        CHECK(alone == expected);
      }
    }
    REQUIRE(numbers.contacts.size() == m.contacts.size());
    for (std::size_t c = 0; c < m.contacts.size(); ++c) {
      CHECK(numbers.contacts[c].radius[l] == m.contacts[c].radius);
      CHECK(numbers.contacts[c].center.z[l] == m.contacts[c].center.z);
    }
    REQUIRE(numbers.features.size() == m.features.size());
    for (std::size_t f = 0; f < m.features.size(); ++f) {
      CHECK(numbers.features[f].radius[l] == m.features[f].radius);
      CHECK(numbers.features[f].center.x[l] == m.features[f].center.x);
      CHECK(numbers.features[f].half_axis.y[l] == m.features[f].half_axis.y);
    }
  }
}

TEST_CASE("numbers: lanes with bodies of their own move like worlds of their own") {
  check_lanes<Pack<double, 4>>(1e-8);
  check_lanes<Pack<float, 4>>(1e-3);
  check_lanes<double>(1e-12);
}

TEST_CASE("numbers: the momenta of each lane are those of its own body") {
  World<Pack<double, 4>> world(scene::humanoid(), 3);
  for (int l = 1; l < 3; ++l) world.set_body(l, another(static_cast<std::uint64_t>(l)));
  for (int l = 0; l < 3; ++l) {
    const Character c = l == 0 ? scene::humanoid() : another(static_cast<std::uint64_t>(l));
    RandomStream random(730);
    Eigen::VectorXd q = scene::random_pose(c, random, 0.6);
    q[2] = 20;
    const Eigen::VectorXd v = scene::random_velocity(c, random, 3);
    world.reset(l, q, v);
    world.refresh();
    const auto start = scene::momentum_of(c, q, v);
    CHECK(norm(world.linear_momentum(l) - start.linear) < 1e-9);
    CHECK(norm(world.angular_momentum(l) - start.angular) < 1e-9);
    CHECK(norm(world.center_of_mass(l) - start.center_of_mass) < 1e-9);
    CHECK(start.mass == doctest::Approx(c.total_mass()));
  }
  std::vector<Vector> before;
  for (int l = 0; l < 3; ++l) before.push_back(world.linear_momentum(l));
  world.step(240);
  for (int l = 0; l < 3; ++l) {
    const Character c = l == 0 ? scene::humanoid() : another(static_cast<std::uint64_t>(l));
    const auto end = scene::momentum_of(c, world.pose(l), world.velocity(l));
    CHECK(norm(end.linear - before[static_cast<std::size_t>(l)] + Vector{0, 0, 0.5 * 9.81 * c.total_mass()}) < 1e-8);
  }
}

TEST_CASE("numbers: a body stays with its lane through resets, and can be given back") {
  World<double> world(scene::humanoid(), 2), plain(scene::humanoid(), 1);
  world.set_body(1, another(1));
  for (int round = 0; round < 2; ++round) {
    for (int l = 0; l < 2; ++l) world.reset(l, scene::standing_pose(), scene::at_rest());
    plain.reset(0, scene::standing_pose(), scene::at_rest());
    world.step(100);
    plain.step(100);
    CHECK(world.pose(0) == plain.pose(0));
    CHECK((world.pose(1) == plain.pose(0)) == (round == 1));
    world.set_body(1, scene::humanoid());
  }
}

TEST_CASE("numbers: bodies built alike are accepted, others refused with the part that differs") {
  const Character& c = scene::humanoid();
  const auto joint = [&](const char* name) { return static_cast<std::size_t>(c.skeleton.find(name)); };
  CHECK(refusal(c, c) == "");
  CHECK(refusal(c, another(1)) == "");
  CHECK(refusal(another(1), another(2)) == "");

  const std::string where = "character 'other': ";
  const std::string whole = where + "expected the bodies, joints and shapes of '" + c.name + "'";
  const auto changed = [&](auto&& change) {
    Character other = c;
    other.name = "other";
    change(other);
    return refusal(c, other);
  };
  const auto with_joint = [](Character& other, std::size_t index, auto&& change) {
    traceur::body::Skeleton skeleton;
    std::size_t i = 0;
    for (traceur::body::Joint j : other.skeleton.joints()) {
      if (i++ == index) change(j);
      skeleton.add(j);
    }
    other.skeleton = skeleton;
  };
  CHECK(changed([](Character&) {}) == "");
  CHECK(changed([](Character& o) { o.shapes.pop_back(); }) == whole);
  CHECK(changed([](Character& o) { o.shapes.push_back(o.shapes[0]); }) == whole);
  CHECK(changed([&](Character& o) {
          with_joint(o, joint("left_knee"), [](traceur::body::Joint& j) { j.type = JointType::fixed; });
        }) == whole);
  CHECK(refusal(c, scene::box({1, 1, 1}, 1)) == "character 'box': expected the bodies, joints and shapes of '" + c.name + "'");

  const std::string shin = where + "body 'left_shin': ", torso = where + "body 'torso': ";
  // As many shapes, one of them on another body: the first body that lacks it is named.
  CHECK(changed([&](Character& o) {
          for (Shape& s : o.shapes)
            if (s.body == static_cast<int>(joint("left_knee"))) s.body = static_cast<int>(joint("left_hip"));
        }) == where + "body 'left_thigh': expected the joint and the shapes it has in '" + c.name + "'");
  const std::string turned = "its rest rotation and axis cannot differ between lanes";
  CHECK(changed([&](Character& o) {
          with_joint(o, joint("left_knee"), [](traceur::body::Joint& j) { j.axis = {0, -1, 0}; });
        }) == shin + turned);
  CHECK(changed([&](Character& o) {
          with_joint(o, joint("abdomen"), [](traceur::body::Joint& j) { j.rest = about_axis(Vector{1, 0, 0}, 0.01) * j.rest; });
        }) == torso + turned);
  // The other sign is the same rotation.
  CHECK(changed([&](Character& o) {
          with_joint(o, joint("abdomen"), [](traceur::body::Joint& j) { j.rest = -j.rest; });
        }) == "");
  const std::string stops = "its stops, its armature and whether its torque is limited cannot differ between lanes";
  const std::size_t knee = joint("left_knee"), abdomen = joint("abdomen");
  CHECK(changed([&](Character& o) { o.actuators[knee].armature *= 2; }) == shin + stops);
  CHECK(changed([&](Character& o) { o.actuators[knee].upper.x += 0.1; }) == shin + stops);
  CHECK(changed([&](Character& o) { o.actuators[knee].lower.x -= 0.1; }) == shin + stops);
  CHECK(changed([&](Character& o) { o.actuators[knee].limited = false; }) == shin + stops);
  CHECK(changed([&](Character& o) {
          double& limit = o.actuators[knee].torque_limit;
          limit = std::isfinite(limit) ? std::numeric_limits<double>::infinity() : 100;
        }) == shin + stops);
  REQUIRE(std::isfinite(c.actuators[abdomen].cone));
  CHECK(changed([&](Character& o) { o.actuators[abdomen].cone *= 0.9; }) == torso + stops);
  CHECK(changed([&](Character& o) { o.actuators[abdomen].cone = std::numeric_limits<double>::infinity(); }) == torso + stops);

  World<double> world(c, 2);
  Character other = c;
  other.shapes.pop_back();
  CHECK_THROWS_AS(world.set_body(1, other), Error);
}

TEST_CASE("a lane's larger body meets boxes that the others' cannot reach") {
  traceur::sim::Scene scene;
  scene.boxes = traceur::terrain::BoxScene({{{0, 0, 5}, {2, 2, 0.5}, scene::Quaternion::identity()}});
  World<double> world(scene::box({0.1, 0.1, 0.1}, 5), 1, {}, scene);
  world.set_body(0, scene::box({1, 1, 1}, 50));
  Eigen::VectorXd q = world.character().skeleton.neutral_pose();
  q[2] = 6.6;
  world.reset(0, q, Eigen::VectorXd::Zero(6));
  for (int n = 0; n < 100; ++n) world.step(10);
  CHECK(world.pose(0)[2] == doctest::Approx(6.5).epsilon(0.002));
}

TEST_CASE("a body with the same number of shapes in another order is refused") {
  using traceur::body::Shape;
  Character first = scene::box({0.2, 0.2, 0.2}, 5);
  Shape capsule, sphere;
  capsule.kind = Shape::Kind::capsule;
  capsule.name = "rod";
  capsule.size = {0.05, 0.2, 0};
  sphere.kind = Shape::Kind::sphere;
  sphere.name = "knob";
  sphere.size = {0.05, 0, 0};
  first.shapes = {capsule, sphere};
  Character second = first;
  second.shapes = {sphere, capsule};
  World<double> world(first, 1);
  CHECK_THROWS_AS(world.set_body(0, second), Error);
  world.set_body(0, first);
}
