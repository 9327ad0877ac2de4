// SPDX-License-Identifier: MIT
// The snippets of docs/parameterize.md, compiled and run. Keep the two alike.
#include <cmath>
#include <utility>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/parameterize/continuation.hpp>
#include <traceur/parameterize/curriculum.hpp>
#include <traceur/parameterize/density.hpp>
#include <traceur/parameterize/elite_set.hpp>
#include <traceur/parameterize/metropolis.hpp>
#include <traceur/parameterize/neighbor_regression.hpp>
#include <traceur/parameterize/rbf.hpp>

using namespace traceur::parameterize;

TEST_CASE("docs/parameterize.md: rbf") {
  Eigen::MatrixXd tasks(2, 4), controls(3, 4);  // a column each: turn (degrees), speed (m/s)
  tasks.row(0) << 0, 6, 0, 6;
  tasks.row(1) << 2, 2, 5, 5;
  controls.row(0) << 0.0, 0.4, 0.1, 0.6;
  controls.row(1) << 0.3, 0.3, 0.9, 0.8;
  controls.row(2) << 0.0, 0.1, 0.0, 0.2;
  RbfParameters parameters;
  parameters.unit = Eigen::Vector2d(6, 3);
  const Rbf rbf(tasks, controls, parameters);
  const Eigen::VectorXd control = rbf(Eigen::Vector2d(2, 3.5));  // in between
  const Eigen::VectorXd guess = rbf(Eigen::Vector2d(7, 5.5));    // and beyond

  const float task[] = {2, 3.5f};  // any scalar, without allocation: floats, packs, dual numbers
  float out[3];
  rbf.evaluate<float>(task, out);

  CHECK((control(0) > 0.0 && control(0) < 0.6));
  CHECK(guess(0) > 0.6);
  CHECK(out[1] == doctest::Approx(control(1)).epsilon(1e-5));
}

TEST_CASE("docs/parameterize.md: continuation") {
  const Eigen::VectorXd known_control = Eigen::VectorXd::Constant(1, 3.5);
  const auto best = [](const Eigen::VectorXd& task) { return task(1) + 0.01 * task(0) * task(0); };
  const auto runs_well = [&](const Eigen::VectorXd& task, const Eigen::VectorXd& control) {
    return std::abs(control(0) - best(task)) < 0.1;
  };
  const auto optimised = [&](const Eigen::VectorXd& task, const Eigen::VectorXd& from) {
    ContinuationResult result;
    result.works = std::abs(from(0) - best(task)) < 1.0;
    result.control = Eigen::VectorXd::Constant(1, best(task));
    result.evaluations = 100;
    return result;
  };

  ContinuationParameters grid;
  grid.axes = {Eigen::VectorXd::LinSpaced(13, -6, 6), Eigen::VectorXd::LinSpaced(13, 2, 5)};
  grid.unit = Eigen::Vector2d(6, 1.5);
  Continuation continuation(grid, Eigen::Vector2d(0, 3.5), known_control);

  const auto solver = [&](const ContinuationTask& task) {
    ContinuationResult result;
    if (task.kind == ContinuationTask::Kind::test) {
      result.works = runs_well(task.parameter, task.control);
    } else {
      result = optimised(task.parameter, task.control);  // CMA-ES from this control; counts its evaluations
    }
    return result;
  };
  traceur::core::ThreadExecutor threads;
  run(continuation, solver, threads);
  const Eigen::VectorXd control = continuation.model()(Eigen::Vector2d(1.7, 4.2));

  CHECK(continuation.coverage() == 1.0);
  CHECK(runs_well(Eigen::Vector2d(1.7, 4.2), control));
}

TEST_CASE("docs/parameterize.md: elite_set, neighbor_regression, density, metropolis") {
  const Eigen::VectorXd motion_of_it = Eigen::VectorXd::Ones(7);
  EliteSet<Eigen::VectorXd> kept(2);
  {
    const Eigen::VectorXd& motion = motion_of_it;

    EliteSetParameters parameters;
    parameters.radius = 0.1;
    EliteSet<Eigen::VectorXd> elites(2, parameters);  // two task parameters; a motion comes with each
    const EliteOutcome outcome = elites.insert(Eigen::Vector2d(1.0, 1.2), 0.6, motion);
    // outcome.accepted, outcome.replaced; outcome.discovery is what the exploration rate counts
    Neighbor nearest[5];
    const int found = elites.nearest(Eigen::Vector2d(1.1, 1.2), nearest);

    CHECK(outcome.discovery);
    CHECK(found == 1);
    kept = elites;
  }
  const EliteSet<Eigen::VectorXd>& elites = kept;

  const Eigen::Vector2d task(1.1, 1.2);
  const NeighborRegression regression;
  const Eigen::VectorXd motion = regression(elites, task);
  const KernelDensity density;
  const bool known = density(elites, task) > 0.8;
  MetropolisParameters walk;
  walk.step = Eigen::Vector2d(0.1, 0.1);
  const auto log_density = [&](const Eigen::VectorXd& a) { return std::log(density(elites, a)); };
  const Eigen::MatrixXd drawn = metropolis(log_density, elites.parameter(0), walk);  // 2 by 100

  CHECK(motion == motion_of_it);
  CHECK(known);
  CHECK(drawn.cols() == 100);
}

TEST_CASE("docs/parameterize.md: curriculum") {
  const auto practise = [](int task, const Eigen::VectorXd& a) {
    Attempt<Eigen::VectorXd> attempt;
    attempt.task = task;
    attempt.achieved = a;
    attempt.fitness = attempt.value = 0.5;
    return attempt;
  };

  CurriculumParameters parameters;
  parameters.lower = Eigen::Vector2d(0.8, 0.2);  // energy, gravity
  parameters.upper = Eigen::Vector2d(1.8, 1.65);
  parameters.start = Eigen::Vector2d(1.0, 1.0);  // the reference motion's
  Curriculum<Eigen::VectorXd> curriculum(parameters);
  for (int batch = 0; batch < 10; ++batch) {
    std::vector<Attempt<Eigen::VectorXd>> attempts;
    const Eigen::MatrixXd& tasks = curriculum.ask();  // 2 by 20
    for (int k = 0; k < tasks.cols(); ++k) {
      attempts.push_back(practise(k, tasks.col(k)));  // achieved parameters, fitness, value, motion
    }
    curriculum.tell(std::move(attempts));
  }
  const double explored = curriculum.explored();

  CHECK(explored > 0.5);
}
