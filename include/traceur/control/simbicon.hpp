// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include "traceur/control/feedback_law.hpp"
#include "traceur/core/error.hpp"

namespace traceur::control {

/// Balance by step placement (Terrain Runner, s5.1; after Yin, Loken and van de Panne 2007): da = S ds with
///
///     ds = {velocity of the centre of mass, vectors from it to the stance and to the swing foot}, horizontal parts: 6
///     da = {rotation of the swing hip about the forward and about the sideways axis}: 2
///
/// S is 2 x 6, so twelve numbers.
using SimbiconGains = Eigen::Matrix<double, 2, 6>;

/// Where the six are among a law's sensors, and the two among its actions.
inline constexpr int simbicon_sensors[6] = {6, 7, 9, 10, 12, 13};
inline constexpr int simbicon_actions[2] = {0, 1};

/// The gains of the original controller, c_v for velocity and c_d for distance: the swing foot is set down farther out in
/// the direction in which the body is moving too fast. A rotation about the sideways axis takes the leg back, so the
/// forward gains are negative.
inline SimbiconGains simbicon_gains(double velocity = 0.2, double distance = 0.2) {
  SimbiconGains s = SimbiconGains::Zero();
  // Sideways velocity and stance foot; the foot is to the right of a body that leans left.
  s(0, 1) = velocity;
  s(0, 3) = -distance;
  s(1, 0) = -velocity;
  s(1, 2) = distance;
  return s;
}

/// The same as the law of one phase of a shape with the swing foot among its sensors and rank 2 or more, so that whatever
/// plays laws plays it. Throws Error on other shapes.
inline Eigen::VectorXd simbicon_law(const FeedbackShape& shape, const SimbiconGains& gains) {
  if (!shape.sets.swing_foot || shape.rank < 2) throw Error("simbicon: expected a law of rank 2 or more that senses the swing foot");
  Eigen::VectorXd law = Eigen::VectorXd::Zero(shape.phase_size());
  const int m = shape.sets.actions(), r = shape.rank;
  for (int k = 0; k < 2; ++k) {
    law[k * m + simbicon_actions[k]] = 1;
    for (int i = 0; i < 6; ++i) law[m * r + simbicon_sensors[i] * r + k] = gains(k, i);
  }
  return law;
}

}  // namespace traceur::control
