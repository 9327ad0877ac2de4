// SPDX-License-Identifier: MIT
#include <traceur/motion/smooth.hpp>

#include <doctest/doctest.h>

#include "figure.hpp"

using namespace traceur;
using namespace figure;

TEST_CASE("constant velocities, linear and angular, pass unchanged, ends included") {
  std::mt19937_64 rng(61);
  motion::Clip clip{"glide", biped(), Vec::LinSpaced(31, 0, 1), Eigen::MatrixXd(biped().nq(), 31), Eigen::MatrixXd(), false};
  const Vec q0 = random_pose(clip.skeleton, rng);
  Vec v(clip.skeleton.nv());
  for (Eigen::Index i = 0; i < v.size(); ++i) v[i] = uniform(rng, -2, 2);
  for (int k = 0; k < 31; ++k) {
    const Vec d = clip.times[k] * v;
    body::displace(clip.skeleton, q0.data(), d.data(), clip.poses.col(k).data());
  }
  CHECK(largest_gap(motion::smooth(clip, 0.05), clip) < 1e-9);
}

TEST_CASE("an oscillation is damped as the Gaussian's transform says") {
  motion::Clip clip{"wave", biped(), Vec::LinSpaced(241, 0, 2), Eigen::MatrixXd(biped().nq(), 241), Eigen::MatrixXd(), true};
  const int knee = clip.skeleton[clip.skeleton.find("left_knee")].q_index;
  const double w = 2 * pi * 2, sigma = 0.05;
  for (int k = 0; k < 241; ++k) {
    clip.poses.col(k) = clip.skeleton.neutral_pose();
    clip.poses(knee, k) = std::sin(w * clip.times[k]);
  }
  const auto out = motion::smooth(clip, sigma);
  const double gain = std::exp(-0.5 * w * w * sigma * sigma);
  CHECK(gain < 0.85);
  for (int k = 0; k < 241; ++k) CHECK(out.poses(knee, k) == doctest::Approx(gain * std::sin(w * clip.times[k])).epsilon(0.01).scale(1.0));
}

TEST_CASE("a turning cycle stays closed, and its seam is smoothed like any place") {
  Gait g;
  g.turn = 0.6;
  const auto clip = gait(g, g.period, 61, true);
  const auto out = motion::smooth(clip, 0.03);
  Vec end = out.poses.col(0);
  clip.carry_root(1, end);
  CHECK(distance(clip.skeleton, end, out.poses.col(60)) < 1e-9);
  Gait later = g;
  later.lead = 2 * pi * 0.25;
  const auto shifted = motion::smooth(gait(later, g.period, 61, true), 0.03);
  const int n = clip.skeleton.nq() - 7;
  for (int k = 0; k < 60; ++k) CHECK((shifted.poses.col(k).tail(n) - out.poses.col((k + 15) % 60).tail(n)).norm() < 1e-6);
}

TEST_CASE("noise shrinks and end poses stay") {
  std::mt19937_64 rng(62);
  Gait g;
  const auto clean = gait(g, 2.0, 121);
  auto noisy = clean;
  for (int k = 0; k < 121; ++k) {
    Vec d(clean.skeleton.nv());
    for (Eigen::Index i = 0; i < d.size(); ++i) d[i] = uniform(rng, -0.05, 0.05);
    body::displace(clean.skeleton, noisy.poses.col(k).data(), d.data(), noisy.poses.col(k).data());
  }
  const auto out = motion::smooth(noisy, 0.03);
  double before = 0, after = 0;
  for (int k = 0; k < 121; ++k) {
    before += distance(clean.skeleton, noisy.poses.col(k), clean.poses.col(k));
    after += distance(clean.skeleton, out.poses.col(k), clean.poses.col(k));
  }
  CHECK(after < 0.6 * before);
  CHECK(distance(clean.skeleton, out.poses.col(0), noisy.poses.col(0)) < 1e-9);
  CHECK(distance(clean.skeleton, out.poses.col(120), noisy.poses.col(120)) < 1e-9);
  CHECK_NOTHROW(out.check());
  CHECK(fails_with([&] { motion::smooth(clean, 0); }, "clip 'gait': smooth"));
}
