// SPDX-License-Identifier: MIT
#include <traceur/nn/gaussian_head.hpp>

#include <cmath>
#include <string>
#include <string_view>
#include <vector>

#include <doctest/doctest.h>

#include "allocations.hpp"

using namespace traceur::nn;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using traceur::core::RandomStream;
using Deviation = GaussianHead::Deviation;

namespace {

MatrixXd random_matrix(Index rows, Index cols, unsigned seed) {
  RandomStream random(seed);
  MatrixXd m(rows, cols);
  for (Index i = 0; i < m.size(); ++i) m.data()[i] = random.normal();
  return m;
}

struct Setting {
  explicit Setting(Index d, unsigned seed = 1, Index columns = 5)
      : head(VectorXd::LinSpaced(d, 0.2, 1.5), Deviation::learned),
        theta(d),
        mean(random_matrix(d, columns, seed)),
        actions(random_matrix(d, columns, seed + 1)),
        w(head.workspace<double>()) {
    head.initialize(theta.data());
    theta += 0.1 * random_matrix(d, 1, seed + 2);
    head.prepare(theta.data(), w);
  }
  VectorXd log_probability() {
    VectorXd out(mean.cols());
    head.prepare(theta.data(), w);
    head.log_probability<double>(w, mean, actions, out);
    return out;
  }
  GaussianHead head;
  VectorXd theta;
  MatrixXd mean, actions;
  GaussianHead::Workspace<double> w;
};

}  // namespace

TEST_CASE("the log-probability is that of the product of densities") {
  Setting s(4);
  const VectorXd found = s.log_probability();
  for (Index j = 0; j < 5; ++j) {
    double density = 1.0;
    for (Index i = 0; i < 4; ++i) {
      const double deviation = std::exp(s.theta[i]), z = (s.actions(i, j) - s.mean(i, j)) / deviation;
      density *= std::exp(-0.5 * z * z) / (deviation * std::sqrt(2.0 * std::acos(-1.0)));
    }
    CHECK(found[j] == doctest::Approx(std::log(density)).epsilon(1e-12));
  }
}

TEST_CASE("the density integrates to one, and its entropy is the mean of -log p") {
  const GaussianHead head(1, 0.3);
  auto w = head.workspace<double>();
  head.prepare<double>(nullptr, w);
  const Index n = 2001;
  const MatrixXd x = VectorXd::LinSpaced(n, -3.0, 3.0).transpose(), mean = MatrixXd::Constant(1, n, 0.2);
  VectorXd logp(n);
  head.log_probability<double>(w, mean, x, logp);
  const double dx = 6.0 / static_cast<double>(n - 1);
  CHECK(logp.array().exp().sum() * dx == doctest::Approx(1.0).epsilon(1e-10));
  CHECK(-(logp.array().exp() * logp.array()).sum() * dx == doctest::Approx(head.entropy(w)).epsilon(1e-10));
}

TEST_CASE("gradients are those of a weighting of the log-probabilities and the entropy") {
  Setting s(4);
  const VectorXd g = random_matrix(5, 1, 9);
  const double g_entropy = 0.7, h = 1e-6;
  const auto loss = [&] {
    const double sum = g.dot(s.log_probability());
    return sum + g_entropy * s.head.entropy(s.w);
  };
  VectorXd dtheta = VectorXd::Constant(4, 2.0);
  MatrixXd dmean(4, 5);
  loss();
  s.head.log_probability_backward<double>(s.w, s.mean, s.actions, g, dmean, dtheta.data());
  s.head.entropy_backward(g_entropy, dtheta.data());
  const auto difference = [&](double& at) {
    const double before = at;
    at = before + h;
    const double up = loss();
    at = before - h;
    const double down = loss();
    at = before;
    return (up - down) / (2 * h);
  };
  for (Index i = 0; i < 4; ++i) CHECK(dtheta[i] - 2.0 == doctest::Approx(difference(s.theta[i])).epsilon(1e-6));
  for (Index i = 0; i < 20; ++i) CHECK(dmean.data()[i] == doctest::Approx(difference(s.mean.data()[i])).epsilon(1e-6));
}

TEST_CASE("samples have the mean and the deviation asked for") {
  const Index n = 20000;
  VectorXd deviations(2);
  deviations << 0.1, 2.0;
  const GaussianHead head(deviations);
  auto w = head.workspace<double>();
  head.prepare<double>(nullptr, w);
  MatrixXd mean(2, n), a(2, n);
  mean.row(0).setConstant(3.0);
  mean.row(1).setConstant(-1.0);
  RandomStream random(3);
  head.sample<double>(w, mean, random, a);
  for (Index i = 0; i < 2; ++i) {
    const double sigma = deviations[i], error = a.row(i).mean() - mean(i, 0);
    CHECK(std::abs(error) < 4.0 * sigma / std::sqrt(static_cast<double>(n)));
    const double variance = (a.row(i) - mean.row(i)).squaredNorm() / static_cast<double>(n);
    CHECK(variance == doctest::Approx(sigma * sigma).epsilon(4.0 * std::sqrt(2.0 / static_cast<double>(n))));
  }
  CHECK(std::abs((a.row(0) - mean.row(0)).dot(a.row(1) - mean.row(1)) / (0.2 * static_cast<double>(n))) < 0.03);
  VectorXd logp(n);
  head.log_probability<double>(w, mean, a, logp);
  CHECK(-logp.mean() == doctest::Approx(head.entropy(w)).epsilon(0.02));
}

TEST_CASE("the divergence is the mean of the log-ratio, zero only for the same distribution") {
  const Index n = 40000;
  Setting p(3, 1), q(3, 7);
  VectorXd found(5);
  p.head.divergence<double>(p.w, p.mean, p.w, p.mean, found);
  CHECK(found.cwiseAbs().maxCoeff() < 1e-14);
  p.head.divergence<double>(p.w, p.mean, q.w, q.mean, found);
  CHECK(found.minCoeff() > 0.0);

  const MatrixXd mean_p = p.mean.col(0).replicate(1, n), mean_q = q.mean.col(0).replicate(1, n);
  MatrixXd a(3, n);
  VectorXd log_p(n), log_q(n);
  RandomStream random(5);
  p.head.sample<double>(p.w, mean_p, random, a);
  p.head.log_probability<double>(p.w, mean_p, a, log_p);
  q.head.log_probability<double>(q.w, mean_q, a, log_q);
  const double mean = (log_p - log_q).mean();
  const double error = std::sqrt((log_p - log_q).array().square().mean() / static_cast<double>(n));
  CHECK(std::abs(mean - found[0]) < 4.0 * error);
}

TEST_CASE("fixed deviations are no parameters") {
  const GaussianHead head(3, 0.5);
  CHECK(head.parameters() == 0);
  auto w = head.workspace<float>();
  head.prepare<float>(nullptr, w);
  CHECK(w.deviation[2] == doctest::Approx(0.5));
  Eigen::MatrixXf m = Eigen::MatrixXf::Ones(3, 2), a = m, d(3, 2);
  Eigen::VectorXf g = Eigen::VectorXf::Ones(2), logp(2);
  RandomStream random(1);
  const long before = allocations();
  head.sample<float>(w, m, random, a);
  head.log_probability<float>(w, m, a, logp);
  head.log_probability_backward<float>(w, m, a, g, d, nullptr);
  head.entropy_backward(1.0f, static_cast<float*>(nullptr));
  CHECK(allocations() == before);
  std::vector<std::string> names;
  const auto collect = [&](std::string_view name, Index, Index rows, Index) {
    names.push_back(std::string(name) + std::to_string(rows));
  };
  head.for_each_parameter(collect);
  CHECK(names.empty());
  GaussianHead(3, 0.5, Deviation::learned).for_each_parameter(collect);
  CHECK(names == std::vector<std::string>{"log_deviation3"});
}

TEST_CASE("impossible heads are refused") {
  CHECK_THROWS_WITH_AS(GaussianHead(0, 1.0), "gaussian head: expected at least one component, got 0", traceur::Error);
  CHECK_THROWS_AS(GaussianHead(-1, 1.0), traceur::Error);
  CHECK_THROWS_AS(GaussianHead(2, 0.0), traceur::Error);
  CHECK_THROWS_AS(GaussianHead(2, std::nan("")), traceur::Error);
}
