// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "traceur/motion/align.hpp"

namespace traceur::motion {

/// 3u^2 - 2u^3 for u limited to [0, 1]: from 0 to 1 with no slope at either end.
template <class S>
inline S smoothstep(const S& u) {
  const S c = core::clamp(u, S(0.0), S(1.0));
  return c * c * (S(3.0) - S(2.0) * c);
}

/// When and how one clip passes into another.
struct Blend {
  double start = 0;       ///< time on the first clip at which the blend begins, s
  double duration = 0.3;  ///< of the blend, s; Terrain Runner, s5.3 takes one running step
  double phase = 0;       ///< time on the second clip when the blend begins, s
  bool align = true;      ///< move the second clip along the ground so that both roots agree in the middle of the blend
  core::Vector3<double> forward{1, 0, 0};  ///< facing direction in the root's frame, for `align`
};

/// The first clip until the blend begins, the second after it ends, in between their poses interpolated (slerp) with a
/// smoothstep weight: the reference blending of Terrain Runner, s5.3. Ends with the second clip's end, or after one of its
/// cycles if it is cyclic. Contact labels are blended if both have them. The result is not cyclic. Throws Error if the
/// joints differ, the blend has no length, or it begins outside a clip that is not cyclic.
inline Clip blend(const Clip& a, const Clip& b, const Blend& options) {
  const std::string where = detail::where(a) + " and " + detail::where(b) + ": blend: ";
  detail::require_same_skeleton(a, b);
  const Blend& o = options;
  if (!(o.duration > 0) || !std::isfinite(o.duration)) throw Error(where + "expected a positive duration");
  if (!(o.start >= 0) || !std::isfinite(o.start) || (!a.cyclic && o.start > a.duration()))
    throw Error(where + "expected it to begin within the first clip");
  if (!(o.phase >= 0) || !std::isfinite(o.phase) || (!b.cyclic && o.phase >= b.duration()))
    throw Error(where + "expected it to begin within the second clip");
  const double end = b.cyclic ? o.start + std::max(o.duration, b.duration())
                              : std::max(o.start + o.duration, o.start + b.duration() - o.phase);

  std::vector<double> times{o.start, o.start + o.duration};
  const auto add_keys = [&](const Clip& clip, double shift, double from, double to) {
    const double cycle = clip.duration();
    const int first = clip.cyclic ? static_cast<int>(std::floor((from - shift) / cycle)) : 0;
    const int last = clip.cyclic ? static_cast<int>(std::floor((to - shift) / cycle)) : 0;
    for (int c = first; c <= last; ++c)
      for (int k = 0; k < clip.keys(); ++k) {
        const double t = clip.times[k] + c * cycle + shift;
        if (t >= from && t <= to) times.push_back(t);
      }
  };
  add_keys(a, 0, 0, o.start + o.duration);
  add_keys(b, o.start - o.phase, o.start, end);
  // The weight is curved where the clips' keys are far apart; between these keys it is off by less than 0.002.
  const int steps = 20;
  for (int k = 1; k < steps; ++k) times.push_back(o.start + o.duration * k / steps);
  const Eigen::VectorXd keys = detail::key_times(std::move(times), end);

  const bool labels = a.contacts.cols() != 0 && b.contacts.cols() != 0;
  Clip out{a.name + "-" + b.name, a.skeleton, keys, Eigen::MatrixXd(a.skeleton.nq(), keys.size()), Eigen::MatrixXd(), false};
  if (labels) out.contacts.resize(a.skeleton.size(), keys.size());
  GroundTransform place;
  if (o.align && a.skeleton.free_root()) {
    const double half = 0.5 * o.duration;
    place = ground_frame(a.sample(o.start + half), o.forward) * ground_frame(b.sample(o.phase + half), o.forward).inverse();
  }
  Eigen::VectorXd qa(a.skeleton.nq()), qb(a.skeleton.nq()), ca(a.skeleton.size()), cb(a.skeleton.size());
  for (Eigen::Index k = 0; k < keys.size(); ++k) {
    const double weight = smoothstep((keys[k] - o.start) / o.duration), phi = keys[k] - o.start + o.phase;
    a.sample(keys[k], qa.data());
    b.sample(phi, qb.data());
    if (a.skeleton.free_root()) place.apply_root(qb);
    body::interpolate(a.skeleton, qa.data(), qb.data(), weight, out.poses.col(k).data());
    if (!labels) continue;
    a.sample_contacts(keys[k], ca);
    b.sample_contacts(phi, cb);
    out.contacts.col(k) = (1 - weight) * ca + weight * cb;
  }
  return out;
}

}  // namespace traceur::motion
