// SPDX-License-Identifier: MIT
// The three products of a dense layer, beside Eigen's in the same run: forward y = W x, back dx = W^T dy, gradient
// dW += dy x^T. Arguments: outputs, inputs, columns. `flops` counts a multiplication and an addition as two.
#include <Eigen/Core>
#include <benchmark/benchmark.h>

#include <traceur/core/random.hpp>
#include <traceur/nn/product.hpp>

namespace {

using traceur::core::RandomStream;
using Matrix = Eigen::MatrixXf;

struct Layer {
  explicit Layer(const benchmark::State& state)
      : w(state.range(0), state.range(1)),
        x(state.range(1), state.range(2)),
        y(state.range(0), state.range(2)),
        scratch(traceur::nn::product_scratch<float>(w.rows(), w.cols())) {
    RandomStream random(1);
    for (Matrix* m : {&w, &x, &y}) {
      for (Eigen::Index i = 0; i < m->size(); ++i) m->data()[i] = random.normal<float>();
    }
  }

  void count(benchmark::State& state) const {
    const double flops = 2.0 * static_cast<double>(w.size()) * static_cast<double>(x.cols());
    state.counters["flops"] =
        benchmark::Counter(flops * static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
  }

  Matrix w, x, y;
  Eigen::VectorXf scratch;
};

void forward(benchmark::State& state) {
  Layer l(state);
  for (auto _ : state) {
    traceur::nn::product<float>(l.w, l.x, l.y, l.scratch.data());
    benchmark::DoNotOptimize(l.y.data());
    benchmark::ClobberMemory();
  }
  l.count(state);
}

void forward_eigen(benchmark::State& state) {
  Layer l(state);
  for (auto _ : state) {
    l.y.noalias() = l.w * l.x;
    benchmark::DoNotOptimize(l.y.data());
    benchmark::ClobberMemory();
  }
  l.count(state);
}

void back(benchmark::State& state) {
  Layer l(state);
  for (auto _ : state) {
    traceur::nn::transposed_product<float>(l.w, l.y, l.x, l.scratch.data());
    benchmark::DoNotOptimize(l.x.data());
    benchmark::ClobberMemory();
  }
  l.count(state);
}

void back_eigen(benchmark::State& state) {
  Layer l(state);
  for (auto _ : state) {
    l.x.noalias() = l.w.transpose() * l.y;
    benchmark::DoNotOptimize(l.x.data());
    benchmark::ClobberMemory();
  }
  l.count(state);
}

void gradient(benchmark::State& state) {
  Layer l(state);
  for (auto _ : state) {
    traceur::nn::outer_product<float>(l.y, l.x, l.w, l.scratch.data());
    benchmark::DoNotOptimize(l.w.data());
    benchmark::ClobberMemory();
  }
  l.count(state);
}

void gradient_eigen(benchmark::State& state) {
  Layer l(state);
  for (auto _ : state) {
    l.w.noalias() += l.y * l.x.transpose();
    benchmark::DoNotOptimize(l.w.data());
    benchmark::ClobberMemory();
  }
  l.count(state);
}

void shapes(benchmark::internal::Benchmark* b) {
  for (const auto& shape : {std::pair{64, 3}, {64, 64}, {1, 64}, {28, 128}, {256, 200}, {128, 256}, {1024, 512}}) {
    for (const int columns : {1, 8, 256, 4096}) {
      if (shape.first == 1024 && columns == 4096) continue;
      b->Args({shape.first, shape.second, columns});
    }
  }
}

}  // namespace

BENCHMARK(forward)->Apply(shapes);
BENCHMARK(forward_eigen)->Apply(shapes);
BENCHMARK(back)->Apply(shapes);
BENCHMARK(back_eigen)->Apply(shapes);
BENCHMARK(gradient)->Apply(shapes);
BENCHMARK(gradient_eigen)->Apply(shapes);
