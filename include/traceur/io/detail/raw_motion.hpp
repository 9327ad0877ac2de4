// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "traceur/body/kinematics.hpp"
#include "traceur/io/detail/text.hpp"
#include "traceur/io/load_report.hpp"

namespace traceur::io::detail {

using core::Matrix3;
using core::Quaternion;
using core::Vector3;

struct RawJoint {
  std::string name;
  int parent = -1;
  Vector3<double> offset{0, 0, 0};
  bool fixed = false;
};

/// A motion as its file has it: file units, file axes.
struct RawMotion {
  std::string where;  ///< file name for messages
  std::string name;
  std::vector<RawJoint> joints;
  std::size_t frames = 0;
  double dt = 0;                              ///< s
  std::vector<Vector3<double>> root;          ///< root position of each frame
  std::vector<Quaternion<double>> rotations;  ///< frame-major: rotation of each joint seen from its parent

  const Quaternion<double>& rotation(std::size_t frame, std::size_t joint) const {
    return rotations[frame * joints.size() + joint];
  }
};

/// Where the parts of a human body are in a skeleton; -1 where they were not recognised.
struct Anatomy {
  int left_ankle = -1, right_ankle = -1, left_hip = -1, right_hip = -1;
  int spine = -1;     ///< first joint above the root, on the way to the head, that is not at the root
  int head_top = -1;  ///< end of the head
  double leg = 0;     ///< hip to ankle along the bones, file units; mean of both sides
  double trunk = 0;   ///< root to head top along the bones, file units
  bool legs() const { return left_ankle >= 0 && right_ankle >= 0; }
  bool complete() const { return legs() && head_top >= 0 && spine >= 0; }
};

/// Name of the joint on the other side, or empty when the name tells no side.
inline std::vector<std::string> mirrored_names(const std::string& name) {
  std::vector<std::string> out;
  constexpr std::array<std::array<const char*, 2>, 6> words{{{"left", "right"},
                                                             {"Left", "Right"},
                                                             {"LEFT", "RIGHT"},
                                                             {"right", "left"},
                                                             {"Right", "Left"},
                                                             {"RIGHT", "LEFT"}}};
  for (const auto& [from, to] : words)
    if (const std::size_t at = name.find(from); at != std::string::npos)
      out.push_back(std::string(name).replace(at, std::char_traits<char>::length(from), to));
  const auto swapped = [](char c) { return c == 'l' ? 'r' : c == 'L' ? 'R' : c == 'r' ? 'l' : c == 'R' ? 'L' : c; };
  const auto swap_at = [&](std::size_t at) {
    if (at >= name.size() || swapped(name[at]) == name[at]) return;
    std::string other = name;
    other[at] = swapped(name[at]);
    out.push_back(other);
  };
  swap_at(0);
  const std::size_t space = name.find_first_of(":_");
  if (space != std::string::npos) swap_at(space + 1);
  if (name.size() > 2 && (name[name.size() - 2] == '_' || name[name.size() - 2] == '.')) swap_at(name.size() - 1);
  return out;
}

/// Recognises legs and head by name. A side counts only where the joint of the other side exists too.
inline Anatomy find_anatomy(const std::vector<RawJoint>& joints) {
  const int n = static_cast<int>(joints.size());
  const auto at = [&](int i) -> const RawJoint& { return joints[static_cast<std::size_t>(i)]; };
  const auto length = [&](int i) { return norm(at(i).offset); };
  std::unordered_map<std::string, int> index;
  for (int i = 0; i < n; ++i) index.emplace(at(i).name, i);
  const auto partner = [&](int i) {
    for (const std::string& other : mirrored_names(at(i).name))
      if (const auto found = index.find(other); found != index.end()) return found->second;
    return -1;
  };

  Anatomy a;
  std::vector<bool> of_leg(joints.size(), false);
  for (int i = 1; i < n && !a.legs(); ++i) {
    const std::string name = lowered(at(i).name);
    if (at(i).fixed && name.ends_with("_end")) continue;
    if (name.find("foot") == std::string::npos && name.find("ankle") == std::string::npos) continue;
    const int other = partner(i);
    if (other < 0 || other == i) continue;
    // Of a pair that differs in one letter or word the left one has the l: 'left' < 'right' and 'l' < 'r'.
    const bool left = lowered(at(i).name) < lowered(at(other).name);
    a.left_ankle = left ? i : other;
    a.right_ankle = left ? other : i;
  }
  if (a.legs()) {
    const auto leg = [&](int ankle, int& hip) {
      std::vector<int> chain;
      for (int i = ankle; i > 0; i = at(i).parent) chain.push_back(i);
      double longest = 0, total = 0;
      for (const int i : chain) longest = std::max(longest, length(i));
      for (const int i : chain) total += length(i);
      // The first bone that has a length leads from the root to the hip, unless it is the thigh itself.
      for (std::size_t k = chain.size(); k-- > 0;) {
        if (length(chain[k]) <= 1e-3 * longest) continue;
        if (length(chain[k]) < 0.6 * longest) {
          hip = chain[k];
          total -= length(chain[k]);
        }
        break;
      }
      for (const int i : chain) of_leg[static_cast<std::size_t>(i)] = true;
      return total;
    };
    a.leg = 0.5 * (leg(a.left_ankle, a.left_hip) + leg(a.right_ankle, a.right_hip));
    of_leg[0] = false;
    for (int i = 1; i < n; ++i)
      if (of_leg[static_cast<std::size_t>(at(i).parent)]) of_leg[static_cast<std::size_t>(i)] = true;
  }

  std::vector<double> reach(joints.size(), 0.0);
  for (int i = 1; i < n; ++i)
    reach[static_cast<std::size_t>(i)] = reach[static_cast<std::size_t>(at(i).parent)] + length(i);
  int head = -1;
  for (int i = 1; i < n && head < 0; ++i)
    if (lowered(at(i).name).find("head") != std::string::npos && !of_leg[static_cast<std::size_t>(i)] && length(i) > 0)
      head = i;
  if (head >= 0) {
    a.head_top = head;
    for (int i = head + 1; i < n; ++i)
      if (at(i).parent == head && at(i).fixed) a.head_top = i;
  } else if (a.legs()) {
    // Without a head the end of the spine stands for it: the farthest end site that belongs to neither side.
    for (int i = 1; i < n; ++i) {
      if (of_leg[static_cast<std::size_t>(i)] || !at(i).fixed || !at(i).name.ends_with("_end")) continue;
      bool sided = false;
      for (int p = i; p > 0; p = at(p).parent) sided = sided || partner(p) >= 0;
      if (!sided &&
          (a.head_top < 0 || reach[static_cast<std::size_t>(i)] > reach[static_cast<std::size_t>(a.head_top)]))
        a.head_top = i;
    }
  }
  if (a.head_top >= 0) {
    a.trunk = reach[static_cast<std::size_t>(a.head_top)];
    for (int i = a.head_top; i > 0; i = at(i).parent)
      if (length(i) > 1e-3 * a.trunk) a.spine = i;
  }
  return a;
}

/// Leg length, hip joint to ankle, as a share of body height: thigh 0.245 and shank 0.246 of it (Winter, Biomechanics).
inline constexpr double leg_share = 0.491;
inline constexpr double shortest_person = 1.2, tallest_person = 2.2;  ///< m

struct Unit {
  double metres;
  const char* name;
};
inline constexpr std::array<Unit, 5> known_units{{{1, "metres"},
                                                  {0.01, "centimetres"},
                                                  {0.001, "millimetres"},
                                                  {0.0254, "inches"},
                                                  {0.0254 / 0.45, "CMU units, 1/0.45 inch"}}};

inline bool plausible_unit(const Anatomy& a, double unit) {
  const double height = unit * a.leg / leg_share, trunk = unit * a.trunk;
  return height >= shortest_person && height <= tallest_person && trunk >= 0.25 * shortest_person &&
         trunk <= 0.65 * tallest_person;
}

/// The only known unit in which the skeleton is as tall as a person. Throws Error that names the option `unit`.
inline Unit guess_unit(const Anatomy& a, const std::string& where) {
  const std::string option = "; set the option unit (metres in one unit of the file)";
  if (!a.complete())
    throw Error(where +
                ": no length unit given, and no joints named head and left and right foot (or ankle) to tell it from" +
                option);
  std::optional<Unit> found;
  for (const Unit& u : known_units) {
    if (!plausible_unit(a, u.metres)) continue;
    if (found) throw Error(where + ": the skeleton fits a person in " + found->name + " and in " + u.name + option);
    found = u;
  }
  if (!found)
    throw Error(where + ": legs of " + short_number(a.leg) + " units and a trunk of " + short_number(a.trunk) +
                " units fit a person 1.2-2.2 m tall in none of m, cm, mm, inch, CMU unit" + option);
  return *found;
}

/// Index 0..2 of the axis a direction points along, or -1 when it points along none, or against it.
inline int along_axis(const Vector3<double>& v, double share) {
  const double length = norm(v);
  if (!(length > 0)) return -1;
  if (v.x > share * length) return 0;
  if (v.y > share * length) return 1;
  if (v.z > share * length) return 2;
  return -1;
}

/// Positions of all joints of one frame in file axes and units.
inline void raw_positions(const RawMotion& m, std::size_t frame, std::vector<Vector3<double>>& position,
                          std::vector<Quaternion<double>>& rotation) {
  position.resize(m.joints.size());
  rotation.resize(m.joints.size());
  for (std::size_t i = 0; i < m.joints.size(); ++i) {
    const RawJoint& j = m.joints[i];
    if (j.parent < 0) {
      position[i] = m.root[frame];
      rotation[i] = m.rotation(frame, i);
    } else {
      const auto p = static_cast<std::size_t>(j.parent);
      position[i] = position[p] + rotation[p].rotate(j.offset);
      rotation[i] = rotation[p] * m.rotation(frame, i);
    }
  }
}

inline Vector3<double> feet_to_head(const Anatomy& a, const std::vector<Vector3<double>>& p) {
  const auto at = [&](int i) { return p[static_cast<std::size_t>(i)]; };
  return at(a.head_top) - 0.5 * (at(a.left_ankle) + at(a.right_ankle));
}

/// The pelvis' up direction and its left in the root's own axes; zero when not known.
inline Vector3<double> pelvis_up(const RawMotion& m, const Anatomy& a) {
  if (!a.complete()) return {0, 0, 0};
  const auto from_root = [&](int joint) {
    Vector3<double> p{0, 0, 0};
    for (int i = joint; i > 0; i = m.joints[static_cast<std::size_t>(i)].parent)
      p += m.joints[static_cast<std::size_t>(i)].offset;
    return p;
  };
  Vector3<double> hips{0, 0, 0};
  if (a.left_hip >= 0 && a.right_hip >= 0) hips = 0.5 * (from_root(a.left_hip) + from_root(a.right_hip));
  return from_root(a.spine) - hips;
}
inline Vector3<double> pelvis_left(const RawMotion& m, const Anatomy& a) {
  if (a.left_hip < 0 || a.right_hip < 0) return {0, 0, 0};
  return m.joints[static_cast<std::size_t>(a.left_hip)].offset - m.joints[static_cast<std::size_t>(a.right_hip)].offset;
}

inline constexpr const char* axis_names[] = {"x", "y", "z"};

/// y or z, whichever of rest pose and motion speak for. Throws Error that names the option `up` when they disagree.
inline int guess_up(const RawMotion& m, const Anatomy& a, std::string& reason) {
  const std::string option = "; set the option up (the file's axis away from the ground)";
  if (!a.complete())
    throw Error(m.where +
                ": no up axis given, and no joints named head and left and right foot (or ankle) to tell it from" +
                option);
  const auto candidate = [](int axis) { return axis > 0 ? axis : -1; };
  const int rest = candidate(along_axis(pelvis_up(m, a), 0.8));
  std::vector<Vector3<double>> p;
  std::vector<Quaternion<double>> r;
  Vector3<double> sum{0, 0, 0};
  int first = -1;
  for (std::size_t f = 0; f < m.frames; ++f) {
    raw_positions(m, f, p, r);
    const Vector3<double> d = feet_to_head(a, p);
    if (f == 0) first = candidate(along_axis(d, 0.7));
    const double length = norm(d);
    if (length > 0) sum += (1 / length) * d;
  }
  const int mean = candidate(along_axis(sum, 0.7));
  if (rest >= 0) {
    if (first == rest) {
      reason = "head above feet in the rest pose and in the first frame";
    } else if (mean == rest || (first < 0 && mean < 0)) {
      reason = mean == rest ? "head above feet in the rest pose and on average" : "head above feet in the rest pose";
    } else {
      throw Error(m.where + ": the up axis is " + axis_names[rest] + " by the rest pose but " +
                  axis_names[first >= 0 ? first : mean] + " by the motion" + option);
    }
    return rest;
  }
  if (first >= 0 && (mean == first || mean < 0)) {
    reason = "head above feet in the first frame; the rest pose does not stand";
    return first;
  }
  throw Error(m.where + ": neither rest pose nor motion tell whether y or z is up" + option);
}

/// The rotation whose matrix has the given rows, each a signed axis.
inline Quaternion<double> from_rows(const Vector3<double>& x, const Vector3<double>& y, const Vector3<double>& z) {
  Eigen::Matrix3d m;
  m << x.x, x.y, x.z, y.x, y.y, y.z, z.x, z.y, z.z;
  return Quaternion<double>::from(Eigen::Quaterniond(m));
}

/// From file axes to house axes. With y up the file's z is forward and its x left, as motion files have it; with z up
/// axes stay; with x up, y is forward and z left.
inline Quaternion<double> world_turn(int up) {
  const Vector3<double> ex{1, 0, 0}, ey{0, 1, 0}, ez{0, 0, 1};
  return up == 1 ? from_rows(ez, ex, ey) : up == 0 ? from_rows(ey, ez, ex) : Quaternion<double>::identity();
}

inline Vector3<double> snapped(const Vector3<double>& v) {
  const double length = norm(v);
  const auto entry = [&](double e) { return std::abs(e) > 0.8 * length ? (e > 0 ? 1.0 : -1.0) : 0.0; };
  return {entry(v.x), entry(v.y), entry(v.z)};
}

/// Exact zeros for what an axis permutation by quaternion leaves as rounding.
inline Vector3<double> turned(const Quaternion<double>& turn, const Vector3<double>& v) {
  const Matrix3<double> m = turn.matrix();
  const auto clean = [](double e) { return std::round(e); };
  const Matrix3<double> exact{clean(m.xx), clean(m.xy), clean(m.xz), clean(m.yx), clean(m.yy),
                              clean(m.yz), clean(m.zx), clean(m.zy), clean(m.zz)};
  return exact * v;
}

/// What the caller fixed about a raw motion, and what it found out.
struct Conversion {
  double unit;
  int up;
  Anatomy anatomy;
};

/// Turns a raw motion into a clip: metres, z up, the root's own x forward and z up wherever the pelvis tells them.
/// `report` already holds unit and up axis; notes are added.
inline motion::Clip convert(const RawMotion& m, const Conversion& c, LoadReport& report) {
  const Quaternion<double> world = world_turn(c.up);
  Quaternion<double> local = world;
  const Vector3<double> up = snapped(pelvis_up(m, c.anatomy)), left = snapped(pelvis_left(m, c.anatomy));
  if (std::abs(norm(up) - 1) < 1e-9 && std::abs(norm(left) - 1) < 1e-9 && std::abs(dot(up, left)) < 1e-9)
    local = from_rows(cross(left, up), left, up);
  else
    report.notes.push_back("hips and spine do not tell the root's own axes; the root's forward axis is the file's");

  motion::Clip clip;
  clip.name = m.name;
  for (std::size_t i = 0; i < m.joints.size(); ++i) {
    const RawJoint& raw = m.joints[i];
    body::Joint j;
    j.name = raw.name;
    j.body = raw.name;
    j.parent = raw.parent;
    j.type = raw.parent < 0 ? body::JointType::free : raw.fixed ? body::JointType::fixed : body::JointType::ball;
    // The free root's place is in its coordinates alone.
    if (raw.parent >= 0) j.offset = c.unit * turned(local, raw.offset);
    clip.skeleton.add(std::move(j));
  }
  const auto frames = static_cast<Eigen::Index>(m.frames);
  clip.times.resize(frames);
  clip.poses.resize(clip.skeleton.nq(), frames);
  const Quaternion<double> back = local.conjugate();
  for (std::size_t f = 0; f < m.frames; ++f) {
    clip.times[static_cast<Eigen::Index>(f)] = static_cast<double>(f) * m.dt;
    double* q = clip.poses.col(static_cast<Eigen::Index>(f)).data();
    (c.unit * turned(world, m.root[f])).store(q);
    (world * m.rotation(f, 0) * back).normalized().store(q + 3);
    for (int i = 1; i < clip.skeleton.size(); ++i) {
      const body::Joint& j = clip.skeleton[i];
      if (j.type == body::JointType::ball)
        (local * m.rotation(f, static_cast<std::size_t>(i)) * back).normalized().store(q + j.q_index);
    }
  }
  clip.check();

  if (c.anatomy.legs()) {
    report.standing_height = c.unit * c.anatomy.leg / leg_share;
    double lowest = HUGE_VAL;
    body::Frames<double> frames_of(clip.skeleton);
    std::vector<bool> foot(m.joints.size(), false);
    for (std::size_t i = 1; i < m.joints.size(); ++i)
      foot[i] = static_cast<int>(i) == c.anatomy.left_ankle || static_cast<int>(i) == c.anatomy.right_ankle ||
                foot[static_cast<std::size_t>(m.joints[i].parent)];
    for (int k = 0; k < clip.keys(); ++k) {
      body::forward_kinematics(clip.skeleton, clip.poses.col(k).data(), frames_of);
      for (std::size_t i = 0; i < m.joints.size(); ++i)
        if (foot[i]) lowest = std::min(lowest, frames_of.position[i].z);
    }
    if (std::abs(lowest) > 0.25)
      report.notes.push_back("the lowest joint of the feet is at height " + short_number(lowest) +
                             " m: the ground is not at 0, or positions are in another unit than the skeleton");
  }
  if (clip.keys() > 2) {
    Eigen::VectorXd d(clip.skeleton.nv());
    const auto jump = [&](int k) {
      body::difference(clip.skeleton, clip.poses.col(k).data(), clip.poses.col(k + 1).data(), d.data());
      double largest = 0;
      for (const body::Joint& j : clip.skeleton.joints())
        if (j.type == body::JointType::ball) largest = std::max(largest, d.segment(j.v_index, 3).norm());
      return largest;
    };
    const double before = jump(0), after = jump(1);
    if (before > 0.35 && after < 0.1 * before)
      report.notes.push_back(
          "a joint jumps " + short_number(before) +
          " rad after the first frame, which seems to be a rest pose; the option skip_frames = 1 drops it");
  }
  return clip;
}

/// Product of rotations about axes 0..2 (x, y, z) by the angles (rad), left to right.
inline Quaternion<double> rotation_about(int axis, double angle) {
  const double s = std::sin(0.5 * angle), c = std::cos(0.5 * angle);
  return {axis == 0 ? s : 0.0, axis == 1 ? s : 0.0, axis == 2 ? s : 0.0, c};
}

/// 1/n seconds for a step that is that but for the digits a file rounds it to.
inline double tidy_step(double dt) {
  const double n = std::round(1 / dt);
  return n >= 1 && std::abs(1 / dt - n) < 1e-4 * n ? 1 / n : dt;
}

}  // namespace traceur::io::detail
