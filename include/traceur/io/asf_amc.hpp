// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <numbers>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "traceur/io/detail/raw_motion.hpp"
#include "traceur/io/load_report.hpp"

namespace traceur::io {

struct AsfAmcOptions {
  std::filesystem::path
      skeleton;  ///< the ASF file; empty: the one beside the clip, named as the clip is before its first '_'
  std::optional<double>
      unit;  ///< metres in one unit of the file; without it an inch divided by the skeleton's `length`
  UpAxis up = UpAxis::detect;  ///< detect: y, as the format has it, if the rest pose agrees
  double fps = 120;            ///< AMC files do not say; CMU recorded most takes at 120 Hz
  int skip_frames = 0;         ///< frames to drop at the start
};

/// One bone of an ASF skeleton. Direction, axis and motion are in the root's axes.
struct AsfBone {
  std::string name;
  core::Vector3<double> direction{0, 0, 0};
  double length = 0;
  core::Quaternion<double> axis = core::Quaternion<double>::identity();  ///< axes about which its angles turn
  std::vector<int> dof;                                                  ///< 0..2 for rx ry rz, in the file's order
  int parent = -1;                                                       ///< index of a bone, -1 for the root
};

/// An Acclaim skeleton file.
struct Asf {
  std::string where;
  double length_unit = 1;  ///< `length` of the units section
  bool degrees = true;
  std::array<int, 6> root_order{0, 1, 2, 3, 4, 5};  ///< 0..2 for TX TY TZ, 3..5 for RX RY RZ
  std::vector<AsfBone> bones;                       ///< parents before children
  std::vector<std::string> notes;
};

namespace detail {

/// "XYZ" in any order as axes 0..2.
inline bool to_axes(std::string_view word, std::array<int, 3>& axes) {
  if (word.size() != 3) return false;
  bool seen[3] = {};
  for (std::size_t k = 0; k < 3; ++k) {
    const int axis = lower(word[k]) - 'x';
    if (axis < 0 || axis > 2 || std::exchange(seen[axis], true)) return false;
    axes[k] = axis;
  }
  return true;
}

/// Rotation by angles about fixed axes, the first in the list applied first.
inline core::Quaternion<double> fixed_axes(const int* axes, const double* angles, std::size_t count) {
  core::Quaternion<double> q = core::Quaternion<double>::identity();
  for (std::size_t k = 0; k < count; ++k) q = rotation_about(axes[k], angles[k]) * q;
  return q;
}

}  // namespace detail

/// Reads an Acclaim skeleton from text. `where` names it in messages. Throws Error that names line and field.
inline Asf parse_asf(std::string_view text, const std::string& where) {
  using namespace detail;
  Asf asf;
  asf.where = where;
  std::vector<AsfBone> bones;
  std::unordered_map<std::string, int> index;
  std::vector<int> parent;  // -2: not in the hierarchy
  struct Axis {
    double angles[3];
    std::array<int, 3> order;
  };
  std::vector<Axis> axes;
  enum class Section { none, units, root, bone_data, hierarchy, ignored } section = Section::none;
  bool in_block = false, has_bones = false, has_hierarchy = false;
  bool has_name = false, has_direction = false, has_length = false;

  Lines lines(text);
  std::string_view line;
  while (lines.next_filled(line)) {
    const int number = lines.number();
    if (line.front() == '#') continue;
    if (line.front() == ':') {
      if (in_block) fail(where, number, "expected 'end' before " + shown(line));
      line.remove_prefix(1);
      const std::string key = lowered(next_word(line));
      section = key == "units"       ? Section::units
                : key == "root"      ? Section::root
                : key == "bonedata"  ? Section::bone_data
                : key == "hierarchy" ? Section::hierarchy
                                     : Section::ignored;
      continue;
    }
    std::string_view rest = line;
    const std::string_view word = next_word(rest);
    const std::string key = lowered(word);
    switch (section) {
      case Section::none:
        fail(where, number, "expected a section such as ':units', found " + shown(word));
      case Section::ignored:
        break;
      case Section::units:
        if (key == "length") {
          asf.length_unit = next_number(rest, where, number, "length");
          if (!(asf.length_unit > 1e-6)) fail(where, number, "length: expected more than 0");
        } else if (key == "angle") {
          const std::string angle = lowered(next_word(rest));
          if (angle != "deg" && angle != "rad")
            fail(where, number, "angle: expected deg or rad, found " + shown(angle));
          asf.degrees = angle == "deg";
        }
        break;
      case Section::root:
        if (key == "order") {
          bool seen[6] = {};
          for (int& entry : asf.root_order) {
            const std::string_view token = next_word(rest);
            const std::string name = lowered(token);
            const bool known =
                name.size() == 2 && (name[0] == 't' || name[0] == 'r') && name[1] >= 'x' && name[1] <= 'z';
            entry = known ? (name[0] == 'r' ? 3 : 0) + name[1] - 'x' : 0;
            if (!known || std::exchange(seen[entry], true))
              fail(where, number, "root order: expected TX TY TZ RX RY RZ in some order, found " + shown(token));
          }
          expect_end(rest, where, number, "root order");
        } else if (key == "axis") {
          std::array<int, 3> order{};
          const std::string_view token = next_word(rest);
          if (!to_axes(token, order))
            fail(where, number, "root axis: expected XYZ in some order, found " + shown(token));
        } else if (key == "position" || key == "orientation") {
          double largest = 0;
          for (int k = 0; k < 3; ++k)
            largest = std::max(largest, std::abs(next_number(rest, where, number, "root " + key)));
          expect_end(rest, where, number, "root " + key);
          if (key == "orientation" && largest > 0)
            fail(where, number, "root orientation: expected 0 0 0; others are not supported");
          if (largest > 0)
            asf.notes.push_back("dropped the skeleton's root position; the clip's own is its place in the world");
        } else {
          fail(where, number, "root: expected order, axis, position or orientation, found " + shown(word));
        }
        break;
      case Section::bone_data:
        if (key == "begin") {
          if (in_block) fail(where, number, "expected 'end' before the next 'begin'");
          if (bones.size() >= static_cast<std::size_t>(most_joints))
            fail(where, number, "expected at most " + std::to_string(most_joints) + " bones");
          in_block = has_bones = true;
          has_name = has_direction = has_length = false;
          bones.emplace_back();
          axes.push_back({{0, 0, 0}, {0, 1, 2}});
          break;
        }
        if (!in_block) fail(where, number, "bonedata: expected 'begin', found " + shown(word));
        if (key == "end") {
          if (!has_name || !has_direction || !has_length)
            fail(where, number,
                 "bone " + shown(bones.back().name) + ": expected name, direction and length before 'end'");
          in_block = false;
        } else if (key == "name") {
          const std::string_view name = next_word(rest);
          if (name.empty() || name == "root") fail(where, number, "name: expected a bone name other than 'root'");
          if (has_name) fail(where, number, "a second name of bone " + shown(bones.back().name));
          if (!index.emplace(std::string(name), static_cast<int>(bones.size()) - 1).second)
            fail(where, number, "a second bone named " + shown(name));
          bones.back().name = std::string(name);
          has_name = true;
        } else if (key == "direction") {
          auto& d = bones.back().direction;
          for (double* e : {&d.x, &d.y, &d.z}) *e = next_number(rest, where, number, "direction");
          expect_end(rest, where, number, "direction");
          if (std::abs(norm(d) - 1) > 0.01) fail(where, number, "direction: expected a unit vector");
          has_direction = true;
        } else if (key == "length") {
          bones.back().length = next_number(rest, where, number, "length");
          expect_end(rest, where, number, "length");
          if (bones.back().length < 0) fail(where, number, "length: expected zero or more");
          has_length = true;
        } else if (key == "axis") {
          for (double& angle : axes.back().angles) angle = next_number(rest, where, number, "axis");
          const std::string_view order = next_word(rest);
          if (!to_axes(order, axes.back().order))
            fail(where, number, "axis: expected XYZ in some order, found " + shown(order));
        } else if (key == "dof") {
          bool seen[3] = {};
          bones.back().dof.clear();
          for (std::string_view token = next_word(rest); !token.empty(); token = next_word(rest)) {
            const std::string name = lowered(token);
            if (name.size() != 2 || name[0] != 'r' || name[1] < 'x' || name[1] > 'z' ||
                std::exchange(seen[name[1] - 'x'], true))
              fail(where, number, "dof: expected rx ry rz at most once each, found " + shown(token));
            bones.back().dof.push_back(name[1] - 'x');
          }
        } else if (key != "id" && key != "limits" && key != "bodymass" && key != "cofmass" && key.front() != '(') {
          fail(where, number,
               "bone " + shown(bones.back().name) +
                   ": expected name, direction, length, axis, dof, limits or end, found " + shown(word));
        }
        break;
      case Section::hierarchy:
        if (key == "begin") {
          in_block = has_hierarchy = true;
          parent.assign(bones.size(), -2);
          break;
        }
        if (!in_block) fail(where, number, "hierarchy: expected 'begin', found " + shown(word));
        if (key == "end") {
          in_block = false;
          break;
        }
        {
          int from = -1;
          if (word != "root") {
            const auto found = index.find(std::string(word));
            if (found == index.end()) fail(where, number, "hierarchy: no bone named " + shown(word));
            from = found->second;
          }
          for (std::string_view token = next_word(rest); !token.empty(); token = next_word(rest)) {
            const auto found = index.find(std::string(token));
            if (found == index.end()) fail(where, number, "hierarchy: no bone named " + shown(token));
            int& p = parent[static_cast<std::size_t>(found->second)];
            if (p != -2) fail(where, number, "hierarchy: bone " + shown(token) + " has two parents");
            p = from;
          }
        }
        break;
    }
  }
  if (in_block) fail(where, lines.number(), "expected 'end', found the end of the file");
  if (!has_bones) fail(where, lines.number(), "expected a ':bonedata' section with bones, found none");
  if (!has_hierarchy) fail(where, lines.number(), "expected a ':hierarchy' section, found none");
  if (parent.size() != bones.size()) fail(where, lines.number(), "expected ':hierarchy' after ':bonedata'");

  // Depth first from the root: bones in a loop are never reached.
  std::vector<std::vector<int>> children(bones.size() + 1);
  for (std::size_t i = 0; i < bones.size(); ++i) {
    if (parent[i] == -2) throw Error(where + ": bone " + shown(bones[i].name) + " is not in the hierarchy");
    children[static_cast<std::size_t>(parent[i] + 1)].push_back(static_cast<int>(i));
  }
  const double radian = asf.degrees ? std::numbers::pi / 180 : 1.0;
  std::vector<std::pair<int, int>> stack;  // bone, new index of its parent
  const auto push = [&](int old_index, int new_index) {
    const auto& list = children[static_cast<std::size_t>(old_index + 1)];
    for (std::size_t k = list.size(); k-- > 0;) stack.push_back({list[k], new_index});
  };
  push(-1, -1);
  while (!stack.empty()) {
    const auto [i, up] = stack.back();
    stack.pop_back();
    const auto k = static_cast<std::size_t>(i);
    AsfBone bone = std::move(bones[k]);
    bone.parent = up;
    for (double& angle : axes[k].angles) angle *= radian;
    bone.axis = fixed_axes(axes[k].order.data(), axes[k].angles, 3).normalized();
    asf.bones.push_back(std::move(bone));
    push(i, static_cast<int>(asf.bones.size()) - 1);
  }
  if (asf.bones.size() != bones.size())
    throw Error(where + ": hierarchy: some bones hang in a loop, not from the root");
  return asf;
}

/// Reads an AMC clip from text, for the given skeleton. `where` names it in messages.
///
/// A bone with angles becomes a ball joint at its start, one without a fixed joint; the end of a leaf bone is a fixed
/// joint named "<bone>_end". Every frame must hold the root and every bone that has angles. Throws Error that names
/// line and field.
inline LoadedClip parse_amc(std::string_view text, const Asf& asf, const std::string& where,
                            const AsfAmcOptions& options = {}) {
  using namespace detail;
  if (options.unit && !(*options.unit > 0 && *options.unit < 1e6))
    throw Error(where + ": option unit: expected metres, more than 0");
  if (!(options.fps > 0 && options.fps < 1e6))
    throw Error(where + ": option fps: expected frames a second, more than 0");
  if (options.skip_frames < 0) throw Error(where + ": option skip_frames: expected zero or more");

  const std::size_t bones = asf.bones.size();
  std::unordered_map<std::string_view, std::size_t> index;
  std::size_t moving = 1;
  for (std::size_t i = 0; i < bones; ++i) {
    index.emplace(asf.bones[i].name, i);
    if (!asf.bones[i].dof.empty()) ++moving;
  }

  RawMotion m;
  m.where = where;
  m.name = std::filesystem::path(where).stem().string();
  m.dt = 1 / options.fps;
  m.joints.push_back({"root", -1, {0, 0, 0}, false});
  std::vector<bool> leaf(bones, true);
  for (const AsfBone& b : asf.bones)
    if (b.parent >= 0) leaf[static_cast<std::size_t>(b.parent)] = false;
  const auto end_of = [&](int i) {
    const AsfBone& b = asf.bones[static_cast<std::size_t>(i)];
    return b.length * b.direction;
  };
  for (const AsfBone& b : asf.bones)
    m.joints.push_back(
        {b.name, b.parent + 1, b.parent < 0 ? Vector3<double>{0, 0, 0} : end_of(b.parent), b.dof.empty()});
  for (std::size_t i = 0; i < bones; ++i) {
    if (!leaf[i]) continue;
    const std::string name = asf.bones[i].name + "_end";
    if (index.contains(name))
      throw Error(asf.where + ": bone name " + shown(name) + " is kept for the end of another bone");
    m.joints.push_back({name, static_cast<int>(i) + 1, end_of(static_cast<int>(i)), true});
  }
  const std::size_t width = m.joints.size();

  Lines lines(text);
  std::string_view line;
  double radian = asf.degrees ? std::numbers::pi / 180 : 1.0;
  bool in_frame = false;
  long long frame = 0, first_frame = 0;
  std::vector<long long> seen(bones + 1, 0);  // number of the last frame that held the bone, counted from one
  std::size_t held = 0;
  const auto close_frame = [&] {
    if (!in_frame || held == moving) return;
    std::string missing = seen[0] == static_cast<long long>(m.frames) ? "" : "root";
    for (std::size_t i = 0; i < bones && missing.empty(); ++i)
      if (!asf.bones[i].dof.empty() && seen[i + 1] != static_cast<long long>(m.frames)) missing = asf.bones[i].name;
    fail(where, lines.number(),
         "frame " + std::to_string(frame) + ": expected bone " + shown(missing) +
             " before its end; is the file truncated?");
  };
  while (lines.next_filled(line)) {
    const int number = lines.number();
    if (line.front() == '#') continue;
    if (line.front() == ':') {
      const std::string key = lowered(line);
      if (in_frame) fail(where, number, "expected " + shown(line) + " before the first frame");
      if (key == ":degrees") radian = std::numbers::pi / 180;
      if (key == ":radians") radian = 1;
      continue;
    }
    std::string_view rest = line;
    const std::string_view word = next_word(rest);
    if (word.front() >= '0' && word.front() <= '9') {
      close_frame();
      long long next = 0;
      if (!to_integer(word, next) || !trimmed(rest).empty())
        fail(where, number, "expected a frame number alone, found " + shown(line));
      if (in_frame && next != frame + 1)
        fail(where, number, "expected frame " + std::to_string(frame + 1) + ", found " + std::to_string(next));
      if (!in_frame) first_frame = next;
      in_frame = true;
      frame = next;
      held = 0;
      ++m.frames;
      m.root.push_back({0, 0, 0});
      m.rotations.resize(m.frames * width, Quaternion<double>::identity());
      continue;
    }
    if (!in_frame) fail(where, number, "expected a frame number, found " + shown(word));
    const std::string field = "frame " + std::to_string(frame) + ", " + std::string(word.substr(0, 40));
    const bool is_root = word == "root";
    std::size_t slot = 0;
    if (!is_root) {
      const auto found = index.find(word);
      if (found == index.end())
        fail(where, number,
             "frame " + std::to_string(frame) + ": bone " + shown(word) + " is not in the skeleton " + asf.where);
      slot = found->second + 1;
    }
    if (std::exchange(seen[slot], static_cast<long long>(m.frames)) == static_cast<long long>(m.frames))
      fail(where, number, "frame " + std::to_string(frame) + ": bone " + shown(word) + " twice");
    Quaternion<double>& q = m.rotations[(m.frames - 1) * width + slot];
    if (is_root) {
      ++held;
      for (const int entry : asf.root_order) {
        const double value = next_number(rest, where, number, field);
        Vector3<double>& p = m.root.back();
        if (entry >= 3)
          q = rotation_about(entry - 3, value * radian) * q;
        else
          (entry == 0 ? p.x : entry == 1 ? p.y : p.z) = value;
      }
    } else {
      const AsfBone& bone = asf.bones[slot - 1];
      if (!bone.dof.empty()) ++held;
      double angles[3] = {};
      for (std::size_t k = 0; k < bone.dof.size(); ++k) angles[k] = next_number(rest, where, number, field) * radian;
      q = bone.axis * fixed_axes(bone.dof.data(), angles, bone.dof.size()) * bone.axis.conjugate();
    }
    expect_end(rest, where, number, field);
  }
  close_frame();
  if (m.frames < 2) fail(where, lines.number(), "expected at least two frames, found " + std::to_string(m.frames));

  LoadedClip out;
  LoadReport& report = out.report;
  report.source = where;
  report.format = "ASF/AMC";
  report.notes = asf.notes;
  report.rotation_order =
      std::string("about fixed bone axes in the order of dof, ") + (radian == 1 ? "radians" : "degrees");
  report.fps = options.fps;
  report.fps_reason = "option fps, 120 unless set: AMC files do not say";
  if (first_frame != 1) report.notes.push_back("the first frame is number " + std::to_string(first_frame));
  if (static_cast<long long>(m.frames) - options.skip_frames < 2)
    throw Error(where + ": option skip_frames leaves fewer than two of " + std::to_string(m.frames) + " frames");
  if (const auto skip = static_cast<std::size_t>(options.skip_frames); skip > 0) {
    m.frames -= skip;
    m.root.erase(m.root.begin(), m.root.begin() + options.skip_frames);
    m.rotations.erase(m.rotations.begin(), m.rotations.begin() + static_cast<std::ptrdiff_t>(skip * width));
    report.notes.push_back("dropped the first " + std::to_string(skip) + " frames, as asked");
  }

  Conversion c{0.0254 / asf.length_unit, 1, find_anatomy(m.joints)};
  report.unit_reason = "an inch divided by the skeleton's length " + short_number(asf.length_unit);
  if (options.unit) {
    c.unit = *options.unit;
    report.unit_reason = "option unit";
  } else if (!c.anatomy.complete()) {
    report.notes.push_back("the skeleton has no head and feet by name, so its unit could not be checked");
  } else if (!plausible_unit(c.anatomy, c.unit)) {
    throw Error(asf.where + ": with length " + short_number(asf.length_unit) + " the body is about " +
                short_number(c.unit * c.anatomy.leg / leg_share) + " m tall, expected 1.2-2.2 m; set the option unit");
  }
  report.up_reason = "as the format has it";
  if (options.up != UpAxis::detect) {
    c.up = static_cast<int>(options.up) - 1;
    report.up_reason = "option up";
  } else if (c.anatomy.complete()) {
    if (along_axis(pelvis_up(m, c.anatomy), 0.8) != 1)
      throw Error(asf.where + ": the rest pose does not stand along y, as the format has it; set the option up");
    report.up_reason += ", and the rest pose agrees";
  }
  report.unit = c.unit;
  report.up = axis_names[c.up];
  out.clip = convert(m, c, report);
  return out;
}

inline Asf read_asf(const std::filesystem::path& path) { return parse_asf(detail::read_text(path), path.string()); }

/// The skeleton that belongs to a clip by its name: "01.asf" beside "01_14.amc".
inline std::filesystem::path asf_beside(const std::filesystem::path& amc) {
  const std::string stem = amc.stem().string();
  return amc.parent_path() / (stem.substr(0, stem.find('_')) + ".asf");
}

/// Reads an AMC file and its skeleton; see parse_amc.
inline LoadedClip read_asf_amc(const std::filesystem::path& path, const AsfAmcOptions& options = {}) {
  const std::string text = detail::read_text(path);
  const std::filesystem::path skeleton = options.skeleton.empty() ? asf_beside(path) : options.skeleton;
  if (options.skeleton.empty() && !std::filesystem::exists(skeleton))
    throw Error(path.string() + ": expected its skeleton at " + skeleton.string() + "; set the option skeleton");
  return parse_amc(text, read_asf(skeleton), path.string(), options);
}

}  // namespace traceur::io
