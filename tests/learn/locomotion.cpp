// SPDX-License-Identifier: MIT
#include <traceur/learn/locomotion.hpp>

#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include <doctest/doctest.h>

#include "tracking_support.hpp"
#include <traceur/learn/adversarial_imitation.hpp>

using namespace traceur;
using namespace traceur::learn;
using namespace learn_test;
using doctest::Approx;

namespace {

using Serial = core::SerialExecutor;
using Task = Locomotion<Lane, Serial>;
constexpr int width = core::lane_count<Lane>;
static_assert(StyledEnvironments<Task>);
static_assert(StyleReference<ReferenceTransitions>);

std::vector<ReferenceMotion> walks() { return {make_reference_motion(humanoid(), roles(), wave(true, 1.5), 30)}; }

struct Bench {
  Serial serial;
  Task task;
  Eigen::MatrixXf action, seen;
  StepResult<float> result;

  explicit Bench(const LocomotionSettings& s = {}, Eigen::Index environments = width)
      : task(humanoid(), roles(), walks(), environments, s, sim::Ground<float>(), {}, serial),
        action(Eigen::MatrixXf::Zero(task.actions(), environments)),
        seen(task.observations(), environments),
        result(environments) {}
  void step() {
    result.clear();
    task.step(action, result);
    task.observe(seen);
  }
};

}  // namespace

TEST_CASE("who moves as asked earns the whole reward, and its history is the motion's") {
  LocomotionSettings s;
  s.start = LocomotionStart::spread;
  s.task.slowest = s.task.fastest = 1.5;
  s.history = 3;
  Bench b(s);
  const ReferenceMotion& m = b.task.motions()[0];
  b.task.use({std::make_shared<Puppeteer>([&](int lane, int step, Eigen::VectorXf& q, Eigen::VectorXf& v) {
    const int tick = (lane * m.ticks / width + step) % m.ticks;
    q = m.poses.col(tick);
    v = m.velocities.col(tick);
  })});
  b.task.reset(1);
  b.task.observe(b.seen);
  Eigen::MatrixXf style(b.task.style_features(), width);
  for (int k = 0; k < 5; ++k) {
    b.task.observe_style(style);
    for (int e = 0; e < width; ++e) {
      const auto history = b.task.reference().history(0, (e * m.ticks / width + k) % m.ticks);
      CHECK((style.col(e) - Eigen::Map<const Eigen::VectorXf>(history.data(), style.rows())).cwiseAbs().maxCoeff() < 2e-3f);
    }
    b.step();
    for (int e = 0; e < width; ++e) {
      CHECK(b.result.reward[e] == Approx(1).epsilon(1e-3));
      CHECK(b.task.speed(e) == Approx(1.5).epsilon(0.02));
      CHECK(b.seen(b.seen.rows() - 3, e) == Approx(1).epsilon(1e-3));
      CHECK(b.seen(b.seen.rows() - 1, e) == 1.5f);
    }
  }
}

TEST_CASE("episodes end on a fall, at their time and on a number that is not finite, each lane for itself") {
  LocomotionSettings s;
  s.start = LocomotionStart::spread;
  s.episode_s = 0.1;
  Bench b(s);
  const ReferenceMotion& m = b.task.motions()[0];
  b.task.use({std::make_shared<Puppeteer>([&](int lane, int, Eigen::VectorXf& q, Eigen::VectorXf& v) {
    q = m.poses.col(0);
    v = m.velocities.col(0);
    if (lane == 1) q[2] -= 1.4f;
    if (lane == 2) q[9] = std::numeric_limits<float>::quiet_NaN();
  })});
  b.task.reset(1);
  for (int k = 1; k <= 3; ++k) {
    b.step();
    CHECK(b.result.end[0] == (k < 3 ? End::running : End::timed_out));
    CHECK(b.result.end[1] == End::terminated);
    CHECK(b.result.end[2] == End::failed);
    CHECK(b.result.reward[1] == 0);
    if (k > 1) continue;
    const Eigen::MatrixXf before = b.seen;
    for (const Eigen::Index e : {1, 2}) b.task.restart(e);
    b.task.observe(b.seen);
    CHECK(b.seen.allFinite());
    CHECK((b.seen.col(0) - before.col(0)).norm() == 0);
  }
}

TEST_CASE("goals are spread for tests, and change at random in training") {
  LocomotionSettings s;
  s.start = LocomotionStart::spread;
  Bench test(s, 2 * width);
  for (Eigen::Index e = 0; e < 2 * width; ++e)
    CHECK(test.task.goal(e).speed == Approx(1 + 3 * (static_cast<double>(e) + 0.5) / (2 * width)));
  s.start = LocomotionStart::anywhere;
  s.task.least_s = s.task.most_s = 0.2;
  s.task.turn = 0.5;
  Bench b(s, 2 * width);
  const ReferenceMotion& m = b.task.motions()[0];
  const auto stay = [&](int, int, Eigen::VectorXf& q, Eigen::VectorXf& v) {
    q = m.poses.col(0);
    v = m.velocities.col(0);
  };
  b.task.use({std::make_shared<Puppeteer>(stay), std::make_shared<Puppeteer>(stay)});
  b.task.reset(3);
  int own = 0;
  for (Eigen::Index e = 0; e < 2 * width; ++e) own += std::abs(b.task.goal(e).speed - 1.5f) < 0.02f;
  CHECK(own > width / 2);
  CHECK(own < 2 * width);
  const MovingGoal before = b.task.goal(0);
  int changes = 0;
  float last = before.speed;
  for (int k = 0; k < 30; ++k) {
    b.step();
    if (b.task.goal(0).speed != last) ++changes;
    last = b.task.goal(0).speed;
  }
  CHECK(changes >= 4);
  CHECK(changes <= 6);
  CHECK(b.task.goal(0).heading != before.heading);
}

TEST_CASE("the same seed gives the same bits on any number of threads, in whole or in parts") {
  core::ThreadExecutor one(1), two(2);
  LocomotionSettings s;
  s.spread_ages = true;
  s.task.turn = 1;
  s.task.least_s = s.task.most_s = 0.3;
  sim::Extras extras;
  Locomotion<Lane, core::ThreadExecutor> a(humanoid(), roles(), walks(), 4 * width, s, sim::Ground<float>(), extras, one);
  s.all_environments = 4 * width;
  s.first_environment = 2 * width;
  Locomotion<Lane, core::ThreadExecutor> b(humanoid(), roles(), walks(), 2 * width, s, sim::Ground<float>(), extras, two);
  a.reset(5);
  b.reset(5);
  Eigen::MatrixXf seen_a(a.observations(), 4 * width), seen_b(a.observations(), 2 * width), action(a.actions(), 4 * width),
      style_a(a.style_features(), 4 * width), style_b(a.style_features(), 2 * width);
  StepResult<float> result_a(4 * width), result_b(2 * width);
  int ended = 0;
  for (int k = 0; k < 40; ++k) {
    core::RandomStream random(9, 0, static_cast<std::uint64_t>(k));
    for (float* x = action.data(); x != action.data() + action.size(); ++x) *x = static_cast<float>(3 * random.normal());
    result_a.clear();
    result_b.clear();
    a.step(action, result_a);
    b.step(action.rightCols(2 * width), result_b);
    for (Eigen::Index e = 0; e < 4 * width; ++e) {
      if (result_a.end[e] == End::running) continue;
      ++ended;
      a.restart(e);
      if (e >= 2 * width) b.restart(e - 2 * width);
    }
    a.observe(seen_a);
    b.observe(seen_b);
    a.observe_style(style_a);
    b.observe_style(style_b);
    REQUIRE(seen_a.rightCols(2 * width) == seen_b);
    REQUIRE(style_a.rightCols(2 * width) == style_b);
    REQUIRE(result_a.reward.tail(2 * width) == result_b.reward);
    REQUIRE(seen_a.allFinite());
  }
  CHECK(ended > 0);
}

TEST_CASE("the rest pose is the motions' mean, upright") {
  Bench b;
  const body::Skeleton& skeleton = humanoid().character.skeleton;
  const Eigen::VectorXd neutral = skeleton.neutral_pose();
  Eigen::VectorXd d(skeleton.nv());
  body::difference(skeleton, neutral.data(), b.task.rest_pose().data(), d.data());
  // The arm is raised by 0.6 (1 - cos) rad about x, in the mean by 0.6.
  const int shoulder = skeleton[skeleton.find("left_shoulder")].v_index;
  CHECK(d[shoulder] == Approx(0.6).epsilon(0.02));
  d[shoulder] = 0;
  CHECK(d.cwiseAbs().maxCoeff() < 1e-3);
}

TEST_CASE("tasks that cannot be are refused") {
  Serial serial;
  const auto make = [&](std::vector<ReferenceMotion> motions, Eigen::Index environments, const LocomotionSettings& s = {}) {
    Task task(humanoid(), roles(), std::move(motions), environments, s, sim::Ground<float>(), {}, serial);
  };
  CHECK_THROWS_WITH_AS(make({}, width), "reference transitions: expected a motion", Error);
  CHECK_THROWS_AS(make(walks(), width + 1), Error);
  CHECK_THROWS_AS(make(walks(), 0), Error);
  CHECK_THROWS_WITH_AS(make({make_reference_motion(humanoid(), roles(), wave(true), 60)}, width),
                       "locomotion: motion 'wave' has other ticks", Error);
  LocomotionSettings s;
  s.task.fastest = -1;
  CHECK_THROWS_AS(make(walks(), width, s), Error);
}
