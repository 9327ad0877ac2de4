// SPDX-License-Identifier: MIT
#include <traceur/learn/discriminator.hpp>

#include <cmath>
#include <limits>

#include <doctest/doctest.h>

using namespace traceur;
using namespace traceur::learn;
using doctest::Approx;

namespace {

template <class A>
struct Bench {
  Discriminator<A> discriminator;
  Eigen::VectorXd theta;
  Eigen::MatrixXd real, fake;

  explicit Bench(const DiscriminatorParameters& p = {}) : discriminator(nn::Mlp<A>({4, 7, 5, 1}), p) {
    core::RandomStream random(8);
    theta.resize(discriminator.parameters());
    for (double& t : theta) t = random.normal(0, 0.5);
    for (Eigen::MatrixXd* m : {&real, &fake}) {
      m->resize(4, 6);
      for (double* v = m->data(); v != m->data() + m->size(); ++v) *v = random.normal();
    }
  }
  /// Eq. 3 and the regularisers, from values and gradients that the network gives.
  double loss(const Eigen::VectorXd& at) const {
    const DiscriminatorParameters& p = discriminator.settings();
    auto w = discriminator.network().template workspace<double>(6);
    Eigen::MatrixXd y(1, 6), dx(4, 6);
    const Eigen::MatrixXd one = Eigen::MatrixXd::Ones(1, 6);
    Eigen::VectorXd unused = Eigen::VectorXd::Zero(at.size());
    double sum = 0;
    discriminator.network().template forward<double>(at.data(), fake, w, y);
    for (int j = 0; j < 6; ++j) sum -= std::log(1 - 1 / (1 + std::exp(-y(0, j)))) / 6;
    discriminator.network().template forward<double>(at.data(), real, w, y);
    discriminator.network().template backward<double>(at.data(), real, one, w, unused.data(), dx);
    for (int j = 0; j < 6; ++j) sum -= std::log(1 / (1 + std::exp(-y(0, j)))) / 6;
    sum += p.gradient_penalty * dx.squaredNorm() / 6;
    discriminator.network().for_each_parameter([&](std::string_view name, Eigen::Index offset, Eigen::Index rows, Eigen::Index cols) {
      if (!name.ends_with("weight")) return;
      const double squares = at.segment(offset, rows * cols).squaredNorm();
      sum += (p.weight_decay + (name == "layers.2.weight" ? p.logit_regularizer : 0.0)) * squares;
    });
    return sum;
  }
  Eigen::VectorXd gradient(DiscriminatorTally& on_real, DiscriminatorTally& on_fake, double& rest) const {
    Eigen::VectorXd out = Eigen::VectorXd::Zero(theta.size());
    auto w = discriminator.template workspace<double>(6);
    // Cut in two, as threads would.
    for (const int first : {0, 2}) {
      const int count = first == 0 ? 2 : 4;
      on_real += discriminator.template accumulate_real<double>(theta.data(), real.middleCols(first, count), 1.0 / 6, w, out.data());
      on_fake += discriminator.template accumulate_fake<double>(theta.data(), fake.middleCols(first, count), 1.0 / 6, w, out.data());
    }
    rest = discriminator.regularize(theta.data(), out.data());
    return out;
  }
};

}  // namespace

TEST_CASE_TEMPLATE("loss and gradient are those of Eq. 3 and the regularisers", A, nn::Relu, nn::Silu) {
  DiscriminatorParameters p;
  p.gradient_penalty = 0.7;
  p.logit_regularizer = 0.2;
  p.weight_decay = 0.05;
  const Bench<A> b(p);
  DiscriminatorTally real, fake;
  double rest = 0;
  const Eigen::VectorXd got = b.gradient(real, fake, rest);
  CHECK((real.loss + fake.loss + p.gradient_penalty * real.penalty) / 6 + rest == Approx(b.loss(b.theta)).epsilon(1e-12));
  CHECK(real.samples == 6);
  const double size = got.cwiseAbs().maxCoeff();
  for (Eigen::Index i = 0; i < b.theta.size(); ++i) {
    Eigen::VectorXd more = b.theta, less = b.theta;
    more[i] += 1e-5;
    less[i] -= 1e-5;
    CHECK(std::abs(got[i] - (b.loss(more) - b.loss(less)) / 2e-5) < 1e-6 * size);
  }
}

TEST_CASE("a sample on its own side of zero counts as right") {
  const Bench<nn::Relu> b;
  DiscriminatorTally real, fake;
  double rest = 0;
  b.gradient(real, fake, rest);
  Eigen::MatrixXd logit(1, 6);
  auto w = b.discriminator.workspace<double>(6);
  b.discriminator.infer<double>(b.theta.data(), b.real, w, logit);
  CHECK(real.right == (logit.array() > 0).count());
  CHECK(real.logit == Approx(logit.sum()));
  b.discriminator.infer<double>(b.theta.data(), b.fake, w, logit);
  CHECK(fake.right == (logit.array() < 0).count());
}

TEST_CASE("the style reward is -log(1 - D), bounded, and no logit overflows it") {
  const StyleReward reward;
  for (const double logit : {-3.0, 0.0, 2.5}) CHECK(reward(logit) == Approx(-std::log(1 - 1 / (1 + std::exp(-logit)))).epsilon(1e-12));
  CHECK(reward(0.0) == Approx(std::log(2.0)));
  CHECK(reward(1e4f) == Approx(-std::log(1e-4)));
  CHECK(reward(-1e4) == 0);
  CHECK(StyleReward{2.0, 1e-4}(0.0f) == Approx(2 * std::log(2.0)));
  CHECK(probability(-800.0) == 0);
  CHECK(probability(800.0) == 1);
  CHECK(probability(0.3) + probability(-0.3) == Approx(1));
}

TEST_CASE("a step down the gradient tells two heaps apart") {
  Discriminator<> d(nn::Mlp<>({2, 16, 1}));
  core::RandomStream random(2);
  Eigen::VectorXf theta(d.parameters()), gradient(d.parameters());
  d.network().initialize(theta.data(), random);
  Eigen::MatrixXf real(2, 64), fake(2, 64);
  for (int j = 0; j < 64; ++j) {
    real.col(j) << static_cast<float>(random.normal(1, 0.5)), static_cast<float>(random.normal());
    fake.col(j) << static_cast<float>(random.normal(-1, 0.5)), static_cast<float>(random.normal());
  }
  auto w = d.workspace<float>(64);
  nn::Adam<float> adam(d.parameters());
  double right = 0;
  for (int k = 0; k < 300; ++k) {
    gradient.setZero();
    right = d.accumulate_real<float>(theta.data(), real, 1.0f / 64, w, gradient.data()).right +
            d.accumulate_fake<float>(theta.data(), fake, 1.0f / 64, w, gradient.data()).right;
    d.regularize(theta.data(), gradient.data());
    adam.step(theta, gradient, 3e-3);
  }
  CHECK(right > 0.9 * 128);
}

TEST_CASE("weights below zero and networks of two outputs are refused") {
  CHECK_THROWS_AS(Discriminator<>(nn::Mlp<>({2, 2})), Error);
  CHECK_THROWS_WITH_AS(Discriminator<>(nn::Mlp<>({2, 1}), {-1, 0, 0}), "discriminator: expected weights of zero or more", Error);
}
