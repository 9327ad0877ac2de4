// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include "traceur/body/kinematics.hpp"
#include "traceur/motion/clip.hpp"

namespace traceur::motion {

/// When a motion counts as not getting on. Numbers of PARC's released code.
struct Hesitation {
  double distance = 0.15;  ///< m; between two poses: root of the sum of squares over the places of all bodies
  int shortest = 4;        ///< frames in a row
};

/// Keys at which the motion hesitates: it is back, within `distance`, where it was at an earlier key at which it was
/// getting on, and so for at least `shortest` keys in a row. Poses in between do not matter: whoever walks in a circle
/// and comes back to the same pose has gone nowhere either. Throws Error on a distance that is not positive.
inline std::vector<bool> hesitating_keys(const Clip& clip, const Hesitation& h = {}) {
  if (!(h.distance > 0) || h.shortest < 1)
    throw Error(detail::where(clip) + ": hesitation: expected a positive distance and at least one frame");
  const int keys = clip.keys();
  const int bodies = clip.skeleton.size();
  Eigen::MatrixXd places(3 * bodies, keys);
  body::Frames<double> frames(clip.skeleton);
  for (int k = 0; k < keys; ++k) {
    body::forward_kinematics(clip.skeleton, clip.poses.col(k).data(), frames);
    for (int b = 0; b < bodies; ++b)
      frames.position[static_cast<std::size_t>(b)].store(places.col(k).data() + 3 * static_cast<std::ptrdiff_t>(b));
  }
  std::vector<bool> near(static_cast<std::size_t>(keys), false);
  const double squared = h.distance * h.distance;
  for (int i = 0; i < keys; ++i) {
    if (near[static_cast<std::size_t>(i)]) continue;
    for (int j = i + 1; j < keys; ++j)
      if ((places.col(j) - places.col(i)).squaredNorm() < squared) near[static_cast<std::size_t>(j)] = true;
  }
  for (std::size_t k = 0; k < near.size();) {
    std::size_t end = k;
    while (end < near.size() && near[end] == near[k]) ++end;
    if (near[k] && end - k < static_cast<std::size_t>(h.shortest))
      for (std::size_t i = k; i < end; ++i) near[i] = false;
    k = end;
  }
  return near;
}

/// The clip without the keys at which it hesitates (PARC's released code, before its motions are corrected). Every kept
/// key comes as long after the kept one before as it came after its predecessor. Where keys were cut the motion jumps by
/// up to `distance`, which kinematic correction smooths. A clip of which fewer than two keys are left is returned as it is.
inline Clip without_hesitation(const Clip& clip, const Hesitation& h = {}) {
  const std::vector<bool> cut = hesitating_keys(clip, h);
  std::vector<int> kept;
  for (int k = 0; k < clip.keys(); ++k)
    if (!cut[static_cast<std::size_t>(k)]) kept.push_back(k);
  if (kept.size() < 2) return clip;
  const auto n = static_cast<Eigen::Index>(kept.size());
  Clip out{clip.name, clip.skeleton, Eigen::VectorXd::Zero(n), Eigen::MatrixXd(clip.poses.rows(), n),
           Eigen::MatrixXd(clip.contacts.rows(), clip.contacts.cols() == 0 ? 0 : n), clip.cyclic};
  for (Eigen::Index i = 0; i < n; ++i) {
    const int k = kept[static_cast<std::size_t>(i)];
    out.poses.col(i) = clip.poses.col(k);
    if (clip.contacts.cols() != 0) out.contacts.col(i) = clip.contacts.col(k);
    if (i > 0) out.times[i] = out.times[i - 1] + (clip.times[k] - clip.times[k - 1]);
  }
  return out;
}

}  // namespace traceur::motion
