// SPDX-License-Identifier: MIT
#include <traceur/parameterize/rbf.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/pack.hpp>

#include "support.hpp"

using namespace traceur::parameterize;
using support::fails_with;
using traceur::core::Pack;
using traceur::core::RandomStream;

namespace {

using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

struct Case {
  Kernel kernel;
  int degree;
};
constexpr Case cases[] = {
    {Kernel::linear, -1}, {Kernel::linear, 0}, {Kernel::linear, 1}, {Kernel::cubic, 1}, {Kernel::thin_plate, 1}};

RbfParameters parameters_of(const Case& c) {
  RbfParameters p;
  p.kernel = c.kernel;
  p.degree = c.degree;
  return p;
}

double basis(Kernel kernel, double r) {
  if (kernel == Kernel::linear) return r;
  if (kernel == Kernel::cubic) return r * r * r;
  return r > 0.0 ? r * r * std::log(r) : 0.0;
}

/// Gaussian elimination with full pivoting: slow, and plain enough to be a reference.
Matrix solved(Matrix system, Matrix right) {
  const Eigen::Index size = system.rows();
  std::vector<Eigen::Index> unknown;
  for (Eigen::Index i = 0; i < size; ++i) unknown.push_back(i);
  for (Eigen::Index k = 0; k < size; ++k) {
    Eigen::Index row = k, column = k;
    for (Eigen::Index j = k; j < size; ++j) {
      for (Eigen::Index i = k; i < size; ++i) {
        if (std::abs(system(i, j)) > std::abs(system(row, column))) std::tie(row, column) = std::pair(i, j);
      }
    }
    REQUIRE(system(row, column) != 0.0);
    for (Eigen::Index j = 0; j < size; ++j) std::swap(system(k, j), system(row, j));
    for (Eigen::Index j = 0; j < right.cols(); ++j) std::swap(right(k, j), right(row, j));
    for (Eigen::Index i = 0; i < size; ++i) std::swap(system(i, k), system(i, column));
    std::swap(unknown[static_cast<std::size_t>(k)], unknown[static_cast<std::size_t>(column)]);
    for (Eigen::Index i = 0; i < size; ++i) {
      if (i == k) continue;
      const double factor = system(i, k) / system(k, k);
      for (Eigen::Index j = k; j < size; ++j) system(i, j) -= factor * system(k, j);
      for (Eigen::Index j = 0; j < right.cols(); ++j) right(i, j) -= factor * right(k, j);
    }
  }
  Matrix x(size, right.cols());
  for (Eigen::Index k = 0; k < size; ++k) {
    for (Eigen::Index j = 0; j < right.cols(); ++j)
      x(unknown[static_cast<std::size_t>(k)], j) = right(k, j) / system(k, k);
  }
  return x;
}

/// Eq. 7 at `theta`, from the whole saddle-point system in full pivoting: slow and independent.
Vector by_full_system(const Matrix& centres, const Matrix& values, const Case& c, const Vector& unit,
                      const Vector& theta) {
  const Eigen::Index n = centres.rows(), total = centres.cols(), m = c.degree < 0 ? 0 : c.degree == 0 ? 1 : n + 1;
  const auto distance = [&](const double* a, const double* b) {
    double squared = 0.0;
    for (Eigen::Index d = 0; d < n; ++d) squared += std::pow((a[d] - b[d]) / unit(d), 2);
    return std::sqrt(squared);
  };
  const auto centre = [&](Eigen::Index i) { return centres.data() + n * i; };
  Matrix system = Matrix::Zero(total + m, total + m);
  Matrix right = Matrix::Zero(total + m, values.rows());
  Vector row(total + m);
  for (Eigen::Index i = 0; i < total; ++i) {
    for (Eigen::Index j = 0; j < total; ++j) system(i, j) = basis(c.kernel, distance(centre(i), centre(j)));
    for (Eigen::Index k = 0; k < m; ++k) system(i, total + k) = system(total + k, i) = k == 0 ? 1.0 : centres(k - 1, i);
    for (Eigen::Index o = 0; o < values.rows(); ++o) right(i, o) = values(o, i);
    row(i) = basis(c.kernel, distance(theta.data(), centre(i)));
  }
  for (Eigen::Index k = 0; k < m; ++k) row(total + k) = k == 0 ? 1.0 : theta(k - 1);
  const Matrix solution = solved(system, right);
  Vector value = Vector::Zero(values.rows());
  for (Eigen::Index o = 0; o < value.size(); ++o) {
    for (Eigen::Index i = 0; i < row.size(); ++i) value(o) += solution(i, o) * row(i);
  }
  return value;
}

}  // namespace

TEST_CASE("rbf: interpolates, and agrees with the full saddle-point system") {
  for (const Case& c : cases) {
    for (const Eigen::Index n : {1, 2, 3}) {
      RandomStream random(1, static_cast<std::uint64_t>(n), static_cast<std::uint64_t>(c.degree + 1));
      Matrix centres = support::uniform(random, n, 40);
      const Matrix values = support::uniform(random, 3, 40, -1.0, 1.0);
      // Kept apart: how well close centres can be told apart is not the question here.
      for (int i = 0; i < 40; ++i) centres(0, i) = (i + 0.5 * centres(0, i)) / 40.0;
      RbfParameters p = parameters_of(c);
      p.unit = Vector::LinSpaced(n, 0.7, 1.3);
      const Rbf rbf(centres, values, p);
      CHECK(rbf.residual() < 1e-9);
      for (Eigen::Index i = 0; i < 40; ++i) CHECK((rbf(centres.col(i)) - values.col(i)).norm() < 1e-8);
      for (int k = 0; k < 5; ++k) {
        const Vector theta = support::uniform(random, n, 1, -0.5, 1.5).col(0);
        const Vector expected = by_full_system(centres, values, c, p.unit, theta);
        CHECK((rbf(theta) - expected).norm() <
              1e-9 * (1.0 + (c.kernel == Kernel::linear ? 1.0 : 1e3) * expected.norm()));
      }
    }
  }
}

TEST_CASE("rbf: the weights satisfy their side conditions") {
  for (const Case& c : cases) {
    RandomStream random(2);
    const Matrix centres = support::uniform(random, 2, 60), values = support::uniform(random, 4, 60);
    const Rbf rbf(centres, values, parameters_of(c));
    const double scale = rbf.weights().cwiseAbs().maxCoeff();
    for (Eigen::Index o = 0; o < 4; ++o) {
      double sums[3] = {};
      for (Eigen::Index i = 0; i < 60; ++i) {
        sums[0] += rbf.weights()(o, i);
        for (int d = 0; d < 2; ++d) sums[d + 1] += rbf.weights()(o, i) * centres(d, i);
      }
      for (int k = 0; k < 3 && k <= c.degree + (c.degree > 0); ++k) CHECK(std::abs(sums[k]) < 1e-11 * scale);
    }
  }
}

TEST_CASE("rbf: a linear function is reproduced everywhere, and its coefficients are the polynomial's") {
  for (const Case& c : cases) {
    if (c.degree < 1) continue;
    RandomStream random(3);
    Matrix centres = support::uniform(random, 3, 25);
    Matrix values(2, 25);
    const Matrix slope = support::uniform(random, 2, 3, -1.0, 1.0);
    const Vector constant = support::uniform(random, 2, 1).col(0);
    const auto linear = [&](const double* theta, Eigen::Index o) {
      return constant(o) + slope(o, 0) * theta[0] + slope(o, 1) * theta[1] + slope(o, 2) * theta[2];
    };
    for (Eigen::Index i = 0; i < 25; ++i) {
      centres(1, i) = 6.0 * centres(1, i) - 3.0;
      centres(2, i) = 0.1 * centres(2, i) + 1000.0;
      for (Eigen::Index o = 0; o < 2; ++o) values(o, i) = linear(centres.data() + 3 * i, o);
    }
    RbfParameters p = parameters_of(c);
    p.unit = Vector(3);
    p.unit << 1.0, 6.0, 0.1;
    const Rbf rbf(centres, values, p);
    for (int k = 0; k < 20; ++k) {
      Vector theta = support::uniform(random, 3, 1, -5.0, 5.0).col(0);
      theta(2) += 1000.0;
      for (Eigen::Index o = 0; o < 2; ++o) CHECK(std::abs(rbf(theta)(o) - linear(theta.data(), o)) < 1e-6);
    }
    const Matrix p_of_theta = rbf.polynomial();
    for (Eigen::Index o = 0; o < 2; ++o) {
      CHECK(std::abs(p_of_theta(o, 0) - constant(o)) < 1e-3);
      for (Eigen::Index d = 0; d < 3; ++d) CHECK(std::abs(p_of_theta(o, d + 1) - slope(o, d)) < 1e-6);
    }
  }
}

TEST_CASE("rbf: in one dimension, r interpolates by straight lines and r^3 by the natural cubic spline") {
  Matrix centres(1, 4), values(1, 4);
  centres << 0.0, 1.0, 3.0, 4.0;
  values << 0.0, 2.0, 0.0, 1.0;
  const Rbf lines(centres, values);
  const auto at = [](const Rbf& rbf, double x) { return rbf(Vector::Constant(1, x))(0); };
  CHECK(at(lines, 0.5) == doctest::Approx(1.0));
  CHECK(at(lines, 2.5) == doctest::Approx(0.5));
  CHECK(at(lines, 3.75) == doctest::Approx(0.75));

  RbfParameters p;
  p.kernel = Kernel::cubic;
  const Rbf spline(centres, values, p);
  // Natural: straight beyond the ends.
  CHECK(at(spline, 6.0) - 2.0 * at(spline, 5.0) + at(spline, 4.0) == doctest::Approx(0.0).epsilon(1e-9));
  CHECK(at(spline, -2.0) - 2.0 * at(spline, -1.0) + at(spline, 0.0) == doctest::Approx(0.0).epsilon(1e-9));
}

TEST_CASE("rbf: many at once, one at a time, and in every scalar are the same function") {
  for (const Case& c : cases) {
    RandomStream random(4);
    const Matrix centres = support::uniform(random, 2, 300), values = support::uniform(random, 5, 300);
    RbfParameters p = parameters_of(c);
    p.unit = Vector::Constant(2, 0.5);
    const Rbf rbf(centres, values, p);
    Matrix thetas = support::uniform(random, 2, 331);
    thetas.col(7) = centres.col(280);
    Matrix out(5, 331);
    rbf.evaluate(thetas, out);
    double weight = 1.0;
    for (Eigen::Index i = 0; i < 5 * 300; ++i) weight = std::max(weight, std::abs(rbf.weights().data()[i]));
    using P = Pack<double, 4>;
    for (Eigen::Index q = 0; q < 331; ++q) {
      const Vector one = rbf(thetas.col(q));
      for (Eigen::Index o = 0; o < 5; ++o) CHECK(std::abs(out(o, q) - one(o)) < 1e-13 * weight);
      if (q % 50 != 7) continue;
      const float x[] = {static_cast<float>(thetas(0, q)), static_cast<float>(thetas(1, q))};
      float y[5];
      rbf.evaluate<float>(x, y);
      P lanes[] = {P(thetas(0, q)), P(thetas(1, q))}, values_of_lanes[5];
      lanes[0].set(2, 0.25);
      rbf.evaluate<P>(lanes, values_of_lanes);
      Vector other(2);
      other << 0.25, thetas(1, q);
      for (Eigen::Index o = 0; o < 5; ++o) {
        CHECK(std::abs(static_cast<double>(y[o]) - out(o, q)) < 1e-4 * weight);
        CHECK(std::abs(values_of_lanes[o][1] - out(o, q)) < 1e-13 * weight);
        CHECK(std::abs(values_of_lanes[o][2] - rbf(other)(o)) < 1e-13 * weight);
      }
    }
  }
}

TEST_CASE("rbf: reduced, it interpolates centres that lie on a point or a line") {
  RbfParameters p;
  p.reduce = true;
  Vector value(2);
  value << 3.0, -1.0;
  const Rbf point(Matrix::Ones(2, 1), value, p);
  CHECK(point(Vector::Zero(2)) == value);

  // A slope along the line is extrapolated, and nothing is made up across it.
  Matrix centres(2, 5), values(1, 5);
  for (int i = 0; i < 5; ++i) {
    centres.col(i) << i, 2.0 * i;
    values(0, i) = 7.0 + 3.0 * i;
  }
  const Rbf line(centres, values, p);
  Vector theta(2);
  theta << 10.0, 20.0;
  CHECK(line(theta)(0) == doctest::Approx(37.0));
  theta << 10.0 - 2.0, 20.0 + 1.0;
  CHECK(line(theta)(0) == doctest::Approx(37.0));
}

TEST_CASE("rbf: centres that cannot be interpolated are refused with their reason") {
  RandomStream random(5);
  Matrix centres = support::uniform(random, 2, 10);
  const Matrix values = support::uniform(random, 3, 10);
  const auto fit = [&](const Matrix& c, const Matrix& v, RbfParameters p = {}) { return [=] { Rbf(c, v, p); }; };
  CHECK(fails_with(fit(centres, values.leftCols(9)), "10 centres, got 9"));
  CHECK(fails_with(fit(centres.leftCols(2), values.leftCols(2)), "3 or more centres"));
  CHECK(fails_with(fit(Matrix(2, 0), Matrix(3, 0)), "one or more centres"));
  CHECK(fails_with(fit(Matrix::Zero(17, 1), Matrix::Zero(1, 1)), "1 to 16"));
  Matrix line = centres;
  line.row(1) = 2.0 * line.row(0);
  CHECK(fails_with(fit(line, values), "extend in 1"));
  Matrix twice = centres;
  twice.col(8) = twice.col(2);
  CHECK(fails_with(fit(twice, values), "centre 2 and centre 8"));
  RbfParameters p;
  p.degree = -1;
  CHECK(fails_with(fit(centres.leftCols(1), values.leftCols(1), p), "2 or more centres"));
  p.kernel = Kernel::cubic;
  CHECK(fails_with(fit(centres, values, p), "degree"));
  p = {};
  p.unit = Vector::Zero(2);
  CHECK(fails_with(fit(centres, values, p), "unit"));
  p.unit.resize(0);
  p.degree = 2;
  CHECK(fails_with(fit(centres, values, p), "degree"));
  centres(1, 4) = std::numeric_limits<double>::quiet_NaN();
  CHECK(fails_with(fit(centres, values), "centre 4"));
  const Rbf rbf(Matrix::Identity(1, 2), Matrix::Ones(1, 2));
  CHECK(fails_with([&] { rbf(Vector::Zero(2)); }, "1 task parameters"));
}
