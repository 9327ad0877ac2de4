// SPDX-License-Identifier: MIT
#include <traceur/motion/correction.hpp>

#include <doctest/doctest.h>

#include "../error_message.hpp"
#include "walk_on_boxes.hpp"

using namespace traceur;

TEST_CASE("correction: Adam brings a sunk walk out of the ground and leaves the rest") {
  const auto points = body::surface_points(walk_on_boxes::character());
  const motion::Clip source = walk_on_boxes::clip(24, 0.08);
  const terrain::HeightGrid ground = walk_on_boxes::ground();
  motion::CorrectionOptions options;
  options.iterations = 1500;
  options.final_step = 1e-5;
  // Of the paper's weight for jerk Adam's squares of gradients are full for thousands of steps.
  options.weights.jerk = 0.01;
  const motion::Corrected done = motion::correct(source, points, ground, options);
  const auto &before = done.report.before, &after = done.report.after;
  MESSAGE("penetration " << before.penetration << " -> " << after.penetration << " m, contact " << before.contact << " -> " << after.contact << " m, total " << before.total << " -> " << after.total);
  CHECK(before.penetration > 1);
  CHECK(after.penetration < 0.1 * before.penetration);
  CHECK(after.contact < before.contact);
  CHECK(after.jerk <= before.jerk);
  CHECK(after.total < 0.2 * before.total);
  CHECK(figure::largest_gap(done.clip, source) < 0.5);
  CHECK_NOTHROW(done.clip.check());
  CHECK(done.clip.contacts == source.contacts);
  // What the report says is what the clip is.
  const motion::CorrectionLoss again(done.clip, points, ground, options.weights);
  const auto measured = again.losses(Eigen::MatrixXd::Zero(again.nv(), again.keys()));
  CHECK(measured.penetration == doctest::Approx(after.penetration).epsilon(1e-6));
  CHECK(measured.contact == doctest::Approx(after.contact).epsilon(1e-6));
  CHECK(done.report.history.size() == 1501);
  CHECK(*std::min_element(done.report.history.begin(), done.report.history.end()) == after.total);
}

TEST_CASE("correction: a motion without fault stays as it is") {
  const auto points = body::surface_points(walk_on_boxes::character());
  motion::Clip source = walk_on_boxes::clip(16, -1.0);
  source.contacts.setZero();
  motion::CorrectionOptions options;
  options.iterations = 20;
  const motion::Corrected done = motion::correct(source, points, walk_on_boxes::ground(), options);
  CHECK(done.report.before.total == 0);
  CHECK(figure::largest_gap(done.clip, source) < 1e-12);
}

TEST_CASE("correction: threads do not change the bits; no iterations change nothing") {
  const auto points = body::surface_points(walk_on_boxes::character());
  const motion::Clip source = walk_on_boxes::clip(20, 0.06);
  motion::CorrectionOptions options;
  options.iterations = 30;
  core::ThreadExecutor threads(3);
  const auto a = motion::correct(source, points, walk_on_boxes::ground(), options);
  const auto b = motion::correct(source, points, walk_on_boxes::ground(), options, threads);
  CHECK(a.clip.poses == b.clip.poses);
  CHECK(a.report.history == b.report.history);
  options.iterations = 0;
  const auto none = motion::correct(source, points, walk_on_boxes::ground(), options);
  CHECK(figure::largest_gap(none.clip, source) < 1e-12);
  options.step = 0;
  CHECK(traceur_test::message([&] { motion::correct(source, points, walk_on_boxes::ground(), options); }).find("step") !=
        std::string::npos);
}
