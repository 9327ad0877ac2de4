// SPDX-License-Identifier: MIT
#include <traceur/core/matrix3.hpp>

#include <Eigen/Geometry>
#include <doctest/doctest.h>

#include "support.hpp"

namespace {

using namespace traceur::core;

/// One lane as an Eigen matrix of doubles.
template <class S>
Eigen::Matrix3d lane(const Matrix3<S>& m, int l) {
  Eigen::Matrix3d e;
  const S* x = &m.xx;
  for (int i = 0; i < 9; ++i) e(i / 3, i % 3) = law::number(x[i], l);
  return e;
}
template <class S>
Eigen::Matrix3d lane(const Symmetric3<S>& m, int l) {
  return lane(m.full(), l);
}
template <class S>
Eigen::Vector3d lane(const Vector3<S>& v, int l) {
  return {law::number(v.x, l), law::number(v.y, l), law::number(v.z, l)};
}

template <class S>
Vector3<S> vector(RandomStream& random) {
  return {law::any_of<S>(random, -2, 2), law::any_of<S>(random, -2, 2), law::any_of<S>(random, -2, 2)};
}
template <class S>
Matrix3<S> matrix(RandomStream& random) {
  Matrix3<S> m = Matrix3<S>::zero();
  S* x = &m.xx;
  for (int i = 0; i < 9; ++i) x[i] = law::any_of<S>(random, -2, 2);
  return m;
}
/// Positive definite: the identity and a few outer products.
template <class S>
Symmetric3<S> positive(RandomStream& random) {
  Symmetric3<S> m = Symmetric3<S>::scalar(S(0.5));
  for (int i = 0; i < 3; ++i) m += Symmetric3<S>::outer(S(1.0), vector<S>(random));
  return m;
}

}  // namespace

TEST_CASE_TEMPLATE("matrix: the arithmetic is Eigen's", S, TRACEUR_TEST_SCALARS) {
  RandomStream random(6);
  const double tolerance = 300 * law::unit<S>();
  for (int trial = 0; trial < 20; ++trial) {
    const auto a = matrix<S>(random), b = matrix<S>(random);
    const auto p = positive<S>(random), q = positive<S>(random);
    const auto v = vector<S>(random), w = vector<S>(random);
    const S s = law::any_of<S>(random, -2, 2);
    auto sum = a;
    sum += b;
    auto mixed = p;
    mixed += q;
    mixed -= p;
    const auto inverse = p.inverse();
    for (int l = 0; l < lane_count<S>; ++l) {
      const Eigen::Matrix3d ea = lane(a, l), eb = lane(b, l), ep = lane(p, l), eq = lane(q, l);
      const Eigen::Vector3d ev = lane(v, l), ew = lane(w, l);
      const double es = law::number(s, l);
      CHECK((lane(sum, l) - ea - eb).norm() < tolerance);
      CHECK((lane(a - b, l) - ea + eb).norm() < tolerance);
      CHECK((lane(a * v, l) - ea * ev).norm() < tolerance);
      CHECK((lane(transpose_times(a, v), l) - ea.transpose() * ev).norm() < tolerance);
      CHECK((lane(a * b, l) - ea * eb).norm() < tolerance);
      CHECK((lane(s * a, l) - es * ea).norm() < tolerance);
      CHECK((lane(a.transpose(), l) - ea.transpose()).norm() == 0);
      CHECK((lane(Matrix3<S>::skew(v) * w, l) - ev.cross(ew)).norm() < tolerance);
      CHECK((lane(a.row_y(), l) - ea.row(1).transpose()).norm() == 0);
      CHECK((lane(a.column_z(), l) - ea.col(2)).norm() == 0);
      CHECK((lane(mixed, l) - eq).norm() < 10 * tolerance);
      CHECK((lane(p - q, l) - ep + eq).norm() < 10 * tolerance);
      CHECK((lane(p * v, l) - ep * ev).norm() < 10 * tolerance);
      CHECK((lane(p * a, l) - ep * ea).norm() < 10 * tolerance);
      CHECK((lane(s * p, l) - es * ep).norm() < 10 * tolerance);
      CHECK((lane(Symmetric3<S>::outer(s, v), l) - es * ev * ev.transpose()).norm() < 10 * tolerance);
      CHECK((lane(rotated(p, a), l) - ea * ep * ea.transpose()).norm() < 100 * tolerance);
      CHECK((lane(upper(p.full()), l) - ep).norm() == 0);
      const double condition = ep.norm() * lane(inverse, l).norm();
      CHECK((lane(inverse, l) * ep - Eigen::Matrix3d::Identity()).norm() < condition * tolerance);
      CHECK((lane(Matrix3<S>::identity() * v, l) - ev).norm() == 0);
    }
  }
}

TEST_CASE("matrix: to Eigen and other scalars") {
  const Matrix3<double> m{1, 2, 3, 4, 5, 6, 7, 8, 9};
  CHECK(m.eigen()(1, 2) == 6);
  const Symmetric3<double> s{1, 2, 3, 4, 5, 6};
  CHECK(s.full().xy == 4);
  CHECK(s.full().zx == 5);
  CHECK(s.full().zy == 6);
  CHECK(s.cast<float>().yz == 6.0f);
  CHECK((s.cast<Pack<float, 4>>().zz[3]) == 3.0f);
}
