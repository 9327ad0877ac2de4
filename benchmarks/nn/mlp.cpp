// SPDX-License-Identifier: MIT
// A whole perceptron on one thread: forward and backward of a batch, and inference, beside the same written in Eigen's
// own products in the same run. Networks: a pendulum's (3-64-64-1), one clip's policy (190-256-128-28) and value
// (200-256-128), a large one (200-1024-512-28). The argument is the number of columns; `samples` is columns a second.
#include <vector>

#include <Eigen/Core>
#include <benchmark/benchmark.h>

#include <traceur/core/random.hpp>
#include <traceur/nn/mlp.hpp>

namespace {

using Eigen::Index;
using Eigen::MatrixXf;
using Eigen::VectorXf;
using traceur::nn::Mlp;
using Widths = std::vector<Index>;

struct Batch {
  Batch(const Widths& widths, Index columns)
      : mlp(widths),
        theta(mlp.parameters()),
        gradient(VectorXf::Zero(mlp.parameters())),
        x(mlp.inputs(), columns),
        y(mlp.outputs(), columns),
        dy(mlp.outputs(), columns) {
    traceur::core::RandomStream random(1);
    mlp.initialize(theta.data(), random);
    for (MatrixXf* m : {&x, &dy}) {
      for (Index i = 0; i < m->size(); ++i) m->data()[i] = random.normal<float>();
    }
  }
  Mlp<> mlp;
  VectorXf theta, gradient;
  MatrixXf x, y, dy;
};

void count(benchmark::State& state) {
  state.counters["samples"] =
      benchmark::Counter(static_cast<double>(state.iterations() * state.range(0)), benchmark::Counter::kIsRate);
}

void train(benchmark::State& state, const Widths& widths) {
  Batch b(widths, state.range(0));
  auto w = b.mlp.workspace<float>(b.x.cols());
  for (auto _ : state) {
    b.mlp.forward(b.theta.data(), b.x, w, b.y);
    b.mlp.backward(b.theta.data(), b.x, b.dy, w, b.gradient.data(), traceur::nn::no_gradient<float>());
    benchmark::DoNotOptimize(b.gradient.data());
    benchmark::ClobberMemory();
  }
  count(state);
}

void infer(benchmark::State& state, const Widths& widths) {
  Batch b(widths, state.range(0));
  auto w = b.mlp.workspace<float>(b.x.cols());
  for (auto _ : state) {
    b.mlp.infer(b.theta.data(), b.x, w, b.y);
    benchmark::DoNotOptimize(b.y.data());
    benchmark::ClobberMemory();
  }
  count(state);
}

/// The same network as one would write it with Eigen: ReLU between the layers.
struct Plain {
  explicit Plain(const Widths& widths, Index columns) {
    for (std::size_t i = 0; i + 1 < widths.size(); ++i) {
      weight.push_back(0.1f * MatrixXf::Random(widths[i + 1], widths[i]));
      bias.push_back(VectorXf::Zero(widths[i + 1]));
      dweight.push_back(MatrixXf::Zero(widths[i + 1], widths[i]));
      dbias.push_back(VectorXf::Zero(widths[i + 1]));
      out.emplace_back(widths[i + 1], columns);
      delta.emplace_back(widths[i + 1], columns);
    }
  }
  void forward(const MatrixXf& x) {
    for (std::size_t i = 0; i < weight.size(); ++i) {
      out[i].noalias() = weight[i] * (i == 0 ? x : out[i - 1]);
      out[i].colwise() += bias[i];
      if (i + 1 < weight.size()) out[i] = out[i].cwiseMax(0.0f);
    }
  }
  void backward(const MatrixXf& x, const MatrixXf& dy) {
    delta.back() = dy;
    for (std::size_t i = weight.size(); i-- > 0;) {
      if (i + 1 < weight.size()) delta[i].array() *= (out[i].array() > 0.0f).cast<float>();
      dweight[i].noalias() += delta[i] * (i == 0 ? x : out[i - 1]).transpose();
      dbias[i] += delta[i].rowwise().sum();
      if (i > 0) delta[i - 1].noalias() = weight[i].transpose() * delta[i];
    }
  }
  std::vector<MatrixXf> weight, dweight, out, delta;
  std::vector<VectorXf> bias, dbias;
};

void train_eigen(benchmark::State& state, const Widths& widths) {
  Batch b(widths, state.range(0));
  Plain plain(widths, b.x.cols());
  for (auto _ : state) {
    plain.forward(b.x);
    plain.backward(b.x, b.dy);
    benchmark::DoNotOptimize(plain.dweight[0].data());
    benchmark::ClobberMemory();
  }
  count(state);
}

void infer_eigen(benchmark::State& state, const Widths& widths) {
  Batch b(widths, state.range(0));
  Plain plain(widths, b.x.cols());
  for (auto _ : state) {
    plain.forward(b.x);
    benchmark::DoNotOptimize(plain.out.back().data());
    benchmark::ClobberMemory();
  }
  count(state);
}

const Widths pendulum = {3, 64, 64, 1}, policy = {190, 256, 128, 28}, value = {200, 256, 128},
             large = {200, 1024, 512, 28};

}  // namespace

BENCHMARK_CAPTURE(train, pendulum, pendulum)->Arg(32)->Arg(256)->Arg(4096);
BENCHMARK_CAPTURE(train_eigen, pendulum, pendulum)->Arg(32)->Arg(256)->Arg(4096);
BENCHMARK_CAPTURE(train, policy, policy)->Arg(256)->Arg(1024)->Arg(4096);
BENCHMARK_CAPTURE(train_eigen, policy, policy)->Arg(256)->Arg(1024)->Arg(4096);
BENCHMARK_CAPTURE(train, value, value)->Arg(256)->Arg(4096);
BENCHMARK_CAPTURE(train_eigen, value, value)->Arg(256)->Arg(4096);
BENCHMARK_CAPTURE(train, large, large)->Arg(256)->Arg(4096);
BENCHMARK_CAPTURE(train_eigen, large, large)->Arg(256)->Arg(4096);
BENCHMARK_CAPTURE(infer, pendulum, pendulum)->Arg(1)->Arg(16)->Arg(256);
BENCHMARK_CAPTURE(infer_eigen, pendulum, pendulum)->Arg(1)->Arg(16)->Arg(256);
BENCHMARK_CAPTURE(infer, policy, policy)->Arg(1)->Arg(16)->Arg(256);
BENCHMARK_CAPTURE(infer_eigen, policy, policy)->Arg(1)->Arg(16)->Arg(256);
BENCHMARK_CAPTURE(infer, large, large)->Arg(1);
BENCHMARK_CAPTURE(infer_eigen, large, large)->Arg(1);
