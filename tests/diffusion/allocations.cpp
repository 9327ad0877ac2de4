// SPDX-License-Identifier: MIT
#include <traceur/diffusion/motion_generator.hpp>

#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/executor.hpp>
#include <traceur/diffusion/blended_denoiser.hpp>
#include <traceur/diffusion/ddim.hpp>
#include <traceur/diffusion/motion_loss.hpp>
#include <traceur/diffusion/network_denoiser.hpp>
#include <traceur/diffusion/training.hpp>

#include "../nn/allocations.hpp"
#include "figure.hpp"
#include "support.hpp"

using namespace traceur::diffusion;

TEST_CASE("neither training nor sampling takes memory") {
  const FrameFeatures features(figure::skeleton());
  MotionGenerator::Parameters p;
  p.frame_features = features.size();
  p.future = 3;
  p.terrain = {.height = 5, .width = 5, .layers = {{3, 2}}, .patch = 2, .token = 8, .scale = 1.0 / 3};
  p.target_hidden = p.hidden = p.feed_forward = 8;
  p.heads = p.layers = 2;
  const MotionGenerator net(p);
  const Schedule schedule = Schedule::cosine();
  const MotionLoss<float> loss(features, FeatureScale<float>::none(features.size()), 5, 0.1);
  Eigen::VectorXf theta(net.parameters()), gradient = Eigen::VectorXf::Zero(net.parameters());
  traceur::core::RandomStream random(1);
  net.initialize(theta.data(), random);
  const Eigen::Index n = 4;
  const Table<float> values = random_table<float>(net.condition_features(), n, 2);
  Table<float> x = random_table<float>(net.features(), n, 3);
  const std::vector<Parts> given{all_parts, 0, all_parts, past_part};
  const Condition<float> condition{values, given.data()};
  traceur::core::ThreadExecutor threads(2);
  Training<float, MotionGenerator, MotionLoss<float>> training(net, schedule, loss, {.batch = n, .chunks = 2, .drops = {}, .seed = 1});
  NetworkDenoiser<float, MotionGenerator, traceur::core::ThreadExecutor> denoiser(net, theta.data(), threads, n);
  BlendedDenoiser<float, decltype(denoiser)> blended(denoiser, {past_seen, 0.5}, n);
  Ddim<float> ddim(schedule, 5, net.features(), n);
  for (int round = 0; round < 2; ++round) {
    const long before = allocations();
    training.run(threads, theta.data(), x, condition, 0, gradient);
    ddim.sample(blended, condition, x);
    if (round == 1) CHECK(allocations() == before);
  }
}
