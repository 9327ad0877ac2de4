// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <vector>

#include "traceur/control/mirror.hpp"
#include "traceur/core/pack.hpp"

namespace traceur::control {

/// Which sensors and actions a reduced-order feedback law has. Always there (Terrain Runner s3, running): root orientation
/// q0, centre of mass c and its velocity, vector d from the centre of mass to the stance foot; swing hip, stance hip, waist.
struct FeedbackSets {
  bool swing_foot = false;  ///< sensor: vector from the centre of mass to the swing foot
  bool root_spin = false;   ///< sensor: angular velocity of the root
  bool ankles = false;      ///< actions: swing and stance ankle
  bool knees = false;       ///< actions: swing and stance knee, one angle each, bending positive

  int sensors() const { return 12 + (swing_foot ? 3 : 0) + (root_spin ? 3 : 0); }  ///< n
  int actions() const { return 9 + (ankles ? 6 : 0) + (knees ? 2 : 0); }           ///< m
};

/// Sensors a law can have, in the order of a full measurement: root orientation, centre of mass, its velocity, stance foot,
/// swing foot, root angular velocity; three numbers each.
inline constexpr int full_sensors = 18;

/// Actions a law can have at most.
inline constexpr int full_actions = 17;

/// Limits on what a law sees and does, so that a character far off its reference is still given sensible targets.
struct FeedbackLimits {
  double forward = 0.3;   ///< centre of mass ahead or behind, m
  double sideways = 0.5;  ///< centre of mass to the side or in height, m
  double action = 0.6;    ///< each component of an action, rad
};

/// da = M_ap M_sp ds (Terrain Runner Eq. 1-3 with a_hat = 0), one pair of matrices for each phase of a motion.
///
/// Parameters of one phase: M_ap (m x r, column by column), then M_sp (r x n, column by column): r (m + n) numbers.
struct FeedbackShape {
  FeedbackSets sets;
  int rank = 3;    ///< r
  int phases = 1;

  int phase_size() const { return rank * (sets.actions() + sets.sensors()); }
  int size() const { return phases * phase_size(); }
};

/// A first guess for the law of a gait, of step-placement form (Yin, Loken, van de Panne 2007, Eq. 1, velocity and distance
/// gains of 0.2): the swing hip steps towards where the centre of mass is drifting, the stance hip and waist hold the trunk
/// upright. One reduced dimension each for forward, sideways and trunk; further ones are zero. Needs rank 3 or more.
inline Eigen::VectorXd step_placement_law(const FeedbackShape& shape, double gain = 1) {
  Eigen::VectorXd law = Eigen::VectorXd::Zero(shape.size());
  if (shape.rank < 3) return law;
  const int m = shape.sets.actions(), r = shape.rank;
  for (int phase = 0; phase < shape.phases; ++phase) {
    double* ap = law.data() + phase * shape.phase_size();
    double* sp = ap + m * r;
    const double g = std::sqrt(gain * 0.2);
    const auto sense = [&](int row, int sensor, double x) { sp[sensor * r + row] = x; };
    const auto act = [&](int row, int action, double x) { ap[row * m + action] = x; };
    // Sensors: 1 pitch, 0 roll, 6 and 7 velocity, 9 and 10 stance foot from the centre of mass.
    sense(0, 6, g);
    sense(0, 9, -g);
    act(0, 1, -g);
    sense(1, 7, g);
    sense(1, 10, -g);
    sense(1, 0, g);
    act(1, 0, g);
    act(1, 3, g);
    sense(2, 1, g);
    act(2, 4, g);
    act(2, 7, -0.5 * g);
  }
  return law;
}

/// Evaluates the law of one phase: `law` has phase_size() numbers, `ds` has full_sensors, `da` gets actions() numbers.
template <class S>
[[gnu::always_inline]] inline void feedback(const FeedbackShape& shape, const FeedbackLimits& limits, const S* law, const S* ds, S* da) {
  using T = core::Element<S>;
  const auto constant = [](double x) { return S(static_cast<T>(x)); };
  const int m = shape.sets.actions(), n = shape.sets.sensors(), r = shape.rank;
  std::array<S, full_sensors> s;
  int used = 0;
  for (int k = 0; k < 12; ++k) s[static_cast<std::size_t>(used++)] = ds[k];
  if (shape.sets.swing_foot)
    for (int k = 12; k < 15; ++k) s[static_cast<std::size_t>(used++)] = ds[k];
  if (shape.sets.root_spin)
    for (int k = 15; k < 18; ++k) s[static_cast<std::size_t>(used++)] = ds[k];
  s[3] = core::clamp(s[3], constant(-limits.forward), constant(limits.forward));
  for (std::size_t k = 4; k < 6; ++k) s[k] = core::clamp(s[k], constant(-limits.sideways), constant(limits.sideways));
  const S* ap = law;
  const S* sp = law + m * r;
  for (int i = 0; i < m; ++i) da[i] = constant(0);
  for (int k = 0; k < r; ++k) {
    S reduced = constant(0);
    for (int i = 0; i < n; ++i) reduced += sp[i * r + k] * s[static_cast<std::size_t>(i)];
    for (int i = 0; i < m; ++i) da[i] += ap[k * m + i] * reduced;
  }
  for (int i = 0; i < m; ++i) da[i] = core::clamp(da[i], constant(-limits.action), constant(limits.action));
}

}  // namespace traceur::control
