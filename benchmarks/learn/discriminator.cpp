// SPDX-License-Identifier: MIT
// A discriminator on one thread, ten steps of a humanoid's features (740-256-128-1): judging histories, learning from the
// policy's, and learning from real ones, which the exact gradient penalty makes dearer. `samples` is histories a second.
#include <Eigen/Core>
#include <benchmark/benchmark.h>

#include <traceur/core/random.hpp>
#include <traceur/learn/discriminator.hpp>

namespace {

using traceur::learn::Discriminator;

struct Batch {
  static constexpr Eigen::Index columns = 256;
  Discriminator<> discriminator{traceur::nn::Mlp<>({740, 256, 128, 1})};
  Eigen::VectorXf theta{discriminator.parameters()}, gradient = Eigen::VectorXf::Zero(discriminator.parameters());
  Eigen::MatrixXf x{740, columns}, logit{1, columns};
  Discriminator<>::Workspace<float> work = discriminator.workspace<float>(columns);

  Batch() {
    traceur::core::RandomStream random(1);
    discriminator.network().initialize(theta.data(), random);
    for (float* v = x.data(); v != x.data() + x.size(); ++v) *v = random.normal<float>();
  }
};

void count(benchmark::State& state) {
  state.counters["samples"] =
      benchmark::Counter(static_cast<double>(state.iterations() * Batch::columns), benchmark::Counter::kIsRate);
}

void judge(benchmark::State& state) {
  Batch b;
  for (auto _ : state) b.discriminator.infer<float>(b.theta.data(), b.x, b.work, b.logit);
  count(state);
}
BENCHMARK(judge);

void learn_from_fake(benchmark::State& state) {
  Batch b;
  for (auto _ : state) b.discriminator.accumulate_fake<float>(b.theta.data(), b.x, 1.0f / 256, b.work, b.gradient.data());
  count(state);
}
BENCHMARK(learn_from_fake);

void learn_from_real(benchmark::State& state) {
  Batch b;
  for (auto _ : state) b.discriminator.accumulate_real<float>(b.theta.data(), b.x, 1.0f / 256, b.work, b.gradient.data());
  count(state);
}
BENCHMARK(learn_from_real);

}  // namespace
