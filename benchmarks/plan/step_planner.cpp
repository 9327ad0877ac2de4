// SPDX-License-Identifier: MIT
// A plan of the speeds of so many steps up to an obstacle (Terrain Runner, Eq. 15 in closed form), as it is made anew at every
// step, and the turn of the next one.
#include <benchmark/benchmark.h>

#include <traceur/core/random.hpp>
#include <traceur/plan/step_planner.hpp>

namespace {

using namespace traceur;

template <class S>
void plan_steps(benchmark::State& state) {
  plan::StepPlanner<S> planner;
  core::RandomStream random(1);
  const auto steps = static_cast<S>(state.range(0));
  const S length = planner.parameters().length(S(3.5));
  for (auto _ : state) {
    const S distance = 1 + length * (steps + random.uniform<S>(S(-0.4), S(0.4)));
    auto p = planner.plan(distance, random.uniform<S>(S(3.3), S(3.7)), {S(1), S(3.5)});
    benchmark::DoNotOptimize(p);
  }
}

void turn(benchmark::State& state) {
  const plan::DirectionTracker<double> tracker;
  core::RandomStream random(2);
  for (auto _ : state) benchmark::DoNotOptimize(tracker.turn(random.uniform(-1, 1), 0.0, random.uniform(-2, 2)));
}

}  // namespace

BENCHMARK_TEMPLATE(plan_steps, double)->Arg(1)->Arg(10)->Arg(100);
BENCHMARK_TEMPLATE(plan_steps, float)->Arg(10);
BENCHMARK(turn);
