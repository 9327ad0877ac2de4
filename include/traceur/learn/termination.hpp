// SPDX-License-Identifier: MIT
#pragma once

#include <limits>
#include <numbers>
#include <span>
#include <vector>

#include "traceur/learn/tracking_error.hpp"

namespace traceur::learn {

/// No limit: for joints that are exempt.
inline constexpr double no_limit = std::numeric_limits<double>::infinity();

/// Whether any joint is further from its place in the reference than its limit (m, one a joint). A lane whose place is not
/// a number counts as beyond.
template <class S>
core::MaskOf<S> strayed(const TrackingState<S>& state, const TrackingState<S>& reference, std::span<const double> limit) {
  core::MaskOf<S> within = S(0.0) <= S(0.0);
  for (std::size_t b = 0; b < limit.size(); ++b) {
    if (limit[b] == no_limit) continue;
    within = within & (squared_norm(state.frames.position[b] - reference.frames.position[b]) <= S(limit[b] * limit[b]));
  }
  return !within;
}

/// The limits of PARC, appendix F.1: 0.7 m for every joint, feet exempt.
inline std::vector<double> parc_limits(const body::Skeleton& skeleton, std::span<const int> feet) {
  std::vector<double> limit(static_cast<std::size_t>(skeleton.size()), 0.7);
  for (const int f : feet) limit[static_cast<std::size_t>(f)] = no_limit;
  return limit;
}

/// The limits of HIL, section 6.3, for tracking: 0.5 m for every joint.
inline std::vector<double> hil_limits(const body::Skeleton& skeleton) {
  return std::vector<double>(static_cast<std::size_t>(skeleton.size()), 0.5);
}

/// How far the root may leave the reference before an episode ends.
struct RootLimits {
  double distance = no_limit;  ///< m
  double angle = no_limit;     ///< rad
  double lowest = -no_limit;   ///< height, m
  double highest = no_limit;   ///< height, m

  /// Lee et al.'s released code; the paper has no such rule.
  static RootLimits lee() { return {0.8, 0.4 * std::numbers::pi, 0.1, 4.0}; }
  /// PARC's released code, beside its joint limits.
  static RootLimits parc_code() { return {0.6, 75 * std::numbers::pi / 180, -no_limit, no_limit}; }
};

/// Whether the root is beyond its limits; not being a number counts as beyond.
template <class S>
core::MaskOf<S> root_strayed(const TrackingState<S>& state, const TrackingState<S>& reference, const RootLimits& limits) {
  const RootError<S> error(state, reference);
  const S height = state.frames.position[0].z;
  const auto within = (error.position <= S(limits.distance * limits.distance)) &
                      (error.rotation <= S(limits.angle * limits.angle)) & (S(limits.lowest) <= height) &
                      (height <= S(limits.highest));
  return !within;
}

/// A fall: a body touches the ground that must not. One entry a body in both.
inline bool fell(std::span<const unsigned char> touches, std::span<const unsigned char> may_touch) noexcept {
  for (std::size_t b = 0; b < touches.size(); ++b)
    if (touches[b] != 0 && (b >= may_touch.size() || may_touch[b] == 0)) return true;
  return false;
}

/// HIL's parkour rule, section 6.3: the target is missed by more than 2 m. The paper does not say when it counts as missed;
/// here, once the root is that much further from it than it has been before.
inline bool missed_target(double distance, double least_distance, double limit = 2.0) noexcept {
  return !(distance - least_distance <= limit);
}

/// HIL's heading rule, section 6.3: the head is below 0.3 m.
inline bool head_down(double head_height, double limit = 0.3) noexcept { return !(head_height >= limit); }

}  // namespace traceur::learn
