// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <random>
#include <string>

#include <traceur/body/character.hpp>
#include <traceur/motion/clip.hpp>

/// A small two-legged figure, symmetric about its x-z plane, and motions of it, shared by the tests of this folder.
namespace figure {

using traceur::body::Joint;
using traceur::body::JointType;
using traceur::body::Skeleton;
using traceur::core::Quaternion;
using traceur::core::Vector3;
using traceur::motion::Clip;
using Vec = Eigen::VectorXd;

constexpr double pi = 3.14159265358979323846;

inline double uniform(std::mt19937_64& rng, double low, double high) {
  return low + (high - low) * (static_cast<double>(rng() >> 11) * 0x1p-53);
}

inline Vector3<double> random_vector(std::mt19937_64& rng, double size) {
  return {uniform(rng, -size, size), uniform(rng, -size, size), uniform(rng, -size, size)};
}

inline Joint joint(const std::string& name, int parent, JointType type, Vector3<double> offset,
                   Vector3<double> axis = {0, 1, 0}) {
  Joint j;
  j.name = name;
  j.body = name + "_body";
  j.parent = parent;
  j.type = type;
  j.offset = offset;
  j.axis = axis;
  return j;
}

/// Pelvis, chest, and on each side hip (ball), knee (hinge), foot (fixed), shoulder (ball), elbow (hinge).
inline Skeleton biped() {
  Skeleton s;
  s.add(joint("root", -1, JointType::free, {0, 0, 0}));
  s.add(joint("chest", 0, JointType::ball, {0, 0, 0.25}));
  for (const double side : {1.0, -1.0}) {
    const std::string name = side > 0 ? "left_" : "right_";
    const int hip = s.add(joint(name + "hip", 0, JointType::ball, {0, side * 0.1, -0.05}));
    const int knee = s.add(joint(name + "knee", hip, JointType::hinge, {0, 0, -0.4}));
    s.add(joint(name + "foot", knee, JointType::fixed, {0, 0, -0.4}));
    const int shoulder = s.add(joint(name + "shoulder", 1, JointType::ball, {0, side * 0.2, 0.2}));
    s.add(joint(name + "elbow", shoulder, JointType::hinge, {0.02, side * 0.03, -0.3}));
  }
  return s;
}

inline Vec random_pose(const Skeleton& s, std::mt19937_64& rng, double angle = 1.0) {
  Vec d(s.nv()), q = s.neutral_pose();
  for (Eigen::Index i = 0; i < d.size(); ++i) d[i] = uniform(rng, -angle, angle);
  traceur::body::displace(s, q.data(), d.data(), q.data());
  return q;
}

/// A clip of random poses at uneven keys.
inline Clip random_clip(std::mt19937_64& rng, int keys = 7, bool cyclic = false) {
  Clip clip{"random", biped(), Vec::Zero(keys), Eigen::MatrixXd(biped().nq(), keys), Eigen::MatrixXd(), cyclic};
  for (int k = 0; k < keys; ++k) {
    if (k > 0) clip.times[k] = clip.times[k - 1] + uniform(rng, 0.05, 0.3);
    clip.poses.col(k) = random_pose(clip.skeleton, rng, 0.7);
  }
  return clip;
}

/// Settings of a made-up gait in closed form.
struct Gait {
  double period = 1.2;
  double speed = 1.3;
  double turn = 0;      ///< heading change per s
  double heading = 0;   ///< at time 0
  double lead = 0;      ///< phase at time 0, rad
};

/// Pose of the gait at time t: mirror symmetric about half its period while it does not turn.
inline Vec gait_pose(const Skeleton& s, const Gait& g, double t) {
  const double w = 2 * pi / g.period, a = w * t + g.lead, psi = g.heading + g.turn * t;
  Vec d = Vec::Zero(s.nv()), q = s.neutral_pose();
  const auto at = [&](const char* name) { return s[s.find(name)].v_index; };
  const double sway = 0.03 * std::sin(a);
  double x = g.speed * t, y = 0;
  if (g.turn != 0) {
    x = g.speed / g.turn * std::sin(g.turn * t);
    y = g.speed / g.turn * (1 - std::cos(g.turn * t));
  }
  q[0] = std::cos(g.heading) * x - std::sin(g.heading) * y - sway * std::sin(psi);
  q[1] = std::sin(g.heading) * x + std::cos(g.heading) * y + sway * std::cos(psi);
  q[2] = 0.83 + 0.02 * std::cos(2 * a);
  const Vector3<double> up{0, 0, 1};
  (traceur::core::about_axis(up, psi) * exp_map(Vector3<double>{0.05 * std::sin(a), 0.08, 0.1 * std::cos(a)})).store(q.data() + 3);
  d[at("chest") + 2] = -0.2 * std::cos(a);
  for (const double side : {1.0, -1.0}) {
    const std::string name = side > 0 ? "left_" : "right_";
    const double swing = side * std::sin(a);
    d[at((name + "hip").c_str()) + 1] = -0.5 * swing;
    d[at((name + "hip").c_str())] = 0.05 * side;
    d[at((name + "knee").c_str())] = 0.4 - 0.3 * side * std::cos(a);
    d[at((name + "shoulder").c_str()) + 1] = 0.4 * swing;
    d[at((name + "elbow").c_str())] = -0.5 - 0.1 * swing;
  }
  Vec joints = q;
  traceur::body::displace(s, q.data(), d.data(), joints.data());
  return joints;
}

inline Clip gait(const Gait& g, double duration, int keys, bool cyclic = false) {
  Clip clip{"gait", biped(), Vec::LinSpaced(keys, 0, duration), Eigen::MatrixXd(biped().nq(), keys), Eigen::MatrixXd(), cyclic};
  for (int k = 0; k < keys; ++k) clip.poses.col(k) = gait_pose(clip.skeleton, g, clip.times[k]);
  return clip;
}

/// Largest component of the tangent vector between two poses: blind to the sign of quaternions.
inline double distance(const Skeleton& s, const Vec& a, const Vec& b) {
  Vec d(s.nv());
  traceur::body::difference(s, a.data(), b.data(), d.data());
  return d.cwiseAbs().maxCoeff();
}

inline double largest_gap(const Clip& a, const Clip& b) {
  double worst = 0;
  for (int k = 0; k < a.keys(); ++k) worst = std::max(worst, distance(a.skeleton, a.poses.col(k), b.poses.col(k)));
  return worst;
}

/// Checks that `f` throws Error with one line that holds `part`.
template <class F>
inline bool fails_with(F&& f, const std::string& part) {
  try {
    f();
  } catch (const traceur::Error& error) {
    const std::string what = error.what();
    return what.find(part) != std::string::npos && what.find('\n') == std::string::npos;
  }
  return false;
}

}  // namespace figure
