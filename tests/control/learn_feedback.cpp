// SPDX-License-Identifier: MIT
#include <traceur/control/learn_feedback.hpp>

#include <doctest/doctest.h>

#include <memory>
#include <optional>

#include "support.hpp"

using namespace figures;
using control::Controller;
using control::EpisodeResult;
using control::FeedbackLearning;
using control::FeedbackProgress;
using traceur::optimize::CmaEs;

namespace {

// Four lanes whatever the machine.
using S = core::Pack<float, 4>;
using Runner = control::EpisodeRunner<S>;

/// The humanoid is to stand for a second after it was shoved; its motors alone do not see to that.
struct Task {
  const Figure& f = humanoid();
  sim::Parameters simulation;
  sim::Ground<float> ground;
  control::TrackingCost cost{f.model, f.roles, f.points};
  std::vector<Runner> runners;
  Controller c;
  FeedbackLearning settings;

  explicit Task(bool cyclic) {
    for (int i = 0; i < 2; ++i) runners.emplace_back(f.model, simulation, ground, cost);
    c.cyclic = cyclic;
    c.shape = {{.ankles = true}, 3, 1};
    c.reference = reference_of(f, standing_clip(cyclic ? 6 : 60), cyclic ? 0.1 : 1);
    const int ticks = c.reference.ticks;
    c.targets = c.reference.poses.leftCols(ticks);
    c.sensory = Eigen::MatrixXd::Zero(control::full_sensors, ticks);
    c.stance.assign(static_cast<std::size_t>(ticks), 0);
    c.phase.assign(static_cast<std::size_t>(ticks), 0);
    c.law = Eigen::VectorXd::Zero(c.shape.size());
    c.start_pose = c.reference.poses.col(0);
    c.start_velocity = c.reference.velocities.col(0);
    settings.population = 12;
    settings.starts = 8;
    settings.generations = 12;
    settings.validation_episodes = 12;
    settings.validate_every = 3;
    settings.sigma = 0.3;
    settings.starts_moved.root_velocity = 0.6;
    settings.first_perturbation = 0.5;
    settings.one_shot_step = 0.1;
  }
  template <class E>
  FeedbackProgress learn(E&& executor) {
    return control::learn_feedback(runners, c, settings, executor);
  }
  FeedbackProgress learn() { return learn(core::SerialExecutor{}); }

  /// Mean cost of a law on the starts of validation.
  double validate(const Eigen::VectorXd& law) {
    control::EpisodeSettings e;
    e.perturbation = 1;
    e.seconds = settings.last_seconds;
    e.starts = settings.starts_moved;
    e.seed = settings.seed;
    e.stream = 999;
    Controller trial = c;
    trial.law = law;
    core::SerialExecutor serial;
    double sum = 0;
    for (const EpisodeResult& r : control::run_episodes(runners, trial, e, settings.validation_episodes, serial))
      sum += control::episode_cost(r, c.cyclic ? e.seconds : 1.5, c.cyclic);
    return sum / settings.validation_episodes;
  }
};

bool same(const FeedbackProgress& a, const FeedbackProgress& b) {
  return a.generation == b.generation && a.seconds == b.seconds && a.perturbation == b.perturbation && a.mean_cost == b.mean_cost &&
         a.mean_success == b.mean_success && a.best_validation == b.best_validation && a.best_law == b.best_law &&
         a.since_best == b.since_best && a.simulated_seconds == b.simulated_seconds;
}

}  // namespace

TEST_CASE("the cost of an episode") {
  EpisodeResult r;
  r.seconds = 2;
  r.deviation = 0.3;
  r.reached_end = r.held = true;
  CHECK(control::episode_cost(r, 2, true) == doctest::Approx(0.3));
  CHECK(control::episode_cost(r, 8, true) == doctest::Approx(7.5 + 0.3));
  CHECK(control::episode_cost(r, 2, false) == doctest::Approx(0.3));
  r.held = false;
  CHECK(control::episode_cost(r, 2, false) == doctest::Approx(1.3));
  r.reached_end = false;
  CHECK(control::episode_cost(r, 2, false) == doctest::Approx(3.3));
  CHECK(control::episode_cost(r, 2, true) == doctest::Approx(0.3));
  r.slide_m_s = 0.05;
  CHECK(control::episode_cost(r, 2, true, 10) == doctest::Approx(0.8));
  r.deviation = std::nan("");
  CHECK(control::episode_cost(r, 2, true) == 100);
  CHECK(control::episode_cost({}, 2, true) == 20);
}

TEST_CASE("a few generations learn to keep standing") {
  // How far twelve generations get is luck, six times that is not.
  double before = 0, after = 0;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    Task task(false);
    task.settings.seed = seed;
    before += task.validate(task.c.law);
    after += task.validate(task.learn().best_law);
  }
  MESSAGE("validations ", before, " without feedback, ", after, " with");
  CHECK(after < 0.93 * before);
}

TEST_CASE("threads and interruptions do not show in a law") {
  Task task(false);
  std::vector<FeedbackProgress> history;
  std::optional<CmaEs> halfway;
  core::SerialExecutor serial;
  const FeedbackProgress done = control::learn_feedback(
      task.runners, task.c, task.settings, serial, [&](const FeedbackProgress& state, const CmaEs& cma) {
        CHECK(cma.generation() == state.generation);
        history.push_back(state);
        if (state.generation == 4) halfway = cma;
        return true;
      });
  REQUIRE(history.size() == 12);
  CHECK(same(done, history.back()));

  CHECK(task.validate(done.best_law) == doctest::Approx(done.best_validation).epsilon(1e-12));
  for (std::size_t k = 1; k < history.size(); ++k) {
    CHECK(history[k].best_validation <= history[k - 1].best_validation);
    CHECK(history[k].perturbation >= history[k - 1].perturbation);
    CHECK(history[k].perturbation <= 1);
    // Difficulty grows after a success only, by one step or two.
    const double step = history[k].perturbation - history[k - 1].perturbation;
    if (history[k].mean_success < 0.6) CHECK(step == 0);
    CHECK(step < 0.2 + 1e-9);
  }

  core::ThreadExecutor threads(2);
  CHECK(same(task.learn(threads), done));

  std::size_t k = 4;
  const FeedbackProgress resumed = control::learn_feedback(
      task.runners, task.c, task.settings, serial,
      [&](const FeedbackProgress& state, const CmaEs&) {
        CHECK(same(state, history[k++]));
        return true;
      },
      &*halfway, &history[3]);
  CHECK(k == 12);
  CHECK(same(resumed, done));

  const FeedbackProgress stopped = control::learn_feedback(task.runners, task.c, task.settings, serial,
                                                           [](const FeedbackProgress& state, const CmaEs&) { return state.generation < 2; });
  CHECK(same(stopped, history[1]));
}

TEST_CASE("episodes of a cyclic motion grow longer and harder with success, and patience ends it") {
  Task task(true);
  FeedbackLearning& p = task.settings;
  p.population = 4;
  p.starts = 1;
  p.first_seconds = 0.1;
  p.last_seconds = 0.3;
  p.seconds_growth = 1.5;
  p.perturbation_step = 0.4;
  p.validation_episodes = 1;
  p.validate_every = 2;
  p.patience = 4;
  p.generations = 40;
  p.advance = 1e9;
  std::vector<FeedbackProgress> history;
  core::SerialExecutor serial;
  const auto keep = [&](const FeedbackProgress& state, const CmaEs&) {
    history.push_back(state);
    return true;
  };
  const FeedbackProgress done = control::learn_feedback(task.runners, task.c, p, serial, keep);
  REQUIRE(history.size() >= 3);
  CHECK(history[0].seconds == doctest::Approx(0.15));
  CHECK(history[0].perturbation == doctest::Approx(0.4));
  CHECK(history[1].seconds == doctest::Approx(0.225));
  CHECK(history[1].perturbation == doctest::Approx(0.8));
  CHECK(history[2].seconds == doctest::Approx(0.3));
  CHECK(history[2].perturbation == 1);
  CHECK(history[0].simulated_seconds == doctest::Approx(5 * 0.1).epsilon(0.2));
  CHECK((done.generation == 40 || done.since_best >= 4));
  CHECK(done.generation == static_cast<int>(history.size()));

  history.clear();
  p.advance = 0;
  p.generations = 3;
  control::learn_feedback(task.runners, task.c, p, serial, keep);
  CHECK(history.back().seconds == doctest::Approx(0.1));
  CHECK(history.back().perturbation == 0);
}

TEST_CASE("worlds and pushes are drawn within their ranges, the same for the same numbers") {
  const control::WorldRange range;
  double hardest = 0, softest = 1e9, slipperiest = 1e9, finest = 0;
  for (std::uint64_t draw = 0; draw < 300; ++draw) {
    const control::WorldChange own = control::draw_world(range, 1, 5, draw, 0), w = control::draw_world(range, 1, 5, draw, 1),
                               again = control::draw_world(range, 1, 5, draw, 1), still = control::draw_world(range, 0, 5, draw, 2);
    CHECK((own.ground == 1 && own.friction == 1 && own.finer == 1));
    CHECK((still.ground == 1 && still.friction == 1 && still.finer == 1));
    CHECK((w.ground == again.ground && w.friction == again.friction && w.finer == again.finer));
    CHECK((w.ground <= range.harder && w.ground * range.softer >= 1 - 1e-12));
    CHECK((w.friction <= range.friction + 1e-12 && w.friction * range.friction >= 1 - 1e-12));
    CHECK((w.finer >= 1 && w.finer <= range.finer));
    hardest = std::max(hardest, w.ground);
    softest = std::min(softest, w.ground);
    slipperiest = std::min(slipperiest, w.friction);
    finest = std::max(finest, static_cast<double>(w.finer));
    const control::Push p = control::draw_push(8, 2, 1.0 / 60, 5, draw, 3);
    CHECK(norm(p.force) * 0.1 <= 8 + 1e-12);
    CHECK(p.force.z == 0);
    CHECK((p.first_tick >= 0 && p.ticks == 6 && p.first_tick + p.ticks <= 120));
  }
  CHECK((hardest > 0.8 * range.harder && softest < 1 && slipperiest < 0.85 && finest == range.finer));
  CHECK(control::draw_push(0, 2, 1.0 / 60, 5, 1, 3).ticks == 0);
}

TEST_CASE("a law is learned in several worlds, the same on any threads, and the runners are left in their own") {
  Task task(true), alone(true);
  for (Task* t : {&task, &alone}) {
    FeedbackLearning& p = t->settings;
    p.population = 4;
    p.starts = 4;
    p.first_seconds = p.last_seconds = 0.2;
    p.perturbation_step = 1;
    p.validation_episodes = 4;
    p.validate_every = 2;
    p.generations = 4;
    p.advance = 1e9;
    p.worlds = 2;
    p.push = 5;
  }
  const FeedbackProgress one = task.learn(), two = alone.learn(core::ThreadExecutor(2));
  CHECK(one.best_law == two.best_law);
  CHECK(one.mean_cost == two.mean_cost);
  CHECK(one.simulated_seconds == doctest::Approx(two.simulated_seconds));
  // Of the first generation one start in each world; of the others four episodes; validation at the start and twice.
  CHECK(one.simulated_seconds == doctest::Approx(0.2 * (5 * 2 + 3 * 5 * 4 + 3 * 4)).epsilon(0.05));
  const EpisodeResult after = control::run_episodes(task.runners, task.c, {}, 1, *std::make_unique<core::SerialExecutor>())[0];
  Task fresh(true);
  const EpisodeResult before = control::run_episodes(fresh.runners, fresh.c, {}, 1, *std::make_unique<core::SerialExecutor>())[0];
  CHECK(after.deviation == before.deviation);
}

TEST_CASE("settings that cannot be learned with are refused") {
  const auto refusal = [](auto&& spoil) {
    Task task(false);
    spoil(task);
    return error_of([&] { task.learn(); });
  };
  CHECK(contains(refusal([](Task& t) { t.c.shape.rank = 0; }), "expected a law with parameters"));
  CHECK(contains(refusal([](Task& t) { t.settings.population = 3; }), "population"));
  CHECK(contains(refusal([](Task& t) { t.settings.starts = 0; }), "starts"));
  CHECK(contains(refusal([](Task& t) { t.settings.validate_every = 0; }), "validate_every"));
  CHECK(contains(refusal([](Task& t) { t.settings.validation_episodes = 0; }), "validation_episodes"));
  CHECK(contains(refusal([](Task& t) { t.settings.worlds = 0; }), "worlds"));
  CHECK(contains(refusal([](Task& t) { t.settings.changes.harder = 0.5; }), "ratios"));
  CHECK(contains(refusal([](Task& t) { t.settings.push = -1; }), "push"));
  CHECK(contains(refusal([](Task& t) { t.settings.slide = -1; }), "slide"));
}
