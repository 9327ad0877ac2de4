// SPDX-License-Identifier: MIT
#include <traceur/parameterize/metropolis.hpp>

#include <array>
#include <cmath>
#include <limits>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace traceur::parameterize;
using support::fails_with;

namespace {

using Vector = Eigen::VectorXd;
constexpr double minus_infinity = -std::numeric_limits<double>::infinity();

}  // namespace

TEST_CASE("metropolis: a histogram of the draws is the density of Eq. 17") {
  // A value that rises from 0.5 to 1.5 over the unit interval, mean 1: p is exponential with rate k.
  const double k = 3.0;
  const auto log_density = [&](const Vector& a) {
    if (a(0) < 0.0 || a(0) > 1.0) return minus_infinity;
    return refinement_log_density(0.5 + a(0), 1.0, k);
  };
  MetropolisParameters parameters;
  parameters.draws = 20000;
  parameters.burn_in = 50;
  parameters.step = Vector::Constant(1, 0.5);
  parameters.seed = 1;
  const Eigen::MatrixXd starts = Eigen::RowVectorXd::LinSpaced(10, 0.05, 0.95);
  const Eigen::MatrixXd drawn = metropolis(log_density, starts, parameters);
  REQUIRE(drawn.rows() == 1);
  REQUIRE(drawn.cols() == 200000);
  std::array<double, 10> share{};
  for (Eigen::Index i = 0; i < drawn.cols(); ++i) {
    REQUIRE((drawn(0, i) >= 0.0 && drawn(0, i) <= 1.0));
    share[static_cast<std::size_t>(std::min(9.0, 10.0 * drawn(0, i)))] += 1.0 / static_cast<double>(drawn.cols());
  }
  const auto below = [&](double x) { return (1.0 - std::exp(-k * x)) / (1.0 - std::exp(-k)); };
  for (int bin = 0; bin < 10; ++bin) {
    CHECK(std::abs(share[static_cast<std::size_t>(bin)] - (below(0.1 * (bin + 1)) - below(0.1 * bin))) < 0.006);
  }
}

TEST_CASE("metropolis: the moments of a Gaussian in the plane") {
  const auto log_density = [](const Vector& a) {
    const double x = a(0) - 1.0, y = a(1) - 0.5 * x;
    return -0.5 * (x * x + y * y / 0.25);
  };
  MetropolisParameters parameters;
  parameters.draws = 20000;
  parameters.burn_in = 200;
  parameters.step = Vector::Constant(2, 1.2);
  const Eigen::MatrixXd drawn = metropolis(log_density, Eigen::MatrixXd::Zero(2, 5), parameters);
  const Vector mean = drawn.rowwise().mean();
  CHECK(std::abs(mean(0) - 1.0) < 0.05);
  CHECK(std::abs(mean(1)) < 0.04);
  const Eigen::MatrixXd centred = drawn.colwise() - mean;
  CHECK(centred.row(0).squaredNorm() / static_cast<double>(drawn.cols()) == doctest::Approx(1.0).epsilon(0.08));
  CHECK(centred.row(0).dot(centred.row(1)) / static_cast<double>(drawn.cols()) == doctest::Approx(0.5).epsilon(0.1));
}

TEST_CASE("metropolis: chains depend on seed, run and their number alone") {
  const auto log_density = [](const Vector& a) { return -a.squaredNorm(); };
  MetropolisParameters parameters;
  parameters.draws = 10;
  parameters.step = Vector::Ones(1);
  const Eigen::MatrixXd one = metropolis(log_density, Eigen::MatrixXd::Zero(1, 1), parameters);
  const Eigen::MatrixXd three = metropolis(log_density, Eigen::MatrixXd::Zero(1, 3), parameters);
  CHECK(three.leftCols(10) == one);
  CHECK(three.middleCols(10, 10) != one);
  parameters.run = 1;
  CHECK(metropolis(log_density, Eigen::MatrixXd::Zero(1, 1), parameters) != one);
}

TEST_CASE("metropolis: what does not fit is refused") {
  const auto nowhere = [](const Vector&) { return minus_infinity; };
  MetropolisParameters parameters;
  parameters.step = Vector::Ones(2);
  CHECK(fails_with([&] { metropolis(nowhere, Eigen::MatrixXd::Zero(2, 3), parameters); }, "start 0"));
  CHECK(fails_with([&] { metropolis(nowhere, Eigen::MatrixXd::Zero(3, 3), parameters); }, "step"));
  parameters.draws = 0;
  CHECK(fails_with([&] { metropolis(nowhere, Eigen::MatrixXd::Zero(2, 3), parameters); }, "draws"));
}
