// SPDX-License-Identifier: MIT
#include <traceur/motion/loop.hpp>

#include <doctest/doctest.h>

#include "figure.hpp"

using namespace traceur;
using namespace figure;
using motion::Clip;
using motion::Mirror;

namespace {

/// Adds a disturbance that grows along the clip and is not the same on both sides.
Clip drifted(Clip clip, double size) {
  std::mt19937_64 rng(81);
  Vec drift(clip.skeleton.nv());
  for (Eigen::Index i = 0; i < drift.size(); ++i) drift[i] = uniform(rng, -size, size);
  for (int k = 0; k < clip.keys(); ++k) {
    const Vec d = clip.times[k] / clip.duration() * drift;
    body::displace(clip.skeleton, clip.poses.col(k).data(), d.data(), clip.poses.col(k).data());
  }
  clip.name = "drifted";
  return clip;
}

Vec carried_start(const Clip& clip) {
  Vec q = clip.poses.col(0);
  clip.carry_root(1, q);
  return q;
}

}  // namespace

TEST_CASE("a closed cycle ends where the next begins; travel, heading and the undisturbed part stay") {
  Gait g;
  g.turn = 0.5;
  const Clip open = drifted(gait(g, g.period, 49), 0.2);
  const Clip closed = motion::close_cycle(open, 0.6);
  CHECK_NOTHROW(closed.check());
  CHECK(closed.cyclic);
  CHECK(distance(open.skeleton, closed.poses.col(48), carried_start(closed)) < 1e-12);
  CHECK((closed.poses.col(48).head(2) - open.poses.col(48).head(2)).norm() < 1e-12);
  const auto heading = [](const Clip& c, int k) { return core::heading(Quaternion<double>::from(c.poses.col(k).data() + 3)); };
  CHECK(norm(log_map(heading(closed, 48) * heading(open, 48).conjugate())) < 1e-9);
  for (int k = 0; k < 49; ++k)
    if (open.times[k] <= 0.4 * g.period) CHECK(distance(open.skeleton, closed.poses.col(k), open.poses.col(k)) < 1e-12);
  CHECK(distance(open.skeleton, closed.sample(5.5 * g.period - 1e-6), closed.sample(5.5 * g.period + 1e-6)) < 1e-4);
  // No step of the correction is larger than a smoothstep's steepest slope allows.
  const double misfit = distance(open.skeleton, open.poses.col(48), carried_start(open));
  for (int k = 0; k < 48; ++k) {
    const double before = distance(open.skeleton, closed.poses.col(k), open.poses.col(k));
    const double after = distance(open.skeleton, closed.poses.col(k + 1), open.poses.col(k + 1));
    CHECK(std::abs(after - before) < 1.1 * 1.5 * misfit / (0.6 * 48));
  }
  const Clip good = gait(g, g.period, 49);
  CHECK(largest_gap(motion::close_cycle(good), good) < 1e-7);
  CHECK(fails_with([&] { motion::close_cycle(open, 0); }, "clip 'drifted': close_cycle"));
}

TEST_CASE("a straightened cycle repeats without turning and is as long") {
  Gait g;
  g.turn = 0.5;
  const Clip turning = motion::close_cycle(gait(g, g.period, 49)), straight = motion::straighten_cycle(turning);
  CHECK_NOTHROW(straight.check());
  const Vec next = carried_start(straight);
  CHECK(distance(straight.skeleton, straight.poses.col(48), next) < 1e-9);
  CHECK((next.tail(next.size() - 2) - straight.poses.col(0).tail(next.size() - 2)).cwiseAbs().maxCoeff() < 1e-9);
  CHECK((next.head(2) - straight.poses.col(0).head(2)).norm() > 0.1);
  for (int k = 1; k < 49; ++k) {
    const auto step = [&](const Clip& c) { return (c.poses.col(k) - c.poses.col(k - 1)).head(2).norm(); };
    CHECK(step(straight) == doctest::Approx(step(turning)).epsilon(1e-12));
    CHECK((straight.poses.col(k) - turning.poses.col(k)).tail(straight.skeleton.nq() - 7).norm() == 0);
  }
  Clip open = turning;
  open.cyclic = false;
  CHECK(fails_with([&] { motion::straighten_cycle(open); }, "straighten_cycle: expected a cyclic clip"));
}

TEST_CASE("a symmetrized gait mirrors itself half a cycle later") {
  const Mirror mirror(biped());
  Gait g;
  g.heading = 0.9;
  g.turn = 0.1;
  const Clip open = drifted(gait(g, g.period, 49), 0.15);
  for (const auto half : {motion::GaitHalf::mean, motion::GaitHalf::first, motion::GaitHalf::second}) {
    const Clip out = motion::symmetrize_gait(open, mirror, half);
    CHECK_NOTHROW(out.check());
    CHECK(out.cyclic);
    CHECK(out.duration() == doctest::Approx(g.period));
    CHECK(std::abs(out.poses(0, 0)) < 1e-12);
    const Vec end = out.poses.col(out.keys() - 1);
    CHECK(end[1] == doctest::Approx(out.poses(1, 0)).epsilon(1e-9).scale(1.0));
    CHECK(distance(out.skeleton, end, carried_start(out)) < 1e-9);
    const double advance = 0.5 * (end[0] - out.poses(0, 0));
    for (double phi = 0.01; phi < 2.5; phi += 0.05) {
      Vec image = mirror.pose(out.sample(phi));
      image[0] += advance;
      CHECK(distance(out.skeleton, out.sample(phi + 0.5 * g.period), image) < 1e-8);
    }
    // It is still about the motion it came from.
    CHECK(end[0] == doctest::Approx(g.speed * g.period).epsilon(0.1));
  }
}

TEST_CASE("a gait that is symmetric already is only straightened") {
  const Mirror mirror(biped());
  Gait g;
  const Clip clip = gait(g, g.period, 49);
  for (const auto half : {motion::GaitHalf::mean, motion::GaitHalf::first, motion::GaitHalf::second}) {
    const Clip out = motion::symmetrize_gait(clip, mirror, half);
    for (int k = 0; k < 49; ++k) CHECK(distance(clip.skeleton, out.sample(clip.times[k]), clip.poses.col(k)) < 1e-9);
  }
  Gait turned = g;
  turned.heading = -2;
  CHECK(largest_gap(motion::symmetrize_gait(gait(turned, g.period, 49), mirror), clip) < 1e-9);
}

TEST_CASE("the period of a longer capture is found, turning or not, at any rate of keys") {
  for (const double turn : {0.0, 0.4})
    for (const double period : {0.8, 1.15, 1.6}) {
      Gait g;
      g.period = period;
      g.turn = turn;
      g.lead = 0.7;
      const Clip capture = gait(g, 4.7, 4 * 47 + 1);
      const auto found = motion::find_cycle(capture);
      REQUIRE(found.has_value());
      CAPTURE(period);
      CHECK(found->end - found->start == doctest::Approx(period).epsilon(0.02));
      CHECK(found->misfit.position_m < 0.02);
      CHECK(found->misfit.tilt_rad < 0.02);
      const Clip cycle = motion::cut(capture, found->start, found->end);
      CHECK(motion::is_cyclic_candidate(cycle));
      CHECK(!motion::is_cyclic_candidate(motion::cut(capture, found->start, found->start + 0.6 * period)));
    }
}

TEST_CASE("the interval avoids the part of a capture that is off, and standing still is no cycle") {
  Gait g;
  Clip capture = gait(g, 4.0, 241);
  std::mt19937_64 rng(82);
  // Disturbs the first 2.5 s; only the rest holds a clean cycle.
  for (int k = 0; k < 150; ++k) {
    Vec d(capture.skeleton.nv());
    for (Eigen::Index i = 0; i < d.size(); ++i) d[i] = 0.25 * std::sin(2 * pi * (0.37 + 0.11 * static_cast<double>(i)) * capture.times[k]) * (150 - k) / 150;
    body::displace(capture.skeleton, capture.poses.col(k).data(), d.data(), capture.poses.col(k).data());
  }
  const auto found = motion::find_cycle(capture);
  REQUIRE(found.has_value());
  CHECK(found->start > 2.2);
  CHECK(found->end - found->start == doctest::Approx(g.period).epsilon(0.02));

  Clip still = capture;
  for (int k = 0; k < still.keys(); ++k) still.poses.col(k) = capture.poses.col(0);
  CHECK(!motion::find_cycle(still).has_value());
  CHECK(!motion::find_cycle(gait(g, 0.3, 20)).has_value());
  motion::CycleSearch wrong;
  wrong.longest = 0.1;
  CHECK(fails_with([&] { motion::find_cycle(capture, wrong); }, "clip 'gait': find_cycle"));
}

TEST_CASE("the misfit says what is off, and by how much") {
  Gait g;
  Clip clip = gait(g, g.period, 49);
  CHECK(motion::cycle_misfit(clip, 0, g.period).position_m < 1e-9);
  const int last = 48, knee = clip.skeleton[clip.skeleton.find("left_knee")].q_index;
  clip.poses(knee, last) += 0.2;
  clip.poses(2, last) += 0.03;
  const auto m = motion::cycle_misfit(clip, 0, g.period);
  CHECK(m.joint_rad == doctest::Approx(0.2));
  CHECK(m.height_m == doctest::Approx(0.03));
  CHECK(m.tilt_rad < 1e-9);
  // The knee moves the foot 0.4 m below it by a chord of 0.2 rad, and the root lifts it.
  CHECK(m.position_m > 0.4 * 2 * std::sin(0.1) - 0.03);
  CHECK(m.position_m < 0.4 * 2 * std::sin(0.1) + 0.03);
  CHECK(fails_with([&] { motion::cycle_misfit(clip, 0.5, 0.2); }, "clip 'gait': cycle_misfit"));
}
