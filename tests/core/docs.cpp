// SPDX-License-Identifier: MIT
// The code of docs/core.md.
#include <cmath>

#include <doctest/doctest.h>

#include <traceur/core/pack.hpp>
#include <traceur/core/rotation.hpp>

using namespace traceur::core;

namespace {

template <Scalar S>
S safe_root(const S& x) {
  using std::sqrt;
  const auto positive = S(0.0) < x;
  if (!any(positive)) return S(0.0);
  return select(positive, sqrt(select(positive, x, S(1.0))), S(0.0));
}

}  // namespace

TEST_CASE("docs/core.md") {
  Pack<float, 4> x(9.0f);
  x.set(2, -1.0f);
  const Pack<float, 4> roots = safe_root(x);  // 3 3 0 3
  CHECK(roots[1] == 3);
  CHECK(roots[2] == 0);
  CHECK(safe_root(-4.0) == 0);

  const Quaternion<double> a = Quaternion<double>::identity();
  const Quaternion<double> b = about_axis(Vector3<double>{0, 0, 1}, 1.2);
  const Vector3<double> way = log_map(a.conjugate() * b);  // 0 0 1.2
  const Quaternion<double> middle = slerp(a, b, 0.5);      // 0.6 about z
  CHECK(way.z == doctest::Approx(1.2));
  CHECK(log_map(middle).z == doctest::Approx(0.6));
}
