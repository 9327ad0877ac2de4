// SPDX-License-Identifier: MIT
// Single layers and optimizers on one thread. Layer norm and attention: tokens of 256 numbers, 32 samples of 80 tokens, 4 heads;
// a PointNet (3-64-128) over 60 points of 256 clouds. `infer`, `train` (forward and backward). Optimizers: a step of a million
// parameters, Adam beside the same in Eigen's expressions.
#include <cmath>

#include <Eigen/Core>
#include <benchmark/benchmark.h>

#include <traceur/core/random.hpp>
#include <traceur/nn/attention.hpp>
#include <traceur/nn/layer_norm.hpp>
#include <traceur/nn/mlp.hpp>
#include <traceur/nn/optimizer.hpp>
#include <traceur/nn/point_net.hpp>

namespace {

using namespace traceur;
using Eigen::Index;
using Eigen::MatrixXf;
using Eigen::VectorXf;

void draw(float* values, Index count, std::uint64_t seed) {
  core::RandomStream random(seed);
  for (Index i = 0; i < count; ++i) values[i] = random.normal<float>();
}

template <class L>
struct Batch {
  Batch(L l, Index columns)
      : layer(std::move(l)),
        theta(layer.parameters()),
        gradient(VectorXf::Zero(layer.parameters())),
        x(layer.inputs(), columns),
        y(layer.outputs(), columns),
        dx(layer.inputs(), columns),
        dy(layer.outputs(), columns),
        work(layer.template workspace<float>(columns)) {
    core::RandomStream random(1);
    layer.initialize(theta.data(), random);
    draw(x.data(), x.size(), 2);
    draw(dy.data(), dy.size(), 3);
  }
  L layer;
  VectorXf theta, gradient;
  MatrixXf x, y, dx, dy;
  typename L::template Workspace<float> work;
};

template <auto make, Index columns>
void infer(benchmark::State& state) {
  Batch b(make(), columns);
  for (auto _ : state) {
    b.layer.template infer<float>(b.theta.data(), b.x, b.work, b.y);
    benchmark::ClobberMemory();
  }
}

template <auto make, Index columns>
void train(benchmark::State& state) {
  Batch b(make(), columns);
  for (auto _ : state) {
    b.layer.template forward<float>(b.theta.data(), b.x, b.work, b.y);
    b.layer.template backward<float>(b.theta.data(), b.x, b.dy, b.work, b.gradient.data(), b.dx);
    benchmark::ClobberMemory();
  }
}

nn::LayerNorm layer_norm() { return nn::LayerNorm(256); }
nn::Attention attention() { return nn::Attention(nn::Attention::Parameters{}); }
nn::PointNet<nn::Mlp<>> point_net() { return {nn::Mlp<>({3, 64, 128}), 60}; }

constexpr Index parameters = 1000000;

template <class O>
void step(benchmark::State& state) {
  O optimizer(parameters);
  VectorXf theta(parameters), gradient(parameters);
  draw(theta.data(), parameters, 4);
  draw(gradient.data(), parameters, 5);
  for (auto _ : state) {
    optimizer.step(theta, gradient, 1e-4);
    benchmark::ClobberMemory();
  }
}

void step_adam_eigen(benchmark::State& state) {
  VectorXf theta(parameters), gradient(parameters), m = VectorXf::Zero(parameters), v = m;
  draw(theta.data(), parameters, 4);
  draw(gradient.data(), parameters, 5);
  double m_left = 1, v_left = 1;
  for (auto _ : state) {
    m_left *= 0.9;
    v_left *= 0.999;
    m = 0.9F * m + 0.1F * gradient;
    v = 0.999F * v + 0.001F * gradient.cwiseAbs2();
    const auto rate = static_cast<float>(1e-4 / (1 - m_left)), scale = static_cast<float>(1 / std::sqrt(1 - v_left));
    theta.array() -= rate * m.array() / (scale * v.array().sqrt() + 1e-8F);
    benchmark::ClobberMemory();
  }
}

}  // namespace

BENCHMARK(infer<layer_norm, 80 * 32>)->Name("infer/layer_norm")->Unit(benchmark::kMicrosecond);
BENCHMARK(train<layer_norm, 80 * 32>)->Name("train/layer_norm")->Unit(benchmark::kMicrosecond);
BENCHMARK(infer<attention, 80 * 32>)->Name("infer/attention")->Unit(benchmark::kMicrosecond);
BENCHMARK(train<attention, 80 * 32>)->Name("train/attention")->Unit(benchmark::kMicrosecond);
BENCHMARK(infer<point_net, 256>)->Name("infer/point_net")->Unit(benchmark::kMicrosecond);
BENCHMARK(train<point_net, 256>)->Name("train/point_net")->Unit(benchmark::kMicrosecond);
BENCHMARK(step<nn::Adam<float>>)->Name("step/adam")->Unit(benchmark::kMicrosecond);
BENCHMARK(step_adam_eigen)->Name("step/adam_eigen")->Unit(benchmark::kMicrosecond);
BENCHMARK(step<nn::Sgd<float>>)->Name("step/sgd")->Unit(benchmark::kMicrosecond);
