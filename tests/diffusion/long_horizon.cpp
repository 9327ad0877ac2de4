// SPDX-License-Identifier: MIT
#include <traceur/diffusion/long_horizon.hpp>

#include <cmath>
#include <limits>
#include <vector>

#include <doctest/doctest.h>

#include "figure.hpp"
#include "support.hpp"

using namespace traceur::diffusion;
using traceur::core::Vector3;
using traceur::terrain::HeightGrid;

namespace {

// Glides at 1.5 m/s in the direction asked for, whatever the noise: root level at its height, the past as given.
struct Glider {
  const MotionWindows<double>& windows;
  Table<double> values;
  std::vector<Parts> given;
  int begun = 0;
  double speed = 1.5;

  Eigen::Index features() const { return windows.sample_features(); }
  Eigen::Index condition_features() const { return windows.condition_features(); }
  void begin(const Condition<double>& c) {
    ++begun;
    values = c.values;
    given.clear();
    for (Eigen::Index j = 0; j < c.values.cols(); ++j) given.push_back(c.parts(j));
  }
  void denoise(int, traceur::nn::ConstMatrix<double> noisy, traceur::nn::Matrix<double> clean) {
    clean.setZero();
    for (Eigen::Index j = 0; j < noisy.cols(); ++j) {
      const double dx = values(windows.target_row(), j), dy = values(windows.target_row() + 1, j);
      for (int k = 0; k < windows.frames(); ++k) {
        double* const x = clean.col(j).data() + k * windows.features().size();
        const double way = speed * (k - 1) * windows.dt();
        x[0] = way * dx;
        x[1] = way * dy;
        x[5] = k < 2 ? 0 : std::atan2(dy, dx);
      }
      windows.scale().apply(clean.col(j).data(), windows.frames());
    }
  }
};
static_assert(Denoiser<Glider, double>);

std::vector<Vector3<double>> line(double length, double spacing = 0.4) {
  std::vector<Vector3<double>> path;
  for (double s = 0; s <= length + 1e-9; s += spacing) path.push_back({1 + 0.6 * s, 2 + 0.8 * s, 0});
  return path;
}

WindowParameters few_heights() {
  WindowParameters p;
  p.map = {.spacing = 0.2, .back = 1, .ahead = 1, .side = 1, .limit = 3};
  return p;
}

}  // namespace

TEST_CASE("a motion follows its path to the end, without a jump between windows") {
  const MotionWindows<double> windows(FrameFeatures(figure::skeleton()), few_heights());
  Glider first{windows, {}, {}}, next{windows, {}, {}};
  LongHorizonParameters p;
  p.feet = {5};
  LongHorizon<double> horizon(windows, Schedule::cosine(), 5, 3, p);
  const auto path = line(6);
  const HeightGrid ground = HeightGrid::flat(0.3);
  horizon.generate(first, next, path, ground, 7, 3);
  CHECK(first.begun == 1);
  CHECK(next.begun > 5);
  for (int b = 0; b < 3; ++b) {
    CHECK(horizon.end(b) == LongHorizonEnd::arrived);
    const auto clip = horizon.clip(b);
    // 5.5 m at 1.5 m/s.
    CHECK(clip.duration() == doctest::Approx(5.5 / 1.5).epsilon(0.02));
    for (int k = 0; k < clip.keys(); ++k) {
      const double x = clip.poses(0, k) - 1, y = clip.poses(1, k) - 2;
      CHECK(std::abs(0.8 * x - 0.6 * y) < 1e-6);
      CHECK(clip.poses(2, k) > 0.3 + 0.7);
      CHECK(clip.poses(2, k) < 0.3 + 0.9);
      if (k > 0) CHECK((clip.poses.col(k) - clip.poses.col(k - 1)).head(3).norm() == doctest::Approx(0.05).epsilon(1e-6));
    }
  }
  // Each starts at a height of its own.
  CHECK(horizon.clip(0).poses(2, 0) != horizon.clip(1).poses(2, 0));
}

TEST_CASE("a motion of a batch has the same bits alone") {
  const MotionWindows<double> windows(FrameFeatures(figure::skeleton()), few_heights());
  Glider d{windows, {}, {}};
  const HeightGrid ground = HeightGrid::flat();
  LongHorizon<double> horizon(windows, Schedule::cosine(), 5, 3);
  const auto path = line(3);
  horizon.generate(d, d, path, ground, 7, 3);
  const auto of_batch = horizon.clip(0);
  horizon.generate(d, d, path, ground, 7, 1);
  CHECK(horizon.clip(0).poses == of_batch.poses);
}

TEST_CASE("a motion goes on from poses") {
  const auto walk = figure::walk();
  const MotionWindows<double> windows(FrameFeatures(walk.skeleton), few_heights());
  Glider first{windows, {}, {}}, next{windows, {}, {}};
  LongHorizon<double> horizon(windows, Schedule::cosine(), 5, 1);
  Eigen::MatrixXd start(walk.skeleton.nq(), 2);
  start.col(0) = walk.sample(0.0);
  start.col(1) = walk.sample(1.0 / 30);
  std::vector<Vector3<double>> path;
  for (int i = 0; i < 12; ++i) path.push_back({1 + 0.4 * i * std::cos(0.5), -2 + 0.4 * i * std::sin(0.5), 0});
  horizon.generate(first, next, path, HeightGrid::flat(), 7, 1, start);
  CHECK(first.begun == 0);
  CHECK(horizon.end(0) == LongHorizonEnd::arrived);
  const auto clip = horizon.clip(0);
  CHECK((clip.poses.leftCols(2) - start).norm() < 1e-12);
}

TEST_CASE("a motion that does not arrive ends in time, and one that breaks is told apart") {
  const MotionWindows<double> windows(FrameFeatures(figure::skeleton()), few_heights());
  Glider slow{windows, {}, {}};
  slow.speed = 0;
  LongHorizonParameters p;
  p.longest = 1.5;
  LongHorizon<double> horizon(windows, Schedule::cosine(), 5, 1, p);
  horizon.generate(slow, slow, line(4), HeightGrid::flat(), 1, 1);
  CHECK(horizon.end(0) == LongHorizonEnd::too_long);
  CHECK(horizon.clip(0).duration() == doctest::Approx(1.5));
  Glider broken{windows, {}, {}};
  broken.speed = std::numeric_limits<double>::quiet_NaN();
  horizon.generate(slow, broken, line(4), HeightGrid::flat(), 1, 1);
  CHECK(horizon.end(0) == LongHorizonEnd::not_finite);
  CHECK(horizon.clip(0).keys() >= 2);
}

TEST_CASE("long horizons refuse what does not fit") {
  const MotionWindows<double> windows(FrameFeatures(figure::skeleton()), few_heights());
  const Schedule s = Schedule::cosine();
  using L = LongHorizon<double>;
  const auto with = [](auto&& change) {
    LongHorizonParameters p;
    change(p);
    return p;
  };
  CHECK_THROWS_AS(L(windows, s, 5, 0), traceur::Error);
  CHECK_THROWS_WITH_AS(L(windows, s, 5, 1, with([](auto& p) { p.rewind = 1; })),
                       "long horizon: expected a rewind of 2 to 14 frames, got 1", traceur::Error);
  CHECK_THROWS_AS(L(windows, s, 5, 1, with([](auto& p) { p.feet = {6}; })), traceur::Error);
  CHECK_THROWS_AS(L(windows, s, 5, 1, with([](auto& p) { p.longest = 0; })), traceur::Error);
  L horizon(windows, s, 5, 1);
  Glider d{windows, {}, {}};
  const auto path = line(4);
  const HeightGrid ground = HeightGrid::flat();
  CHECK_THROWS_AS(horizon.generate(d, d, line(0.1), ground, 1, 1), traceur::Error);
  CHECK_THROWS_AS(horizon.generate(d, d, path, ground, 1, 2), traceur::Error);
  CHECK_THROWS_AS(horizon.generate(d, d, path, ground, 1, 1, Eigen::MatrixXd::Zero(3, 2)), traceur::Error);
}
