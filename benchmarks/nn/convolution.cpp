// SPDX-License-Identifier: MIT
// The four convolutions that turn a local height map of 31 x 31 into 64 channels of 16 x 16 before it is cut into tokens, in
// float on one thread. Arguments: which of them, images. `flops` counts the multiplications and additions.
#include <Eigen/Core>
#include <benchmark/benchmark.h>

#include <traceur/core/random.hpp>
#include <traceur/nn/convolution.hpp>

namespace {

using traceur::nn::Convolution;
using Matrixf = Eigen::MatrixXf;

Convolution layer(std::int64_t which) {
  constexpr Convolution::Parameters shapes[] = {
      {1, 31, 31, 32, 5, 1, 0}, {32, 27, 27, 32, 5, 1, 0}, {32, 23, 23, 32, 5, 1, 0}, {32, 19, 19, 64, 4, 1, 0}};
  return Convolution(shapes[which]);
}

struct Run {
  explicit Run(const benchmark::State& state)
      : module(layer(state.range(0))),
        theta(module.parameters()),
        gradient(Eigen::VectorXf::Zero(module.parameters())),
        x(module.inputs(), state.range(1)),
        y(module.outputs(), state.range(1)),
        dx(module.inputs(), state.range(1)),
        workspace(module.workspace<float>(state.range(1))) {
    traceur::core::RandomStream random(1);
    module.initialize(theta.data(), random);
    for (Matrixf* m : {&x, &y}) {
      for (Eigen::Index i = 0; i < m->size(); ++i) m->data()[i] = random.normal<float>();
    }
  }

  void count(benchmark::State& state, double passes) const {
    const double places = static_cast<double>(module.output_height() * module.output_width() * state.range(1));
    const double flops = 2.0 * static_cast<double>(module.parameters()) * places;
    state.counters["flops"] =
        benchmark::Counter(passes * flops * static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
  }

  Convolution module;
  Eigen::VectorXf theta, gradient;
  Matrixf x, y, dx;
  Convolution::Workspace<float> workspace;
};

void forward(benchmark::State& state) {
  Run run(state);
  for (auto _ : state) {
    run.module.forward(run.theta.data(), run.x, run.workspace, run.y);
    benchmark::DoNotOptimize(run.y.data());
    benchmark::ClobberMemory();
  }
  run.count(state, 1);
}

void backward(benchmark::State& state) {
  Run run(state);
  for (auto _ : state) {
    run.module.backward(run.theta.data(), run.x, run.y, run.workspace, run.gradient.data(), run.dx);
    benchmark::DoNotOptimize(run.gradient.data());
    benchmark::ClobberMemory();
  }
  run.count(state, 2);
}

void shapes(benchmark::internal::Benchmark* b) {
  for (const int which : {0, 1, 2, 3}) b->Args({which, 16});
  b->Args({1, 1});
}

}  // namespace

BENCHMARK(forward)->Apply(shapes)->Unit(benchmark::kMicrosecond);
BENCHMARK(backward)->Apply(shapes)->Unit(benchmark::kMicrosecond);
