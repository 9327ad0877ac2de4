// SPDX-License-Identifier: MIT
#include <traceur/nn/normalizer.hpp>

#include <cmath>
#include <limits>

#include <doctest/doctest.h>

#include <traceur/core/random.hpp>

#include "allocations.hpp"

using namespace traceur::nn;
using Eigen::MatrixXd;
using Eigen::MatrixXf;

namespace {

/// Samples of features with means and deviations of their own, far from 0 and 1.
MatrixXd samples(Eigen::Index features, Eigen::Index count, unsigned seed = 1) {
  traceur::core::RandomStream random(seed);
  MatrixXd x(features, count);
  for (Eigen::Index j = 0; j < count; ++j) {
    for (Eigen::Index i = 0; i < features; ++i) {
      x(i, j) = 1000.0 * static_cast<double>(i) + std::pow(10.0, static_cast<double>(i) - 2.0) * random.normal();
    }
  }
  return x;
}

void check_statistics(const Normalizer& n, const MatrixXd& x) {
  CHECK(n.samples() == static_cast<double>(x.cols()));
  for (Eigen::Index i = 0; i < x.rows(); ++i) {
    const double mean = x.row(i).mean(), variance = (x.row(i).array() - mean).square().mean();
    CHECK(n.mean(i) == doctest::Approx(mean).epsilon(1e-12));
    CHECK(n.variance(i) == doctest::Approx(variance).epsilon(1e-9));
  }
}

}  // namespace

TEST_CASE("however the samples come, the statistics are those of all of them") {
  const MatrixXd x = samples(4, 200);
  Normalizer whole(4), one_by_one(4), batches(4), left(4), right(4);
  whole.observe<double>(x);
  check_statistics(whole, x);
  for (Eigen::Index j = 0; j < 200; ++j) one_by_one.observe<double>(x.col(j));
  check_statistics(one_by_one, x);
  batches.observe<double>(x.leftCols(3));
  batches.observe<double>(x.middleCols(3, 0));
  batches.observe<double>(x.middleCols(3, 150));
  batches.observe<double>(x.rightCols(47));
  check_statistics(batches, x);
  left.observe<double>(x.leftCols(60));
  right.observe<double>(x.rightCols(140));
  left.merge(right);
  left.merge(Normalizer(4));
  check_statistics(left, x);
}

TEST_CASE("normalised samples have mean 0 and deviation 1, and can be undone") {
  const MatrixXd x = samples(3, 500);
  Normalizer n(3, {.clip = std::numeric_limits<double>::infinity()});
  n.observe<double>(x);
  MatrixXd y(3, 500), back(3, 500);
  n.apply<double>(x, y);
  for (Eigen::Index i = 0; i < 3; ++i) {
    CHECK(std::abs(y.row(i).mean()) < 1e-9);
    CHECK(y.row(i).squaredNorm() / 500 == doctest::Approx(1.0));
  }
  n.undo<double>(y, back);
  CHECK((back - x).cwiseAbs().maxCoeff() < 1e-9);
  back = x;
  n.apply<double>(back, back);
  CHECK(back == y);
}

TEST_CASE("clamping, features that do not vary, and before the first sample") {
  Normalizer n(2, {.clip = 2.0, .min_deviation = 0.5});
  MatrixXf x(2, 1), y(2, 1);
  x << 1.5f, -7.0f;
  n.apply<float>(x, y);
  CHECK(y(0, 0) == 1.5f);
  CHECK(y(1, 0) == -2.0f);
  for (int k = 0; k < 10; ++k) n.observe<float>(x);
  CHECK(n.variance(0) == 0.0);
  CHECK(n.deviation(0) == 0.5);
  x << 2.0f, 100.0f;
  n.apply<float>(x, y);
  CHECK(y(0, 0) == 1.0f);
  CHECK(y(1, 0) == 2.0f);
  x(0, 0) = std::nanf("");
  n.apply<float>(x, y);
  CHECK(std::isnan(y(0, 0)));
}

TEST_CASE("samples that are not finite are left out and counted") {
  MatrixXd x = samples(3, 10), bad(3, 13);
  bad << x.leftCols(4), MatrixXd::Ones(3, 2), x.rightCols(6), MatrixXd::Ones(3, 1);
  bad(1, 4) = std::nan("");
  bad(2, 5) = std::numeric_limits<double>::infinity();
  bad(0, 12) = -std::numeric_limits<double>::infinity();
  Normalizer n(3), m(3);
  CHECK(n.observe<double>(bad) == 3);
  check_statistics(n, x);
  CHECK(m.observe<double>(bad.col(4)) == 1);
  CHECK(m.samples() == 0.0);
}

TEST_CASE("a frozen normaliser learns nothing") {
  const MatrixXd x = samples(2, 30);
  Normalizer n(2, {.max_samples = 20});
  n.observe<double>(x.leftCols(10));
  n.freeze();
  n.observe<double>(x);
  CHECK(n.samples() == 10.0);
  n.freeze(false);
  n.observe<double>(x.leftCols(15));
  CHECK(n.frozen());
  n.observe<double>(x);
  CHECK(n.samples() == 25.0);
}

TEST_CASE("state goes on to the same bits, and nonsense is refused") {
  const MatrixXd x = samples(3, 40);
  Normalizer n(3), m(3);
  n.observe<double>(x.leftCols(25));
  m.restore(n.state());
  n.observe<double>(x.rightCols(15));
  m.observe<double>(x.rightCols(15));
  CHECK(n.state() == m.state());
  CHECK(n.deviation(2) == m.deviation(2));
  CHECK_THROWS_WITH_AS(m.restore(Eigen::VectorXd::Zero(6)), "normalizer state: expected 7 numbers, got 6",
                       traceur::Error);
  Eigen::VectorXd bad = n.state();
  bad[4] = -1.0;
  CHECK_THROWS_WITH_AS(m.restore(bad), "normalizer state: number 4: expected a finite number, 0 or more",
                       traceur::Error);
  CHECK_THROWS_AS(Normalizer(0), traceur::Error);
  CHECK_THROWS_AS(Normalizer(1, {.clip = 0.0}), traceur::Error);
  CHECK_THROWS_AS(Normalizer(1, {.min_deviation = -1.0}), traceur::Error);
  CHECK_THROWS_AS(Normalizer(1, {.max_samples = -1}), traceur::Error);
}

TEST_CASE("learning takes nothing from the heap") {
  Normalizer n(3);
  MatrixXd x = samples(3, 40);
  const long before = allocations();
  n.observe<double>(x);
  n.apply<double>(x, x);
  CHECK(allocations() == before);
}
