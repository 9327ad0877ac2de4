// SPDX-License-Identifier: MIT
#include <traceur/parameterize/continuation.hpp>

#include <algorithm>
#include <cmath>
#include <sstream>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/executor.hpp>

#include "support.hpp"

using namespace traceur::parameterize;
using support::fails_with;
using traceur::core::RandomStream;
using traceur::core::SerialExecutor;
using traceur::core::ThreadExecutor;

namespace {

using Vector = Eigen::VectorXd;
using Kind = ContinuationTask::Kind;

/// A skill whose controls work in a basin that moves with the task: |c - c*(theta)| < basin, c* smooth and curved.
/// Beyond `reach` the cost is flat, so an optimisation from there finds nothing. theta = (turn in degrees, speed in
/// m/s).
struct Skill {
  double basin = 0.12;
  double reach = 0.6;
  /// No control turns sharply at full speed, where this is positive.
  double cut = 1e9;

  static Vector best(const Vector& theta) {
    const double turn = theta(0) / 6.0, speed = (theta(1) - 3.5) / 1.5;
    Vector c(4);
    c << 0.8 * turn + 0.3 * turn * speed, speed + 0.25 * speed * speed, std::sin(1.2 * speed) + 0.3 * turn * turn,
        0.5 * std::exp(0.4 * speed) * turn;
    return c;
  }
  bool possible(const Vector& theta) const { return std::abs(theta(0)) / 6.0 + theta(1) / 5.0 < cut; }
  double distance(const ContinuationTask& task, const Vector& control) const {
    return possible(task.parameter) ? (control - best(task.parameter)).norm() : 1e3;
  }

  /// The optimiser is a (1+1) evolution strategy with the one-fifth rule, so an optimisation costs what it costs.
  ContinuationResult operator()(const ContinuationTask& task) const {
    ContinuationResult result;
    result.control = task.control;
    result.cost = distance(task, task.control);
    if (task.kind == Kind::optimize) {
      RandomStream random(9, static_cast<std::uint64_t>(task.node));
      double sigma = 0.1;
      Vector trial = task.control;
      while (result.cost > 0.02 && result.evaluations < 600) {
        for (Eigen::Index i = 0; i < 4; ++i) trial(i) = result.control(i) + sigma * random.normal();
        const double cost = std::min(distance(task, trial), reach);
        ++result.evaluations;
        if (cost < result.cost) {
          result.control = trial;
          result.cost = cost;
          sigma *= 1.5;
        } else {
          sigma *= 0.9;
        }
      }
    }
    result.works = result.cost < basin;
    return result;
  }
};

ContinuationParameters plane(int turns = 13, int speeds = 13) {
  ContinuationParameters p;
  p.axes = {Vector::LinSpaced(turns, -6.0, 6.0), Vector::LinSpaced(speeds, 2.0, 5.0)};
  p.unit = Vector(2);
  p.unit << 6.0, 1.5;
  return p;
}

Continuation start(const ContinuationParameters& p) {
  Vector seed(2);
  seed << 0.0, 3.5;
  return Continuation(p, seed, Skill::best(seed));
}

/// The share of a finer grid on which the model's control works.
double covers(const Continuation& c, const Skill& skill, int steps) {
  const Rbf model = c.model();
  int good = 0, all = 0;
  ContinuationTask task;
  task.parameter.resize(2);
  for (int i = 0; i <= steps; ++i) {
    for (int j = 0; j <= steps; ++j) {
      task.parameter << -6.0 + 12.0 * i / steps, 2.0 + 3.0 * j / steps;
      if (!skill.possible(task.parameter)) continue;
      ++all;
      good += skill.distance(task, model(task.parameter)) < skill.basin;
    }
  }
  return static_cast<double>(good) / all;
}

std::string saved(const Continuation& c) {
  std::ostringstream out;
  c.save(out);
  return out.str();
}

Continuation loaded(const std::string& text) {
  std::istringstream in(text);
  return Continuation::load(in);
}

}  // namespace

TEST_CASE("continuation: extrapolation covers the plane with less than half the evaluations of axis by axis") {
  SerialExecutor serial;
  const Skill skill;
  ContinuationParameters p = plane();
  Continuation ours = start(p);
  run(ours, skill, serial);
  p.kernel = Kernel::cubic;
  Continuation smooth = start(p);
  run(smooth, skill, serial);
  CHECK(smooth.coverage() == 1.0);
  p.strategy = Strategy::axis_by_axis;
  Continuation baseline = start(p);
  run(baseline, skill, serial);

  MESSAGE("evaluations: " << ours.evaluations() << " by extrapolation (" << ours.optimizations() << " optimisations, "
                          << ours.tests() << " tests, " << ours.rounds() << " rounds), " << smooth.evaluations()
                          << " with r^3, " << baseline.evaluations() << " axis by axis (" << baseline.optimizations()
                          << ")");
  CHECK(ours.coverage() == 1.0);
  CHECK(baseline.coverage() == 1.0);
  CHECK(baseline.optimizations() == ours.node_count() - 1);
  CHECK(2 * ours.evaluations() < baseline.evaluations());
  CHECK(smooth.evaluations() < ours.evaluations());
  // Of every node the last prediction works; between nodes it nearly always does.
  for (int node = 0; node < ours.node_count(); ++node) {
    ContinuationTask task{Kind::test, node, ours.parameter(node), ours.model()(ours.parameter(node))};
    CHECK(skill(task).works);
    task.control = ours.control(node);
    CHECK(skill(task).works);
  }
  CHECK(covers(ours, skill, 40) > 0.97);
}

TEST_CASE("continuation: in one dimension, from the end of the axis") {
  SerialExecutor serial;
  ContinuationParameters p;
  p.axes = {Vector::LinSpaced(31, 0.1, 0.7)};
  // Beyond its centres the spline goes on as it ended; the interpolant by r goes on along the chord of first and last.
  p.kernel = Kernel::cubic;
  // A control that bends as the obstacle gets higher; the cost of an optimisation is what its distance makes it.
  const auto best = [](double h) { return Vector::Constant(1, 5.0 * h * h); };
  const auto skill = [&](const ContinuationTask& task) {
    ContinuationResult result;
    const double distance = std::abs(task.control(0) - best(task.parameter(0))(0));
    result.works = distance < (task.kind == Kind::test ? 0.05 : 0.5);
    result.control = best(task.parameter(0));
    result.evaluations = task.kind == Kind::test ? 1 : 50;
    return result;
  };
  Continuation c(p, p.axes[0].head(1), best(0.1));
  run(c, skill, serial);
  CHECK(c.coverage() == 1.0);
  CHECK(c.optimizations() < 10);
  CHECK(c.status(0) == NodeStatus::solved);
  CHECK(c.tested_round(c.seed()) == 0);
  for (int node = 1; node < c.node_count(); ++node) {
    CHECK(c.tested_round(node) >= 1);
    CHECK(c.tested_round(node) <= c.rounds());
  }
}

TEST_CASE("continuation: what cannot be done is left as failed, all around it is found, and it ends") {
  SerialExecutor serial;
  Skill skill;
  skill.cut = 1.5;
  for (const Strategy strategy : {Strategy::predictor_corrector, Strategy::axis_by_axis}) {
    ContinuationParameters p = plane();
    p.strategy = strategy;
    Continuation c = start(p);
    run(c, skill, serial);
    for (int node = 0; node < c.node_count(); ++node) {
      const bool works = c.status(node) == NodeStatus::solved || c.status(node) == NodeStatus::extrapolated;
      // A ray that meets the impossible ends there, so what lies behind is out of the baseline's reach.
      if (works || strategy == Strategy::predictor_corrector) CHECK(works == skill.possible(c.parameter(node)));
    }
  }
}

TEST_CASE("continuation: once less is asked, what failed is reached, and what worked keeps what it has") {
  SerialExecutor serial;
  Skill hard;
  hard.cut = 1.5;
  for (const Strategy strategy : {Strategy::predictor_corrector, Strategy::axis_by_axis}) {
    for (const bool interrupted : {false, true}) {
      ContinuationParameters p = plane();
      p.strategy = strategy;
      p.max_evaluations = interrupted ? 300 : 0;
      Continuation c = start(p);
      run(c, hard, serial);
      const Continuation before = c;
      REQUIRE(before.coverage() < 1.0);
      c.retry();
      CHECK(c.coverage() == before.coverage());
      CHECK(c.evaluations() == before.evaluations());
      CHECK(!c.finished());
      CHECK(saved(loaded(saved(c))) == saved(c));
      if (interrupted) continue;
      run(c, Skill(), serial);
      CHECK(c.coverage() == 1.0);
      for (int node = 0; node < c.node_count(); ++node)
        if (before.status(node) == NodeStatus::solved) CHECK(c.control(node) == before.control(node));
    }
  }
}

TEST_CASE("continuation: the counts add up, and a budget ends it") {
  SerialExecutor serial;
  ContinuationParameters p = plane();
  p.max_evaluations = 1500;
  Continuation c = start(p);
  std::int64_t sum = 0, jobs = 0;
  run(
      c,
      [&](const ContinuationTask& task) {
        const ContinuationResult result = Skill()(task);
        sum += result.evaluations;
        ++jobs;
        CHECK(task.parameter == c.parameter(task.node));
        return result;
      },
      serial);
  CHECK(c.evaluations() == sum);
  CHECK(c.tests() + c.optimizations() == jobs);
  CHECK(sum >= 1500);
  CHECK(c.ask().empty());
  CHECK(c.count(NodeStatus::solved) + c.count(NodeStatus::extrapolated) + c.count(NodeStatus::failed) +
            c.count(NodeStatus::untried) ==
        c.node_count());
}

TEST_CASE("continuation: any number of threads gives the same bits, and so does a saved one that goes on") {
  ThreadExecutor threads(3);
  for (const Strategy strategy : {Strategy::predictor_corrector, Strategy::axis_by_axis}) {
    ContinuationParameters p = plane(7, 9);
    p.strategy = strategy;
    Continuation whole = start(p);
    Continuation threaded = start(p);
    run(threaded, Skill(), threads);
    Continuation resumed = start(p);
    while (!whole.finished()) {
      resumed = loaded(saved(resumed));
      REQUIRE(saved(resumed) == saved(whole));
      std::vector<ContinuationResult> results;
      for (const ContinuationTask& task : whole.ask()) results.push_back(Skill()(task));
      whole.tell(results);
      resumed.tell(results);
    }
    CHECK(saved(threaded) == saved(whole));
    CHECK(loaded(saved(whole)).finished());
  }
}

TEST_CASE("continuation: a damaged file is refused with the name of the field") {
  const std::string text = saved(start(plane(3, 3)));
  CHECK(fails_with([&] { loaded(text.substr(0, text.size() / 2)); }, "Continuation: load: field"));
  CHECK(fails_with([&] { loaded("traceur.cma_es.1\n"); }, "traceur.continuation.1"));
  const auto with = [&](const char* field, const char* number) {
    std::string other = text;
    const std::size_t at = other.find(std::string("\n") + field + " ") + 1;
    other.replace(at, other.find('\n', at) - at, std::string(field) + " " + number);
    return [other] { loaded(other); };
  };
  CHECK(fails_with(with("strategy", "0000000000000007"), "field 'strategy'"));
  CHECK(fails_with(with("controls", "000000000000000x"), "16 hexadecimal digits"));
  CHECK(fails_with(with("solved", "0000000000000002"), "field 'solved'"));
  CHECK(fails_with(with("axes", "0000000000000000"), "field 'axes'"));
}

TEST_CASE("continuation: what does not fit is refused") {
  Vector seed(2);
  seed << 0.0, 3.5;
  const auto made = [&](const ContinuationParameters& p, const Vector& at, const Vector& control) {
    return [=] { Continuation(p, at, control); };
  };
  ContinuationParameters p = plane();
  CHECK(fails_with(made(p, Vector::Constant(2, 3.3), Vector::Ones(1)), "seed"));
  CHECK(fails_with(made(p, seed, Vector()), "control"));
  p.axes[1](3) = 10.0;
  CHECK(fails_with(made(p, seed, Vector::Ones(1)), "axes: expected increasing values in axis 1"));
  p = plane();
  p.max_attempts = 0;
  CHECK(fails_with(made(p, seed, Vector::Ones(1)), "max_attempts"));
  p = plane();
  p.unit = Vector::Ones(3);
  CHECK(fails_with(made(p, seed, Vector::Ones(1)), "unit"));
  Continuation c = start(plane());
  std::vector<ContinuationResult> results;
  CHECK(fails_with([&] { c.tell(results); }, "results"));
  results.resize(c.ask().size());
  results[0].evaluations = 0;
  CHECK(fails_with([&] { c.tell(results); }, "result 0"));
  CHECK(c.evaluations() == 0);
}
