// SPDX-License-Identifier: MIT
#include <traceur/control/running_search.hpp>

#include <doctest/doctest.h>

#include "moving_gait.hpp"

using namespace figures;

namespace {

using S = core::Pack<float, 4>;

control::RunningSearch small_search() {
  control::RunningSearch p;
  p.run = Sway::settings();
  p.run.cycles = 1;
  p.population = 4;
  p.generations = 2;
  p.check_every = 1;
  p.trials = 4;
  p.good_cost = 0;
  return p;
}

}  // namespace

TEST_CASE("a search returns nothing worse than it was given, the same for the same seed, and symmetric for straight ahead") {
  const Sway s;
  control::RunningTrials<S> trials(s.f.model, s.f.roles, s.parameters, s.ground, s.c, s.gait);
  const control::RunningSearch p = small_search();
  const control::RunningTask stand{};
  const control::RunningJudgement before = control::judge_running(trials, stand, s.numbers, p, p.trials, 1);
  const control::RunningFound a = control::search_running(trials, s.gait.shape, stand, s.numbers, p);
  const control::RunningFound b = control::search_running(trials, s.gait.shape, stand, s.numbers, p);
  CHECK(a.judgement.cost <= before.cost);
  CHECK(a.control == b.control);
  CHECK(a.control.isApprox(s.gait.shape.symmetric(a.control), 1e-14));
  CHECK(a.generations == 2);
  // Judged at the beginning and after each generation; two runs of each candidate.
  CHECK(a.runs == 3 * p.trials + 2 * p.population * p.starts);
  CHECK(before.survived == 1);
  CHECK(a.works);
}

TEST_CASE("a control that does what is asked for well enough is returned as it is") {
  const Sway s;
  control::RunningTrials<S> trials(s.f.model, s.f.roles, s.parameters, s.ground, s.c, s.gait);
  control::RunningSearch p = small_search();
  p.good_cost = 100;
  const control::RunningFound a = control::search_running(trials, s.gait.shape, {}, s.numbers, p);
  CHECK(a.generations == 0);
  CHECK(a.control == s.numbers);
}

TEST_CASE("who does not run at the speed asked for has not solved the task") {
  const Sway s;
  control::RunningTrials<S> trials(s.f.model, s.f.roles, s.parameters, s.ground, s.c, s.gait);
  control::RunningSearch p = small_search();
  const control::RunningJudgement j = control::judge_running(trials, {0, 1.5}, s.numbers, p, 4, 1);
  CHECK(j.share == 0);
}
