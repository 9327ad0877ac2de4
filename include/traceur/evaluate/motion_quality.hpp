// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "traceur/core/error.hpp"
#include "traceur/core/vector3.hpp"
#include "traceur/evaluate/confidence.hpp"
#include "traceur/terrain/height_grid.hpp"
#include "traceur/terrain/signed_distance.hpp"

namespace traceur::evaluate {

/// Positions of n points over time, world, m: 3n x frames, point k in rows 3k to 3k + 2.
template <class T>
using Tracks = Eigen::Ref<const Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>>;

/// The largest jerk of a joint in PARC's motion capture, m/s^3 (s7.2): above it a frame counts as one of high jerk.
inline constexpr double parc_jerk_limit = 11666;

namespace detail {

inline void require_tracks(Eigen::Index rows, const char* what) {
  if (rows == 0 || rows % 3 != 0)
    throw Error(std::string(what) + ": expected three rows for each point, found " + std::to_string(rows));
}

}  // namespace detail

/// FWD: how far the root ends from the end of its path, horizontally, m (PARC s7.2, which does not say whether height
/// counts: way points lie on the ground and the root a body's height above, so here it does not).
template <std::floating_point T>
inline T final_waypoint_distance(const core::Vector3<T>& last_root, const core::Vector3<T>& target) {
  return std::hypot(last_root.x - target.x, last_root.y - target.y);
}

/// Where the root got to, horizontally, m: the last place less the first (PARC Figure 6 shows its distribution). `root`
/// is 3 x frames.
template <std::floating_point T>
inline core::Vector3<T> net_displacement(const Tracks<T>& root) {
  if (root.rows() != 3 || root.cols() == 0) throw Error("net displacement: expected three rows and at least one frame");
  const Eigen::Index last = root.cols() - 1;
  return {root(0, last) - root(0, 0), root(1, last) - root(1, 0), T(0)};
}

/// TPL: the depths of all surface points below the ground, summed over points and frames, m (PARC Eq. 7). Throws Error
/// if the rows are no points. `points` is 3P x frames.
template <std::floating_point T>
inline T penetration_loss(const terrain::HeightGrid& grid, const Tracks<T>& points) {
  detail::require_tracks(points.rows(), "penetration loss");
  T sum = 0;
  for (Eigen::Index t = 0; t < points.cols(); ++t)
    for (Eigen::Index k = 0; k < points.rows(); k += 3) {
      const core::Vector3<T> p{points(k, t), points(k + 1, t), points(k + 2, t)};
      // High above the highest cell there is nothing to look for; a NaN is not above.
      if (p.z > grid.table<T>().highest) continue;
      const T d = terrain::signed_distance(grid, p);
      if (!(d >= 0)) sum -= d;
    }
  return sum;
}

/// TCL: for each body that is to touch, the distance of its nearest surface point from the ground, either side,
/// weighted by its contact label and summed over bodies and frames, m (PARC Eq. 8).
///
/// `body_of_point` has P numbers of bodies, `labels` is bodies x frames. Throws Error if sizes do not match or a body
/// has a label but no point.
template <std::floating_point T>
inline T contact_loss(const terrain::HeightGrid& grid, const Tracks<T>& points, std::span<const int> body_of_point,
                      const Tracks<T>& labels) {
  detail::require_tracks(points.rows(), "contact loss");
  if (static_cast<std::size_t>(points.rows()) != 3 * body_of_point.size())
    throw Error("contact loss: expected a body for each point");
  if (labels.cols() != points.cols()) throw Error("contact loss: expected labels for each frame");
  for (const int b : body_of_point)
    if (b < 0 || b >= labels.rows())
      throw Error("contact loss: a point names body " + std::to_string(b) + ", which has no label");
  constexpr T none = std::numeric_limits<T>::infinity();
  std::vector<T> nearest(static_cast<std::size_t>(labels.rows()));
  T sum = 0;
  for (Eigen::Index t = 0; t < points.cols(); ++t) {
    std::fill(nearest.begin(), nearest.end(), none);
    for (std::size_t k = 0; k < body_of_point.size(); ++k) {
      const int b = body_of_point[k];
      if (labels(b, t) == 0) continue;
      const auto row = static_cast<Eigen::Index>(3 * k);
      const core::Vector3<T> p{points(row, t), points(row + 1, t), points(row + 2, t)};
      T& least = nearest[static_cast<std::size_t>(b)];
      const T d = std::abs(terrain::signed_distance(grid, p));
      if (!(d >= least)) least = d;
    }
    for (Eigen::Index b = 0; b < labels.rows(); ++b) {
      if (labels(b, t) == 0) continue;
      const T least = nearest[static_cast<std::size_t>(b)];
      if (least == none) throw Error("contact loss: body " + std::to_string(b) + " is to touch but has no point");
      sum += labels(b, t) * least;
    }
  }
  return sum;
}

/// Size of the jerk of every point by the third difference of its positions, m/s^3: points x (frames - 3), column t
/// from frames t to t + 3. `dt` is the time between frames, s. Throws Error on fewer than four frames or a dt that is
/// not positive.
template <std::floating_point T>
inline Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic> jerks(const Tracks<T>& joints, T dt) {
  detail::require_tracks(joints.rows(), "jerk");
  if (joints.cols() < 4) throw Error("jerk: expected at least four frames");
  if (!(dt > 0)) throw Error("jerk: expected a positive time between frames");
  Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic> out(joints.rows() / 3, joints.cols() - 3);
  for (Eigen::Index t = 0; t < out.cols(); ++t)
    for (Eigen::Index k = 0; k < out.rows(); ++k) {
      const auto p = [&](Eigen::Index later) { return joints.col(t + later).template segment<3>(3 * k); };
      // Grouped so that points at rest have none, whatever their coordinates.
      out(k, t) = ((p(3) - p(0)) - 3 * (p(2) - p(1))).norm() / (dt * dt * dt);
    }
  return out;
}

/// %HJF over 100: the share of frames with a joint above the jerk limit (PARC s7.2), of the frames for which there is a
/// jerk. A jerk that is not a number counts as high.
template <std::floating_point T>
inline T high_jerk_share(const Tracks<T>& joints, T dt, T limit = T(parc_jerk_limit)) {
  const auto size = jerks<T>(joints, dt);
  Eigen::Index high = 0;
  for (Eigen::Index t = 0; t < size.cols(); ++t) high += (size.col(t).array() <= limit).all() ? 0 : 1;
  return static_cast<T>(high) / static_cast<T>(size.cols());
}

/// Distance of joints from where a reference has them, mean over joints and frames, m (PARC Table 2). Throws Error if
/// the two differ in size.
template <std::floating_point T>
inline T mean_joint_error(const Tracks<T>& joints, const Tracks<T>& reference) {
  detail::require_tracks(joints.rows(), "joint error");
  if (joints.rows() != reference.rows() || joints.cols() != reference.cols() || joints.cols() == 0)
    throw Error("joint error: expected two motions of the same joints and frames, at least one");
  T sum = 0;
  for (Eigen::Index t = 0; t < joints.cols(); ++t)
    for (Eigen::Index k = 0; k < joints.rows(); k += 3)
      sum += (joints.col(t).template segment<3>(k) - reference.col(t).template segment<3>(k)).norm();
  return sum / (static_cast<T>(joints.rows() / 3) * static_cast<T>(joints.cols()));
}

/// The numbers of PARC's Tables 1 and 3 for one motion.
struct MotionQuality {
  double final_waypoint_distance_m = 0;
  double penetration_loss_m = 0;
  double contact_loss_m = 0;
  double high_jerk_share = 0;
};

/// The same over many motions: means with bootstrap intervals.
struct MotionQualitySummary {
  Interval final_waypoint_distance_m, penetration_loss_m, contact_loss_m, high_jerk_share;
};

/// Throws Error without motions or on a number that is not finite.
inline MotionQualitySummary summarize(std::span<const MotionQuality> motions, const Bootstrap& p = {}) {
  std::vector<double> values(motions.size());
  const auto of = [&](double MotionQuality::*number) {
    for (std::size_t k = 0; k < motions.size(); ++k) values[k] = motions[k].*number;
    return mean_interval(values, p);
  };
  return {of(&MotionQuality::final_waypoint_distance_m), of(&MotionQuality::penetration_loss_m),
          of(&MotionQuality::contact_loss_m), of(&MotionQuality::high_jerk_share)};
}

}  // namespace traceur::evaluate
