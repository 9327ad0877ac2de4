// SPDX-License-Identifier: MIT
#include <traceur/core/scalar.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include <doctest/doctest.h>

#include "support.hpp"

namespace near_miss {

/// Arithmetic without order: one comparison short of a scalar.
struct Unordered {
  double x;
  explicit Unordered(double value) : x(value) {}
  friend Unordered operator+(Unordered a, Unordered b) { return Unordered(a.x + b.x); }
  friend Unordered operator-(Unordered a, Unordered b) { return Unordered(a.x - b.x); }
  friend Unordered operator*(Unordered a, Unordered b) { return Unordered(a.x * b.x); }
  friend Unordered operator/(Unordered a, Unordered b) { return Unordered(a.x / b.x); }
  friend Unordered operator-(Unordered a) { return Unordered(-a.x); }
  Unordered& operator+=(Unordered b) { return *this = *this + b; }
  Unordered& operator-=(Unordered b) { return *this = *this - b; }
  Unordered& operator*=(Unordered b) { return *this = *this * b; }
  Unordered& operator/=(Unordered b) { return *this = *this / b; }
};

}  // namespace near_miss

namespace {

using namespace traceur::core;
using near_miss::Unordered;

static_assert(Scalar<float>);
static_assert(Scalar<double>);
static_assert(Scalar<Pack<float>>);
static_assert(Scalar<Pack<double, 2>>);
#if defined(TRACEUR_HAS_CERES)
static_assert(Scalar<ceres::Jet<double, 3>>);
#endif
static_assert(!Scalar<Unordered>);
static_assert(!Scalar<std::string>);
static_assert(!Scalar<double*>);

static_assert(std::is_same_v<Element<double>, double>);
static_assert(std::is_same_v<Element<Pack<float, 4>>, float>);

}  // namespace

TEST_CASE_TEMPLATE("scalar: select, min, max and clamp lane by lane", S, TRACEUR_TEST_SCALARS) {
  RandomStream random(1);
  for (int trial = 0; trial < 100; ++trial) {
    const S a = law::any_of<S>(random, -2, 2), b = law::any_of<S>(random, -2, 2), x = law::any_of<S>(random, 3, 4);
    const S chosen = traceur::core::select(a < b, x, -x);
    const S low = traceur::core::min(a, b), high = traceur::core::max(a, b);
    const S inside = traceur::core::clamp(S(2.0) * a, S(-1.0), S(1.0));
    for (int l = 0; l < lane_count<S>; ++l) {
      const double na = law::number(a, l), nb = law::number(b, l);
      CHECK(law::number(chosen, l) == (na < nb ? law::number(x, l) : -law::number(x, l)));
      CHECK(law::number(low, l) == std::min(na, nb));
      CHECK(law::number(high, l) == std::max(na, nb));
      CHECK(law::number(inside, l) == std::clamp(2 * na, -1.0, 1.0));
    }
    CHECK(all(low <= high));
    CHECK(!any(high < low));
  }
}

TEST_CASE_TEMPLATE("scalar: a clamped NaN is a safe index", S, TRACEUR_TEST_SCALARS) {
  const S nan(std::numeric_limits<double>::quiet_NaN());
  CHECK(!any(nan < S(0.0)));
  CHECK(!any(nan <= nan));
  const S index = traceur::core::clamp(nan, S(0.0), S(7.0));
  for (int l = 0; l < lane_count<S>; ++l) CHECK(law::number(index, l) == 7);
  const S x(3.0);
  CHECK(law::number(traceur::core::min(nan, x), 0) == 3);
  CHECK(law::number(traceur::core::max(nan, x), 0) == 3);
}

TEST_CASE("scalar: masks of one element") {
  CHECK(any(true));
  CHECK(!any(false));
  CHECK(all(true));
  CHECK(!all(false));
  CHECK(traceur::core::select(true, 1, 2) == 1);
  CHECK(traceur::core::select(false, 1, 2) == 2);
}

TEST_CASE("scalar: the plain part of a number") {
  CHECK(plain(1.5) == 1.5);
#if defined(TRACEUR_HAS_CERES)
  CHECK(plain(ceres::Jet<double, 2>(1.5, 1)) == 1.5);
  CHECK(plain(ceres::Jet<ceres::Jet<double, 2>, 2>(ceres::Jet<double, 2>(1.5))) == 1.5);
#endif
}
