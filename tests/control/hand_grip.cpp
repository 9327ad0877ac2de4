// SPDX-License-Identifier: MIT
#include <traceur/control/hand_grip.hpp>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace figures;
using S = core::Pack<float, 4>;

TEST_CASE("hands are the ends of the arms") {
  const Figure& f = humanoid();
  const auto hands = control::find_hands(f.model);
  const Eigen::VectorXd q = f.skeleton().neutral_pose();
  body::Frames<double> frames(f.skeleton());
  body::forward_kinematics(f.skeleton(), q.data(), frames);
  const Vector right = frames.point(hands[0].joint, hands[0].point), left = frames.point(hands[1].joint, hands[1].point);
  CHECK(right.y == doctest::Approx(-left.y));
  CHECK(right.y < -0.15);
  CHECK(right.z == doctest::Approx(left.z));
  // Farther from the shoulder than the elbow is.
  CHECK(apart(right, place_of(f, q, "right_shoulder")) > apart(place_of(f, q, "right_elbow"), place_of(f, q, "right_shoulder")) + 0.1);
}

namespace {

/// The humanoid at rest, its right hand the lanes' only grip, and a wall to the right, 5 mm closer than the hand is wide; no weight.
struct BesideWall {
  const Figure& f = humanoid();
  const sim::Parameters parameters;
  const Eigen::VectorXd q = f.skeleton().neutral_pose(), v = at_rest(f);
  const sim::GripPoint hand = control::find_hands(f.model)[0];
  const int body = f.model.moving_of_joint[static_cast<std::size_t>(hand.joint)];
  const sim::Ground<float> wall = sim::Ground<float>::plane({0, 1, 0}, hand_place().y - 0.035);
  sim::Lanes<S> lanes{f.model, parameters, wall, extras()};

  BesideWall() {
    for (int l = 0; l < 4; ++l) lanes.set_gravity(l, 0);
  }
  void put_all(const Eigen::VectorXd& pose, int steps) {
    for (int l = 0; l < 4; ++l) put(lanes, l, pose, v);
    lanes.refresh();
    lanes.step(steps);
  }
  /// The body's middle is on one side of the hand: behind it for who travels to the other.
  Vector towards() const {
    return {core::lane_of(lanes.work().center_of_mass.x, 0) > core::lane_of(lanes.grip_place(0).x, 0) ? -1.0 : 1.0, 0, 0};
  }

private:
  Vector hand_place() const {
    body::Frames<double> frames(f.skeleton());
    body::forward_kinematics(f.skeleton(), q.data(), frames);
    return frames.point(hand.joint, hand.point);
  }
  sim::Extras extras() const {
    sim::Extras e;
    e.grips = {hand};
    return e;
  }
};

}  // namespace

TEST_CASE("a hand takes hold where it first touches, keeps its place, and lets go for good once the body has passed") {
  BesideWall s;
  sim::Lanes<S>& lanes = s.lanes;
  control::HandGrip grip(0, s.body);

  // Away from the wall nothing is touched.
  Eigen::VectorXd away = s.q;
  away[1] += 1;
  s.put_all(away, 8);
  CHECK_FALSE(grip.update(lanes, 0, {1, 0, 0}));
  CHECK_FALSE(grip.holds());

  s.put_all(s.q, 1);
  const Vector towards = s.towards();
  REQUIRE(grip.update(lanes, 0, towards));
  const Vector anchor = grip.anchor();
  for (int t = 0; t < 12; ++t) {
    lanes.step(8);
    CHECK(grip.update(lanes, 0, towards));
  }
  const auto now = lanes.grip_place(0);
  CHECK(apart(anchor, Vector{core::lane_of(now.x, 0), core::lane_of(now.y, 0), core::lane_of(now.z, 0)}) < 0.01);
  CHECK(lanes.holds(0, 0));
  CHECK_FALSE(lanes.holds(1, 0));
  // Seen the other way the centre of mass has passed.
  CHECK_FALSE(grip.update(lanes, 0, -1.0 * towards));
  CHECK(grip.done());
  CHECK_FALSE(lanes.holds(0, 0));
  lanes.step(8);
  CHECK_FALSE(grip.update(lanes, 0, towards));
  grip.restart();
  CHECK_FALSE(grip.done());
}

TEST_CASE("without a memory of its own a hand holds on while the body is behind it and it may") {
  BesideWall s;
  sim::Lanes<S>& lanes = s.lanes;
  const int body = s.body;
  s.put_all(s.q, 1);
  const Vector towards = s.towards();
  CHECK_FALSE(control::hold_until_passed(lanes, 0, 0, body, towards, false));
  CHECK_FALSE(lanes.holds(0, 0));
  CHECK(control::hold_until_passed(lanes, 0, 0, body, towards, true));
  CHECK(lanes.holds(0, 0));
  CHECK_FALSE(lanes.holds(1, 0));
  CHECK(control::hold_until_passed(lanes, 0, 0, body, towards, true));
  // Seen the other way the centre of mass has passed: it lets go, and does not take hold again.
  CHECK_FALSE(control::hold_until_passed(lanes, 0, 0, body, -1.0 * towards, true));
  CHECK_FALSE(lanes.holds(0, 0));
  CHECK_FALSE(control::hold_until_passed(lanes, 0, 0, body, -1.0 * towards, true));
  // What may not hold on any more lets go.
  REQUIRE(control::hold_until_passed(lanes, 1, 0, body, towards, true));
  CHECK_FALSE(control::hold_until_passed(lanes, 1, 0, body, towards, false));
  CHECK_FALSE(lanes.holds(1, 0));
}
