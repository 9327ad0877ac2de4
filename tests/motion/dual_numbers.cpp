// SPDX-License-Identifier: MIT
#include <ceres/jet.h>
#include <doctest/doctest.h>

#include <traceur/motion/blend.hpp>
#include <traceur/motion/displacement.hpp>
#include <traceur/motion/mirror.hpp>

#include "figure.hpp"

using namespace traceur;
using namespace figure;

TEST_CASE("a dual reference time carries the derivative of the pose") {
  using J = ceres::Jet<double, 1>;
  Gait g;
  g.turn = 0.3;
  const motion::Clip clip = gait(g, g.period, 31, true);
  for (const double phi : {0.31, -2.05, 0.0, 4.4}) {
    Eigen::Matrix<J, Eigen::Dynamic, 1> q(clip.skeleton.nq());
    clip.sample(J(phi, 0), q.data());
    const double h = 1e-6;
    const Vec ahead = clip.sample(phi + 2 * h), behind = clip.sample(phi + 1e-12);
    for (Eigen::Index i = 0; i < q.size(); ++i) {
      CHECK(q[i].a == doctest::Approx(clip.sample(phi)[i]).epsilon(1e-12));
      CHECK(q[i].v[0] == doctest::Approx((ahead[i] - behind[i]) / (2 * h)).epsilon(1e-4).scale(1.0));
    }
  }
}

TEST_CASE("dual tau gives the derivative of the phase") {
  using J = ceres::Jet<double, 4>;
  std::mt19937_64 rng(12);
  Vec tau(4);
  for (int i = 0; i < 4; ++i) tau[i] = uniform(rng, -1, 1);
  Eigen::Matrix<J, Eigen::Dynamic, 1> dual(4);
  for (int i = 0; i < 4; ++i) dual[i] = J(tau[i], i);
  const motion::TimeWarp<J> w(dual, 0.2);
  const double t = 0.47;
  const J phi = w.phase(J(t));
  // t lies in the third interval: full increments before it, a share of its own, none after.
  CHECK(phi.v[0] == doctest::Approx(0.2 * std::exp(tau[0])));
  CHECK(phi.v[1] == doctest::Approx(0.2 * std::exp(tau[1])));
  CHECK(phi.v[2] == doctest::Approx(0.07 * std::exp(tau[2])));
  CHECK(phi.v[3] == 0.0);
}

TEST_CASE("dual displacements carry the derivative of the pose") {
  using J = ceres::Jet<double, 2>;
  std::mt19937_64 rng(25);
  const auto clip = random_clip(rng, 5);
  motion::Displacement<double> d{Vec::LinSpaced(3, 0, clip.duration()), Eigen::MatrixXd(clip.skeleton.nv(), 3)};
  for (Eigen::Index i = 0; i < d.values.size(); ++i) d.values.data()[i] = uniform(rng, -0.5, 0.5);
  // Differentiates by the first displacement's 5th number and by reference time.
  const double phi = 0.3 * clip.duration(), h = 1e-6;
  const int row = 4;
  const auto pose = [&](double change, double at) {
    auto e = d;
    e.values(row, 0) += change;
    Vec q(clip.skeleton.nq()), scratch(clip.skeleton.nv());
    motion::sample_displaced(clip, e, at, q.data(), scratch.data());
    return q;
  };
  motion::Displacement<J> dual{d.times, d.values.cast<J>()};
  dual.values(row, 0).v[0] = 1;
  Eigen::Matrix<J, Eigen::Dynamic, 1> q(clip.skeleton.nq()), scratch(clip.skeleton.nv());
  motion::sample_displaced(clip, dual, J(phi, 1), q.data(), scratch.data());
  const Vec by_value = (pose(h, phi) - pose(-h, phi)) / (2 * h), by_phase = (pose(0, phi + h) - pose(0, phi - h)) / (2 * h);
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    CHECK(q[i].v[0] == doctest::Approx(by_value[i]).epsilon(1e-6).scale(1.0));
    CHECK(q[i].v[1] == doctest::Approx(by_phase[i]).epsilon(1e-6).scale(1.0));
  }
}

TEST_CASE("a dual smoothstep has the closed-form slope") {
  using J = ceres::Jet<double, 1>;
  for (double u = 0.01; u < 1; u += 0.01)
    CHECK(motion::smoothstep(J(u, 0)).v[0] == doctest::Approx(6 * u * (1 - u)));
}

TEST_CASE("mirroring a dual pose mirrors its derivative") {
  using J = ceres::Jet<double, 1>;
  std::mt19937_64 rng(28);
  const motion::Mirror mirror(biped());
  const Vec q = random_pose(biped(), rng), slope = random_pose(biped(), rng);
  Eigen::Matrix<J, Eigen::Dynamic, 1> dual(q.size()), out(q.size());
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    dual[i].a = q[i];
    dual[i].v[0] = slope[i];
  }
  mirror.pose(dual.data(), out.data());
  // The map is linear in the numbers of a pose.
  const Vec value = mirror.pose(q), derivative = mirror.pose(slope);
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    CHECK(out[i].a == doctest::Approx(value[i]));
    CHECK(out[i].v[0] == doctest::Approx(derivative[i]));
  }
}
