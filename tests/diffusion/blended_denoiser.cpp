// SPDX-License-Identifier: MIT
#include <traceur/diffusion/blended_denoiser.hpp>

#include <limits>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/executor.hpp>
#include <traceur/diffusion/mlp_denoiser.hpp>
#include <traceur/diffusion/network_denoiser.hpp>

#include "support.hpp"

using namespace traceur::diffusion;
using Vec = Eigen::VectorXd;

TEST_CASE("a blend is its formula") {
  // An estimate that tells what it was given.
  auto inner = denoiser_of<double>(2, 1, [](int step, const Vec& x, const Vec& c, Parts given, Eigen::Index) {
    return Vec((given & 2) != 0 ? x * step + Vec::Constant(2, c[0]) : Vec(-x));
  });
  BlendedDenoiser blended = BlendedDenoiser<double, decltype(inner)>(inner, {2, 0.65}, 3);
  const Table<double> x = random_table<double>(2, 3, 1), c = random_table<double>(1, 3, 2);
  Table<double> clean(2, 3);
  blended.begin({c});
  blended.denoise(7, x, clean);
  for (int j = 0; j < 3; ++j) {
    const Vec expected = 0.65 * -x.col(j) + 0.35 * (7 * x.col(j) + Vec::Constant(2, c(0, j)));
    CHECK((clean.col(j) - expected).norm() < 1e-14);
  }
  // A sample that lacks the part anyway is not changed by blending.
  const Parts given[] = {1, 1, 3};
  blended.begin({c, given});
  blended.denoise(7, x, clean);
  CHECK((clean.col(1) + x.col(1)).norm() < 1e-14);
}

TEST_CASE("a denoiser that blends itself gives what the general way gives") {
  const MlpDenoiser<> net({.features = 3, .condition = {{2, 1}, {4, 2}}, .hidden = {16}, .step_features = 8});
  std::vector<double> theta(static_cast<std::size_t>(net.parameters()));
  traceur::core::RandomStream random(1);
  net.initialize(theta.data(), random);
  traceur::core::SerialExecutor serial;
  NetworkDenoiser<double, MlpDenoiser<>, traceur::core::SerialExecutor> inner(net, theta.data(), serial, 10);
  // Hides that it can blend.
  struct Plain {
    decltype(inner)& d;
    Eigen::Index features() const { return d.features(); }
    Eigen::Index condition_features() const { return d.condition_features(); }
    void begin(const Condition<double>& c) { d.begin(c); }
    void denoise(int k, traceur::nn::ConstMatrix<double> x, traceur::nn::Matrix<double> y) { d.denoise(k, x, y); }
  } plain{inner};
  static_assert(!BlendingDenoiser<Plain, double>);
  BlendedDenoiser<double, decltype(inner)> itself(inner, {2, 0.3}, 5);
  BlendedDenoiser<double, Plain> general(plain, {2, 0.3}, 5);
  const Table<double> x = random_table<double>(3, 5, 3), c = random_table<double>(6, 5, 4);
  Table<double> a(3, 5), b(3, 5);
  itself.begin({c});
  itself.denoise(4, x, a);
  general.begin({c});
  general.denoise(4, x, b);
  CHECK((a - b).norm() < 1e-13);
  inner.begin({c});
  inner.denoise(4, x, b);
  CHECK((a - b).norm() > 1e-3);
}

TEST_CASE("a blended denoiser refuses numbers out of range") {
  auto inner = denoiser_of<double>(1, 0, [](int, const Vec& x, const Vec&, Parts, Eigen::Index) { return x; });
  using B = BlendedDenoiser<double, decltype(inner)>;
  CHECK_THROWS_AS(B(inner, {1, 0.5}, 0), traceur::Error);
  CHECK_THROWS_AS(B(inner, {1, std::numeric_limits<double>::infinity()}, 1), traceur::Error);
}
