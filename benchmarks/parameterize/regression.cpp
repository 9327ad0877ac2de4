// SPDX-License-Identifier: MIT
// What a curriculum asks of 10 000 elites over four task parameters: the weighted mean of the five nearest, 200 numbers each (Lee
// et al. 2021, Eq. 14), and a hundred draws of one Markov chain by Eq. 17 over their density.
#include <limits>

#include <Eigen/Core>
#include <benchmark/benchmark.h>

#include <traceur/core/random.hpp>
#include <traceur/parameterize/density.hpp>
#include <traceur/parameterize/elite_set.hpp>
#include <traceur/parameterize/metropolis.hpp>
#include <traceur/parameterize/neighbor_regression.hpp>

namespace {

using namespace traceur::parameterize;
using Elites = EliteSet<Eigen::VectorXd>;

const Elites& elites() {
  static const Elites all = [] {
    EliteSetParameters parameters;
    parameters.radius = 0.05;
    Elites set(4, parameters);
    traceur::core::RandomStream random(1);
    Eigen::VectorXd a(4);
    for (int i = 0; i < 100000 && set.size() < 10000; ++i) {
      for (double& x : a) x = random.uniform();
      set.insert(a, random.uniform(0.1, 1.0), Eigen::VectorXd::Constant(200, a.sum()));
    }
    return set;
  }();
  return all;
}

void regression(benchmark::State& state) {
  const NeighborRegression regress;
  traceur::core::RandomStream random(2);
  Eigen::VectorXd a(4);
  for (auto _ : state) {
    for (double& x : a) x = random.uniform();
    benchmark::DoNotOptimize(regress(elites(), a));
  }
  state.counters["elites"] = elites().size();
}

void chain(benchmark::State& state) {
  const KernelDensity density;
  MetropolisParameters p;
  p.draws = 100;
  p.step = Eigen::VectorXd::Constant(4, 0.1);
  const Eigen::MatrixXd start = Eigen::MatrixXd::Constant(4, 1, 0.5);
  const auto log_density = [&](const Eigen::VectorXd& a) {
    if (a.minCoeff() < 0 || a.maxCoeff() > 1) return -std::numeric_limits<double>::infinity();
    return refinement_log_density(density(elites(), a), 1.0);
  };
  for (auto _ : state) {
    benchmark::DoNotOptimize(metropolis(log_density, start, p));
    ++p.run;
  }
}

}  // namespace

BENCHMARK(regression)->Unit(benchmark::kMicrosecond);
BENCHMARK(chain)->Unit(benchmark::kMicrosecond);
