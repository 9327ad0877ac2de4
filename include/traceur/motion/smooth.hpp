// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>

#include "traceur/motion/clip.hpp"

namespace traceur::motion {

/// The clip smoothed in time by a Gaussian of standard deviation `sigma` (s), cut at 3 sigma: at every key the poses around
/// it are averaged as tangent vectors, root included. Constant velocities, linear or angular, are left unchanged; a joint
/// angle oscillating at w rad/s keeps close to the share exp(-(w sigma)^2 / 2) of its amplitude.
///
/// A cyclic clip is smoothed across its seam and stays closed if it was. Otherwise the motion is continued beyond each end by
/// its own reflection through the end pose, which keeps that pose and its velocity. Throws Error unless sigma is positive
/// and finite.
inline Clip smooth(const Clip& clip, double sigma) {
  if (!(sigma > 0) || !std::isfinite(sigma)) throw Error(detail::where(clip) + ": smooth: expected a positive width");
  constexpr int half = 24;
  constexpr double reach = 3.0;
  const body::Skeleton& skeleton = clip.skeleton;
  const double duration = clip.duration();
  Eigen::VectorXd q(skeleton.nq()), d(skeleton.nv()), sum(skeleton.nv());
  const auto around = [&](double phi) {
    if (clip.cyclic) return clip.sample(phi, q.data());
    if (phi >= 0 && phi <= duration) return clip.sample_within(phi, q.data());
    const auto end = clip.poses.col(phi < 0 ? 0 : clip.keys() - 1);
    clip.sample_within(phi < 0 ? -phi : 2 * duration - phi, q.data());
    body::difference(skeleton, q.data(), end.data(), d.data());
    body::displace(skeleton, end.data(), d.data(), q.data());
  };
  Clip out = clip;
  for (int k = 0; k < clip.keys(); ++k) {
    sum.setZero();
    double weights = 0;
    for (int j = -half; j <= half; ++j) {
      const double offset = reach * j / half, weight = std::exp(-0.5 * offset * offset);
      around(clip.times[k] + sigma * offset);
      body::difference(skeleton, clip.poses.col(k).data(), q.data(), d.data());
      sum += weight * d;
      weights += weight;
    }
    sum /= weights;
    body::displace(skeleton, clip.poses.col(k).data(), sum.data(), out.poses.col(k).data());
    body::normalize(skeleton, out.poses.col(k).data());
  }
  return out;
}

}  // namespace traceur::motion
