// SPDX-License-Identifier: MIT
// A set of 100 000 elites over four task parameters, as full as it gets: an insertion (nearly all are refused or
// replace others), the five nearest of a point, and the density around it.
#include <Eigen/Core>
#include <benchmark/benchmark.h>

#include <traceur/core/random.hpp>
#include <traceur/parameterize/density.hpp>
#include <traceur/parameterize/elite_set.hpp>

namespace {

using traceur::core::RandomStream;
using namespace traceur::parameterize;

void draw(RandomStream& random, Eigen::VectorXd& a) {
  for (Eigen::Index d = 0; d < a.size(); ++d) a(d) = random.uniform();
}

EliteSet<int>& full() {
  static EliteSet<int> elites = [] {
    EliteSetParameters parameters;
    parameters.radius = 0.044;
    EliteSet<int> set(4, parameters);
    RandomStream random(1);
    Eigen::VectorXd a(4);
    for (int i = 0; i < 4000000 && set.size() < 100000; ++i) {
      draw(random, a);
      set.insert(a, random.uniform(0.1, 1.0));
    }
    return set;
  }();
  return elites;
}

void insert(benchmark::State& state) {
  EliteSet<int>& elites = full();
  RandomStream random(2);
  Eigen::VectorXd a(4);
  for (auto _ : state) {
    draw(random, a);
    benchmark::DoNotOptimize(elites.insert(a, random.uniform(0.1, 1.0)));
  }
  state.counters["elites"] = elites.size();
}

void nearest(benchmark::State& state) {
  const EliteSet<int>& elites = full();
  RandomStream random(3);
  Eigen::VectorXd a(4);
  Neighbor found[5];
  for (auto _ : state) {
    draw(random, a);
    elites.nearest(a, found);
    benchmark::DoNotOptimize(found);
  }
}

void density(benchmark::State& state) {
  const EliteSet<int>& elites = full();
  const KernelDensity kernel({0.044, 1.0, 3.0});
  RandomStream random(4);
  Eigen::VectorXd a(4);
  for (auto _ : state) {
    draw(random, a);
    benchmark::DoNotOptimize(kernel(elites, a));
  }
}

}  // namespace

BENCHMARK(insert)->Unit(benchmark::kMicrosecond);
BENCHMARK(nearest)->Unit(benchmark::kMicrosecond);
BENCHMARK(density)->Unit(benchmark::kMicrosecond);
