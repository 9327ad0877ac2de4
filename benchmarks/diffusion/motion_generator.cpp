// SPDX-License-Identifier: MIT
// The motion generator in PARC's published size (31 x 31 heights, 15 frames of 105 numbers, width 256, 8 heads, 4 layers),
// in float with random parameters: half a second of motion from noise by five steps of DDIM, blended, so ten calls of the
// network; and a step of training. Arguments: samples, threads. `flops` counts the products that every call would do
// without sharing any work, convolutions once.
#include <Eigen/Core>
#include <benchmark/benchmark.h>

#include <traceur/core/executor.hpp>
#include <traceur/core/random.hpp>
#include <traceur/diffusion/blended_denoiser.hpp>
#include <traceur/diffusion/ddim.hpp>
#include <traceur/diffusion/motion_generator.hpp>
#include <traceur/diffusion/network_denoiser.hpp>
#include <traceur/diffusion/training.hpp>

namespace {

using namespace traceur::diffusion;
using Matrixf = Eigen::MatrixXf;

struct Scene {
  explicit Scene(Eigen::Index samples)
      : theta(net.parameters()), values(net.condition_features(), samples), x(net.features(), samples) {
    traceur::core::RandomStream random(1);
    net.initialize(theta.data(), random);
    draw_noise<float>(values, 2);
    draw_noise<float>(x, 3);
  }
  const MotionGenerator net{MotionGenerator::Parameters{}};
  const Schedule schedule = Schedule::cosine(21);
  Eigen::VectorXf theta;
  Matrixf values, x;
};

void generate(benchmark::State& state) {
  const Eigen::Index samples = state.range(0);
  Scene scene(samples);
  traceur::core::ThreadExecutor threads(static_cast<int>(state.range(1)));
  NetworkDenoiser<float, MotionGenerator, traceur::core::ThreadExecutor> denoiser(scene.net, scene.theta.data(), threads,
                                                                                  samples);
  BlendedDenoiser<float, decltype(denoiser)> blended(denoiser, {past_seen, 0.65}, samples);
  Ddim<float> ddim(scene.schedule, 5, scene.net.features(), samples);
  for (auto _ : state) {
    draw_noise<float>(scene.x, 4);
    ddim.sample(blended, {scene.values}, scene.x);
    benchmark::DoNotOptimize(scene.x.data());
    benchmark::ClobberMemory();
  }
  const double tokens = 82, width = 256, layers = 4;
  const double call = 2 * tokens * layers * (4 * width * width + 2 * width * width + 2 * tokens * width);
  const double convolutions = 2 * (27.0 * 27 * 25 * 32 + 23.0 * 23 * 800 * 32 + 19.0 * 19 * 800 * 32 + 256.0 * 512 * 64);
  state.counters["flops"] = benchmark::Counter(static_cast<double>(samples) * (10 * call + convolutions),
                                               benchmark::Counter::kIsIterationInvariantRate);
}

void train(benchmark::State& state) {
  const Eigen::Index samples = state.range(0);
  Scene scene(samples);
  traceur::core::ThreadExecutor threads(static_cast<int>(state.range(1)));
  const SquaredError<float> loss;
  Training<float, MotionGenerator> training(scene.net, scene.schedule, loss,
                                            {.batch = samples, .chunks = 8, .drops = {{past_seen, 0.15}}, .seed = 1});
  Eigen::VectorXf gradient(scene.net.parameters());
  std::uint64_t step = 0;
  for (auto _ : state) {
    gradient.setZero();
    training.run(threads, scene.theta.data(), scene.x, {scene.values}, step++, gradient);
    benchmark::DoNotOptimize(gradient.data());
    benchmark::ClobberMemory();
  }
}

}  // namespace

BENCHMARK(generate)
    ->ArgsProduct({{1, 32}, {1, 2}})
    ->ArgNames({"samples", "threads"})
    ->MeasureProcessCPUTime()
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK(train)
    ->Args({64, 2})
    ->ArgNames({"samples", "threads"})
    ->MeasureProcessCPUTime()
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);
