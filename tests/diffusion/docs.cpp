// SPDX-License-Identifier: MIT
// The snippet of docs/diffusion.md, compiled and run. Keep the two alike.
#include <traceur/diffusion/blended_denoiser.hpp>
#include <traceur/diffusion/long_horizon.hpp>
#include <traceur/diffusion/motion_generator.hpp>
#include <traceur/diffusion/motion_loss.hpp>
#include <traceur/diffusion/motion_windows.hpp>
#include <traceur/diffusion/network_denoiser.hpp>
#include <traceur/diffusion/training.hpp>
#include <traceur/nn/optimizer.hpp>

#include <cmath>

#include <doctest/doctest.h>

#include "figure.hpp"

TEST_CASE("a generator is trained on a clip and walks along a path") {
  const traceur::motion::Clip clip = figure::walk();

  using namespace traceur::diffusion;
  using traceur::terrain::HeightGrid;

  // Windows of the clips, and how their features are scaled.
  WindowParameters cut;
  cut.map = {.spacing = 0.4, .back = 1, .ahead = 3, .side = 2, .limit = 3};  // 5 x 5 heights; PARC: 31 x 31
  MotionWindows<float> windows(FrameFeatures(clip.skeleton), cut);
  const traceur::motion::Clip* const clips[] = {&clip};
  windows.check(clip);
  windows.set_scale(measure_scale<float>(windows, clips));

  // A small network of PARC's kind. MotionGenerator::Parameters{} with frame_features set is the published size.
  MotionGenerator::Parameters shape;
  shape.frame_features = windows.features().size();
  shape.terrain = {.height = 5, .width = 5, .layers = {{4, 2}}, .patch = 2, .token = 32, .scale = 1.0 / 3};
  shape.target_hidden = shape.hidden = shape.feed_forward = 32;
  shape.heads = shape.layers = 2;
  const MotionGenerator net(shape);
  Eigen::VectorXf theta(net.parameters()), gradient(net.parameters());
  traceur::core::RandomStream start(1);
  net.initialize(theta.data(), start);

  const Schedule schedule = Schedule::cosine(21);
  const MotionLoss<float> loss(windows.features(), windows.scale(), windows.frames(), windows.dt());
  const Eigen::Index batch = 16;
  Training<float, MotionGenerator, MotionLoss<float>> training(
      net, schedule, loss,
      {.batch = batch,
       .chunks = 4,
       .drops = {{past_seen, 0.15}, {past_part, 0.5}, {terrain_part, 0.025}, {target_part, 0.025}},
       .seed = 1});
  traceur::nn::Adam<float> adam(net.parameters(), {.weight_decay = 0.01});
  traceur::nn::ExponentialAverage<float> average(theta, 0.99);

  traceur::core::ThreadExecutor threads(2);
  const HeightGrid ground = HeightGrid::flat();
  auto scratch = windows.scratch();
  Eigen::MatrixXf samples(windows.sample_features(), batch), conditions(windows.condition_features(), batch);
  for (std::uint64_t step = 0; step < 200; ++step) {
    for (Eigen::Index j = 0; j < batch; ++j) {
      traceur::core::RandomStream random(7, static_cast<std::uint64_t>(j), step);
      windows.draw(clip, ground, random, scratch, samples.col(j).data(), conditions.col(j).data());
    }
    gradient.setZero();
    training.run(threads, theta.data(), samples, {conditions}, step, gradient);
    traceur::nn::clip_global_norm(gradient.data(), gradient.size(), 1.0);
    adam.step(theta, gradient, 1e-3);
    average.update(theta);
  }

  // Two motions along a path.
  NetworkDenoiser<float, MotionGenerator, traceur::core::ThreadExecutor> denoiser(net, average.value().data(), threads, 2);
  BlendedDenoiser<float, decltype(denoiser)> blended(denoiser, {past_seen, 0.5}, 2);
  LongHorizon<float> horizon(windows, schedule, 5, 2, {.longest = 2});
  std::vector<traceur::core::Vector3<double>> path;
  for (int node = 0; node < 8; ++node) path.push_back({0.4 * node, 0.0, 0.0});
  horizon.generate(denoiser, blended, path, ground, 1, 2);
  const traceur::motion::Clip motion = horizon.clip(0);

  CHECK(theta.allFinite());
  CHECK(horizon.end(0) != LongHorizonEnd::not_finite);
  CHECK(motion.keys() > 15);
  // It has learnt to go where it is asked to, roughly as fast as the clip.
  const double way = motion.poses(0, motion.keys() - 1) - motion.poses(0, 0);
  MESSAGE("went " << way << " m in " << motion.duration() << " s");
  CHECK(way > 0.5 * motion.duration());
}
