// SPDX-License-Identifier: MIT
// The code of docs/nn.md, but for that of its sequences.
#include <cmath>
#include <cstddef>

#include <doctest/doctest.h>

#include <traceur/nn/compact_mlp.hpp>
#include <traceur/nn/data_parallel.hpp>
#include <traceur/nn/gaussian_head.hpp>
#include <traceur/nn/mlp.hpp>
#include <traceur/nn/optimizer.hpp>
#include <traceur/nn/schedule.hpp>

using namespace traceur::nn;

TEST_CASE("docs/nn.md") {
  const Mlp<Tanh> net({1, 32, 32, 1});
  Eigen::VectorXf theta(net.parameters()), gradient(net.parameters());
  traceur::core::RandomStream random(7);
  net.initialize(theta.data(), random);

  const Eigen::Index n = 64;
  auto workspace = net.workspace<float>(n);
  const Eigen::MatrixXf x = Eigen::RowVectorXf::LinSpaced(n, -1.0f, 1.0f);
  const Eigen::MatrixXf goal = x.unaryExpr([](float at) { return std::sin(3.0f * at); });
  Eigen::MatrixXf y(1, n), dy(1, n);

  Adam<float> adam(net.parameters());
  const WarmUp rate{20, CosineRate{.first = 1e-2, .last = 0.0, .steps = 600}};
  for (int step = 0; step < 620; ++step) {
    net.forward(theta.data(), x, workspace, y);
    dy = (y - goal) / static_cast<float>(n);  // of half the mean squared error
    gradient.setZero();
    net.backward(theta.data(), x, dy, workspace, gradient.data(), no_gradient<float>());
    clip_global_norm(gradient.data(), gradient.size(), 1.0);
    adam.step(theta, gradient, rate(step));
  }
  CHECK((y - goal).cwiseAbs().maxCoeff() < 0.03f);

  CompactMlp<Tanh> compact(net, theta.data());  // load() takes new parameters
  auto room = compact.workspace();
  float in = 0.5f, estimate;
  compact.infer(&in, room, &estimate);
  CHECK(std::abs(estimate - std::sin(1.5f)) < 0.06f);

  // A policy's action, and the gradient that makes it more probable.
  const Mlp<> policy({10, 64, 3});
  const GaussianHead head(3, 0.1);
  Eigen::VectorXf weights(policy.parameters());
  policy.initialize(weights.data(), random, He{}, Normal{0.01});

  auto memory = policy.workspace<float>(1);
  auto deviations = head.workspace<float>();
  head.prepare<float>(nullptr, deviations);  // no parameters: the deviation is fixed

  Eigen::MatrixXf observation = Eigen::MatrixXf::Ones(10, 1), mean(3, 1), action(3, 1), dmean(3, 1);
  policy.forward(weights.data(), observation, memory, mean);
  head.sample<float>(deviations, mean, random, action);

  const Eigen::VectorXf one = Eigen::VectorXf::Ones(1);
  Eigen::VectorXf log_probability(1), uphill = Eigen::VectorXf::Zero(policy.parameters());
  head.log_probability<float>(deviations, mean, action, log_probability);
  head.log_probability_backward<float>(deviations, mean, action, one, dmean, nullptr);
  policy.backward(weights.data(), observation, dmean, memory, uphill.data(), no_gradient<float>());

  const float before = log_probability[0];
  weights += 1e-5f * uphill;
  policy.infer(weights.data(), observation, memory, mean);
  head.log_probability<float>(deviations, mean, action, log_probability);
  CHECK(log_probability[0] > before);

  DataParallel<float> parallel(net.parameters(), 4);
  auto workspaces = parallel.workspaces(net, n);
  traceur::core::ThreadExecutor threads(2);
  gradient.setZero();
  parallel.run(threads, n, gradient, [&](int chunk, Eigen::Index first, Eigen::Index count, float* part) {
    auto& w = workspaces[static_cast<std::size_t>(chunk)];
    net.forward(theta.data(), x.middleCols(first, count), w, y.middleCols(first, count));
    dy.middleCols(first, count) = (y - goal).middleCols(first, count) / static_cast<float>(n);
    net.backward(theta.data(), x.middleCols(first, count), dy.middleCols(first, count), w, part, no_gradient<float>());
  });
  Eigen::VectorXf whole = Eigen::VectorXf::Zero(net.parameters());
  net.forward(theta.data(), x, workspace, y);
  dy = (y - goal) / static_cast<float>(n);
  net.backward(theta.data(), x, dy, workspace, whole.data(), no_gradient<float>());
  CHECK((gradient - whole).norm() < 1e-6f);
}
