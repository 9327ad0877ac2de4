// SPDX-License-Identifier: MIT
#include <traceur/learn/policy.hpp>

#include <doctest/doctest.h>

using namespace traceur;
using namespace traceur::learn;

TEST_CASE("a policy is its normaliser, then its network, for any number of columns") {
  nn::Mlp<> network({3, 8, 2});
  core::RandomStream random(4);
  Eigen::VectorXf theta(network.parameters());
  network.initialize(theta.data(), random);
  nn::Normalizer normalizer(3);
  Eigen::MatrixXf seen(3, 200), expected(2, 200), action(2, 200);
  for (float* x = seen.data(); x != seen.data() + seen.size(); ++x) *x = static_cast<float>(2 + 3 * random.normal());
  normalizer.observe<float>(seen);
  Policy<float> policy(network, theta, normalizer);
  policy.act(seen, action);
  auto workspace = network.workspace<float>(1);
  for (Eigen::Index e = 0; e < seen.cols(); ++e) {
    Eigen::MatrixXf x(3, 1), y(2, 1);
    for (Eigen::Index i = 0; i < 3; ++i)
      x(i, 0) = static_cast<float>((static_cast<double>(seen(i, e)) - normalizer.mean(i)) / normalizer.deviation(i));
    x = x.cwiseMax(-5.0f).cwiseMin(5.0f);
    network.infer<float>(theta.data(), x, workspace, y);
    expected.col(e) = y;
  }
  CHECK((action - expected).cwiseAbs().maxCoeff() < 1e-5f);
}

TEST_CASE("parts that do not fit together are refused") {
  nn::Mlp<> network({3, 8, 2});
  CHECK_THROWS_WITH_AS((Policy<float>(network, Eigen::VectorXf::Zero(5), nn::Normalizer(3))),
                       "policy: expected 50 parameters, got 5", Error);
  CHECK_THROWS_WITH_AS((Policy<float>(network, Eigen::VectorXf::Zero(network.parameters()), nn::Normalizer(4))),
                       "policy: expected a normalizer of 3 observations, got 4", Error);
}
