// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

#include "traceur/body/character.hpp"
#include "traceur/motion/clip.hpp"

namespace traceur::motion {

/// A point of a body that may touch something: the centre of a small ball fixed to the body.
struct ContactPoint {
  int body = 0;                          ///< joint index of the body
  core::Vector3<double> local{0, 0, 0};  ///< m, in the body's frame
  double radius = 0;                     ///< m
};

/// The outermost points of a character's collision shapes: a sphere's centre, a capsule's two ends (both with the shape's
/// radius), a box's eight corners. Of all bodies, or of those named. Throws Error on a name that no body has.
inline std::vector<ContactPoint> contact_points(const body::Character& character, const std::vector<std::string>& bodies = {}) {
  std::vector<int> wanted;
  for (const std::string& name : bodies) {
    wanted.push_back(character.skeleton.find_body(name));
    if (wanted.back() < 0) throw Error("character '" + character.name + "': contact points: no body named '" + name + "'");
  }
  std::vector<ContactPoint> points;
  for (const body::Shape& s : character.shapes) {
    if (!wanted.empty() && std::find(wanted.begin(), wanted.end(), s.body) == wanted.end()) continue;
    const auto add = [&](const core::Vector3<double>& local, double radius) {
      points.push_back({s.body, s.position + s.rotation.rotate(local), radius});
    };
    if (s.kind == body::Shape::Kind::sphere) add({0, 0, 0}, s.size.x);
    if (s.kind == body::Shape::Kind::capsule)
      for (const double end : {-1.0, 1.0}) add({0, 0, end * s.size.y}, s.size.x);
    if (s.kind == body::Shape::Kind::box)
      for (int corner = 0; corner < 8; ++corner)
        add({(corner & 1) != 0 ? s.size.x : -s.size.x, (corner & 2) != 0 ? s.size.y : -s.size.y,
             (corner & 4) != 0 ? s.size.z : -s.size.z},
            0);
  }
  return points;
}

/// Flat ground of a given height, for functions that take the ground as a callable (x, y) -> height, all m.
struct FlatGround {
  double height = 0;
  double operator()(double, double) const { return height; }
};

/// When a body counts as touching. The pairs are hysteresis: a contact begins below `*_on` and lasts until above `*_off`.
struct ContactDetection {
  double height_on = 0.03;   ///< of the body's lowest point above the ground, m
  double height_off = 0.05;  ///< m
  double speed_on = 0.6;     ///< of that point, m/s
  double speed_off = 1.2;    ///< m/s
  double shortest = 0.05;    ///< contacts and gaps that last less are removed (gaps first), s
};

namespace detail {

inline void require_points(const Clip& clip, const std::vector<ContactPoint>& points) {
  if (points.empty()) throw Error(where(clip) + ": contacts: expected at least one contact point");
  for (const ContactPoint& p : points)
    if (p.body < 0 || p.body >= clip.skeleton.size())
      throw Error(where(clip) + ": contacts: a contact point names body " + std::to_string(p.body) + ", which does not exist");
}

/// Clearance (m) and speed (m/s) of every point at every key, points x keys.
struct PointTracks {
  Eigen::MatrixXd clearance;
  Eigen::MatrixXd speed;
};
template <class Ground>
inline PointTracks point_tracks(const Clip& clip, const std::vector<ContactPoint>& points, const Ground& ground) {
  const auto n = static_cast<Eigen::Index>(points.size());
  PointTracks out{Eigen::MatrixXd(n, clip.keys()), Eigen::MatrixXd(n, clip.keys())};
  body::Frames<double> frames(clip.skeleton), before(clip.skeleton), after(clip.skeleton);
  Eigen::VectorXd q(clip.skeleton.nq());
  const auto pose_at = [&](double phi, body::Frames<double>& to) {
    clip.sample(phi, q.data());
    body::forward_kinematics(clip.skeleton, q.data(), to);
  };
  for (int k = 0; k < clip.keys(); ++k) {
    // Differences reach to the neighbouring keys: a piecewise linear motion has no velocity at a key.
    const int last = clip.keys() - 1;
    const double gap_before = clip.times[k == 0 ? last : k] - clip.times[k == 0 ? last - 1 : k - 1];
    const double gap_after = clip.times[k == last ? 1 : k + 1] - clip.times[k == last ? 0 : k];
    double a = clip.times[k] - gap_before, b = clip.times[k] + gap_after;
    if (!clip.cyclic) {
      a = std::max(a, 0.0);
      b = std::min(b, clip.duration());
    }
    body::forward_kinematics(clip.skeleton, clip.poses.col(k).data(), frames);
    pose_at(a, before);
    pose_at(b, after);
    for (Eigen::Index i = 0; i < n; ++i) {
      const ContactPoint& p = points[static_cast<std::size_t>(i)];
      const core::Vector3<double> here = frames.point(p.body, p.local);
      out.clearance(i, k) = here.z - p.radius - ground(here.x, here.y);
      out.speed(i, k) = norm(after.point(p.body, p.local) - before.point(p.body, p.local)) / (b - a);
    }
  }
  return out;
}

/// Turns runs of `value` that last less than `shortest` into the opposite. Runs at the ends of a clip that is not cyclic
/// may be cut off by the clip's own ends, and stay.
inline void remove_short_runs(const Clip& clip, std::vector<char>& on, char value, double shortest) {
  const int n = clip.keys() - 1;
  const auto at = [&](int k) -> char& { return on[static_cast<std::size_t>(clip.cyclic ? k % n : k)]; };
  const int count = clip.cyclic ? n : n + 1;
  int first = 0;
  while (clip.cyclic && first < count && at(first) == value) ++first;
  if (first == count) return;
  const auto time = [&](int k) { return clip.cyclic ? clip.times[k % n] + clip.duration() * (k / n) : clip.times[k]; };
  for (int k = first; k < first + count;) {
    if (at(k) != value) {
      ++k;
      continue;
    }
    int end = k;
    while (end < first + count && at(end) == value) ++end;
    const bool cut_off = !clip.cyclic && (k == 0 || end == count);
    if (!cut_off && time(end) - time(k) < shortest)
      for (int i = k; i < end; ++i) at(i) = value == 0 ? 1 : 0;
    k = end;
  }
}

}  // namespace detail

/// The clip with contact labels found from its motion: a body touches while one of its points is low and slow. Bodies without
/// points have label 0. `ground(x, y)` is the ground's height in m. Throws Error if there are no points or one names a body
/// that does not exist.
template <class Ground = FlatGround>
inline Clip label_contacts(const Clip& clip, const std::vector<ContactPoint>& points, const ContactDetection& thresholds = {},
                           const Ground& ground = {}) {
  detail::require_points(clip, points);
  const detail::PointTracks tracks = detail::point_tracks(clip, points, ground);
  Clip out = clip;
  out.contacts = Eigen::MatrixXd::Zero(clip.skeleton.size(), clip.keys());
  const int keys = clip.keys();
  std::vector<char> on(static_cast<std::size_t>(keys));
  for (int body = 0; body < clip.skeleton.size(); ++body) {
    // Every point has its own hysteresis; the body touches while any of them does.
    std::fill(on.begin(), on.end(), char{0});
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (points[i].body != body) continue;
      const auto row = static_cast<Eigen::Index>(i);
      bool touching = false;
      // A cyclic clip is gone through twice, so that its begin knows how its end left off.
      for (int round = clip.cyclic ? 0 : 1; round < 2; ++round)
        for (int k = 0; k < keys; ++k) {
          const double height = touching ? thresholds.height_off : thresholds.height_on;
          const double speed = touching ? thresholds.speed_off : thresholds.speed_on;
          touching = tracks.clearance(row, k) < height && tracks.speed(row, k) < speed;
          if (round == 1 && touching) on[static_cast<std::size_t>(k)] = 1;
        }
    }
    detail::remove_short_runs(clip, on, 0, thresholds.shortest);
    detail::remove_short_runs(clip, on, 1, thresholds.shortest);
    if (clip.cyclic) on.back() = on.front();
    for (int k = 0; k < keys; ++k) out.contacts(body, k) = on[static_cast<std::size_t>(k)];
  }
  return out;
}

/// Where a clip's ground seems to be.
struct GroundEstimate {
  double height = 0;      ///< m
  bool by_stance = true;  ///< found from resting points; otherwise from a percentile of the lowest points
  int frames = 0;         ///< keys it rests on
};

/// How estimate_ground looks for the ground.
struct GroundSearch {
  double stance_speed = 0.4;     ///< a lowest point slower than this stands on the ground, m/s
  double least_stance = 0.1;     ///< share of keys that must have such a point
  double percentile = 0.4;       ///< of the lowest points' heights over all keys, when too few do
};

/// Height of the ground under a clip that moves on flat ground: the median height of its lowest point over the keys where
/// that point rests; where too few do (rolls, flips), a percentile over all keys. Throws Error as label_contacts does, or if
/// an option is out of range.
inline GroundEstimate estimate_ground(const Clip& clip, const std::vector<ContactPoint>& points, const GroundSearch& search = {}) {
  detail::require_points(clip, points);
  if (!(search.percentile >= 0 && search.percentile <= 1))
    throw Error(detail::where(clip) + ": estimate_ground: expected a percentile in [0, 1]");
  const detail::PointTracks tracks = detail::point_tracks(clip, points, FlatGround{});
  std::vector<double> all, resting;
  for (int k = 0; k < clip.keys(); ++k) {
    Eigen::Index lowest = 0;
    const double height = tracks.clearance.col(k).minCoeff(&lowest);
    all.push_back(height);
    if (tracks.speed(lowest, k) < search.stance_speed) resting.push_back(height);
  }
  const auto quantile = [](std::vector<double>& values, double share) {
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(std::llround(share * static_cast<double>(values.size() - 1)));
    std::nth_element(values.begin(), at, values.end());
    return *at;
  };
  const bool enough = !resting.empty() && static_cast<double>(resting.size()) >= search.least_stance * clip.keys();
  if (enough) return {quantile(resting, 0.5), true, static_cast<int>(resting.size())};
  return {quantile(all, search.percentile), false, clip.keys()};
}

/// The clip raised or lowered by `height` (m). Throws Error if its root is not free.
inline Clip raised(const Clip& clip, double height) {
  detail::require_free_root(clip);
  Clip out = clip;
  out.poses.row(2).array() += height;
  return out;
}

/// The clip shifted in height so that its estimated ground is at zero.
inline Clip grounded(const Clip& clip, const std::vector<ContactPoint>& points, const GroundSearch& search = {}) {
  return raised(clip, -estimate_ground(clip, points, search).height);
}

}  // namespace traceur::motion
