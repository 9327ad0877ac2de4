// SPDX-License-Identifier: MIT
#include <traceur/motion/keyframes.hpp>

#include <doctest/doctest.h>

#include <cmath>

using namespace traceur;
using core::Quaternion;
using core::Vector3;

namespace {

/// A free root with an arm of two links of 0.4 and 0.3 m, shoulder a ball and elbow a hinge about y.
body::Skeleton arm() {
  body::Joint root, shoulder, elbow;
  root.name = root.body = "root";
  root.type = body::JointType::free;
  shoulder.name = shoulder.body = "shoulder";
  shoulder.type = body::JointType::ball;
  shoulder.parent = 0;
  elbow.name = elbow.body = "elbow";
  elbow.type = body::JointType::hinge;
  elbow.parent = 1;
  elbow.offset = {0.4, 0, 0};
  elbow.axis = {0, 1, 0};
  body::Skeleton s;
  for (const body::Joint& j : {root, shoulder, elbow}) s.add(j);
  return s;
}
const Vector3<double> hand{0.3, 0, 0};

Eigen::VectorXd pose(double x, double turn, double bend) {
  const body::Skeleton s = arm();
  Eigen::VectorXd q = s.neutral_pose();
  q[0] = x;
  core::about_axis(Vector3<double>{0, 0, 1}, turn).store(q.data() + s[1].q_index);
  q[s[2].q_index] = bend;
  return q;
}

Vector3<double> hand_of(const Eigen::VectorXd& q) {
  const body::Skeleton s = arm();
  body::Frames<double> frames(s);
  body::forward_kinematics(s, q.data(), frames);
  return frames.point(2, hand);
}

}  // namespace

TEST_CASE("a point that can be reached is put where it is pinned") {
  const body::Skeleton s = arm();
  for (const Vector3<double> target : {Vector3<double>{0.5, 0.2, 0.1}, Vector3<double>{-0.3, 0.3, -0.2}, Vector3<double>{1.0, 1.0, 1.0}}) {
    const motion::Keyframe key{0, pose(0, 0.2, 0.5), {{2, hand, target, 1}}};
    const Eigen::VectorXd q = motion::solve_pins(s, key, {1e-6, 200, 1e-10});
    CHECK(norm(hand_of(q) - target) < 1e-4);
    CHECK_NOTHROW(body::check_pose(s, q, "solved"));
  }
}

TEST_CASE("a pose whose points are in place, or that has none, stays as it is") {
  const body::Skeleton s = arm();
  const Eigen::VectorXd q = pose(0.1, 0.4, 0.7);
  CHECK(motion::solve_pins(s, {0, q, {}}) == q);
  CHECK((motion::solve_pins(s, {0, q, {{2, hand, hand_of(q), 1}}}) - q).norm() < 1e-9);
}

TEST_CASE("a pinned point moves no more than staying allows, by the balance of both costs") {
  // Only the root's place can follow a pin at the root: w (x - t)^2 + s x^2 is least at x = w t / (w + s).
  const body::Skeleton s = arm();
  const Eigen::VectorXd q = motion::solve_pins(s, {0, pose(0, 0, 0), {{0, {0, 0, 0}, {0.2, 0, 0}, 3}}}, {1, 100, 1e-12});
  CHECK(q[0] == doctest::Approx(0.2 * 3 / (3 + 1.0)).epsilon(1e-6));
}

TEST_CASE("pins that cannot all be met are met half way") {
  const body::Skeleton s = arm();
  const motion::Keyframe key{0, pose(0, 0, 0), {{0, {0, 0, 0}, {0, 0, 1}, 1}, {0, {0, 0, 0}, {0, 0, -1}, 1}}};
  CHECK(std::abs(motion::solve_pins(s, key)[2]) < 1e-6);
}

TEST_CASE("a clip passes through its keys, begins and ends at rest, and has no jump in velocity") {
  const body::Skeleton s = arm();
  const std::vector<motion::Keyframe> keys{
      {0, pose(0, 0, 0.2), {}}, {0.25, pose(0.3, 0.5, 0.9), {}}, {0.75, pose(0.5, -0.4, 0.1), {}}, {1, pose(0.6, 0, 0.2), {}}};
  const motion::Clip clip = motion::from_keyframes("wave", s, keys, 120);
  CHECK(clip.duration() == doctest::Approx(1));
  CHECK(clip.keys() == 121);
  for (const motion::Keyframe& k : keys) CHECK((clip.sample(k.time) - k.pose).norm() < 1e-9);
  const auto speed = [&](int f) { return ((clip.poses.col(f + 1) - clip.poses.col(f)) * 120).eval(); };
  // Half a frame from rest there is speed, in proportion to the frame.
  const motion::Clip fine = motion::from_keyframes("wave", s, keys, 1200);
  const auto fine_speed = [&](int f) { return ((fine.poses.col(f + 1) - fine.poses.col(f)) * 1200).norm(); };
  CHECK(speed(0).norm() < 0.6);
  CHECK(fine_speed(0) < 0.11 * speed(0).norm());
  CHECK(fine_speed(1199) < 0.11 * speed(119).norm() + 1e-9);
  for (int f = 1; f < 119; ++f) CHECK((speed(f + 1) - speed(f)).norm() < 0.6);
}

TEST_CASE("keys on a parabola give the parabola") {
  const body::Skeleton s = arm();
  std::vector<motion::Keyframe> keys;
  for (const double t : {0.0, 0.2, 0.5, 0.7, 1.0}) keys.push_back({t, pose(3 * t * t - t, 0, 0), {}});
  const motion::Clip clip = motion::from_keyframes("parabola", s, keys, 100);
  for (double t = 0.2; t <= 0.7; t += 0.01) CHECK(clip.sample(t)[0] == doctest::Approx(3 * t * t - t).epsilon(1e-6).scale(1));
}

TEST_CASE("what is no motion is refused") {
  const body::Skeleton s = arm();
  const Eigen::VectorXd q = pose(0, 0, 0);
  CHECK_THROWS_WITH(motion::from_keyframes("a", s, {{0, q, {}}}), "keyframes 'a': expected at least two keys, found 1");
  CHECK_THROWS_WITH(motion::from_keyframes("a", s, {{0.5, q, {}}, {1, q, {}}}), "keyframes 'a', key 0: expected time 0");
  CHECK_THROWS_WITH(motion::from_keyframes("a", s, {{0, q, {}}, {0, q, {}}}), "keyframes 'a', key 1: expected a time after the key before, by a millisecond or more");
  CHECK_THROWS_WITH(motion::from_keyframes("a", s, {{0, q, {}}, {1e8, q, {}}}),
                    "keyframes 'a': expected at most 1000000 frames, found 100000000.000000 s of 60.000000 a second");
  CHECK_THROWS_WITH(motion::from_keyframes("a", s, {{0, q, {}}, {1, q, {{7, hand, hand, 1}}}}),
                    "keyframes 'a', key 1: expected a joint of the skeleton in a pin");
  CHECK_THROWS_WITH(motion::from_keyframes("a", s, {{0, q, {}}, {1, q, {{2, hand, {NAN, 0, 0}, 1}}}}),
                    "keyframes 'a', key 1: expected finite numbers in a pin");
}
