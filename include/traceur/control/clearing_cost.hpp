// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>

#include "traceur/core/vector3.hpp"

namespace traceur::control {

/// |x|_+ = max(x, 0).
inline double hinge_loss(double x) noexcept { return std::max(x, 0.0); }

/// Jumping up a step (Terrain Runner, s4.2.1): E_c = |h - h_f|_+, where h_f is the lowest height of the foot when it meets a
/// step of height h (m).
inline double jump_contact_cost(double step_height, double foot_height) noexcept {
  return hinge_loss(step_height - foot_height);
}

/// What the contacts of a vault were like. Heights above the ground, m.
struct VaultRecord {
  double left_foot = 0, right_foot = 0;      ///< h_l, h_r: lowest heights as the feet passed the obstacle
  core::Vector3<double> landing{0, 0, 0};    ///< d_r: from the first foot that landed to the centre of mass, m
  core::Vector3<double> landing_reference{0, 0, 0};
  double hand = 0;                           ///< h_h: lowest height of the hand at its contact
  double hand_off_middle = 0;                ///< d_h: from the hand to the obstacle's middle, m
  core::Vector3<double> support{0, 0, 0};    ///< vector d_h: from the hand to the centre of mass, m
  core::Vector3<double> support_reference{0, 0, 0};
};

/// Weights of Eq. 11, which the paper does not give. All 1/m.
struct VaultWeights {
  double clearance = 1;  ///< w_f1
  double landing = 1;    ///< w_f2
  double hand = 1;       ///< w_h1
  double support = 1;    ///< w_h2
};

/// Vaulting, Eq. 11: both feet pass at `clearance` m or higher (h_d), the first foot lands where it does in the reference,
/// the hand is put on top of the obstacle of height h, onto its middle, and carries the body where it does in the reference.
inline double vault_contact_cost(const VaultRecord& r, double height, double clearance, const VaultWeights& w = {}) noexcept {
  return w.clearance * (hinge_loss(clearance - r.left_foot) + hinge_loss(clearance - r.right_foot)) +
         w.landing * norm(r.landing - r.landing_reference) + w.hand * (hinge_loss(height - r.hand) + r.hand_off_middle) +
         w.support * norm(r.support - r.support_reference);
}

/// Balance at the end of a jump or a vault: E_b, the distance of the stance foot from where the reference has it, both
/// from the centre of mass, m.
inline double balance_cost(const core::Vector3<double>& stance, const core::Vector3<double>& reference) noexcept {
  return norm(stance - reference);
}

/// What a drop-roll's balance depends on. Feet from the centre of mass, m, as they are minus as they should be.
struct DropRollRecord {
  core::Vector3<double> momentum{0, 0, 0};  ///< angular, at the end of phase 1, off the reference, kg m^2/s
  core::Vector3<double> left{0, 0, 0}, right{0, 0, 0};  ///< feet at the end of phase 2
  core::Vector3<double> stance{0, 0, 0};    ///< stance foot at the end of phase 3
};

/// Drop-rolling (s4.2.1) has no contact term: E_b = w_L |L| + w_d (|d_l| + |d_r| + |d|) of what is off the reference.
inline double drop_roll_balance_cost(const DropRollRecord& r, double momentum_weight = 0.1, double distance_weight = 1) noexcept {
  return momentum_weight * norm(r.momentum) + distance_weight * (norm(r.left) + norm(r.right) + norm(r.stance));
}

/// E_p's parts: the mean pose distance over the manoeuvre, and those of its last pose and root.
struct PoseRecord {
  double mean = 0, last = 0, last_root = 0;
};

/// Weights of Eq. 10, which the paper does not give.
struct ClearingWeights {
  double contact = 10;  ///< w_c
  double balance = 2;   ///< w_b
  double pose = 1;      ///< w_p
  double mean_pose = 1;  ///< w, of the mean within E_p
};

/// Terrain Runner, Eq. 10: E = w_c E_c + w_b E_b + w_p E_p.
inline double clearing_cost(double contact, double balance, const PoseRecord& pose, const ClearingWeights& w = {}) noexcept {
  return w.contact * contact + w.balance * balance + w.pose * (w.mean_pose * pose.mean + pose.last + pose.last_root);
}

}  // namespace traceur::control
