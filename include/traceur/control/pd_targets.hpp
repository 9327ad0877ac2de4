// SPDX-License-Identifier: MIT
#pragma once

#include "traceur/control/tracking_reference.hpp"

namespace traceur::control {

/// PD target poses that make motors with damping on absolute joint speed follow a reference: each tick's pose led by
/// `lead` seconds of the reference's joint velocity. With lead = kd / kp the damping torque of the reference motion itself
/// is cancelled; without it a target arrives that much late. One column per tick.
inline Eigen::MatrixXd led_targets(const sim::Model& model, const TrackingReference& r, double lead) {
  Eigen::MatrixXd targets(model.nq, r.ticks + 1);
  for (int t = 0; t <= r.ticks; ++t) {
    const Eigen::VectorXd d = lead * r.velocities.col(t);
    body::displace(model.character.skeleton, r.poses.col(t).data(), d.data(), targets.col(t).data());
    targets.col(t).head(7) = r.poses.col(t).head(7);
  }
  return targets;
}

}  // namespace traceur::control
