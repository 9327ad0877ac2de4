// SPDX-License-Identifier: MIT
#include <traceur/body/pose.hpp>

#include <cmath>
#include <string>
#include <type_traits>
#include <vector>

#include <doctest/doctest.h>

#include "../core/support.hpp"
#include "support.hpp"

using namespace body_test;

namespace {

Eigen::VectorXd displaced(const Skeleton& s, const Eigen::VectorXd& q, const Eigen::VectorXd& d) {
  Eigen::VectorXd out = q;
  displace(s, q.data(), d.data(), out.data());
  return out;
}
Eigen::VectorXd differed(const Skeleton& s, const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
  Eigen::VectorXd out(s.nv());
  difference(s, a.data(), b.data(), out.data());
  return out;
}
Eigen::VectorXd blended(const Skeleton& s, const Eigen::VectorXd& a, const Eigen::VectorXd& b, double u) {
  Eigen::VectorXd out = a;
  interpolate(s, a.data(), b.data(), u, out.data());
  return out;
}

}  // namespace

TEST_CASE("pose: displace and difference are inverse") {
  const Skeleton s = creature().skeleton;
  RandomStream random(2);
  for (int trial = 0; trial < 100; ++trial) {
    const Eigen::VectorXd a = random_pose(s, random), b = random_pose(s, random);
    CHECK(apart(s, displaced(s, a, differed(s, a, b)), b) < 1e-12);
    const Eigen::VectorXd d = random_tangent(s, random, 1.5);
    CHECK((differed(s, a, displaced(s, a, d)) - d).norm() < 1e-12);
    CHECK(differed(s, a, a).norm() < 1e-7);
    CHECK(apart(s, displaced(s, a, Eigen::VectorXd::Zero(s.nv())), a) < 1e-15);
    Eigen::VectorXd in_place = a;
    displace(s, in_place.data(), d.data(), in_place.data());
    CHECK(in_place == displaced(s, a, d));
  }
}

TEST_CASE("pose: a displacement turns the root in world axes and a ball in its own") {
  const Skeleton s = creature().skeleton;
  RandomStream random(3);
  const Eigen::VectorXd q = random_pose(s, random);
  Eigen::VectorXd d = Eigen::VectorXd::Zero(s.nv());
  const Vector turn{0.1, -0.2, 0.3};
  turn.store(d.data() + 3);
  const int spine = s.find("spine");
  turn.store(d.data() + s[spine].v_index);
  const Eigen::VectorXd moved = displaced(s, q, d);
  const auto at = [&](const Eigen::VectorXd& pose, int index) { return Quaternion<double>::from(pose.data() + index); };
  const auto e = exp_map(turn);
  CHECK(norm((at(moved, 3).conjugate() * (e * at(q, 3))).vec()) < 1e-15);
  CHECK(norm((at(moved, s[spine].q_index).conjugate() * (at(q, s[spine].q_index) * e)).vec()) < 1e-15);
}

TEST_CASE("pose: interpolation has its ends and moves evenly") {
  const Skeleton s = creature().skeleton;
  RandomStream random(4);
  for (int trial = 0; trial < 50; ++trial) {
    const Eigen::VectorXd a = random_pose(s, random), b = random_pose(s, random);
    CHECK(apart(s, blended(s, a, b, 0), a) < 1e-12);
    CHECK(apart(s, blended(s, a, b, 1), b) < 1e-12);
    CHECK((differed(s, a, blended(s, a, b, 0.3)) - 0.3 * differed(s, a, b)).norm() < 1e-11);
    CHECK(apart(s, blended(s, a, b, 0.3), blended(s, b, a, 0.7)) < 1e-11);
  }
}

TEST_CASE("pose: normalize scales quaternions only") {
  const Skeleton s = creature().skeleton;
  RandomStream random(5);
  const Eigen::VectorXd q = random_pose(s, random);
  Eigen::VectorXd scaled = q;
  for (const Joint& j : s.joints()) {
    if (j.type == JointType::free) scaled.segment(j.q_index + 3, 4) *= 3;
    if (j.type == JointType::ball) scaled.segment(j.q_index, 4) *= 0.2;
  }
  normalize(s, scaled.data());
  CHECK((scaled - q).norm() < 1e-14);
}

TEST_CASE_TEMPLATE("pose: every scalar gives what double gives", S, TRACEUR_TEST_SCALARS) {
  const Skeleton s = creature().skeleton;
  RandomStream random(6);
  const Eigen::VectorXd a = random_pose(s, random), d = random_tangent(s, random, 1);
  const Eigen::VectorXd b = displaced(s, a, d), middle = blended(s, a, b, 0.4);
  using T = traceur::core::Element<S>;
  const auto lift = [](const Eigen::VectorXd& x) {
    std::vector<S> out;
    for (const double v : x) out.push_back(S(static_cast<T>(v)));
    return out;
  };
  const auto lower = [](const std::vector<S>& x) {
    Eigen::VectorXd out(static_cast<Eigen::Index>(x.size()));
    for (Eigen::Index i = 0; i < out.size(); ++i)
      out[i] = law::number(x[static_cast<std::size_t>(i)], traceur::core::lane_count<S> - 1);
    return out;
  };
  const auto sa = lift(a), sd = lift(d), sb = lift(b);
  std::vector<S> moved(sa), found(sd), half(sa);
  displace(s, sa.data(), sd.data(), moved.data());
  difference(s, sa.data(), sb.data(), found.data());
  interpolate(s, sa.data(), sb.data(), S(0.4), half.data());
  const double tolerance = std::is_same_v<T, float> ? 1e-5 : 1e-8;
  CHECK(apart(s, lower(moved), b) < tolerance);
  CHECK((lower(found) - d).norm() < tolerance);
  CHECK(apart(s, lower(half), middle) < tolerance);
  normalize(s, half.data());
  CHECK(apart(s, lower(half), middle) < tolerance);
}

#if defined(TRACEUR_HAS_CERES)
TEST_CASE("pose: a plain pose displaced by dual numbers carries their derivatives") {
  using Jet = ceres::Jet<double, 1>;
  const Skeleton s = creature().skeleton;
  RandomStream random(7);
  const Eigen::VectorXd q = random_pose(s, random), d = random_tangent(s, random, 0.5),
                        along = random_tangent(s, random, 1);
  std::vector<Jet> dual, out(static_cast<std::size_t>(s.nq()));
  for (Eigen::Index i = 0; i < d.size(); ++i) {
    dual.emplace_back(d[i]);
    dual.back().v[0] = along[i];
  }
  displace(s, q.data(), dual.data(), out.data());
  const double h = 1e-6;
  const Eigen::VectorXd slope = (displaced(s, q, d + h * along) - displaced(s, q, d - h * along)) / (2 * h);
  for (Eigen::Index i = 0; i < slope.size(); ++i)
    CHECK(std::abs(out[static_cast<std::size_t>(i)].v[0] - slope[i]) < 1e-8);
}
#endif

TEST_CASE("pose: what is no pose is refused by joint") {
  const Skeleton s = creature().skeleton;
  const Eigen::VectorXd q = s.neutral_pose();
  CHECK_NOTHROW(check_pose(s, q, "clip"));
  const auto message = [&](const Eigen::VectorXd& bad) {
    try {
      check_pose(s, bad, "clip");
    } catch (const traceur::Error& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  CHECK(message(q.head(5)).rfind("clip: expected a pose of", 0) == 0);
  Eigen::VectorXd bad = q;
  bad[s[4].q_index] = std::nan("");
  CHECK(message(bad).find("'elbow'") != std::string::npos);
  bad = q;
  bad[s[1].q_index + 3] = 1.01;
  CHECK(message(bad).find("'spine'") != std::string::npos);
  bad = q;
  bad[6] = 0.99;
  CHECK(message(bad).find("'root'") != std::string::npos);
}
