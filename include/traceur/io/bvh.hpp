// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cmath>
#include <filesystem>
#include <map>
#include <numbers>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_set>
#include <utility>
#include <vector>

#include "traceur/io/atomic_file.hpp"
#include "traceur/io/detail/raw_motion.hpp"
#include "traceur/io/load_report.hpp"

namespace traceur::io {

struct BvhOptions {
  std::optional<double> unit;  ///< metres in one unit of the file; without it the one in which the skeleton is a person
  UpAxis up = UpAxis::detect;  ///< the file's axis away from the ground
  int skip_frames = 0;         ///< frames to drop at the start, such as a rest pose
};

namespace detail {

/// One column of a BVH motion line: which joint, position or rotation, about or along which axis.
struct BvhChannel {
  int joint;
  bool rotation;
  int axis;
};

struct BvhHierarchy {
  std::vector<RawJoint> joints;
  std::vector<BvhChannel> channels;
};

/// Words and names of the hierarchy block, with braces as words of their own.
class BvhWords {
public:
  BvhWords(std::string_view text, std::string_view where) : text_(text), where_(where) {}

  std::string_view next() {
    while (at_ < text_.size() && is_space(text_[at_])) step();
    const std::size_t begin = at_;
    if (at_ < text_.size() && is_brace(text_[at_])) {
      step();
    } else {
      while (at_ < text_.size() && !is_space(text_[at_]) && !is_brace(text_[at_])) step();
    }
    return text_.substr(begin, at_ - begin);
  }
  /// The rest of the line up to a brace: names may hold blanks.
  std::string_view rest_of_line() {
    const std::size_t begin = at_;
    while (at_ < text_.size() && text_[at_] != '\n' && !is_brace(text_[at_])) ++at_;
    return trimmed(text_.substr(begin, at_ - begin));
  }
  double number(const std::string& field) {
    std::string_view word = next();
    return next_number(word, where_, line_, field);
  }
  [[noreturn]] void fail(const std::string& message) const { detail::fail(where_, line_, message); }
  int line() const { return line_; }
  std::string_view rest() const { return text_.substr(at_); }

private:
  static bool is_brace(char c) { return c == '{' || c == '}'; }
  void step() {
    if (text_[at_] == '\n') ++line_;
    ++at_;
  }

  std::string_view text_, where_;
  std::size_t at_ = 0;
  int line_ = 1;
};

inline BvhHierarchy parse_bvh_hierarchy(BvhWords& words) {
  BvhHierarchy h;
  std::unordered_set<std::string> names;
  struct Open {
    int joint;
    bool has_offset = false, has_channels = false, has_end = false;
  };
  std::vector<Open> open;

  const auto expect = [&](std::string_view word, std::string_view expected) {
    if (lowered(word) != lowered(expected))
      words.fail("expected " + shown(expected) + ", found " + (word.empty() ? "the end of the file" : shown(word)));
  };
  const auto begin = [&](std::string name, bool fixed) {
    if (name.empty()) words.fail("expected a joint name");
    if (!names.insert(name).second) words.fail("a second joint named " + shown(name));
    if (h.joints.size() >= static_cast<std::size_t>(most_joints))
      words.fail("expected at most " + std::to_string(most_joints) + " joints");
    if (open.size() >= static_cast<std::size_t>(deepest_joint))
      words.fail("joints nest deeper than " + std::to_string(deepest_joint) + " levels");
    h.joints.push_back({std::move(name), open.empty() ? -1 : open.back().joint, {0, 0, 0}, fixed});
    expect(words.next(), "{");
    open.push_back({static_cast<int>(h.joints.size()) - 1});
  };

  expect(words.next(), "HIERARCHY");
  expect(words.next(), "ROOT");
  begin(std::string(words.rest_of_line()), false);
  while (!open.empty()) {
    const std::string word = lowered(words.next());
    Open& top = open.back();
    RawJoint& joint = h.joints[static_cast<std::size_t>(top.joint)];
    const bool end_site = joint.fixed;
    if (word == "offset") {
      if (std::exchange(top.has_offset, true)) words.fail("joint " + shown(joint.name) + ": a second OFFSET");
      const std::string field = "OFFSET of " + shown(joint.name);
      joint.offset.x = words.number(field);
      joint.offset.y = words.number(field);
      joint.offset.z = words.number(field);
    } else if (word == "channels" && !end_site) {
      if (std::exchange(top.has_channels, true)) words.fail("joint " + shown(joint.name) + ": a second CHANNELS");
      const std::string field = "CHANNELS of " + shown(joint.name);
      const std::string_view count_word = words.next();
      long long count = 0;
      if (!to_integer(count_word, count) || count < 0 || count > 6)
        words.fail(field + ": expected a count from 0 to 6, found " + shown(count_word));
      bool seen[2][3] = {};
      for (long long k = 0; k < count; ++k) {
        const std::string_view name_word = words.next();
        const std::string name = lowered(name_word);
        const bool position = name.size() == 9 && name.ends_with("position"),
                   rotation = name.size() == 9 && name.ends_with("rotation");
        if ((!position && !rotation) || name[0] < 'x' || name[0] > 'z')
          words.fail(field + ": expected Xposition ... Zrotation, found " + shown(name_word));
        const int axis = name[0] - 'x';
        if (std::exchange(seen[rotation][axis], true)) words.fail(field + ": " + shown(name_word) + " twice");
        h.channels.push_back({top.joint, rotation, axis});
      }
    } else if (word == "joint" && !end_site) {
      begin(std::string(words.rest_of_line()), false);
    } else if (word == "end" && !end_site) {
      if (std::exchange(top.has_end, true)) words.fail("joint " + shown(joint.name) + ": a second End Site");
      expect(words.next(), "Site");
      begin(joint.name + "_end", true);
    } else if (word == "}") {
      if (!top.has_offset) words.fail("joint " + shown(joint.name) + ": expected an OFFSET before '}'");
      open.pop_back();
    } else {
      words.fail("joint " + shown(joint.name) + ": expected OFFSET, CHANNELS, JOINT, End Site or '}', found " +
                 (word.empty() ? "the end of the file (unbalanced braces)" : shown(word)));
    }
  }
  return h;
}

/// Places a joint's angles about the axes it lists, "ZXY" say, in the order they multiply.
inline std::string rotation_orders(const BvhHierarchy& h) {
  std::vector<std::string> order(h.joints.size());
  for (const BvhChannel& c : h.channels)
    if (c.rotation) order[static_cast<std::size_t>(c.joint)] += "XYZ"[c.axis];
  std::map<std::string, int> count;
  for (const std::string& o : order)
    if (!o.empty()) ++count[o];
  std::string out;
  for (const auto& [o, n] : count) {
    if (!out.empty()) out += ", ";
    out += o;
    if (count.size() > 1) out += " (" + std::to_string(n) + " joints)";
  }
  return (out.empty() ? "none" : out) + ", degrees";
}

}  // namespace detail

/// Reads a motion from BVH text. `where` names it in messages.
///
/// Joints are balls, the root is free, an End Site becomes a fixed joint named "<parent>_end". Angles multiply in the
/// order the file lists them. The root's position channels are its place in the world, its OFFSET is not added;
/// position channels of other joints stand for their OFFSET by their mean over the clip. Throws Error that names line
/// and field; the option `unit` or `up` where the file leaves that open.
inline LoadedClip parse_bvh(std::string_view text, const std::string& where, const BvhOptions& options = {}) {
  using namespace detail;
  if (options.unit && !(*options.unit > 0 && *options.unit < 1e6))
    throw Error(where + ": option unit: expected metres, more than 0");
  if (options.skip_frames < 0) throw Error(where + ": option skip_frames: expected zero or more");
  BvhWords words(text, where);
  BvhHierarchy h = parse_bvh_hierarchy(words);

  const std::string_view motion_word = words.next();
  if (lowered(motion_word) == "root") words.fail("a second ROOT: expected one character in a file");
  if (lowered(motion_word) != "motion")
    words.fail("expected 'MOTION', found " +
               (motion_word.empty() ? std::string("the end of the file") : shown(motion_word)));
  Lines lines(words.rest());
  const int first_line = words.line() - 1;
  const auto line_number = [&] { return first_line + lines.number(); };
  const auto header = [&](const char* key) {
    std::string_view line;
    if (!lines.next_filled(line))
      fail(where, line_number(), std::string("expected '") + key + "', found the end of the file");
    const std::size_t colon = line.find(':');
    if (colon == std::string_view::npos || lowered(trimmed(line.substr(0, colon))) + ":" != lowered(key))
      fail(where, line_number(), std::string("expected '") + key + "', found " + shown(line));
    return trimmed(line.substr(colon + 1));
  };
  const std::string_view count_word = header("Frames:");
  long long frames = 0;
  if (!to_integer(count_word, frames) || frames < 0)
    fail(where, line_number(), "Frames: expected a whole number, found " + shown(count_word));
  const int count_line = line_number();
  std::string_view step_word = header("Frame Time:");
  const double dt = next_number(step_word, where, line_number(), "Frame Time");
  expect_end(step_word, where, line_number(), "Frame Time");
  if (!(dt > 1e-6 && dt < 1e3))
    fail(where, line_number(), "Frame Time: expected seconds between 1e-6 and 1e3, found " + short_number(dt));
  if (frames < 2) fail(where, count_line, "expected at least two frames, found " + std::to_string(frames));
  if (h.channels.empty()) fail(where, count_line, "expected at least one channel in the hierarchy");
  const std::size_t width = h.channels.size();
  // Each number takes at least two bytes, so an absurd count shows before anything is allocated for it.
  const std::size_t most = (lines.rest().size() + 1) / 2;
  if (static_cast<unsigned long long>(frames) > most / width)
    fail(where, count_line,
         "Frames: " + std::to_string(frames) + " frames of " + std::to_string(width) +
             " numbers do not fit in the rest of the file; is it truncated?");

  std::vector<double> values;
  values.reserve(static_cast<std::size_t>(frames) * width);
  std::string_view line;
  for (long long f = 0; f < frames; ++f) {
    if (!lines.next_filled(line))
      fail(where, line_number(),
           "expected " + std::to_string(frames) + " frames, found " + std::to_string(f) + "; is the file truncated?");
    for (std::size_t c = 0; c < width; ++c) {
      const std::string_view word = next_word(line);
      double value = 0;
      if (!word.empty() && to_double(word, value) && std::abs(value) <= largest_number) {
        values.push_back(value);
        continue;
      }
      const BvhChannel& channel = h.channels[c];
      const std::string field = "frame " + std::to_string(f) + ", " +
                                h.joints[static_cast<std::size_t>(channel.joint)].name + " " + "XYZ"[channel.axis] +
                                (channel.rotation ? "rotation" : "position");
      if (word.empty())
        fail(where, line_number(),
             field + ": expected " + std::to_string(width) + " numbers, found " + std::to_string(c));
      fail(where, line_number(), field + ": expected a finite number, found " + shown(word));
    }
    expect_end(line, where, line_number(), "frame " + std::to_string(f) + " of " + std::to_string(width) + " numbers");
  }
  if (lines.next_filled(line))
    fail(where, line_number(),
         "expected the end of the file after " + std::to_string(frames) + " frames, found " + shown(line));

  LoadedClip out;
  LoadReport& report = out.report;
  report.source = where;
  report.format = "BVH";
  report.rotation_order = rotation_orders(h);
  if (frames - options.skip_frames < 2)
    throw Error(where + ": option skip_frames leaves fewer than two of " + std::to_string(frames) + " frames");
  const auto skip = static_cast<std::size_t>(options.skip_frames);
  if (skip > 0) report.notes.push_back("dropped the first " + std::to_string(skip) + " frames, as asked");

  RawMotion m;
  m.where = where;
  m.name = std::filesystem::path(where).stem().string();
  m.frames = static_cast<std::size_t>(frames) - skip;
  m.dt = tidy_step(dt);
  report.fps = 1 / m.dt;
  report.fps_reason = "Frame Time";

  std::vector<bool> moves(h.joints.size(), false), turns(h.joints.size(), false);
  for (const BvhChannel& c : h.channels) (c.rotation ? turns : moves)[static_cast<std::size_t>(c.joint)] = true;
  for (std::size_t i = 1; i < h.joints.size(); ++i)
    if (!turns[i]) h.joints[i].fixed = true;
  if (norm(h.joints[0].offset) > 0 && moves[0])
    report.notes.push_back("the root's OFFSET is not added: its position channels are its place in the world");

  m.root.assign(m.frames, h.joints[0].offset);
  m.rotations.assign(m.frames * h.joints.size(), Quaternion<double>::identity());
  constexpr double degree = std::numbers::pi / 180;
  for (std::size_t f = 0; f < m.frames; ++f) {
    const double* row = values.data() + (f + skip) * width;
    for (std::size_t c = 0; c < width; ++c) {
      const BvhChannel& channel = h.channels[c];
      const auto joint = static_cast<std::size_t>(channel.joint);
      if (channel.rotation) {
        Quaternion<double>& q = m.rotations[f * h.joints.size() + joint];
        q = q * rotation_about(channel.axis, row[c] * degree);
      } else if (joint == 0) {
        (channel.axis == 0 ? m.root[f].x : channel.axis == 1 ? m.root[f].y : m.root[f].z) = row[c];
      }
    }
  }
  std::vector<double> moved(h.joints.size(), 0.0);
  for (std::size_t c = 0; c < width; ++c) {
    const BvhChannel& channel = h.channels[c];
    const auto joint = static_cast<std::size_t>(channel.joint);
    if (channel.rotation || joint == 0) continue;
    double mean = 0, most_off = 0;
    for (std::size_t f = 0; f < m.frames; ++f) mean += values[(f + skip) * width + c] / static_cast<double>(m.frames);
    for (std::size_t f = 0; f < m.frames; ++f)
      most_off = std::max(most_off, std::abs(values[(f + skip) * width + c] - mean));
    Vector3<double>& offset = h.joints[joint].offset;
    (channel.axis == 0 ? offset.x : channel.axis == 1 ? offset.y : offset.z) = mean;
    moved[joint] = std::max(moved[joint], most_off);
  }
  m.joints = std::move(h.joints);

  Conversion conversion{1, 1, find_anatomy(m.joints)};
  if (options.unit) {
    conversion.unit = *options.unit;
    report.unit_reason = "option unit";
    if (conversion.anatomy.complete() && !plausible_unit(conversion.anatomy, conversion.unit))
      report.notes.push_back("in the given unit the skeleton is not 1.2-2.2 m tall");
  } else {
    const Unit unit = guess_unit(conversion.anatomy, where);
    conversion.unit = unit.metres;
    report.unit_reason = std::string(unit.name) + ": the only known unit in which the skeleton is 1.2-2.2 m tall";
  }
  if (options.up != UpAxis::detect) {
    conversion.up = static_cast<int>(options.up) - 1;
    report.up_reason = "option up";
  } else {
    conversion.up = guess_up(m, conversion.anatomy, report.up_reason);
  }
  report.unit = conversion.unit;
  report.up = axis_names[conversion.up];
  for (std::size_t i = 1; i < moved.size(); ++i)
    if (moves[i])
      report.notes.push_back("dropped the position channels of " + shown(m.joints[i].name) + ", which vary by " +
                             short_number(moved[i] * conversion.unit) + " m; their mean stands for its OFFSET");
  out.clip = convert(m, conversion, report);
  return out;
}

/// Reads a BVH file; see parse_bvh.
inline LoadedClip read_bvh(const std::filesystem::path& path, const BvhOptions& options = {}) {
  return parse_bvh(detail::read_text(path), path.string(), options);
}

/// The clip as BVH text: y up, z forward, angles in the order Z X Y, lengths in `unit` metres (centimetres unless
/// told). Fixed leaves named "<parent>_end" become End Sites. What BVH cannot hold throws Error: keys that are not
/// evenly spaced, a root that is not free, joints of one name. Contact labels and `cyclic` are lost.
inline std::string format_bvh(const motion::Clip& clip, double unit = 0.01) {
  using namespace detail;
  clip.check();
  const std::string where = "clip '" + clip.name + "'";
  const body::Skeleton& s = clip.skeleton;
  if (!(unit > 0)) throw Error(where + ": expected a unit of more than 0 m");
  if (!s.free_root()) throw Error(where + ": BVH needs a free root");
  const double dt = clip.times[1];
  for (int k = 1; k < clip.keys(); ++k)
    if (std::abs(clip.times[k] - clip.times[k - 1] - dt) > 1e-3 * dt)
      throw Error(where + ", frame " + std::to_string(k) + ": BVH needs evenly spaced frames; resample the clip first");

  const auto n = static_cast<std::size_t>(s.size());
  std::vector<std::vector<int>> children(n);
  std::unordered_set<std::string> names;
  for (int i = 0; i < s.size(); ++i) {
    if (s[i].parent >= 0) children[static_cast<std::size_t>(s[i].parent)].push_back(i);
    const std::string& name = s[i].name;
    if (name.empty() || name.find_first_of("{}\r\n") != std::string::npos || trimmed(name) != name)
      throw Error(where + ": " + shown(name) + " cannot be a BVH joint name");
    if (!names.insert(name).second) throw Error(where + ": two joints named " + shown(name));
  }
  const auto end_site = [&](int i) {
    return s[i].type == body::JointType::fixed && s[i].parent >= 0 && children[static_cast<std::size_t>(i)].empty() &&
           s[i].name == s[s[i].parent].name + "_end";
  };

  // House to file axes: x = left = house y, y = up = house z, z = forward = house x.
  const Quaternion<double> turn = world_turn(1).conjugate();
  std::string out = "HIERARCHY\n";
  std::vector<int> order;
  const auto offset = [&](const std::string& indent, const Vector3<double>& v) {
    const Vector3<double> file = (1 / unit) * turned(turn, v);
    out += indent + "OFFSET";
    for (const double e : {file.x, file.y, file.z}) append_number(out += ' ', e + 0.0, 12);
    out += '\n';
  };
  struct Visit {
    int joint;
    bool leave;
  };
  std::vector<Visit> stack{{0, false}};
  std::vector<std::size_t> depth(n, 0);
  while (!stack.empty()) {
    const auto [i, leave] = stack.back();
    stack.pop_back();
    const auto k = static_cast<std::size_t>(i);
    if (s[i].parent >= 0) depth[k] = depth[static_cast<std::size_t>(s[i].parent)] + 1;
    const std::string indent(2 * depth[k], ' ');
    if (leave) {
      out += indent + "}\n";
      continue;
    }
    const bool is_end = end_site(i);
    out += indent + (is_end ? "End Site" : (i == 0 ? "ROOT " : "JOINT ") + s[i].name) + "\n" + indent + "{\n";
    offset(indent + "  ", i == 0 ? Vector3<double>::zero() : s[i].offset);
    if (!is_end) {
      out += indent + (i == 0 ? "  CHANNELS 6 Xposition Yposition Zposition" : "  CHANNELS 3") +
             " Zrotation Xrotation Yrotation\n";
      order.push_back(i);
      if (children[k].empty())
        out += indent + "  End Site\n" + indent + "  {\n" + indent + "    OFFSET 0 0 0\n" + indent + "  }\n";
    }
    stack.push_back({i, true});
    for (std::size_t c = children[k].size(); c-- > 0;) stack.push_back({children[k][c], false});
  }

  out += "MOTION\nFrames: " + std::to_string(clip.keys()) + "\nFrame Time: ";
  append_number(out, dt, 12);
  out += '\n';
  constexpr double degrees = 180 / std::numbers::pi;
  for (int k = 0; k < clip.keys(); ++k) {
    const double* q = clip.poses.col(k).data();
    for (const int i : order) {
      if (i == 0) {
        const Vector3<double> p = (1 / unit) * turned(turn, Vector3<double>::from(q));
        for (const double e : {p.x, p.y, p.z}) append_number(out, e + 0.0, 12), out += ' ';
      }
      const Matrix3<double> r = (turn * s[i].rest * body::joint_rotation(s[i], q) * turn.conjugate()).matrix();
      const double c = std::hypot(r.xy, r.yy);
      const double x = std::atan2(r.zy, c);
      // With x at a right angle z and y turn about one axis; all of it goes to z.
      const double z = c > 1e-9 ? std::atan2(-r.xy, r.yy) : std::atan2(r.yx, r.xx);
      const double y = c > 1e-9 ? std::atan2(-r.zx, r.zz) : 0.0;
      for (const double e : {z, x, y}) append_number(out, e * degrees + 0.0, 12), out += ' ';
    }
    out.back() = '\n';
  }
  return out;
}

/// Writes a BVH file whole or not at all; see format_bvh.
inline void write_bvh(const std::filesystem::path& path, const motion::Clip& clip, double unit = 0.01) {
  write_atomically(path, format_bvh(clip, unit));
}

}  // namespace traceur::io
