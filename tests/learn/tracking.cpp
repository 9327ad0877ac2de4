// SPDX-License-Identifier: MIT
#include <traceur/learn/tracking.hpp>

#include <limits>
#include <memory>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include "tracking_support.hpp"

using namespace traceur;
using namespace traceur::learn;
using namespace learn_test;

namespace {

using Serial = core::SerialExecutor;
using Task = Tracking<Lane, Serial>;
constexpr int width = core::lane_count<Lane>;
static_assert(Environments<Task>);
static_assert(Environments<Tracking<Lane, core::ThreadExecutor>>);

ReferenceMotion reference(const motion::Clip& clip) { return make_reference_motion(humanoid(), roles(), clip, 30); }

/// One task of as many environments as a pack has lanes, all begun at the motion's start.
struct Bench {
  ReferenceMotion motion;
  Serial serial;
  Task task;
  std::shared_ptr<Puppeteer> puppeteer;
  Eigen::MatrixXf action;
  StepResult<float> result{width};

  static TrackingSettings from_begin(TrackingSettings s) {
    s.start = TrackingStart::begin;
    return s;
  }
  explicit Bench(const motion::Clip& clip, TrackingSettings s = {})
      : motion(reference(clip)),
        task(humanoid(), roles(), {motion}, width, from_begin(s), sim::Ground<float>(), {}, serial),
        action(Eigen::MatrixXf::Zero(task.actions(), width)) {}
  void place(Puppeteer::Place where) {
    puppeteer = std::make_shared<Puppeteer>(std::move(where));
    task.use({puppeteer});
    task.reset(1);
  }
  void step() {
    result.clear();
    task.step(action, result);
  }
};

}  // namespace

TEST_CASE("perfect tracking earns 1 a step until the motion is over") {
  Bench b(wave(false));
  b.place([&](int, int step, Eigen::VectorXf& q, Eigen::VectorXf& v) {
    q = b.motion.poses.col(step);
    v = b.motion.velocities.col(step);
  });
  CHECK(b.motion.ticks == 30);
  for (int k = 1; k <= 30; ++k) {
    b.step();
    // What the motors are asked for without an action is the reference a step ahead.
    CHECK((b.puppeteer->target - b.motion.poses.col(k)).tail(humanoid().nq - 7).cwiseAbs().maxCoeff() < 1e-6f);
    for (int e = 0; e < width; ++e) {
      CHECK(b.result.reward[e] == doctest::Approx(1).epsilon(1e-5));
      CHECK(b.result.end[e] == (k < 30 ? End::running : End::timed_out));
      CHECK(b.task.joint_error(e) < 1e-5);
    }
  }
  CHECK(b.task.ending(0) == TrackingEnd::completed);
}

TEST_CASE("an action turns targets away from the reference by its size times the scale") {
  TrackingSettings s;
  s.action_limit = 4;
  Bench b(wave(false), s);
  b.place([&](int, int step, Eigen::VectorXf& q, Eigen::VectorXf& v) {
    q = b.motion.poses.col(step);
    v = b.motion.velocities.col(step);
  });
  core::RandomStream random(3);
  for (Eigen::Index i = 0; i < b.action.rows(); ++i) b.action(i, 0) = static_cast<float>(random.uniform(-3, 3));
  b.action(5, 0) = 100;
  b.step();
  const auto& skeleton = humanoid().character.skeleton;
  Eigen::VectorXd from = b.motion.poses.col(1).cast<double>(), to = b.puppeteer->target.cast<double>(), d(skeleton.nv());
  to.head(7) = from.head(7);
  body::difference(skeleton, from.data(), to.data(), d.data());
  for (Eigen::Index i = 0; i < b.action.rows(); ++i)
    CHECK(d[i + 6] == doctest::Approx(0.1 * std::min(4.0f, b.action(i, 0))).epsilon(1e-3));
}

TEST_CASE("episodes end on a turned root, a part far off and a number that is not finite, each lane for itself") {
  Bench b(wave(true));
  b.place([&](int lane, int, Eigen::VectorXf& q, Eigen::VectorXf& v) {
    q = b.motion.poses.col(1);
    v = b.motion.velocities.col(1);
    if (lane == 1) core::about_axis(core::Vector3<float>{0, 1, 0}, 1.7f).store(q.data() + 3);
    if (lane == 2) q[0] += 1.1f;
    if (lane == 3) q[9] = std::numeric_limits<float>::quiet_NaN();
    if (lane == 4) q[0] += 0.9f;
  });
  b.step();
  CHECK(b.task.ending(0) == TrackingEnd::running);
  CHECK(b.task.ending(1) == TrackingEnd::fall);
  CHECK(b.task.ending(2) == TrackingEnd::drift);
  CHECK(b.task.ending(3) == TrackingEnd::failure);
  CHECK(b.task.ending(4) == TrackingEnd::running);
  CHECK(b.task.joint_error(4) == doctest::Approx(0.9).epsilon(1e-3));
  CHECK(b.result.end[1] == End::terminated);
  CHECK(b.result.end[3] == End::failed);
  CHECK(b.result.reward[0] > 0.99f);
  CHECK(b.result.reward[1] == 0);
  CHECK(b.result.reward[4] < 0.9f);
  Eigen::MatrixXf before(b.task.observations(), width), after = before;
  b.task.observe(before);
  b.task.restart(1);
  b.task.restart(3);
  b.task.observe(after);
  CHECK(after.allFinite());
  CHECK((after.col(0) - before.col(0)).norm() == 0);
  CHECK((after.col(2) - before.col(2)).norm() == 0);
  CHECK((after.col(1) - after.col(3)).norm() == 0);
  CHECK(b.task.tick(1) == 0);
}

TEST_CASE("after a cycle the reference goes on from under the root, or from where it was") {
  for (const bool meet : {true, false}) {
    TrackingSettings s;
    s.meet_again = meet;
    s.episode_s = 5;
    Bench b(wave(true, 1.2), s);
    CHECK(b.motion.carry[0] == doctest::Approx(1.2).epsilon(1e-3));
    // It falls behind by 0.3 m a cycle.
    b.place([&](int, int step, Eigen::VectorXf& q, Eigen::VectorXf& v) {
      q = b.motion.poses.col(step % 30);
      v = b.motion.velocities.col(step % 30);
      q[0] += 1.2f * static_cast<float>(step / 30) - 0.01f * static_cast<float>(step);
    });
    int lived = 0;
    while (b.task.ending(0) == TrackingEnd::running) {
      b.step();
      ++lived;
    }
    // 5 s in all, or 1 m behind.
    CHECK(lived == (meet ? 150 : 101));
    CHECK(b.task.ending(0) == (meet ? TrackingEnd::completed : TrackingEnd::drift));
  }
}

TEST_CASE("a policy sees nothing of where in the world it is") {
  Bench here(wave(true, 1)), there(wave(true, 1));
  Eigen::MatrixXf a(here.task.observations(), width), b = a;
  const auto far = [](Bench& of, float x) {
    of.place([&of, x](int, int step, Eigen::VectorXf& q, Eigen::VectorXf& v) {
      q = of.motion.poses.col(step % 30);
      v = of.motion.velocities.col(step % 30);
      q[0] += x + of.motion.carry[0] * static_cast<float>(step / 30);
    });
    for (int k = 0; k < 40; ++k) of.step();
  };
  far(here, 0);
  far(there, 0.25f);
  here.task.observe(a);
  there.task.observe(b);
  // The cycle's end has put the reference over the root again.
  CHECK((a - b).cwiseAbs().maxCoeff() < 1e-4f);
}

TEST_CASE("starts are spread over motions and ticks; motions that fail are begun more often") {
  Serial serial;
  const std::vector<ReferenceMotion> motions{reference(wave(false)), reference(wave(true, 1))};
  TrackingSettings s;
  s.start = TrackingStart::spread;
  Task spread(humanoid(), roles(), motions, 4 * width, s, sim::Ground<float>(), {}, serial);
  std::vector<int> seen(2 * 30, 0);
  for (Eigen::Index e = 0; e < spread.environments(); ++e) {
    CHECK(spread.motion(e) == e % 2);
    CHECK(spread.tick(e) < 30);
    ++seen[static_cast<std::size_t>(30 * spread.motion(e) + spread.tick(e))];
  }
  CHECK(*std::max_element(seen.begin(), seen.end()) <= 1 + 4 * width / 60);
  s.start = TrackingStart::anywhere;
  Task task(humanoid(), roles(), motions, 32 * width, s, sim::Ground<float>(), {}, serial);
  s.priority_floor = 1;
  Task even(humanoid(), roles(), motions, 32 * width, s, sim::Ground<float>(), {}, serial);
  const auto second = [](const Task& of) {
    int n = 0;
    for (Eigen::Index e = 0; e < of.environments(); ++e) n += of.motion(e) == 1;
    return n / static_cast<double>(of.environments());
  };
  CHECK(second(task) == doctest::Approx(0.5).epsilon(0.2));
  for (Task* t : {&task, &even}) {
    // A second has four parts.
    REQUIRE(t->priorities().clips() == 8);
    for (int k = 0; k < 8000; ++k) t->priorities().record(k % 4, false);
    t->reset(2);
  }
  CHECK(second(task) > 0.95);
  CHECK(second(even) == doctest::Approx(0.5).epsilon(0.2));
}

TEST_CASE("the same seed gives the same bits on any number of threads") {
  const std::vector<ReferenceMotion> motions{reference(wave(true, 0.5))};
  core::ThreadExecutor one(1), two(2);
  TrackingSettings s;
  s.spread_ages = true;
  sim::Extras extras;
  extras.self_collisions = sim::self_collision_pairs(humanoid());
  Tracking<Lane, core::ThreadExecutor> a(humanoid(), roles(), motions, 4 * width, s, sim::Ground<float>(), extras, one);
  Tracking<Lane, core::ThreadExecutor> b(humanoid(), roles(), motions, 4 * width, s, sim::Ground<float>(), extras, two);
  a.reset(5);
  b.reset(5);
  Eigen::MatrixXf seen_a(a.observations(), 4 * width), seen_b = seen_a, action(a.actions(), 4 * width);
  StepResult<float> result_a(4 * width), result_b(4 * width);
  int ended = 0;
  for (int k = 0; k < 40; ++k) {
    core::RandomStream random(9, 0, static_cast<std::uint64_t>(k));
    for (float* x = action.data(); x != action.data() + action.size(); ++x) *x = static_cast<float>(3 * random.normal());
    result_a.clear();
    result_b.clear();
    a.step(action, result_a);
    b.step(action, result_b);
    for (Eigen::Index e = 0; e < 4 * width; ++e) {
      if (result_a.end[e] == End::running) continue;
      ++ended;
      a.restart(e);
      b.restart(e);
    }
    a.observe(seen_a);
    b.observe(seen_b);
    REQUIRE(seen_a == seen_b);
    REQUIRE(result_a.reward == result_b.reward);
    REQUIRE(seen_a.allFinite());
  }
  CHECK(ended > 0);
}

TEST_CASE("tasks that cannot be are refused") {
  Serial serial;
  const ReferenceMotion good = reference(wave(true));
  const auto make = [&](std::vector<ReferenceMotion> motions, Eigen::Index environments) {
    Task task(humanoid(), roles(), std::move(motions), environments, {}, sim::Ground<float>(), {}, serial);
  };
  CHECK_THROWS_WITH_AS(make({}, width), "tracking: expected a motion", Error);
  const std::string multiple = "tracking: expected a positive multiple of " + std::to_string(width) + " environments, got ";
  CHECK_THROWS_WITH_AS(make({good}, 0), (multiple + "0").c_str(), Error);
  CHECK_THROWS_WITH_AS(make({good}, width + 1), (multiple + std::to_string(width + 1)).c_str(), Error);
  CHECK_THROWS_WITH_AS(make({make_reference_motion(humanoid(), roles(), wave(true), 60)}, width),
                       "tracking: motion 'wave' has other ticks", Error);
  ReferenceMotion other = good;
  other.poses.resize(7, 31);
  CHECK_THROWS_WITH_AS(make({other}, width), "tracking: motion 'wave' is of another character", Error);
}
