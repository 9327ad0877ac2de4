// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <limits>
#include <optional>
#include <vector>

#include "traceur/body/kinematics.hpp"
#include "traceur/motion/blend.hpp"
#include "traceur/motion/displacement.hpp"
#include "traceur/motion/mirror.hpp"

namespace traceur::motion {

/// How far the pose at the end of an interval is from that at its begin, both seen from the ground frame below their roots
/// (so travel and heading do not count).
struct CycleMisfit {
  double position_m = 0;    ///< largest distance between the places of a joint
  double velocity_m_s = 0;  ///< largest difference of a joint's velocities
  double joint_rad = 0;     ///< largest rotation of a joint below the root
  double tilt_rad = 0;      ///< rotation of the root (pitch and roll)
  double height_m = 0;      ///< change of root height
};

namespace detail {

/// Places (3 per joint, m) and, in the rows below, velocities (m/s) of all joints at reference time phi, in the ground frame
/// below the root. Never wraps; differences over `step` seconds to each side, one-sided at the clip's ends.
inline Eigen::VectorXd joint_features(const Clip& clip, double phi, double step) {
  const body::Skeleton& skeleton = clip.skeleton;
  const int n = skeleton.size();
  body::Frames<double> here(skeleton), before(skeleton), after(skeleton);
  Eigen::VectorXd q(skeleton.nq());
  const double a = std::max(0.0, phi - step), b = std::min(clip.duration(), phi + step);
  clip.sample_within(a, q.data());
  body::forward_kinematics(skeleton, q.data(), before);
  clip.sample_within(b, q.data());
  body::forward_kinematics(skeleton, q.data(), after);
  clip.sample_within(phi, q.data());
  body::forward_kinematics(skeleton, q.data(), here);
  const GroundTransform to_root = skeleton.free_root() ? ground_frame(q).inverse() : GroundTransform{};
  Eigen::VectorXd out(6 * n);
  for (int i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    to_root.apply(here.position[k]).store(out.data() + 3 * i);
    const core::Vector3<double> velocity = (1 / (b - a)) * (after.position[k] - before.position[k]);
    to_root.turn.rotate(velocity).store(out.data() + 3 * n + 3 * i);
  }
  return out;
}

inline double largest_distance(const Eigen::VectorXd& a, const Eigen::VectorXd& b, Eigen::Index first, Eigen::Index count) {
  double worst = 0;
  for (Eigen::Index i = first; i < first + count; i += 3) worst = std::max(worst, (a.segment(i, 3) - b.segment(i, 3)).norm());
  return worst;
}

}  // namespace detail

/// The misfit between two reference times of a clip, velocities by differences over `step` seconds. Throws Error unless
/// 0 <= from < to <= duration.
inline CycleMisfit cycle_misfit(const Clip& clip, double from, double to, double step = 1.0 / 60) {
  if (!(from >= 0 && from < to && to <= clip.duration()))
    throw Error(detail::where(clip) + ": cycle_misfit: expected an interval within the clip");
  const body::Skeleton& skeleton = clip.skeleton;
  const Eigen::VectorXd a = detail::joint_features(clip, from, step), b = detail::joint_features(clip, to, step);
  CycleMisfit out;
  const Eigen::Index n = 3 * skeleton.size();
  out.position_m = detail::largest_distance(a, b, 0, n);
  out.velocity_m_s = detail::largest_distance(a, b, n, n);
  Eigen::VectorXd qa(skeleton.nq()), qb(skeleton.nq()), d(skeleton.nv());
  clip.sample_within(from, qa.data());
  clip.sample_within(to, qb.data());
  if (skeleton.free_root()) {
    ground_frame(qa).inverse().apply_root(qa);
    ground_frame(qb).inverse().apply_root(qb);
  }
  body::difference(skeleton, qa.data(), qb.data(), d.data());
  for (const body::Joint& j : skeleton.joints()) {
    if (j.type == body::JointType::free) {
      out.height_m = std::abs(d[2]);
      out.tilt_rad = d.segment(3, 3).norm();
    } else if (j.type != body::JointType::fixed) {
      out.joint_rad = std::max(out.joint_rad, d.segment(j.v_index, body::velocity_size(j.type)).norm());
    }
  }
  return out;
}

/// Misfits up to which a clip's ends are close enough to be closed into a cycle.
struct CycleLimits {
  double position_m = 0.25;
  double velocity_m_s = 2.5;
  double joint_rad = 0.6;
  double tilt_rad = 0.3;
};

/// Whether the clip as a whole could be one cycle.
inline bool is_cyclic_candidate(const Clip& clip, const CycleLimits& limits = {}) {
  const CycleMisfit m = cycle_misfit(clip, 0, clip.duration());
  return m.position_m <= limits.position_m && m.velocity_m_s <= limits.velocity_m_s && m.joint_rad <= limits.joint_rad &&
         m.tilt_rad <= limits.tilt_rad;
}

/// A cyclic clip whose end meets its begin: joint rotations, root height, pitch and roll of the last key become those of the
/// first, and the misfit is spread by a smoothstep over the last `share` of the cycle. Horizontal travel and heading are the
/// cycle's own and stay. Throws Error unless share is in (0, 1].
inline Clip close_cycle(const Clip& clip, double share = 0.7) {
  if (!(share > 0 && share <= 1)) throw Error(detail::where(clip) + ": close_cycle: expected a share in (0, 1]");
  const body::Skeleton& skeleton = clip.skeleton;
  const int last = clip.keys() - 1;
  Clip out = clip;
  out.cyclic = true;
  Eigen::VectorXd target = clip.poses.col(0), misfit(skeleton.nv());
  clip.carry_root(1, target.data());
  difference_local(skeleton, clip.poses.col(last).data(), target.data(), misfit.data());
  for (int k = 1; k < last; ++k) {
    const Eigen::VectorXd d = smoothstep(1 - (1 - clip.times[k] / clip.duration()) / share) * misfit;
    displace_local(skeleton, out.poses.col(k).data(), d.data(), out.poses.col(k).data());
  }
  out.poses.col(last) = target;
  if (out.contacts.cols() != 0) out.contacts.col(last) = out.contacts.col(0);
  return out;
}

/// A cyclic clip without the turn of its cycle: each key is turned back by its share, in time, of the whole turn about the
/// vertical, and steps of the root's path with it, so that the cycle keeps the length of its path and ends heading as it
/// began. Throws Error unless the clip is cyclic and its root free.
inline Clip straighten_cycle(const Clip& clip) {
  detail::require_free_root(clip);
  if (!clip.cyclic) throw Error(detail::where(clip) + ": straighten_cycle: expected a cyclic clip");
  const int last = clip.keys() - 1;
  const auto rotation = [&](int k) { return core::Quaternion<double>::from(clip.poses.col(k).data() + 3); };
  const core::Vector3<double> up{0, 0, 1};
  const double turn = core::twist_angle(core::heading(rotation(last)) * core::heading(rotation(0)).conjugate(), up);
  const auto back = [&](double share) { return core::about_axis(up, -share * turn); };
  Clip out = clip;
  for (int k = 1; k <= last; ++k) {
    const double here = clip.times[k] / clip.duration(), before = clip.times[k - 1] / clip.duration();
    (back(here) * rotation(k)).store(out.poses.col(k).data() + 3);
    core::Vector3<double> step{clip.poses(0, k) - clip.poses(0, k - 1), clip.poses(1, k) - clip.poses(1, k - 1), 0};
    step = back(0.5 * (here + before)).rotate(step);
    out.poses(0, k) = out.poses(0, k - 1) + step.x;
    out.poses(1, k) = out.poses(1, k - 1) + step.y;
  }
  return out;
}

/// What symmetrize_gait takes as the half cycle that it repeats.
enum class GaitHalf {
  mean,   ///< the mean of the first half and the mirrored second
  first,  ///< the first half
  second  ///< the mirrored second half
};

/// A gait whose second half is the mirror image of its first, from a clip of one full cycle (a left and a right step of about
/// equal length in time). Half a cycle is taken, closed onto its own mirror image by spreading the misfit over its last
/// `share`, and repeated mirrored. The result is cyclic, travels straight along +x (turning is removed), begins at x = 0 and
/// has the cycle's duration. A cycle that travels less than 0.1 m keeps its first heading as its direction. Throws Error if
/// the root is not free, the joints are not the mirror's, or share is not in (0, 1].
inline Clip symmetrize_gait(const Clip& clip, const Mirror& mirror, GaitHalf half = GaitHalf::mean, double share = 0.7) {
  detail::require_free_root(clip);
  if (!(share > 0 && share <= 1)) throw Error(detail::where(clip) + ": symmetrize_gait: expected a share in (0, 1]");
  const body::Skeleton& skeleton = clip.skeleton;
  const double duration = clip.duration(), middle = 0.5 * duration;
  const Eigen::VectorXd travel = clip.poses.col(clip.keys() - 1).head(2) - clip.poses.col(0).head(2);
  const core::Vector3<double> up{0, 0, 1};
  GroundTransform straighten;
  straighten.turn = travel.norm() > 0.1
                        ? core::about_axis(up, -std::atan2(travel[1], travel[0]))
                        : core::heading(core::Quaternion<double>::from(clip.poses.col(0).data() + 3)).conjugate();
  const Clip straight = moved(clip, straighten);
  const Clip flipped = mirror.clip(straight);

  std::vector<double> times;
  for (int k = 0; k < clip.keys(); ++k) {
    const double t = clip.times[k];
    if (t <= middle && half != GaitHalf::second) times.push_back(t);
    if (t >= middle && half != GaitHalf::first) times.push_back(t - middle);
  }
  const Eigen::VectorXd keys = detail::key_times(std::move(times), middle);
  const int n = static_cast<int>(keys.size());
  const auto half_clip = [&](const Clip& from, double begin) {
    Clip out = detail::sampled(from, keys, (keys.array() + begin).matrix(), false);
    // Either half begins at x = 0 and sways about y = 0: its end is to be the mirror image of its begin.
    GroundTransform center;
    center.shift = {-out.poses(0, 0), -0.5 * (out.poses(1, 0) + out.poses(1, n - 1)), 0};
    return moved(out, center);
  };
  Clip step = half == GaitHalf::second ? half_clip(flipped, middle) : half_clip(straight, 0);
  if (half == GaitHalf::mean) {
    const Clip other = half_clip(flipped, middle);
    for (int k = 0; k < n; ++k)
      body::interpolate(skeleton, step.poses.col(k).data(), other.poses.col(k).data(), 0.5, step.poses.col(k).data());
    if (step.contacts.cols() != 0) step.contacts = 0.5 * (step.contacts + other.contacts);
  }

  Eigen::VectorXd target = mirror.pose(Eigen::VectorXd(step.poses.col(0))), misfit(skeleton.nv());
  const double advance = step.poses(0, n - 1);
  target[0] = advance;
  difference_local(skeleton, step.poses.col(n - 1).data(), target.data(), misfit.data());
  for (int k = 1; k < n; ++k) {
    const Eigen::VectorXd d = smoothstep(1 - (1 - keys[k] / middle) / share) * misfit;
    displace_local(skeleton, step.poses.col(k).data(), d.data(), step.poses.col(k).data());
  }
  if (step.contacts.cols() != 0)
    for (int i = 0; i < skeleton.size(); ++i) step.contacts(mirror.partner(i), n - 1) = step.contacts(i, 0);
  const Clip swung = mirror.clip(step);

  Clip out{clip.name, skeleton, Eigen::VectorXd(2 * n - 1), Eigen::MatrixXd(skeleton.nq(), 2 * n - 1), Eigen::MatrixXd(), true};
  out.times << keys, keys.tail(n - 1).array() + middle;
  out.poses << step.poses, swung.poses.rightCols(n - 1);
  out.poses.row(0).tail(n - 1).array() += advance;
  if (step.contacts.cols() != 0) {
    out.contacts.resize(skeleton.size(), 2 * n - 1);
    out.contacts << step.contacts, swung.contacts.rightCols(n - 1);
  }
  return out;
}

/// What find_cycle looks for.
struct CycleSearch {
  double shortest = 0.4;         ///< least period, s
  double longest = 2.5;          ///< greatest period, s
  double rate = 60;              ///< of the grid of candidate times, Hz
  double velocity_weight = 0.1;  ///< s; 1 m/s of velocity mismatch counts as much as this many metres of position
  double least_motion = 0.02;    ///< joints' root mean square spread about their mean in an interval worth looking at, m
};

/// The best cyclic interval of a clip.
struct CycleInterval {
  double start = 0;     ///< s
  double end = 0;       ///< s
  double mismatch = 0;  ///< root mean square over joints of position and weighted velocity mismatch, m
  CycleMisfit misfit;   ///< between the poses at both ends
};

/// Finds one period in a longer capture, such as several steps of a walk: the two times on a grid whose poses and velocities
/// match best when each is seen from the ground frame below its root, their distance being a period within the given range.
/// Among periods that are about equally good (one, two, three cycles) the shortest is taken. Nothing if the clip is too
/// short or stands still. Throws Error if the range or the rate makes no sense.
inline std::optional<CycleInterval> find_cycle(const Clip& clip, const CycleSearch& search = {}) {
  if (!(search.rate > 0 && search.shortest > 0 && search.longest >= search.shortest) || !std::isfinite(search.longest))
    throw Error(detail::where(clip) + ": find_cycle: expected a positive rate and 0 < shortest <= longest");
  const double grid = clip.duration() * search.rate + 1e-9;
  if (!(grid < 1e6)) throw Error(detail::where(clip) + ": find_cycle: expected fewer than a million candidate times");
  const int frames = static_cast<int>(grid) + 1, joints = clip.skeleton.size(), rows = 3 * joints;
  const int shortest = std::max(1, static_cast<int>(std::ceil(search.shortest * search.rate - 1e-9)));
  const int longest = std::min(frames - 1, static_cast<int>(std::floor(search.longest * search.rate + 1e-9)));
  if (longest < shortest) return std::nullopt;

  Eigen::MatrixXd features(2 * rows, frames), sums = Eigen::MatrixXd::Zero(rows, frames + 1);
  Eigen::VectorXd squares = Eigen::VectorXd::Zero(frames + 1);
  for (int k = 0; k < frames; ++k) {
    features.col(k) = detail::joint_features(clip, k / search.rate, 1 / search.rate);
    features.col(k).tail(rows) *= search.velocity_weight;
    sums.col(k + 1) = sums.col(k) + features.col(k).head(rows);
    squares[k + 1] = squares[k] + features.col(k).head(rows).squaredNorm();
  }
  const double infinity = std::numeric_limits<double>::infinity();
  std::vector<double> cost(static_cast<std::size_t>(longest - shortest + 1), infinity);
  std::vector<int> start(cost.size(), -1);
  for (int period = shortest; period <= longest; ++period) {
    const auto p = static_cast<std::size_t>(period - shortest);
    for (int k = 0; k + period < frames; ++k) {
      const double spread = (squares[k + period] - squares[k]) / period -
                            ((sums.col(k + period) - sums.col(k)) / period).squaredNorm();
      if (spread < joints * search.least_motion * search.least_motion) continue;
      const double c = (features.col(k + period) - features.col(k)).squaredNorm() / joints;
      if (!(c < cost[p])) continue;
      cost[p] = c;
      start[p] = k;
    }
  }
  for (double& c : cost) c = std::sqrt(c);
  const double best = *std::min_element(cost.begin(), cost.end());
  if (!(best < infinity)) return std::nullopt;
  // A multiple of the period may match a little better by chance; neighbours of a minimum must not pass for shorter periods.
  std::size_t chosen = 0;
  for (std::size_t p = 0; p < cost.size(); ++p) {
    const bool lowest = (p == 0 || cost[p] <= cost[p - 1]) && (p + 1 == cost.size() || cost[p] <= cost[p + 1]);
    if (lowest && cost[p] <= 1.5 * best + 0.002) {
      chosen = p;
      break;
    }
  }
  CycleInterval out;
  out.start = start[chosen] / search.rate;
  out.end = std::min(clip.duration(), (start[chosen] + shortest + static_cast<int>(chosen)) / search.rate);
  out.mismatch = cost[chosen];
  out.misfit = cycle_misfit(clip, out.start, out.end, 1 / search.rate);
  return out;
}

}  // namespace traceur::motion
