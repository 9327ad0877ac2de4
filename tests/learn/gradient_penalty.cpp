// SPDX-License-Identifier: MIT
#include <traceur/learn/gradient_penalty.hpp>

#include <cmath>

#include <doctest/doctest.h>

#include "../nn/allocations.hpp"

using namespace traceur;
using namespace traceur::learn;

namespace {

/// A network, samples, and the penalty in its own words: input gradients by the network's own backward.
template <class A>
struct Bench {
  nn::Mlp<A> network;
  GradientPenalty<A> penalty;
  Eigen::VectorXd theta;
  Eigen::MatrixXd x;

  explicit Bench(std::vector<Eigen::Index> widths, Eigen::Index samples) : network(std::move(widths)), penalty(network) {
    core::RandomStream random(5);
    theta.resize(network.parameters());
    for (double& t : theta) t = random.normal(0, 0.6);
    x.resize(network.inputs(), samples);
    for (double* v = x.data(); v != x.data() + x.size(); ++v) *v = random.normal();
  }
  double by_backward(const Eigen::VectorXd& at) const {
    auto w = network.template workspace<double>(x.cols());
    Eigen::MatrixXd y(1, x.cols()), dx(x.rows(), x.cols());
    const Eigen::MatrixXd one = Eigen::MatrixXd::Ones(1, x.cols());
    Eigen::VectorXd unused = Eigen::VectorXd::Zero(at.size());
    network.template forward<double>(at.data(), x, w, y);
    network.template backward<double>(at.data(), x, one, w, unused.data(), dx);
    return dx.squaredNorm();
  }
  double accumulate(double scale, Eigen::VectorXd& gradient) const {
    auto w = network.template workspace<double>(x.cols());
    auto scratch = penalty.template workspace<double>(x.cols());
    Eigen::MatrixXd y(1, x.cols());
    network.template forward<double>(theta.data(), x, w, y);
    const long before = allocations();
    const double p = penalty.template accumulate<double>(theta.data(), x, w, scale, scratch, gradient.data());
    CHECK(allocations() == before);
    return p;
  }
};

}  // namespace

TEST_CASE_TEMPLATE("the gradient of the penalty is that of finite differences", A, nn::Relu, nn::LeakyRelu<>, nn::Tanh, nn::Sigmoid,
                   nn::Silu, nn::Gelu) {
  for (const std::vector<Eigen::Index>& widths :
       {std::vector<Eigen::Index>{5, 1}, {5, 7, 1}, {4, 9, 6, 1}, {3, 5, 8, 4, 1}}) {
    Bench<A> b(widths, 7);
    constexpr double scale = 0.3;
    Eigen::VectorXd gradient = Eigen::VectorXd::Constant(b.theta.size(), 2.0);  // it adds
    CHECK(b.accumulate(scale, gradient) == doctest::Approx(b.by_backward(b.theta)).epsilon(1e-12));
    gradient.array() -= 2.0;
    const double size = gradient.cwiseAbs().maxCoeff();
    CHECK(size > 0);
    for (Eigen::Index i = 0; i < b.theta.size(); ++i) {
      constexpr double h = 1e-5;
      Eigen::VectorXd more = b.theta, less = b.theta;
      more[i] += h;
      less[i] -= h;
      const double expected = scale * (b.by_backward(more) - b.by_backward(less)) / (2 * h);
      CHECK(std::abs(gradient[i] - expected) < 1e-6 * size);
    }
  }
}

TEST_CASE("a penalty worked by hand") {
  // D = 3 max(0, 2 x1 - x2) - max(0, x1 + x2); at (1, 0) both are active, at (0, 1) only the second.
  const nn::Mlp<> network({2, 2, 1});
  const GradientPenalty<> penalty(network);
  Eigen::VectorXd theta(network.parameters()), gradient = Eigen::VectorXd::Zero(theta.size());
  theta << 2, 1, -1, 1, 0, 0, 3, -1, 0;  // W1 by columns, b1, W2, b2
  Eigen::MatrixXd x(2, 2), y(1, 2);
  x << 1, 0, 0, 1;
  auto w = network.workspace<double>(2);
  auto scratch = penalty.workspace<double>(2);
  network.forward<double>(theta.data(), x, w, y);
  // Input gradients (5, -4) and (-1, -1): 41 + 2.
  CHECK(penalty.accumulate<double>(theta.data(), x, w, 0.5, scratch, gradient.data()) == doctest::Approx(43));
  Eigen::VectorXd expected(theta.size());
  // d/dW1 = delta g^T: (3, -1) (5, -4)^T + (0, -1) (-1, -1)^T; d/dW2 = W1 g, where active.
  expected << 15, -5 + 1, -12, 4 + 1, 0, 0, 14, 1 - 2, 0;
  CHECK((gradient - expected).cwiseAbs().maxCoeff() < 1e-12);
}

TEST_CASE("floats agree with doubles, and a network of two outputs is refused") {
  Bench<nn::Relu> b({6, 16, 8, 1}, 9);
  Eigen::VectorXd gradient = Eigen::VectorXd::Zero(b.theta.size());
  const double p = b.accumulate(1, gradient);
  const Eigen::VectorXf theta = b.theta.cast<float>();
  const Eigen::MatrixXf x = b.x.cast<float>();
  Eigen::MatrixXf y(1, x.cols());
  Eigen::VectorXf single = Eigen::VectorXf::Zero(theta.size());
  auto w = b.network.workspace<float>(x.cols());
  auto scratch = b.penalty.workspace<float>(x.cols());
  b.network.forward<float>(theta.data(), x, w, y);
  CHECK(b.penalty.accumulate<float>(theta.data(), x, w, 1.0f, scratch, single.data()) == doctest::Approx(p).epsilon(1e-5));
  CHECK((single.cast<double>() - gradient).norm() < 1e-5 * gradient.norm());
  CHECK_THROWS_WITH_AS(GradientPenalty<>(nn::Mlp<>({3, 2})), "gradient penalty: expected a network of one output, got 2", Error);
}
