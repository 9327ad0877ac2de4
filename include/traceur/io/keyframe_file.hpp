// SPDX-License-Identifier: MIT
#pragma once

#include <filesystem>
#include <fstream>
#include <numbers>
#include <sstream>
#include <string>

#include <nlohmann/json.hpp>

#include "traceur/io/detail/json.hpp"
#include "traceur/motion/keyframes.hpp"

namespace traceur::io {

namespace detail {

inline int keyframe_joint(const body::Skeleton& skeleton, const std::string& name, const std::string& where) {
  const int joint = skeleton.find(name);
  if (joint < 0) throw Error(where + ": the character has no joint '" + name + "'");
  return joint;
}

}  // namespace detail

/// An authored motion as text: one JSON object.
///
///     {"format": "traceur keyframes 1", "name": "leap", "fps": 60, "keys": [
///       {"time_s": 0, "root_m": [0, 0, 0.9], "root_deg": [0, 10, 0],
///        "joints_deg": {"right_hip": [0, -30, 0], "right_knee": [40]},
///        "pins": [{"joint": "right_ankle", "point_m": [0, 0, 0], "at_m": [0.1, -0.1, 0.06], "weight": 1}]}, ...]}
///
/// Rotations are rotation vectors in degrees, of hinges one angle. A joint or root that a key leaves out is as in the key
/// before; in the first, as at rest. Point and weight of a pin may be left out. Throws Error that names line or field.
inline motion::Clip keyframes_from_text(std::string_view text, const body::Skeleton& skeleton, const std::string& where) {
  using detail::member, detail::to_array, detail::to_number, detail::to_text, detail::to_vector;
  const detail::Json json = detail::parse_json(text, where);
  if (to_text(member(json, "format", where), where + ": format") != "traceur keyframes 1")
    throw Error(where + ": expected the format 'traceur keyframes 1'");
  const std::string name = to_text(member(json, "name", where), where + ": name");
  const double fps = json.contains("fps") ? to_number(json["fps"], where + ": fps") : 60;
  constexpr double degree = std::numbers::pi / 180;
  std::vector<motion::Keyframe> keys;
  Eigen::VectorXd pose = skeleton.neutral_pose();
  for (const detail::Json& entry : to_array(member(json, "keys", where), where + ": keys")) {
    const std::string here = where + ": key " + std::to_string(keys.size());
    motion::Keyframe key;
    key.time = to_number(member(entry, "time_s", here), here + ": time_s");
    if (entry.contains("root_m") || entry.contains("root_deg")) {
      if (!skeleton.free_root()) throw Error(here + ": the character's root cannot move");
      if (entry.contains("root_m")) to_vector(entry["root_m"], here + ": root_m").store(pose.data());
      if (entry.contains("root_deg")) core::exp_map(degree * to_vector(entry["root_deg"], here + ": root_deg")).store(pose.data() + 3);
    }
    if (entry.contains("joints_deg")) {
      if (!entry["joints_deg"].is_object()) throw Error(here + ": joints_deg: expected an object");
      for (const auto& [joint, value] : entry["joints_deg"].items()) {
        const body::Joint& j = skeleton[detail::keyframe_joint(skeleton, joint, here)];
        const std::string field = here + ": " + joint;
        if (j.type == body::JointType::ball)
          core::exp_map(degree * to_vector(value, field)).store(pose.data() + j.q_index);
        else if (j.type == body::JointType::hinge)
          pose[j.q_index] = degree * to_number(to_array(value, 1, field)[0], field);
        else
          throw Error(field + ": expected a joint that turns");
      }
    }
    if (entry.contains("pins"))
      for (const detail::Json& p : to_array(entry["pins"], here + ": pins")) {
        const std::string field = here + ": pin " + std::to_string(key.pins.size());
        motion::KeyframePin pin;
        pin.joint = detail::keyframe_joint(skeleton, to_text(member(p, "joint", field), field + ": joint"), field);
        if (p.contains("point_m")) pin.point = to_vector(p["point_m"], field + ": point_m");
        pin.target = to_vector(member(p, "at_m", field), field + ": at_m");
        if (p.contains("weight")) pin.weight = to_number(p["weight"], field + ": weight");
        key.pins.push_back(pin);
      }
    key.pose = pose;
    keys.push_back(std::move(key));
  }
  try {
    return motion::from_keyframes(name, skeleton, keys, fps);
  } catch (const Error& e) {
    throw Error(where + ": " + e.what());
  }
}

/// The same of a file.
inline motion::Clip read_keyframes(const std::filesystem::path& path, const body::Skeleton& skeleton) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  if (!in || !(text << in.rdbuf())) throw Error(path.string() + ": cannot be read");
  return keyframes_from_text(text.str(), skeleton, path.string());
}

}  // namespace traceur::io
