// SPDX-License-Identifier: MIT
// A path from corner to corner of a terrain of n by n cells, by PARC's costs. `plan` searches a graph that is there,
// with new noise each time; `graph_and_plan` also makes the graph, as for a terrain seen for the first time. Terrains
// are random boxes, as many per area as on PARC's 16 by 16 ones (many cliffs, many jumps), and random walks.
#include <cstdint>
#include <vector>

#include <benchmark/benchmark.h>

#include <traceur/core/random.hpp>
#include <traceur/plan/a_star.hpp>
#include <traceur/plan/navigation_graph.hpp>
#include <traceur/terrain/generators.hpp>

namespace {

using namespace traceur;

terrain::HeightGrid boxes(int n) {
  terrain::RandomBoxes p;
  p.nx = p.ny = n;
  p.boxes = 10 * n * n / 256;
  core::RandomStream random(7);
  return terrain::random_boxes(p, random);
}

terrain::HeightGrid walks(int n) {
  terrain::RandomWalks p;
  p.nx = p.ny = n;
  p.paths = 10 * n * n / 1024;
  core::RandomStream random(7);
  return terrain::random_walks(p, random);
}

void count(benchmark::State& state, const plan::NavigationGraph& graph, const plan::PathPlanner& planner) {
  state.counters["edges"] = graph.edge_count();
  state.counters["expanded"] = planner.expanded();
}

void plan_only(benchmark::State& state, terrain::HeightGrid (*make)(int)) {
  const plan::NavigationGraph graph(make(static_cast<int>(state.range(0))));
  plan::PathPlanner planner;
  std::vector<int> path;
  std::uint64_t step = 0;
  for (auto _ : state) benchmark::DoNotOptimize(planner.plan(graph, 0, graph.size() - 1, 1, step++, path));
  count(state, graph, planner);
}

void graph_and_plan(benchmark::State& state, terrain::HeightGrid (*make)(int)) {
  const terrain::HeightGrid grid = make(static_cast<int>(state.range(0)));
  plan::PathPlanner planner;
  std::vector<int> path;
  std::uint64_t step = 0;
  for (auto _ : state) {
    const plan::NavigationGraph graph(grid);
    benchmark::DoNotOptimize(planner.plan(graph, 0, graph.size() - 1, 1, step++, path));
    count(state, graph, planner);
  }
}

}  // namespace

BENCHMARK_CAPTURE(plan_only, boxes, boxes)->Arg(16)->Arg(100)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(plan_only, walks, walks)->Arg(32)->Arg(100)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(graph_and_plan, boxes, boxes)->Arg(16)->Arg(100)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(graph_and_plan, walks, walks)->Arg(32)->Arg(100)->Unit(benchmark::kMillisecond);
