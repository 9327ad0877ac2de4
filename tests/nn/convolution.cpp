// SPDX-License-Identifier: MIT
#include <traceur/nn/convolution.hpp>

#include <doctest/doctest.h>

#include "module_laws.hpp"

using namespace traceur::nn;
using laws::Index;
using Matrixd = Eigen::MatrixXd;

namespace {

using Shape = Convolution::Parameters;

const Shape shapes[] = {
    {1, 5, 6, 2, 3, 1, 0},   // no zeros around
    {3, 4, 5, 9, 3, 1, 1},   // as large as before
    {2, 7, 5, 3, 2, 2, 0},   // the last row and column fall off
    {2, 5, 7, 3, 3, 2, 1},   //
    {1, 3, 3, 2, 3, 3, 3},   // patches of zeros only
    {4, 1, 1, 5, 1, 1, 0},   // a dense layer
    {1, 2, 3, 1, 4, 1, 2},   // a kernel larger than the image
};

// The formula, number by number.
Matrixd definition(const Shape& s, const Matrixd& theta, const Matrixd& x) {
  const Index height = (s.height + 2 * s.padding - s.kernel) / s.stride + 1;
  const Index width = (s.width + 2 * s.padding - s.kernel) / s.stride + 1;
  const auto pixel = [&](Index image, Index c, Index r, Index q) {
    return r < 0 || q < 0 || r >= s.height || q >= s.width ? 0.0 : x((c * s.height + r) * s.width + q, image);
  };
  const auto weight = [&](Index o, Index c, Index i, Index j) {
    return theta(o + s.filters * ((c * s.kernel + i) * s.kernel + j), 0);
  };
  Matrixd y(s.filters * height * width, x.cols());
  for (Index image = 0; image < x.cols(); ++image) {
    for (Index o = 0; o < s.filters; ++o) {
      for (Index r = 0; r < height; ++r) {
        for (Index q = 0; q < width; ++q) {
          double sum = theta(s.filters * s.channels * s.kernel * s.kernel + o, 0);
          for (Index c = 0; c < s.channels; ++c) {
            for (Index i = 0; i < s.kernel; ++i) {
              for (Index j = 0; j < s.kernel; ++j) {
                sum += weight(o, c, i, j) * pixel(image, c, r * s.stride + i - s.padding, q * s.stride + j - s.padding);
              }
            }
          }
          y((o * height + r) * width + q, image) = sum;
        }
      }
    }
  }
  return y;
}

}  // namespace

TEST_CASE("a convolution is its definition") {
  for (const Shape& s : shapes) {
    const Convolution m(s);
    const Matrixd theta = laws::random_parameters(m, 1), x = laws::random_table(m.inputs(), 2, 2);
    CAPTURE(s.kernel);
    CHECK(laws::relative_error(laws::output(m, theta, x), definition(s, theta, x)) < 1e-12);
  }
}

TEST_CASE("an image larger than the cache goes through in pieces") {
  const Shape s{16, 20, 43, 70, 5, 1, 2};
  const Convolution m(s);
  REQUIRE(m.workspace<double>(1).strip.size() < m.outputs());
  const Matrixd theta = laws::random_parameters(m, 3), x = laws::random_table(m.inputs(), 1, 4);
  CHECK(laws::relative_error(laws::output(m, theta, x), definition(s, theta, x)) < 1e-12);

  // Linear in x and in the weights, so backward is the transpose of forward: dy . y(x) without bias = dx . x = dw . w.
  Matrixd linear = theta;
  linear.bottomRows(s.filters).setZero();
  const Matrixd y = laws::output(m, linear, x), dy = laws::random_table(m.outputs(), 1, 5);
  auto w = m.workspace<double>(1);
  Matrixd dtheta = Matrixd::Zero(m.parameters(), 1), dx(m.inputs(), 1);
  m.backward(linear.data(), x, dy, w, dtheta.data(), dx);
  const double product = dy.cwiseProduct(y).sum();
  CHECK(dx.cwiseProduct(x).sum() == doctest::Approx(product).epsilon(1e-11));
  CHECK(dtheta.cwiseProduct(linear).sum() == doctest::Approx(product).epsilon(1e-11));
}

TEST_CASE("convolutions obey the laws of modules") {
  for (const Shape& s : shapes) {
    laws::check_module<double>(Convolution(s));
    laws::check_gradient(Convolution(s), 2);
  }
  laws::check_module<float>(Convolution(shapes[1]));
  laws::check_module<float>(Convolution(shapes[3]));
}

TEST_CASE("a shifted image gives a shifted output") {
  const Shape s{1, 6, 6, 2, 3, 1, 1};
  const Convolution m(s);
  const Matrixd theta = laws::random_parameters(m, 6);
  Matrixd x = Matrixd::Zero(36, 2);
  for (Index r = 2; r < 4; ++r) {
    for (Index q = 1; q < 4; ++q) {
      x(r * 6 + q, 0) = static_cast<double>(r + q * q);
      x((r + 1) * 6 + q + 1, 1) = x(r * 6 + q, 0);
    }
  }
  const Matrixd y = laws::output(m, theta, x);
  for (Index o = 0; o < 2; ++o) {
    for (Index r = 0; r < 5; ++r) {
      for (Index q = 0; q < 5; ++q) CHECK(y(o * 36 + (r + 1) * 6 + q + 1, 1) == y(o * 36 + r * 6 + q, 0));
    }
  }
}

TEST_CASE("a convolution refuses shapes that do not fit") {
  CHECK_THROWS_WITH_AS(Convolution({1, 3, 2, 1, 4, 1, 0}), "convolution: expected a kernel of at most 2 rows, got 4",
                       traceur::Error);
  CHECK_THROWS_AS(Convolution({0, 3, 3, 1, 1, 1, 0}), traceur::Error);
  CHECK_THROWS_AS(Convolution({1, 0, 3, 1, 1, 1, 0}), traceur::Error);
  CHECK_THROWS_AS(Convolution({1, 3, 0, 1, 1, 1, 0}), traceur::Error);
  CHECK_THROWS_AS(Convolution({1, 3, 3, 0, 1, 1, 0}), traceur::Error);
  CHECK_THROWS_AS(Convolution({1, 3, 3, 1, 0, 1, 0}), traceur::Error);
  CHECK_THROWS_AS(Convolution({1, 3, 3, 1, 1, 0, 0}), traceur::Error);
  CHECK_THROWS_AS(Convolution({1, 3, 3, 1, 1, 1, -1}), traceur::Error);
}
