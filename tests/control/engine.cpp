// SPDX-License-Identifier: MIT
#include <traceur/control/engine.hpp>
#include <traceur/control/episodes.hpp>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace figures;
using control::Controller;
using control::EpisodeResult;
using control::Push;

namespace {

using S = core::Pack<double, 2>;
using Runner = control::EpisodeRunner<S>;
using Results = std::array<EpisodeResult, 2>;
using World = sim::World<double>;

/// The humanoid sways from foot to foot, its two lanes from different starts.
struct Trial {
  const Figure& f = humanoid();
  sim::Parameters simulation;
  sim::Ground<double> ground;
  control::TrackingCost cost{f.model, f.roles, f.points};
  Controller c;
  control::EpisodeSettings e;
  Runner runner{f.model, simulation, ground, cost};

  explicit Trial(double seconds) {
    const motion::Clip clip = sway_clip(60);
    c.cyclic = true;
    c.reference = reference_of(f, clip, clip.duration());
    const int ticks = c.reference.ticks;
    c.targets = c.reference.poses.leftCols(ticks);
    c.sensory = Eigen::MatrixXd::Zero(control::full_sensors, ticks);
    c.stance.assign(static_cast<std::size_t>(ticks), 0);
    c.phase.assign(static_cast<std::size_t>(ticks), 0);
    c.law = Eigen::VectorXd::Zero(c.shape.size());
    c.start_pose = c.reference.poses.col(0);
    c.start_velocity = c.reference.velocities.col(0);
    e.seconds = seconds;
  }
  Results run(int used = 2, const Push& push = {}, const Runner::Observer& observer = {}) {
    return runner.run(c, e, used, [&](int) { return c.law.data(); }, [](int lane) { return lane; }, [&](int) { return push; }, observer);
  }
  World world(int lanes, double dt = sim::Parameters{}.dt) const {
    sim::Parameters p = simulation;
    p.dt = dt;
    return World(f.model.character, lanes, p, ground);
  }
};

void check_close(const EpisodeResult& a, const EpisodeResult& b, double tolerance) {
  CHECK(a.survived == b.survived);
  CHECK(a.seconds == b.seconds);
  CHECK(std::abs(a.deviation - b.deviation) <= tolerance);
  // What has fallen is left where it is.
  if (a.survived) CHECK(std::abs(a.mean_speed - b.mean_speed) <= tolerance);
}

/// Height and failure of lanes as told by whoever moves them: nothing falls, nothing is felt, and one lane may fail.
class Puppet {
 public:
  explicit Puppet(int lanes) : lanes_(lanes), q_(humanoid().skeleton().neutral_pose()) {}
  int lanes() const { return lanes_; }
  const body::Character& character() const { return humanoid().model.character; }
  double dt() const { return 1.0 / 60; }
  template <class Q, class V>
  void reset(int, const Eigen::MatrixBase<Q>& q, const Eigen::MatrixBase<V>&) { q_ = q; }
  template <class Q>
  void set_target(int, const Eigen::MatrixBase<Q>&) {}
  void step(int count) { steps += count; }
  template <class Q>
  void pose(int, Eigen::MatrixBase<Q>& out) const { out = q_; }
  template <class V>
  void velocity(int, Eigen::MatrixBase<V>& out) const { out.setZero(); }
  bool failed(int lane) const { return lane == failing && steps >= 5; }

  int failing = -1, steps = 0;

 private:
  int lanes_;
  Eigen::VectorXd q_;
};
static_assert(sim::Simulator<Puppet>);

}  // namespace

TEST_CASE("the bundled simulator as an engine tells what the bundled runner tells") {
  Trial trial(1);
  std::vector<double> forces;
  const auto observe = [&](int, const sim::Lanes<S>& lanes) {
    for (const auto& f : lanes.body_force()) forces.push_back(core::lane_of(f.z, 1));
  };
  const Results bundled = trial.run(2, {}, observe);
  const std::vector<double> felt = forces;
  CHECK(*std::max_element(felt.begin(), felt.end()) > 100);

  trial.runner.use(control::engine_of<S>(trial.world(2)));
  forces.clear();
  const Results one = trial.run(2, {}, observe);
  REQUIRE(forces.size() == felt.size());
  double worst = 0;
  for (std::size_t k = 0; k < felt.size(); ++k) worst = std::max(worst, std::abs(forces[k] - felt[k]));
  CHECK(worst < 1);

  std::vector<World> two;
  two.push_back(trial.world(1));
  two.push_back(trial.world(1));
  trial.runner.use(control::engine_of<S>(std::move(two)));
  const Results apart = trial.run();
  for (std::size_t l = 0; l < 2; ++l) {
    check_close(one[l], bundled[l], 1e-6);
    check_close(apart[l], bundled[l], 1e-6);
  }
  CHECK(bundled[0].deviation != bundled[1].deviation);

  trial.runner.use(nullptr);
  const Results again = trial.run();
  for (std::size_t l = 0; l < 2; ++l) check_close(again[l], bundled[l], 0);
}

TEST_CASE("an episode begins without memory of the one before") {
  Trial trial(0.5);
  trial.runner.use(control::engine_of<S>(trial.world(2)));
  const Results first = trial.run(), second = trial.run();
  for (std::size_t l = 0; l < 2; ++l) check_close(second[l], first[l], 0);
}

TEST_CASE("pushes reach the engine's character, in the lane and the ticks they are meant for") {
  Trial trial(1);
  const Push push{{0, 260, 0}, 6, 12};
  const Results bundled = trial.run(2, push);
  trial.runner.use(control::engine_of<S>(trial.world(2)));
  const Results still = trial.run(), pushed = trial.run(2, push);
  for (std::size_t l = 0; l < 2; ++l) {
    check_close(pushed[l], bundled[l], 1e-6);
    CHECK(pushed[l].deviation > 1.05 * still[l].deviation);
  }
}

TEST_CASE("an engine has a time step of its own, which must divide the control interval") {
  Trial trial(1);
  const Results bundled = trial.run();
  trial.runner.use(control::engine_of<S>(trial.world(2, 1.0 / 960)));
  const Results fine = trial.run();
  CHECK(fine[0].survived == bundled[0].survived);
  CHECK(fine[0].deviation == doctest::Approx(bundled[0].deviation).epsilon(0.1));
  CHECK(fine[0].deviation != bundled[0].deviation);
  trial.runner.use(control::engine_of<S>(trial.world(2, 1.0 / 500)));
  CHECK(contains(error_of([&] { trial.run(); }), "time steps of 0.002"));
}

TEST_CASE("what fails in the engine ends its episode") {
  Trial trial(1);
  Puppet puppet(2);
  puppet.failing = 1;
  trial.runner.use(control::engine_of<S>(puppet));
  const Results r = trial.run();
  CHECK(r[0].survived);
  CHECK_FALSE(r[0].non_finite);
  CHECK(r[1].non_finite);
  CHECK(r[1].seconds == doctest::Approx(4.0 / 60));
  // The next episode begins whole.
  puppet.failing = -1;
  trial.runner.use(control::engine_of<S>(puppet));
  CHECK(trial.run()[1].survived);
  CHECK(contains(error_of([&] { trial.run(2, Push{{1, 0, 0}, 0, 1}); }), "no pushes"));
}

TEST_CASE("simulators none of whose lanes is wanted stand still") {
  Trial trial(1);
  std::vector<Puppet> puppets{Puppet(1), Puppet(1)};
  puppets[1].failing = 0;
  const auto engine = std::make_shared<control::SimulatorEngine<S, Puppet>>(puppets);
  trial.runner.use(engine);
  trial.run();
  CHECK(engine->simulators()[0].steps == 60);
  CHECK(engine->simulators()[1].steps == 5);
  trial.run(1);
  CHECK(engine->simulators()[0].steps == 120);
  CHECK(engine->simulators()[1].steps == 5);
}

TEST_CASE("an engine must have the lanes and the character") {
  Trial trial(1);
  CHECK(contains(error_of([&] { control::engine_of<S>(trial.world(1)); }), "2 lanes"));
  const auto other = control::engine_of<S>(World(small().model.character, 2));
  CHECK(contains(error_of([&] { trial.runner.use(other); }), "another character"));
}
