// SPDX-License-Identifier: MIT
// The snippets on correction of docs/motion.md and on surface points of docs/body.md, compiled and run. Keep them alike.
#include <traceur/motion/correction.hpp>
#include <traceur/motion/correction_ceres.hpp>
#include <traceur/motion/hesitation.hpp>
#include <traceur/motion/selection.hpp>

#include "walk_on_boxes.hpp"

// After Ceres, which brings macros of the same names.
#include <doctest/doctest.h>

using namespace traceur;

TEST_CASE("surface points on the page") {
  const body::Character character = walk_on_boxes::character();
  const Eigen::VectorXd q = character.skeleton.neutral_pose();

  const std::vector<body::SurfacePoint> points = body::surface_points(character);
  body::Frames<double> frames(character.skeleton);
  body::forward_kinematics(character.skeleton, q.data(), frames);
  std::vector<double> places(3 * points.size());  // x y z of each, m
  body::place_points<double>(points, frames, places.data());

  CHECK(points.size() == 160);
  CHECK(places[2] < 0.2);
}

TEST_CASE("correction on the page") {
  const body::Character character = walk_on_boxes::character();
  const terrain::HeightGrid ground = walk_on_boxes::ground();
  const motion::Clip generated = walk_on_boxes::clip();

  const auto points = body::surface_points(character);
  const motion::Clip brisk = motion::without_hesitation(generated);
  core::ThreadExecutor threads(2);
  const motion::Corrected solved = motion::correct_ceres(brisk, points, ground, {}, threads);
  motion::CorrectionOptions as_in_the_paper;
  as_in_the_paper.iterations = 200;  // the paper: 3000
  const motion::Corrected descended = motion::correct(brisk, points, ground, as_in_the_paper, threads);

  CHECK(solved.report.after.penetration < 0.05 * solved.report.before.penetration);
  CHECK(descended.report.after.total < descended.report.before.total);
}

TEST_CASE("selection on the page") {
  const auto points = body::surface_points(walk_on_boxes::character());
  const terrain::HeightGrid ground = walk_on_boxes::ground();
  const std::vector<motion::Clip> batch{walk_on_boxes::clip(12, 0.1), walk_on_boxes::clip(12, 0.02)};

  std::vector<motion::MotionScore> scores;
  for (const motion::Clip& clip : batch) scores.push_back(motion::score(clip, points, ground, true));
  const std::size_t best = motion::best_motions(scores, 1)[0];

  CHECK(best == 1);
}
