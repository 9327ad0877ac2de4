// SPDX-License-Identifier: MIT
#pragma once

#include <filesystem>
#include <vector>

#include "traceur/control/controller.hpp"
#include "traceur/control/tracking_regulator.hpp"

namespace terrain_runner {

/// A manoeuvre over obstacles of several heights as it was simulated without feedback: the reference that its law and offsets
/// are learned around. Of all heights it has the same ticks. It begins with a step on the left foot; its frame's origin is
/// where the obstacle begins, on the ground before it.
struct MotionFamily {
  std::vector<double> heights;                              ///< m, increasing
  std::vector<Eigen::MatrixXd> targets, poses, velocities;  ///< of each height: nq x ticks, nq x (ticks + 1), nv x (ticks + 1)
  std::vector<int> stance, phase, parts;                    ///< of each tick: foot (0 right, 1 left), law, offset
  int end = 0;                                              ///< tick at which running begins again, with a step on the right foot
  int placed = 0;                                           ///< tick from which on it is all one where on the ground it is done
  int hold_from = 0, hold_to = 0;                           ///< ticks in which the right hand may hold on to the obstacle
  std::vector<std::vector<traceur::control::Gain>> gains;   ///< of each height, of each tick up to `end`: a regulator's
  Eigen::MatrixXd plan_offsets;                               ///< of the last height's plan, around which the next is sought; empty: there is none
  double plan_distance = 0;                                 ///< m, beside it: from which the first plan began before the obstacle
  double depth = 0;                                         ///< of the obstacle along the way, m; 0: it has no other side

  int ticks() const { return static_cast<int>(stance.size()); }
  int laws() const;
  int offsets() const;
  /// The motion at its k-th height as a controller of the gait's kind, its law and sensory record zero.
  traceur::control::Controller controller(const traceur::sim::Model& model, const traceur::control::Roles& roles,
                                          const traceur::control::Controller& gait, std::size_t k) const;
};

/// A motion in the mirror, which begins with a step on the other foot. Laws and offsets are seen from the stance foot, so the
/// same numbers do for both.
traceur::control::Controller mirrored(const traceur::sim::Model& model, const traceur::control::Roles& roles, traceur::control::Controller c);

/// Throws traceur::Error that names the file when it is not one of the model's, or numbers in it cannot be.
MotionFamily read_family(const std::filesystem::path& path, const traceur::sim::Model& model);
void write_family(const std::filesystem::path& path, const MotionFamily& family);

}  // namespace terrain_runner
