// SPDX-License-Identifier: MIT
// The code of docs/control.md.
#include <traceur/control/learn_feedback.hpp>
#include <traceur/control/make_controller.hpp>
#include <traceur/control/running_search.hpp>
#include <traceur/control/sampling_control.hpp>
#include <traceur/control/regulator_practice.hpp>
#include <traceur/control/tracking_regulator.hpp>
#include <traceur/io/mjcf.hpp>

#include <doctest/doctest.h>

#include "moving_gait.hpp"

using namespace traceur;

TEST_CASE("docs/control.md") {
  const char* path = TRACEUR_SOURCE_DIR "/examples/characters/humanoid.xml";
  const motion::Clip clip = figures::squat_clip(30, 0.3);
  using S = core::Pack<float>;  // lanes simulated together

  const sim::Model model = sim::make_model(io::read_mjcf(path));
  const control::Roles roles = control::find_roles(model);
  const std::vector<control::TrackedPoint> points = control::tracked_points(model, roles);
  const control::TrackingReference reference = control::make_reference(model, roles, points, clip, clip.duration(), 1.0 / 60);
  const control::TrackingCost cost(model, roles, points);
  const sim::Parameters simulation;
  const sim::Ground<float> ground;
  core::ThreadExecutor threads(2);

  // Open loop.
  control::SamplingParameters sampling;
  sampling.samples = 256;
  sampling.elites = 32;
  sampling.rounds = 3;
  const control::SampledControl sampled = control::sample_control<S>(model, simulation, ground, cost, reference, sampling, threads);

  // A law of three phases, and what the sensors should read.
  const control::FeedbackShape shape{{.swing_foot = true, .root_spin = true, .ankles = true}, 3, 3};
  sim::Lanes<S> lanes(model, simulation, ground);
  control::Controller controller = control::make_one_shot(lanes, model, simulation, roles, reference, sampled, sampling, shape);

  // Its numbers.
  std::vector<control::EpisodeRunner<S>> runners;
  for (int i = 0; i < threads.concurrency(); ++i) runners.emplace_back(model, simulation, ground, cost);
  control::FeedbackLearning learning;
  learning.population = 8;
  learning.starts = 4;
  learning.generations = 2;
  controller.law = control::learn_feedback(runners, controller, learning, threads).best_law;

  const std::vector<control::EpisodeResult> trials = control::run_episodes(runners, controller, {}, 16, threads);

  // Keeping to a simulated motion.
  const control::SimulatedMotion motion{sampled.targets, sampled.poses, sampled.velocities};
  const control::RegulatorSettings settings;
  const auto nothing = [](auto&, int) {};
  const auto ticks = control::linearize(lanes, model, motion, sampling.steps_per_tick, settings, nothing);
  const auto gains =
      control::regulator_gains(ticks, control::regulator_costs(model, settings, motion.ticks()), settings.effort);
  const control::TrackingRegulator regulator(model, roles, {1}, {motion}, {gains});

  // By practice.
  control::PracticeSettings practice;
  practice.rounds = 1;
  practice.rollouts = practice.trials = 16;
  const auto begin = [&](core::RandomStream& random) {
    control::PracticeStart s{{motion.poses.col(0), motion.velocities.col(0)}};
    s.velocity[0] += random.uniform(-0.3, 0.3);
    return s;
  };
  const control::RegulatorPractice<S, decltype(nothing)> practise(model, roles, simulation, ground, {}, motion, motion.ticks(),
                                                                  sampling.steps_per_tick, settings, practice, nothing);
  const control::PractisedRegulator practised = practise.run(begin, threads);
  const control::TrackingRegulator better(model, roles, {1}, {motion}, std::vector(1, practised.gains));

  // Refined targets.
  control::RefinementSettings refinement;
  refinement.generations = 1;
  const control::RefinedTargets refined = practise.refine(practised.gains, refinement, begin, threads);
  CHECK(refined.targets.cols() == motion.ticks());

  CHECK(regulator.ticks() == static_cast<int>(sampled.targets.cols()));
  CHECK(better.ticks() == regulator.ticks());
  CHECK(sampled.mean_joint_error < 0.1);
  CHECK(controller.law.size() == 297);
  REQUIRE(trials.size() == 16);
  for (const control::EpisodeResult& r : trials) CHECK_FALSE(r.non_finite);
}

TEST_CASE("docs/control.md, running at any speed and turn") {
  using S = core::Pack<float>;
  const sim::Model& model = figures::humanoid().model;
  const control::Roles& roles = figures::humanoid().roles;
  const control::Controller gait = figures::any_controller(figures::humanoid(), 48, true, 3.0);
  const sim::Ground<float> ground;

  const control::MotionTable table(model, roles, gait, {0.5, 0.75, 1, 1.25, 1.5});
  const control::Skill skill{table, {gait.shape, 2}, gait.limits};
  control::RunningTrials<S> runs(model, roles, gait.simulation, ground, gait, skill);

  control::RunningSearch search;
  search.run.frequency = {2 / table.duration(), table.speed()};  // c_f and c_v of Eq. 8
  search.run.cycles = 2;
  search.generations = 2;
  search.trials = 4;
  const control::RunningTask left_turn{0.02, table.speed()};  // rad per step, m/s
  const control::RunningFound found =
      control::search_running(runs, skill.shape, left_turn, skill.shape.neutral(gait.law), search);

  CHECK(skill.shape.size() == 83);
  CHECK(found.runs > 0);
  CHECK(found.control.size() == 83);
}
