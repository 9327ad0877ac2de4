// SPDX-License-Identifier: MIT
#pragma once

#include <ceres/ceres.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "traceur/body/character.hpp"
#include "traceur/motion/align.hpp"
#include "traceur/motion/blend.hpp"
#include "traceur/motion/joint_map.hpp"

namespace traceur::motion {

/// When a foot's heel or toe rests on the ground: it begins when the point is both lower and slower than the first pair and
/// ends when it is higher or faster than the second. Speeds are horizontal.
struct ContactThresholds {
  double begin_height = 0.03;  ///< m
  double end_height = 0.05;    ///< m
  double begin_speed = 0.5;    ///< m/s
  double end_speed = 0.8;      ///< m/s
  double shortest = 0.05;      ///< s; shorter contacts are dropped and shorter gaps closed
  double creep = 0.06;         ///< m; a contact that moves further than this is kept
  double creep_speed = 0.15;   ///< only where it is slower than this, m/s
};

/// Standard deviations by which the solve divides its residuals: the smaller, the more it counts.
struct RetargetWeights {
  double root = 0.04;           ///< m
  double direction = 0.04;      ///< bone directions, rad
  double trunk = 0.05;          ///< orientation of pelvis, torso and head, rad
  double foot = 0.08;           ///< orientation of feet, rad
  double twist = 0.2;           ///< orientation of thighs and upper arms, rad
  double ankle = 0.03;          ///< place of the ankles, m
  double contact = 0.0001;      ///< a sole point in contact, from its place, m
  double ground = 0.0005;       ///< depth of any shape below ground, m
  double limit = 0.003;         ///< joint angles beyond their range, rad
  double change = 0.5;          ///< all joint angles, from the first guess, rad or m
  double acceleration = 10.0;   ///< of the correction, rad/s^2; a tenth of it for the root's place, m/s^2
};

struct RetargetOptions {
  JointNames joints;        ///< names that the recogniser would get wrong
  double least_fps = 30;    ///< slower clips get more keys
  double most_fps = 60;     ///< faster clips are resampled to this
  bool direct = true;       ///< copy rotations where source and target bones match within 1 %, instead of solving
  bool align = true;        ///< move the clip to begin above the origin heading +x
  /// Whether the source moves on a plane. If not, heights are kept but for the scale, feet are held where they rest, at
  /// whatever height, and nothing is kept above ground: for stairs, slopes, and clips that come with terrain.
  bool flat_ground = true;
  int iterations = 20;      ///< of the solver, at most; 0 leaves the first guess
  ContactThresholds contact;
  RetargetWeights weights;
};

struct RetargetReport {
  bool direct = false;            ///< rotations were copied
  double scale = 1;               ///< of the root's path: leg length, target over source
  double ground_offset = 0;       ///< added to all scaled heights, m
  double foot_slide_before = 0;   ///< fastest horizontal motion of a sole point in contact, m/s; in the first guess
  double foot_slide_after = 0;    ///< the same in the result
  double foot_drift_after = 0;    ///< longest way of a sole point within one contact, m
  double penetration_before = 0;  ///< deepest point below ground, m; in the first guess
  double penetration_after = 0;
  double direction_error = 0;      ///< mean angle between bones of arms and legs and the source's, rad
  double direction_error_max = 0;  ///< rad
  int limits_clipped = 0;          ///< joints times keys moved back into their range after the solve
  double limits_excess = 0;        ///< how far the worst was out; of a direct copy, which is not clipped, still is; rad
  double contact_share = 0;        ///< share of keys with a foot on the ground
  int iterations = 0;
  double solve_seconds = 0;
  std::vector<std::string> unmapped;  ///< landmarks the source lacks
  std::vector<std::string> notes;

  std::string text() const {
    char b[900];
    constexpr double deg = 180 / std::numbers::pi;
    std::snprintf(b, sizeof b,
                  "%s, scale %.4f, ground offset %.4f m\n  foot slide %.4f -> %.4f m/s, drift %.4f m, contact in %.0f %% of keys\n"
                  "  penetration %.4f -> %.4f m\n  bone directions off by %.2f deg on average, %.1f at most\n"
                  "  %d joint angles clipped, worst excess %.2f deg\n  %d iterations, %.2f s\n",
                  direct ? "rotations copied" : "solved", scale, ground_offset, foot_slide_before, foot_slide_after,
                  foot_drift_after, 100 * contact_share, penetration_before, penetration_after, deg * direction_error,
                  deg * direction_error_max, limits_clipped, deg * limits_excess, iterations, solve_seconds);
    std::string out = b;
    for (const std::string& name : unmapped) out += "  the source has no " + name + "\n";
    for (const std::string& note : notes) out += "  note: " + note + "\n";
    return out;
  }
};

struct Retargeted {
  Clip clip;
  RetargetReport report;
};

namespace detail {

using Vec = core::Vector3<double>;
using Quat = core::Quaternion<double>;

inline Vec unit(const Vec& v) {
  const double n = norm(v);
  return n > 1e-12 ? (1 / n) * v : Vec{0, 0, 0};
}

inline Quat from_columns(const Vec& x, const Vec& y, const Vec& z) {
  Eigen::Matrix3d m;
  m << x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z;
  return Quat::from(Eigen::Quaterniond(m)).normalized();
}

/// Orthonormal axes with the first along a and the second near b.
inline Quat triad(const Vec& a, const Vec& b) {
  const Vec x = unit(a), y = unit(b - dot(b, x) * x);
  return from_columns(x, y, cross(x, y));
}

/// The rotation that takes direction a to a_to and, as near as it can, b to b_to.
inline Quat rotation_of_pair(const Vec& a, const Vec& b, const Vec& a_to, const Vec& b_to) {
  return triad(a_to, b_to) * triad(a, b).conjugate();
}

/// The smallest rotation that takes direction a to b.
inline Quat swing(const Vec& a, const Vec& b) {
  const Vec u = unit(a), v = unit(b);
  const double c = dot(u, v);
  if (c < -1 + 1e-9) {
    const Vec across = std::abs(u.x) < 0.8 ? cross(u, Vec{1, 0, 0}) : cross(u, Vec{0, 1, 0});
    return core::about_axis(unit(across), std::numbers::pi);
  }
  const Vec w = cross(u, v);
  return Quat{w.x, w.y, w.z, 1 + c}.normalized();
}

inline double angle_between(const Vec& a, const Vec& b) { return std::atan2(norm(cross(a, b)), dot(a, b)); }

/// Weighted mean of rotations that are near one another.
struct MeanRotation {
  Quat sum{0, 0, 0, 0};
  double weight = 0;

  void add(const Quat& q, double w) {
    const double s = core::dot(q, sum) < 0 ? -w : w;
    sum = {sum.x + s * q.x, sum.y + s * q.y, sum.z + s * q.z, sum.w + s * q.w};
    weight += w;
  }
  Quat mean() const { return weight > 0 ? sum.normalized() : Quat::identity(); }
};

/// A point of a shape's surface or axis that may touch the ground, with the radius around it.
struct GroundPoint {
  int body;
  Vec local;
  double radius;
};

/// A sole point and whether it belongs to the heel (0) or the toe (1).
struct SolePoint {
  Vec local;
  int part;
};

/// What the solve needs to know about the character, computed once.
struct TargetBody {
  const body::Character& character;
  BodyPlan plan;
  body::Frames<double> neutral;        ///< at zero angles, root at the origin
  std::vector<GroundPoint> points;     ///< of all shapes
  std::array<std::vector<SolePoint>, 2> sole;
  std::array<double, 2> ankle_height{0, 0};  ///< of the ankle above its sole, standing, m

  struct Bone {
    int from, to;
    Vec local;  ///< unit, in the frame of `from`
  };
  std::array<std::array<Bone, 4>, 2> bones;  ///< of each side: thigh, shin, upper arm, lower arm

  const body::Skeleton& skeleton() const { return character.skeleton; }
  Quat neutral_rotation(int joint) const { return neutral.rotation[static_cast<std::size_t>(joint)]; }
  Vec neutral_position(int joint) const { return neutral.position[static_cast<std::size_t>(joint)]; }

  TargetBody(const body::Character& c, const BodyPlan& p) : character(c), plan(p), neutral(c.skeleton) {
    const Eigen::VectorXd q = c.skeleton.neutral_pose();
    body::forward_kinematics(c.skeleton, q.data(), neutral);
    for (const body::Shape& s : c.shapes) {
      if (s.kind == body::Shape::Kind::sphere) points.push_back({s.body, s.position, s.size.x});
      if (s.kind == body::Shape::Kind::capsule)
        for (const double end : {-1.0, 1.0})
          points.push_back({s.body, s.position + s.rotation.rotate(Vec{0, 0, end * s.size.y}), s.size.x});
      if (s.kind == body::Shape::Kind::box)
        for (int k = 0; k < 8; ++k)
          points.push_back({s.body, s.position + s.rotation.rotate(Vec{(k & 1 ? 1 : -1) * s.size.x, (k & 2 ? 1 : -1) * s.size.y,
                                                                     (k & 4 ? 1 : -1) * s.size.z}), 0});
    }
    for (std::size_t side = 0; side < 2; ++side) {
      const BodyPlan::Limbs& l = plan.side[side];
      const auto bone = [&](int from, int to) {
        const Vec d = neutral_position(to) - neutral_position(from);
        if (!(norm(d) > 1e-6)) throw Error("character '" + c.name + "': the bone from '" + c.skeleton[from].name + "' has no length");
        return Bone{from, to, neutral_rotation(from).conjugate().rotate(unit(d))};
      };
      bones[side] = {bone(l.hip, l.knee), bone(l.knee, l.ankle), bone(l.shoulder, l.elbow), bone(l.elbow, l.wrist)};
      double lowest = std::numeric_limits<double>::infinity(), front = 0, count = 0;
      const auto bottom = [&](const GroundPoint& g) {
        return neutral.point(g.body, g.local) - Vec{0, 0, g.radius};
      };
      const auto of_foot = [&](const GroundPoint& g) { return is_below(c.skeleton, g.body, l.ankle); };
      for (const GroundPoint& g : points)
        if (of_foot(g)) lowest = std::min(lowest, bottom(g).z);
      for (const GroundPoint& g : points)
        if (of_foot(g) && bottom(g).z < lowest + 0.01) front += bottom(g).x, ++count;
      if (count == 0) throw Error("character '" + c.name + "': '" + c.skeleton[l.ankle].body + "' has no shape to stand on");
      const Quat to_local = neutral_rotation(l.ankle).conjugate();
      for (const GroundPoint& g : points)
        if (of_foot(g) && bottom(g).z < lowest + 0.01)
          sole[side].push_back({to_local.rotate(bottom(g) - neutral_position(l.ankle)), bottom(g).x > front / count ? 1 : 0});
      ankle_height[side] = neutral_position(l.ankle).z - lowest;
    }
  }

  /// Depth of the lowest point below z = 0, m; negative above.
  double depth(const body::Frames<double>& frames) const {
    double lowest = std::numeric_limits<double>::infinity();
    for (const GroundPoint& g : points) lowest = std::min(lowest, frames.point(g.body, g.local).z - g.radius);
    return -lowest;
  }
};

/// Which sole parts touch the ground: contact[side][part][key].
struct FootContacts {
  std::array<std::array<std::vector<char>, 2>, 2> on;

  bool any(std::size_t side, std::size_t key) const { return on[side][0][key] != 0 || on[side][1][key] != 0; }
};

/// Labels heel and toe of both feet by the height and speed of their sole points. `place(key, side, local)` is where a sole
/// point is in the world.
template <class Place>
inline FootContacts find_contacts(const TargetBody& target, const Eigen::VectorXd& times, const ContactThresholds& limits,
                                  bool flat_ground, const Place& place) {
  FootContacts out;
  const auto n = static_cast<std::size_t>(times.size());
  for (std::size_t side = 0; side < 2; ++side)
    for (std::size_t part = 0; part < 2; ++part) {
      std::vector<Vec> p(n, Vec{0, 0, 0});
      std::vector<double> tilt(n, 0.0);  // height difference of points that share the ground when the part stands
      double count = 0;
      for (const SolePoint& s : target.sole[side]) {
        if (s.part != static_cast<int>(part)) continue;
        ++count;
        for (std::size_t k = 0; k < n; ++k) {
          const Vec at = place(k, side, s.local);
          if (count > 1) tilt[k] = std::max(tilt[k], std::abs(at.z - p[k].z / (count - 1)));
          p[k] += at;
        }
      }
      std::vector<char>& on = out.on[side][part];
      on.assign(n, 0);
      if (count == 0) continue;
      for (Vec& v : p) v *= 1 / count;
      const auto speed = [&](std::size_t a, std::size_t b) {
        return std::hypot(p[b].x - p[a].x, p[b].y - p[a].y, flat_ground ? 0.0 : p[b].z - p[a].z) / (times[static_cast<Eigen::Index>(b)] - times[static_cast<Eigen::Index>(a)]);
      };
      // The slower of the steps before and after: a touch-down's step before is still swing.
      std::vector<double> v(n);
      for (std::size_t k = 0; k < n; ++k)
        v[k] = k == 0 ? speed(0, 1) : k + 1 == n ? speed(n - 2, n - 1) : std::min(speed(k - 1, k), speed(k, k + 1));
      const Vec up = target.neutral_rotation(target.plan.side[side].ankle).conjugate().rotate(Vec{0, 0, 1});
      const auto passes = [&](std::size_t k, double height, double fast) {
        // A foot on its side, heel or back touches the ground, but does not stand.
        const bool stands = tilt[k] < 0.05 && (place(k, side, up) - place(k, side, Vec{0, 0, 0})).z > 0.3;
        return stands && (!flat_ground || p[k].z < height) && v[k] < fast;
      };
      for (std::size_t k = 0; k < n; ++k) {
        const bool held = k > 0 && on[k - 1] != 0 && passes(k, limits.end_height, limits.end_speed);
        on[k] = held || passes(k, limits.begin_height, limits.begin_speed) ? 1 : 0;
      }
      // Hysteresis backwards too, so that a contact begins where it would end in the reversed clip.
      for (std::size_t k = n - 1; k-- > 0;)
        if (on[k + 1] != 0 && passes(k, limits.end_height, limits.end_speed)) on[k] = 1;
      // Short gaps in which the point went nowhere are closed, then short contacts dropped.
      const auto time = [&](std::size_t k) { return times[static_cast<Eigen::Index>(k)]; };
      for (const char value : {char{0}, char{1}})
        for (std::size_t k = 0; k < n;) {
          std::size_t end = k;
          while (end < n && on[end] == on[k]) ++end;
          const bool gap = on[k] == 0;
          bool flip = on[k] == value && k > 0 && end < n;
          if (flip && gap) flip = time(end) - time(k - 1) < limits.shortest && norm(p[end] - p[k - 1]) < 0.02;
          if (flip && !gap) flip = time(end - 1) - time(k) < limits.shortest;
          for (std::size_t i = k; flip && i < end; ++i) on[i] = static_cast<char>(1 - value);
          k = end;
        }
      // What creeps along in contact, such as a foot turned on the spot, is no contact but where it rests.
      for (std::size_t k = 0; k < n;) {
        std::size_t end = k;
        while (end < n && on[end] == on[k]) ++end;
        double spread = 0;
        for (std::size_t i = k; on[k] != 0 && i < end; ++i) spread = std::max(spread, norm(p[i] - p[k]));
        for (std::size_t i = k; spread > limits.creep && i < end; ++i)
          if (v[i] > limits.creep_speed) on[i] = 0;
        k = end;
      }
      // A fast step between two slow ones parts two contacts.
      for (std::size_t k = 1; k < n; ++k)
        if (on[k - 1] != 0 && on[k] != 0 && speed(k - 1, k) > limits.end_speed) on[k - 1] = 0;
    }
  return out;
}

struct Slide {
  double speed = 0;  ///< m/s
  double drift = 0;  ///< m
};

/// Horizontal motion of sole points while in contact.
template <class Place>
inline Slide find_slide(const TargetBody& target, const FootContacts& contacts, const Eigen::VectorXd& times, const Place& place) {
  Slide out;
  for (std::size_t side = 0; side < 2; ++side)
    for (const SolePoint& s : target.sole[side]) {
      const std::vector<char>& on = contacts.on[side][static_cast<std::size_t>(s.part)];
      Vec first{0, 0, 0}, last{0, 0, 0};
      for (std::size_t k = 0; k < on.size(); ++k) {
        if (on[k] == 0) continue;
        const Vec p = place(k, side, s.local);
        if (k == 0 || on[k - 1] == 0) {
          first = p;
        } else {
          const auto i = static_cast<Eigen::Index>(k);
          out.speed = std::max(out.speed, std::hypot(p.x - last.x, p.y - last.y) / (times[i] - times[i - 1]));
          out.drift = std::max(out.drift, std::hypot(p.x - first.x, p.y - first.y));
        }
        last = p;
      }
    }
  return out;
}

/// What one key should look like, in the world of the result.
struct KeyGoal {
  Vec root{0, 0, 0};
  Quat pelvis, torso, head;
  std::array<std::array<Vec, 4>, 2> direction;  ///< as TargetBody::bones
  std::array<std::array<Quat, 2>, 2> twist;     ///< orientation of thigh and upper arm
  std::array<Quat, 2> foot;
  std::array<Vec, 2> ankle;
};

/// How much a joint is beyond its range: up to four numbers (box and cone of a ball, one of a hinge), zero inside.
template <class S>
inline int limit_excess(const body::Joint& joint, const body::Actuator& a, const S* q, S* out) {
  if (!a.limited) return 0;
  const auto beyond = [](const S& x, double low, double high) {
    return x < S(low) ? S(x - S(low)) : x > S(high) ? S(x - S(high)) : S(0.0);
  };
  if (joint.type == body::JointType::hinge) {
    out[0] = beyond(q[joint.q_index], a.lower.x, a.upper.x);
    return 1;
  }
  if (joint.type != body::JointType::ball) return 0;
  const core::Vector3<S> r = log_map(core::Quaternion<S>::from(q + joint.q_index));
  out[0] = beyond(r.x, a.lower.x, a.upper.x);
  out[1] = beyond(r.y, a.lower.y, a.upper.y);
  out[2] = beyond(r.z, a.lower.z, a.upper.z);
  const S n2 = squared_norm(r);
  using std::sqrt;
  out[3] = n2 > S(a.cone * a.cone) ? S(sqrt(n2) - S(a.cone)) : S(0.0);
  return 4;
}

/// Residuals of one key at displacement d (nv): parameter 0. A sole point in contact adds three numbers that also depend on
/// the ground anchor (2) where it rests: parameters 1, 2, ...
class KeyCost final : public ceres::CostFunction {
 public:
  struct Contact {
    int body;
    Vec local;
    double height;  ///< of the ground there, m
  };

  KeyCost(const TargetBody& t, const RetargetWeights& w, const KeyGoal& g, const double* q, std::vector<Contact> held)
      : target(t), weights(w), goal(g), guess(q), contacts(std::move(held)) {
    set_num_residuals(residuals());
    mutable_parameter_block_sizes()->push_back(t.skeleton().nv());
    for (std::size_t c = 0; c < contacts.size(); ++c) mutable_parameter_block_sizes()->push_back(2);
  }

  bool Evaluate(double const* const* parameters, double* out, double** jacobians) const override {
    constexpr int width = 12;
    using Dual = ceres::Jet<double, width>;
    const int nv = target.skeleton().nv(), rows = num_residuals();
    const auto count = static_cast<std::size_t>(nv);
    if (jacobians == nullptr || jacobians[0] == nullptr) {
      evaluate(parameters[0], out);
    } else {
      // As many directions at a time as a dual number holds.
      std::vector<Dual> d(count), r(static_cast<std::size_t>(rows));
      for (int begin = 0; begin < nv; begin += width) {
        for (int i = 0; i < nv; ++i) {
          const bool active = i >= begin && i < begin + width;
          d[static_cast<std::size_t>(i)] = active ? Dual(parameters[0][i], i - begin) : Dual(parameters[0][i]);
        }
        evaluate(d.data(), r.data());
        for (int k = 0; k < rows; ++k)
          for (int i = begin; i < std::min(nv, begin + width); ++i) jacobians[0][k * nv + i] = r[static_cast<std::size_t>(k)].v[i - begin];
      }
      for (int k = 0; k < rows; ++k) out[k] = r[static_cast<std::size_t>(k)].a;
    }
    const int first = rows - 3 * static_cast<int>(contacts.size());
    for (std::size_t c = 0; c < contacts.size(); ++c) {
      const int row = first + 3 * static_cast<int>(c);
      out[row] -= parameters[c + 1][0] / weights.contact;
      out[row + 1] -= parameters[c + 1][1] / weights.contact;
      if (jacobians == nullptr || jacobians[c + 1] == nullptr) continue;
      std::fill_n(jacobians[c + 1], 2 * rows, 0.0);
      jacobians[c + 1][2 * row] = jacobians[c + 1][2 * (row + 1) + 1] = -1 / weights.contact;
    }
    return true;
  }

 private:
  /// All residuals with the anchors at the origin.
  template <class S>
  void evaluate(const S* d, S* out) const {
    using core::Quaternion;
    using core::Vector3;
    const body::Skeleton& s = target.skeleton();
    std::vector<S> q(static_cast<std::size_t>(s.nq()));
    body::Frames<S> frames(s);
    body::displace(s, guess, d, q.data());
    body::forward_kinematics(s, q.data(), frames);
    const auto position = [&](int i) { return frames.position[static_cast<std::size_t>(i)]; };
    const auto put = [&](const Vector3<S>& v, double sigma) {
      (S(1 / sigma) * v).store(out);
      out += 3;
    };
    const auto put_rotation = [&](int i, const Quat& to, double sigma) {
      put(log_map(to.conjugate().cast<S>() * frames.rotation[static_cast<std::size_t>(i)]), sigma);
    };
    put(position(target.plan.pelvis) - goal.root.cast<S>(), weights.root);
    put_rotation(target.plan.pelvis, goal.pelvis, weights.trunk);
    put_rotation(target.plan.chest, goal.torso, weights.trunk);
    if (target.plan.head >= 0) put_rotation(target.plan.head, goal.head, weights.trunk);
    for (std::size_t side = 0; side < 2; ++side) {
      for (std::size_t b = 0; b < 4; ++b) {
        const TargetBody::Bone& bone = target.bones[side][b];
        put(frames.rotation[static_cast<std::size_t>(bone.from)].rotate(bone.local.cast<S>()) - goal.direction[side][b].cast<S>(),
            weights.direction);
      }
      const BodyPlan::Limbs& l = target.plan.side[side];
      put_rotation(l.hip, goal.twist[side][0], weights.twist);
      put_rotation(l.shoulder, goal.twist[side][1], weights.twist);
      put_rotation(l.ankle, goal.foot[side], weights.foot);
      put(position(l.ankle) - goal.ankle[side].cast<S>(), weights.ankle);
    }
    for (const GroundPoint& g : target.points) {
      const S z = frames.point(g.body, g.local.cast<S>()).z - S(g.radius);
      *out++ = z < S(0.0) ? S(z / S(weights.ground)) : S(0.0);
    }
    S excess[4];
    for (int i = 0; i < s.size(); ++i) {
      const int n = limit_excess(s[i], target.character.actuators[static_cast<std::size_t>(i)], q.data(), excess);
      for (int k = 0; k < n; ++k) *out++ = excess[k] / S(weights.limit);
    }
    for (int i = 0; i < s.nv(); ++i) *out++ = d[i] * S(1 / weights.change);
    for (const Contact& c : contacts) {
      const Vector3<S> p = frames.point(c.body, c.local.cast<S>());
      put({p.x, p.y, p.z - S(c.height)}, weights.contact);
    }
  }

  int residuals() const {
    const body::Skeleton& s = target.skeleton();
    int n = 3 + 6 + (target.plan.head >= 0 ? 3 : 0) + 2 * (12 + 12) + static_cast<int>(target.points.size()) + s.nv() +
            3 * static_cast<int>(contacts.size());
    for (int i = 0; i < s.size(); ++i)
      if (target.character.actuators[static_cast<std::size_t>(i)].limited)
        n += s[i].type == body::JointType::hinge ? 1 : s[i].type == body::JointType::ball ? 4 : 0;
    return n;
  }

  const TargetBody& target;
  const RetargetWeights& weights;
  KeyGoal goal;
  const double* guess;
  std::vector<Contact> contacts;
};

/// The correction's acceleration over three keys, divided by its standard deviation.
class AccelerationCost final : public ceres::CostFunction {
 public:
  AccelerationCost(const body::Skeleton& skeleton, double before, double after, double sigma) {
    set_num_residuals(skeleton.nv());
    for (int k = 0; k < 3; ++k) mutable_parameter_block_sizes()->push_back(skeleton.nv());
    const double middle = 0.5 * (before + after);
    factor_ = {1 / (before * middle), -(1 / before + 1 / after) / middle, 1 / (after * middle)};
    scale_ = Eigen::VectorXd::Constant(skeleton.nv(), 1 / sigma);
    if (skeleton.free_root()) scale_.head(3) *= 10;
  }
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const Eigen::Index n = scale_.size();
    for (Eigen::Index i = 0; i < n; ++i)
      residuals[i] = scale_[i] * (factor_[0] * parameters[0][i] + factor_[1] * parameters[1][i] + factor_[2] * parameters[2][i]);
    for (std::size_t k = 0; jacobians != nullptr && k < 3; ++k) {
      if (jacobians[k] == nullptr) continue;
      Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> j(jacobians[k], n, n);
      j.setZero();
      j.diagonal() = factor_[k] * scale_;
    }
    return true;
  }

 private:
  std::array<double, 3> factor_;
  Eigen::VectorXd scale_;
};

/// Source motion seen as a moving body: all frames, and the constant rotations from source segments to target segments.
class Retargeter {
 public:
  Retargeter(const Clip& source, const body::Character& character, const JointMap& map, const RetargetOptions& options)
      : source_(source), options_(options), map_(map), target_(character, map.target), neutral_(source.skeleton) {
    const body::Skeleton& s = source_.skeleton;
    keys_ = static_cast<std::size_t>(source_.keys());
    frames_.assign(keys_, body::Frames<double>(s));
    for (std::size_t k = 0; k < keys_; ++k)
      body::forward_kinematics(s, source_.poses.col(static_cast<Eigen::Index>(k)).data(), frames_[k]);
    const Eigen::VectorXd q = s.neutral_pose();
    body::forward_kinematics(s, q.data(), neutral_);
  }

  /// Copies rotations if the bones match; false if they do not.
  bool copy(Retargeted& out) const {
    const body::Skeleton &s = source_.skeleton, &t = target_.skeleton();
    std::vector<Quat> turn(static_cast<std::size_t>(t.size()), Quat::identity());
    for (int i = 0; i < t.size(); ++i) {
      const int from = source_of(i);
      if (from < 0) return false;
      const auto k = static_cast<std::size_t>(i);
      if (i > 0) {
        const int p = t[i].parent;
        if (s[from].parent != source_of(p)) return false;
        turn[k] = s[from].rest.conjugate() * turn[static_cast<std::size_t>(p)] * t[i].rest;
      }
      std::vector<int> children;
      for (int c = i + 1; c < t.size(); ++c)
        if (t[c].parent == i) children.push_back(c);
      const auto fits = [&] {
        for (const int c : children) {
          if (source_of(c) < 0) return false;
          const Vec a = turn[k].rotate(t[c].offset), b = s[source_of(c)].offset;
          if (norm(a - b) > 0.01 * std::max(norm(a), 0.05)) return false;
        }
        return true;
      };
      if (!fits()) {
        if (children.size() != 1 || source_of(children[0]) < 0) return false;
        turn[k] = swing(turn[k].rotate(t[children[0]].offset), s[source_of(children[0])].offset) * turn[k];
        if (!fits()) return false;
      }
    }
    Clip& clip = out.clip;
    clip.poses.resize(t.nq(), source_.keys());
    std::vector<Quat> world(static_cast<std::size_t>(t.size()));
    for (std::size_t f = 0; f < keys_; ++f) {
      double* q = clip.poses.col(static_cast<Eigen::Index>(f)).data();
      for (int i = 0; i < t.size(); ++i) {
        const auto k = static_cast<std::size_t>(i);
        const body::Joint& j = t[i];
        world[k] = frames_[f].rotation[static_cast<std::size_t>(source_of(i))] * turn[k];
        const Quat parent = j.parent < 0 ? Quat::identity() : world[static_cast<std::size_t>(j.parent)];
        const Quat local = (j.rest.conjugate() * (parent.conjugate() * world[k])).normalized();
        if (j.type == body::JointType::free) {
          frames_[f].position[static_cast<std::size_t>(source_of(i))].store(q);
          local.store(q + 3);
        } else if (j.type == body::JointType::ball) {
          local.store(q + j.q_index);
        } else {
          double angle = 0;
          if (j.type == body::JointType::hinge) q[j.q_index] = angle = core::twist_angle(local, j.axis);
          if (norm(core::log_map(core::about_axis(j.axis, angle).conjugate() * local)) > 0.02) return false;
        }
      }
    }
    out.report.direct = true;
    if (options_.flat_ground) lift(clip, out.report);
    return true;
  }

  /// First guess and solve.
  void solve(Retargeted& out) {
    calibrate();
    Clip& clip = out.clip;
    RetargetReport& report = out.report;
    report.scale = scale_;
    report.ground_offset = ground_;
    clip.poses.resize(target_.skeleton().nq(), source_.keys());
    goals_.resize(keys_);
    for (std::size_t k = 0; k < keys_; ++k) {
      goals_[k] = goal(k);
      pose(goals_[k], clip.poses.col(static_cast<Eigen::Index>(k)).data());
    }
    const auto goal_place = [&](std::size_t k, std::size_t side, const Vec& local) {
      return goals_[k].ankle[side] + goals_[k].foot[side].rotate(local);
    };
    contacts_ = find_contacts(target_, source_.times, options_.contact, options_.flat_ground, goal_place);
    report.foot_slide_before = find_slide(target_, contacts_, source_.times, goal_place).speed;
    report.penetration_before = std::max(0.0, deepest(clip));
    if (options_.iterations > 0) optimize(clip, report);
    clip_limits(clip, report);
  }

  /// Fills in what is measured on the result, and its contact labels.
  void measure(Retargeted& out) {
    Clip& clip = out.clip;
    std::vector<body::Frames<double>> frames(keys_, body::Frames<double>(target_.skeleton()));
    for (std::size_t k = 0; k < keys_; ++k)
      body::forward_kinematics(target_.skeleton(), clip.poses.col(static_cast<Eigen::Index>(k)).data(), frames[k]);
    const auto place = [&](std::size_t k, std::size_t side, const Vec& local) {
      return frames[k].point(target_.plan.side[side].ankle, local);
    };
    RetargetReport& report = out.report;
    if (report.direct) contacts_ = find_contacts(target_, source_.times, options_.contact, options_.flat_ground, place);
    const Slide slide = find_slide(target_, contacts_, source_.times, place);
    report.foot_slide_after = slide.speed;
    report.foot_drift_after = slide.drift;
    report.penetration_after = std::max(0.0, deepest(clip));
    if (report.direct) {
      report.foot_slide_before = slide.speed;
      report.penetration_before = report.penetration_after;
      report.limits_excess = worst_excess(clip);
    }
    clip.contacts.setZero(target_.skeleton().size(), source_.keys());
    double sum = 0, standing = 0;
    for (std::size_t k = 0; k < keys_; ++k) {
      const auto i = static_cast<Eigen::Index>(k);
      for (const GroundPoint& g : target_.points)
        if (options_.flat_ground && frames[k].point(g.body, g.local).z - g.radius < 0.01) clip.contacts(g.body, i) = 1;
      for (std::size_t side = 0; side < 2; ++side) {
        clip.contacts(target_.plan.side[side].ankle, i) = contacts_.any(side, k) ? 1 : 0;
        for (std::size_t b = 0; b < 4; ++b) {
          const TargetBody::Bone& bone = target_.bones[side][b];
          const auto at = [&](int joint) { return frames[k].position[static_cast<std::size_t>(joint)]; };
          const double error = angle_between(at(bone.to) - at(bone.from), direction(k, side, b));
          sum += error;
          report.direction_error_max = std::max(report.direction_error_max, error);
        }
      }
      if (contacts_.any(0, k) || contacts_.any(1, k)) ++standing;
    }
    report.direction_error = sum / (8 * static_cast<double>(keys_));
    report.contact_share = standing / static_cast<double>(keys_);
  }

 private:
  int source_of(int joint) const { return map_.source_of[static_cast<std::size_t>(joint)]; }
  Vec at(std::size_t key, int joint) const { return frames_[key].position[static_cast<std::size_t>(joint)]; }
  Quat turn(std::size_t key, int joint) const { return frames_[key].rotation[static_cast<std::size_t>(joint)]; }
  static std::pair<int, int> ends(const BodyPlan::Limbs& l, std::size_t bone) {
    return bone == 0 ? std::pair{l.hip, l.knee} : bone == 1 ? std::pair{l.knee, l.ankle}
           : bone == 2 ? std::pair{l.shoulder, l.elbow} : std::pair{l.elbow, l.wrist};
  }
  Vec direction(const body::Frames<double>& f, std::size_t side, std::size_t bone) const {
    const auto [from, to] = ends(map_.source.side[side], bone);
    return unit(f.position[static_cast<std::size_t>(to)] - f.position[static_cast<std::size_t>(from)]);
  }
  Vec direction(std::size_t key, std::size_t side, std::size_t bone) const { return direction(frames_[key], side, bone); }
  /// Middle of the hips.
  Vec hips(const body::Frames<double>& f) const {
    return 0.5 * (f.position[static_cast<std::size_t>(map_.source.left().hip)] + f.position[static_cast<std::size_t>(map_.source.right().hip)]);
  }

  /// Heights of a copied clip: the stance sole at 0, or the 40th percentile of the lowest point where no foot stands.
  void lift(Clip& clip, RetargetReport& report) const {
    const body::Skeleton& t = target_.skeleton();
    body::Frames<double> f(t);
    std::vector<double> lowest, standing;
    std::vector<Vec> before;
    for (int k = 0; k < clip.keys(); ++k) {
      body::forward_kinematics(t, clip.poses.col(k).data(), f);
      lowest.push_back(-target_.depth(f));
      std::vector<Vec> sole;
      for (std::size_t side = 0; side < 2; ++side)
        for (const SolePoint& p : target_.sole[side]) sole.push_back(f.point(target_.plan.side[side].ankle, p.local));
      for (std::size_t i = 0; k > 0 && i < sole.size(); ++i) {
        const double speed = norm(sole[i] - before[i]) / (clip.times[k] - clip.times[k - 1]);
        if (speed < 0.4 && sole[i].z < lowest.back() + 0.02) {
          standing.push_back(lowest.back());
          break;
        }
      }
      before = std::move(sole);
    }
    const auto quantile = [](std::vector<double>& v, double share) {
      const auto nth = v.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(v.size() - 1) + 0.5);
      std::nth_element(v.begin(), nth, v.end());
      return *nth;
    };
    const bool stands = standing.size() >= 3 && static_cast<double>(standing.size()) > 0.1 * clip.keys();
    report.ground_offset = -(stands ? quantile(standing, 0.5) : quantile(lowest, 0.4));
    if (!stands) report.notes.push_back("no foot stands still; ground height from the lowest points");
    clip.poses.row(2).array() += report.ground_offset;
  }

  double deepest(const Clip& clip) const {
    body::Frames<double> f(target_.skeleton());
    double worst = -std::numeric_limits<double>::infinity();
    for (int k = 0; k < clip.keys(); ++k) {
      body::forward_kinematics(target_.skeleton(), clip.poses.col(k).data(), f);
      worst = std::max(worst, target_.depth(f));
    }
    return worst;
  }

  double worst_excess(const Clip& clip) const {
    const body::Skeleton& t = target_.skeleton();
    double worst = 0, e[4];
    for (int k = 0; k < clip.keys(); ++k)
      for (int i = 0; i < t.size(); ++i) {
        const int n = limit_excess(t[i], target_.character.actuators[static_cast<std::size_t>(i)], clip.poses.col(k).data(), e);
        for (int c = 0; c < n; ++c) worst = std::max(worst, std::abs(e[c]));
      }
    return worst;
  }

  /// Puts every joint into its range.
  void clip_limits(Clip& clip, RetargetReport& report) const {
    const body::Skeleton& t = target_.skeleton();
    for (int k = 0; k < clip.keys(); ++k)
      for (int i = 0; i < t.size(); ++i) {
        const body::Actuator& a = target_.character.actuators[static_cast<std::size_t>(i)];
        double* q = clip.poses.col(k).data();
        double e[4] = {0, 0, 0, 0};
        const int n = limit_excess(t[i], a, q, e);
        double worst = 0;
        for (int c = 0; c < n; ++c) worst = std::max(worst, std::abs(e[c]));
        if (worst < 1e-9) continue;
        // The solve leaves what its weights trade; only more than that counts as clipped.
        if (worst > 0.02) ++report.limits_clipped;
        report.limits_excess = std::max(report.limits_excess, worst);
        if (t[i].type == body::JointType::hinge) {
          q[t[i].q_index] = std::clamp(q[t[i].q_index], a.lower.x, a.upper.x);
        } else {
          Vec r = core::log_map(Quat::from(q + t[i].q_index));
          r = {std::clamp(r.x, a.lower.x, a.upper.x), std::clamp(r.y, a.lower.y, a.upper.y), std::clamp(r.z, a.lower.z, a.upper.z)};
          if (const double size = norm(r); size > a.cone) r *= a.cone / size;
          core::exp_map(r).store(q + t[i].q_index);
        }
      }
  }

  /// Whether the source at zero angles stands upright, facing +x of its root: then that pose tells how its segments lie.
  bool upright_rest() const {
    const auto p = [&](int j) { return neutral_.position[static_cast<std::size_t>(j)]; };
    for (std::size_t side = 0; side < 2; ++side) {
      const BodyPlan::Limbs& l = map_.source.side[side];
      if (direction(neutral_, side, 0).z > -0.8 || direction(neutral_, side, 1).z > -0.8) return false;
      if (l.toe >= 0 && unit(p(l.toe) - p(l.ankle)).x < 0.4) return false;
    }
    const Vec across = unit(p(map_.source.left().hip) - p(map_.source.right().hip));
    const int top = map_.source.neck >= 0 ? map_.source.neck : map_.source.left().shoulder;
    const Vec up = unit(p(top) - hips(neutral_));
    return across.y > 0.9 && up.z > 0.7;
  }

  /// Orientation of the target's pelvis in the source's root frame.
  void calibrate_pelvis() {
    Vec across{0, 0, 0}, up{0, 0, 0};
    for (std::size_t k = 0; k < keys_; ++k) {
      const Quat back = turn(k, map_.source.pelvis).conjugate();
      across += back.rotate(unit(at(k, map_.source.left().hip) - at(k, map_.source.right().hip)));
      up += back.rotate(unit(spine_point(frames_[k], 0.4) - hips(frames_[k])));
    }
    across = unit(across);
    up = unit(up);
    pelvis_ = Quat::identity();
    if (across.y < 0.95 || up.z < 0.85) pelvis_ = rotation_of_pair(Vec{0, 1, 0}, Vec{0, 0, 1}, across, up);
  }

  /// A point on the way from the middle of the hips along the spine to the neck, at a share of its length.
  Vec spine_point(const body::Frames<double>& f, double share) const {
    std::vector<Vec> way{hips(f)};
    for (const int j : spine_) way.push_back(f.position[static_cast<std::size_t>(j)]);
    double length = 0;
    for (std::size_t i = 1; i < way.size(); ++i) length += norm(way[i] - way[i - 1]);
    double left = share * length;
    for (std::size_t i = 1; i < way.size(); ++i) {
      const double d = norm(way[i] - way[i - 1]);
      if (left <= d && d > 0) return way[i - 1] + (left / d) * (way[i] - way[i - 1]);
      left -= d;
    }
    return way.back();
  }

  void calibrate() {
    const BodyPlan &from = map_.source, &to = map_.target;
    const body::Skeleton& s = source_.skeleton;
    const auto length = [](const body::Frames<double>& f, const BodyPlan::Limbs& l) {
      const auto p = [&](int j) { return f.position[static_cast<std::size_t>(j)]; };
      return norm(p(l.knee) - p(l.hip)) + norm(p(l.ankle) - p(l.knee));
    };
    double ours = 0, theirs = 0;
    for (std::size_t side = 0; side < 2; ++side) {
      ours += length(target_.neutral, to.side[side]);
      theirs += length(frames_[0], from.side[side]);
      for (std::size_t b = 0; b < 4; ++b)
        if (!(norm(direction(0, side, b)) > 0))
          throw Error(where(source_) + ": the bone from '" + s[ends(from.side[side], b).first].name + "' has no length");
    }
    scale_ = ours / theirs;
    upright_ = upright_rest();

    const int top = from.neck >= 0 ? from.neck : from.chest;
    for (int j = top; j >= 0; j = s[j].parent) spine_.insert(spine_.begin(), j);
    // Without a neck the middle of the shoulders ends the spine, which the chest's frame does not tell; its joint stands in.
    const auto up_of = [&](const body::Frames<double>& f, const BodyPlan& plan) {
      return f.position[static_cast<std::size_t>(plan.neck >= 0 ? plan.neck : plan.chest)];
    };
    const double lower = norm(target_.neutral_position(to.chest) - target_.neutral_position(to.pelvis));
    const double upper = norm(up_of(target_.neutral, to) - target_.neutral_position(to.chest));
    waist_ = lower / std::max(1e-9, lower + upper);
    calibrate_pelvis();

    // Torso: up along the spine, across the shoulders as they are on average.
    Vec across{0, 0, 0};
    for (std::size_t k = 0; k < keys_; ++k)
      across += turn(k, from.chest).conjugate().rotate(unit(at(k, from.left().shoulder) - at(k, from.right().shoulder)));
    shoulders_ = unit(across);
    const Quat chest_back = target_.neutral_rotation(to.chest).conjugate();
    torso_up_ = chest_back.rotate(unit(up_of(target_.neutral, to) - target_.neutral_position(to.chest)));
    torso_across_ = chest_back.rotate(unit(target_.neutral_position(to.left().shoulder) - target_.neutral_position(to.right().shoulder)));

    if (to.head >= 0 && from.head >= 0) {
      MeanRotation mean;
      for (std::size_t k = 0; k < keys_; ++k)
        mean.add(turn(k, from.head).conjugate() * torso(frames_[k]) * chest_back * target_.neutral_rotation(to.head), 1);
      head_ = mean.mean();
      if (upright_) head_ = neutral_.rotation[static_cast<std::size_t>(from.head)].conjugate() * target_.neutral_rotation(to.head);
    }

    for (std::size_t side = 0; side < 2; ++side) {
      calibrate_limb(side, 0);
      calibrate_limb(side, 2);
      calibrate_foot(side);
    }
    if (options_.flat_ground) {
      std::array<double, 2> own{};
      for (std::size_t side = 0; side < 2; ++side) own[side] = target_.ankle_height[side] - scale_ * flat_height_[side];
      ground_ = std::max(own[0], own[1]);
      // A foot that never comes down as low as the other, as in a kick, tells nothing of the ground.
      for (std::size_t side = 0; side < 2; ++side) foot_offset_[side] = ground_ - own[side] < 0.04 ? own[side] - ground_ : 0.0;
    } else {
      ground_ = -0.5 * (raise_[0] + raise_[1]);
    }
  }

  /// The hinge's axis in the frame of the segment above it, signed so that bending in its range is positive.
  Vec hinge_axis(std::size_t side, std::size_t bone) const {
    const int j = target_.bones[side][bone + 1].from;
    const body::Joint& joint = target_.skeleton()[j];
    Vec axis = joint.type == body::JointType::hinge ? joint.rest.rotate(joint.axis) : Vec{0, bone == 0 ? 1.0 : -1.0, 0};
    const body::Actuator& a = target_.character.actuators[static_cast<std::size_t>(j)];
    if (joint.type == body::JointType::hinge && a.limited && a.lower.x + a.upper.x < 0) axis = -axis;
    return axis;
  }

  /// The segment's orientation by the plane in which the limb bends; its bend decides how well that is known.
  Quat bent(std::size_t side, std::size_t bone, const Vec& d, const Vec& next) const {
    return rotation_of_pair(target_.bones[side][bone].local, hinge_axis(side, bone), d, cross(d, next));
  }
  /// The segment swung from its place at the trunk, without twist.
  Quat swung(std::size_t side, std::size_t bone, const Quat& trunk, const Vec& d) const {
    const int trunk_joint = bone == 0 ? map_.target.pelvis : map_.target.chest;
    const Quat rest = trunk * target_.neutral_rotation(trunk_joint).conjugate() *
                      target_.neutral_rotation(target_.bones[side][bone].from);
    return swing(rest.rotate(target_.bones[side][bone].local), d) * rest;
  }

  void calibrate_limb(std::size_t side, std::size_t bone) {
    const int segment = ends(map_.source.side[side], bone).first;
    MeanRotation by_bend, by_swing;
    for (std::size_t k = 0; k < keys_; ++k) {
      const Vec d = direction(k, side, bone), next = direction(k, side, bone + 1);
      const Quat back = turn(k, segment).conjugate();
      const double bend = angle_between(d, next);
      if (bend > 0.35) by_bend.add(back * bent(side, bone, d, next), std::sin(std::min(bend, 1.57)));
      by_swing.add(back * swung(side, bone, bone == 0 ? pelvis(k) : torso(frames_[k]), d), 1);
    }
    Quat& out = limb_[side][bone / 2];
    if (by_bend.weight > 1 + 0.03 * static_cast<double>(keys_)) {
      out = by_bend.mean();
    } else if (upright_) {
      const int trunk = bone == 0 ? map_.target.pelvis : map_.target.chest;
      out = neutral_.rotation[static_cast<std::size_t>(segment)].conjugate() *
            swung(side, bone, target_.neutral_rotation(trunk), direction(neutral_, side, bone));
    } else {
      out = by_swing.mean();
    }
  }

  /// The sole in the source foot's frame: horizontal, on average, where the foot is low and slow, as a foot that stands is.
  void calibrate_foot(std::size_t side) {
    const BodyPlan::Limbs& l = map_.source.side[side];
    const Quat neutral = target_.neutral_rotation(map_.target.side[side].ankle);
    const Quat by_rest = neutral_.rotation[static_cast<std::size_t>(l.ankle)].conjugate() * neutral;
    const int tip = l.toe >= 0 ? l.toe : l.ankle;
    std::vector<double> cost(keys_), ankle(keys_), toe(keys_);
    for (std::size_t k = 0; k < keys_; ++k) {
      ankle[k] = scale_ * at(k, l.ankle).z;
      toe[k] = scale_ * at(k, tip).z;
    }
    const auto low = [](std::vector<double> v) {
      const auto nth = v.begin() + static_cast<std::ptrdiff_t>(v.size() / 20);
      std::nth_element(v.begin(), nth, v.end());
      return *nth;
    };
    const double ankle_low = low(ankle), toe_low = low(toe);
    for (std::size_t k = 0; k < keys_; ++k) {
      const std::size_t a = k > 0 ? k - 1 : 0, b = std::min(k + 1, keys_ - 1);
      const double dt = source_.times[static_cast<Eigen::Index>(b)] - source_.times[static_cast<Eigen::Index>(a)];
      cost[k] = std::abs(ankle[k] - ankle_low) / 0.02 + std::abs(toe[k] - toe_low) / 0.02 +
                scale_ * (norm(at(b, tip) - at(a, tip)) + norm(at(b, l.ankle) - at(a, l.ankle))) / dt / 0.3;
    }
    const double least = *std::min_element(cost.begin(), cost.end());
    Vec up{0, 0, 0}, forward{0, 0, 0};
    double height = 0, toe_height = 0, sum = 0;
    MeanRotation by_pelvis;
    for (std::size_t k = 0; k < keys_; ++k) {
      const double w = std::exp(-(cost[k] - least));
      const Quat back = turn(k, l.ankle).conjugate();
      up += w * back.rotate(Vec{0, 0, 1});
      if (l.toe >= 0) forward += back.rotate(unit(at(k, l.toe) - at(k, l.ankle)));
      by_pelvis.add(back * pelvis(k) * neutral, 1);
      height += w * ankle[k] / scale_;
      toe_height += w * toe[k] / scale_;
      sum += w;
    }
    flat_height_[side] = height / sum;
    if (l.toe < 0) {
      foot_[side] = upright_ ? by_rest : by_pelvis.mean();
      raise_[side] = 0;
      return;
    }
    const Vec x = neutral.conjugate().rotate(Vec{1, 0, 0}), z = neutral.conjugate().rotate(Vec{0, 0, 1});
    foot_[side] = rotation_of_pair(z, x, unit(up), unit(forward));
    if (upright_ && angle_between(foot_[side].rotate(z), by_rest.rotate(z)) > 0.45)
      foot_[side] = rotation_of_pair(z, x, by_rest.rotate(z), unit(forward));
    // The toe joint is about 2 cm above the sole, so the source's ankle is this much higher above its sole than ours.
    raise_[side] = std::clamp(scale_ * (height - toe_height) / sum + 0.02 - target_.ankle_height[side], -0.03, 0.08);
  }

  Quat pelvis(std::size_t key) const { return turn(key, map_.source.pelvis) * pelvis_; }
  Quat torso(const body::Frames<double>& f) const {
    const int top = map_.source.neck >= 0 ? map_.source.neck : map_.source.chest;
    const Vec up = f.position[static_cast<std::size_t>(top)] - spine_point(f, waist_);
    const Vec across = f.rotation[static_cast<std::size_t>(map_.source.chest)].rotate(shoulders_);
    return rotation_of_pair(torso_up_, torso_across_, unit(up), across);
  }

  KeyGoal goal(std::size_t k) const {
    const BodyPlan &from = map_.source, &to = map_.target;
    KeyGoal g;
    const auto placed = [&](const Vec& p) { return scale_ * p + Vec{0, 0, ground_}; };
    g.pelvis = pelvis(k) * target_.neutral_rotation(to.pelvis);
    g.torso = torso(frames_[k]);
    g.head = to.head >= 0 && from.head >= 0 ? turn(k, from.head) * head_
             : to.head >= 0 ? g.torso * target_.neutral_rotation(to.chest).conjugate() * target_.neutral_rotation(to.head) : Quat::identity();
    const Vec middle = 0.5 * (target_.neutral_position(to.left().hip) + target_.neutral_position(to.right().hip)) -
                       target_.neutral_position(to.pelvis);
    g.root = placed(hips(frames_[k])) - pelvis(k).rotate(middle);
    for (std::size_t side = 0; side < 2; ++side) {
      for (std::size_t b = 0; b < 4; ++b) g.direction[side][b] = direction(k, side, b);
      for (const std::size_t b : {std::size_t{0}, std::size_t{2}}) {
        const Vec d = g.direction[side][b], next = g.direction[side][b + 1];
        const Quat carried = turn(k, ends(from.side[side], b).first) * limb_[side][b / 2];
        const Quat straight = swing(carried.rotate(target_.bones[side][b].local), d) * carried;
        Quat& out = g.twist[side][b / 2];
        out = straight;
        const double known = smoothstep((angle_between(d, next) - 0.2) / (0.6 - 0.2));
        if (known > 0) {
          double twist = core::twist_angle(bent(side, b, d, next) * straight.conjugate(), d);
          // A limb bent the wrong way round is overstretched, not twisted by half a turn.
          if (std::abs(twist) > 0.5 * std::numbers::pi) twist -= std::copysign(std::numbers::pi, twist);
          out = core::about_axis(d, known * twist) * straight;
        }
      }
      g.foot[side] = turn(k, from.side[side].ankle) * foot_[side];
      const Vec up = (g.foot[side] * target_.neutral_rotation(to.side[side].ankle).conjugate()).rotate(Vec{0, 0, 1});
      g.ankle[side] = placed(at(k, from.side[side].ankle)) + Vec{0, 0, foot_offset_[side]} - raise_[side] * (up - Vec{0, 0, 1});
    }
    return g;
  }

  /// The pose whose segments are oriented as the goal has them, as far as the joints allow.
  void pose(const KeyGoal& g, double* q) const {
    const body::Skeleton& t = target_.skeleton();
    const BodyPlan& plan = map_.target;
    std::vector<Quat> world(static_cast<std::size_t>(t.size()));
    for (int i = 0; i < t.size(); ++i) {
      const body::Joint& j = t[i];
      const Quat parent = j.parent < 0 ? Quat::identity() : world[static_cast<std::size_t>(j.parent)];
      Quat wanted = parent * j.rest;
      double angle = 0;
      if (i == plan.pelvis) wanted = g.pelvis;
      if (i == plan.chest && i != plan.pelvis) wanted = g.torso;
      if (i == plan.head) wanted = g.head;
      for (std::size_t side = 0; side < 2; ++side) {
        const BodyPlan::Limbs& l = plan.side[side];
        if (i == l.hip) wanted = g.twist[side][0];
        if (i == l.shoulder) wanted = g.twist[side][1];
        if (i == l.ankle) wanted = g.foot[side];
        for (const std::size_t b : {std::size_t{1}, std::size_t{3}}) {
          const TargetBody::Bone& bone = target_.bones[side][b];
          if (i != bone.from) continue;
          const Quat rest = parent * j.rest;
          const Vec was = rest.rotate(bone.local), d = g.direction[side][b], axis = rest.rotate(j.axis);
          if (j.type == body::JointType::hinge)
            angle = std::atan2(dot(cross(was, d), axis), dot(was, d) - dot(was, axis) * dot(d, axis));
          else
            wanted = swing(was, d) * rest;
        }
      }
      const Quat local = (j.rest.conjugate() * (parent.conjugate() * wanted)).normalized();
      world[static_cast<std::size_t>(i)] = wanted;
      if (j.type == body::JointType::free) {
        g.root.store(q);
        local.store(q + 3);
      } else if (j.type == body::JointType::ball) {
        local.store(q + j.q_index);
      } else if (j.type == body::JointType::hinge) {
        // Overstretched limbs come out just beyond zero, not a turn away.
        q[j.q_index] = angle;
        world[static_cast<std::size_t>(i)] = parent * j.rest * core::about_axis(j.axis, angle);
      } else {
        world[static_cast<std::size_t>(i)] = parent * j.rest;
      }
    }
  }

  void optimize(Clip& clip, RetargetReport& report) {
    const body::Skeleton& t = target_.skeleton();
    const Eigen::Index nv = t.nv();
    const auto started = std::chrono::steady_clock::now();
    Eigen::MatrixXd correction = Eigen::MatrixXd::Zero(nv, clip.keys());
    const Eigen::MatrixXd guess = clip.poses;

    // One anchor for every sole point and contact: where that point rests is free, but it is one place.
    struct Anchor {
      std::array<double, 2> place{0, 0};
      double height = 0;
      int keys = 0;
    };
    std::vector<std::unique_ptr<Anchor>> anchors;
    std::vector<std::vector<std::pair<KeyCost::Contact, Anchor*>>> held(keys_);
    for (std::size_t side = 0; side < 2; ++side)
      for (const SolePoint& p : target_.sole[side]) {
        const std::vector<char>& on = contacts_.on[side][static_cast<std::size_t>(p.part)];
        for (std::size_t k = 0; k < keys_; ++k) {
          if (on[k] == 0) continue;
          if (k == 0 || on[k - 1] == 0) anchors.push_back(std::make_unique<Anchor>());
          Anchor& a = *anchors.back();
          const Vec at = goals_[k].ankle[side] + goals_[k].foot[side].rotate(p.local);
          ++a.keys;
          a.place[0] += (at.x - a.place[0]) / a.keys;
          a.place[1] += (at.y - a.place[1]) / a.keys;
          if (!options_.flat_ground) a.height += (at.z - a.height) / a.keys;
          held[k].push_back({{target_.plan.side[side].ankle, p.local, 0}, &a});
        }
      }

    RetargetWeights weights = options_.weights;
    if (!options_.flat_ground) weights.ground = std::numeric_limits<double>::infinity();
    ceres::Problem problem;
    for (std::size_t k = 0; k < keys_; ++k) {
      const auto i = static_cast<Eigen::Index>(k);
      std::vector<KeyCost::Contact> contacts;
      std::vector<double*> blocks{correction.col(i).data()};
      for (const auto& [contact, anchor] : held[k]) {
        contacts.push_back(contact);
        contacts.back().height = anchor->height;
        blocks.push_back(anchor->place.data());
      }
      auto* cost = new KeyCost(target_, weights, goals_[k], guess.col(i).data(), std::move(contacts));
      problem.AddResidualBlock(cost, nullptr, blocks);
      if (k >= 2)
        problem.AddResidualBlock(new AccelerationCost(t, clip.times[i - 1] - clip.times[i - 2], clip.times[i] - clip.times[i - 1],
                                                      options_.weights.acceleration),
                                 nullptr, correction.col(i - 2).data(), correction.col(i - 1).data(), correction.col(i).data());
    }
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    options.max_num_iterations = options_.iterations;
    options.function_tolerance = 1e-4;
    options.parameter_tolerance = 1e-6;
    options.num_threads = 1;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    if (summary.termination_type == ceres::FAILURE || !correction.allFinite())
      throw Error(where(source_) + ": retargeting: the solve failed: " + summary.message);
    report.iterations = static_cast<int>(summary.iterations.size());
    for (std::size_t k = 0; k < keys_; ++k) {
      const auto i = static_cast<Eigen::Index>(k);
      body::displace(t, guess.col(i).data(), correction.col(i).data(), clip.poses.col(i).data());
      body::normalize(t, clip.poses.col(i).data());
    }
    report.solve_seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  }

  const Clip& source_;
  const RetargetOptions& options_;
  const JointMap& map_;
  TargetBody target_;
  body::Frames<double> neutral_;  ///< of the source at zero angles
  std::size_t keys_ = 0;
  std::vector<body::Frames<double>> frames_;  ///< of the source
  std::vector<KeyGoal> goals_;
  FootContacts contacts_;
  std::vector<int> spine_;  ///< source joints from root to neck
  bool upright_ = false;
  double scale_ = 1, ground_ = 0, waist_ = 0.5;
  Vec shoulders_{0, 1, 0}, torso_up_{0, 0, 1}, torso_across_{0, 1, 0};
  Quat pelvis_ = Quat::identity(), head_ = Quat::identity();
  std::array<std::array<Quat, 2>, 2> limb_;  ///< of each side: thigh and upper arm
  std::array<Quat, 2> foot_;
  std::array<double, 2> flat_height_{0, 0}, raise_{0, 0}, foot_offset_{0, 0};
};

/// The rate a retargeted clip has, for keys at the source's times; 0 keeps them.
inline double retarget_fps(const Clip& clip, const RetargetOptions& options) {
  const double fps = (clip.keys() - 1) / clip.duration();
  if (fps > options.most_fps * 1.01) return options.most_fps;
  // A whole multiple keeps the keys there are.
  if (fps < options.least_fps * 0.99) return fps * std::ceil(options.least_fps / fps - 0.01);
  for (int k = 1; k < clip.keys(); ++k)
    if (std::abs((clip.times[k] - clip.times[k - 1]) * fps - 1) > 0.02) return fps;
  return 0;
}

}  // namespace detail

/// The motion of any humanoid on the character's own skeleton. z up; the ground is at height 0.
///
/// Bones keep the source's directions and get the character's lengths; the root's path is scaled by the ratio of leg lengths.
/// Feet, trunk and head get the source's orientations, calibrated on the clip itself, so that the two rest poses need not
/// agree. Feet that stand are held in place, shapes above ground and joints within range by one nonlinear least-squares
/// problem over all keys. Where the source's bones match the character's within 1 %, rotations are copied instead and only
/// the ground height changes.
///
/// The result has the source's keys at 30 to 60 frames per second, begins above the origin heading +x, and carries contact
/// labels. Throws Error when the source lacks joints the character needs, naming them, when its root is not free, or when a
/// limb's bone has no length.
inline Retargeted retarget(const Clip& source, const body::Character& character, const RetargetOptions& options = {}) {
  source.check();
  detail::require_free_root(source);
  if (!character.skeleton.free_root()) throw Error("character '" + character.name + "': retargeting: expected a free root");
  const JointMap map = map_joints(source.skeleton, character.skeleton, options.joints, detail::where(source));
  const double fps = detail::retarget_fps(source, options);
  const Clip keyed = fps > 0 ? resample(source, fps) : source;
  Retargeted out;
  out.report.unmapped = map.unmapped;
  out.clip.name = source.name;
  out.clip.skeleton = character.skeleton;
  out.clip.times = keyed.times;
  out.clip.cyclic = source.cyclic;
  detail::Retargeter work(keyed, character, map, options);
  if (!options.direct || !work.copy(out)) work.solve(out);
  work.measure(out);
  if (options.align) out.clip = align(out.clip).clip;
  out.clip.check();
  return out;
}

}  // namespace traceur::motion
