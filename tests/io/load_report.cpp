// SPDX-License-Identifier: MIT
#include "traceur/io/load_report.hpp"

#include <doctest/doctest.h>


using namespace traceur;

namespace {

/// A hinged pair of bodies at two keys.
io::LoadedClip pair(double rise, double bend, double turn) {
  io::LoadedClip loaded;
  motion::Clip& clip = loaded.clip;
  clip.name = "pair";
  body::Joint root, arm;
  root.name = root.body = "root";
  root.type = body::JointType::free;
  arm.name = arm.body = "arm";
  arm.parent = 0;
  arm.type = body::JointType::hinge;
  clip.skeleton.add(root);
  clip.skeleton.add(arm);
  clip.times = Eigen::Vector2d(0, 1);
  clip.poses.resize(clip.skeleton.nq(), 2);
  clip.poses.col(0) = clip.poses.col(1) = clip.skeleton.neutral_pose();
  clip.poses(0, 1) = 1.5;  // travel is the cycle's own
  clip.poses(2, 1) += rise;
  core::about_axis(core::Vector3<double>{0, 0, 1}, turn).store(clip.poses.col(1).data() + 3);
  clip.poses(7, 1) = bend;
  return loaded;
}

}  // namespace

TEST_CASE("load_report: a closed cycle that travels and turns has no gap") {
  io::LoadedClip loaded = pair(0, 0, 0.5);
  io::make_cyclic(loaded);
  CHECK(loaded.clip.cyclic);
  CHECK(std::abs(loaded.report.cycle_gap) < 1e-12);
  CHECK(loaded.report.cycle_gap_angle < 1e-9);
  CHECK(loaded.report.notes.empty());
}

TEST_CASE("load_report: gaps are the last key less the first, and large ones are noted") {
  io::LoadedClip loaded = pair(-0.03, 0.25, 0);
  io::make_cyclic(loaded);
  CHECK(loaded.report.cycle_gap == doctest::Approx(-0.03));
  CHECK(loaded.report.cycle_gap_angle == doctest::Approx(0.25));
  REQUIRE(loaded.report.notes.size() == 1);
  CHECK(loaded.report.notes[0].find("0.03 m") != std::string::npos);
  CHECK(loaded.report.notes[0].find("0.25 rad") != std::string::npos);
}

TEST_CASE("load_report: the text states unit, axis, order, rate and every note") {
  io::LoadReport report;
  report.source = "a.bvh";
  report.format = "BVH";
  report.unit = 0.01;
  report.unit_reason = "standing height";
  report.up = "y";
  report.up_reason = "rest pose";
  report.rotation_order = "ZXY";
  report.fps = 30;
  report.fps_reason = "frame time";
  report.notes = {"first note", "second note"};
  const std::string without = report.text();
  for (const char* part : {"a.bvh: BVH", "unit 0.01 m (standing height)", "up y (rest pose)", "rotations ZXY", "30 frames/s (frame time)",
                           "note: first note", "note: second note"})
    CHECK_MESSAGE(without.find(part) != std::string::npos, part);
  CHECK(without.find("standing height about") == std::string::npos);
  report.standing_height = 1.7;
  CHECK(report.text().find("standing height about 1.7 m") != std::string::npos);
}
