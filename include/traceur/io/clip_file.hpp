// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cmath>
#include <filesystem>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "traceur/io/atomic_file.hpp"
#include "traceur/io/detail/json.hpp"
#include "traceur/io/load_report.hpp"

namespace traceur::io {

namespace detail {

inline constexpr const char* clip_format = "traceur-clip";
inline constexpr std::array<const char*, 4> joint_type_names{"fixed", "hinge", "ball",
                                                             "free"};  // in the order of body::JointType

inline void append_list(std::string& out, const double* values, Eigen::Index count) {
  out += '[';
  for (Eigen::Index i = 0; i < count; ++i) {
    if (i > 0) out += ',';
    // Without a point a JSON reader takes it for a whole number, which has no negative zero.
    if (values[i] == 0 && std::signbit(values[i]))
      out += "-0.0";
    else
      append_number(out, values[i]);
  }
  out += ']';
}

inline body::Joint parse_joint(const Json& value, const std::string& at) {
  body::Joint j;
  j.name = to_text(member(value, "name", at), at + ".name");
  j.body = to_text(member(value, "body", at), at + ".body");
  const double parent = to_number(member(value, "parent", at), at + ".parent");
  if (!(parent >= -1 && parent < most_joints && parent == std::floor(parent)))
    throw Error(at + ".parent: expected a joint's index or -1");
  j.parent = static_cast<int>(parent);
  const std::string& type = to_text(member(value, "type", at), at + ".type");
  std::size_t t = 0;
  while (t < joint_type_names.size() && type != joint_type_names[t]) ++t;
  if (t == joint_type_names.size())
    throw Error(at + ".type: expected fixed, hinge, ball or free, found " + shown(type));
  j.type = static_cast<body::JointType>(t);
  j.offset = to_vector(member(value, "offset", at), at + ".offset");
  const Json::array_t& r = to_array(member(value, "rest", at), 4, at + ".rest");
  // As it stands, not rescaled: a clip comes back with the bits it was written with.
  j.rest = {to_number(r[0], at + ".rest"), to_number(r[1], at + ".rest"), to_number(r[2], at + ".rest"),
            to_number(r[3], at + ".rest")};
  j.axis = to_vector(member(value, "axis", at), at + ".axis");
  return j;
}

}  // namespace detail

/// The clip as text in our own format, JSON lines: a header with format, version, name, cyclic, keys, whether contact
/// labels follow, and the joints; then one line a key with time `t`, pose `q` and contact labels `c`. Numbers come back
/// bit for bit. Throws Error when the clip does not pass its own check or a name is not UTF-8.
inline std::string format_clip(const motion::Clip& clip) {
  using namespace detail;
  clip.check();
  const body::Skeleton& s = clip.skeleton;
  const auto text = [&](const std::string& value) {
    try {
      return Json(value).dump();
    } catch (const Json::exception&) {
      throw Error("clip " + shown(clip.name) + ": the name " + shown(value) + " is not UTF-8");
    }
  };
  std::string out = std::string("{\"format\":\"") + clip_format + "\",\"version\":1,\"name\":" + text(clip.name) +
                    ",\"cyclic\":" + (clip.cyclic ? "true" : "false") + ",\"keys\":" + std::to_string(clip.keys()) +
                    ",\"contacts\":" + (clip.contacts.cols() != 0 ? "true" : "false") + ",\"joints\":[";
  for (int i = 0; i < s.size(); ++i) {
    const body::Joint& j = s[i];
    if (i > 0) out += ',';
    out += "{\"name\":" + text(j.name) + ",\"body\":" + text(j.body) + ",\"parent\":" + std::to_string(j.parent) +
           ",\"type\":\"" + joint_type_names[static_cast<std::size_t>(j.type)] + "\",\"offset\":";
    const double offset[] = {j.offset.x, j.offset.y, j.offset.z}, rest[] = {j.rest.x, j.rest.y, j.rest.z, j.rest.w},
                 axis[] = {j.axis.x, j.axis.y, j.axis.z};
    append_list(out, offset, 3);
    out += ",\"rest\":";
    append_list(out, rest, 4);
    out += ",\"axis\":";
    append_list(out, axis, 3);
    out += '}';
  }
  out += "]}\n";
  for (int k = 0; k < clip.keys(); ++k) {
    out += "{\"t\":";
    append_number(out, clip.times[k]);
    out += ",\"q\":";
    append_list(out, clip.poses.col(k).data(), clip.poses.rows());
    if (clip.contacts.cols() != 0) {
      out += ",\"c\":";
      append_list(out, clip.contacts.col(k).data(), clip.contacts.rows());
    }
    out += "}\n";
  }
  return out;
}

/// Reads a clip in our own format; see format_clip. `where` names the text in messages. Throws Error that names line
/// and field.
inline LoadedClip parse_clip(std::string_view text, const std::string& where) {
  using namespace detail;
  Lines lines(text);
  std::string_view line;
  if (!lines.next_filled(line)) fail(where, 1, "expected a header line, found an empty file");
  const auto here = [&] { return where + ":" + std::to_string(lines.number()); };
  const Json header = parse_json(line, where, lines.number());
  const std::string top = here() + ": header";
  if (to_text(member(header, "format", top), top + ".format") != clip_format)
    throw Error(top + ".format: expected '" + clip_format + "', found " +
                shown(header["format"].get_ref<const std::string&>()));
  if (to_number(member(header, "version", top), top + ".version") != 1) throw Error(top + ".version: expected 1");

  LoadedClip out;
  motion::Clip& clip = out.clip;
  clip.name = to_text(member(header, "name", top), top + ".name");
  const auto flag = [&](const char* key) {
    const Json& value = member(header, key, top);
    if (!value.is_boolean()) throw Error(top + "." + key + ": expected true or false");
    return value.get<bool>();
  };
  const bool cyclic = flag("cyclic"), contacts = flag("contacts");
  const double keys = to_number(member(header, "keys", top), top + ".keys");
  if (!(keys >= 2 && keys == std::floor(keys))) throw Error(top + ".keys: expected a whole number, two or more");
  const Json::array_t& joints = to_array(member(header, "joints", top), top + ".joints");
  if (joints.empty() || joints.size() > static_cast<std::size_t>(most_joints))
    throw Error(top + ".joints: expected 1 to " + std::to_string(most_joints) + " joints, found " +
                std::to_string(joints.size()));
  for (std::size_t i = 0; i < joints.size(); ++i) {
    const std::string at = top + ".joints[" + std::to_string(i) + "]";
    body::Joint j = parse_joint(joints[i], at);
    try {
      clip.skeleton.add(std::move(j));
    } catch (const Error& e) {
      throw Error(at + ": " + e.what());
    }
  }

  const auto nq = static_cast<std::size_t>(clip.skeleton.nq()), bodies = static_cast<std::size_t>(clip.skeleton.size());
  // Grown line by line, so a wrong count in the header allocates nothing.
  std::vector<double> times, poses, labels;
  while (lines.next_filled(line)) {
    const Json row = parse_json(line, where, lines.number());
    const std::string at = here() + ": frame " + std::to_string(times.size());
    if (static_cast<double>(times.size()) >= keys)
      throw Error(at + ": expected the end of the file after " + std::to_string(times.size()) + " frames");
    times.push_back(to_number(member(row, "t", at), at + ".t"));
    for (const Json& value : to_array(member(row, "q", at), nq, at + ".q"))
      poses.push_back(to_number(value, at + ".q"));
    if (!contacts) continue;
    for (const Json& value : to_array(member(row, "c", at), bodies, at + ".c")) {
      labels.push_back(to_number(value, at + ".c"));
      if (!(labels.back() >= 0 && labels.back() <= 1)) throw Error(at + ".c: expected labels from 0 to 1");
    }
  }
  if (static_cast<double>(times.size()) < keys)
    throw Error(here() + ": expected " + std::to_string(static_cast<long long>(keys)) + " frames, found " +
                std::to_string(times.size()) + "; is the file truncated?");
  const auto count = static_cast<Eigen::Index>(times.size());
  clip.times = Eigen::Map<const Eigen::VectorXd>(times.data(), count);
  clip.poses = Eigen::Map<const Eigen::MatrixXd>(poses.data(), static_cast<Eigen::Index>(nq), count);
  if (contacts)
    clip.contacts = Eigen::Map<const Eigen::MatrixXd>(labels.data(), static_cast<Eigen::Index>(bodies), count);
  try {
    clip.check();
  } catch (const Error& e) {
    throw Error(where + ": " + e.what());
  }

  LoadReport& report = out.report;
  report.source = where;
  report.format = "traceur clip";
  report.unit_reason = report.up_reason = "as the format has it";
  report.up = "z";
  report.rotation_order = "quaternions x y z w; hinge angles in radians";
  report.fps = 1 / (clip.times[1] - clip.times[0]);
  report.fps_reason = "time of the second frame";
  if (cyclic) make_cyclic(out);
  return out;
}

/// Reads a clip file; see parse_clip.
inline LoadedClip read_clip(const std::filesystem::path& path) {
  return parse_clip(detail::read_text(path), path.string());
}

/// Writes a clip file whole or not at all; see format_clip.
inline void write_clip(const std::filesystem::path& path, const motion::Clip& clip) {
  write_atomically(path, format_clip(clip));
}

}  // namespace traceur::io
