// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cmath>
#include <vector>

#include <Eigen/Core>

#include "traceur/control/affine_control.hpp"
#include "traceur/control/motion_table.hpp"
#include "traceur/motion/blend.hpp"

namespace traceur::control {

/// Where the reference of a skill is: its origin on the ground (m, world) and the heading of its +x axis (rad).
struct SkillFrame {
  double heading = 0, x = 0, y = 0, z = 0;
};

/// The frame moved along the ground so that a centre of mass at (x, y) is no farther from its origin than the limits.
inline SkillFrame near_frame(SkillFrame f, double x, double y, const FeedbackLimits& limits) noexcept {
  const double c = std::cos(f.heading), s = std::sin(f.heading);
  const double dx = x - f.x, dy = y - f.y;
  const double ahead = c * dx + s * dy, aside = c * dy - s * dx;
  const double along = ahead - std::clamp(ahead, -limits.forward, limits.forward);
  const double across = aside - std::clamp(aside, -limits.sideways, limits.sideways);
  f.x += c * along - s * across;
  f.y += s * along + c * across;
  return f;
}

/// A skill as it is played: its table, and the shapes and limits of its controls.
struct Skill {
  MotionTable table;
  AffineShape shape;
  FeedbackLimits limits;
};

/// Plays skills one after the other for one character: keeps their clock and frame, and says at every tick what the
/// reference is and which numbers of the control are in force. A gait's frame moves at the speed and turning rate it is
/// steered with; that of a skill done once stands still.
///
/// Passing to another skill blends the references (states and actions) over some time, Terrain Runner s5.3: while both go
/// on, one fades into the other with a smoothstep weight. Laws do not fade.
class SkillPlayer {
public:
  /// What is in force now.
  struct Moment {
    SkillFrame frame;
    int stance = 0;           ///< 0 right, 1 left
    const double* law = nullptr;     ///< of the phase, law.phase_size() numbers
    const double* offset = nullptr;  ///< a_hat, law.sets.actions() numbers
  };

  SkillPlayer() = default;

  /// Begins a skill at a phase (ticks), with nothing before it. Skill and control must outlive the playing.
  void start(const Skill& skill, const double* control, const SkillFrame& frame, double phase = 0) noexcept {
    now_ = {&skill, control, frame, phase, 0, 0};
    before_ = {};
    blended_ = duration_ = 0;
  }
  /// Begins a skill while the reference of the one before fades out over `seconds`.
  void pass_to(const Skill& skill, const double* control, const SkillFrame& frame, double phase, double seconds) noexcept {
    before_ = now_;
    now_ = {&skill, control, frame, phase, 0, 0};
    blended_ = 0;
    duration_ = seconds;
  }
  /// Gives the skill another control (another law, offsets, amplitude and duration).
  void use(const double* control) noexcept { now_.control = control; }
  /// Speed (m/s) and turning rate (rad/s) of a gait's frame.
  void steer(double speed, double turn_rate) noexcept {
    now_.speed = speed;
    now_.turn_rate = turn_rate;
  }
  /// Moves the frame, as when the character has got too far from its reference.
  void move_frame(const SkillFrame& frame) noexcept { now_.frame = frame; }

  const Skill& skill() const noexcept { return *now_.skill; }
  const double* control() const noexcept { return now_.control; }
  const SkillFrame& frame() const noexcept { return now_.frame; }
  double phase() const noexcept { return now_.phase; }
  double speed() const noexcept { return now_.speed; }
  double alpha() const noexcept { return now_.control[now_.skill->shape.alpha()]; }
  double beta() const noexcept { return now_.control[now_.skill->shape.beta()]; }
  bool blending() const noexcept { return before_.skill != nullptr && blended_ < duration_; }
  /// Whether a skill done once has come to its end.
  bool ended() const noexcept { return !now_.skill->table.cyclic() && now_.phase >= now_.skill->table.ticks(); }

  /// The reference moment (table().layout().size() numbers, quaternions not of unit length) in the present skill's frame,
  /// and what is in force.
  Moment sample(float* out) const noexcept {
    const Skill& skill = *now_.skill;
    const MotionTable& table = skill.table;
    table.sample(alpha(), beta(), now_.phase, out);
    Moment m;
    m.frame = now_.frame;
    m.stance = table.stance(now_.phase);
    const int law = table.law(now_.phase);
    m.law = now_.control + law * skill.shape.law.phase_size();
    m.offset = now_.control + skill.shape.offset(table.offset(now_.phase));
    if (blending()) fade(out);
    return m;
  }

  /// Goes on by some seconds: clocks by 1/beta, frames by their speed.
  void advance(double seconds) noexcept {
    now_.advance(seconds);
    if (blending()) {
      before_.advance(seconds);
      blended_ += seconds;
    }
  }

private:
  struct Play {
    const Skill* skill = nullptr;
    const double* control = nullptr;
    SkillFrame frame;
    double phase = 0;  ///< ticks
    double speed = 0, turn_rate = 0;

    double stretch() const noexcept { return control[skill->shape.beta()]; }
    void advance(double seconds) noexcept {
      phase += seconds / (skill->table.tick() * stretch());
      if (!skill->table.cyclic()) return;
      const double middle = frame.heading + 0.5 * seconds * turn_rate;
      frame.x += seconds * speed * std::cos(middle);
      frame.y += seconds * speed * std::sin(middle);
      frame.heading += seconds * turn_rate;
    }
  };

  /// Mixes what is fading into the moment `out`, in the frame of the present skill.
  void fade(float* out) const noexcept {
    using core::Quaternion;
    using core::Vector3;
    const auto weight = static_cast<float>(motion::smoothstep(blended_ / duration_));
    const Skill& skill = *before_.skill;
    const MomentLayout& l = skill.table.layout();
    std::array<float, 128> old{};
    if (l.size() > static_cast<int>(old.size()) || l.size() != now_.skill->table.layout().size()) return;
    const double* control = before_.control;
    skill.table.sample(control[skill.shape.alpha()], control[skill.shape.beta()], before_.phase, old.data());
    // The old moment as seen from the new frame. Of gaits, what the frame itself moves is part of the velocity.
    const double turn = before_.frame.heading - now_.frame.heading;
    const auto c = static_cast<float>(std::cos(turn)), s = static_cast<float>(std::sin(turn));
    const auto rotate = [&](int row) {
      const float x = old[static_cast<std::size_t>(row)], y = old[static_cast<std::size_t>(row + 1)];
      old[static_cast<std::size_t>(row)] = c * x - s * y;
      old[static_cast<std::size_t>(row + 1)] = s * x + c * y;
    };
    old[static_cast<std::size_t>(l.velocity())] += static_cast<float>(before_.speed);
    for (const int row : {l.center(), l.velocity(), l.feet(), l.feet() + 3, l.spin()}) rotate(row);
    old[static_cast<std::size_t>(l.velocity())] -= static_cast<float>(now_.speed);
    old[static_cast<std::size_t>(l.yaw())] += static_cast<float>(turn);
    const double dx = before_.frame.x - now_.frame.x, dy = before_.frame.y - now_.frame.y;
    const double ch = std::cos(now_.frame.heading), sh = std::sin(now_.frame.heading);
    old[static_cast<std::size_t>(l.center())] += static_cast<float>(ch * dx + sh * dy);
    old[static_cast<std::size_t>(l.center() + 1)] += static_cast<float>(ch * dy - sh * dx);
    old[static_cast<std::size_t>(l.center() + 2)] += static_cast<float>(before_.frame.z - now_.frame.z);
    float* root = old.data() + l.root();
    (core::about_axis(Vector3<float>{0, 0, 1}, static_cast<float>(turn)) * Quaternion<float>::from(root)).store(root);
    const auto mix = [&](int row) {
      const auto k = static_cast<std::size_t>(row);
      out[row] = old[k] + weight * (out[row] - old[k]);
    };
    const auto mix_rotation = [&](int row) {
      float same = 0;
      for (int i = 0; i < 4; ++i) same += old[static_cast<std::size_t>(row + i)] * out[row + i];
      for (int i = 0; i < 4; ++i) {
        if (same < 0) old[static_cast<std::size_t>(row + i)] = -old[static_cast<std::size_t>(row + i)];
        mix(row + i);
      }
    };
    for (std::size_t b = 0; b < joints_.size(); ++b) {
      if (joints_[b] == 4) mix_rotation(static_cast<int>(b));
      if (joints_[b] == 1) mix(static_cast<int>(b));
    }
    mix_rotation(l.root());
    for (int row = l.yaw(); row < l.size(); ++row) mix(row);
  }

public:
  /// Tells which of a pose's numbers are rotations. Once, before anything is blended.
  void know(const sim::Model& model) {
    joints_.assign(static_cast<std::size_t>(model.nq - 7), 0);
    for (const sim::MovingBody& b : model.bodies) {
      if (b.type == body::JointType::ball) joints_[static_cast<std::size_t>(b.q_index - 7)] = 4;
      if (b.type == body::JointType::hinge) joints_[static_cast<std::size_t>(b.q_index - 7)] = 1;
    }
  }

private:
  Play now_, before_;
  double blended_ = 0, duration_ = 0;  ///< s
  std::vector<int> joints_;            ///< 4 where a rotation begins, 1 where an angle is, 0 else
};

}  // namespace traceur::control
