// SPDX-License-Identifier: MIT
// A transformer encoder of the size of a motion generator's: 80 tokens of width 256, 4 layers, 4 heads, 1024 hidden
// features, in float on one thread. Argument: samples. `flops` counts the multiplications and additions of the products
// alone (attention's among them), so it can be held against benchmarks/nn/product.cpp.
#include <Eigen/Core>
#include <benchmark/benchmark.h>

#include <traceur/core/random.hpp>
#include <traceur/nn/transformer.hpp>

namespace {

using namespace traceur::nn;
using Matrixf = Eigen::MatrixXf;

constexpr Eigen::Index width = 256, tokens = 80, layers = 4, hidden = 1024;

TransformerParameters shape() {
  TransformerParameters p;
  p.layers = layers;
  p.layer.attention.width = width;
  p.layer.attention.heads = 4;
  p.layer.attention.tokens = tokens;
  p.layer.feed_forward = hidden;
  return p;
}

template <class A>
struct Run {
  explicit Run(const benchmark::State& state)
      : module(shape()),
        theta(module.parameters()),
        gradient(Eigen::VectorXf::Zero(module.parameters())),
        x(width, tokens * state.range(0)),
        y(x.rows(), x.cols()),
        dy(x.rows(), x.cols()),
        dx(x.rows(), x.cols()),
        workspace(module.template workspace<float>(x.cols())) {
    traceur::core::RandomStream random(1);
    module.initialize(theta.data(), random);
    for (Matrixf* m : {&x, &dy}) {
      for (Eigen::Index i = 0; i < m->size(); ++i) m->data()[i] = random.normal<float>();
    }
  }

  void count(benchmark::State& state, double passes) const {
    const double products = 2.0 * static_cast<double>(4 * width * width + 2 * width * hidden + 2 * tokens * width);
    const double columns = static_cast<double>(x.cols()) * static_cast<double>(state.iterations());
    state.counters["flops"] =
        benchmark::Counter(passes * products * static_cast<double>(layers) * columns, benchmark::Counter::kIsRate);
    state.counters["seconds_per_sample"] = benchmark::Counter(
        columns / static_cast<double>(tokens), benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
  }

  Transformer<A> module;
  Eigen::VectorXf theta, gradient;
  Matrixf x, y, dy, dx;
  typename Transformer<A>::template Workspace<float> workspace;
};

template <class A>
void infer(benchmark::State& state) {
  Run<A> run(state);
  for (auto _ : state) {
    run.module.infer(run.theta.data(), run.x, run.workspace, run.y);
    benchmark::DoNotOptimize(run.y.data());
    benchmark::ClobberMemory();
  }
  run.count(state, 1);
}

template <class A>
void train(benchmark::State& state) {
  Run<A> run(state);
  for (auto _ : state) {
    run.module.forward(run.theta.data(), run.x, run.workspace, run.y);
    run.module.backward(run.theta.data(), run.x, run.dy, run.workspace, run.gradient.data(), run.dx);
    benchmark::DoNotOptimize(run.gradient.data());
    benchmark::ClobberMemory();
  }
  run.count(state, 3);
}

}  // namespace

BENCHMARK(infer<Gelu>)->Arg(1)->Arg(32)->Unit(benchmark::kMillisecond);
BENCHMARK(infer<Relu>)->Arg(32)->Unit(benchmark::kMillisecond);
BENCHMARK(train<Gelu>)->Arg(1)->Arg(32)->Unit(benchmark::kMillisecond);
BENCHMARK(train<Relu>)->Arg(32)->Unit(benchmark::kMillisecond);
