// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include "traceur/body/kinematics.hpp"
#include "traceur/motion/clip.hpp"

namespace traceur::motion {

/// A point of a body that shall be somewhere in a key.
struct KeyframePin {
  int joint = 0;                          ///< whose frame carries the point
  core::Vector3<double> point{0, 0, 0};   ///< m, in that frame
  core::Vector3<double> target{0, 0, 0};  ///< m, world
  double weight = 1;                      ///< above 0
};

/// A pose of an authored motion, roughly right, and what must be right about it.
struct Keyframe {
  double time = 0;       ///< s
  Eigen::VectorXd pose;  ///< nq
  std::vector<KeyframePin> pins;
};

struct KeyframeSolve {
  double stay = 1e-3;     ///< cost of a radian or metre off the pose as authored, against one metre off a pin, both squared
  int iterations = 60;    ///< at most
  double tolerance = 1e-7;  ///< of the last step, rad or m
};

/// The pose nearest to a key's, in the sense of the settings, that has its points where they are pinned: least squares over
/// root and joints by Gauss and Newton with damping. Where pins cannot all be met it is the best compromise.
inline Eigen::VectorXd solve_pins(const body::Skeleton& skeleton, const Keyframe& key, const KeyframeSolve& settings = {}) {
  Eigen::VectorXd q = key.pose;
  const Eigen::Index n = skeleton.nv(), rows = 3 * static_cast<Eigen::Index>(key.pins.size());
  if (rows == 0) return q;
  body::Frames<double> frames(skeleton);
  const auto misses = [&](const Eigen::VectorXd& pose) {
    body::forward_kinematics(skeleton, pose.data(), frames);
    Eigen::VectorXd r(rows);
    for (std::size_t p = 0; p < key.pins.size(); ++p)
      (std::sqrt(key.pins[p].weight) * (frames.point(key.pins[p].joint, key.pins[p].point) - key.pins[p].target))
          .store(r.data() + 3 * p);
    return r;
  };
  const auto off = [&](const Eigen::VectorXd& pose) {
    Eigen::VectorXd d(n);
    body::difference(skeleton, key.pose.data(), pose.data(), d.data());
    return d;
  };
  const auto cost = [&](const Eigen::VectorXd& pose) { return misses(pose).squaredNorm() + settings.stay * off(pose).squaredNorm(); };
  double now = cost(q), damping = 1e-4;
  Eigen::MatrixXd jacobian(rows, n);
  Eigen::VectorXd moved(q.size()), step(n);
  for (int i = 0; i < settings.iterations; ++i) {
    const Eigen::VectorXd r = misses(q), d = off(q);
    constexpr double h = 1e-6;
    for (Eigen::Index k = 0; k < n; ++k) {
      step.setZero();
      step[k] = h;
      body::displace(skeleton, q.data(), step.data(), moved.data());
      jacobian.col(k) = (misses(moved) - r) / h;
    }
    // To first order what a step adds to the distance from the authored pose is the step itself.
    Eigen::MatrixXd normal = jacobian.transpose() * jacobian;
    normal.diagonal().array() += settings.stay + damping;
    step = -normal.llt().solve(jacobian.transpose() * r + settings.stay * d);
    body::displace(skeleton, q.data(), step.data(), moved.data());
    body::normalize(skeleton, moved.data());
    const double then = cost(moved);
    if (then < now) {
      q = moved;
      now = then;
      damping = std::max(1e-9, 0.3 * damping);
      if (step.cwiseAbs().maxCoeff() < settings.tolerance) break;
    } else {
      damping = std::min(1e3, 5 * damping);
      if (damping >= 1e3) break;
    }
  }
  return q;
}

/// The longest clip that keys are sampled to.
inline constexpr int most_keyframe_frames = 1000000;

/// A clip through authored keys: each key's pins are solved, and in between poses move along cubic curves in the tangent
/// space of the key before, whose speeds at the keys are those from neighbour to neighbour, zero at both ends. It passes through every
/// solved key and has no jump in velocity but what rotations that turn far between two keys leave. Sampled at `fps` frames
/// a second. Throws Error on fewer than two keys, times that do not begin at zero and increase by a millisecond or more, numbers that are not
/// finite, more than `most_keyframe_frames` frames, or a pose that is not the skeleton's.
inline Clip from_keyframes(const std::string& name, const body::Skeleton& skeleton, const std::vector<Keyframe>& keys, double fps = 60,
                           const KeyframeSolve& settings = {}) {
  const std::string where = "keyframes '" + name + "'";
  if (keys.size() < 2) throw Error(where + ": expected at least two keys, found " + std::to_string(keys.size()));
  if (!(fps > 0) || !std::isfinite(fps)) throw Error(where + ": expected a positive number of frames a second");
  std::vector<Eigen::VectorXd> poses;
  for (std::size_t k = 0; k < keys.size(); ++k) {
    const std::string here = where + ", key " + std::to_string(k);
    if (!std::isfinite(keys[k].time) || (k == 0 ? keys[k].time != 0 : !(keys[k].time >= keys[k - 1].time + 0.001)))
      throw Error(here + (k == 0 ? ": expected time 0" : ": expected a time after the key before, by a millisecond or more"));
    body::check_pose(skeleton, keys[k].pose, here);
    for (const KeyframePin& p : keys[k].pins) {
      if (p.joint < 0 || p.joint >= skeleton.size()) throw Error(here + ": expected a joint of the skeleton in a pin");
      if (!(p.weight > 0) || !std::isfinite(p.weight)) throw Error(here + ": expected a weight above zero in a pin");
      for (const core::Vector3<double>& v : {p.point, p.target})
        if (!std::isfinite(squared_norm(v))) throw Error(here + ": expected finite numbers in a pin");
    }
    poses.push_back(solve_pins(skeleton, keys[k], settings));
  }
  const Eigen::Index n = skeleton.nv();
  const auto between = [&](std::size_t a, std::size_t b) {
    Eigen::VectorXd d(n);
    body::difference(skeleton, poses[a].data(), poses[b].data(), d.data());
    return d;
  };
  std::vector<Eigen::VectorXd> speeds(keys.size(), Eigen::VectorXd::Zero(n));
  for (std::size_t k = 1; k + 1 < keys.size(); ++k) {
    const double before = keys[k].time - keys[k - 1].time, after = keys[k + 1].time - keys[k].time;
    // The parabola's slope through three keys.
    speeds[k] = (between(k, k + 1) * before / after + between(k - 1, k) * after / before) / (before + after);
  }
  Clip clip;
  clip.name = name;
  clip.skeleton = skeleton;
  const double duration = keys.back().time;
  // Poses are memory: a slip of the pen in a time should cost a message.
  if (!(duration * fps <= most_keyframe_frames))
    throw Error(where + ": expected at most " + std::to_string(most_keyframe_frames) + " frames, found " + std::to_string(duration) + " s of " +
                std::to_string(fps) + " a second");
  const auto frames = std::max<Eigen::Index>(2, std::lround(duration * fps) + 1);
  clip.times = Eigen::VectorXd::LinSpaced(frames, 0, duration);
  clip.poses.resize(skeleton.nq(), frames);
  std::size_t k = 0;
  for (Eigen::Index f = 0; f < frames; ++f) {
    while (k + 2 < keys.size() && clip.times[f] >= keys[k + 1].time) ++k;
    const double span = keys[k + 1].time - keys[k].time, u = (clip.times[f] - keys[k].time) / span;
    const double u2 = u * u, u3 = u2 * u;
    const Eigen::VectorXd d = (3 * u2 - 2 * u3) * between(k, k + 1) + span * (u3 - 2 * u2 + u) * speeds[k] + span * (u3 - u2) * speeds[k + 1];
    body::displace(skeleton, poses[k].data(), d.data(), clip.poses.col(f).data());
    body::normalize(skeleton, clip.poses.col(f).data());
  }
  clip.check();
  return clip;
}

}  // namespace traceur::motion
