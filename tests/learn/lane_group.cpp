// SPDX-License-Identifier: MIT
#include <traceur/learn/lane_group.hpp>

#include <cmath>
#include <memory>
#include <vector>

#include <doctest/doctest.h>

#include "tracking_support.hpp"

using namespace traceur;
using namespace traceur::learn;
using namespace learn_test;

namespace {

constexpr int width = core::lane_count<Lane>;

struct Bench {
  sim::Parameters parameters;
  sim::Ground<float> ground;
  LaneGroup<Lane> group{humanoid(), parameters, ground, {}, 3};
  Eigen::VectorXf q = humanoid().character.skeleton.neutral_pose().cast<float>(), v = Eigen::VectorXf::Zero(humanoid().nv);

  Bench() {
    q[2] = 3;
    for (int lane = 0; lane < width; ++lane) group.place(lane, q.data(), v.data());
  }
};

}  // namespace

TEST_CASE("lanes are put where they should be, and fall from there") {
  Bench b;
  b.q[0] = 7;
  b.group.place(2, b.q.data(), b.v.data());
  b.group.turn_targets(b.group.lanes.q(), [](int) { return Lane(0.0); });
  b.group.advance(1.0 / 30, 16);
  b.group.measure();
  CHECK(b.group.state.frames.position[0].x[2] == doctest::Approx(7).epsilon(1e-3));
  CHECK(std::abs(b.group.state.frames.position[0].x[1]) < 1e-3f);
  // A thirtieth of a second of free fall.
  CHECK(b.group.state.center_velocity.z[0] == doctest::Approx(-9.81 / 30).epsilon(1e-3));
  CHECK(b.group.greatest_force({0})[0] == 0);
}

TEST_CASE("targets are a pose turned by rotation vectors and angles") {
  Bench b;
  const auto& skeleton = humanoid().character.skeleton;
  core::RandomStream random(3);
  Eigen::VectorXd d = Eigen::VectorXd::Zero(humanoid().nv), expected(humanoid().nq);
  for (Eigen::Index i = 6; i < d.size(); ++i) d[i] = random.normal(0, 0.5);
  const Eigen::VectorXd from = b.q.cast<double>();
  body::displace(skeleton, from.data(), d.data(), expected.data());
  b.group.turn_targets(b.group.lanes.q(), [&](int i) { return Lane(d[i + 6]); });
  for (int i = 7; i < humanoid().nq; ++i) CHECK(b.group.lanes.target()[i][1] == doctest::Approx(expected[i]).epsilon(1e-5));
}

TEST_CASE("motors' power is torque times rate, the torque within its limit") {
  Bench b;
  const sim::MovingBody* hinge = nullptr;
  for (const sim::MovingBody& m : humanoid().bodies)
    if (m.type == body::JointType::hinge) hinge = &m;
  REQUIRE(hinge != nullptr);
  for (int i = 0; i < humanoid().nq; ++i) b.group.lanes.target()[i] = b.group.lanes.q()[i];
  CHECK(b.group.motor_power()[0] == 0);
  const float rate = 0.5f, angle = 0.1f;
  b.group.lanes.v()[hinge->v_index] = Lane(rate);
  b.group.lanes.target()[hinge->q_index] = b.group.lanes.q()[hinge->q_index] + Lane(angle);
  const double torque = hinge->actuator.stiffness * 0.1 - hinge->actuator.damping * 0.5;
  CHECK(b.group.motor_power()[0] == doctest::Approx(std::abs(torque) * 0.5).epsilon(1e-4));
  b.group.lanes.target()[hinge->q_index] = Lane(1000.0);
  CHECK(b.group.motor_power()[0] == doctest::Approx(hinge->actuator.torque_limit * 0.5).epsilon(1e-4));
}

TEST_CASE("engines are taken one a group, and given back") {
  Bench b;
  const auto puppeteer = std::make_shared<Puppeteer>([&](int lane, int, Eigen::VectorXf& q, Eigen::VectorXf& v) {
    q = b.q;
    v = b.v;
    q[1] = static_cast<float>(lane);
  });
  use_engines<Lane>("task", {&b.group}, {puppeteer});
  b.group.advance(1.0 / 30, 16);
  b.group.measure();
  CHECK(b.group.state.frames.position[0].y[3] == 3);
  use_engines<Lane>("task", {&b.group}, {});
  CHECK(b.group.engine == nullptr);
  CHECK_THROWS_WITH_AS(use_engines<Lane>("task", {&b.group, &b.group}, {puppeteer}), "task: expected an engine for each group of lanes",
                       Error);
}
