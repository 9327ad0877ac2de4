// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <initializer_list>
#include <limits>
#include <vector>

#include "traceur/core/error.hpp"

namespace traceur::control {

/// What ends a phase of a manoeuvre (Terrain Runner, s3).
enum class PhaseEvent {
  center_passes_hand,  ///< the centre of mass has passed the place where a hand touched the obstacle
  one_foot_lands,      ///< a foot is down, after both were off the ground
  both_feet_leave,     ///< neither foot is down
  both_feet_land,      ///< each foot has been down since the phase began and both were off the ground
  center_passes_shin,  ///< the centre of mass has passed the lower leg of a kneeling leg
  never                ///< the last phase goes on to the motion's end
};

/// What a phase detector looks at, one control tick at a time. Places are measured along the direction of travel, m.
struct PhaseSenses {
  std::array<bool, 2> foot_down{false, false};  ///< right, left
  bool hand_touches = false;                    ///< the supporting hand is on the obstacle
  bool shin_down = false;                       ///< a knee or lower leg bears on the ground
  double center = 0, hand = 0, shin = 0;        ///< centre of mass, supporting hand, middle of that lower leg
};

/// The phases of a manoeuvre: what ends each.
using PhasePlan = std::vector<PhaseEvent>;

/// Up a step: run-up and take-off, flight, landing.
inline PhasePlan jump_phases() { return {PhaseEvent::both_feet_leave, PhaseEvent::one_foot_lands, PhaseEvent::never}; }
/// A hand reaches for the obstacle and the legs lift off; the body passes over it; the runner goes on.
inline PhasePlan vault_phases() { return {PhaseEvent::center_passes_hand, PhaseEvent::one_foot_lands, PhaseEvent::never}; }
/// Off the edge; down; the roll; up again.
inline PhasePlan drop_roll_phases() {
  return {PhaseEvent::both_feet_leave, PhaseEvent::both_feet_land, PhaseEvent::center_passes_shin, PhaseEvent::never};
}

/// Follows a manoeuvre through its phases by what happens to the body rather than by the clock. One phase ends at most in
/// one tick.
class PhaseDetector {
public:
  /// `least_seconds`: no phase is shorter, so that a contact which flickers at a change does not end the next phase too.
  /// Throws Error on a plan without phases or a negative time.
  explicit PhaseDetector(PhasePlan plan, double least_seconds = 0.05)
      : plan_(std::move(plan)), least_seconds_(least_seconds) {
    if (plan_.empty()) throw Error("phases: expected a phase");
    if (!(least_seconds >= 0)) throw Error("phases: expected a least time of zero or more");
  }

  int phase() const noexcept { return phase_; }
  int phases() const noexcept { return static_cast<int>(plan_.size()); }
  /// Time since the present phase began, s.
  double seconds() const noexcept { return seconds_; }
  /// Where the supporting hand first touched, m along the direction of travel; not finite before.
  double hand_place() const noexcept { return hand_place_; }

  void restart() noexcept {
    phase_ = 0;
    begin();
    hand_place_ = std::numeric_limits<double>::quiet_NaN();
  }

  /// Takes in a tick of `dt` seconds and returns the phase after it.
  int update(const PhaseSenses& s, double dt) noexcept {
    seconds_ += dt;
    if (s.hand_touches && !(hand_place_ == hand_place_)) hand_place_ = s.hand;
    if (!s.foot_down[0] && !s.foot_down[1]) {
      flew_ = true;
      landed_ = {false, false};
    }
    for (std::size_t side = 0; side < 2; ++side) landed_[side] = landed_[side] || (flew_ && s.foot_down[side]);
    if (seconds_ < least_seconds_ || phase_ + 1 >= phases() || !ends(s)) return phase_;
    ++phase_;
    begin();
    // A phase that begins in the air has flown already.
    flew_ = !s.foot_down[0] && !s.foot_down[1];
    return phase_;
  }

private:
  bool ends(const PhaseSenses& s) const noexcept {
    switch (plan_[static_cast<std::size_t>(phase_)]) {
      case PhaseEvent::center_passes_hand: return s.center > hand_place_;
      case PhaseEvent::one_foot_lands: return landed_[0] || landed_[1];
      case PhaseEvent::both_feet_leave: return !s.foot_down[0] && !s.foot_down[1];
      case PhaseEvent::both_feet_land: return landed_[0] && landed_[1];
      case PhaseEvent::center_passes_shin: return s.shin_down && s.center > s.shin;
      case PhaseEvent::never: return false;
    }
    return false;
  }
  void begin() noexcept {
    seconds_ = 0;
    flew_ = false;
    landed_ = {false, false};
  }

  PhasePlan plan_;
  double least_seconds_;
  int phase_ = 0;
  double seconds_ = 0;
  double hand_place_ = std::numeric_limits<double>::quiet_NaN();
  bool flew_ = false;
  std::array<bool, 2> landed_{false, false};
};

}  // namespace traceur::control
