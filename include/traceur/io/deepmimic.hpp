// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <string>
#include <string_view>

#include "traceur/io/detail/json.hpp"
#include "traceur/io/load_report.hpp"

namespace traceur::io {

struct DeepMimicOptions {
  std::filesystem::path skeleton;  ///< the character file; empty: the built-in humanoid, equal to humanoid3d.txt
};

namespace detail {

struct DeepMimicJoint {
  const char* name;
  const char* body;
  int parent;
  body::JointType type;
  double x, y, z;  ///< attachment in the parent's frame, file axes (y up, x forward, z right), m
};

/// The joints of the DeepMimic humanoid in the order of its clips; bodies named as in the MJCF model of the same
/// proportions.
inline constexpr std::array<DeepMimicJoint, 15> deepmimic_joints{{
    {"root", "pelvis", -1, body::JointType::free, 0, 0, 0},
    {"chest", "torso", 0, body::JointType::ball, 0, 0.236151, 0},
    {"neck", "head", 1, body::JointType::ball, 0, 0.223894, 0},
    {"right_hip", "right_thigh", 0, body::JointType::ball, 0, 0, 0.084887},
    {"right_knee", "right_shin", 3, body::JointType::hinge, 0, -0.421546, 0},
    {"right_ankle", "right_foot", 4, body::JointType::ball, 0, -0.40987, 0},
    {"right_shoulder", "right_upper_arm", 1, body::JointType::ball, -0.02405, 0.2435, 0.18311},
    {"right_elbow", "right_lower_arm", 6, body::JointType::hinge, 0, -0.274788, 0},
    {"right_wrist", "right_hand", 7, body::JointType::fixed, 0, -0.258947, 0},
    {"left_hip", "left_thigh", 0, body::JointType::ball, 0, 0, -0.084887},
    {"left_knee", "left_shin", 9, body::JointType::hinge, 0, -0.421546, 0},
    {"left_ankle", "left_foot", 10, body::JointType::ball, 0, -0.40987, 0},
    {"left_shoulder", "left_upper_arm", 1, body::JointType::ball, -0.02405, 0.2435, -0.18311},
    {"left_elbow", "left_lower_arm", 12, body::JointType::hinge, 0, -0.274788, 0},
    {"left_wrist", "left_hand", 13, body::JointType::fixed, 0, -0.258947, 0},
}};

/// File axes (y up, x forward, z right) to house axes: x stays, y becomes z, z becomes -y.
inline core::Vector3<double> from_deepmimic(double x, double y, double z) { return {x, -z, y}; }

inline body::Skeleton deepmimic_skeleton(const std::array<core::Vector3<double>, 15>& attach) {
  body::Skeleton s;
  for (std::size_t i = 0; i < deepmimic_joints.size(); ++i) {
    const DeepMimicJoint& d = deepmimic_joints[i];
    body::Joint j;
    j.name = d.name;
    j.body = d.body;
    j.parent = d.parent;
    j.type = d.type;
    j.offset = from_deepmimic(attach[i].x, attach[i].y, attach[i].z);
    // The file's hinges turn about its z axis.
    if (d.type == body::JointType::hinge) j.axis = {0, -1, 0};
    s.add(std::move(j));
  }
  return s;
}

}  // namespace detail

/// The DeepMimic humanoid: 15 bodies, hinge knees and elbows about -y, arms hanging at zero angles.
inline body::Skeleton deepmimic_skeleton() {
  std::array<core::Vector3<double>, 15> attach;
  for (std::size_t i = 0; i < attach.size(); ++i)
    attach[i] = {detail::deepmimic_joints[i].x, detail::deepmimic_joints[i].y, detail::deepmimic_joints[i].z};
  return detail::deepmimic_skeleton(attach);
}

/// Reads the skeleton of a DeepMimic character from text: the 15 joints of the humanoid in their order, any
/// proportions. `where` names the text in messages. Throws Error that names joint and field.
inline body::Skeleton parse_deepmimic_skeleton(std::string_view text, const std::string& where) {
  using namespace detail;
  const Json root = parse_json(text, where);
  const Json& list = member(member(root, "Skeleton", where), "Joints", where + ": Skeleton");
  const Json::array_t& joints = to_array(list, deepmimic_joints.size(), where + ": Skeleton.Joints");
  std::array<core::Vector3<double>, 15> attach;
  for (std::size_t i = 0; i < joints.size(); ++i) {
    const DeepMimicJoint& expected = deepmimic_joints[i];
    const Json& j = joints[i];
    const std::string at = where + ": joint " + std::to_string(i);
    const std::string& name = to_text(member(j, "Name", at), at + ": Name");
    if (name != expected.name) throw Error(at + ": expected '" + expected.name + "', found " + shown(name));
    const std::string& type = to_text(member(j, "Type", at), at + ": Type");
    const char* wanted = expected.type == body::JointType::free    ? "none"
                         : expected.type == body::JointType::ball  ? "spherical"
                         : expected.type == body::JointType::hinge ? "revolute"
                                                                   : "fixed";
    if (type != wanted) throw Error(at + " '" + name + "': expected type " + wanted + ", found " + shown(type));
    if (to_number(member(j, "Parent", at), at + ": Parent") != expected.parent)
      throw Error(at + " '" + name + "': expected parent " + std::to_string(expected.parent));
    for (const char* key : {"AttachThetaX", "AttachThetaY", "AttachThetaZ"})
      if (j.contains(key) && to_number(j[key], at + ": " + key) != 0)
        throw Error(at + " '" + name + "': " + key + ": expected 0");
    attach[i] = {to_number(member(j, "AttachX", at), at + ": AttachX"),
                 to_number(member(j, "AttachY", at), at + ": AttachY"),
                 to_number(member(j, "AttachZ", at), at + ": AttachZ")};
  }
  return detail::deepmimic_skeleton(attach);
}

/// Reads a DeepMimic clip from text. `where` names it in messages.
///
/// A frame holds 44 numbers: seconds to the next frame, root position, root quaternion (w x y z), then the joints in
/// the skeleton's order, quaternions w x y z or one angle. The time of the last frame leads nowhere and is dropped. A
/// clip that wraps is cyclic; the report tells how far its last frame is from its first. Published clips hold
/// quaternions as short as 0.58: between 0.5 and 1.5 they are scaled to unit length and the report says so. Throws
/// Error that names frame and field.
inline LoadedClip parse_deepmimic(std::string_view text, const std::string& where,
                                  const body::Skeleton& skeleton = deepmimic_skeleton()) {
  using namespace detail;
  const Json root = parse_json(text, where);
  const std::string& loop = to_text(member(root, "Loop", where), where + ": Loop");
  if (loop != "wrap" && loop != "none") throw Error(where + ": Loop: expected wrap or none, found " + shown(loop));
  const Json::array_t& frames = to_array(member(root, "Frames", where), where + ": Frames");
  if (frames.size() < 2)
    throw Error(where + ": Frames: expected at least two frames, found " + std::to_string(frames.size()));

  LoadedClip out;
  motion::Clip& clip = out.clip;
  clip.name = std::filesystem::path(where).stem().string();
  clip.skeleton = skeleton;
  const auto keys = static_cast<Eigen::Index>(frames.size());
  clip.times.resize(keys);
  clip.poses.resize(skeleton.nq(), keys);
  double time = 0, shortest = 1, longest = 1;
  int off_unit = 0;
  for (Eigen::Index k = 0; k < keys; ++k) {
    const std::string at = where + ": frame " + std::to_string(k);
    const Json::array_t& row = to_array(frames[static_cast<std::size_t>(k)], 44, at);
    std::size_t next = 0;
    const auto number = [&](const char* name) {
      const std::size_t entry = next++;
      if (!row[entry].is_number())
        throw Error(at + ", number " + std::to_string(entry) + " (" + name + "): expected a number");
      return to_number(row[entry], at + ", number " + std::to_string(entry) + " (" + name + ")");
    };
    const auto quaternion = [&](const char* name) {
      const double w = number(name), x = number(name), y = number(name), z = number(name);
      const core::Vector3<double> v = from_deepmimic(x, y, z);
      const double length = std::sqrt(w * w + x * x + y * y + z * z);
      if (!(length > 0.5 && length < 1.5))
        throw Error(at + ", " + name + ": expected a unit quaternion, found length " + short_number(length));
      if (std::abs(length - 1) > 1e-3) ++off_unit;
      shortest = std::min(shortest, length);
      longest = std::max(longest, length);
      return core::Quaternion<double>{v.x / length, v.y / length, v.z / length, w / length};
    };
    clip.times[k] = time;
    const double duration = number("duration");
    if (k + 1 < keys && !(duration > 0)) throw Error(at + ": duration: expected seconds, more than 0");
    time += duration;
    double* q = clip.poses.col(k).data();
    for (const body::Joint& j : skeleton.joints()) {
      const char* name = j.name.c_str();
      if (j.type == body::JointType::free) {
        const double x = number(name), y = number(name), z = number(name);
        from_deepmimic(x, y, z).store(q);
        quaternion(name).store(q + 3);
      } else if (j.type == body::JointType::ball) {
        quaternion(name).store(q + j.q_index);
      } else if (j.type == body::JointType::hinge) {
        q[j.q_index] = number(name);
      }
    }
  }
  clip.check();
  LoadReport& report = out.report;
  report.source = where;
  report.format = "DeepMimic";
  report.unit_reason = report.up_reason = "as the format has it";
  report.up = "y";
  report.rotation_order = "quaternions w x y z; hinge angles in radians";
  report.fps = 1 / clip.times[1];
  report.fps_reason = "duration of the first frame";
  if (off_unit > 0)
    report.notes.push_back("scaled " + std::to_string(off_unit) + " quaternions to unit length; their lengths were " +
                           short_number(shortest) + " to " + short_number(longest));
  if (loop == "wrap") make_cyclic(out);
  return out;
}

/// Reads a DeepMimic clip file; see parse_deepmimic.
inline LoadedClip read_deepmimic(const std::filesystem::path& path, const DeepMimicOptions& options = {}) {
  const std::string text = detail::read_text(path);
  if (options.skeleton.empty()) return parse_deepmimic(text, path.string());
  return parse_deepmimic(text, path.string(),
                         parse_deepmimic_skeleton(detail::read_text(options.skeleton), options.skeleton.string()));
}

}  // namespace traceur::io
