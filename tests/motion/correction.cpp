// SPDX-License-Identifier: MIT
#include <traceur/motion/correction.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

#include <doctest/doctest.h>

#include <traceur/core/random.hpp>

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

TEST_CASE("correction: a time scale keeps parabolas and half of an oscillation of its period") {
  constexpr int keys = 240;
  constexpr double dt = 1 / 30.0, scale = 0.5;
  const motion::detail::TimeScales scales(keys, dt, {scale});
  CHECK(scales.columns() == 2 * keys);
  Eigen::MatrixXd y = Eigen::MatrixXd::Zero(3, 2 * keys), d(3, keys), part = d;
  for (int k = 0; k < keys; ++k) {
    const double t = k * dt;
    y(0, keys + k) = 1 - 2 * t + 0.3 * t * t;
    y(1, keys + k) = std::sin(2 * std::numbers::pi * t / scale);
    y(2, k) = k % 7;
  }
  scales.spread(y, d, part);
  CHECK((d.row(0) - y.row(0).tail(keys)).cwiseAbs().maxCoeff() < 1e-9);
  // Away from the ends, and a little less than in continuous time, whose third derivative is smaller than the difference's.
  for (int k = keys / 3; k < 2 * keys / 3; ++k) CHECK(std::abs(d(1, k) - 0.5 * y(1, keys + k)) < 0.05);
  CHECK(d.row(2) == y.row(2).head(keys));
  // What is smoothed solves the equation it is said to.
  const double lambda = std::pow(scale / (2 * std::numbers::pi * dt), 6);
  Eigen::MatrixXd third = Eigen::MatrixXd::Zero(keys - 3, keys);
  for (int k = 0; k + 3 < keys; ++k) third.row(k).segment<4>(k) << -1, 3, -3, 1;
  const Eigen::MatrixXd back = d + lambda * (d * third.transpose()) * third;
  CHECK((back.row(1) - y.row(1).tail(keys)).cwiseAbs().maxCoeff() < 1e-9);
}

TEST_CASE("correction: the gradient over time scales and of rounded kinks is that of central differences") {
  const auto points = body::surface_points(walk_on_boxes::character());
  motion::CorrectionWeights weights;
  weights.jerk = 0.1;  // else jerk drowns the rest
  const motion::Clip source = walk_on_boxes::clip(12, 0.1);
  const motion::CorrectionLoss loss(source, points, walk_on_boxes::ground(), weights);
  const motion::detail::TimeScales scales(loss.keys(), loss.dt(), {0.2, 0.6});
  const motion::KinkRounding rounding{0.02, 300, 200};
  const core::SerialExecutor serial;
  Eigen::MatrixXd d = Eigen::MatrixXd::Zero(loss.nv(), loss.keys()), g = d, part = d;
  Eigen::MatrixXd y = Eigen::MatrixXd::Zero(loss.nv(), scales.columns()), gy = y;
  core::RandomStream random(2, 0, 0);
  for (Eigen::Index i = 0; i < y.size(); ++i) y.data()[i] = 0.02 * (random.below(2001) / 1000.0 - 1);
  motion::CorrectionLoss::Workspace w = loss.workspace();
  scales.spread(y, d, part);
  const motion::CorrectionLosses at = loss.gradient(d, g, w, serial, rounding);
  scales.gather(g, gy, part);
  CHECK(at.jerk > 1000);
  CHECK(at.penetration > 0.1);
  CHECK(at.rounded != doctest::Approx(at.total));
  // The losses that are told are not rounded.
  CHECK(at.total == doctest::Approx(loss.losses(d).total).epsilon(1e-12));
  int kinks = 0;
  for (int trial = 0; trial < 100; ++trial) {
    const auto i = static_cast<Eigen::Index>(random.below(static_cast<std::uint32_t>(y.size())));
    const double here = y.data()[i], step = 1e-5;
    const auto rounded = [&](double x) {
      y.data()[i] = x;
      scales.spread(y, d, part);
      y.data()[i] = here;
      return loss.gradient(d, g, w, serial, rounding).rounded;
    };
    const double central = (rounded(here + step) - rounded(here - step)) / (2 * step);
    // Another point of a foot may become the nearest, another cell of the ground.
    if (std::abs(central - gy.data()[i]) > 1e-3 * (1 + std::abs(gy.data()[i]))) ++kinks;
  }
  CHECK(kinks <= 3);
}

TEST_CASE("correction: over several time scales Adam ends far below the paper's, on any executor") {
  const auto points = body::surface_points(walk_on_boxes::character());
  const motion::Clip source = walk_on_boxes::clip(20, 0.08);
  const terrain::HeightGrid ground = walk_on_boxes::ground();
  motion::CorrectionOptions paper, ours = motion::CorrectionOptions::multiscale(1000);
  paper.iterations = 1000;
  const auto plain = motion::correct(source, points, ground, paper);
  const auto done = motion::correct(source, points, ground, ours);
  MESSAGE("total loss " << plain.report.before.total << " -> " << plain.report.after.total << " as in the paper, "
                        << done.report.after.total);
  CHECK(done.report.after.total < 0.2 * plain.report.after.total);
  CHECK(done.report.after.penetration < 0.05 * done.report.before.penetration);
  CHECK(done.report.after.jerk <= done.report.before.jerk);
  ours.iterations = 30;
  core::ThreadExecutor threads(3);
  CHECK(motion::correct(source, points, ground, ours).clip.poses ==
        motion::correct(source, points, ground, ours, threads).clip.poses);
  ours.time_scales = {0.0};
  CHECK(traceur_test::message([&] { motion::correct(source, points, ground, ours); }).find("time scales") !=
        std::string::npos);
  ours.time_scales = {};
  ours.rounding.jerk_margin = 1000;
  CHECK(traceur_test::message([&] { motion::correct(source, points, ground, ours); }).find("margin") !=
        std::string::npos);
}
