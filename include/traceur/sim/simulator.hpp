// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <concepts>

#include "traceur/body/character.hpp"

namespace traceur::sim {

/// A physics engine that holds any number of independent copies ("lanes") of one character. Everything that learns or
/// controls is written against this concept.
///
/// Laws: after `reset(lane, q, v)` the lane is at pose q and velocity v (layouts of body::Skeleton) with no memory of what
/// was before. `set_target(lane, q)` gives joint motors their target pose (root entries ignored), which holds until changed.
/// `step(n)` advances every lane by n x `dt()` seconds. `failed(lane)` tells that a lane stopped on a number that is not
/// finite. Lanes never influence one another, and the same calls give the same bits.
template <class W>
concept Simulator = requires(W w, const W c, int lane, int n, const Eigen::VectorXd& q, Eigen::VectorXd& out) {
  { c.lanes() } -> std::convertible_to<int>;
  { c.character() } -> std::convertible_to<const body::Character&>;
  { c.dt() } -> std::convertible_to<double>;
  w.reset(lane, q, q);
  w.set_target(lane, q);
  w.step(n);
  c.pose(lane, out);
  c.velocity(lane, out);
  { c.failed(lane) } -> std::convertible_to<bool>;
};

}  // namespace traceur::sim
