// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <array>
#include <filesystem>
#include <string>
#include <string_view>
#include <unordered_set>
#include <utility>

#include "traceur/io/detail/json.hpp"
#include "traceur/io/load_report.hpp"

namespace traceur::io {

/// The humanoid of PARC's clips: 15 bodies, z up, x forward, arms stretched sideways at zero rotations; all joints
/// balls.
inline body::Skeleton parc_skeleton() {
  struct Row {
    const char* name;
    const char* body;
    int parent;
    core::Vector3<double> offset;
  };
  const std::array<Row, 15> rows{{
      {"root", "pelvis", -1, {0, 0, 0}},
      {"abdomen", "torso", 0, {0, 0, 0.236151}},
      {"neck", "head", 1, {0, 0, 0.223894}},
      {"right_shoulder", "right_upper_arm", 1, {-0.02405, -0.18311, 0.2435}},
      {"right_elbow", "right_lower_arm", 3, {0, -0.274788, 0}},
      {"right_wrist", "right_hand", 4, {0, -0.258947, 0}},
      {"left_shoulder", "left_upper_arm", 1, {-0.02405, 0.18311, 0.2435}},
      {"left_elbow", "left_lower_arm", 6, {0, 0.274788, 0}},
      {"left_wrist", "left_hand", 7, {0, 0.258947, 0}},
      {"right_hip", "right_thigh", 0, {0, -0.084887, 0}},
      {"right_knee", "right_shin", 9, {0, 0, -0.421546}},
      {"right_ankle", "right_foot", 10, {0, 0, -0.40987}},
      {"left_hip", "left_thigh", 0, {0, 0.084887, 0}},
      {"left_knee", "left_shin", 12, {0, 0, -0.421546}},
      {"left_ankle", "left_foot", 13, {0, 0, -0.40987}},
  }};
  body::Skeleton s;
  for (const Row& row : rows) {
    body::Joint j;
    j.name = row.name;
    j.body = row.body;
    j.parent = row.parent;
    j.type = row.parent < 0 ? body::JointType::free : body::JointType::ball;
    j.offset = row.offset;
    s.add(std::move(j));
  }
  return s;
}

namespace detail {

inline double read_fps(const Json& root, const std::string& where) {
  const double fps = to_number(member(root, "fps", where), where + ": fps");
  if (!(fps > 1e-3 && fps < 1e6)) throw Error(where + ": fps: expected frames a second, more than 0");
  return fps;
}

/// Sizes times and poses for `frames` keys.
inline void start_clip(motion::Clip& clip, std::size_t frames, double fps, const std::string& where) {
  if (frames < 2) throw Error(where + ": expected at least two frames, found " + std::to_string(frames));
  const auto keys = static_cast<Eigen::Index>(frames);
  clip.name = std::filesystem::path(where).stem().string();
  clip.times = Eigen::VectorXd::LinSpaced(keys, 0, static_cast<double>(keys - 1));
  clip.times /= fps;
  clip.poses.setZero(clip.skeleton.nq(), keys);
}

inline std::string entry(const std::string& where, const char* key, std::size_t i) {
  return where + ": " + key + "[" + std::to_string(i) + "]";
}

inline body::Skeleton amp_skeleton(const Json& root, const std::string& where) {
  const Json::array_t& names = to_array(member(root, "node_names", where), where + ": node_names");
  const std::size_t n = names.size();
  if (n == 0 || n > static_cast<std::size_t>(most_joints))
    throw Error(where + ": node_names: expected 1 to " + std::to_string(most_joints) + " names, found " +
                std::to_string(n));
  const Json::array_t& parents = to_array(member(root, "parent_indices", where), n, where + ": parent_indices");
  const Json::array_t& offsets = to_array(member(root, "local_translation", where), n, where + ": local_translation");
  body::Skeleton s;
  std::unordered_set<std::string> seen;
  for (std::size_t i = 0; i < n; ++i) {
    body::Joint j;
    j.name = j.body = to_text(names[i], entry(where, "node_names", i));
    if (!seen.insert(j.name).second)
      throw Error(entry(where, "node_names", i) + ": a second node named " + shown(j.name));
    const double parent = to_number(parents[i], entry(where, "parent_indices", i));
    const bool valid =
        i == 0 ? parent == -1 : parent >= 0 && parent < static_cast<double>(i) && parent == std::floor(parent);
    if (!valid)
      throw Error(entry(where, "parent_indices", i) + ": expected " + (i == 0 ? "-1" : "the index of an earlier node"));
    j.parent = static_cast<int>(parent);
    j.type = i == 0 ? body::JointType::free : body::JointType::ball;
    // The root's place is in the clip.
    if (i > 0) j.offset = to_vector(offsets[i], entry(where, "local_translation", i));
    s.add(std::move(j));
  }
  return s;
}

inline void read_amp(const Json& root, const std::string& where, LoadedClip& out) {
  motion::Clip& clip = out.clip;
  if (const auto local = root.find("is_local"); local != root.end() && !(local->is_boolean() && local->get<bool>()))
    throw Error(where + ": is_local: expected true (rotations seen from the parent)");
  const double fps = read_fps(root, where);
  clip.skeleton = amp_skeleton(root, where);
  const Json::array_t& positions = to_array(member(root, "root_translation", where), where + ": root_translation");
  const Json::array_t& rotations = to_array(member(root, "rotation", where), positions.size(), where + ": rotation");
  start_clip(clip, positions.size(), fps, where);
  const auto n = static_cast<std::size_t>(clip.skeleton.size());
  for (std::size_t k = 0; k < positions.size(); ++k) {
    double* q = clip.poses.col(static_cast<Eigen::Index>(k)).data();
    to_vector(positions[k], entry(where, "root_translation", k)).store(q);
    const std::string at = entry(where, "rotation", k);
    const Json::array_t& row = to_array(rotations[k], n, at);
    for (std::size_t i = 0; i < n; ++i)
      to_quaternion(row[i], at + "[" + std::to_string(i) + "]")
          .store(q + (i == 0 ? 3 : clip.skeleton[static_cast<int>(i)].q_index));
  }
  out.report.format = "AMP JSON";
  out.report.fps = fps;
}

inline TerrainHeights read_heights(const Json& terrain, const std::string& where) {
  TerrainHeights out;
  const Json::array_t& rows = to_array(member(terrain, "hf", where), where + ".hf");
  if (rows.empty()) throw Error(where + ".hf: expected at least one row of heights");
  const std::size_t columns = to_array(rows[0], where + ".hf[0]").size();
  if (columns == 0) throw Error(where + ".hf[0]: expected at least one height");
  for (std::size_t i = 0; i < rows.size(); ++i) to_array(rows[i], columns, entry(where, "hf", i));
  out.heights.resize(static_cast<Eigen::Index>(rows.size()), static_cast<Eigen::Index>(columns));
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const std::string at = entry(where, "hf", i);
    const Json::array_t& row = rows[i].get_ref<const Json::array_t&>();
    for (std::size_t j = 0; j < columns; ++j)
      out.heights(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = to_number(row[j], at);
  }
  const Json::array_t& corner = to_array(member(terrain, "min_point", where), 2, where + ".min_point");
  out.min_point = {to_number(corner[0], where + ".min_point"), to_number(corner[1], where + ".min_point")};
  out.dx = to_number(member(terrain, "dx", where), where + ".dx");
  if (!(out.dx > 0)) throw Error(where + ".dx: expected metres, more than 0");
  return out;
}

inline void read_parc(const Json& root, const std::string& where, LoadedClip& out) {
  motion::Clip& clip = out.clip;
  const double fps = read_fps(root, where);
  bool wraps = false;
  if (const auto mode = root.find("loop_mode"); mode != root.end()) {
    const std::string& loop = to_text(*mode, where + ": loop_mode");
    if (loop != "CLAMP" && loop != "WRAP")
      throw Error(where + ": loop_mode: expected CLAMP or WRAP, found " + shown(loop));
    wraps = loop == "WRAP";
  }
  clip.skeleton = parc_skeleton();
  const Json::array_t& positions = to_array(member(root, "root_pos", where), where + ": root_pos");
  const std::size_t frames = positions.size();
  const Json::array_t& turns = to_array(member(root, "root_rot", where), frames, where + ": root_rot");
  const Json::array_t& joints = to_array(member(root, "joint_rot", where), frames, where + ": joint_rot");
  start_clip(clip, frames, fps, where);
  for (std::size_t k = 0; k < frames; ++k) {
    double* q = clip.poses.col(static_cast<Eigen::Index>(k)).data();
    to_vector(positions[k], entry(where, "root_pos", k)).store(q);
    to_quaternion(turns[k], entry(where, "root_rot", k)).store(q + 3);
    const std::string at = entry(where, "joint_rot", k);
    const Json::array_t& row = to_array(joints[k], 14, at);
    for (std::size_t i = 0; i < 14; ++i) to_quaternion(row[i], at + "[" + std::to_string(i) + "]").store(q + 7 + 4 * i);
  }
  if (const auto labels = root.find("body_contacts"); labels != root.end()) {
    const Json::array_t& list = to_array(*labels, frames, where + ": body_contacts");
    clip.contacts.resize(15, static_cast<Eigen::Index>(frames));
    for (std::size_t k = 0; k < frames; ++k) {
      const std::string at = entry(where, "body_contacts", k);
      const Json::array_t& row = to_array(list[k], 15, at);
      for (std::size_t i = 0; i < 15; ++i) {
        const double label = to_number(row[i], at);
        if (!(label >= 0 && label <= 1)) throw Error(at + ": expected labels from 0 to 1");
        clip.contacts(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = label;
      }
    }
  }
  if (const auto terrain = root.find("terrain"); terrain != root.end())
    out.terrain = read_heights(*terrain, where + ": terrain");
  out.report.format = "PARC JSON";
  out.report.fps = fps;
  if (wraps) make_cyclic(out);
}

}  // namespace detail

/// Reads a clip from the text of one of two JSON layouts, both z up, metres, quaternions x y z w. `where` names it in
/// messages. Throws Error that names field and frame.
///
/// The AMP layout brings its skeleton (node_names, parent_indices, local_translation) and has root_translation and, for
/// every frame, one local rotation a node. PARC's has root_pos, root_rot and 14 joint_rot for `parc_skeleton()`,
/// contact labels and the ground.
inline LoadedClip parse_motion_json(std::string_view text, const std::string& where) {
  using namespace detail;
  const Json root = parse_json(text, where);
  if (!root.is_object()) throw Error(where + ": expected an object with root_translation (AMP) or root_pos (PARC)");
  LoadedClip out;
  out.report.source = where;
  out.report.unit_reason = out.report.up_reason = "as the format has it";
  out.report.up = "z";
  out.report.rotation_order = "quaternions x y z w";
  out.report.fps_reason = "fps";
  if (root.contains("root_translation"))
    read_amp(root, where, out);
  else if (root.contains("root_pos"))
    read_parc(root, where, out);
  else
    throw Error(where + ": expected a field root_translation (AMP) or root_pos (PARC), found neither");
  const std::array<std::string_view, 16> used{
      "format",    "source",           "fps",      "loop_mode",  "root_pos",       "root_rot",
      "joint_rot", "body_contacts",    "terrain",  "node_names", "parent_indices", "local_translation",
      "is_local",  "root_translation", "rotation", "name"};
  for (const auto& field : root.items())
    if (std::find(used.begin(), used.end(), field.key()) == used.end() && out.report.notes.size() < 20)
      out.report.notes.push_back("dropped the field " + shown(field.key()));
  out.clip.check();
  return out;
}

/// Reads a JSON clip file; see parse_motion_json.
inline LoadedClip read_motion_json(const std::filesystem::path& path) {
  return parse_motion_json(detail::read_text(path), path.string());
}

}  // namespace traceur::io
