// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "traceur/control/feedback_law.hpp"
#include "traceur/core/error.hpp"

namespace traceur::control {

/// Where the numbers of an affine control are (Terrain Runner, Eq. 4-6 and 9): da = M ds + a_hat, with the amplitude alpha
/// and the duration beta of the reference.
///
///     M (law.size()), a_hat (offsets x actions), alpha, beta
///
/// A runner has two vectors a_hat, for the steps on the right and on the left foot (the paper's a_r and a_l), both as seen
/// from the right foot: its action set is {a_l, a_r, alpha, beta}, 20 numbers, and with the law of rank 3 a running control
/// has 83. A skill done once has one, or one for each of its phases.
struct AffineShape {
  FeedbackShape law;
  int offsets = 2;

  int actions() const { return law.sets.actions(); }
  int offset(int index) const { return law.size() + index * actions(); }
  int alpha() const { return law.size() + offsets * actions(); }
  int beta() const { return alpha() + 1; }
  int size() const { return alpha() + 2; }

  /// The control that changes nothing about a law's motion: a_hat = 0, alpha = beta = 1.
  Eigen::VectorXd neutral(const Eigen::VectorXd& numbers) const {
    Eigen::VectorXd control = Eigen::VectorXd::Zero(size());
    control.head(law.size()) = numbers;
    control[alpha()] = control[beta()] = 1;
    return control;
  }

  /// The control of the mirrored motion: turning left becomes turning right. Laws and offsets are seen from the stance foot
  /// already, so the two offsets change places and all else stays. An involution. For runners, with two offsets.
  Eigen::VectorXd mirrored(const Eigen::VectorXd& control) const {
    Eigen::VectorXd out = control;
    out.segment(offset(0), actions()) = control.segment(offset(1), actions());
    out.segment(offset(1), actions()) = control.segment(offset(0), actions());
    return out;
  }

  /// The nearest control that is its own mirror image, for running straight ahead.
  Eigen::VectorXd symmetric(const Eigen::VectorXd& control) const { return 0.5 * (control + mirrored(control)); }
};

namespace detail {

/// Where each number of a law of one phase with few sensors and actions goes in that of one with more; -1 where it goes
/// nowhere.
inline std::vector<int> widened_law(const FeedbackShape& from, const FeedbackShape& to) {
  std::vector<int> sensors, actions;
  for (int i = 0; i < 12; ++i) sensors.push_back(i);
  int at = 12;
  if (from.sets.swing_foot)
    for (int i = 0; i < 3; ++i) sensors.push_back(to.sets.swing_foot ? at + i : -1);
  at += to.sets.swing_foot ? 3 : 0;
  if (from.sets.root_spin)
    for (int i = 0; i < 3; ++i) sensors.push_back(to.sets.root_spin ? at + i : -1);
  for (int i = 0; i < 9; ++i) actions.push_back(i);
  at = 9;
  if (from.sets.ankles)
    for (int i = 0; i < 6; ++i) actions.push_back(to.sets.ankles ? at + i : -1);
  at += to.sets.ankles ? 6 : 0;
  if (from.sets.knees)
    for (int i = 0; i < 2; ++i) actions.push_back(to.sets.knees ? at + i : -1);
  std::vector<int> out;
  const int m = to.sets.actions();
  for (int k = 0; k < from.rank; ++k)
    for (const int a : actions) out.push_back(a < 0 ? -1 : k * m + a);
  for (const int s : sensors)
    for (int k = 0; k < from.rank; ++k) out.push_back(s < 0 ? -1 : m * to.rank + s * to.rank + k);
  return out;
}

}  // namespace detail

/// A law of one phase of a shape, in a shape of more sensors and actions and the same rank or more, which does the same:
/// new sensors are not looked at, new actions not used. Throws Error where something would be lost.
inline Eigen::VectorXd widened_law(const FeedbackShape& from, const FeedbackShape& to, const Eigen::VectorXd& law) {
  const std::vector<int> places = detail::widened_law(from, to);
  if (law.size() != from.phase_size() || to.rank < from.rank) throw Error("affine control: expected a law of its shape's size and a rank as large");
  Eigen::VectorXd out = Eigen::VectorXd::Zero(to.phase_size());
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (places[i] < 0) throw Error("affine control: expected a shape with all sensors and actions of the law");
    out[places[i]] = law[static_cast<Eigen::Index>(i)];
  }
  return out;
}

/// The same of a whole control with one phase: law, offsets, alpha and beta.
inline Eigen::VectorXd widened(const AffineShape& from, const AffineShape& to, const Eigen::VectorXd& control) {
  if (from.law.phases != 1 || to.law.phases != 1 || from.offsets != to.offsets || control.size() != from.size())
    throw Error("affine control: expected controls of one phase with equally many offsets");
  Eigen::VectorXd out = to.neutral(widened_law(from.law, to.law, control.head(from.law.size())));
  const int m = from.actions();
  for (int k = 0; k < from.offsets; ++k) {
    out.segment(to.offset(k), 9) = control.segment(from.offset(k), 9);
    int here = 9, there = 9;
    if (from.law.sets.ankles) out.segment(to.offset(k) + 9, 6) = control.segment(from.offset(k) + 9, 6);
    here += from.law.sets.ankles ? 6 : 0;
    there += to.law.sets.ankles ? 6 : 0;
    for (; here < m; ++here, ++there) out[to.offset(k) + there] = control[from.offset(k) + here];
  }
  out[to.alpha()] = control[from.alpha()];
  out[to.beta()] = control[from.beta()];
  return out;
}

}  // namespace traceur::control
