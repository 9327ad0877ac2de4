// SPDX-License-Identifier: MIT
#include <traceur/parameterize/curriculum.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include "spreading.hpp"
#include "support.hpp"

using namespace traceur::parameterize;
using support::fails_with;
using traceur::core::RandomStream;

static_assert(MarginalValue<LocalValue>);
static_assert(!MarginalValue<KernelDensity>);

namespace {

using spreading::Attempts;
using spreading::Skill;
using spreading::square;
using spreading::Vector;

double explored_after(Schedule schedule, std::uint64_t seed, int batches) {
  double explored = 0.0;
  spreading::practise(schedule, seed, batches, [&](int b, const Curriculum<int>& c) {
    if (b + 1 == batches) explored = c.explored();
  });
  return explored;
}

/// Tells a batch in which `discoveries` new elites appear, at places never used before.
void tell_discoveries(Curriculum<int>& curriculum, int discoveries, int& place) {
  curriculum.ask();
  Attempts attempts;
  for (int i = 0; i < discoveries; ++i, ++place) {
    Attempt<int> attempt;
    attempt.achieved = Vector(2);
    attempt.achieved << 0.1 * (place % 100), 0.1 * (place / 100);
    attempt.fitness = 1.0;
    attempts.push_back(attempt);
  }
  curriculum.tell(std::move(attempts));
}

CurriculumParameters wide(Schedule schedule) {
  CurriculumParameters p;
  p.lower = Vector::Zero(2);
  p.upper = Vector::Constant(2, 10.0);
  p.start = Vector::Zero(2);
  p.elites.radius = 0.05;
  p.density.bandwidth = 0.106;
  p.schedule = schedule;
  p.trials = 200;
  p.batch = 2;
  return p;
}

}  // namespace

TEST_CASE("curriculum: a skill that spreads is covered by the paper's method, less by the others") {
  double mean[5] = {};
  for (const Schedule schedule :
       {Schedule::adaptive, Schedule::uniform, Schedule::explore_first, Schedule::alternating}) {
    for (const std::uint64_t seed : {1u, 2u, 3u}) {
      const double explored = explored_after(schedule, seed, 100);
      mean[static_cast<int>(schedule)] += explored / 3.0;
      if (schedule == Schedule::adaptive) CHECK(explored > 0.97);
    }
  }
  const double adaptive = mean[0], uniform = mean[1], explore_first = mean[2], alternating = mean[4];
  MESSAGE("explored: adaptive " << adaptive << ", alternating " << alternating << ", explore first " << explore_first
                                << ", uniform " << uniform);
  CHECK(alternating < 0.85 * adaptive);
  CHECK(explore_first < 0.8 * alternating);
  CHECK(uniform < 0.8 * alternating);
  CHECK(explored_after(Schedule::mastering, 1, 120) > 0.9);
}

TEST_CASE("curriculum: exploration draws from the rim, refinement from the known") {
  for (const Schedule schedule : {Schedule::adaptive, Schedule::uniform}) {
    CurriculumParameters p = square(schedule);
    Curriculum<int> curriculum(p);
    Skill skill(p.start);
    CHECK(curriculum.density(p.start) == 0.0);
    int rim = 0, known = 0;
    for (int b = 0; b < 40; ++b) {
      const Eigen::MatrixXd tasks = curriculum.ask();
      CHECK(curriculum.ask() == tasks);
      REQUIRE(tasks.cols() == 20);
      const bool unfinished = curriculum.explored(200) < 0.9;
      for (Eigen::Index i = 0; i < tasks.cols(); ++i) {
        const Vector a = tasks.col(i);
        CHECK((a.minCoeff() >= 0.0 && a.maxCoeff() <= 1.0));
        if (schedule == Schedule::uniform || curriculum.elites().size() == 0) continue;
        const double density = curriculum.density(a);
        if (curriculum.batch_phase() == Phase::refine) {
          CHECK(density > 0.8);
          ++known;
        } else if (unfinished) {
          CHECK((density > 0.2 && density < 0.8));
          ++rim;
        }
      }
      curriculum.tell(skill.practise(tasks, RandomStream(5, 0, static_cast<std::uint64_t>(b))));
      if (b == 0 && schedule == Schedule::adaptive) CHECK(tasks.col(3) == p.start);
    }
    if (schedule == Schedule::adaptive) CHECK((rim > 0 && known > 0));
  }
}

TEST_CASE("curriculum: phases change when the other one finds more, not before the least length") {
  CurriculumParameters p = wide(Schedule::adaptive);
  Curriculum<int> curriculum(p);
  int place = 0;
  const auto run = [&](int rim, int known, int batches) {
    for (int b = 0; b < batches; ++b)
      tell_discoveries(curriculum, curriculum.batch_phase() == Phase::explore ? rim : known, place);
  };
  // The rim finds more: exploration goes on, with a probe of 2 after every 10.
  run(6, 2, 10);
  CHECK(curriculum.phase() == Phase::explore);
  CHECK(curriculum.batch_phase() == Phase::refine);
  run(6, 2, 2);
  CHECK(curriculum.batch_phase() == Phase::explore);
  run(6, 2, 38);
  CHECK(curriculum.phase() == Phase::explore);
  CHECK(curriculum.exploration_rate(Phase::explore) == 6.0);
  CHECK(curriculum.exploration_rate(Phase::refine) == 2.0);
  // The rim dries up.
  run(0, 2, 10);
  CHECK(curriculum.phase() == Phase::refine);
  CHECK(curriculum.phase_batches() < 10);
  // However much the rim has, a phase lasts 10; then a probe shows it.
  run(9, 2, 5);
  CHECK(curriculum.phase() == Phase::refine);
  run(9, 2, 30);
  CHECK(curriculum.phase() == Phase::explore);
}

TEST_CASE("curriculum: the baselines' phases") {
  const auto phases = [](CurriculumParameters p, int batches, double value) {
    Curriculum<int> curriculum(p);
    std::string letters;
    int place = 0;
    for (int b = 0; b < batches; ++b) {
      curriculum.ask();
      letters += curriculum.batch_phase() == Phase::explore ? 'e' : 'r';
      Attempts attempts(1);
      attempts[0].achieved = Vector::Constant(2, 0.1 * place++);
      attempts[0].fitness = 1.0;
      attempts[0].value = value;
      curriculum.tell(std::move(attempts));
    }
    return letters;
  };
  CurriculumParameters p = wide(Schedule::alternating);
  p.alternation = 3;
  CHECK(phases(p, 10, 0.0) == "eeerrreeer");
  p = wide(Schedule::explore_first);
  p.trials = 3000;
  p.upper = Vector::Ones(2);
  CHECK(phases(p, 10, 0.0) == "eeeeeeeeee");
  p.upper = Vector::Constant(2, 0.03);
  CHECK(phases(p, 4, 0.0) == "eerr");
  // Mastered at once, so it explores; never mastered, so only the time limit ends a phase.
  p = wide(Schedule::mastering);
  p.mastery = 0.5;
  p.timeout = 4;
  p.least = 2;
  CHECK(phases(p, 9, 1.0) == "reeeereee");
  CHECK(phases(p, 9, 0.0) == "rrrreerrr");
}

TEST_CASE("curriculum: the same seed and episodes give the same tasks") {
  for (const std::uint64_t seed : {3u, 4u}) {
    Curriculum<int> a(square(Schedule::adaptive, 3)), b(square(Schedule::adaptive, seed));
    Skill skill_a(a.parameters().start), skill_b(b.parameters().start);
    bool same = true;
    for (std::uint64_t i = 0; i < 25; ++i) {
      same = same && a.ask() == b.ask();
      a.tell(skill_a.practise(a.ask(), RandomStream(1, 0, i)));
      b.tell(skill_b.practise(b.ask(), RandomStream(1, 0, i)));
    }
    CHECK(same == (seed == 3));
  }
}

TEST_CASE("curriculum: hindsight counts what was achieved inside the box, whatever was pursued") {
  Curriculum<int> curriculum(square());
  curriculum.ask();
  Attempts attempts(3);
  attempts[0].achieved = Vector::Constant(2, 0.7);
  attempts[0].fitness = 0.5;
  attempts[0].payload = 11;
  attempts[1].achieved = Vector::Constant(2, 1.01);
  attempts[1].fitness = 1.0;
  attempts[2].achieved = Vector::Constant(2, std::numeric_limits<double>::quiet_NaN());
  attempts[2].fitness = 1.0;
  curriculum.tell(std::move(attempts));
  REQUIRE(curriculum.elites().size() == 1);
  CHECK(curriculum.elites().payload(0) == 11);
  CHECK(curriculum.exploration_rate(Phase::explore) == 1.0);
}

TEST_CASE("local value: a local mean that forgets") {
  LocalValue value(Vector::Ones(1), 0.1, 100);
  const auto at = [](double x) { return Vector::Constant(1, x); };
  CHECK(value.value(at(0.3)) == 0.0);
  for (int i = 0; i < 50; ++i) {
    value.add(at(0.0), 1.0);
    value.add(at(1.0), 3.0);
  }
  value.add(at(0.0), std::numeric_limits<double>::quiet_NaN());
  CHECK(value.value(at(0.0)) == doctest::Approx(1.0).epsilon(0.01));
  CHECK(value.value(at(1.0)) == doctest::Approx(3.0).epsilon(0.01));
  CHECK(value.value(at(50.0)) == doctest::Approx(2.0));
  for (int i = 0; i < 100; ++i) value.add(at(0.0), 5.0);
  CHECK(value.value(at(0.0)) == doctest::Approx(5.0));
  CHECK(value.value(at(1.0)) == doctest::Approx(5.0));
  CHECK(fails_with([] { LocalValue(Vector::Ones(1), 0.0); }, "bandwidth"));
  CHECK(fails_with([] { LocalValue(Vector::Ones(1), 0.1, 0); }, "memory"));
}

TEST_CASE("fitness: Eq. 10") {
  const double none[] = {0.0, 0.0, 0.0, 0.0};
  CHECK(fitness(none, fitness_sigmas) == 1.0);
  CHECK(fitness(none, fitness_sigmas, 0.5) == doctest::Approx(1.05));
  const double some[] = {2.67 * 2.67, 0.0, 0.0, 2.0 * 0.49};
  CHECK(fitness(some, fitness_sigmas) == doctest::Approx(std::exp(-3.0)));
}

TEST_CASE("curriculum: what does not fit is refused") {
  const auto with = [](auto change) {
    return [=] {
      CurriculumParameters p = square();
      change(p);
      Curriculum<int> curriculum(p);
    };
  };
  using P = CurriculumParameters&;
  CHECK(fails_with(with([](P p) { p.upper = Vector::Ones(3); }), "lower, upper, start"));
  CHECK(fails_with(with([](P p) { p.upper(1) = 0.0; }), "lower"));
  CHECK(fails_with(with([](P p) { p.start(0) = 2.0; }), "start"));
  CHECK(fails_with(with([](P p) { p.light = 0.9; }), "light"));
  CHECK(fails_with(with([](P p) { p.batch = 0; }), "batch"));
  CHECK(fails_with(with([](P p) { p.elites.radius = -1.0; }), "radius"));
  const CurriculumParameters code = published_code(Vector::Zero(2), Vector::Constant(2, 2.0), Vector::Ones(2));
  CHECK_NOTHROW(Curriculum<int>{code});
  Curriculum<int> curriculum(square());
  CHECK(fails_with([&] { curriculum.tell(Attempts()); }, "ask before"));
  curriculum.ask();
  Attempts attempts(1);
  attempts[0].achieved = Vector::Zero(2);
  attempts[0].task = 20;
  CHECK(fails_with([&] { curriculum.tell(std::move(attempts)); }, "attempt 0"));
}
