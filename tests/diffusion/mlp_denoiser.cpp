// SPDX-License-Identifier: MIT
#include <traceur/diffusion/mlp_denoiser.hpp>

#include <vector>

#include <doctest/doctest.h>

#include "network_laws.hpp"

using namespace traceur::diffusion;

TEST_CASE("an MLP denoiser obeys the laws of networks") {
  check_network(MlpDenoiser<>({.features = 3, .condition = {{2, 1}, {4, 2 | 8}}, .hidden = {12, 10}, .step_features = 6}),
                {all_parts, 1, 2, 0, 10});
  check_network(MlpDenoiser<traceur::nn::Tanh>({.features = 1, .condition = {}, .hidden = {}, .step_features = 2}),
                {all_parts, 0});
}

TEST_CASE("a part that is not given does not matter") {
  const MlpDenoiser<> net({.features = 2, .condition = {{2, 1}, {3, 2}}, .hidden = {8}, .step_features = 4});
  std::vector<double> theta(static_cast<std::size_t>(net.parameters()));
  traceur::core::RandomStream random(3);
  net.initialize(theta.data(), random);
  auto w = net.workspace<double>(1);
  const Table<double> x = random_table<double>(2, 1, 4);
  Table<double> c = random_table<double>(5, 1, 5), a(2, 1), b(2, 1);
  const int step = 3;
  const Parts given = 1;
  net.forward(theta.data(), &step, x, {c, &given}, w, a);
  c.bottomRows(3).setConstant(100);
  net.forward(theta.data(), &step, x, {c, &given}, w, b);
  CHECK(same_bits<double>(a, b));
  // Absent is not the same as zero.
  c.bottomRows(3).setZero();
  const Parts all = 3;
  net.forward(theta.data(), &step, x, {c, &all}, w, b);
  CHECK(a != b);
}

TEST_CASE("an MLP denoiser refuses shapes that do not fit") {
  CHECK_THROWS_AS(MlpDenoiser<>({.features = 0, .condition = {}, .hidden = {}, .step_features = 2}), traceur::Error);
  CHECK_THROWS_AS(MlpDenoiser<>({.features = 1, .condition = {{0, 1}}, .hidden = {}, .step_features = 2}), traceur::Error);
  CHECK_THROWS_AS(MlpDenoiser<>({.features = 1, .condition = {}, .hidden = {}, .step_features = 3}), traceur::Error);
}
