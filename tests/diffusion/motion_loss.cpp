// SPDX-License-Identifier: MIT
#include <traceur/diffusion/motion_loss.hpp>

#include <array>
#include <cmath>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/diffusion/training.hpp>

#include "figure.hpp"
#include "support.hpp"

using namespace traceur::diffusion;
using traceur::core::Vector3;
using traceur::terrain::HeadingFrame;
using traceur::terrain::HeightGrid;

static_assert(DenoisingLoss<MotionLoss<float>, float> && DenoisingLoss<MotionLoss<double>, double>);

namespace {

constexpr int frames = 4;

MotionLossWeights only(double MotionLossWeights::*weight) {
  MotionLossWeights w = MotionLossWeights::penetration_only();
  w.penetration = 0;
  w.*weight = 1;
  return w;
}

FeatureScale<double> some_scale(Eigen::Index features) {
  FeatureScale<double> scale = FeatureScale<double>::none(features);
  for (Eigen::Index i = 0; i < features; ++i) {
    scale.mean[i] = 0.1 * std::sin(static_cast<double>(i));
    scale.deviation[i] = 0.6 + 0.3 * std::cos(static_cast<double>(i));
  }
  return scale;
}

}  // namespace

TEST_CASE("every term's gradient is its slope") {
  const FrameFeatures f(figure::skeleton());
  const auto scale = some_scale(f.size());
  Eigen::MatrixXd heights(4, 4);
  heights << 0.5, 0.2, 0.9, 0.1, -0.3, 0.8, 0.4, 0.3, 0.1, 0.6, -0.2, 0.7, 0.3, 0.5, 0.2, 0.4;
  const HeightGrid ground(heights, 0.4, -0.8, -0.8);
  const HeightGrid* const grids[] = {&ground, &ground};
  const HeadingFrame<double> heading[] = {HeadingFrame<double>::at({0.1, 0.2, 0.3}, 0.7),
                                          HeadingFrame<double>::at({-0.3, 0.1, 0.1}, -2.0)};
  std::vector<traceur::body::SurfacePoint> points;
  for (int i = 0; i < 6; ++i) points.push_back({i, {0.05, -0.02, 0.03 * i}});
  // Rotations of a size that occurs: about 1.5 rad.
  const Table<double> clean = 0.8 * random_table<double>(frames * f.size(), 2, 1);
  const Table<double> estimate = clean + 0.3 * random_table<double>(frames * f.size(), 2, 2);
  using W = MotionLossWeights;
  std::vector<MotionLossWeights> cases{W{}};
  for (double W::*w : {&W::root_position, &W::root_rotation, &W::joint_rotation, &W::joint_position, &W::contacts,
                       &W::root_velocity, &W::joint_velocity, &W::root_turning, &W::joint_turning, &W::consistency,
                       &W::penetration}) {
    cases.push_back(only(w));
  }
  for (const MotionLossWeights& weights : cases) {
    MotionLoss<double> loss(f, scale, frames, 0.1, weights, points);
    loss.set_terrain(grids, heading);
    auto w = loss.workspace();
    Table<double> gradient(estimate.rows(), 2), unused(estimate.rows(), 2);
    const double value = loss(clean, estimate, 0, w, gradient);
    CHECK(value > 0);
    CHECK(w.terms[0] + w.terms[1] + w.terms[2] + w.terms[3] == doctest::Approx(value));
    for (std::uint64_t seed = 3; seed < 9; ++seed) {
      const Table<double> direction = random_table<double>(estimate.rows(), 2, seed);
      const double h = 1e-6;
      const double up = loss(clean, estimate + h * direction, 0, w, unused);
      const double down = loss(clean, estimate - h * direction, 0, w, unused);
      const double slope = (up - down) / (2 * h);
      CHECK((gradient.array() * direction.array()).sum() == doctest::Approx(slope).epsilon(1e-6));
    }
  }
}

TEST_CASE("a motion that the body does, estimated as it is, loses nothing") {
  const FrameFeatures f(figure::skeleton());
  MotionLoss<double> loss(f, FeatureScale<double>::none(f.size()), frames, 1.0 / 30);
  traceur::body::Frames<double> scratch(f.skeleton());
  Table<double> x(frames * f.size(), 1), gradient(x.rows(), 1);
  for (int k = 0; k < frames; ++k) {
    const Eigen::VectorXd q = figure::random_pose(f.skeleton(), static_cast<std::uint64_t>(k));
    f.encode(q.data(), nullptr, HeadingFrame<double>{}, scratch, x.data() + k * f.size());
  }
  auto w = loss.workspace();
  CHECK(loss(x, x, 0, w, gradient) < 1e-20);
  CHECK(gradient.norm() < 1e-9);
}

TEST_CASE("terms are what the equations say") {
  const FrameFeatures f(figure::skeleton());
  const double dt = 0.1;
  auto value = [&](double MotionLossWeights::*weight, const Table<double>& clean, const Table<double>& estimate) {
    MotionLoss<double> loss(f, FeatureScale<double>::none(f.size()), frames, dt, only(weight));
    auto w = loss.workspace();
    Table<double> gradient(clean.rows(), 1);
    return loss(clean, estimate, 0, w, gradient);
  };
  const Table<double> clean = Table<double>::Zero(frames * f.size(), 1);
  Table<double> x = clean;
  // One frame of four: 0.3 m off, and over two of three pairs of frames 3 m/s too fast and too slow.
  x(f.size() + 1) = 0.3;
  CHECK(value(&MotionLossWeights::root_position, clean, x) == doctest::Approx(0.09 / 4));
  CHECK(value(&MotionLossWeights::root_velocity, clean, x) == doctest::Approx(2 * 9.0 / 3));
  x = clean;
  x(f.size() + f.rotation(3) + 2) = 0.2;
  CHECK(value(&MotionLossWeights::joint_rotation, clean, x) == doctest::Approx(0.04 / 4));
  CHECK(value(&MotionLossWeights::joint_turning, clean, x) == doctest::Approx(2 * 4.0 / 3));
  // Rotations that are the same, though their numbers differ by a whole turn.
  Table<double> y = clean;
  x(f.size() + f.rotation(3) + 2) = 2.5;
  y(f.size() + f.rotation(3) + 2) = 2.5 - 2 * 3.14159265358979323846;
  CHECK(value(&MotionLossWeights::joint_rotation, x, y) < 1e-18);
  // The shin 0.1 m from where kinematics has it.
  x = clean;
  traceur::body::Frames<double> scratch(f.skeleton());
  for (int k = 0; k < frames; ++k) f.project(x.data() + k * f.size(), scratch);
  CHECK(value(&MotionLossWeights::consistency, clean, x) < 1e-20);
  x(f.position(4) + 1) += 0.1;
  CHECK(value(&MotionLossWeights::consistency, clean, x) == doctest::Approx(0.01 / 4));
  x = clean;
  x(f.contact(2)) = 0.5;
  CHECK(value(&MotionLossWeights::contacts, clean, x) == doctest::Approx(0.25 / 4));
}

TEST_CASE("penetration is the depth of points below the ground") {
  const FrameFeatures f(figure::skeleton());
  MotionLoss<double> loss(f, FeatureScale<double>::none(f.size()), frames, 0.1, MotionLossWeights::penetration_only(),
                          {{0, {0, 0, -0.2}}, {0, {0, 0, 0.5}}});
  const HeightGrid ground = HeightGrid::flat(1.0);
  const HeightGrid* const grids[] = {&ground};
  const HeadingFrame<double> heading[] = {HeadingFrame<double>::at({3, 4, 1.0}, 1.0)};
  auto w = loss.workspace();
  Table<double> x = Table<double>::Zero(frames * f.size(), 1), gradient(x.rows(), 1);
  CHECK(loss(x, x, 0, w, gradient) == 0.0);  // no ground yet
  loss.set_terrain(grids, heading);
  x(2) = 0.05;  // of the first frame, the root's height over the ground
  CHECK(loss(x, x, 0, w, gradient) == doctest::Approx(15 * (0.15 + 3 * 0.2) / 4));
  CHECK(gradient(2) == doctest::Approx(-15.0 / 4));
}

TEST_CASE("a motion loss refuses what does not fit") {
  const FrameFeatures f(figure::skeleton());
  const auto scale = FeatureScale<double>::none(f.size());
  using L = MotionLoss<double>;
  CHECK_THROWS_AS(L(f, scale, 1, 0.1), traceur::Error);
  CHECK_THROWS_AS(L(f, scale, 4, 0.0), traceur::Error);
  CHECK_THROWS_AS(L(f, FeatureScale<double>::none(3), 4, 0.1), traceur::Error);
  CHECK_THROWS_AS(L(f, scale, 4, 0.1, {}, {{6, {0, 0, 0}}}), traceur::Error);
}
