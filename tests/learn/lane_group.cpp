// SPDX-License-Identifier: MIT
#include <traceur/learn/lane_group.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <set>
#include <string>
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

struct Seat {
  int left = 0, begun = 0;
};

/// Three groups, each of whose lanes shows one number.
struct Hall {
  sim::Parameters parameters;
  sim::Ground<float> ground;
  LaneGroups<SeatedGroup<Lane, Seat>> groups{"task", 3 * width, humanoid(), parameters, ground, sim::Extras(), Eigen::Index{1}};
};

/// Steps that environments have left after a reset that gave each of them `steps`.
std::vector<int> ages(Hall& h, std::uint64_t seed, std::int64_t from, bool spread, int steps) {
  h.groups.reset(seed, from, spread, [&](Eigen::Index e) { h.groups.seat(e).left = steps; });
  std::vector<int> out;
  for (Eigen::Index e = 0; e < h.groups.environments(); ++e) out.push_back(h.groups.seat(e).left);
  return out;
}

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

TEST_CASE("a batch's actions turn targets by their size within the limit, times the scale, each lane by its own column") {
  Bench one, other;
  core::RandomStream random(4);
  const Eigen::Index numbers = humanoid().nv - 6;
  constexpr double scale = 0.25, limit = 1.5;
  Eigen::MatrixXf actions(numbers, 2 * width);
  for (float& a : actions.reshaped()) a = random.normal<float>(0.0f, 2.0f);
  const auto [least, most] = std::minmax_element(actions.data() + width * numbers, actions.data() + 2 * width * numbers);
  REQUIRE(*most > limit);
  REQUIRE(*least < -limit);
  one.group.turn_targets(one.group.lanes.q(), actions, width, scale, limit);
  other.group.turn_targets(other.group.lanes.q(), [&](int i) {
    Lane a(0.0);
    for (int lane = 0; lane < width; ++lane) core::set_lane(a, lane, 0.25f * std::min(1.5f, std::max(-1.5f, actions(i, width + lane))));
    return a;
  });
  for (int i = 7; i < humanoid().nq; ++i)
    for (int lane = 0; lane < width; ++lane)
      CHECK(core::lane_of(one.group.lanes.target()[i], lane) == core::lane_of(other.group.lanes.target()[i], lane));
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

TEST_CASE("every environment has a lane and a seat of its own") {
  Hall h;
  CHECK(h.groups.size() == 3);
  REQUIRE(h.groups.environments() == 3 * width);
  std::set<const Seat*> seats;
  for (Eigen::Index e = 0; e < h.groups.environments(); ++e) {
    const int g = static_cast<int>(e) / width, lane = static_cast<int>(e) - g * width;
    CHECK(&h.groups.of(e) == &h.groups[g]);
    CHECK(h.groups.lane(e) == lane);
    CHECK(h.groups.first(g) + lane == e);
    CHECK(&h.groups.seat(e) == &h.groups[g].seats[static_cast<std::size_t>(lane)]);
    seats.insert(&h.groups.seat(e));
    h.groups[g].seen(0, lane) = static_cast<float>(e);
  }
  CHECK(seats.size() == static_cast<std::size_t>(3 * width));
  Eigen::MatrixXf seen(1, 3 * width);
  h.groups.observe(seen);
  for (Eigen::Index e = 0; e < h.groups.environments(); ++e) CHECK(seen(0, e) == static_cast<float>(e));
}

TEST_CASE("only whole groups are made") {
  const sim::Parameters parameters;
  const sim::Ground<float> ground;
  for (const Eigen::Index count : {Eigen::Index{-width}, Eigen::Index{0}, Eigen::Index{width + 1}}) {
    const std::string said = "task: expected a positive multiple of " + std::to_string(width) + " environments, got " + std::to_string(count);
    const auto make = [&] {
      LaneGroups<SeatedGroup<Lane, Seat>>("task", count, humanoid(), parameters, ground, sim::Extras(), Eigen::Index{1});
    };
    CHECK_THROWS_WITH_AS(make(), said.c_str(), Error);
  }
}

TEST_CASE("a reset empties seats and begins an episode in each, whole or at an age of its own") {
  Hall h;
  for (Eigen::Index e = 0; e < h.groups.environments(); ++e) h.groups.seat(e).begun = 5;
  std::vector<Eigen::Index> order;
  h.groups.reset(1, 0, false, [&](Eigen::Index e) {
    order.push_back(e);
    ++h.groups.seat(e).begun;
  });
  for (Eigen::Index e = 0; e < h.groups.environments(); ++e) {
    CHECK(h.groups.seat(e).begun == 1);
    CHECK(order[static_cast<std::size_t>(e)] == e);
  }

  constexpr int steps = 1000;
  CHECK(ages(h, 1, 0, false, steps) == std::vector<int>(static_cast<std::size_t>(3 * width), steps));
  const std::vector<int> whole = ages(h, 1, 0, true, steps);
  CHECK(*std::min_element(whole.begin(), whole.end()) >= 1);
  CHECK(*std::max_element(whole.begin(), whole.end()) <= steps);
  CHECK(std::set<int>(whole.begin(), whole.end()).size() > static_cast<std::size_t>(2 * width));
  CHECK(ages(h, 2, 0, true, steps) != whole);
  // The part of a task that begins later has the ages that these environments have in the whole.
  const std::vector<int> part = ages(h, 1, width, true, steps);
  CHECK(std::equal(whole.begin() + width, whole.end(), part.begin()));
  // Of one step nothing can be left out.
  CHECK(ages(h, 1, 0, true, 1) == std::vector<int>(static_cast<std::size_t>(3 * width), 1));
}

TEST_CASE("groups take an engine each, or all go back to the bundled dynamics") {
  Hall h;
  std::vector<std::shared_ptr<control::Engine<Lane>>> engines;
  for (int g = 0; g < 3; ++g) engines.push_back(std::make_shared<Puppeteer>([](int, int, Eigen::VectorXf&, Eigen::VectorXf&) {}));
  h.groups.use(engines);
  for (int g = 0; g < 3; ++g) CHECK(h.groups[g].engine == engines[static_cast<std::size_t>(g)]);
  CHECK_THROWS_WITH_AS(h.groups.use({engines[0], engines[1]}), "task: expected an engine for each group of lanes", Error);
  CHECK(h.groups[2].engine == engines[2]);
  h.groups.use({});
  for (int g = 0; g < 3; ++g) CHECK(h.groups[g].engine == nullptr);
}
