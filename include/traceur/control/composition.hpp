// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cmath>
#include <vector>

#include <Eigen/Core>

#include "traceur/control/running.hpp"
#include "traceur/control/simbicon.hpp"
#include "traceur/control/tracking_regulator.hpp"

namespace traceur::control {

/// An obstacle-clearing manoeuvre composed with running (Terrain Runner, s5): everything from the last running step before it
/// (transIn) to its end (clear), for one kind and size of obstacle. Its motion's frame has its origin where the obstacle
/// begins. The law of its first phase is the transIn step's, M'_theta_in; the others are M'_h.
struct Manoeuvre {
  const Skill* skill = nullptr;
  Eigen::VectorXd control;
  double distance = 0;   ///< u_h: from the centre of mass to the obstacle when it begins, m
  double speed_in = 0;   ///< theta_in, m/s; the turn is zero
  double speed_out = 0;  ///< theta_out, m/s
  double rise = 0;       ///< how much higher the ground is afterwards, m
  double slide = 0;      ///< m, by how much it may be done before the obstacle or behind it, if it is begun there
  int steps_out = -1;    ///< running steps of transOut; negative: as many as the composer's settings say
  Eigen::VectorXd recovery{};  ///< what is added to the numbers of running's controls during transOut; empty for nothing
  double end = 0;        ///< phase (ticks) at which running begins again; 0: the table's end. What the table holds beyond it
                         ///< fades out of the reference
  bool blend_in = true;  ///< whether the reference of running fades into the manoeuvre's
  const TrackingRegulator* regulator = nullptr;  ///< adds to the law, if there is one
  double size = 0;       ///< of the obstacle, as the regulator has it
  bool in_mirror = false;  ///< whether it is the mirror image of the regulator's
  int hand = -1;         ///< hand that holds on to the obstacle: 0 right, 1 left; -1: none
  double hold_from = 0, hold_to = 0;  ///< phases (ticks) between which it may
};

/// Where a composed runner is.
enum class RunStage { run, trans_in, clear, trans_out };

/// Composes running with manoeuvres (Terrain Runner, Figure 5): running steps with a control for each; on request transIn and
/// clear, with the references blended over one running step; then transOut, some steps with a control of their own before
/// running as usual, blended likewise.
///
/// The caller tells where the centre of mass is after every tick and, when a step begins, what the runner is to do next. One
/// object moves one character; it allocates only when it is given a larger control than before.
class Composer {
public:
  struct Settings {
    bool blend = true;         ///< reference blending (s5.3); without it references change at once
    int trans_out_steps = 4;   ///< balance comes back within so many steps
  };

  /// The gait must outlive it.
  Composer(const sim::Model& model, const Skill& gait, const Settings& settings)
      : gait_(&gait), settings_(settings), step_starts_(gait.table.step_starts()) {
    if (!gait.table.cyclic() || step_starts_.size() != 2) throw Error("composition: expected a gait of two steps");
    player_.know(model);
    for (Eigen::VectorXd& c : controls_) c = gait.shape.neutral(Eigen::VectorXd::Zero(gait.shape.law.size()));
    manoeuvre_control_ = controls_[0];
  }
  Composer(const sim::Model& model, const Skill& gait) : Composer(model, gait, Settings{}) {}

  const SkillPlayer& player() const noexcept { return player_; }
  RunStage stage() const noexcept { return stage_; }
  /// The manoeuvre that it is in, or null.
  const Manoeuvre* manoeuvre() const noexcept {
    return stage_ == RunStage::trans_in || stage_ == RunStage::clear ? manoeuvre_ : nullptr;
  }
  /// Whether a hand (0 right, 1 left) may hold on to the obstacle now.
  bool may_hold(int hand) const noexcept {
    return manoeuvre() && manoeuvre_->hand == hand &&
           player_.phase() >= manoeuvre_->hold_from && player_.phase() < manoeuvre_->hold_to;
  }
  /// Phase (ticks of the gait) at which a step on a side begins: 0 right, 1 left.
  double step_start(int side) const noexcept {
    for (const int t : step_starts_)
      if (gait_->table.stance(t) == side) return t;
    return 0;
  }
  double step_seconds() const noexcept { return 0.5 * gait_->table.duration() * player_.beta(); }

  /// Begins to run at a phase with a control (gait.shape.size() numbers, copied).
  void start(const Eigen::Ref<const Eigen::VectorXd>& control, double speed, const SkillFrame& frame, double phase) noexcept {
    stage_ = RunStage::run;
    player_.start(*gait_, next_control(control), frame, phase);
    player_.steer(speed, 0);
    new_step_ = true;
    out_steps_ = 0;
  }

  /// Whether a running step begins now and waits for `step` or `clear`.
  bool at_step() const noexcept { return new_step_; }
  /// Side of the foot on which that step is done: 0 right, 1 left.
  int side() const noexcept { return player_.skill().table.stance(player_.phase() + 1e-6); }
  /// Runs the step that begins with a control, at a speed (m/s), turning by so much (rad).
  void step(const Eigen::Ref<const Eigen::VectorXd>& control, double speed, double turn) noexcept {
    player_.use(next_control(control));
    player_.steer(speed, turn / step_seconds());
    new_step_ = false;
  }
  /// Begins a manoeuvre with its control (copied) where the obstacle begins, the centre of mass at (x, y).
  void clear(const Manoeuvre& m, const SkillFrame& obstacle, double x, double y) noexcept {
    manoeuvre_control_ = m.control;
    manoeuvre_ = &m;
    obstacle_ = obstacle;
    const double ahead_x = std::cos(obstacle.heading), ahead_y = std::sin(obstacle.heading);
    const double off = std::clamp(ahead_x * (x - obstacle.x) + ahead_y * (y - obstacle.y) + m.distance, -m.slide, m.slide);
    obstacle_.x += off * ahead_x;
    obstacle_.y += off * ahead_y;
    const double seconds = settings_.blend && m.blend_in ? step_seconds() : 0;
    player_.pass_to(*m.skill, manoeuvre_control_.data(), obstacle_, 0, seconds);
    stage_ = RunStage::trans_in;
    new_step_ = false;
  }
  /// The control of the steps of transOut.
  void set_exit(const Eigen::Ref<const Eigen::VectorXd>& control) noexcept { exit_ = control; }

  /// Goes on by a tick, the centre of mass at (x, y).
  void advance(double seconds, double x, double y) noexcept {
    if (stage_ == RunStage::run || stage_ == RunStage::trans_out) {
      const double before = player_.phase();
      player_.advance(seconds);
      player_.move_frame(near_frame(player_.frame(), x, y, gait_->limits));
      for (const int t : step_starts_)
        if (crosses(before, player_.phase(), t)) begin_step();
      return;
    }
    player_.advance(seconds);
    if (stage_ == RunStage::trans_in && player_.skill().table.law(player_.phase()) > 0) stage_ = RunStage::clear;
    if (manoeuvre_->end > 0 ? player_.phase() >= manoeuvre_->end - 1e-9 : player_.ended()) leave(x, y);
  }

private:
  const double* next_control(const Eigen::Ref<const Eigen::VectorXd>& control) noexcept {
    // The one before may still be fading out.
    which_ = 1 - which_;
    controls_[which_] = control;
    if (stage_ == RunStage::trans_out && manoeuvre_->recovery.size() > 0) controls_[which_] += manoeuvre_->recovery;
    return controls_[which_].data();
  }
  bool crosses(double before, double after, int tick) const noexcept {
    const double n = gait_->table.ticks();
    return std::floor((after - tick) / n + 1e-9) > std::floor((before - tick) / n + 1e-9);
  }
  void begin_step() noexcept {
    new_step_ = true;
    if (stage_ != RunStage::trans_out) return;
    if (++out_steps_ >= (manoeuvre_->steps_out < 0 ? settings_.trans_out_steps : manoeuvre_->steps_out)) stage_ = RunStage::run;
  }
  void leave(double x, double y) noexcept {
    SkillFrame f = obstacle_;
    f.x = x;
    f.y = y;
    f.z += manoeuvre_->rise;
    // The manoeuvre's last stance foot was down; the other one's step is next.
    const int side = 1 - player_.skill().table.stance(player_.phase() - 1);
    const double seconds = settings_.blend ? 0.5 * gait_->table.duration() : 0;
    stage_ = RunStage::trans_out;
    player_.pass_to(*gait_, next_control(exit_), f, step_start(side), seconds);
    player_.steer(manoeuvre_->speed_out, 0);
    out_steps_ = 0;
    new_step_ = true;
  }

  const Skill* gait_;
  Settings settings_;
  std::vector<int> step_starts_;
  SkillPlayer player_;
  RunStage stage_ = RunStage::run;
  const Manoeuvre* manoeuvre_ = nullptr;
  SkillFrame obstacle_;
  std::array<Eigen::VectorXd, 2> controls_;
  std::size_t which_ = 0;
  Eigen::VectorXd manoeuvre_control_, exit_;
  bool new_step_ = false;
  int out_steps_ = 0;
};

}  // namespace traceur::control
