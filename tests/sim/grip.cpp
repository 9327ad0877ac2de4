// SPDX-License-Identifier: MIT
#include <traceur/sim/grip.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include "support.hpp"
#include <traceur/sim/world.hpp>

namespace {

using scene::Character;
using scene::Quaternion;
using scene::Vector;
using traceur::Error;
using traceur::core::Pack;
using traceur::core::RandomStream;
using traceur::sim::Extras;
using traceur::sim::GripPoint;
using traceur::sim::Ground;
using traceur::sim::linearize_grip;
using traceur::sim::Parameters;
using traceur::sim::World;

constexpr int second = 480;

int hand_joint() { return scene::humanoid().skeleton.find_body("right_hand"); }

Extras one_grip() {
  Extras extras;
  extras.grips = {GripPoint{hand_joint(), {0, 0, 0}, -1}};
  return extras;
}

template <class S>
World<S> with_grip(int lanes) {
  return World<S>(scene::humanoid(), lanes, Parameters{}, Ground<traceur::core::Element<S>>{}, one_grip());
}

Vector hand_place(const Eigen::VectorXd& q) {
  traceur::body::Frames<double> frames(scene::humanoid().skeleton);
  forward_kinematics(scene::humanoid().skeleton, q.data(), frames);
  return frames.point(hand_joint(), {0, 0, 0});
}

Vector center_place(const Eigen::VectorXd& q) { return scene::momentum_of(scene::humanoid(), q, scene::at_rest()).center_of_mass; }

/// The right arm raised, the whole turned so that the centre of mass is straight below the right hand, 20 m up.
Eigen::VectorXd hanging_pose() {
  const auto& s = scene::humanoid().skeleton;
  Eigen::VectorXd q = s.neutral_pose();
  about_axis(Vector{0, 1, 0}, -2.6).store(q.data() + s[s.find("right_shoulder")].q_index);
  q[2] = 20;
  Vector down = center_place(q) - hand_place(q);
  down = (1 / norm(down)) * down;
  const Vector axis = cross(down, Vector{0, 0, -1});
  const Quaternion turn = about_axis((1 / norm(axis)) * axis, std::atan2(norm(axis), -down.z));
  (turn * Quaternion::from(q.data() + 3)).store(q.data() + 3);
  return q;
}

double weight() { return scene::humanoid().total_mass() * 9.81; }

template <class S>
void hang(World<S>& world, int lane, double breaking = std::numeric_limits<double>::infinity()) {
  world.reset(lane, hanging_pose(), scene::at_rest());
  world.refresh();
  world.hold(lane, 0, breaking);
}

template <class S>
std::vector<typename World<S>::T> saved(const World<S>& world, int lane) {
  std::vector<typename World<S>::T> out(static_cast<std::size_t>(world.state_size()));
  world.save(lane, out.data());
  return out;
}

}  // namespace

TEST_CASE("grip: a spring and a damper at the end of the step") {
  RandomStream random(601);
  Parameters p;
  p.grip_stiffness = 3e5;
  p.grip_damping = 1500;
  for (int trial = 0; trial < 200; ++trial) {
    const Vector stretch{0.01 * random.normal(), 0.01 * random.normal(), 0.01 * random.normal()};
    const Vector after{random.normal(), random.normal(), random.normal()};
    const auto c = linearize_grip(p, 1.0, stretch);
    // f = -k (x + dt u') - d u'
    const Vector expected = -(p.grip_stiffness * (stretch + p.dt * after)) - p.grip_damping * after;
    CHECK(norm(c.force - c.resistance * after - expected) < 1e-9 * norm(expected));
    const auto open = linearize_grip(p, 0.0, stretch);
    CHECK(norm(open.force - open.resistance * after) == 0);

    using P = Pack<double, 4>;
    P held(1.0);
    held.set(2, 0.0);
    const auto lanes = linearize_grip(p, held, stretch.cast<P>());
    for (int l = 0; l < 4; ++l) {
      CHECK(lanes.force.y[l] == (l == 2 ? 0.0 : doctest::Approx(c.force.y)));
      CHECK(lanes.resistance.zz[l] == (l == 2 ? 0.0 : doctest::Approx(c.resistance.zz)));
    }
  }
}

TEST_CASE("grip: a character hangs by its hand") {
  World<double> world = with_grip<double>(1);
  hang(world, 0);
  CHECK(world.holds(0, 0));
  const Vector anchor = hand_place(hanging_pose());
  double sum = 0, farthest = 0, imbalance = 0, momentum = 0;
  for (int n = 0; n < 2 * second; ++n) {
    world.step(1);
    const Vector force = world.grip_force(0, 0);
    if (n >= second) sum += force.z;
    farthest = std::max(farthest, norm(hand_place(world.pose(0)) - anchor));
    // Nothing else holds it up, so that the grip and gravity alone change its momentum.
    momentum += (force.z - weight()) / second;
    imbalance = std::max(imbalance, std::abs(world.linear_momentum(0).z - momentum));
  }
  MESSAGE("hanging by a hand: mean force " << sum / second << " N, weight " << weight() << " N; hand off by up to "
                                           << 1e3 * farthest << " mm");
  CHECK(world.holds(0, 0));
  CHECK_FALSE(world.failed(0));
  CHECK(sum / second == doctest::Approx(weight()).epsilon(0.02));
  CHECK(farthest < 5e-3);
  CHECK(imbalance < 1e-8);
}

TEST_CASE("grip: it swings like the body that hangs on it") {
  // One rigid body on a pivot is a physical pendulum.
  const Vector half{0.05, 0.05, 0.5};
  const double mass = 10, length = 0.5;
  Extras extras;
  extras.grips = {GripPoint{0, {0, 0, half.z}, -1}};
  World<double> world(scene::box(half, mass), 1, Parameters{}, Ground<double>{}, extras);
  Eigen::VectorXd q = Eigen::VectorXd::Zero(7);
  const double start = 0.05;
  const Quaternion turn = about_axis(Vector{0, 1, 0}, start);
  turn.store(q.data() + 3);
  q[2] = 10;
  world.reset(0, q, Eigen::VectorXd::Zero(6));
  world.refresh();
  const Vector anchor = Vector{0, 0, 10} + turn.rotate({0, 0, half.z});
  world.hold_at(0, 0, anchor);
  const double about_pivot = mass / 3 * (half.x * half.x + half.z * half.z) + mass * length * length;
  const double period = 2 * std::acos(-1.0) * std::sqrt(about_pivot / (mass * 9.81 * length));
  double last = start, crossed[2] = {0, 0}, farthest = 0;
  int crossings = 0;
  for (int n = 1; crossings < 2 && n < 4 * second; ++n) {
    world.step(1);
    const Eigen::VectorXd now = world.pose(0);
    const double angle = 2 * std::atan2(now[4], now[6]);
    if ((angle < 0) != (last < 0)) crossed[crossings++] = (n - 1 + last / (last - angle)) / second;
    last = angle;
    farthest = std::max(farthest, norm(Vector::from(now) + Quaternion::from(now.data() + 3).rotate({0, 0, half.z}) - anchor));
  }
  REQUIRE(crossings == 2);
  MESSAGE("swinging on a grip: period " << 2 * (crossed[1] - crossed[0]) << " s, a pendulum's " << period << " s");
  CHECK(2 * (crossed[1] - crossed[0]) == doctest::Approx(period).epsilon(0.01));
  CHECK(farthest < 1e-3);
}

TEST_CASE("grip: a force above the breaking force opens it, and the character falls") {
  for (const double share : {0.7, 1.5}) {
    World<double> world = with_grip<double>(1);
    hang(world, 0, share * weight());
    world.step(second);
    const double fallen = 20 + center_place(hanging_pose()).z - hanging_pose()[2] - world.center_of_mass(0).z;
    if (share < 1) {
      CHECK_FALSE(world.holds(0, 0));
      // It carried part of the weight for a few steps at the most.
      CHECK(fallen == doctest::Approx(0.5 * 9.81).epsilon(0.1));
      world.step(1);
      CHECK(norm(world.grip_force(0, 0)) == 0);
    } else {
      CHECK(world.holds(0, 0));
      CHECK(std::abs(fallen) < 0.1);
    }
  }
}

TEST_CASE("grip: released it lets go, held again it holds where it is then") {
  World<double> world = with_grip<double>(1);
  hang(world, 0);
  world.step(second / 2);
  world.release(0, 0);
  CHECK_FALSE(world.holds(0, 0));
  const double speed = world.linear_momentum(0).z / scene::humanoid().total_mass();
  world.step(second / 10);
  CHECK(norm(world.grip_force(0, 0)) == 0);
  CHECK(world.linear_momentum(0).z / scene::humanoid().total_mass() == doctest::Approx(speed - 0.981));
  world.hold(0, 0);
  const Vector anchor = hand_place(world.pose(0));
  double farthest = 0;
  for (int n = 0; n < second; ++n) {
    world.step(1);
    farthest = std::max(farthest, norm(hand_place(world.pose(0)) - anchor));
  }
  MESSAGE("caught again after a tenth of a second: hand off by up to " << 1e3 * farthest << " mm");
  CHECK(world.holds(0, 0));
  CHECK(farthest < 0.02);
  // A reset opens it.
  world.reset(0, hanging_pose(), scene::at_rest());
  CHECK_FALSE(world.holds(0, 0));
}

TEST_CASE_TEMPLATE("grip: lanes hold and let go by themselves", S, double, Pack<double, 4>) {
  World<S> world = with_grip<S>(3);
  World<S> held = with_grip<S>(1), open = with_grip<S>(1);
  hang(world, 0);
  hang(world, 1, 0.5 * weight());
  hang(world, 2);
  world.release(2, 0);
  hang(held, 0);
  open.reset(0, hanging_pose(), scene::at_rest());
  for (auto* w : {&world, &held, &open}) w->step(second / 2);
  CHECK(world.holds(0, 0));
  CHECK_FALSE(world.holds(1, 0));
  CHECK_FALSE(world.holds(2, 0));
  CHECK(world.pose(0)[2] > 19);
  CHECK((world.pose(0) - held.pose(0)).cwiseAbs().maxCoeff() < 1e-9);
  CHECK((world.pose(2) - open.pose(0)).cwiseAbs().maxCoeff() < 1e-9);
  CHECK(norm(world.grip_force(0, 0) - held.grip_force(0, 0)) < 1e-4);
  CHECK(norm(world.grip_force(2, 0)) == 0);
  // In free fall, as steps of dt draw it.
  const double t = 0.5, dt = 1.0 / second;
  CHECK(center_place(hanging_pose()).z - world.center_of_mass(2).z == doctest::Approx(0.5 * 9.81 * t * (t + dt)));
}

TEST_CASE_TEMPLATE("grip: a restored lane goes on to the same bits, wherever it is put", S, double, Pack<double, 4>,
                   Pack<float>) {
  World<S> world = with_grip<S>(2);
  hang(world, 0);
  hang(world, 1, 0.5 * weight());
  world.step(100);
  const auto half_way = saved(world, 0);
  world.step(200);
  const auto once = saved(world, 0);
  CHECK(world.holds(0, 0));
  // Lane 1 is open by now, and the state tells it to hold.
  CHECK_FALSE(world.holds(1, 0));
  world.restore(1, half_way.data());
  world.set_target(1, hanging_pose());
  CHECK(world.holds(1, 0));
  world.release(0, 0);
  world.step(200);
  CHECK(saved(world, 1) == once);
  // Into a world that never held.
  World<S> fresh = with_grip<S>(1);
  fresh.restore(0, half_way.data());
  fresh.set_target(0, hanging_pose());
  fresh.step(200);
  CHECK(saved(fresh, 0) == once);
}

TEST_CASE("grip: refuses what does not exist") {
  const auto message = [](auto&& f) -> std::string {
    try {
      f();
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  const auto world_with = [](const GripPoint& g) {
    Extras extras = one_grip();
    extras.grips.push_back(g);
    World<double> world(scene::humanoid(), 1, Parameters{}, Ground<double>{}, extras);
  };
  CHECK(message([&] { world_with({hand_joint(), {0, 0, 0}, -1}); }) == "");
  CHECK(message([&] { world_with({999, {0, 0, 0}, -1}); }) == "simulator: grip 1: names a joint that does not exist");
  CHECK(message([&] { world_with({-1, {0, 0, 0}, -1}); }) == "simulator: grip 1: names a joint that does not exist");
  CHECK(message([&] { world_with({hand_joint(), {0, 0, 0}, 0}); }) == "simulator: grip 1: names an object that does not exist");
  World<double> world = with_grip<double>(1);
  CHECK(message([&] { world.hold(0, 1); }) == "simulator: no grip 1");
  CHECK(message([&] { world.release(0, -1); }) == "simulator: no grip -1");
  CHECK(message([&] { world.hold(0, 0, 0.0); }) == "simulator: lane 0: grip: expected a breaking force above zero");
  CHECK_FALSE(world.holds(0, 0));
}
