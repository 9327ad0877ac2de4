// SPDX-License-Identifier: MIT
#include <traceur/core/rotation.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

#include <doctest/doctest.h>

#include "support.hpp"

namespace {

using namespace traceur::core;
constexpr double pi = std::numbers::pi;

template <class S>
Vector3<S> vector(RandomStream& random, double size) {
  return {law::any_of<S>(random, -size, size), law::any_of<S>(random, -size, size),
          law::any_of<S>(random, -size, size)};
}
template <class S>
Quaternion<S> rotation(RandomStream& random) {
  return Quaternion<S>{law::any_of<S>(random, -1, 1), law::any_of<S>(random, -1, 1), law::any_of<S>(random, -1, 1),
                       law::any_of<S>(random, 0.1, 1)}
      .normalized();
}

template <class S>
double worst(const S& x) {
  double w = 0;
  for (int l = 0; l < lane_count<S>; ++l) {
    const double n = law::number(x, l);
    if (!(std::abs(n) <= w)) w = std::abs(n);
  }
  return w;
}
template <class S>
double worst(const Vector3<S>& v) {
  return std::max({worst(v.x), worst(v.y), worst(v.z)});
}
/// Zero for equal rotations, whichever sign.
template <class S>
double apart(const Quaternion<S>& a, const Quaternion<S>& b) {
  return worst((a.conjugate() * b).vec());
}

/// A pack's logarithm is a fit of 2e-10, an element's the library's.
template <class S>
double tolerance() {
  return 60 * law::unit<S>() + (lane_count<S> > 1 ? 2e-9 : 0);
}

}  // namespace

TEST_CASE_TEMPLATE("quaternion: a group that acts on vectors", S, TRACEUR_TEST_SCALARS) {
  RandomStream random(7);
  const double e = 30 * law::unit<S>();
  for (int trial = 0; trial < 50; ++trial) {
    const auto a = rotation<S>(random), b = rotation<S>(random), c = rotation<S>(random);
    const auto v = vector<S>(random, 2), w = vector<S>(random, 2);
    CHECK(apart((a * b) * c, a * (b * c)) < e);
    CHECK(apart(a * a.conjugate(), Quaternion<S>::identity()) < e);
    CHECK(worst((a * b).rotate(v) - a.rotate(b.rotate(v))) < 2 * e);
    CHECK(worst(a.matrix() * v - a.rotate(v)) < 2 * e);
    CHECK(worst((-a).rotate(v) - a.rotate(v)) < e);
    CHECK(worst(cross(a.rotate(v), a.rotate(w)) - a.rotate(cross(v, w))) < 10 * e);
    CHECK(worst(S(norm(a.rotate(v)) - norm(v))) < 2 * e);
    CHECK(worst(S(dot(a, a) - S(1.0))) < e);
  }
}

TEST_CASE_TEMPLATE("exp and log are inverse, also near zero", S, TRACEUR_TEST_SCALARS) {
  RandomStream random(8);
  for (const double size : {0.0, 1e-12, 1e-6, 5e-5, 1e-4, 2e-4, 1e-2, 0.5, 1.7}) {
    for (int trial = 0; trial < 30; ++trial) {
      const auto v = vector<S>(random, size);  // |v| <= sqrt(3) size < pi
      const auto q = exp_map(v);
      CHECK(worst(S(dot(q, q) - S(1.0))) < 20 * law::unit<S>());
      CHECK(worst(log_map(q) - v) <= tolerance<S>() * std::max(size, 1e-3));
      CHECK(worst(log_map(-q) - v) <= tolerance<S>() * std::max(size, 1e-3));
    }
  }
  for (int trial = 0; trial < 50; ++trial) {
    const auto q = rotation<S>(random);
    CHECK(apart(exp_map(log_map(q)), q) < tolerance<S>());
  }
}

TEST_CASE_TEMPLATE("log near half a turn", S, TRACEUR_TEST_SCALARS) {
  RandomStream random(9);
  for (const double less : {0.0, 1e-6, 1e-3, 0.1}) {
    for (int trial = 0; trial < 30; ++trial) {
      auto axis = vector<S>(random, 1);
      axis.z += S(1.5);
      axis = (S(1.0) / norm(axis)) * axis;
      const auto back = log_map(about_axis(axis, S(pi - less)));
      CHECK(worst(S(norm(back) - S(pi - less))) < 4 * tolerance<S>());
      // Either way round is right at half a turn itself.
      if (less > 1e-5) CHECK(worst(back - S(pi - less) * axis) < 4 * tolerance<S>());
      // Beyond half a turn the shorter way is the other one.
      const auto beyond = log_map(about_axis(axis, S(pi + less)));
      CHECK(worst(S(norm(beyond) - S(pi - less))) < 4 * tolerance<S>());
    }
  }
}

TEST_CASE("the documented error of the small exponential") {
  RandomStream random(10);
  double vector_error = 0, length_error = 0;
  for (int trial = 0; trial < 10000; ++trial) {
    auto v = vector<double>(random, 1);
    v = (0.6 * random.uniform() / norm(v)) * v;
    const auto exact = exp_map(v);
    const auto fast = exp_map_small(v);
    vector_error = std::max(vector_error, norm(fast.vec() - exact.vec()) / norm(exact.vec()));
    length_error = std::max(length_error, std::abs(dot(fast, fast) - 1));
  }
  CHECK(vector_error < 1e-9);
  CHECK(length_error < 1e-9);
  CHECK(norm(exp_map_small(Vector3<double>{0, 0, 0}).vec()) == 0);
}

TEST_CASE("the documented error of the pack's log factor") {
  double worst_error = 0;
  using P = Pack<double, 4>;
  for (int i = 0; i <= 100000; ++i) {
    const double w = i / 100000.0;
    const double s = 1 - w * w;
    const double exact = s < 1e-12 ? 2 / w : 2 * std::atan2(std::sqrt(s), w) / std::sqrt(s);
    worst_error = std::max(worst_error, std::abs(log_factor(P(w), P(s))[1] - exact));
    CHECK(log_factor(w, s) == doctest::Approx(exact).epsilon(1e-12));
  }
  MESSAGE("largest error " << worst_error);
  CHECK(worst_error < 2e-10);
}

TEST_CASE_TEMPLATE("about_axis, twist_angle", S, TRACEUR_TEST_SCALARS) {
  RandomStream random(11);
  for (int trial = 0; trial < 50; ++trial) {
    auto axis = vector<S>(random, 1);
    axis.x += S(1.5);
    axis = (S(1.0) / norm(axis)) * axis;
    const S angle = law::any_of<S>(random, -3, 3);
    const auto q = about_axis(axis, angle);
    CHECK(apart(q, exp_map(angle * axis)) < tolerance<S>());
    CHECK(worst(S(twist_angle(q, axis) - angle)) < 10 * tolerance<S>());
    CHECK(worst(S(twist_angle(-q, axis) - angle)) < 10 * tolerance<S>());
    // A swing about an axis across leaves the twist.
    Vector3<S> across = cross(axis, Vector3<S>{S(0.0), S(0.6), S(0.8)});
    across = (S(1.0) / norm(across)) * across;
    const S half_twist = S(0.5) * angle;
    CHECK(worst(S(twist_angle(about_axis(across, S(1.0)) * about_axis(axis, half_twist), axis) - half_twist)) <
          100 * tolerance<S>());
  }
}

TEST_CASE_TEMPLATE("slerp: ends, middle, constant speed, the shorter way", S, TRACEUR_TEST_SCALARS) {
  RandomStream random(12);
  const double e = 4 * tolerance<S>();
  for (int trial = 0; trial < 50; ++trial) {
    const auto a = rotation<S>(random), b = rotation<S>(random);
    CHECK(apart(slerp(a, b, S(0.0)), a) < e);
    CHECK(apart(slerp(a, b, S(1.0)), b) < e);
    CHECK(apart(slerp(a, -b, S(0.3)), slerp(a, b, S(0.3))) < e);
    const auto whole = log_map(a.conjugate() * b);
    CHECK(worst(S(norm(whole))) <= pi + e);
    CHECK(worst(log_map(a.conjugate() * slerp(a, b, S(0.25))) - S(0.25) * whole) < e);
    CHECK(apart(slerp(b, a, S(0.75)), slerp(a, b, S(0.25))) < e);
  }
}

TEST_CASE_TEMPLATE("heading: turns x to where it points, and nothing else", S, TRACEUR_TEST_SCALARS) {
  RandomStream random(13);
  const double e = 20 * tolerance<S>();
  const Vector3<S> z{S(0.0), S(0.0), S(1.0)};
  for (int trial = 0; trial < 50; ++trial) {
    const S yaw = law::any_of<S>(random, -3, 3), pitch = law::any_of<S>(random, -1.4, 1.4),
            roll = law::any_of<S>(random, -3, 3);
    const Vector3<S> y{S(0.0), S(1.0), S(0.0)}, x{S(1.0), S(0.0), S(0.0)};
    const auto q = about_axis(z, yaw) * about_axis(y, pitch) * about_axis(x, roll);
    CHECK(apart(heading(q), about_axis(z, yaw)) < e);
    CHECK(worst(heading(q).rotate(z) - z) < e);
  }
  const auto upright = about_axis(Vector3<S>{S(0.0), S(1.0), S(0.0)}, S(-pi / 2));
  CHECK(worst(heading(upright).rotate(Vector3<S>{S(1.0), S(0.0), S(0.0)}) - Vector3<S>{S(1.0), S(0.0), S(0.0)}) < 1e-3);
}

TEST_CASE("quaternion: to and from memory and Eigen") {
  const double p[4] = {0.1, 0.2, 0.3, 0.9};
  const auto q = Quaternion<double>::from(p).normalized();
  double back[4];
  q.store(back);
  CHECK(back[3] == q.w);
  CHECK(Quaternion<double>::from(q.eigen()).y == q.y);
  const Eigen::Vector3d v(1, 2, 3);
  CHECK((q.eigen() * v - q.rotate(Vector3<double>::from(v)).eigen()).norm() < 1e-14);
  CHECK((q.matrix().eigen() - q.eigen().toRotationMatrix()).norm() < 1e-14);
  CHECK(q.cast<float>().x == static_cast<float>(q.x));
}

#if defined(TRACEUR_HAS_CERES)
TEST_CASE("exp and log differentiate, at zero too") {
  using Jet = ceres::Jet<double, 3>;
  RandomStream random(14);
  for (const double size : {0.0, 1e-9, 1e-4, 0.8}) {
    const auto v = vector<double>(random, size);
    const Vector3<Jet> j{Jet(v.x, 0), Jet(v.y, 1), Jet(v.z, 2)};
    const auto back = log_map(exp_map(j));
    const Jet* out = &back.x;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) CHECK(std::abs(out[r].v[c] - (r == c ? 1.0 : 0.0)) < 1e-7);
    // Against finite differences of the plain map.
    const auto q = exp_map(j);
    const double h = 1e-6;
    for (int c = 0; c < 3; ++c) {
      Vector3<double> up = v, down = v;
      (&up.x)[c] += h;
      (&down.x)[c] -= h;
      const auto a = exp_map(up), b = exp_map(down);
      CHECK(q.y.v[c] == doctest::Approx((a.y - b.y) / (2 * h)).epsilon(1e-6));
      CHECK(q.w.v[c] == doctest::Approx((a.w - b.w) / (2 * h)).epsilon(1e-6));
    }
  }
}
#endif
