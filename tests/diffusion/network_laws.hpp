// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <string>
#include <string_view>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/random.hpp>
#include <traceur/diffusion/denoiser.hpp>

#include "support.hpp"

/// The laws of a DenoisingNetwork, checked in double with samples that lack different parts.
template <class N>
void check_network(const N& net, const std::vector<traceur::diffusion::Parts>& given) {
  using namespace traceur::diffusion;
  const auto n = static_cast<Eigen::Index>(given.size());
  Eigen::VectorXd theta(net.parameters());
  traceur::core::RandomStream random(11);
  net.initialize(theta.data(), random);
  const Table<double> x = random_table<double>(net.features(), n, 12);
  const Table<double> values = random_table<double>(net.condition_features(), n, 13);
  const Condition<double> condition{values, given.data()};
  std::vector<int> steps;
  for (Eigen::Index j = 0; j < n; ++j) steps.push_back(1 + static_cast<int>(j) * 3);

  // Tensors fill the parameters without a gap.
  Eigen::Index end = 0;
  std::vector<std::string> names;
  net.for_each_parameter([&](std::string_view name, Eigen::Index offset, Eigen::Index rows, Eigen::Index cols) {
    CHECK(offset == end);
    end = offset + rows * cols;
    names.emplace_back(name);
  });
  CHECK(end == net.parameters());
  std::sort(names.begin(), names.end());
  CHECK(std::adjacent_find(names.begin(), names.end()) == names.end());

  // Each sample is inferred as it is estimated in training, alone and in a batch.
  auto w = net.template workspace<double>(n);
  Table<double> y(net.features(), n), z(net.features(), n);
  net.forward(theta.data(), steps.data(), x, condition, w, y);
  auto prepared = net.template prepared<double>(n);
  auto scratch = net.template scratch<double>(n);
  net.load(theta.data(), prepared);
  net.prepare(theta.data(), condition, 0, scratch, prepared);
  for (Eigen::Index j = 0; j < n; ++j) {
    net.infer(theta.data(), steps[static_cast<std::size_t>(j)], x.col(j), prepared, j, 0, scratch, z.col(j));
  }
  CHECK((y - z).cwiseAbs().maxCoeff() < 1e-12 * (1 + y.cwiseAbs().maxCoeff()));
  Table<double> batch(net.features(), n);
  net.infer(theta.data(), 4, x, prepared, 0, 0, scratch, batch);
  for (Eigen::Index j = 0; j < n; ++j) {
    net.infer(theta.data(), 4, x.col(j), prepared, j, 0, scratch, z.col(j));
  }
  CHECK(same_bits<double>(batch, z));

  // To be without a part is as if it had not been given.
  for (const Parts without : {Parts{1}, Parts{2}, Parts{8}}) {
    std::vector<Parts> less;
    for (const Parts p : given) less.push_back(p & ~without);
    net.forward(theta.data(), steps.data(), x, {values, less.data()}, w, y);
    for (Eigen::Index j = 0; j < n; ++j) {
      net.infer(theta.data(), steps[static_cast<std::size_t>(j)], x.col(j), prepared, j, without, scratch, z.col(j));
    }
    CHECK((y - z).cwiseAbs().maxCoeff() < 1e-12 * (1 + y.cwiseAbs().maxCoeff()));
  }

  // backward against central differences along random directions, one for each tensor.
  const Table<double> weights = random_table<double>(net.features(), n, 14);
  const auto value = [&](const Eigen::VectorXd& at) {
    net.forward(at.data(), steps.data(), x, condition, w, y);
    return (y.array() * weights.array()).sum();
  };
  value(theta);
  Eigen::VectorXd gradient = Eigen::VectorXd::Ones(net.parameters());
  net.backward(theta.data(), weights, w, gradient.data());
  gradient.array() -= 1;  // it was added to
  net.for_each_parameter([&](std::string_view name, Eigen::Index offset, Eigen::Index rows, Eigen::Index cols) {
    Eigen::VectorXd direction = Eigen::VectorXd::Zero(net.parameters());
    for (Eigen::Index i = 0; i < rows * cols; ++i) direction[offset + i] = random.normal();
    const double h = 1e-6 / std::sqrt(static_cast<double>(rows * cols));
    const double difference = (value(theta + h * direction) - value(theta - h * direction)) / (2 * h);
    const double slope = gradient.dot(direction);
    INFO(std::string(name));
    CHECK(std::abs(slope - difference) < 2e-6 * (1 + std::abs(difference)));
  });
}
