// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "traceur/control/feedback_law.hpp"
#include "traceur/control/tracking_reference.hpp"
#include "traceur/sim/lanes.hpp"
#include "traceur/sim/parameters.hpp"

namespace traceur::control {

/// A closed-loop controller for one motion: open-loop PD targets, what the sensors should read along the way, and the
/// feedback law that acts on the difference. Plain data; everything needed to run it on another day.
struct Controller {
  std::string clip;
  std::string character;
  bool cyclic = false;
  double tick = 1.0 / 60;      ///< control interval, s
  int steps_per_tick = 8;
  sim::Parameters simulation;  ///< the constants it was learned with
  FeedbackShape shape;
  FeedbackLimits limits;
  Eigen::VectorXd law;          ///< shape.size() numbers
  Eigen::MatrixXd targets;      ///< nq x ticks; one period of a cyclic motion
  TrackingReference reference;  ///< the clip on the same ticks (ticks + 1 columns)
  Eigen::MatrixXd sensory;      ///< full_sensors x ticks: what the sensors read along the open-loop motion
  std::vector<int> stance;      ///< side of the stance foot at each tick, 0 right, 1 left
  std::vector<int> phase;       ///< index of the law at each tick
  Eigen::VectorXd start_pose, start_velocity;

  int ticks() const { return static_cast<int>(targets.cols()); }
};

/// The rigid motion in the ground plane that carries a cyclic reference from its first period to a later one.
struct CycleCarry {
  double turn = 0, x = 0, y = 0;  ///< rad, m, m

  /// Of `cycles` periods of the reference.
  static CycleCarry after(const TrackingReference& r, int cycles) {
    const double dpsi = r.heading[r.ticks] - r.heading[0];
    const double turn = std::remainder(dpsi, 2 * std::numbers::pi);
    CycleCarry c;
    const double ax = r.poses(0, 0), ay = r.poses(1, 0), bx = r.poses(0, r.ticks), by = r.poses(1, r.ticks);
    const CycleCarry one{turn, bx - (std::cos(turn) * ax - std::sin(turn) * ay), by - (std::sin(turn) * ax + std::cos(turn) * ay)};
    for (int i = 0; i < cycles; ++i) {
      const double nx = std::cos(one.turn) * c.x - std::sin(one.turn) * c.y + one.x;
      const double ny = std::sin(one.turn) * c.x + std::cos(one.turn) * c.y + one.y;
      c = {c.turn + one.turn, nx, ny};
    }
    return c;
  }
  core::Vector3<double> apply(const core::Vector3<double>& p) const {
    const core::Vector3<double> r = rotate(p);
    return {r.x + x, r.y + y, r.z};
  }
  core::Vector3<double> rotate(const core::Vector3<double>& v) const {
    return {std::cos(turn) * v.x - std::sin(turn) * v.y, std::sin(turn) * v.x + std::cos(turn) * v.y, v.z};
  }
};

/// Reads all sensors of all lanes against one tick of a reference carried on by `carry`: differences from the clip, seen in
/// the reference's heading frame, mirrored when the left foot is the stance foot. `out` gets full_sensors numbers.
template <class S>
[[gnu::always_inline]] inline void measure(const sim::Lanes<S>& lanes, const sim::Model& model, const Roles& roles,
                                           const TrackingReference& r, int t, const CycleCarry& carry, int stance, S* out) {
  using core::Quaternion;
  using core::Vector3;
  using T = core::Element<S>;
  const auto wide = [](const Vector3<double>& v) { return v.template cast<T>().template cast<S>(); };
  const auto& w = lanes.work();
  const double heading = carry.turn + r.heading[t];
  const S c(static_cast<T>(std::cos(heading))), s(static_cast<T>(std::sin(heading)));
  const bool left = stance == 1;
  const auto seen = [&](const Vector3<S>& v) { return Vector3<S>{c * v.x + s * v.y, c * v.y - s * v.x, v.z}; };
  const auto put = [&](int at, const Vector3<S>& v, bool axial) {
    const Vector3<S> h = seen(v);
    (left ? (axial ? mirrored_rotation(h) : mirrored_vector(h)) : h).store(out + at);
  };
  const Quaternion<double> turn = core::about_axis(Vector3<double>{0, 0, 1}, carry.turn);
  const Quaternion<double> root_ref = turn * Quaternion<double>::from(r.poses.col(t).data() + 3);
  put(0, log_map(Quaternion<S>::from(lanes.q() + 3) * root_ref.conjugate().template cast<T>().template cast<S>()), true);
  const Vector3<double> com_ref = carry.apply(Vector3<double>::from(r.center_of_mass.col(t).data()));
  put(3, w.center_of_mass - wide(com_ref), false);
  const S inverse_mass(static_cast<T>(1.0 / model.total_mass));
  put(6, inverse_mass * w.linear_momentum - wide(carry.rotate(Vector3<double>::from(r.center_velocity.col(t).data()))), false);
  for (int k = 0; k < 2; ++k) {
    const auto side = static_cast<std::size_t>(k == 0 ? stance : 1 - stance);
    const Vector3<double> ref = carry.apply(Vector3<double>::from(r.feet.col(t).data() + 3 * side)) - com_ref;
    const Vector3<S> now = w.bodies[static_cast<std::size_t>(roles.legs[side].foot)].position - w.center_of_mass;
    put(9 + 3 * k, now - wide(ref), false);
  }
  put(15, w.bodies[0].angular - wide(carry.rotate(Vector3<double>::from(r.velocities.col(t).data() + 3))), true);
}

/// Gives the lanes the targets of a tick, moved by an action (actions() numbers, as the law gave it). Actions are rotation
/// vectors in the parent's frame; the waist's is also given to every further trunk joint up to where the arms begin.
template <class S>
[[gnu::always_inline]] inline void apply_action(sim::Lanes<S>& lanes, const sim::Model& model, const Roles& roles, const FeedbackSets& sets,
                                                const double* target, int stance, const S* da) {
  using core::Quaternion;
  using core::Vector3;
  using T = core::Element<S>;
  const auto constant = [](double x) { return S(static_cast<T>(x)); };
  for (int i = 7; i < model.nq; ++i) lanes.target()[i] = constant(target[i]);
  const auto turn = [&](int b, const S* a) {
    if (b <= 0) return;
    const sim::MovingBody& m = model.bodies[static_cast<std::size_t>(b)];
    Vector3<S> d = Vector3<S>::from(a);
    if (stance == 1) d = mirrored_rotation(d);
    S* t = lanes.target() + m.q_index;
    if (m.type == body::JointType::ball) {
      (exp_map(d) * Quaternion<S>::from(t)).store(t);
    } else {
      t[0] += dot(d, m.axis.template cast<T>().template cast<S>());
    }
  };
  const auto st = static_cast<std::size_t>(stance), sw = static_cast<std::size_t>(1 - stance);
  turn(roles.legs[sw].hip, da);
  turn(roles.legs[st].hip, da + 3);
  turn(roles.waist, da + 6);
  for (const int b : roles.upper_trunk) turn(b, da + 6);
  if (sets.ankles) {
    turn(roles.legs[sw].foot, da + 9);
    turn(roles.legs[st].foot, da + 12);
  }
  if (sets.knees) {
    const S* a = da + (sets.ankles ? 15 : 9);
    lanes.target()[model.bodies[static_cast<std::size_t>(roles.legs[sw].knee)].q_index] += a[0];
    lanes.target()[model.bodies[static_cast<std::size_t>(roles.legs[st].knee)].q_index] += a[1];
  }
}

}  // namespace traceur::control
