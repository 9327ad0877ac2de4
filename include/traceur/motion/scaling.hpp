// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "traceur/motion/clip.hpp"

namespace traceur::motion {

/// What scale_amplitude takes as the middle of a motion, beyond the means it finds itself.
struct AmplitudeScaling {
  /// Root rotation that counts as zero. The paper uses the identity, in favour of an upright trunk, for a clip that heads
  /// for +x with a root frame that is upright when unturned; other clips name their own.
  core::Quaternion<double> upright = core::Quaternion<double>::identity();
  /// Whether the horizontal path shrinks too, measured from its start. It must for root velocity to scale (Eq. 6).
  bool travel = true;
};

namespace detail {

/// Share of a clip's time that each key stands for under linear interpolation; sums to 1.
inline Eigen::VectorXd time_weights(const Eigen::VectorXd& times) {
  Eigen::VectorXd w = Eigen::VectorXd::Zero(times.size());
  const double duration = times[times.size() - 1] - times[0];
  for (Eigen::Index k = 0; k + 1 < times.size(); ++k) {
    const double half = 0.5 * (times[k + 1] - times[k]) / duration;
    w[k] += half;
    w[k + 1] += half;
  }
  return w;
}

}  // namespace detail

/// The pose whose tangent vectors to the keys average to zero, weighted by time: the mean of heights and angles, the
/// intrinsic mean of rotations. nq numbers.
inline Eigen::VectorXd mean_pose(const Clip& clip) {
  const Eigen::VectorXd weights = detail::time_weights(clip.times);
  Eigen::VectorXd mean = clip.poses.col(0), step(clip.skeleton.nv()), d(clip.skeleton.nv());
  for (int iteration = 0; iteration < 50; ++iteration) {
    step.setZero();
    for (int k = 0; k < clip.keys(); ++k) {
      body::difference(clip.skeleton, mean.data(), clip.poses.col(k).data(), d.data());
      step += weights[k] * d;
    }
    body::displace(clip.skeleton, mean.data(), step.data(), mean.data());
    if (step.size() == 0 || step.cwiseAbs().maxCoeff() < 1e-12) break;
  }
  body::normalize(clip.skeleton, mean.data());
  return mean;
}

/// The clip with the spatial extent of its motion scaled by alpha (Terrain Runner, Eq. 5 and 6): root height and joint
/// angles x <- alpha (x - mean) + mean; of a ball joint's rotation from its mean the angle is scaled and the axis kept; the
/// root's rotation is scaled from `upright`. Velocities then scale by alpha as well. Throws Error unless alpha is finite and
/// not negative.
inline Clip scale_amplitude(const Clip& clip, double alpha, const AmplitudeScaling& options = {}) {
  if (!(alpha >= 0) || !std::isfinite(alpha))
    throw Error(detail::where(clip) + ": scale_amplitude: expected a finite factor, zero or more");
  const body::Skeleton& skeleton = clip.skeleton;
  Eigen::VectorXd middle = mean_pose(clip), d(skeleton.nv());
  if (skeleton.free_root()) {
    options.upright.store(middle.data() + 3);
    middle.head(2) = clip.poses.col(0).head(2);
  }
  Clip out = clip;
  for (int k = 0; k < clip.keys(); ++k) {
    body::difference(skeleton, middle.data(), clip.poses.col(k).data(), d.data());
    d *= alpha;
    body::displace(skeleton, middle.data(), d.data(), out.poses.col(k).data());
    if (skeleton.free_root() && !options.travel) out.poses.col(k).head(2) = clip.poses.col(k).head(2);
  }
  return out;
}

/// The clip with its duration scaled by beta (Terrain Runner, s4.1.1): above 1 is slower. Throws Error unless beta is
/// positive and finite.
inline Clip scale_duration(const Clip& clip, double beta) {
  if (!(beta > 0) || !std::isfinite(beta)) throw Error(detail::where(clip) + ": scale_duration: expected a positive factor");
  Clip out = clip;
  out.times *= beta;
  return out;
}

}  // namespace traceur::motion
