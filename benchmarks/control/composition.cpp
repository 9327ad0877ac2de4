// SPDX-License-Identifier: MIT
// Time of a control tick of one composed runner without its simulation: looking up the reference, sensing, the affine law and
// the targets ("follow"), and with the clock, the planner and the control of a new step ("whole"; a new step every 24 ticks, as
// running has it); of a tick at which a step begins ("step", the longest); and of one in a manoeuvre that a regulator keeps to
// ("regulated", between two sizes and in the mirror, which costs most). One character, one thread, float.
#include <cmath>
#include <filesystem>
#include <numbers>
#include <vector>

#include <Eigen/Core>
#include <benchmark/benchmark.h>

#include <traceur/control/composition.hpp>
#include <traceur/control/regulator_practice.hpp>
#include <traceur/io/mjcf.hpp>
#include <traceur/parameterize/rbf.hpp>
#include <traceur/plan/step_planner.hpp>

namespace {

using namespace traceur;

/// A gait of the humanoid's that only its joints know of: the time is the same whatever they do.
control::Controller gait(const sim::Model& model, const control::Roles& roles) {
  constexpr int ticks = 48;
  control::Controller c;
  c.clip = "gait";
  c.cyclic = true;
  c.shape.sets = {true, false, true, true};
  control::TrackingReference& r = c.reference;
  r.poses.resize(model.nq, ticks + 1);
  r.velocities = Eigen::MatrixXd::Zero(model.nv, ticks + 1);
  r.velocities.row(0).setConstant(3.5);
  const Eigen::VectorXd neutral = model.character.skeleton.neutral_pose();
  for (int t = 0; t <= ticks; ++t) {
    Eigen::VectorXd d(model.nv);
    for (Eigen::Index k = 0; k < d.size(); ++k)
      d[k] = 0.2 * std::sin(2 * std::numbers::pi * t / ticks + static_cast<double>(k));
    d.head(6).setZero();
    body::displace(model.character.skeleton, neutral.data(), d.data(), r.poses.col(t).data());
    r.poses(0, t) = 3.5 * t / 60;
    r.poses(2, t) = 0.9;
  }
  control::measure_reference(model, roles, {}, r);
  c.targets = r.poses.leftCols(ticks);
  c.sensory = Eigen::MatrixXd::Zero(control::full_sensors, ticks);
  c.stance.assign(ticks, 0);
  std::fill(c.stance.begin() + ticks / 2, c.stance.end(), 1);
  c.phase.assign(ticks, 0);
  c.law = Eigen::VectorXd::Constant(c.shape.size(), 0.01);
  return c;
}

struct Runner {
  sim::Model model = sim::make_model(io::read_mjcf(std::filesystem::path(__FILE__).parent_path() / "../../examples/characters/humanoid.xml"));
  control::Roles roles = control::find_roles(model);
  control::Controller controller = gait(model, roles);
  control::Skill skill{control::MotionTable(model, roles, controller, {0.5, 0.75, 1, 1.25, 1.5}), {controller.shape, 2}, controller.limits};
  sim::Parameters parameters;
  sim::Ground<float> ground;
  sim::Lanes<float> lanes{model, parameters, ground};
  control::Follower<float> follower{model, roles, controller.shape, controller.limits};
  control::Composer composer{model, skill};
  parameterize::Rbf controls;
  plan::StepPlanner<double> planner;
  plan::DirectionTracker<double> direction;
  Eigen::VectorXd numbers;
  double x = 0;

  Runner() : controls(rbf(skill.shape)), numbers(skill.shape.neutral(controller.law)) {
    composer.set_exit(numbers);
    composer.start(numbers, 3.5, {}, 0);
    lanes.refresh();
  }
  /// Forty solved nodes.
  static parameterize::Rbf rbf(const control::AffineShape& shape) {
    Eigen::MatrixXd at(2, 40), values(shape.size(), 40);
    for (int i = 0; i < 40; ++i) {
      at.col(i) << i % 7, 2 + 0.5 * (i / 7);
      values.col(i).setConstant(0.01 * i);
      values(shape.alpha(), i) = values(shape.beta(), i) = 1;
    }
    return {at, values};
  }
  void follow() {
    follower.set(0, composer.player());
    follower.act(lanes);
    benchmark::DoNotOptimize(lanes.target());
  }
  void decide() {
    const plan::Approach<double> approach{2, 3.5};
    const auto p = planner.plan(20, composer.player().speed(), approach);
    const double turn = direction.turn(composer.player().frame().heading, 0, 0.1);
    const double theta[2] = {std::abs(turn), p.speeds[0]};
    controls.evaluate<double>(theta, {numbers.data(), static_cast<std::size_t>(numbers.size())});
    composer.step(numbers, p.speeds[0], turn);
  }
  void whole() {
    if (composer.at_step()) decide();
    follow();
    x += 3.5 / 60;
    composer.advance(1.0 / 60, x, 0);
  }
};

void follow(benchmark::State& state) {
  Runner runner;
  runner.composer.step(runner.numbers, 3.5, 0);
  for (auto _ : state) runner.follow();
}
void whole(benchmark::State& state) {
  Runner runner;
  for (auto _ : state) runner.whole();
}

void step(benchmark::State& state) {
  Runner runner;
  for (auto _ : state) {
    runner.decide();
    runner.follow();
  }
}

void regulated(benchmark::State& state) {
  Runner runner;
  const control::TrackingReference& r = runner.controller.reference;
  const control::SimulatedMotion motion{runner.controller.targets, r.poses, r.velocities};
  const int nv = runner.model.nv;
  const std::vector<control::Gain> gains(48, {Eigen::MatrixXf::Constant(nv - 6, 8, 1e-2F), Eigen::MatrixXf::Constant(8, 2 * nv, 1e-2F)});
  const control::TrackingRegulator regulator(runner.model, runner.roles, {0.6, 0.8}, {motion, motion}, std::vector{gains, gains});
  auto scratch = control::TrackingRegulator::scratch(runner.model);
  runner.composer.step(runner.numbers, 3.5, 0);
  for (auto _ : state) {
    runner.follow();
    regulator.apply(runner.lanes, 0, 0.7, 7, {}, true, scratch);
    benchmark::DoNotOptimize(runner.lanes.target());
  }
}

/// A tick's A and B from 1024 rollouts.
void regression(benchmark::State& state) {
  constexpr int n = 68, na = 28, rollouts = 1024;
  const control::LinearizedTick prior{Eigen::MatrixXd::Identity(n, n), Eigen::MatrixXd::Zero(n, na)};
  control::TickRegression r(prior, Eigen::VectorXd::Ones(n + na));
  const Eigen::MatrixXd x = Eigen::MatrixXd::Random(n, rollouts), u = Eigen::MatrixXd::Random(na, rollouts);
  for (auto _ : state) {
    r.forget(0.8);
    r.add(x, u, x);
    benchmark::DoNotOptimize(r.solve());
  }
}

BENCHMARK(follow);
BENCHMARK(whole);
BENCHMARK(step);
BENCHMARK(regulated);
BENCHMARK(regression)->Unit(benchmark::kMillisecond);

}  // namespace
