// SPDX-License-Identifier: MIT
#include <traceur/diffusion/motion_windows.hpp>

#include <cmath>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/diffusion/motion_generator.hpp>

#include "figure.hpp"
#include "support.hpp"

using namespace traceur::diffusion;
using traceur::core::Vector3;
using traceur::terrain::HeadingFrame;
using traceur::terrain::HeightGrid;

TEST_CASE("a window is seen from its last past frame") {
  const auto clip = figure::walk();
  const MotionWindows<double> windows(FrameFeatures(clip.skeleton));
  const FrameFeatures& f = windows.features();
  CHECK(windows.frames() == 15);
  CHECK(windows.duration() == doctest::Approx(14.0 / 30));
  auto w = windows.scratch();
  Table<double> x(windows.sample_features(), 1);
  const auto frame = windows.sample(clip, 0.3, w, x.data());
  for (int k = 0; k < 15; ++k) {
    const auto own = x.middleRows(k * f.size(), f.size());
    // Straight ahead at 1.5 m/s, facing ahead.
    CHECK(own(0, 0) == doctest::Approx(1.5 * (k - 1) / 30).epsilon(1e-9));
    CHECK(std::abs(own(1, 0)) < 1e-9);
    CHECK(own.middleRows(3, 3).norm() < 1e-9);
    Eigen::VectorXd q(clip.skeleton.nq());
    f.decode(own.eval().data(), frame, q.data(), nullptr);
    CHECK((q - clip.sample(0.3 + k / 30.0)).norm() < 1e-6);
  }
  CHECK(x.col(0).segment(f.size(), 3).norm() < 1e-12);
}

TEST_CASE("a drawn window asks to go where the clip goes") {
  const auto clip = figure::walk();
  WindowParameters p;
  p.target_noise = 0;
  p.map = {.spacing = 0.2, .back = 1, .ahead = 2, .side = 1, .limit = 3};
  MotionWindows<float> windows(FrameFeatures(clip.skeleton), p);
  const traceur::motion::Clip* clips[] = {&clip};
  windows.set_scale(measure_scale<float>(windows, clips));
  auto w = windows.scratch();
  Table<float> x(windows.sample_features(), 1), c(windows.condition_features(), 1), again = x;
  CHECK(windows.condition_features() == 4 * 3 + 2 + 2 * windows.features().size());
  traceur::core::RandomStream random(3);
  const auto frame = windows.draw(clip, HeightGrid::flat(0.1), random, w, x.data(), c.data());
  CHECK(c(windows.target_row()) == doctest::Approx(1.0).epsilon(1e-5));
  CHECK(std::abs(c(windows.target_row() + 1)) < 1e-5f);
  for (int i = 0; i < 12; ++i) CHECK(c(i) == doctest::Approx(0.1 - frame.origin.z).epsilon(1e-5));
  // The past of the condition is that of the sample, a little shaken.
  const Eigen::Index past = 2 * windows.features().size();
  const Table<float> away = c.bottomRows(past) - x.topRows(past);
  double shaken = 0;
  int moved = 0;
  for (int k = 0; k < 2; ++k) {
    for (Eigen::Index i = 0; i < windows.features().size(); ++i) {
      const double by = static_cast<double>(away(k * windows.features().size() + i) * windows.scale().deviation[i]);
      if (i < windows.features().contact(0)) {
        shaken += by * by;
        ++moved;
      } else {
        CHECK(by == 0.0);
      }
    }
  }
  CHECK(std::sqrt(shaken / moved) == doctest::Approx(0.01).epsilon(0.3));
  // Standing still there is nowhere to go.
  windows.look(HeightGrid::flat(0), frame, frame.origin + Vector3<double>{0.05, 0, 9}, c.data());
  CHECK(c(windows.target_row()) == 0.0f);
  CHECK(c(windows.target_row() + 1) == 0.0f);
}

TEST_CASE("projection puts the past in place where it is given") {
  const auto clip = figure::walk();
  MotionWindows<double> windows{FrameFeatures(clip.skeleton)};
  const traceur::motion::Clip* clips[] = {&clip};
  windows.set_scale(measure_scale<double>(windows, clips));
  const Table<double> c = random_table<double>(windows.condition_features(), 2, 1);
  Table<double> x = random_table<double>(windows.sample_features(), 2, 2);
  const Parts given[] = {past_part, terrain_part};
  WindowProjection<double> project(windows);
  project.set_condition({c, given}, past_part);
  project(x);
  const Eigen::Index past = 2 * windows.features().size();
  CHECK(x.col(0).head(past) == c.col(0).tail(past));
  CHECK(x.col(1).head(past) != c.col(1).tail(past));
  // Frames that are generated are left alone the second time.
  Table<double> again = x;
  project(again);
  CHECK((again - x).norm() < 1e-9);
}

TEST_CASE("clips that do not fit are refused") {
  const MotionWindows<float> windows{FrameFeatures(figure::skeleton())};
  CHECK_NOTHROW(windows.check(figure::walk(0.5)));
  CHECK_THROWS_WITH_AS(windows.check(figure::walk(0.2)),
                       "clip 'walk': expected at least 0.466667 s for a window, found 0.200000", traceur::Error);
  auto other = figure::walk();
  other.skeleton = {};
  CHECK_THROWS_AS(windows.check(other), traceur::Error);
  traceur::diffusion::WindowParameters none, still;
  none.past = 0;
  still.fps = 0;
  CHECK_THROWS_AS(MotionWindows<float>(FrameFeatures(figure::skeleton()), none), traceur::Error);
  CHECK_THROWS_AS(MotionWindows<float>(FrameFeatures(figure::skeleton()), still), traceur::Error);
}
