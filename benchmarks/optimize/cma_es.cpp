// SPDX-License-Identifier: MIT
// One generation of CMA-ES, ask and tell, with a cost that takes no time: what the optimizer itself adds to a search.
// The dimensions are 10, 40, 100 and 250, for which benchmarks/peers/kernels.cpp has bars, and those of running feedback
// (63) and a whole motion plan (300). `seconds_per_candidate` is the time of a generation over its default population.
#include <cstdint>

#include <Eigen/Core>
#include <benchmark/benchmark.h>

#include <traceur/optimize/cma_es.hpp>

namespace {

using traceur::optimize::CmaEs;
using traceur::optimize::CmaEsParameters;
using traceur::optimize::Covariance;

void generation(benchmark::State& state, Covariance covariance) {
  const Eigen::Index n = state.range(0);
  CmaEsParameters parameters;
  parameters.covariance = covariance;
  parameters.tolerance_cost = 0.0;
  CmaEs cma(Eigen::VectorXd::Ones(n), parameters);
  Eigen::VectorXd costs(cma.population());
  for (auto _ : state) {
    if (cma.finished()) {
      state.PauseTiming();
      cma = CmaEs(Eigen::VectorXd::Ones(n), parameters);
      state.ResumeTiming();
    }
    costs = cma.ask().colwise().squaredNorm().transpose();
    cma.tell(costs);
    benchmark::DoNotOptimize(cma.mean().data());
  }
  state.counters["seconds_per_candidate"] =
      benchmark::Counter(static_cast<double>(state.iterations()) * cma.population(),
                         benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

}  // namespace

BENCHMARK_CAPTURE(generation, full, Covariance::full)
    ->Arg(10)
    ->Arg(40)
    ->Arg(63)
    ->Arg(100)
    ->Arg(250)
    ->Arg(300)
    ->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(generation, diagonal, Covariance::diagonal)
    ->Arg(63)
    ->Arg(99)
    ->Arg(300)
    ->Unit(benchmark::kMicrosecond);
