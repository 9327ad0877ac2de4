// SPDX-License-Identifier: MIT
#include <traceur/motion/selection.hpp>

#include <limits>
#include <vector>

#include <doctest/doctest.h>

#include "walk_on_boxes.hpp"

using namespace traceur;
using motion::MotionScore;

TEST_CASE("selection: not to arrive is a penalty, whatever the printed equation says") {
  const motion::SelectionHeuristic h;
  CHECK(h({2, 3, true}) == 5);
  CHECK(h({2, 3, false}) == 1005);
  CHECK(motion::SelectionHeuristic::parc_code()({2, 3, true}) == doctest::Approx(0.5));
}

TEST_CASE("selection: the best come first, equals in order, and no number last") {
  const std::vector<MotionScore> scores{{5, 0, true}, {0, 0, false}, {1, 1, true},
                                        {std::numeric_limits<double>::quiet_NaN(), 0, true}, {2, 0, true}};
  CHECK(motion::best_motions(scores, 9) == std::vector<std::size_t>{2, 4, 0, 1, 3});
  CHECK(motion::best_motions(scores, 2) == std::vector<std::size_t>{2, 4});
  CHECK(motion::best_motions({}, 2).empty());
}

TEST_CASE("selection: a score is the losses of the clip") {
  const auto points = body::surface_points(walk_on_boxes::character());
  const motion::Clip clip = walk_on_boxes::clip(12, 0.1);
  const motion::CorrectionLoss loss(clip, points, walk_on_boxes::ground());
  const auto l = loss.losses(Eigen::MatrixXd::Zero(loss.nv(), loss.keys()));
  const MotionScore s = motion::score(clip, points, walk_on_boxes::ground(), true);
  CHECK(s.penetration == doctest::Approx(l.penetration));
  CHECK(s.contact == doctest::Approx(l.contact));
  CHECK(s.reached_end);
}
