// SPDX-License-Identifier: MIT
#include <traceur/core/vector3.hpp>

#include <algorithm>
#include <cmath>

#include <doctest/doctest.h>

#include "support.hpp"

namespace {

using namespace traceur::core;

template <class S>
Vector3<S> draw(RandomStream& random) {
  return {law::any_of<S>(random, -2, 2), law::any_of<S>(random, -2, 2), law::any_of<S>(random, -2, 2)};
}

template <class S>
double worst(const S& x) {
  double w = 0;
  for (int l = 0; l < lane_count<S>; ++l) w = std::max(w, std::abs(law::number(x, l)));
  return w;
}

template <class S>
double worst(const Vector3<S>& v) {
  return std::max({worst(v.x), worst(v.y), worst(v.z)});
}

}  // namespace

TEST_CASE_TEMPLATE("vector: laws of dot and cross", S, TRACEUR_TEST_SCALARS) {
  RandomStream random(4);
  const double tolerance = 200 * law::unit<S>();
  for (int trial = 0; trial < 50; ++trial) {
    const auto a = draw<S>(random), b = draw<S>(random), c = draw<S>(random);
    const S s = law::any_of<S>(random, -2, 2);
    CHECK(worst(cross(a, b) + cross(b, a)) == 0);
    CHECK(worst(dot(a, cross(a, b))) < tolerance);
    CHECK(worst(cross(a, cross(b, c)) - (dot(a, c) * b - dot(a, b) * c)) < tolerance);
    CHECK(worst(S(dot(cross(a, b), c) - dot(a, cross(b, c)))) < tolerance);
    CHECK(worst(S(squared_norm(cross(a, b)) + dot(a, b) * dot(a, b) - squared_norm(a) * squared_norm(b))) <
          10 * tolerance);
    CHECK(worst(S(norm(a) * norm(a) - squared_norm(a))) < tolerance);
    CHECK(worst(s * (a + b) - (s * a + b * s)) < tolerance);
    auto d = a;
    d += b;
    d -= a;
    d *= s;
    CHECK(worst(d - s * b) < tolerance);
    CHECK(worst(-a + a) == 0);
  }
}

TEST_CASE_TEMPLATE("vector: select lane by lane", S, Pack<float>, Pack<double, 2>) {
  RandomStream random(5);
  const auto a = draw<S>(random), b = draw<S>(random);
  const auto mask = a.x < b.x;
  const auto c = select(mask, a, b);
  for (int l = 0; l < lane_count<S>; ++l) {
    CHECK(c.y[l] == (mask[l] ? a.y[l] : b.y[l]));
    CHECK(c.z[l] == (mask[l] ? a.z[l] : b.z[l]));
  }
}

TEST_CASE("vector: to and from memory, Eigen and other scalars") {
  const double p[3] = {1, 2, 3};
  const auto v = Vector3<double>::from(p);
  double q[3] = {};
  v.store(q);
  CHECK(q[2] == 3);
  CHECK(v.eigen() == Eigen::Vector3d(1, 2, 3));
  CHECK(norm(Vector3<double>::from(Eigen::Vector3d(1, 2, 3)) - v) == 0);
  CHECK(v.cast<float>().y == 2.0f);
  CHECK((v.cast<Pack<double, 2>>().z[1]) == 3.0);
  CHECK(norm(Vector3<double>{3, 0, 4}) == 5);
  CHECK(norm(Vector3<double>::zero()) == 0);
}
