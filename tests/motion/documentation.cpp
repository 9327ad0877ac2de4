// SPDX-License-Identifier: MIT
// The snippets of docs/motion.md, compiled and run. Keep the two alike.
#include <doctest/doctest.h>

#include <traceur/motion/align.hpp>
#include <traceur/motion/blend.hpp>
#include <traceur/motion/contact_labels.hpp>
#include <traceur/motion/displacement.hpp>
#include <traceur/motion/flight_consistency.hpp>
#include <traceur/motion/loop.hpp>
#include <traceur/motion/mirror.hpp>
#include <traceur/motion/scaling.hpp>
#include <traceur/motion/smooth.hpp>
#include <traceur/motion/time_warp.hpp>

#include "figure.hpp"

using namespace traceur;

namespace {

motion::Clip capture() {
  motion::Clip clip = figure::gait({}, 3.0, 181);
  clip.poses.row(2).array() += 0.3;
  return clip;
}

body::Character character() {
  body::Character c;
  c.name = "biped";
  c.skeleton = figure::biped();
  for (int i = 0; i < c.skeleton.size(); ++i) c.inertias.push_back({1.0, {0, 0, 0}, core::Symmetric3<double>::scalar(0.01)});
  c.actuators.resize(c.inertias.size());
  for (const char* foot : {"left_foot", "right_foot"})
    c.shapes.push_back({body::Shape::Kind::sphere, foot, c.skeleton.find(foot), {0, 0, 0},
                        core::Quaternion<double>::identity(), {0.05, 0, 0}});
  return c;
}

}  // namespace

TEST_CASE("clips") {
  const motion::Clip clip = capture();

  clip.check();
  const Eigen::VectorXd pose = clip.sample(0.4);        // nq numbers
  const Eigen::VectorXd velocity = clip.velocity(0.4);  // nv numbers
  const motion::Clip part = motion::cut(clip, 0.5, 1.7);
  const motion::Clip even = motion::resample(part, 30);

  CHECK(pose.size() == clip.skeleton.nq());
  CHECK(velocity.size() == clip.skeleton.nv());
  CHECK(even.keys() == 37);
}

TEST_CASE("variants") {
  const motion::Clip clip = capture();

  motion::Displacement<double> d{Eigen::VectorXd::LinSpaced(3, 0, clip.duration()),
                                 Eigen::MatrixXd::Zero(clip.skeleton.nv(), 3)};
  d.values(2, 1) = 0.1;  // 10 cm higher in the middle
  const Eigen::VectorXd tau = Eigen::VectorXd::Constant(30, std::log(1.25));
  const motion::TimeWarp<> warp(tau, clip.duration() / 1.25 / 30);  // a quarter faster
  const motion::Clip variant = motion::variant(clip, d, warp);

  CHECK(variant.duration() == doctest::Approx(clip.duration() / 1.25));
  CHECK(variant.sample(warp.time(1.5))[2] == doctest::Approx(clip.sample(1.5)[2] + 0.1));
}

TEST_CASE("edits") {
  const motion::Clip clip = capture();
  const motion::Clip other = motion::scale_duration(clip, 0.9);

  const motion::Clip small = motion::scale_amplitude(clip, 0.8);  // alpha
  const motion::Clip slow = motion::scale_duration(clip, 1.2);    // beta
  motion::Blend blend;
  blend.start = 1.0;
  blend.duration = 0.4;
  const motion::Clip both = motion::blend(slow, other, blend);
  const motion::Clip soft = motion::smooth(both, 0.03);
  const auto [home, transform] = motion::align(soft);

  CHECK(small.keys() == clip.keys());
  CHECK(std::abs(home.poses(0, 0)) < 1e-9);
  CHECK(norm(transform.inverse().apply(core::Vector3<double>{0, 0, 0}) - core::Vector3<double>{soft.poses(0, 0), soft.poses(1, 0), 0}) < 1e-9);
}

TEST_CASE("cycles") {
  const motion::Clip clip = capture();
  bool found_one = false;

  const motion::Mirror mirror(clip.skeleton);
  if (const auto found = motion::find_cycle(clip)) {
    const motion::Clip cycle = motion::cut(clip, found->start, found->end);
    const motion::Clip closed = motion::close_cycle(cycle);
    const motion::Clip gait = motion::symmetrize_gait(cycle, mirror);
    found_one = closed.cyclic && gait.cyclic;
  }

  CHECK(found_one);
}

TEST_CASE("contact and flight") {
  const motion::Clip clip = capture();
  const body::Character body = character();

  const auto points = motion::contact_points(body, {"left_foot_body", "right_foot_body"});
  const motion::Clip standing = motion::grounded(clip, points);
  const motion::Clip labelled = motion::label_contacts(standing, points);
  const motion::FlightConsistency flight = motion::check_flight(labelled, body);

  CHECK(labelled.contacts.sum() > 0);
  CHECK(flight.flight_s >= 0);
}
