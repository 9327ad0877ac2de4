// SPDX-License-Identifier: MIT
// Terrain Runner's interpolant as its running skill uses it: two task parameters, 40 outputs, phi(r) = r with a linear
// polynomial. `fit` solves for the weights and measures the residual; `evaluate` is 10 000 columns at once, `one` a
// single one, as a controller asks for it while it runs.
#include <Eigen/Core>
#include <benchmark/benchmark.h>

#include <traceur/core/random.hpp>
#include <traceur/parameterize/rbf.hpp>

namespace {

using traceur::parameterize::Rbf;
constexpr Eigen::Index outputs = 40, queries = 10000;

Eigen::MatrixXd uniform(Eigen::Index rows, Eigen::Index cols, std::uint64_t stream) {
  traceur::core::RandomStream random(1, stream);
  Eigen::MatrixXd x(rows, cols);
  for (Eigen::Index i = 0; i < x.size(); ++i) x.data()[i] = random.uniform();
  return x;
}

void fit(benchmark::State& state) {
  const Eigen::MatrixXd centres = uniform(2, state.range(0), 0), values = uniform(outputs, state.range(0), 1);
  double residual = 0.0;
  for (auto _ : state) residual = Rbf(centres, values).residual();
  state.counters["residual"] = residual;
}

void evaluate(benchmark::State& state) {
  const Rbf rbf(uniform(2, state.range(0), 0), uniform(outputs, state.range(0), 1));
  const Eigen::MatrixXd thetas = uniform(2, queries, 2);
  Eigen::MatrixXd values(outputs, queries);
  for (auto _ : state) {
    rbf.evaluate(thetas, values);
    benchmark::DoNotOptimize(values.data());
  }
}

void one(benchmark::State& state) {
  const Rbf rbf(uniform(2, state.range(0), 0), uniform(outputs, state.range(0), 1));
  const double theta[] = {0.3, 0.6};
  double values[outputs];
  for (auto _ : state) {
    rbf.evaluate<double>(theta, values);
    benchmark::DoNotOptimize(values);
    benchmark::ClobberMemory();
  }
}

}  // namespace

BENCHMARK(fit)->Arg(200)->Arg(2000)->Unit(benchmark::kMillisecond);
BENCHMARK(evaluate)->Arg(200)->Arg(2000)->Unit(benchmark::kMillisecond);
BENCHMARK(one)->Arg(200)->Arg(2000)->Unit(benchmark::kMicrosecond);
