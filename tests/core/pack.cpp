// SPDX-License-Identifier: MIT
#include <traceur/core/pack.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <type_traits>
#include <utility>

#include <Eigen/Core>
#include <doctest/doctest.h>

#include "support.hpp"

#define PACKS Pack<float>, Pack<double>, Pack<float, 4>, Pack<double, 2>, Pack<float, 8>, Pack<float, 1>, Pack<float, 2>

namespace {

using namespace traceur::core;

static_assert(!std::is_convertible_v<Mask<float, 4>, bool>);
static_assert(!std::is_constructible_v<bool, Mask<float, 4>>);
static_assert(!std::is_convertible_v<Pack<float, 4>, float>);
// Or clang refuses matrices of them.
static_assert(alignof(Eigen::Matrix<Pack<float, 4 * native_width<float>>, 4, 1>) <= EIGEN_MAX_STATIC_ALIGN_BYTES);
static_assert(lane_count<double> == 1);
static_assert(lane_count<Pack<double, 4>> == 4);
static_assert(Pack<float>::width == native_width<float>);
static_assert(native_width<float> == 2 * native_width<double>);
static_assert(std::is_same_v<MaskOf<double>, bool>);
static_assert(std::is_same_v<MaskOf<Pack<float, 4>>, Mask<float, 4>>);

template <class P>
P draw(RandomStream& random, double low, double high) {
  P x(0);
  for (int l = 0; l < P::width; ++l) x.set(l, static_cast<Element<P>>(random.uniform(low, high)));
  return x;
}

/// Largest absolute errors of sin and cos on a grid and at random in [-range, range].
template <class P>
std::array<double, 2> sin_cos_error(double range) {
  using T = Element<P>;
  RandomStream random(2);
  double worst_sin = 0, worst_cos = 0;
  for (int trial = 0; trial < 40000; ++trial) {
    const P x = draw<P>(random, -range, range);
    const auto sc = sin_cos(x);
    for (int l = 0; l < P::width; ++l) {
      const long double exact = static_cast<long double>(x[l]);
      worst_sin =
          std::max(worst_sin, std::abs(static_cast<double>(std::sin(exact) - static_cast<long double>(T(sc.sin[l])))));
      worst_cos =
          std::max(worst_cos, std::abs(static_cast<double>(std::cos(exact) - static_cast<long double>(T(sc.cos[l])))));
    }
  }
  return {worst_sin, worst_cos};
}

}  // namespace

TEST_CASE_TEMPLATE("pack: arithmetic, comparison and functions are those of every lane", P, PACKS) {
  using T = Element<P>;
  RandomStream random(3);
  for (int trial = 0; trial < 100; ++trial) {
    P a = draw<P>(random, -3, 3);
    const P b = draw<P>(random, 0.5, 3);
    if (trial % 4 == 0) a = b;
    const P sum = a + b, less = a - b, product = a * b, quotient = a / b, negative = -a, root = sqrt(b), size = abs(a);
    P chain = a;
    chain += b;
    chain *= b;
    chain -= a;
    chain /= b;
    const auto lt = a<b, le = a <= b, gt = a> b, ge = a >= b, eq = a == b, ne = a != b;
    const P e = exp(a), lg = log(b), at = atan2(a, b), fl = floor(a), rounded = round(a);
    bool some = false, every = true;
    for (int l = 0; l < P::width; ++l) {
      const T x = a[l], y = b[l];
      CHECK(sum[l] == x + y);
      CHECK(less[l] == x - y);
      CHECK(product[l] == x * y);
      CHECK(quotient[l] == x / y);
      CHECK(negative[l] == -x);
      CHECK(root[l] == std::sqrt(y));
      CHECK(size[l] == std::abs(x));
      CHECK(chain[l] == doctest::Approx(((x + y) * y - x) / y).epsilon(1e-5));
      CHECK(lt[l] == (x < y));
      CHECK(le[l] == (x <= y));
      CHECK(gt[l] == (x > y));
      CHECK(ge[l] == (x >= y));
      CHECK(eq[l] == (x == y));
      CHECK(ne[l] == (x != y));
      CHECK((lt & ge)[l] == false);
      CHECK((lt | ge)[l] == true);
      CHECK((!lt)[l] == (x >= y));
      CHECK(select(lt, a, b)[l] == std::min(x, y));
      CHECK(e[l] == std::exp(x));
      CHECK(lg[l] == std::log(y));
      CHECK(at[l] == std::atan2(x, y));
      CHECK(fl[l] == std::floor(x));
      CHECK(rounded[l] == std::nearbyint(x));
      some = some || x < y;
      every = every && x < y;
    }
    CHECK(any(lt) == some);
    CHECK(all(lt) == every);
  }
}

TEST_CASE_TEMPLATE("pack: one set lane is any, one unset lane is not all", P, PACKS) {
  using M = MaskOf<P>;
  for (int l = 0; l < P::width; ++l) {
    M one = M::none();
    CHECK(!any(one));
    one.set(l, true);
    CHECK(any(one));
    CHECK(mask_lane(one, l));
    M rest = !one;
    CHECK(all(rest | one));
    CHECK(!all(rest));
  }
}

TEST_CASE_TEMPLATE("pack: lanes, loads and stores", P, PACKS) {
  using T = Element<P>;
  // One off any alignment.
  std::array<T, static_cast<std::size_t>(P::width) + 1> memory{}, back{};
  for (std::size_t i = 0; i < memory.size(); ++i) memory[i] = static_cast<T>(i);
  P p = P::load(memory.data() + 1);
  for (int l = 0; l < P::width; ++l) CHECK(lane_of(p, l) == static_cast<T>(l + 1));
  set_lane(p, P::width - 1, T(-7));
  p.store(back.data() + 1);
  CHECK(back[0] == T(0));
  CHECK(back.back() == T(-7));
  double plain_number = 1;
  set_lane(plain_number, 0, 2.0);
  CHECK(lane_of(plain_number, 0) == 2);
}

TEST_CASE_TEMPLATE("pack: a NaN compares false and stays in its lane", P, PACKS) {
  P x(1);
  x.set(0, std::numeric_limits<Element<P>>::quiet_NaN());
  CHECK(!(x < P(2))[0]);
  CHECK(!(x >= P(2))[0]);
  CHECK((x != x)[0]);
  const P y = sqrt(x * P(4) + P(5)) + sin(x) * cos(x);
  CHECK(std::isnan(y[0]));
  for (int l = 1; l < P::width; ++l) CHECK(std::isfinite(y[l]));
}

TEST_CASE("pack: sine and cosine keep their bounds") {
  for (const double range : {1.0, 10.0, 1000.0}) {
    for (const double error : sin_cos_error<Pack<float>>(range)) CHECK(error < 2e-7);
    for (const double error : sin_cos_error<Pack<float, 4>>(range)) CHECK(error < 2e-7);
    for (const double error : sin_cos_error<Pack<double>>(range)) CHECK(error < 1e-14);
  }
  const Pack<double, 2> zero(0);
  CHECK(sin(zero)[0] == 0);
  CHECK(cos(zero)[0] == 1);
}

TEST_CASE("pack: rounding is to even") {
  for (const auto& [x, expected] :
       {std::pair{0.5f, 0.0f}, {1.5f, 2.0f}, {2.5f, 2.0f}, {-0.5f, 0.0f}, {-1.5f, -2.0f}, {4194303.0f, 4194303.0f}})
    CHECK(round(Pack<float, 4>(x))[3] == expected);
}
