// SPDX-License-Identifier: MIT
#include <traceur/diffusion/training.hpp>

#include <cmath>
#include <numbers>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/executor.hpp>
#include <traceur/diffusion/ddim.hpp>
#include <traceur/diffusion/mlp_denoiser.hpp>
#include <traceur/diffusion/network_denoiser.hpp>
#include <traceur/nn/optimizer.hpp>
#include <traceur/nn/schedule.hpp>

#include "support.hpp"

using namespace traceur::diffusion;
using traceur::core::RandomStream;
using traceur::core::SerialExecutor;
using traceur::core::ThreadExecutor;

static_assert(DenoisingLoss<SquaredError<float>, float> && DenoisingLoss<SquaredError<double>, double>);

namespace {

constexpr double pi = std::numbers::pi;

// Two half circles that reach into each other, a little blurred. Label -1 is the upper one; they take turns.
void two_moons(Table<float>& points, Table<float>& labels, std::uint64_t seed) {
  for (Eigen::Index j = 0; j < points.cols(); ++j) {
    RandomStream random(seed, static_cast<std::uint64_t>(j));
    const bool lower = j % 2 != 0;
    const double t = random.uniform(0, pi);
    points(0, j) = static_cast<float>((lower ? 1 - std::cos(t) : std::cos(t)) - 0.5 + 0.05 * random.normal());
    points(1, j) = static_cast<float>((lower ? 0.5 - std::sin(t) : std::sin(t)) - 0.25 + 0.05 * random.normal());
    labels(0, j) = lower ? 1.0f : -1.0f;
  }
}

// Which moon is nearer, as a label.
float nearest_moon(double x, double y) {
  const auto away = [](double u, double v) {  // from the upper half of the unit circle
    return v > 0 ? std::abs(std::hypot(u, v) - 1) : std::hypot(std::abs(u) - 1, v);
  };
  return away(x + 0.5, y + 0.25) < away(0.5 - x, 0.25 - y) ? -1.0f : 1.0f;
}

double mean_distance(const Table<float>& a, const Table<float>& b) {
  double sum = 0;
  for (Eigen::Index j = 0; j < b.cols(); ++j) sum += (a.colwise() - b.col(j)).colwise().norm().cast<double>().sum();
  return sum / static_cast<double>(a.cols() * b.cols());
}

// Szekely and Rizzo 2013: zero for equal distributions alone.
double energy_distance(const Table<float>& a, const Table<float>& b) {
  return 2 * mean_distance(a, b) - mean_distance(a, a) - mean_distance(b, b);
}

}  // namespace

TEST_CASE("a generator of two moons") {
  constexpr Eigen::Index batch = 128, drawn = 1000;
  const MlpDenoiser<> net({.features = 2, .condition = {{1, 1}}, .hidden = {64, 64, 64}, .step_features = 16});
  const Schedule schedule = Schedule::cosine(50);
  const SquaredError<float> loss;
  Training<float, MlpDenoiser<>> training(net, schedule, loss, {.batch = batch, .chunks = 2, .drops = {{1, 0.5}}, .seed = 3});
  Eigen::VectorXf theta(net.parameters()), gradient(net.parameters());
  RandomStream random(2);
  net.initialize(theta.data(), random);
  traceur::nn::Adam<float> adam(net.parameters());
  const int steps = 8000;
  const traceur::nn::CosineRate rate{.first = 3e-3, .last = 1e-5, .steps = steps};
  SerialExecutor serial;
  Table<float> points(2, batch), labels(1, batch);
  for (int step = 0; step < steps; ++step) {
    two_moons(points, labels, 100 + static_cast<std::uint64_t>(step));
    gradient.setZero();
    training.run(serial, theta.data(), points, {labels}, static_cast<std::uint64_t>(step), gradient);
    adam.step(theta, gradient, rate(step));
  }

  Table<float> truth(2, drawn), which(1, drawn), x(2, drawn), normal(2, drawn);
  two_moons(truth, which, 5);
  // The normal distribution of the same mean and deviations.
  draw_noise<float>(normal, 7);
  const Eigen::Vector2f mean = truth.rowwise().mean();
  const Eigen::Vector2f deviation = ((truth.colwise() - mean).rowwise().squaredNorm() / float(drawn)).cwiseSqrt();
  normal = (deviation.asDiagonal() * normal).colwise() + mean;
  const double far = energy_distance(normal, truth);
  MESSAGE("energy distance of a normal distribution: " << far);
  NetworkDenoiser<float, MlpDenoiser<>, SerialExecutor> denoiser(net, theta.data(), serial, drawn, 100);
  const std::vector<Parts> none(drawn, 0);
  for (const int stride : {1, 5}) {
    Ddim<float> ddim(schedule, stride, 2, drawn);
    draw_noise<float>(x, 6);
    ddim.sample(denoiser, {which, none.data()}, x);
    const double either = energy_distance(x, truth);
    draw_noise<float>(x, 6);
    ddim.sample(denoiser, {which}, x);
    const double asked = energy_distance(x, truth);
    int right = 0;
    for (Eigen::Index j = 0; j < drawn; ++j) right += nearest_moon(x(0, j), x(1, j)) == which(0, j);
    MESSAGE("stride " << stride << ": energy distance " << either << ", with a condition " << asked << ", " << right
                      << " of 1000 of the moon asked for");
    CHECK(either < 0.5 * far);
    CHECK(asked < 0.008);
    CHECK(right > 950);
  }
}

TEST_CASE("energy distance tells apart what the generator is to be told apart from") {
  Table<float> a(2, 1000), b(2, 1000), labels(1, 1000), half(2, 500);
  two_moons(a, labels, 1);
  two_moons(b, labels, 2);
  CHECK(energy_distance(a, b) < 0.003);
  // A factor of the covariance, about the mean of zero.
  const double xx = b.row(0).squaredNorm() / 1000.0, xy = b.row(0).dot(b.row(1)) / 1000.0, yy = b.row(1).squaredNorm() / 1000.0;
  Eigen::Matrix2f root;
  root << static_cast<float>(std::sqrt(xx)), 0.0f, static_cast<float>(xy / std::sqrt(xx)),
      static_cast<float>(std::sqrt(yy - xy * xy / xx));
  CHECK(energy_distance(a, root * random_table<float>(2, 1000, 3)) > 0.02);
  for (Eigen::Index j = 0; j < 500; ++j) half.col(j) = b.col(2 * j);
  CHECK(energy_distance(a, half) > 0.1);
  int right = 0;
  for (Eigen::Index j = 0; j < 1000; ++j) right += nearest_moon(a(0, j), a(1, j)) == labels(0, j);
  CHECK(right > 995);
}

TEST_CASE("what a step draws is as it should be") {
  const MlpDenoiser<> net({.features = 4, .condition = {{1, 1}, {1, 2}}, .hidden = {4}, .step_features = 2});
  const Schedule schedule = Schedule::cosine(7);
  const SquaredError<double> loss;
  const Eigen::Index n = 4000;
  Training<double, MlpDenoiser<>> training(net, schedule, loss, {.batch = n, .chunks = 3, .drops = {{1, 0.25}, {2, 1.0}}, .seed = 1});
  Eigen::VectorXd theta(net.parameters()), gradient = Eigen::VectorXd::Zero(net.parameters());
  RandomStream random(2);
  net.initialize(theta.data(), random);
  const Table<double> clean = random_table<double>(4, n, 5), values = random_table<double>(2, n, 6);
  SerialExecutor serial;
  training.run(serial, theta.data(), clean, {values}, 9, gradient);
  double count[8] = {}, dropped = 0, sum[8] = {}, squares[8] = {};
  for (Eigen::Index j = 0; j < n; ++j) {
    const auto i = static_cast<std::size_t>(j);
    const int k = training.steps()[i];
    REQUIRE((k >= 1 && k <= 7));
    ++count[k];
    dropped += (training.given()[i] & 1) == 0;
    CHECK((training.given()[i] & 2) == 0);
    const Eigen::VectorXd eps = (training.noisy(n).col(j) - schedule.signal(k) * clean.col(j)) / schedule.noise(k);
    sum[k] += eps.sum();
    squares[k] += eps.squaredNorm();
  }
  CHECK(dropped / n == doctest::Approx(0.25).epsilon(0.1));
  for (int k = 1; k <= 7; ++k) {
    CHECK(count[k] == doctest::Approx(n / 7.0).epsilon(0.15));
    CHECK(std::abs(sum[k] / (4 * count[k])) < 0.1);
    CHECK(squares[k] / (4 * count[k]) == doctest::Approx(1.0).epsilon(0.15));
  }
}

TEST_CASE("a step's gradient is that of the loss it returns") {
  const MlpDenoiser<> net({.features = 3, .condition = {{2, 1}}, .hidden = {6}, .step_features = 4});
  const SquaredError<double> loss;
  Training<double, MlpDenoiser<>> training(net, Schedule::cosine(9), loss, {.batch = 8, .chunks = 3, .drops = {{1, 0.5}}, .seed = 1});
  Eigen::VectorXd theta(net.parameters()), gradient = Eigen::VectorXd::Zero(net.parameters()), unused = gradient;
  RandomStream random(2);
  net.initialize(theta.data(), random);
  const Table<double> clean = random_table<double>(3, 7, 5), values = random_table<double>(2, 7, 6);
  SerialExecutor serial;
  const double value = training.run(serial, theta.data(), clean, {values}, 4, gradient);
  CHECK(value == doctest::Approx((training.estimate(7) - clean).squaredNorm() / 7));
  const Eigen::VectorXd direction = random_table<double>(net.parameters(), 1, 7);
  const double h = 1e-6;
  const double up = training.run(serial, (theta + h * direction).eval().data(), clean, {values}, 4, unused);
  const double down = training.run(serial, (theta - h * direction).eval().data(), clean, {values}, 4, unused);
  CHECK(gradient.dot(direction) == doctest::Approx((up - down) / (2 * h)).epsilon(1e-6));
}

TEST_CASE("a step has the same bits on any threads") {
  const MlpDenoiser<> net({.features = 3, .condition = {{2, 1}}, .hidden = {24}, .step_features = 4});
  const SquaredError<float> loss;
  Eigen::VectorXf theta(net.parameters());
  RandomStream random(2);
  net.initialize(theta.data(), random);
  const Table<float> clean = random_table<float>(3, 30, 5), values = random_table<float>(2, 30, 6);
  Table<float> first;
  for (const int threads : {1, 2, 3}) {
    ThreadExecutor executor(threads);
    Training<float, MlpDenoiser<>> training(net, Schedule::cosine(9), loss, {.batch = 32, .chunks = 7, .drops = {{1, 0.5}}, .seed = 1});
    Table<float> gradient = Table<float>::Zero(net.parameters(), 1);
    training.run(executor, theta.data(), clean, {values}, 4, gradient.col(0));
    if (threads == 1) first = gradient;
    CHECK(same_bits<float>(gradient, first));
  }
}

TEST_CASE("training refuses numbers out of range") {
  const MlpDenoiser<> net({.features = 3, .condition = {}, .hidden = {2}, .step_features = 4});
  const SquaredError<float> loss;
  using T = Training<float, MlpDenoiser<>>;
  CHECK_THROWS_AS(T(net, Schedule::cosine(9), loss, {.batch = 0, .chunks = 1, .drops = {}, .seed = 1}), traceur::Error);
  CHECK_THROWS_AS(T(net, Schedule::cosine(9), loss, {.batch = 4, .chunks = 0, .drops = {}, .seed = 1}), traceur::Error);
  CHECK_THROWS_WITH_AS(T(net, Schedule::cosine(9), loss, {.batch = 4, .chunks = 1, .drops = {{1, 1.5}}, .seed = 1}),
                       "training: expected a probability in [0, 1], got 1.500000", traceur::Error);
}
