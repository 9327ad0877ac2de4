// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "traceur/control/skill_player.hpp"
#include "traceur/sim/lanes.hpp"

namespace traceur::control {

/// Makes the lanes of a pack follow their players: senses all lanes at once against each lane's own reference moment,
/// evaluates each lane's own affine law, da = M ds + a_hat (Terrain Runner, Eq. 3), and sets the motors' targets. Every lane
/// may be in another skill, phase and frame, as long as all laws have the same sets and rank.
template <class S>
class Follower {
public:
  using T = core::Element<S>;
  static constexpr int width = core::lane_count<S>;

  /// The model must outlive it.
  Follower(const sim::Model& model, const Roles& roles, const FeedbackShape& shape, const FeedbackLimits& limits = {})
      : model_(&model), roles_(roles), shape_(shape), limits_(limits), layout_{model.nq - 7} {
    const auto size = [](int n) { return static_cast<std::size_t>(n); };
    moment_.assign(size(layout_.size()), S(T(0)));
    law_.assign(size(shape.phase_size()), S(T(0)));
    offset_.assign(size(shape.sets.actions()), S(T(0)));
    scratch_.assign(size(layout_.size()), 0.0f);
    laws_.fill(nullptr);
    offsets_.fill(nullptr);
    side_ = cos_ = half_cos_ = S(T(1));
    sin_ = half_sin_ = S(T(0));
    origin_ = core::Vector3<S>::zero();
    for (const sim::MovingBody& b : model.bodies)
      if (b.type == body::JointType::ball) balls_.push_back(b.q_index - 7);
  }

  const MomentLayout& layout() const { return layout_; }
  const FeedbackShape& shape() const { return shape_; }

  /// Gives a lane the moment its player is at. Call for every lane at every tick.
  void set(int lane, const SkillPlayer& player) noexcept {
    const SkillPlayer::Moment m = player.sample(scratch_.data());
    for (std::size_t i = 0; i < scratch_.size(); ++i) core::set_lane(moment_[i], lane, static_cast<T>(scratch_[i]));
    // A gait's frame moves, and the reference's velocity with it.
    S& forward = moment_[static_cast<std::size_t>(layout_.velocity())];
    core::set_lane(forward, lane, core::lane_of(forward, lane) + static_cast<T>(player.speed()));
    const auto k = static_cast<std::size_t>(lane);
    if (laws_[k] != m.law)
      for (std::size_t i = 0; i < law_.size(); ++i) core::set_lane(law_[i], lane, static_cast<T>(m.law[i]));
    if (offsets_[k] != m.offset)
      for (std::size_t i = 0; i < offset_.size(); ++i) core::set_lane(offset_[i], lane, static_cast<T>(m.offset[i]));
    laws_[k] = m.law;
    offsets_[k] = m.offset;
    core::set_lane(side_, lane, m.stance == 0 ? T(1) : T(-1));
    core::set_lane(cos_, lane, static_cast<T>(std::cos(m.frame.heading)));
    core::set_lane(sin_, lane, static_cast<T>(std::sin(m.frame.heading)));
    core::set_lane(half_cos_, lane, static_cast<T>(std::cos(0.5 * m.frame.heading)));
    core::set_lane(half_sin_, lane, static_cast<T>(std::sin(0.5 * m.frame.heading)));
    core::set_lane(origin_.x, lane, static_cast<T>(m.frame.x));
    core::set_lane(origin_.y, lane, static_cast<T>(m.frame.y));
    core::set_lane(origin_.z, lane, static_cast<T>(m.frame.z));
  }
  /// Makes the next `set` read a lane's control again, for callers who changed its numbers in place.
  void forget(int lane) noexcept {
    laws_[static_cast<std::size_t>(lane)] = nullptr;
    offsets_[static_cast<std::size_t>(lane)] = nullptr;
  }

  /// What the sensors of a control tick read: full_sensors differences from the reference and its sensory record, seen
  /// from the stance foot's side. Lanes must be refreshed.
  void sense(const sim::Lanes<S>& lanes, S* ds) const noexcept {
    using core::Quaternion;
    using core::Vector3;
    const auto& w = lanes.work();
    const S yaw = row(layout_.yaw());
    using std::cos;
    using std::sin;
    // Sensors are seen from the reference root's own heading, which sways with each step.
    const S cy = cos(yaw), sy = sin(yaw);
    const auto sway = [&](const Vector3<S>& v) { return Vector3<S>{cy * v.x + sy * v.y, cy * v.y - sy * v.x, v.z}; };
    const auto polar = [&](int at, const Vector3<S>& v) {
      const Vector3<S> h = sway(v);
      Vector3<S>{h.x, side_ * h.y, h.z}.store(ds + at);
    };
    const auto axial = [&](int at, const Vector3<S>& v) {
      const Vector3<S> h = sway(v);
      Vector3<S>{side_ * h.x, h.y, side_ * h.z}.store(ds + at);
    };
    const Quaternion<S> root = rotation(layout_.root());
    // log of a rotation seen from the frame is the log seen from the frame.
    const S zero = S(T(0));
    const Quaternion<S> back{zero, zero, zero - half_sin_, half_cos_};
    axial(0, log_map((back * Quaternion<S>::from(lanes.q() + 3)) * root.conjugate()));
    polar(3, in_frame(w.center_of_mass - origin_) - vector(layout_.center()));
    const S inverse_mass(static_cast<T>(1.0 / model_->total_mass));
    polar(6, in_frame(inverse_mass * w.linear_momentum) - vector(layout_.velocity()));
    const auto right = side_ > zero;
    std::array<Vector3<S>, 2> off;
    for (std::size_t side = 0; side < 2; ++side)
      off[side] = in_frame(w.bodies[static_cast<std::size_t>(roles_.legs[side].foot)].position - w.center_of_mass) -
                  vector(layout_.feet() + 3 * static_cast<int>(side));
    polar(9, core::select(right, off[0], off[1]));
    polar(12, core::select(right, off[1], off[0]));
    axial(15, in_frame(w.bodies[0].angular) - vector(layout_.spin()));
    for (int i = 0; i < full_sensors; ++i) ds[i] -= row(layout_.sensory() + i);
  }

  /// Senses, evaluates the laws and sets the targets.
  void act(sim::Lanes<S>& lanes) const noexcept {
    std::array<S, full_sensors> ds;
    act(lanes, ds.data());
  }
  /// The same, and tells what was sensed (full_sensors numbers).
  void act(sim::Lanes<S>& lanes, S* ds) const noexcept {
    using core::Quaternion;
    using core::Vector3;
    std::array<S, full_actions> da;
    sense(lanes, ds);
    feedback(shape_, limits_, law_.data(), ds, da.data());
    for (std::size_t i = 0; i < offset_.size(); ++i) da[i] += offset_[i];
    S* target = lanes.target() + 7;
    for (int i = 0; i < layout_.joints; ++i) target[i] = row(i);
    for (const int b : balls_) Quaternion<S>::from(target + b).normalized().store(target + b);

    const S zero = S(T(0));
    const auto right = side_ > zero;
    const auto turn = [&](int b, const Vector3<S>& d) {
      if (b <= 0) return;
      const sim::MovingBody& m = model_->bodies[static_cast<std::size_t>(b)];
      S* t = target + (m.q_index - 7);
      if (m.type == body::JointType::ball)
        (exp_map(d) * Quaternion<S>::from(t)).store(t);
      else
        t[0] += dot(d, m.axis.template cast<T>().template cast<S>());
    };
    const auto action = [&](int at) {
      const Vector3<S> d = Vector3<S>::from(da.data() + at);
      return Vector3<S>{side_ * d.x, d.y, side_ * d.z};
    };
    const auto pair = [&](int swing, int stance, int right_body, int left_body) {
      const Vector3<S> sw = action(swing), st = action(stance);
      turn(right_body, core::select(right, st, sw));
      turn(left_body, core::select(right, sw, st));
    };
    pair(0, 3, roles_.legs[0].hip, roles_.legs[1].hip);
    turn(roles_.waist, action(6));
    for (const int b : roles_.upper_trunk) turn(b, action(6));
    if (shape_.sets.ankles) pair(9, 12, roles_.legs[0].foot, roles_.legs[1].foot);
    if (shape_.sets.knees) {
      const auto at = static_cast<std::size_t>(shape_.sets.ankles ? 15 : 9);
      const auto knee = [&](std::size_t side) -> S& {
        return target[model_->bodies[static_cast<std::size_t>(roles_.legs[side].knee)].q_index - 7];
      };
      knee(0) += core::select(right, da[at + 1], da[at]);
      knee(1) += core::select(right, da[at], da[at + 1]);
    }
  }

private:
  const S& row(int i) const noexcept { return moment_[static_cast<std::size_t>(i)]; }
  core::Vector3<S> vector(int i) const noexcept { return core::Vector3<S>::from(moment_.data() + i); }
  core::Quaternion<S> rotation(int i) const noexcept { return core::Quaternion<S>::from(moment_.data() + i).normalized(); }
  core::Vector3<S> in_frame(const core::Vector3<S>& v) const noexcept {
    return {cos_ * v.x + sin_ * v.y, cos_ * v.y - sin_ * v.x, v.z};
  }

  const sim::Model* model_;
  Roles roles_;
  FeedbackShape shape_;
  FeedbackLimits limits_;
  MomentLayout layout_;
  std::vector<int> balls_;
  std::vector<S> moment_, law_, offset_;
  std::vector<float> scratch_;
  std::array<const double*, static_cast<std::size_t>(width)> laws_, offsets_;
  S side_, cos_, sin_, half_cos_, half_sin_;  ///< sign of the stance side; the frame's heading and half of it
  core::Vector3<S> origin_;
};

}  // namespace traceur::control
