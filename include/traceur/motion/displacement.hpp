// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "traceur/motion/time_warp.hpp"

namespace traceur::motion {

/// m (+) d as in Lee et al. 2021, Eq. 2: root position p + d[0..2] (world axes), every rotation q exp(d), the root's too.
/// Only the root's rotation differs from body::displace, which displaces it in world axes. `out` may be `q`.
template <class S, class P>
inline void displace_local(const body::Skeleton& skeleton, const P* q, const S* d, S* out) {
  using core::Quaternion;
  if (!skeleton.free_root()) return body::displace(skeleton, q, d, out);
  const Quaternion<S> root = Quaternion<S>::from(q + 3) * exp_map(core::Vector3<S>::from(d + 3));
  body::displace(skeleton, q, d, out);
  root.store(out + 3);
}

/// The d with a (+) d = b in the sense of displace_local, the shorter way round at every joint. `out` has nv numbers.
template <class S>
inline void difference_local(const body::Skeleton& skeleton, const S* a, const S* b, S* out) {
  using core::Quaternion;
  body::difference(skeleton, a, b, out);
  if (skeleton.free_root())
    log_map(Quaternion<S>::from(a + 3).conjugate() * Quaternion<S>::from(b + 3)).store(out + 3);
}

/// A motion displacement map d(phi) (Lee et al. 2021, s3): tangent vectors in the layout of velocities (m, rad) at keys of
/// reference time, linear in between, held beyond the ends. `S`: `double`, or a dual number.
template <class S = double>
struct Displacement {
  Eigen::VectorXd times;                                     ///< s, strictly increasing, at least one
  Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> values;  ///< nv x keys

  /// d at reference time phi (s); `out` has nv numbers.
  void sample(const S& phi, S* out) const {
    const Eigen::Index n = times.size();
    const double at = core::plain(phi);
    Eigen::Index k = 0;
    S share(0.0);
    if (n > 1) {
      const double* upper = std::upper_bound(times.data() + 1, times.data() + n - 1, at);
      k = upper - times.data() - 1;
      const double length = times[k + 1] - times[k];
      if (at > times[n - 1]) {
        share = S(1.0);
      } else if (!(at < times[0])) {
        share = (phi - S(times[k])) / S(length);
      }
    }
    const Eigen::Index next = n > 1 ? k + 1 : k;
    for (Eigen::Index i = 0; i < values.rows(); ++i) out[i] = values(i, k) + share * (values(i, next) - values(i, k));
  }

  /// Throws Error that begins with `where` and names the key at fault: no key, times that do not increase, a wrong number
  /// of rows for the skeleton, a number that is not finite.
  void check(const body::Skeleton& skeleton, const std::string& where) const {
    if (times.size() == 0 || values.cols() != times.size())
      throw Error(where + ": displacement: expected as many displacements as times, at least one");
    if (values.rows() != skeleton.nv())
      throw Error(where + ": displacement: expected " + std::to_string(skeleton.nv()) + " rows, found " +
                  std::to_string(values.rows()));
    for (Eigen::Index k = 0; k < times.size(); ++k) {
      bool good = std::isfinite(times[k]) && (k == 0 || times[k] > times[k - 1]);
      for (Eigen::Index i = 0; i < values.rows(); ++i) good = good && std::isfinite(core::plain(values(i, k)));
      if (!good)
        throw Error(where + ": displacement, frame " + std::to_string(k) + ": expected finite numbers and increasing times");
    }
  }
};

/// The pose (m_0 (+) d)(phi) exactly, at any phi and for any scalar; a cyclic clip is displaced within its cycle, then
/// carried on. `out` has nq numbers, `scratch` nv. Allocates nothing.
template <class S>
inline void sample_displaced(const Clip& clip, const Displacement<S>& d, const S& phi, S* out, S* scratch) {
  const double cycles = clip.cyclic ? std::floor(core::plain(phi) / clip.duration()) : 0.0;
  const S within = phi - S(cycles * clip.duration());
  clip.sample_within(within, out);
  d.sample(within, scratch);
  displace_local(clip.skeleton, out, scratch, out);
  if (cycles != 0) clip.carry_root(cycles, out);
}

/// The clip m_0 (+) d (Lee et al. 2021, Eq. 2) with keys at those of both; between keys it interpolates. A cyclic clip stays
/// cyclic, which makes sense if d ends as it begins. Contact labels are kept. Throws Error if d does not fit the skeleton.
inline Clip displaced(const Clip& clip, const Displacement<double>& d) {
  d.check(clip.skeleton, detail::where(clip));
  std::vector<double> times(clip.times.data(), clip.times.data() + clip.keys());
  times.insert(times.end(), d.times.data(), d.times.data() + d.times.size());
  const Eigen::VectorXd keys = detail::key_times(std::move(times), clip.duration());
  Clip out = detail::sampled(clip, keys, keys, false);
  out.cyclic = clip.cyclic;
  Eigen::VectorXd at(clip.skeleton.nv());
  for (int k = 0; k < out.keys(); ++k) {
    d.sample(keys[k], at.data());
    displace_local(clip.skeleton, out.poses.col(k).data(), at.data(), out.poses.col(k).data());
  }
  return out;
}

/// The displacement that leads from one clip to another of the same joints and duration: displaced(from, d) shows `to` at
/// the keys of both. Throws Error if joints or durations differ.
inline Displacement<double> displacement_between(const Clip& from, const Clip& to) {
  detail::require_same_skeleton(from, to);
  if (std::abs(from.duration() - to.duration()) > 1e-9 * from.duration())
    throw Error(detail::where(from) + " and " + detail::where(to) + ": expected the same duration");
  std::vector<double> times(from.times.data(), from.times.data() + from.keys());
  times.insert(times.end(), to.times.data(), to.times.data() + to.keys());
  Displacement<double> d;
  d.times = detail::key_times(std::move(times), from.duration());
  d.values.resize(from.skeleton.nv(), d.times.size());
  Eigen::VectorXd a(from.skeleton.nq()), b(from.skeleton.nq());
  for (Eigen::Index k = 0; k < d.times.size(); ++k) {
    from.sample_within(d.times[k], a.data());
    to.sample_within(d.times[k], b.data());
    difference_local(from.skeleton, a.data(), b.data(), d.values.col(k).data());
  }
  return d;
}

/// What an episode did to a clip: the displacement from the clip at reference times `phases` (increasing, s) to the poses
/// reached there (nq x phases). The episode's root must have been aligned to the clip's (Lee et al. 2021, s5.1); see
/// align.hpp. Throws Error on sizes that do not match or phases that do not increase.
inline Displacement<double> displacement_trace(const Clip& clip, const Eigen::VectorXd& phases, const Eigen::MatrixXd& poses) {
  if (poses.rows() != clip.skeleton.nq() || poses.cols() != phases.size())
    throw Error(detail::where(clip) + ": displacement trace: expected one pose of " + std::to_string(clip.skeleton.nq()) +
                " numbers for each phase");
  Displacement<double> d{phases, Eigen::MatrixXd(clip.skeleton.nv(), phases.size())};
  Eigen::VectorXd a(clip.skeleton.nq());
  for (Eigen::Index k = 0; k < phases.size(); ++k) {
    clip.sample(phases[k], a.data());
    difference_local(clip.skeleton, a.data(), poses.col(k).data(), d.values.col(k).data());
  }
  d.check(clip.skeleton, detail::where(clip));
  return d;
}

/// A variant of a clip, m_a(t) = (m_0 (+) d)(phi(t)) (Lee et al. 2021, Eq. 1).
inline Clip variant(const Clip& clip, const Displacement<double>& d, const TimeWarp<double>& w) {
  return warp(displaced(clip, d), w);
}

}  // namespace traceur::motion
