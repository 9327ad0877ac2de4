// SPDX-License-Identifier: MIT
#include <traceur/sim/model.hpp>

#include <string>

#include <doctest/doctest.h>

#include "support.hpp"

namespace {

using scene::Character;
using scene::JointType;
using scene::Vector;

/// Total mass, first moment and inertia about the world's origin, from the parts as the character lists them.
traceur::body::Inertia whole(const Character& c, const Eigen::VectorXd& q) {
  traceur::body::Frames<double> frames(c.skeleton);
  forward_kinematics(c.skeleton, q.data(), frames);
  traceur::body::Inertia sum;
  for (int i = 0; i < c.skeleton.size(); ++i) {
    const auto k = static_cast<std::size_t>(i);
    sum = combined(sum, transformed(c.inertias[k], frames.position[k], frames.rotation[k]));
  }
  return sum;
}

Character welded_chain() {
  Character c;
  c.name = "chain";
  const auto add = [&](const char* name, int parent, JointType type, const Vector& offset) {
    traceur::body::Joint j;
    j.name = j.body = name;
    j.parent = parent;
    j.type = type;
    j.offset = offset;
    if (parent >= 0) j.rest = about_axis(Vector{0.6, 0, 0.8}, 0.7);
    c.skeleton.add(j);
    c.inertias.push_back({1.0 + parent, {0.1, 0.2, 0.3}, {0.3, 0.4, 0.5, 0.01, 0.02, 0.03}});
    c.actuators.emplace_back();
    traceur::body::Shape s;
    s.name = name;
    s.body = c.skeleton.size() - 1;
    s.kind = traceur::body::Shape::Kind::capsule;
    s.position = {0.1, 0, 0};
    s.size = {0.05, 0.2, 0};
    c.shapes.push_back(s);
  };
  add("root", -1, JointType::free, {0, 0, 0});
  add("plate", 0, JointType::fixed, {0.1, 0, 0});
  add("arm", 1, JointType::ball, {0.5, 0, 0});
  add("grip", 2, JointType::fixed, {0, 0.4, 0});
  add("finger", 3, JointType::hinge, {0, 0, 0.2});
  c.inertias[0].mass = 2;
  return c;
}

}  // namespace

TEST_CASE("model: welded bodies are merged and nothing is lost") {
  for (const Character& c : {welded_chain(), scene::humanoid()}) {
    const traceur::sim::Model m = traceur::sim::make_model(c);
    CHECK(m.total_mass == doctest::Approx(c.total_mass()));
    CHECK(m.nq == c.skeleton.nq());
    CHECK(m.nv == c.skeleton.nv());
    traceur::core::RandomStream random(61);
    const Eigen::VectorXd q = scene::random_pose(c, random, 1);
    traceur::body::Frames<double> frames(c.skeleton);
    forward_kinematics(c.skeleton, q.data(), frames);
    traceur::body::Inertia sum;
    double mass = 0;
    for (const auto& b : m.bodies) {
      mass += b.mass;
      const auto k = static_cast<std::size_t>(b.joint);
      const Vector center = (1 / b.mass) * b.first_moment;
      traceur::body::Inertia own{b.mass, center, b.inertia};
      own.about_center -= traceur::core::Symmetric3<double>::scalar(b.mass * squared_norm(center));
      own.about_center += traceur::core::Symmetric3<double>::outer(b.mass, center);
      sum = combined(sum, transformed(own, frames.position[k], frames.rotation[k]));
    }
    CHECK(mass == doctest::Approx(m.total_mass));
    const traceur::body::Inertia expected = whole(c, q);
    CHECK(norm(sum.center - expected.center) < 1e-12);
    CHECK((sum.about_center.full().eigen() - expected.about_center.full().eigen()).norm() < 1e-10);
    // Every joint's frame as its moving body carries it.
    for (int i = 0; i < c.skeleton.size(); ++i) {
      const auto k = static_cast<std::size_t>(i);
      const auto& body = m.bodies[static_cast<std::size_t>(m.moving_of_joint[k])];
      CHECK(norm(frames.point(body.joint, m.welded_place[k]) - frames.position[k]) < 1e-12);
      const auto turn = frames.rotation[static_cast<std::size_t>(body.joint)] * m.welded_rotation[k];
      CHECK(std::abs(dot(turn, frames.rotation[k])) == doctest::Approx(1));
    }
  }
  const traceur::sim::Model m = traceur::sim::make_model(welded_chain());
  CHECK(m.bodies.size() == 3);
  CHECK(m.bodies[2].parent == 1);
  CHECK(m.bodies[1].parent == 0);
}

TEST_CASE("model: contact spheres lie in their shapes and within reach") {
  const Character& c = scene::humanoid();
  const traceur::sim::Model m = traceur::sim::make_model(c);
  CHECK(m.bodies.size() == 13);
  // Five spheres and two hands, ten capsules of two ends, two boxes of eight corners.
  CHECK(m.contacts.size() == 6 + 2 * 10 + 2 * 8);
  traceur::body::Frames<double> frames(c.skeleton);
  traceur::core::RandomStream random(62);
  const Eigen::VectorXd q = scene::random_pose(c, random, 1);
  forward_kinematics(c.skeleton, q.data(), frames);
  std::size_t counted = 0;
  for (std::size_t b = 0; b < m.bodies.size(); ++b) {
    for (int k = 0; k < m.bodies[b].contacts; ++k) {
      const auto& sphere = m.contacts[static_cast<std::size_t>(m.bodies[b].first_contact + k)];
      ++counted;
      CHECK(sphere.body == static_cast<int>(b));
      CHECK(norm(sphere.center) + sphere.radius <= m.bodies[b].reach);
      const auto& shape = c.shapes[static_cast<std::size_t>(sphere.shape)];
      const Vector world = frames.point(m.bodies[b].joint, sphere.center);
      const auto joint = static_cast<std::size_t>(shape.body);
      const Vector in_body = frames.rotation[joint].conjugate().rotate(world - frames.position[joint]);
      const Vector local = shape.rotation.conjugate().rotate(in_body - shape.position);
      if (shape.kind == traceur::body::Shape::Kind::box) {
        CHECK(std::abs(local.x) == doctest::Approx(shape.size.x));
        CHECK(std::abs(local.y) == doctest::Approx(shape.size.y));
        CHECK(std::abs(local.z) == doctest::Approx(shape.size.z));
        CHECK(sphere.radius == 0);
      } else {
        CHECK(std::hypot(local.x, local.y) < 1e-12);
        CHECK(sphere.radius == shape.size.x);
        if (shape.kind == traceur::body::Shape::Kind::capsule)
          CHECK(std::abs(local.z) == doctest::Approx(shape.size.y));
        else
          CHECK(std::abs(local.z) < 1e-12);
      }
    }
  }
  CHECK(counted == m.contacts.size());
}

TEST_CASE("model: what hangs on a fixed root has no moving parent") {
  Character c;
  traceur::body::Joint base, arm;
  base.name = base.body = "base";
  base.type = JointType::fixed;
  arm.name = arm.body = "arm";
  arm.parent = 0;
  c.skeleton.add(base);
  c.skeleton.add(arm);
  c.inertias = {{}, {1, {0, 0, 0.1}, {0.1, 0.1, 0.1, 0, 0, 0}}};
  c.actuators.resize(2);
  const traceur::sim::Model m = traceur::sim::make_model(c);
  REQUIRE(m.bodies.size() == 1);
  CHECK(m.bodies[0].parent == -1);
  CHECK(m.moving_of_joint[0] == -1);
}

TEST_CASE("model: a character that cannot be simulated is named") {
  Character c = welded_chain();
  c.inertias[4].mass = 0;
  std::string what;
  try {
    traceur::sim::make_model(c);
  } catch (const traceur::Error& e) {
    what = e.what();
  }
  CHECK(what.find("'chain'") != std::string::npos);
  CHECK(what.find("'finger'") != std::string::npos);
}
