// SPDX-License-Identifier: MIT
#include <traceur/diffusion/network_denoiser.hpp>

#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/executor.hpp>
#include <traceur/diffusion/mlp_denoiser.hpp>

#include "support.hpp"

using namespace traceur::diffusion;
using traceur::core::SerialExecutor;
using traceur::core::ThreadExecutor;

TEST_CASE("a network's estimates have the same bits alone, in a batch and on any threads") {
  const MlpDenoiser<> net({.features = 3, .condition = {{2, 1}, {4, 2}}, .hidden = {20}, .step_features = 8});
  std::vector<float> theta(static_cast<std::size_t>(net.parameters()));
  traceur::core::RandomStream random(1);
  net.initialize(theta.data(), random);
  const Table<float> x = random_table<float>(3, 9, 2), c = random_table<float>(6, 9, 3);
  const std::vector<Parts> given{1, 2, 3, 0, 3, 3, 2, 1, 3};
  const Blend blend{2, 0.65};

  SerialExecutor serial;
  NetworkDenoiser<float, MlpDenoiser<>, SerialExecutor> one(net, theta.data(), serial, 1);
  Table<float> alone(3, 9);
  for (Eigen::Index j = 0; j < 9; ++j) {
    one.begin(Condition<float>{c, given.data()}.columns(j, 1), blend);
    one.denoise(5, x.col(j), alone.col(j));
  }
  for (const int threads : {1, 3}) {
    ThreadExecutor executor(threads);
    for (const Eigen::Index per_job : {1, 2, 4, 20}) {
      NetworkDenoiser<float, MlpDenoiser<>, ThreadExecutor> all(net, theta.data(), executor, 12, per_job);
      Table<float> y(3, 9);
      all.begin({c, given.data()}, blend);
      all.denoise(5, x, y);
      CHECK(same_bits<float>(y, alone));
    }
  }
}

TEST_CASE("a network denoiser refuses numbers out of range") {
  const MlpDenoiser<> net({.features = 1, .condition = {}, .hidden = {4}, .step_features = 2});
  const std::vector<float> theta(static_cast<std::size_t>(net.parameters()));
  SerialExecutor serial;
  using D = NetworkDenoiser<float, MlpDenoiser<>, SerialExecutor>;
  CHECK_THROWS_AS(D(net, theta.data(), serial, 0), traceur::Error);
  CHECK_THROWS_AS(D(net, theta.data(), serial, 4, 0), traceur::Error);
}
