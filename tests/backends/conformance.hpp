// SPDX-License-Identifier: MIT
// The laws that every engine behind the Simulator concept keeps, as templates over the engine.
#pragma once

#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <string>
#include <type_traits>
#include <utility>

#include <Eigen/Core>
#include <doctest/doctest.h>

// This folder has no unit that compiles a step for the others.
#define TRACEUR_TEST_OWN_STEPS
#include "../sim/support.hpp"
#include <traceur/sim/scene.hpp>
#include <traceur/sim/simulator.hpp>

namespace conformance {

using scene::Character;
using scene::Vector;
using traceur::sim::Parameters;
using traceur::sim::Scene;

/// How well an engine is to keep the laws.
struct Bounds {
  double read_back = 1e-9;       ///< largest difference between what was reset and what is read
  double carried = 1e-3;         ///< the same after a step of a microsecond through the engine's own coordinates
  double fall = 0.001;           ///< m, of the centre of mass after half a second of fall
  double momentum = 0.005;       ///< relative change of momenta in half a second of flight
  double weight = 0.05;          ///< relative, of the contact forces of a standing humanoid
  double creep = 0.002;          ///< m/s, of a standing foot
  double step_response = 0.02;   ///< rad, between the elbow's and the bundled simulator's in a step response
  double torque = 0.02;          ///< relative, of a motor at its limit
  double slope_creep = 0.002;    ///< m/s, of a box on a slope that should hold it
  double slide = 0.05;           ///< relative, of the distance slid down a slope that should not
  double grip = 0.005;           ///< m, between what a grip ties together, a body of 5 kg hanging
  double hanging = 0.005;        ///< m, the same of a humanoid that swings by one hand
  double push = 0.01;            ///< relative, of the speed a push gives
  double rest = 0.005;           ///< m, between where a dropped box comes to rest and where it should
};

template <class W>
W make(const Character& c, int lanes, const Parameters& p = {}, const Scene& s = {}) {
  if constexpr (std::is_constructible_v<W, const Character&, int, const Parameters&, const Scene&>)
    return W(c, lanes, p, s);
  else
    return W(c, lanes, p, s.ground.template cast<typename W::T>());
}

template <class W>
constexpr bool has_scenes = std::is_constructible_v<W, const Character&, int, const Parameters&, const Scene&>;

template <class W>
constexpr bool has_grips = requires(W w, Vector v) {
  w.hold(0, 0, v, v);
  w.release(0, 0);
  w.grip_force(0, 0);
};

template <class W>
Eigen::VectorXd pose(const W& w, int lane = 0) {
  Eigen::VectorXd q(w.character().skeleton.nq());
  w.pose(lane, q);
  return q;
}
template <class W>
Eigen::VectorXd velocity(const W& w, int lane = 0) {
  Eigen::VectorXd v(w.character().skeleton.nv());
  w.velocity(lane, v);
  return v;
}

/// Contact force on all bodies together, N.
template <class W>
Vector contact_force(const W& w, int lane = 0) {
  Vector sum{0, 0, 0};
  const auto& skeleton = w.character().skeleton;
  for (int j = 0; j < skeleton.size(); ++j) {
    // The body of a fixed joint is part of the one it is welded to.
    if (skeleton[j].type == scene::JointType::fixed) continue;
    if constexpr (requires { w.model().moving_of_joint; })
      sum += w.contact_force(lane, w.model().moving_of_joint[static_cast<std::size_t>(j)]).template cast<double>();
    else
      sum += w.contact_force(lane, j);
  }
  return sum;
}

inline traceur::body::Frames<double> frames(const Character& c, const Eigen::VectorXd& q) {
  traceur::body::Frames<double> f(c.skeleton);
  forward_kinematics(c.skeleton, q.data(), f);
  return f;
}

inline Eigen::VectorXd rest_velocity(const Character& c) { return Eigen::VectorXd::Zero(c.skeleton.nv()); }

/// A hinge on the world that turns a rod of 0.3 m about y, with a motor too strong for its torque limit of 5 N m.
inline Character rod() {
  Character c;
  c.name = "rod";
  traceur::body::Joint root;
  root.name = "root";
  root.body = "stand";
  root.type = scene::JointType::fixed;
  c.skeleton.add(root);
  traceur::body::Joint joint;
  joint.name = "joint";
  joint.body = "rod";
  joint.parent = 0;
  joint.type = scene::JointType::hinge;
  joint.offset = {0, 0, 2};
  joint.axis = {0, 1, 0};
  c.skeleton.add(joint);
  traceur::body::Shape shape;
  shape.kind = traceur::body::Shape::Kind::box;
  shape.name = "rod";
  shape.body = 1;
  shape.size = {0.03, 0.03, 0.15};
  shape.position = {0, 0, -0.15};
  c.shapes.push_back(shape);
  c.inertias.resize(2);
  c.inertias[1] = transformed(solid(shape, 1000), shape.position, shape.rotation);
  c.actuators.resize(2);
  c.actuators[1].stiffness = 1000;
  c.actuators[1].damping = 10;
  c.actuators[1].torque_limit = 5;
  c.actuators[1].armature = 0.02;
  return c;
}

template <class W>
void reads_back(const Bounds& bounds) {
  Character c = scene::humanoid();
  for (auto& a : c.actuators) a.stiffness = a.damping = 0;
  for (auto& a : c.actuators) a.limited = false;
  for (auto& a : c.actuators) a.cone = std::numeric_limits<double>::infinity();
  Parameters p;
  p.dt = 1e-6;
  W w = make<W>(c, 2, p);
  CHECK(w.lanes() == 2);
  CHECK(w.dt() == 1e-6);
  CHECK(w.character().skeleton.nq() == c.skeleton.nq());
  traceur::core::RandomStream random(3);
  double worst = 0, carried = 0;
  for (int trial = 0; trial < 10; ++trial) {
    Eigen::VectorXd q = scene::random_pose(c, random, 1.0);
    q.head(3) << random.normal(), random.normal(), 3 + random.uniform(0.0, 1.0);
    const Eigen::VectorXd v = scene::random_velocity(c, random, 3);
    w.reset(1, q, v);
    worst = std::max({worst, (pose(w, 1) - q).cwiseAbs().maxCoeff(), (velocity(w, 1) - v).cwiseAbs().maxCoeff()});
    w.step(1);
    CHECK_FALSE(w.failed(1));
    // A quaternion and its negative are the same rotation.
    Eigen::VectorXd after = pose(w, 1);
    for (const auto& j : c.skeleton.joints()) {
      const int at = j.type == scene::JointType::free ? j.q_index + 3 : j.q_index;
      if (position_size(j.type) >= 4 && after.segment(at, 4).dot(q.segment(at, 4)) < 0) after.segment(at, 4) *= -1;
    }
    carried = std::max({carried, (after - q).cwiseAbs().maxCoeff(), (velocity(w, 1) - v).cwiseAbs().maxCoeff()});
  }
  MESSAGE("read back within " << worst << ", after a microsecond within " << carried);
  CHECK(worst <= bounds.read_back);
  CHECK(carried <= bounds.carried);
}

template <class W>
void falls(const Bounds& bounds) {
  const Character& c = scene::humanoid();
  W w = make<W>(c, 1);
  traceur::core::RandomStream random(5);
  Eigen::VectorXd q = scene::random_target(c, random, 0.4);
  q[2] = 10;
  const Eigen::VectorXd v = scene::random_velocity(c, random, 1.5);
  const auto before = scene::momentum_of(c, q, v);
  w.reset(0, q, v);
  w.set_target(0, scene::random_target(c, random, 0.4));
  const int steps = 240;
  w.step(steps);
  const auto after = scene::momentum_of(c, pose(w), velocity(w));
  const double t = steps * w.dt(), g = w.parameters().gravity;
  const double mass = c.total_mass();
  const Vector velocity = (1 / mass) * before.linear;
  Vector exact = before.center_of_mass + t * velocity;
  exact.z -= 0.5 * g * t * t;
  // Velocity first, then position: half a step ahead of the parabola.
  Vector stepped = exact;
  stepped.z -= 0.5 * g * t * w.dt();
  const double off = std::min(norm(after.center_of_mass - exact), norm(after.center_of_mass - stepped));
  Vector p = before.linear;
  p.z -= mass * g * t;
  const double linear = norm(after.linear - p) / norm(p);
  const double angular = norm(after.angular - before.angular) / norm(before.angular);
  MESSAGE("fall off by " << 1000 * off << " mm, momenta by " << linear << " and " << angular);
  CHECK(off <= bounds.fall);
  CHECK(linear <= bounds.momentum);
  CHECK(angular <= bounds.momentum);
}

/// A humanoid put on ground of height `height` m stands there, its contact forces are its weight and its feet stay.
template <class W>
void stands(const Bounds& bounds, const Scene& place, double height) {
  const Character& c = scene::humanoid();
  W w = make<W>(c, 1, {}, place);
  Eigen::VectorXd q = scene::standing_pose();
  q[2] += height;
  w.reset(0, q, scene::at_rest());
  w.step(240);
  w.step(240);
  CHECK_FALSE(w.failed(0));
  CHECK(pose(w)[2] > height + 0.75);
  const double weight = c.total_mass() * w.parameters().gravity;
  const Vector force = contact_force(w);
  CHECK(std::abs(force.z / weight - 1) <= bounds.weight);
  CHECK(std::hypot(force.x, force.y) <= bounds.weight * weight);
  w.step(480);
  const auto before = frames(c, pose(w));
  w.step(480);
  const auto after = frames(c, pose(w));
  double creep = 0;
  for (const char* foot : {"left_foot", "right_foot"}) {
    const auto k = static_cast<std::size_t>(c.skeleton.find_body(foot));
    const Vector moved = after.position[k] - before.position[k];
    creep = std::max(creep, std::hypot(moved.x, moved.y));
  }
  MESSAGE("stands at " << pose(w)[2] - height << " m on " << force.z / weight << " of its weight, feet creep " << 1000 * creep << " mm/s");
  CHECK(pose(w)[2] > height + 0.75);
  CHECK(creep <= bounds.creep);
}

template <class W>
void follows_targets(const Bounds& bounds) {
  const Character& c = scene::humanoid();
  Parameters p;
  p.gravity = 0;
  W w = make<W>(c, 1, p);
  traceur::sim::World<double> reference(c, 1, p);
  Eigen::VectorXd q = scene::standing_pose();
  q[2] = 5;
  const int elbow = c.skeleton[c.skeleton.find("right_elbow")].q_index;
  Eigen::VectorXd target = q;
  target[elbow] = 1;
  const auto prepare = [&](auto& world) {
    world.reset(0, q, scene::at_rest());
    world.set_target(0, target);
  };
  prepare(w);
  prepare(reference);
  double worst = 0;
  for (int n = 0; n < 30; ++n) {
    w.step(16);
    reference.step(16);
    worst = std::max(worst, std::abs(pose(w)[elbow] - pose(reference)[elbow]));
  }
  MESSAGE("step response within " << worst << " rad of the bundled simulator's, ends at " << pose(w)[elbow]);
  CHECK(worst <= bounds.step_response);
  CHECK(std::abs(pose(w)[elbow] - 1) < 0.05);
}

template <class W>
void limits_torque(const Bounds& bounds) {
  const Character c = rod();
  Parameters p;
  p.gravity = 0;
  W w = make<W>(c, 1, p);
  const Eigen::VectorXd q = c.skeleton.neutral_pose();
  w.reset(0, q, rest_velocity(c));
  Eigen::VectorXd target = q;
  target[0] = 3;
  w.set_target(0, target);
  const int steps = 48;
  w.step(steps);
  const auto& in = c.inertias[1];
  const double inertia = in.about_center.yy + in.mass * squared_norm(in.center) + c.actuators[1].armature;
  const double speed = c.actuators[1].torque_limit * steps * w.dt() / inertia;
  MESSAGE("speed after a tenth of a second at the torque limit: " << velocity(w)[0] / speed << " of the closed form");
  CHECK(velocity(w)[0] == doctest::Approx(speed).epsilon(bounds.torque));
}

/// How far a flat box of 5 kg goes down a slope of `angle` rad in the second that follows the first half, m, and how fast
/// it was when that second began.
template <class W>
std::pair<double, double> descent(double friction, double angle) {
  const Character c = scene::box({0.2, 0.2, 0.05}, 5);
  const auto turn = about_axis(Vector{0, 1, 0}, angle);
  const Vector normal = turn.rotate(Vector{0, 0, 1});
  Scene slope;
  slope.ground = traceur::sim::Ground<double>::plane(normal, 0);
  Parameters p;
  p.friction = friction;
  W w = make<W>(c, 1, p, slope);
  Eigen::VectorXd q = c.skeleton.neutral_pose();
  (0.05 * normal).store(q.data());
  turn.store(q.data() + 3);
  w.reset(0, q, rest_velocity(c));
  w.step(240);
  const Eigen::VectorXd before = pose(w);
  const double speed = velocity(w).head(3).norm();
  w.step(480);
  CHECK_FALSE(w.failed(0));
  return {(pose(w) - before).head(3).norm(), speed};
}

template <class W>
void rubs(const Bounds& bounds) {
  const double friction = 0.8, critical = std::atan(friction);
  const double creep = descent<W>(friction, 0.9 * critical).first;
  CHECK(creep <= bounds.slope_creep);
  const double angle = 1.2 * critical;
  const double a = Parameters{}.gravity * (std::sin(angle) - friction * std::cos(angle));
  const auto [distance, speed] = descent<W>(friction, angle);
  // From rest half a second before.
  const double expected = 0.5 * a * (1.5 * 1.5 - 0.5 * 0.5);
  MESSAGE("creeps " << 1000 * creep << " mm/s below the friction angle, slides " << distance / expected << " of the closed form above it");
  CHECK(distance == doctest::Approx(expected).epsilon(bounds.slide));
  CHECK(speed == doctest::Approx(0.5 * a).epsilon(3 * bounds.slide));
}

/// Where a flat box comes to rest that is let fall 0.1 m onto whatever is below x, m.
template <class W>
Vector place_of_rest(const Scene& scene, double x, double below, const Vector& velocity = {0, 0, 0}) {
  const Character c = scene::box({0.2, 0.2, 0.05}, 5);
  Parameters p;
  p.friction = 0.5;
  W w = make<W>(c, 1, p, scene);
  Eigen::VectorXd q = c.skeleton.neutral_pose(), v = rest_velocity(c);
  q.head(3) << x, 0, below + (norm(velocity) > 0 ? 0.05 : 0.15);
  velocity.store(v.data());
  w.reset(0, q, v);
  w.step(3 * 480);
  CHECK_FALSE(w.failed(0));
  CHECK(conformance::velocity(w).norm() < 0.02);
  return Vector::from(pose(w).data());
}

template <class W>
void drops(const Bounds& bounds) {
  const auto near = [&](const Vector& found, const Vector& expected) { return norm(found - expected) <= bounds.rest; };
  CHECK(near(place_of_rest<W>({}, 0.3, 0), {0.3, 0, 0.05}));
  // Struck at 3 m/s it slides as far as Coulomb lets it.
  const double slid = place_of_rest<W>({}, 0, 0, {3, 0, 0}).x, expected = 9 / (2 * 0.5 * Parameters{}.gravity);
  MESSAGE("struck at 3 m/s slides " << slid / expected << " of the closed form");
  CHECK(slid == doctest::Approx(expected).epsilon(bounds.slide));
  if constexpr (has_scenes<W>) {
    Scene stair;
    stair.boxes = traceur::terrain::BoxScene({traceur::terrain::Box{{-1, 0, 0.15}, {1, 1, 0.15}}});
    const Vector stays = place_of_rest<W>(stair, -0.05, 0.3);
    MESSAGE("dropped with its middle 50 mm inside a stair's edge: rests " << 1000 * norm(stays - Vector{-0.05, 0, 0.35}) << " mm off");
    CHECK(near(stays, {-0.05, 0, 0.35}));
    const Vector tips = place_of_rest<W>(stair, 0.05, 0.3);
    MESSAGE("and 50 mm outside: comes to rest at " << tips.x << ", " << tips.z << " m");
    CHECK(tips.x > 0.1);
    CHECK(tips.z < 0.25);
  }
}

template <class W>
void holds_on(const Bounds& bounds) {
  if constexpr (!has_grips<W>) {
    MESSAGE("has no grips");
  } else {
    const Character c = scene::box({0.1, 0.1, 0.1}, 5);
    W w = make<W>(c, 1);
    Eigen::VectorXd q = c.skeleton.neutral_pose();
    q[2] = 2;
    const Vector point{0.1, 0, 0.1}, anchor{0.1, 0, 2.1};
    w.reset(0, q, rest_velocity(c));
    w.hold(0, 0, point, anchor);
    double worst = 0;
    for (int n = 0; n < 48; ++n) {
      w.step(10);
      worst = std::max(worst, norm(frames(c, pose(w)).point(0, point) - anchor));
    }
    CHECK(worst <= bounds.grip);
    // A pendulum's pull swings about its weight: averaged over many swings it is the weight.
    w.step(4800);
    const double weight = c.total_mass() * w.parameters().gravity;
    const Vector force = w.grip_force(0, 0);
    MESSAGE("grip holds within " << 1000 * worst << " mm with " << force.z / weight << " of the weight");
    CHECK(std::abs(force.z / weight - 1) <= bounds.weight);
    w.release(0, 0);
    w.step(96);
    CHECK(velocity(w)[2] < -1);

    const Character& h = scene::humanoid();
    W swing = make<W>(h, 1);
    q = scene::standing_pose();
    q[2] += 1;
    const int hand = h.skeleton.find_body("right_hand");
    const Vector place = frames(h, q).point(hand, {0, 0, 0});
    swing.reset(0, q, scene::at_rest());
    swing.hold(0, hand, {0, 0, 0}, place);
    worst = 0;
    for (int n = 0; n < 48; ++n) {
      swing.step(10);
      worst = std::max(worst, norm(frames(h, pose(swing)).point(hand, {0, 0, 0}) - place));
    }
    MESSAGE("a humanoid's hand within " << 1000 * worst << " mm");
    CHECK_FALSE(swing.failed(0));
    CHECK(worst <= bounds.hanging);
  }
}

template <class W>
void repeats() {
  const Character& c = scene::humanoid();
  traceur::core::RandomStream random(9);
  const Eigen::VectorXd target = scene::random_target(c, random, 0.5);
  const auto run = [&](W& w, int lane) {
    w.reset(lane, scene::standing_pose(), scene::at_rest());
    w.set_target(lane, target);
    w.step(120);
    w.step(120);
    return std::pair{pose(w, lane), velocity(w, lane)};
  };
  W first = make<W>(c, 1), second = make<W>(c, 1), crowd = make<W>(c, 3);
  const auto once = run(first, 0);
  CHECK(run(second, 0) == once);
  // Reset forgets what was before.
  CHECK(run(first, 0) == once);
  // Other lanes do not matter.
  Eigen::VectorXd q = scene::random_pose(c, random, 0.5);
  q[2] = 1;
  crowd.reset(0, q, scene::random_velocity(c, random, 2));
  crowd.reset(2, q, scene::at_rest());
  CHECK(run(crowd, 1) == once);
  CHECK(pose(crowd, 0) != pose(crowd, 2));
}

template <class W>
void is_pushed(const Bounds& bounds) {
  const Character c = scene::box({0.1, 0.1, 0.1}, 5);
  Parameters p;
  p.gravity = 0;
  W w = make<W>(c, 2, p);
  Eigen::VectorXd q = c.skeleton.neutral_pose();
  q[2] = 3;
  for (int lane : {0, 1}) w.reset(lane, q, rest_velocity(c));
  w.push(0, 0, {10, 0, 5});
  w.push(1, 0, {0, 0.1, 0}, {0.1, 0, 0});
  w.step(48);
  const double t = 48 * w.dt();
  const Eigen::VectorXd v = velocity(w);
  CHECK(v[0] == doctest::Approx(10 * t / 5).epsilon(bounds.push));
  CHECK(v[2] == doctest::Approx(5 * t / 5).epsilon(bounds.push));
  CHECK(v.tail(3).norm() < 1e-4);
  const double spin = 0.1 * 0.1 * t / c.inertias[0].about_center.zz;
  CHECK(velocity(w, 1)[5] == doctest::Approx(spin).epsilon(bounds.push));
  CHECK(velocity(w, 1)[1] == doctest::Approx(0.1 * t / 5).epsilon(bounds.push));
  // It lasts for one call.
  w.step(48);
  CHECK(velocity(w)[0] == doctest::Approx(v[0]).epsilon(1e-4));
}

template <class W>
void survives_numbers() {
  const Character& c = scene::humanoid();
  W w = make<W>(c, 2), alone = make<W>(c, 2);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const int what : {0, 1, 2}) {
    CAPTURE(what);
    for (W* each : {&w, &alone})
      for (int lane : {0, 1}) each->reset(lane, scene::standing_pose(), scene::at_rest());
    Eigen::VectorXd q = scene::standing_pose(), v = scene::at_rest(), target = q;
    if (what == 0) q[2] = nan;
    if (what == 1) v[10] = std::numeric_limits<double>::infinity();
    if (what == 2) target[9] = nan;
    w.reset(0, q, v);
    w.set_target(0, target);
    w.step(16);
    alone.step(16);
    CHECK(w.failed(0));
    CHECK_FALSE(w.failed(1));
    CHECK(pose(w, 0) == c.skeleton.neutral_pose());
    CHECK(velocity(w, 0).isZero());
    CHECK(pose(w, 1) == pose(alone, 1));
    w.reset(0, scene::standing_pose(), scene::at_rest());
    w.step(16);
    CHECK_FALSE(w.failed(0));
    CHECK(pose(w, 0) == pose(alone, 0));
  }
}

template <class W>
void refuses() {
  const Character& c = scene::humanoid();
  CHECK_THROWS_AS(make<W>(c, 0), traceur::Error);
  Parameters p;
  p.dt = 0;
  CHECK_THROWS_AS(make<W>(c, 1, p), traceur::Error);
  Character broken = c;
  broken.inertias.pop_back();
  CHECK_THROWS_AS(make<W>(broken, 1), traceur::Error);
}

/// All laws, one subcase each.
template <class W>
void conforms(const Bounds& bounds) {
  static_assert(traceur::sim::Simulator<W>);
  SUBCASE("what was reset is read back") { reads_back<W>(bounds); }
  SUBCASE("free flight") { falls<W>(bounds); }
  SUBCASE("standing on a plane") { stands<W>(bounds, {}, 0); }
  SUBCASE("standing on a terrain of columns") {
    Eigen::MatrixXd heights = Eigen::MatrixXd::Constant(6, 6, 0.2);
    heights(5, 0) = 1;
    heights(0, 5) = 0;
    Scene place;
    place.ground = traceur::sim::Ground<double>(traceur::terrain::HeightGrid(heights, 0.4, -1.13, -1.17));
    stands<W>(bounds, place, 0.2);
  }
  SUBCASE("standing on a box") {
    if constexpr (has_scenes<W>) {
      traceur::terrain::Box box;
      box.center = {0, 0, 0.15};
      box.half_size = {1, 1, 0.15};
      Scene place;
      place.boxes = traceur::terrain::BoxScene({box});
      stands<W>(bounds, place, 0.3);
    } else {
      MESSAGE("has no scenes");
    }
  }
  SUBCASE("a motor's step response") { follows_targets<W>(bounds); }
  SUBCASE("a motor's torque limit") { limits_torque<W>(bounds); }
  SUBCASE("friction on a slope") { rubs<W>(bounds); }
  SUBCASE("boxes let fall and struck") { drops<W>(bounds); }
  SUBCASE("grips") { holds_on<W>(bounds); }
  SUBCASE("same calls, same bits, lane by lane") { repeats<W>(); }
  SUBCASE("pushes") { is_pushed<W>(bounds); }
  SUBCASE("numbers that are not finite") { survives_numbers<W>(); }
  SUBCASE("bad arguments") { refuses<W>(); }
}

/// The norm of every motor's torque keeps within its limit.
template <class W>
void keeps_torque_norms() {
  const scene::Character& c = scene::humanoid();
  W w(c, 1);
  w.reset(0, scene::standing_pose(), scene::at_rest());
  traceur::core::RandomStream random(11);
  double most = 0;
  for (int n = 0; n < 20; ++n) {
    w.set_target(0, scene::random_target(c, random, 2.0));
    for (int k = 0; k < 16; ++k) {
      w.step(1);
      for (int j = 0; j < c.skeleton.size(); ++j)
        if (c.actuators[static_cast<std::size_t>(j)].stiffness > 0)
          most = std::max(most, norm(w.motor_torque(0, j)) / c.actuators[static_cast<std::size_t>(j)].torque_limit);
    }
  }
  CHECK_FALSE(w.failed(0));
  CHECK(most <= 1 + 2e-6);
  CHECK(most > 0.99);
}

/// Rest frames may be turned, and the root welded.
template <class W>
void takes_turned_frames() {
  using traceur::core::about_axis;
  scene::Character c = scene::humanoid();
  traceur::body::Skeleton turned;
  traceur::core::RandomStream random(12);
  traceur::body::Joint base;
  base.name = base.body = "base";
  base.type = scene::JointType::fixed;
  base.offset = {0.1, 0.2, 5};
  base.rest = scene::random_rotation(random);
  turned.add(base);
  for (traceur::body::Joint j : c.skeleton.joints()) {
    ++j.parent;
    if (j.type == scene::JointType::free) {
      j.type = scene::JointType::ball;
      j.offset = {0.3, 0, 0.1};
    }
    j.rest = scene::random_rotation(random);
    turned.add(j);
  }
  c.skeleton = turned;
  c.inertias.insert(c.inertias.begin(), traceur::body::Inertia{});
  c.actuators.insert(c.actuators.begin(), traceur::body::Actuator{});
  for (auto& s : c.shapes) ++s.body;
  for (auto& a : c.actuators) a = traceur::body::Actuator{};
  const Eigen::VectorXd q = scene::random_pose(c, random, 1.0), v = scene::random_velocity(c, random, 1.0);
  // Without motors a step agrees with the bundled simulator's to first order in its length.
  traceur::sim::Parameters p;
  p.dt = 1e-5;
  W w(c, 1, p);
  traceur::sim::World<double> reference(c, 1, p);
  w.reset(0, q, v);
  reference.reset(0, q, v);
  w.step(100);
  reference.step(100);
  CHECK((w.pose(0) - reference.pose(0)).cwiseAbs().maxCoeff() < 1e-5);
  const double change = (reference.velocity(0) - v).norm();
  CHECK(change > 0.05);
  CHECK((w.velocity(0) - reference.velocity(0)).norm() < 0.02 * change);
}

/// A capsule lies still across a seam of columns and on two bars.
template <class W>
void lets_a_capsule_lie() {
  scene::Character c = scene::box({0.1, 0.1, 0.1}, 4);
  c.shapes[0].kind = traceur::body::Shape::Kind::capsule;
  c.shapes[0].size = {0.05, 0.3, 0};
  c.shapes[0].rotation = about_axis(scene::Vector{0, 1, 0}, std::numbers::pi / 2);
  traceur::sim::Scene place;
  SUBCASE("columns") {
    Eigen::MatrixXd heights = Eigen::MatrixXd::Constant(4, 4, 0.5);
    heights(3, 3) = 0.2;
    place.ground = traceur::sim::Ground<double>(traceur::terrain::HeightGrid(heights, 0.4, -0.8, -0.7));
  }
  SUBCASE("bars above the ground") {
    traceur::terrain::Box left, right;
    left.half_size = right.half_size = {0.05, 0.4, 0.05};
    left.center = {-0.15, 0, 0.45};
    right.center = {0.15, 0, 0.45};
    place.boxes = traceur::terrain::BoxScene({left, right});
  }
  W w(c, 1, {}, place);
  Eigen::VectorXd q = c.skeleton.neutral_pose();
  q[2] = 0.55;
  w.reset(0, q, Eigen::VectorXd::Zero(6));
  w.step(480);
  CHECK_FALSE(w.failed(0));
  CHECK(w.pose(0)[2] == doctest::Approx(0.55).epsilon(0.01));
  CHECK(w.velocity(0).head(3).norm() < 0.01);
  CHECK(w.velocity(0).tail(3).norm() < 0.05);
  CHECK(w.contact_force(0, 0).z == doctest::Approx(4 * 9.81).epsilon(0.02));
}

/// A grip on a place at some distance closes the gap, and a reset lets go.
template <class W>
void draws_a_gap_together() {
  const scene::Character c = scene::box({0.1, 0.1, 0.1}, 5);
  W w(c, 1);
  Eigen::VectorXd q = c.skeleton.neutral_pose();
  q[2] = 2;
  w.reset(0, q, Eigen::VectorXd::Zero(6));
  const scene::Vector point{0, 0, 0.1}, anchor{0.02, 0.01, 2.11};
  w.hold(0, 0, point, anchor);
  w.step(480);
  CHECK(norm(frames(c, w.pose(0)).point(0, point) - anchor) < 1e-3);
  // A reset lets go.
  w.reset(0, q, Eigen::VectorXd::Zero(6));
  w.step(48);
  CHECK(w.velocity(0)[2] == doctest::Approx(-0.981));
  CHECK(norm(w.grip_force(0, 0)) == 0);
}

}  // namespace conformance
