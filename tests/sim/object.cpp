// SPDX-License-Identifier: MIT
#include <traceur/sim/object.hpp>

#include <cmath>
#include <limits>

#include <doctest/doctest.h>

#include "support.hpp"
#include <traceur/core/error.hpp>

namespace {

using namespace traceur::sim;
using scene::Quaternion;
using scene::Vector;
using traceur::Error;
using Kind = ObjectShape::Kind;

Extras with(const ObjectShape& object) {
  Extras e;
  e.objects.push_back(object);
  return e;
}

/// A world of one lane whose character is out of the way, high up.
World<double> alone(const ObjectShape& object, const Parameters& p = {}, const Scene& scene = {}) {
  World<double> world(scene::humanoid(), 1, p, scene, with(object));
  Eigen::VectorXd q = scene::humanoid().skeleton.neutral_pose();
  q.head(3) << 0, 0, 1000;
  world.reset(0, q, scene::at_rest());
  return world;
}

Vector momentum(const World<double>& w) { return w.linear_momentum(0) + w.object_mass(0, 0) * w.object_velocity(0, 0); }

/// Of the object about its centre.
Vector spin(const World<double>& w, const Vector& inertia) {
  const auto r = w.object_rotation(0, 0).matrix();
  const Vector local = transpose_times(r, w.object_angular_velocity(0, 0));
  return r * Vector{inertia.x * local.x, inertia.y * local.y, inertia.z * local.z};
}

/// Of character and object together about the world's origin.
Vector angular_momentum(const World<double>& w, const Vector& inertia) {
  return w.angular_momentum(0) + cross(w.center_of_mass(0), w.linear_momentum(0)) + spin(w, inertia) +
         w.object_mass(0, 0) * cross(w.object_position(0, 0), w.object_velocity(0, 0));
}

}  // namespace

TEST_CASE("a mobility answers as Newton and Euler say") {
  traceur::core::RandomStream random(71);
  const double mass = 3;
  const Vector inertia{0.2, 0.3, 0.4}, arm{0.1, -0.2, 0.3}, force{1, 2, -3};
  BodyWork<double> k{};
  k.j = {inertia.x, inertia.y, inertia.z, 0, 0, 0};
  k.m = traceur::core::Symmetric3<double>::scalar(mass);
  k.h = traceur::core::Matrix3<double>::zero();
  const Mobility<double> m(k);
  const Vector moment = cross(arm, force);
  const auto a = m.answer(moment, force);
  CHECK(norm(a.linear - (1 / mass) * force) < 1e-14);
  CHECK(norm(a.angular - Vector{moment.x / inertia.x, moment.y / inertia.y, moment.z / inertia.z}) < 1e-14);
  CHECK(norm(m.at(arm) * force - (a.linear + cross(a.angular, arm))) < 1e-13);
}

TEST_CASE("a contact that gives way has the force that both equations of motion agree on") {
  // One contact between a fixed-velocity body and a point mass: f and the mass' new velocity, solved by hand.
  const double dt = 1.0 / 480, mass = 2, damping = 700, spring = 90, before = 0.3, body = -1.1;
  LinearContact<double> c{{0, 0, spring}, traceur::core::Symmetric3<double>::outer(damping, Vector{0, 0, 1})};
  const auto y = yielding(c, traceur::core::Symmetric3<double>::scalar(1 / mass), Vector{0, 0, before}, dt);
  const double f = y.force.z - y.resistance.zz * body;
  const double after = before - dt * f / mass;
  CHECK(f == doctest::Approx(spring - damping * (body - after)).epsilon(1e-12));
}

TEST_CASE("a free object falls on a parabola and keeps its spin") {
  World<double> world = alone({Kind::box, {0.3, 0.2, 0.1}, 4, {0, 0, 50}});
  world.set_object(0, 0, {0, 0, 50}, Quaternion::identity(), {1, 2, 3}, {0.1, 4, 0.2});
  const Vector inertia = ObjectShape{Kind::box, {0.3, 0.2, 0.1}, 4}.inertia();
  const Vector before = spin(world, inertia);
  world.step(480);
  const Vector p = world.object_position(0, 0);
  const double g = world.parameters().gravity, dt = world.dt();
  CHECK(p.x == doctest::Approx(1).epsilon(1e-12));
  CHECK(p.y == doctest::Approx(2).epsilon(1e-12));
  // Velocities first: half a step below the parabola.
  CHECK(p.z == doctest::Approx(53 - 0.5 * g * (1 + dt)).epsilon(1e-12));
  CHECK(norm(spin(world, inertia) - before) < 1e-12 * norm(before));
}

TEST_CASE("objects rest on ground and boxes without sinking or creeping") {
  for (const double mass : {2.0, 10.0, 50.0}) {
    for (const bool raised : {false, true}) {
      Scene scene;
      if (raised) scene.boxes = traceur::terrain::BoxScene({{{0, 0, 0.2}, {0.5, 0.5, 0.2}, Quaternion::identity()}});
      World<double> world = alone({Kind::box, {0.2, 0.15, 0.1}, mass, {0, 0, raised ? 0.5 : 0.1}}, {}, scene);
      world.step(480);
      const Vector at = world.object_position(0, 0);
      CHECK(at.z == doctest::Approx(raised ? 0.5 : 0.1).epsilon(0.01));
      CHECK((raised ? 0.5 : 0.1) - at.z < 0.005);
      world.step(4800);
      CHECK(norm(world.object_position(0, 0) - at) < 1e-3);
      CHECK(norm(world.object_angular_velocity(0, 0)) < 1e-6);
    }
  }
}

TEST_CASE("a pushed box slides as far as Coulomb says") {
  for (const double friction : {0.3, 0.8}) {
    Parameters p;
    p.friction = friction;
    World<double> world = alone({Kind::box, {0.3, 0.3, 0.05}, 8, {0, 0, 0.05}}, p);
    world.step(240);
    const Vector from = world.object_position(0, 0);
    world.set_object(0, 0, from, world.object_rotation(0, 0), {3, 0, 0});
    world.step(480 * 4);
    const double distance = world.object_position(0, 0).x - from.x, law = 9 / (2 * friction * p.gravity);
    MESSAGE("friction " << friction << ": slid " << distance << " m, Coulomb " << law);
    CHECK(distance == doctest::Approx(law).epsilon(0.03));
    CHECK(norm(world.object_velocity(0, 0)) < 1e-3);
  }
}

TEST_CASE("a ball rolls down without slipping") {
  const double angle = 0.2;
  Scene scene;
  scene.ground = Ground<double>::plane({std::sin(angle), 0, std::cos(angle)}, 0);
  const double radius = 0.15;
  World<double> world = alone({Kind::sphere, {radius, 0, 0}, 5, radius * Vector{std::sin(angle), 0, std::cos(angle)}}, {}, scene);
  world.step(480);
  const double law = 5.0 / 7 * world.parameters().gravity * std::sin(angle);
  CHECK(norm(world.object_velocity(0, 0)) == doctest::Approx(law).epsilon(0.02));
  CHECK(world.object_angular_velocity(0, 0).y == doctest::Approx(law / radius).epsilon(0.02));
}

TEST_CASE("what a character gains in momentum an object loses, however light or heavy") {
  for (const double mass : {0.5, 5.0, 200.0})
    for (const Kind kind : {Kind::box, Kind::sphere}) {
      const ObjectShape shape{kind, {0.15, 0.15, 0.15}, mass, {1, 0, 100}};
      World<double> world(scene::humanoid(), 1, {}, Scene{}, with(shape));
      world.set_gravity(0, 0);
      Eigen::VectorXd q = scene::humanoid().skeleton.neutral_pose();
      q.head(3) << 0, 0, 100;
      world.reset(0, q, scene::at_rest());
      world.set_object(0, 0, {0.8, 0.05, 100.2}, Quaternion::identity(), {-5, 0, 0});
      world.refresh();
      const Vector linear = momentum(world), angular = angular_momentum(world, shape.inertia());
      Vector impulse = Vector::zero();
      const double before = mass * 5;
      bool met = false;
      for (int tick = 0; tick < 60; ++tick) {
        const Vector had = world.object_velocity(0, 0);
        world.step(8);
        impulse += world.object_impulse(0, 0);
        CHECK(norm(mass * (world.object_velocity(0, 0) - had) - world.object_impulse(0, 0)) < 1e-9 * before);
        met = met || norm(world.object_impulse(0, 0)) > 0;
      }
      CHECK(met);
      CHECK(norm(impulse) > 0.5 * std::min(before, 5.0 * 20));
      CHECK(norm(momentum(world) - linear) < 1e-9 * before);
      CHECK(norm(angular_momentum(world, shape.inertia()) - angular) < 1e-3 * norm(angular));
      CHECK(norm(world.object_velocity(0, 0)) < 6);
      CHECK_FALSE(world.failed(0));
    }
}

TEST_CASE("a struck ball takes the momentum of an impact that does not bounce, and little more") {
  for (const double mass : {0.5, 5.0, 50.0}) {
    const ObjectShape ball{Kind::sphere, {0.15, 0, 0}, mass, {1, 0, 100}};
    scene::Character striker = scene::box({0.2, 0.2, 0.2}, 10);
    striker.shapes[0].kind = traceur::body::Shape::Kind::sphere;
    World<double> world(striker, 1, {}, Scene{}, with(ball));
    world.set_gravity(0, 0);
    Eigen::VectorXd q = world.character().skeleton.neutral_pose();
    q.head(3) << 0, 0, 100;
    world.reset(0, q, Eigen::VectorXd::Zero(6));
    world.set_object(0, 0, {0.36, 0, 100}, Quaternion::identity(), {-3, 0, 0});
    world.step(480);
    const double plastic = 3 * mass * 10 / (mass + 10);
    const double taken = world.linear_momentum(0).x;
    MESSAGE("ball of " << mass << " kg: passes on " << -taken / plastic << " of a plastic impact's momentum");
    CHECK(-taken / plastic > 0.95);
    CHECK(-taken / plastic < 1.1);
  }
}

TEST_CASE("a humanoid stands on a box that lies on the ground") {
  for (const double mass : {3.0, 30.0}) {
    World<double> world(scene::humanoid(), 1, {}, Scene{}, with({Kind::box, {0.5, 0.5, 0.15}, mass, {0, 0, 0.15}}));
    Eigen::VectorXd q = scene::standing_pose();
    q[2] += 0.3;
    world.reset(0, q, scene::at_rest());
    double lowest = 10;
    double force = 0;
    for (int tick = 0; tick < 120; ++tick) {
      world.step(8);
      lowest = std::min(lowest, world.pose(0)[2]);
      if (tick < 60) continue;
      for (std::size_t b = 0; b < world.model().bodies.size(); ++b) force += world.contact_force(0, static_cast<int>(b)).z / 60;
    }
    MESSAGE(mass << " kg: pelvis never below " << lowest << " m, box at " << world.object_position(0, 0).z);
    CHECK(lowest > 0.3 + 0.86);
    CHECK(std::abs(world.object_position(0, 0).z - 0.15) < 0.005);
    CHECK(force == doctest::Approx(world.model().total_mass * world.parameters().gravity).epsilon(0.02));
  }
}

TEST_CASE("an object's size and mass may differ between lanes") {
  using S = traceur::core::Pack<double, 4>;
  const ObjectShape first{Kind::box, {0.2, 0.2, 0.2}, 5, {0, 0, 0.3}}, second{Kind::box, {0.1, 0.3, 0.15}, 12, {0, 0, 0.3}};
  World<S> pack(scene::humanoid(), 2, {}, Scene{}, with(first));
  pack.set_object_shape(1, 0, second);
  World<double> one(scene::humanoid(), 1, {}, Scene{}, with(second));
  Eigen::VectorXd q = scene::humanoid().skeleton.neutral_pose();
  q[2] = 100;
  pack.reset(0, q, scene::at_rest());
  pack.reset(1, q, scene::at_rest());
  one.reset(0, q, scene::at_rest());
  pack.step(240);
  one.step(240);
  CHECK(norm(pack.object_position(1, 0) - one.object_position(0, 0)) < 1e-9);
  CHECK(pack.object_position(0, 0).z == doctest::Approx(0.2).epsilon(0.02));
  CHECK(pack.object_mass(1, 0) == 12);
}

TEST_CASE("bad objects are refused") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refused = [](const ObjectShape& o, const char* message) {
    CHECK_THROWS_WITH_AS(World<double>(scene::humanoid(), 1, {}, Scene{}, with(o)), message, Error);
  };
  refused({Kind::box, {0.1, 0, 0.1}, 1}, "simulator: object 0: expected a size above zero");
  refused({Kind::sphere, {nan, 0, 0}, 1}, "simulator: object 0: expected a size above zero");
  refused({Kind::box, {0.1, 0.1, 0.1}, 0}, "simulator: object 0: expected a mass above zero");
  refused({Kind::box, {0.1, 0.1, 0.1}, -3}, "simulator: object 0: expected a mass above zero");
  refused({Kind::box, {0.1, 0.1, 0.1}, 1, {0, nan, 0}}, "simulator: object 0: position is not finite");
  World<double> world = alone({Kind::box, {0.1, 0.1, 0.1}, 1});
  CHECK_THROWS_AS(world.set_object_shape(0, 0, {Kind::sphere, {0.1, 0, 0}, 1}), Error);
  CHECK_THROWS_AS(world.set_object(0, 1, {0, 0, 0}), Error);
}
