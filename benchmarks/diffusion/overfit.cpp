// SPDX-License-Identifier: MIT
// How closely the motion generator, in PARC's published size, learns one clip: after so many steps of training, 64 windows
// of the clip are generated from noise and their two past frames (five steps of DDIM), and their joints compared with the
// clip's. The clip is that of examples/, or the file named by TRACEUR_CLIP. Argument: steps of 16 windows, about 0.3 s of
// CPU each. Begun from the folder of the sources, on two threads.
#include <algorithm>
#include <cmath>
#include <cstdlib>

#include <Eigen/Core>
#include <benchmark/benchmark.h>

#include <traceur/core/executor.hpp>
#include <traceur/core/random.hpp>
#include <traceur/diffusion/ddim.hpp>
#include <traceur/diffusion/motion_generator.hpp>
#include <traceur/diffusion/motion_loss.hpp>
#include <traceur/diffusion/motion_windows.hpp>
#include <traceur/diffusion/network_denoiser.hpp>
#include <traceur/diffusion/training.hpp>
#include <traceur/io/load_clip.hpp>
#include <traceur/nn/optimizer.hpp>
#include <traceur/nn/schedule.hpp>

namespace {

using namespace traceur::diffusion;
using Matrixf = Eigen::MatrixXf;

void overfit(benchmark::State& state) {
  const char* const named = std::getenv("TRACEUR_CLIP");
  traceur::motion::Clip clip;
  try {
    clip = traceur::io::load_clip(named != nullptr ? named : "examples/clips/walk.jsonl").clip;
  } catch (const traceur::Error& error) {
    state.SkipWithError(error.what());
    return;
  }
  clip.cyclic = false;
  MotionWindows<float> windows{FrameFeatures(clip.skeleton)};
  const traceur::motion::Clip* const clips[] = {&clip};
  windows.set_scale(measure_scale<float>(windows, clips));
  MotionGenerator::Parameters shape;
  shape.frame_features = windows.features().size();
  const MotionGenerator net(shape);
  Eigen::VectorXf theta(net.parameters()), gradient(net.parameters());
  traceur::core::RandomStream start(1);
  net.initialize(theta.data(), start);
  const Schedule schedule = Schedule::cosine(21);
  const MotionLoss<float> loss(windows.features(), windows.scale(), windows.frames(), windows.dt());
  const Eigen::Index batch = 16, shown = 64;
  Training<float, MotionGenerator, MotionLoss<float>> training(net, schedule, loss,
                                                               {.batch = batch, .chunks = 4, .drops = {}, .seed = 1});
  traceur::nn::Adam<float> adam(net.parameters());
  traceur::nn::ExponentialAverage<float> average(theta, 0.99);
  traceur::core::ThreadExecutor threads(2);
  const auto ground = traceur::terrain::HeightGrid::flat();
  auto scratch = windows.scratch();
  Matrixf samples(windows.sample_features(), batch), conditions(windows.condition_features(), batch);
  const auto steps = state.range(0);
  const traceur::nn::WarmUp rate{50, traceur::nn::CosineRate{.first = 5e-4, .last = 1e-5, .steps = steps}};

  double worst = 0, mean = 0, value = 0;
  for (auto _ : state) {
    for (std::int64_t step = 0; step < steps; ++step) {
      for (Eigen::Index j = 0; j < batch; ++j) {
        traceur::core::RandomStream random(7, static_cast<std::uint64_t>(j), static_cast<std::uint64_t>(step));
        windows.draw(clip, ground, random, scratch, samples.col(j).data(), conditions.col(j).data());
      }
      gradient.setZero();
      value = training.run(threads, theta.data(), samples, {conditions}, static_cast<std::uint64_t>(step), gradient);
      traceur::nn::clip_global_norm(gradient.data(), gradient.size(), 1.0);
      adam.step(theta, gradient, rate(step));
      average.update(theta);
    }
  }

  Matrixf truth(windows.sample_features(), shown), condition(windows.condition_features(), shown), x = truth;
  for (Eigen::Index j = 0; j < shown; ++j) {
    traceur::core::RandomStream random(8, static_cast<std::uint64_t>(j));
    windows.draw(clip, ground, random, scratch, truth.col(j).data(), condition.col(j).data());
  }
  draw_noise<float>(x, 9);
  NetworkDenoiser<float, MotionGenerator, traceur::core::ThreadExecutor> denoiser(net, average.value().data(), threads, shown);
  WindowProjection<float> project(windows);
  project.set_condition({condition}, past_part);
  Ddim<float> ddim(schedule, 5, net.features(), shown);
  ddim.sample(denoiser, {condition}, x, project);
  traceur::body::Frames<float> a(clip.skeleton), b(clip.skeleton);
  const FrameFeatures& features = windows.features();
  int count = 0;
  for (Eigen::Index j = 0; j < shown; ++j) {
    windows.scale().undo(x.col(j).data(), windows.frames());
    windows.scale().undo(truth.col(j).data(), windows.frames());
    for (int f = 2; f < windows.frames(); ++f) {
      features.kinematics(x.col(j).data() + f * features.size(), a);
      features.kinematics(truth.col(j).data() + f * features.size(), b);
      for (std::size_t i = 0; i < a.position.size(); ++i, ++count) {
        const double off = static_cast<double>(norm(a.position[i] - b.position[i]));
        mean += off;
        worst = std::max(worst, off);
      }
    }
  }
  state.counters["mean_joint_error_m"] = mean / count;
  state.counters["worst_joint_error_m"] = worst;
  state.counters["loss"] = value;
}

}  // namespace

BENCHMARK(overfit)->Arg(600)->Arg(3000)->Iterations(1)->MeasureProcessCPUTime()->UseRealTime()->Unit(benchmark::kSecond);
