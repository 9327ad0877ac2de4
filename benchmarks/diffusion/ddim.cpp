// SPDX-License-Identifier: MIT
// What DDIM itself costs in a sampling of the motion generator's size (32 samples of 15 frames of 210 numbers, 21 steps of
// noise): the denoiser only copies, so all else that is timed is updating the samples. `calls` is of the denoiser.
#include <Eigen/Core>
#include <benchmark/benchmark.h>

#include <traceur/core/random.hpp>
#include <traceur/diffusion/ddim.hpp>

namespace {

using namespace traceur;

constexpr Eigen::Index features = 15 * 210, samples = 32;

struct Copying {
  Eigen::Index features() const { return ::features; }
  Eigen::Index condition_features() const { return 0; }
  void begin(const diffusion::Condition<float>&) {}
  void denoise(int, nn::ConstMatrix<float> noisy, nn::Matrix<float> clean) { clean = noisy; }
};

void sample(benchmark::State& state) {
  diffusion::Ddim<float> ddim(diffusion::Schedule::cosine(), static_cast<int>(state.range(0)), features, samples);
  Copying denoiser;
  Eigen::MatrixXf x(features, samples);
  core::RandomStream random(1);
  for (float& v : x.reshaped()) v = random.normal<float>();
  for (auto _ : state) {
    ddim.sample(denoiser, diffusion::no_condition<float>(samples), x);
    benchmark::ClobberMemory();
  }
  state.counters["calls"] = static_cast<double>(ddim.steps().size());
}

}  // namespace

BENCHMARK(sample)->Arg(1)->Arg(5)->Arg(20)->Unit(benchmark::kMicrosecond);
