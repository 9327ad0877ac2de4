// SPDX-License-Identifier: MIT
#include <traceur/control/episodes.hpp>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace figures;
using control::Controller;
using control::EpisodeResult;
using control::EpisodeSettings;
using control::Push;

namespace {

// Four lanes whatever the machine.
using S = core::Pack<float, 4>;
using Runner = control::EpisodeRunner<S>;

/// The humanoid with a controller of zero law around its own reference.
struct Trial {
  const Figure& f = humanoid();
  sim::Parameters simulation;
  sim::Ground<float> ground;
  control::TrackingCost cost{f.model, f.roles, f.points};
  Controller c;
  EpisodeSettings e;

  explicit Trial(const motion::Clip& clip) {
    c.cyclic = clip.cyclic;
    c.reference = reference_of(f, clip, clip.duration());
    const int ticks = c.reference.ticks;
    c.targets = c.reference.poses.leftCols(ticks);
    c.sensory = Eigen::MatrixXd::Zero(control::full_sensors, ticks);
    c.stance.assign(static_cast<std::size_t>(ticks), 0);
    c.phase.assign(static_cast<std::size_t>(ticks), 0);
    c.law = Eigen::VectorXd::Zero(c.shape.size());
    c.start_pose = c.reference.poses.col(0);
    c.start_velocity = c.reference.velocities.col(0);
    e.perturbation = 0;
  }
  Runner runner() const { return Runner(f.model, simulation, ground, cost); }
  auto run(Runner& r, int used, const std::function<Push(int)>& push = [](int) { return Push{}; }, const Runner::Observer& observer = {}) const {
    return r.run(c, e, used, [&](int) { return c.law.data(); }, [](int lane) { return lane; }, push, observer);
  }
  EpisodeResult one() const {
    Runner r = runner();
    return run(r, 1)[0];
  }
};

/// Standing, high above the ground.
motion::Clip aloft(int ticks, bool cyclic = false, double speed = 0) {
  return clip_of(
      humanoid(), "aloft", ticks,
      [=](double t) {
        Eigen::VectorXd q = standing_pose();
        q[0] += speed * t;
        q[2] += 50;
        return q;
      },
      cyclic);
}

bool same(const EpisodeResult& a, const EpisodeResult& b) {
  return a.seconds == b.seconds && a.survived == b.survived && a.reached_end == b.reached_end && a.held == b.held &&
         a.deviation == b.deviation && a.local_error_m == b.local_error_m && a.mean_speed == b.mean_speed && a.non_finite == b.non_finite;
}

/// The height lost after n steps of free fall with upward speed v, as the simulator's steps have it.
double drop(const sim::Parameters& p, double v, int n) { return p.gravity * p.dt * p.dt * n * (n + 1) / 2 - v * p.dt * n; }

}  // namespace

TEST_CASE("with a law of zeros and no perturbation an episode is the open loop") {
  Trial trial(squat_clip(30));
  trial.e.hold = 0;
  Runner runner = trial.runner();
  int ticks = 0;
  sim::Lanes<S> open(trial.f.model, trial.simulation, trial.ground);
  for (int i = 0; i < 4; ++i) put(open, i, trial.c.start_pose, trial.c.start_velocity);
  double apart = 0;
  const auto result = trial.run(runner, 4, [](int) { return Push{}; }, [&](int tick, const sim::Lanes<S>& lanes) {
    CHECK(tick == ticks++);
    for (int k = 7; k < trial.f.model.nq; ++k) open.target()[k] = S(trial.c.targets(k, tick));
    open.step(trial.c.steps_per_tick);
    for (int k = 0; k < trial.f.model.nq; ++k)
      for (int i = 0; i < 4; ++i) apart = std::max(apart, static_cast<double>(std::abs(lanes.q()[k][i] - open.q()[k][i])));
  });
  CHECK(ticks == 30);
  CHECK(apart == 0);
  for (const EpisodeResult& r : result) {
    CHECK(r.survived);
    CHECK(r.seconds == doctest::Approx(0.5));
    CHECK(same(r, result[0]));
  }
}

TEST_CASE("standing to the end and beyond is reached and held") {
  Trial trial(standing_clip(20));
  trial.e.measure_joints = true;
  const EpisodeResult good = trial.one();
  CHECK(good.survived);
  CHECK(good.reached_end);
  CHECK(good.held);
  CHECK(good.seconds == doctest::Approx(20 / 60.0 + 0.5));
  CHECK(good.local_error_m < 0.02);
  CHECK(good.deviation < 0.2);
  CHECK(std::abs(good.mean_speed) < 0.1);
  // Half a metre below where the clip ends, and nobody calls it a fall.
  trial.c.reference.poses(2, 20) += 0.5;
  trial.e.fall = {10, 3};
  const EpisodeResult elsewhere = trial.one();
  CHECK(elsewhere.survived);
  CHECK_FALSE(elsewhere.reached_end);
  CHECK_FALSE(elsewhere.held);
}

TEST_CASE("soles slide as fast as the body glides on ice, and not where they hold") {
  Trial trial(standing_clip(20));
  trial.c.start_velocity[0] = 0.3;
  trial.c.start_velocity[1] = 0.4;
  trial.e.hold = 0;
  CHECK(trial.one().slide_m_s == 0);  // not asked for
  trial.e.measure_slide = true;
  trial.simulation.friction = 0;
  Runner runner = trial.runner();
  double speed = 0;
  const EpisodeResult gliding = trial.run(runner, 1, [](int) { return Push{}; }, [&](int, const sim::Lanes<S>& lanes) {
    for (const auto& leg : trial.f.roles.legs) {
      const auto& v = lanes.work().bodies[static_cast<std::size_t>(leg.foot)].linear;
      speed += std::hypot(core::lane_of(v.x, 0), core::lane_of(v.y, 0)) / 40;
    }
  })[0];
  CHECK(speed > 0.4);
  CHECK(gliding.slide_m_s == doctest::Approx(speed).epsilon(0.03));
  trial.simulation.friction = 1;
  trial.c.start_velocity.setZero();
  CHECK(trial.one().slide_m_s < 0.005);
}

TEST_CASE("a push changes the momentum by its impulse") {
  Trial trial(aloft(30));
  trial.simulation.gravity = 0;
  trial.e.hold = 0;
  Runner runner = trial.runner();
  const Vector force{60, -30, 45};
  std::vector<Vector> momentum[2];
  const auto result = trial.run(
      runner, 3, [&](int lane) { return lane == 2 ? Push{force, 10, 6} : Push{}; },
      [&](int, const sim::Lanes<S>& lanes) {
        const auto& p = lanes.work().linear_momentum;
        momentum[0].push_back({p.x[1], p.y[1], p.z[1]});
        momentum[1].push_back({p.x[2], p.y[2], p.z[2]});
      });
  REQUIRE(momentum[0].size() == 30);
  for (std::size_t t = 0; t < 30; ++t) {
    const double share = std::clamp((static_cast<double>(t) + 1 - 10) / 60.0, 0.0, 0.1);
    CHECK(norm(momentum[0][t]) < 1e-3);
    CHECK(apart(momentum[1][t], share * force) < 1e-3);
  }
  CHECK(result[0].survived);
}

TEST_CASE("in another world the ground gives more or less and the steps are finer, until the runner is back in its own") {
  const Trial falling(aloft(12));
  Runner r = falling.runner();
  double height = 0;
  const auto look = [&](int, const sim::Lanes<S>& lanes) { height = core::lane_of(lanes.q()[2], 0); };
  const auto fallen = [&](const sim::Parameters& p, int n) { return standing_pose()[2] + 50 - drop(p, 0, n); };
  const EpisodeResult own = falling.run(r, 1)[0];
  r.change_world({.finer = 2});
  falling.run(r, 1, [](int) { return Push{}; }, look);
  sim::Parameters finer = falling.simulation;
  finer.dt /= 2;
  const int ticks = 12 + static_cast<int>(std::lround(falling.e.hold * 60));
  CHECK(height == doctest::Approx(fallen(finer, 2 * falling.c.steps_per_tick * ticks)).epsilon(1e-5));
  r.change_world({});
  CHECK(same(falling.run(r, 1)[0], own));

  Trial standing(standing_clip(30));
  Runner s = standing.runner();
  const auto rests = [&](double ground) {
    s.change_world({.ground = ground});
    standing.run(s, 1, [](int) { return Push{}; }, look);
    return height;
  };
  const double soft = rests(0.1), as_made = rests(1), hard = rests(10);
  CHECK(soft < as_made - 0.001);
  CHECK(as_made < hard);
}

TEST_CASE("a fall ends the episode at its own time in every lane") {
  Trial trial(aloft(60));
  trial.e.hold = 0;
  trial.e.perturbation = 1;
  trial.e.starts = {2.0, 0};
  trial.e.seed = 5;
  Runner runner = trial.runner();
  const auto result = trial.run(runner, 4);
  double first = 9, last = 0;
  for (int lane = 0; lane < 4; ++lane) {
    core::RandomStream random(trial.e.seed, trial.e.stream, static_cast<std::uint64_t>(lane));
    random.uniform(), random.uniform();
    const double up = 2.0 * random.uniform(-1.0, 1.0);
    int ticks = 0;
    while (drop(trial.simulation, up, 8 * (ticks + 1)) <= trial.e.fall.drop) ++ticks;
    const EpisodeResult& r = result[static_cast<std::size_t>(lane)];
    CHECK(r.seconds == doctest::Approx(ticks / 60.0));
    CHECK_FALSE(r.survived);
    CHECK_FALSE(r.reached_end);
    CHECK_FALSE(r.held);
    first = std::min(first, r.seconds), last = std::max(last, r.seconds);
  }
  CHECK(last > first + 0.1);
}

TEST_CASE("tilting over is a fall, turning on the spot is none") {
  Trial trial(aloft(60));
  trial.simulation.gravity = 0;
  trial.e.hold = 0;
  trial.c.start_velocity[4] = 2;
  const EpisodeResult tilted = trial.one();
  CHECK_FALSE(tilted.survived);
  CHECK(std::abs(tilted.seconds - trial.e.fall.tilt / 2) < 2.5 / 60);
  trial.c.start_velocity[4] = 0;
  const Vector up = Quaternion::from(trial.c.start_pose.data() + 3).rotate({0, 0, 1});
  (2.0 * up).store(trial.c.start_velocity.data() + 3);
  CHECK(trial.one().survived);
}

TEST_CASE("a start that is no number is counted as such") {
  Trial trial(aloft(10));
  trial.c.start_velocity[7] = std::nan("");
  const EpisodeResult r = trial.one();
  CHECK(r.non_finite);
  CHECK_FALSE(r.survived);
  CHECK(r.seconds == 0);
}

TEST_CASE("a cyclic controller goes on for the seconds asked, carried along by its reference") {
  Trial trial(aloft(15, true, 1.5));
  trial.simulation.gravity = 0;
  trial.e.seconds = 2;
  trial.e.measure_joints = true;
  const EpisodeResult r = trial.one();
  CHECK(r.survived);
  CHECK(r.seconds == doctest::Approx(2));
  CHECK(r.mean_speed == doctest::Approx(1.5).epsilon(0.001));
  CHECK(r.deviation < 0.02);  // eight periods away it still is where the reference is
  CHECK(r.local_error_m < 0.005);
  CHECK_FALSE(r.reached_end);
}

TEST_CASE("deviations are measured from what the sensors should read, whether there is a law or not") {
  for (const int rank : {0, 3}) {
    Trial trial(aloft(20));
    trial.simulation.gravity = 0;
    trial.c.shape.rank = rank;
    trial.c.law = Eigen::VectorXd::Zero(trial.c.shape.size());
    CHECK(trial.one().deviation < 0.02);
    trial.c.sensory.row(4).setConstant(0.2);
    CHECK(trial.one().deviation == doctest::Approx(2 * 0.2).epsilon(0.05));
  }
}

TEST_CASE("a result depends on the start and the law, not on the lane, its neighbours or the threads") {
  Trial trial(squat_clip(24));
  trial.e.perturbation = 1;
  trial.e.hold = 0.2;
  trial.e.measure_joints = true;
  trial.c.law = control::step_placement_law(trial.c.shape);
  core::SerialExecutor serial;
  core::ThreadExecutor threads(2);
  std::vector<Runner> runners;
  runners.push_back(trial.runner());
  runners.push_back(trial.runner());
  const auto push = [](int i) { return i == 3 ? Push{{200, 0, 0}, 5, 10} : Push{}; };
  const std::vector<EpisodeResult> all = control::run_episodes(runners, trial.c, trial.e, 7, serial, push);
  const std::vector<EpisodeResult> threaded = control::run_episodes(runners, trial.c, trial.e, 7, threads, push);
  REQUIRE(all.size() == 7);
  CHECK_FALSE(all[0].deviation == all[1].deviation);
  for (std::size_t i = 0; i < 7; ++i) CHECK(same(all[i], threaded[i]));
  const double* law = trial.c.law.data();
  for (const int offset : {0, 3, 5}) {
    const auto shifted = runners[1].run(
        trial.c, trial.e, 4, [&](int) { return law; }, [&](int lane) { return (lane + offset) % 7; },
        [&](int lane) { return push((lane + offset) % 7); });
    for (std::size_t lane = 0; lane < 4; ++lane) CHECK(same(shifted[lane], all[(lane + static_cast<std::size_t>(offset)) % 7]));
  }
  const auto alone = runners[0].run(trial.c, trial.e, 1, [&](int) { return law; }, [](int) { return 6; }, [](int) { return Push{}; });
  CHECK(same(alone[0], all[6]));
}
