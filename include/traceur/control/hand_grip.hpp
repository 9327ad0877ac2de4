// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cmath>

#include "traceur/sim/lanes.hpp"

namespace traceur::control {

/// The ends of a character's arms, right and left: what is farthest out to each side above the root in the rest pose, and the
/// middle of its shape there. Throws Error where a side has none.
inline std::array<sim::GripPoint, 2> find_hands(const sim::Model& model) {
  const body::Skeleton& sk = model.character.skeleton;
  const Eigen::VectorXd q = sk.neutral_pose();
  body::Frames<double> frames(sk);
  body::forward_kinematics(sk, q.data(), frames);
  const core::Vector3<double> root = frames.position[0];
  std::array<sim::GripPoint, 2> hands;
  std::array<int, 2> longest{0, 0};
  const auto depth = [&](int j) {
    int n = 0;
    for (; j > 0; j = sk[j].parent) ++n;
    return n;
  };
  for (const body::Shape& s : model.character.shapes) {
    const core::Vector3<double> at = frames.point(s.body, s.position);
    const double out = at.y - root.y;
    // Legs end below the root's children, arms above; the head is in the middle.
    int top = s.body;
    while (top > 0 && sk[top].parent > 0) top = sk[top].parent;
    const bool arm = frames.position[static_cast<std::size_t>(top)].z > root.z && std::abs(out) > 0.05;
    if (!arm) continue;
    const std::size_t side = out > 0 ? 1 : 0;
    if (depth(s.body) <= longest[side]) continue;
    longest[side] = depth(s.body);
    hands[side] = {s.body, s.position, -1};
  }
  for (const int n : longest)
    if (n == 0) throw Error("character '" + model.character.name + "': expected an arm on each side");
  return hands;
}

/// One tick of a supporting hand that needs no memory but the grip's own: while the centre of mass is behind the hand along
/// `forward` (unit, world), a hand on moving body `body` takes hold where it touches with more than `least_force` N; it lets go
/// when the centre of mass has passed, or where it is not `allowed` to hold. Returns whether it holds.
template <class S>
bool hold_until_passed(sim::Lanes<S>& lanes, int lane, int grip, int body, const core::Vector3<double>& forward, bool allowed,
                       double least_force = 1) noexcept {
  using T = core::Element<S>;
  if (!allowed && !lanes.holds(lane, grip)) return false;
  const auto of = [&](const core::Vector3<S>& v) {
    return core::Vector3<T>{core::lane_of(v.x, lane), core::lane_of(v.y, lane), core::lane_of(v.z, lane)};
  };
  const core::Vector3<T> hand = of(lanes.grip_place(grip));
  const bool behind = dot((of(lanes.work().center_of_mass) - hand).template cast<double>(), forward) < 0;
  if (lanes.holds(lane, grip)) {
    if (behind && allowed) return true;
    lanes.release(lane, grip);
    return false;
  }
  if (!behind || !(norm(of(lanes.body_force()[static_cast<std::size_t>(body)])) > static_cast<T>(least_force))) return false;
  lanes.hold(lane, grip, hand, static_cast<T>(1e18));
  return true;
}

/// The supporting hand of a vault: it holds on to the obstacle, as by a ball-and-socket joint, from its first touch until the
/// centre of mass has passed it, and not again (Terrain Runner, s4.2.1: a sphere for a hand cannot grasp). One for each lane.
class HandGrip {
public:
  /// `grip`: index in the lanes' Extras::grips; `body`: the moving body that the hand is on; a touch is a contact force of
  /// more than `least_force` N.
  HandGrip(int grip, int body, double least_force = 1) : grip_(grip), body_(body), least_force_(least_force) {}

  bool holds() const noexcept { return held_ && !done_; }
  /// Whether it has let go.
  bool done() const noexcept { return done_; }
  void restart() noexcept { held_ = done_ = false; }

  /// After every control tick; `forward` is the direction of travel (unit, world). Returns whether the hand holds now.
  template <class S>
  bool update(sim::Lanes<S>& lanes, int lane, const core::Vector3<double>& forward) noexcept {
    using T = core::Element<S>;
    if (done_) return false;
    const auto of = [&](const core::Vector3<S>& v) {
      return core::Vector3<T>{core::lane_of(v.x, lane), core::lane_of(v.y, lane), core::lane_of(v.z, lane)};
    };
    if (!held_) {
      if (!(norm(of(lanes.body_force()[static_cast<std::size_t>(body_)])) > static_cast<T>(least_force_))) return false;
      const core::Vector3<T> at = of(lanes.grip_place(grip_));
      anchor_ = at.template cast<double>();
      lanes.hold(lane, grip_, at, static_cast<T>(1e18));
      held_ = true;
    }
    if (dot(of(lanes.work().center_of_mass).template cast<double>() - anchor_, forward) <= 0) return true;
    lanes.release(lane, grip_);
    done_ = true;
    return false;
  }
  /// Where it took hold, m, world.
  const core::Vector3<double>& anchor() const noexcept { return anchor_; }

private:
  int grip_, body_;
  double least_force_;
  core::Vector3<double> anchor_{0, 0, 0};
  bool held_ = false, done_ = false;
};

}  // namespace traceur::control
