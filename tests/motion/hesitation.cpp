// SPDX-License-Identifier: MIT
#include <traceur/motion/hesitation.hpp>

#include <cmath>

#include <doctest/doctest.h>

#include "../error_message.hpp"
#include "figure.hpp"

using namespace traceur;

namespace {

/// A gait whose clock stands still, or runs back and forth, for a while.
motion::Clip halting(double from, double stop, double sway) {
  const body::Skeleton s = figure::biped();
  const int keys = 91;
  motion::Clip clip{"halting", s, Eigen::VectorXd::LinSpaced(keys, 0, 3), Eigen::MatrixXd(s.nq(), keys),
                    Eigen::MatrixXd::Zero(s.size(), keys), false};
  for (int k = 0; k < keys; ++k) {
    const double t = clip.times[k];
    const double phi = t < from ? t : t < from + stop ? from + sway * std::sin(20 * (t - from)) : t - stop;
    clip.poses.col(k) = figure::gait_pose(s, {}, phi);
    clip.contacts(0, k) = k / 100.0;
  }
  return clip;
}

}  // namespace

TEST_CASE("hesitation: a motion that gets on loses nothing") {
  const motion::Clip clip = figure::gait({}, 3.0, 91);
  for (const bool cut : motion::hesitating_keys(clip)) CHECK_FALSE(cut);
  CHECK(motion::without_hesitation(clip).poses == clip.poses);
}

TEST_CASE("hesitation: a halt is cut out, and what is left goes on as before") {
  for (const double sway : {0.0, 0.01}) {
    const motion::Clip clip = halting(1.0, 1.0, sway);
    const motion::Clip out = motion::without_hesitation(clip);
    CHECK_NOTHROW(out.check());
    CHECK(out.duration() == doctest::Approx(2.0).epsilon(0.06));
    CHECK(out.contacts(0, out.keys() - 1) == clip.contacts(0, 90));
    // The widest step is a walking step and what was allowed to be close.
    for (int k = 1; k < out.keys(); ++k) {
      CHECK(out.times[k] - out.times[k - 1] == doctest::Approx(1 / 30.0));
      CHECK(std::abs(out.poses(0, k) - out.poses(0, k - 1)) < 1.3 / 30 + 0.15 / std::sqrt(13.0) + 0.02);
    }
  }
}

TEST_CASE("hesitation: each cut key is near an earlier kept one, each kept one is not") {
  const motion::Clip clip = halting(0.7, 0.6, 0.02);
  const auto cut = motion::hesitating_keys(clip, {0.2, 1});
  const auto apart = [&](int a, int b) {
    body::Frames<double> fa(clip.skeleton), fb(clip.skeleton);
    body::forward_kinematics(clip.skeleton, clip.poses.col(a).data(), fa);
    body::forward_kinematics(clip.skeleton, clip.poses.col(b).data(), fb);
    double squared = 0;
    for (std::size_t i = 0; i < fa.position.size(); ++i) squared += squared_norm(fa.position[i] - fb.position[i]);
    return std::sqrt(squared);
  };
  int count = 0;
  for (int k = 0; k < clip.keys(); ++k) {
    double nearest = 10;
    for (int i = 0; i < k; ++i)
      if (!cut[static_cast<std::size_t>(i)]) nearest = std::min(nearest, apart(i, k));
    CHECK(cut[static_cast<std::size_t>(k)] == (nearest < 0.2));
    count += cut[static_cast<std::size_t>(k)];
  }
  CHECK(count > 10);
}

TEST_CASE("hesitation: short halts stay") {
  const motion::Clip clip = halting(1.0, 0.14, 0);
  CHECK(motion::without_hesitation(clip, {0.05, 4}).keys() < clip.keys());
  CHECK(motion::without_hesitation(clip, {0.05, 8}).keys() == clip.keys());
  CHECK(traceur_test::message([&] { motion::hesitating_keys(clip, {0, 4}); }).find("distance") != std::string::npos);
}

TEST_CASE("hesitation: who never moves keeps his clip") {
  motion::Clip clip = figure::gait({}, 1.0, 31);
  for (int k = 1; k < 31; ++k) clip.poses.col(k) = clip.poses.col(0);
  CHECK(motion::without_hesitation(clip).keys() == 31);
}
