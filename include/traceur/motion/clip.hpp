// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <string>
#include <type_traits>
#include <vector>

#include "traceur/body/pose.hpp"

namespace traceur::motion {

/// A motion of one skeleton: poses at keys, in between a piecewise linear function of reference time (Lee et al. 2021, s3).
///
/// Beyond its ends a clip that is not cyclic holds its first and last pose; a cyclic clip goes on, its root carried along by
/// the cycle's change of horizontal position and heading. The last key of a cyclic clip is the first of the next cycle.
struct Clip {
  std::string name;
  body::Skeleton skeleton;
  Eigen::VectorXd times;     ///< reference time of each key, s; times[0] = 0, strictly increasing, at least two
  Eigen::MatrixXd poses;     ///< nq x keys
  Eigen::MatrixXd contacts;  ///< contact label in [0, 1] of each body at each key, bodies x keys; may have no columns
  bool cyclic = false;

  int keys() const { return static_cast<int>(times.size()); }
  double duration() const { return times[times.size() - 1]; }

  /// Throws Error that names the clip and the key at fault: fewer than two keys, times that do not increase, a wrong number
  /// of rows, a number that is not finite, a quaternion that is not unit, a contact label outside [0, 1].
  void check() const {
    const std::string where = "clip '" + name + "'";
    if (keys() < 2) throw Error(where + ": expected at least two frames, found " + std::to_string(keys()));
    if (poses.cols() != keys())
      throw Error(where + ": expected " + std::to_string(keys()) + " poses, found " + std::to_string(poses.cols()));
    if (contacts.cols() != 0 && (contacts.cols() != keys() || contacts.rows() != skeleton.size()))
      throw Error(where + ": contact labels do not match its bodies and frames");
    if (times[0] != 0) throw Error(where + ": expected the first frame at time 0");
    for (int k = 0; k < keys(); ++k) {
      const std::string frame = where + ", frame " + std::to_string(k);
      if (k > 0 && !(times[k] > times[k - 1])) throw Error(frame + ": expected a time after the frame before");
      if (!std::isfinite(times[k])) throw Error(frame + ": time is not finite");
      body::check_pose(skeleton, poses.col(k), frame);
      for (int b = 0; contacts.cols() != 0 && b < skeleton.size(); ++b)
        if (!(contacts(b, k) >= 0 && contacts(b, k) <= 1))
          throw Error(frame + ": body '" + skeleton[b].body + "': expected a contact label in [0, 1]");
    }
  }

  /// The key interval that holds reference time phi in [0, duration]: index of its first key and the share passed.
  struct Place {
    int key;
    double share;
  };
  Place place(double phi) const {
    const auto* begin = times.data();
    const auto* end = begin + times.size();
    const auto upper = std::upper_bound(begin + 1, end - 1, phi);
    const int key = static_cast<int>(upper - begin) - 1;
    const double share = (phi - times[key]) / (times[key + 1] - times[key]);
    return {key, std::clamp(share, 0.0, 1.0)};
  }

  /// The pose at reference time phi (s), limited to [0, duration], whether cyclic or not; `out` has nq numbers. A dual phi
  /// carries its derivative, except beyond the ends.
  template <class S>
  void sample_within(const std::type_identity_t<S>& phi, S* out) const {
    const Place at = place(core::plain(phi));
    const double begin = times[at.key], length = times[at.key + 1] - begin;
    const S share = at.share > 0 && at.share < 1 ? S((phi - S(begin)) / S(length)) : share_at_edge<S>(phi, at, begin, length);
    body::interpolate(skeleton, poses.col(at.key).data(), poses.col(at.key + 1).data(), share, out);
  }

  /// The pose at reference time phi (s), any real number, into `out` (nq numbers).
  template <class S>
  void sample(const std::type_identity_t<S>& phi, S* out) const {
    const double cycles = cyclic ? std::floor(core::plain(phi) / duration()) : 0.0;
    sample_within(cycles == 0 ? phi : S(phi - S(cycles * duration())), out);
    if (cycles != 0) carry_root(cycles, out);
  }
  void sample(double phi, Eigen::Ref<Eigen::VectorXd> out) const { sample(phi, out.data()); }
  Eigen::VectorXd sample(double phi) const {
    Eigen::VectorXd q(skeleton.nq());
    sample(phi, q.data());
    return q;
  }

  /// Contact labels at reference time phi (s), linear between keys, one number per body. The clip must have labels.
  void sample_contacts(double phi, Eigen::Ref<Eigen::VectorXd> out) const {
    const Place at = place(cyclic ? phi - std::floor(phi / duration()) * duration() : phi);
    out = (1 - at.share) * contacts.col(at.key) + at.share * contacts.col(at.key + 1);
  }

  /// The velocity at reference time phi (nv numbers) by central difference over 2 `half_step` seconds, one-sided at the
  /// ends of a clip that is not cyclic. Body-fixed for balls, world for the root, as in body::Skeleton.
  Eigen::VectorXd velocity(double phi, double half_step = 1.0 / 120) const {
    Eigen::VectorXd v(skeleton.nv()), before(skeleton.nq()), after(skeleton.nq());
    velocity(phi, half_step, v, before, after);
    return v;
  }

  /// The same without allocation: `out` has nv numbers; `before` and `after` are scratch of nq numbers each and hold the
  /// two poses compared afterwards.
  void velocity(double phi, double half_step, Eigen::Ref<Eigen::VectorXd> out, Eigen::Ref<Eigen::VectorXd> before,
                Eigen::Ref<Eigen::VectorXd> after) const {
    double a = phi - half_step, b = phi + half_step;
    if (!cyclic) {
      a = std::clamp(a, 0.0, duration());
      b = std::clamp(b, 0.0, duration());
    }
    sample(a, before.data());
    sample(b, after.data());
    if (!(b > a)) {
      out.setZero();
      return;
    }
    body::difference(skeleton, before.data(), after.data(), out.data());
    out /= b - a;
  }

  /// Moves a pose of the first cycle to the cycle `cycles` later (earlier if negative): the root's horizontal position and
  /// heading change by the same rigid motion from one cycle to the next. Leaves a fixed root alone. `q` has nq numbers.
  template <class S>
  void carry_root(double cycles, S* q) const {
    using core::Quaternion;
    using core::Vector3;
    if (!skeleton.free_root()) return;
    const Vector3<double> up{0, 0, 1};
    const auto end = poses.col(keys() - 1);
    const Vector3<double> p0{poses(0, 0), poses(1, 0), 0}, p1{end[0], end[1], 0};
    const Quaternion<double> h0 = core::heading(Quaternion<double>::from(poses.col(0).data() + 3));
    const Quaternion<double> h1 = core::heading(Quaternion<double>::from(end.data() + 3));
    const double angle = core::twist_angle(h1 * h0.conjugate(), up);
    // One cycle maps p to R p + t; n of them to R^n p + (1 + R + ... + R^(n-1)) t. The geometric sum is the turn by
    // (n - 1) / 2 angles times sin(n angle / 2) / sin(angle / 2), for negative n as well.
    const Vector3<double> t = p1 - core::about_axis(up, angle).rotate(p0);
    const double s = std::sin(0.5 * angle);
    const double sum = s == 0 ? cycles : std::sin(0.5 * cycles * angle) / s;
    const Quaternion<double> turn = core::about_axis(up, cycles * angle);
    const Vector3<double> shift = sum * core::about_axis(up, 0.5 * (cycles - 1) * angle).rotate(t);
    (turn.cast<S>().rotate(Vector3<S>::from(q)) + shift.cast<S>()).store(q);
    (turn.cast<S>() * Quaternion<S>::from(q + 3)).store(q + 3);
  }
  void carry_root(double cycles, Eigen::Ref<Eigen::VectorXd> q) const { carry_root(cycles, q.data()); }

 private:
  // At a key the derivative is that of the interval that begins there; beyond the ends the pose is held.
  template <class S>
  S share_at_edge(const S& phi, const Place& at, double begin, double length) const {
    const double plain = core::plain(phi);
    if (plain < 0 || plain > duration()) return S(at.share);
    return S((phi - S(begin)) / S(length));
  }
};

namespace detail {

inline std::string where(const Clip& clip) { return "clip '" + clip.name + "'"; }

/// Throws Error unless both clips move skeletons with the same joints.
inline void require_same_skeleton(const Clip& a, const Clip& b) {
  bool same = a.skeleton.size() == b.skeleton.size();
  for (int i = 0; same && i < a.skeleton.size(); ++i) {
    const body::Joint &ja = a.skeleton[i], &jb = b.skeleton[i];
    same = ja.name == jb.name && ja.type == jb.type && ja.parent == jb.parent;
  }
  if (!same) throw Error(where(a) + " and " + where(b) + ": expected the same joints");
}

inline void require_free_root(const Clip& clip) {
  if (!clip.skeleton.free_root()) throw Error(where(clip) + ": expected a skeleton with a free root");
}

/// Sorted times in [0, duration] without near-duplicates; the first is 0 and the last `duration`.
inline Eigen::VectorXd key_times(std::vector<double> times, double duration) {
  const double tolerance = 1e-9 * duration;
  times.push_back(0.0);
  std::sort(times.begin(), times.end());
  std::vector<double> kept{0.0};
  for (const double t : times)
    if (t > kept.back() + tolerance && t < duration - tolerance) kept.push_back(t);
  kept.push_back(duration);
  return Eigen::Map<const Eigen::VectorXd>(kept.data(), static_cast<Eigen::Index>(kept.size()));
}

/// A clip with keys at `times` that shows `clip` at `phases` (both as long). With `wrap` a cyclic clip goes on beyond its
/// ends; without, phases are limited to [0, duration]. The result is not cyclic.
inline Clip sampled(const Clip& clip, const Eigen::VectorXd& times, const Eigen::VectorXd& phases, bool wrap) {
  Clip out{clip.name, clip.skeleton, times, Eigen::MatrixXd(clip.skeleton.nq(), times.size()), Eigen::MatrixXd(), false};
  if (clip.contacts.cols() != 0) out.contacts.resize(clip.skeleton.size(), times.size());
  for (Eigen::Index k = 0; k < times.size(); ++k) {
    if (wrap) {
      clip.sample(phases[k], out.poses.col(k));
    } else {
      clip.sample_within(phases[k], out.poses.col(k).data());
    }
    if (out.contacts.cols() == 0) continue;
    const bool last = !wrap && phases[k] >= clip.duration();
    if (last) out.contacts.col(k) = clip.contacts.col(clip.keys() - 1);
    if (!last) clip.sample_contacts(phases[k], out.contacts.col(k));
  }
  return out;
}

}  // namespace detail

/// The part of a clip between two reference times (s), its own time starting at 0; keeps the keys inside. A cyclic clip may
/// be cut anywhere; of others 0 <= from < to <= duration. The result is not cyclic. Throws Error on an empty interval or one
/// that leaves the clip.
inline Clip cut(const Clip& clip, double from, double to) {
  if (!(std::isfinite(from) && std::isfinite(to) && from < to))
    throw Error(detail::where(clip) + ": cut: expected an interval of finite, positive length");
  const double slack = 1e-9 * clip.duration();
  const bool inside = from >= -slack && to <= clip.duration() + slack;
  if (!clip.cyclic && !inside)
    throw Error(detail::where(clip) + ": cut: expected an interval within 0 and " + std::to_string(clip.duration()) + " s");
  std::vector<double> times;
  const int first = inside ? 0 : static_cast<int>(std::floor(from / clip.duration()));
  const int last = inside ? 0 : static_cast<int>(std::floor(to / clip.duration()));
  for (int cycle = first; cycle <= last; ++cycle)
    for (int k = 0; k < clip.keys(); ++k) {
      const double t = clip.times[k] + cycle * clip.duration() - from;
      if (t > 0 && t < to - from) times.push_back(t);
    }
  const Eigen::VectorXd keys = detail::key_times(std::move(times), to - from);
  return detail::sampled(clip, keys, (keys.array() + from).matrix(), !inside);
}

/// A clip with its keys evenly spaced, as near to `fps` frames per second as its duration allows; first and last pose are
/// kept. Throws Error unless fps is positive and finite.
inline Clip resample(const Clip& clip, double fps) {
  if (!(fps > 0) || !std::isfinite(fps)) throw Error(detail::where(clip) + ": resample: expected a positive frame rate");
  const auto steps = static_cast<Eigen::Index>(std::max(1.0, std::round(clip.duration() * fps)));
  const Eigen::VectorXd times = Eigen::VectorXd::LinSpaced(steps + 1, 0.0, clip.duration());
  Clip out = detail::sampled(clip, times, times, false);
  out.cyclic = clip.cyclic;
  return out;
}

}  // namespace traceur::motion
