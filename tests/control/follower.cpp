// SPDX-License-Identifier: MIT
#include <traceur/control/follower.hpp>

#include <doctest/doctest.h>

#include <cmath>

#include "moving_gait.hpp"

using namespace figures;
using control::full_sensors;

namespace {

/// Lanes in states a little off a controller's tick, carried by some rigid motion in the plane.
template <class S>
void scatter(sim::Lanes<S>& lanes, const Figure& f, const control::Controller& c, int t, double turn, double x, double y) {
  core::RandomStream random(5, static_cast<std::uint64_t>(t));
  const control::CycleCarry carry{turn, x, y};
  for (int l = 0; l < core::lane_count<S>; ++l) {
    Eigen::VectorXd d(f.model.nv), q(f.model.nq), v = c.reference.velocities.col(t);
    for (double& k : d) k = 0.1 * random.uniform(-1.0, 1.0);
    body::displace(f.skeleton(), c.reference.poses.col(t).data(), d.data(), q.data());
    v += 0.3 * any_velocity(f, random);
    carry.apply(Vector::from(q.data())).store(q.data());
    (about_axis(Vector{0, 0, 1}, turn) * Quaternion::from(q.data() + 3)).store(q.data() + 3);
    carry.rotate(Vector::from(v.data())).store(v.data());
    carry.rotate(Vector::from(v.data() + 3)).store(v.data() + 3);
    put(lanes, l, q, v);
  }
  lanes.refresh();
}

/// What the plain way of a controller without a table gives, and the follower.
template <class S>
void same_as_plain(const Figure& f, double tolerance) {
  const control::FeedbackShape shape{{true, true, true}, 3, 1};
  const int ticks = 12;
  const control::Controller c = any_controller(f, ticks, true, 3.0, 3, shape);
  const control::Skill gait{control::MotionTable(f.model, f.roles, c, {1.0}), {shape, 2}, c.limits};
  const Eigen::VectorXd numbers = gait.shape.neutral(c.law);
  const sim::Parameters parameters;
  const sim::Ground<core::Element<S>> ground;
  sim::Lanes<S> lanes(f.model, parameters, ground), plain(f.model, parameters, ground);
  control::Follower<S> follower(f.model, f.roles, shape, c.limits);
  for (const int t : {0, 3, 7, 11}) {
    const double turn = 0.7 - 0.1 * t, x = 1 + t, y = -2;
    scatter(lanes, f, c, t, turn, x, y);
    scatter(plain, f, c, t, turn, x, y);
    // Where the table's frame is when the reference is carried so: its origin is the first centre of mass, moved on with the
    // gait.
    const control::CycleCarry carry{turn, x, y};
    const Vector origin = carry.apply(gait.table.start_center() + Vector{gait.table.speed() * t * c.tick, 0, 0});
    control::SkillPlayer player;
    player.know(f.model);
    player.start(gait, numbers.data(), {turn, origin.x, origin.y, 0}, t);
    player.steer(gait.table.speed(), 0);
    for (int l = 0; l < core::lane_count<S>; ++l) follower.set(l, player);

    std::array<S, full_sensors> raw, ds;
    std::array<S, control::full_actions> da;
    const auto k = static_cast<std::size_t>(t);
    control::measure(plain, f.model, f.roles, c.reference, t, carry, c.stance[k], raw.data());
    std::vector<S> law(static_cast<std::size_t>(shape.size()));
    for (int i = 0; i < shape.size(); ++i) law[static_cast<std::size_t>(i)] = S(static_cast<core::Element<S>>(c.law[i]));
    for (int i = 0; i < full_sensors; ++i)
      raw[static_cast<std::size_t>(i)] -= S(static_cast<core::Element<S>>(c.sensory(i, t)));
    control::feedback(shape, c.limits, law.data(), raw.data(), da.data());
    control::apply_action(plain, f.model, f.roles, shape.sets, c.targets.col(t).data(), c.stance[k], da.data());
    follower.act(lanes, ds.data());
    for (int l = 0; l < core::lane_count<S>; ++l) {
      for (int i = 0; i < full_sensors; ++i) {
        CAPTURE(t);
        CAPTURE(i);
        CHECK(std::abs(core::lane_of(ds[static_cast<std::size_t>(i)], l) - core::lane_of(raw[static_cast<std::size_t>(i)], l)) < tolerance);
      }
      for (const sim::MovingBody& b : f.model.bodies) {
        const auto at = [&](sim::Lanes<S>& w, int i) { return static_cast<double>(core::lane_of(w.target()[b.q_index + i], l)); };
        if (b.type == body::JointType::hinge) CHECK(std::abs(at(lanes, 0) - at(plain, 0)) < tolerance);
        if (b.type == body::JointType::ball)
          CHECK(apart(Quaternion{at(lanes, 0), at(lanes, 1), at(lanes, 2), at(lanes, 3)},
                      Quaternion{at(plain, 0), at(plain, 1), at(plain, 2), at(plain, 3)}) < tolerance);
      }
    }
  }
}

}  // namespace

TEST_CASE("following a table is following the controller it was made of") {
  same_as_plain<double>(humanoid(), 2e-5);
  same_as_plain<core::Pack<float, 4>>(humanoid(), 2e-4);
  same_as_plain<double>(small(), 2e-5);
}

TEST_CASE("offsets are added to the law's action, seen from the stance foot") {
  const Figure& f = humanoid();
  const control::FeedbackShape shape{{true, false, true, true}, 3, 1};
  const control::Controller c = any_controller(f, 12, true, 3.0, 3, shape);
  const control::Skill gait{control::MotionTable(f.model, f.roles, c, {1.0}), {shape, 2}, c.limits};
  const Eigen::VectorXd neutral = gait.shape.neutral(Eigen::VectorXd::Zero(shape.size()));
  const sim::Parameters parameters;
  const sim::Ground<double> ground;
  sim::Lanes<double> lanes(f.model, parameters, ground);
  control::Follower<double> follower(f.model, f.roles, shape, c.limits);
  for (const int t : {2, 8}) {
    scatter(lanes, f, c, t, 0.4, 0, 0);
    const auto targets = [&](const Eigen::VectorXd& numbers) {
      control::SkillPlayer player;
      player.know(f.model);
      player.start(gait, numbers.data(), {}, t);
      follower.forget(0);
      follower.set(0, player);
      follower.act(lanes);
      return Eigen::VectorXd(Eigen::Map<const Eigen::VectorXd>(lanes.target(), f.model.nq));
    };
    const bool left = t >= 6;
    Eigen::VectorXd numbers = neutral;
    const int at = gait.shape.offset(left ? 1 : 0);
    numbers[at] = 0.2;       // swing hip, about the forward axis
    numbers[at + 16] = 0.3;  // stance knee
    const Eigen::VectorXd before = targets(neutral), after = targets(numbers);
    const auto joint = [&](const char* name) { return f.skeleton()[f.skeleton().find(name)].q_index; };
    const char* swing = left ? "right_hip" : "left_hip";
    const char* stance = left ? "left_knee" : "right_knee";
    // In the mirror a rotation about the forward axis goes the other way, a knee bends as it did.
    CHECK(apart(Quaternion::from(after.data() + joint(swing)),
                about_axis(Vector{1, 0, 0}, left ? -0.2 : 0.2) * Quaternion::from(before.data() + joint(swing))) < 1e-6);
    CHECK(after[joint(stance)] - before[joint(stance)] == doctest::Approx(0.3));
    Eigen::VectorXd rest = after - before;
    rest.segment(joint(swing), 4).setZero();
    rest[joint(stance)] = 0;
    CHECK(rest.cwiseAbs().maxCoeff() < 1e-12);
  }
}
