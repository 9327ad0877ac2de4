// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cctype>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "traceur/body/kinematics.hpp"

namespace traceur::motion {

/// Places on a human body where skeletons have joints. A joint is named by the segment that begins there as often as by the
/// joint itself: `LeftUpLeg`, `lfemur`, `left_thigh` and `left_hip` are all the left hip.
enum class Landmark { none, pelvis, spine, neck, head, clavicle, shoulder, elbow, wrist, hip, knee, ankle, toe };

enum class Side { middle, left, right };

/// What a joint's name says. Names that styles use for two places ("shoulder" for clavicle or arm, "foot" for ankle or toes,
/// "hand" for wrist or palm) are marked as vague: they mean the place given unless another joint claims it by a plain name.
struct NamedLandmark {
  Landmark landmark = Landmark::none;
  Side side = Side::middle;
  bool vague = false;
};

namespace detail {

/// Lower-case letters of a name without namespaces ("mixamorig:"), character prefixes, separators and digits, and the side.
inline std::pair<std::string, Side> split_joint_name(std::string_view name) {
  if (const std::size_t colon = name.rfind(':'); colon != std::string_view::npos) name.remove_prefix(colon + 1);
  // Words end at separators, digits, and where a capital follows a small letter or begins a small-lettered word.
  std::vector<std::string> words{""};
  const auto is = [&](std::size_t i, int (*kind)(int)) {
    return i < name.size() && kind(static_cast<unsigned char>(name[i])) != 0;
  };
  for (std::size_t i = 0; i < name.size(); ++i) {
    const bool letter = is(i, std::isalpha);
    const bool begins = is(i, std::isupper) && i > 0 && (is(i - 1, std::islower) || is(i + 1, std::islower));
    if ((!letter || begins) && !words.back().empty()) words.emplace_back();
    if (letter) words.back() += static_cast<char>(std::tolower(static_cast<unsigned char>(name[i])));
  }
  if (words.back().empty()) words.pop_back();
  while (words.size() > 1 && (words.front() == "character" || words.front() == "bip" || words.front() == "mixamorig"))
    words.erase(words.begin());
  Side side = Side::middle;
  std::string rest;
  for (std::size_t i = 0; i < words.size(); ++i) {
    const bool left = words[i] == "left" || words[i] == "l", right = words[i] == "right" || words[i] == "r";
    if (side == Side::middle && (left || right))
      side = left ? Side::left : Side::right;
    else
      rest += words[i];
  }
  return {rest, side};
}

struct LandmarkWord {
  std::string_view word;
  Landmark landmark;
  bool sided;
  bool vague;
};

constexpr std::array<LandmarkWord, 49> landmark_words{{
    {"hips", Landmark::pelvis, false, false},       {"hip", Landmark::pelvis, false, false},
    {"pelvis", Landmark::pelvis, false, false},     {"root", Landmark::pelvis, false, false},
    {"spine", Landmark::spine, false, false},       {"lowerback", Landmark::spine, false, false},
    {"upperback", Landmark::spine, false, false},   {"thorax", Landmark::spine, false, false},
    {"chest", Landmark::spine, false, false},       {"torso", Landmark::spine, false, false},
    {"abdomen", Landmark::spine, false, false},     {"waist", Landmark::spine, false, false},
    {"upperchest", Landmark::spine, false, false},  {"back", Landmark::spine, false, false},
    {"neck", Landmark::neck, false, false},         {"lowerneck", Landmark::neck, false, false},
    {"upperneck", Landmark::neck, false, false},    {"head", Landmark::head, false, false},
    {"clavicle", Landmark::clavicle, true, false},  {"collar", Landmark::clavicle, true, false},
    {"shoulder", Landmark::shoulder, true, true},   {"arm", Landmark::shoulder, true, false},
    {"uparm", Landmark::shoulder, true, false},     {"upperarm", Landmark::shoulder, true, false},
    {"humerus", Landmark::shoulder, true, false},   {"shldr", Landmark::shoulder, true, false},
    {"forearm", Landmark::elbow, true, false},      {"lowarm", Landmark::elbow, true, false},
    {"lowerarm", Landmark::elbow, true, false},     {"radius", Landmark::elbow, true, false},
    {"elbow", Landmark::elbow, true, false},        {"wrist", Landmark::wrist, true, false},
    {"hand", Landmark::wrist, true, true},          {"upleg", Landmark::hip, true, false},
    {"upperleg", Landmark::hip, true, false},       {"thigh", Landmark::hip, true, false},
    {"femur", Landmark::hip, true, false},          {"hip", Landmark::hip, true, false},
    {"leg", Landmark::knee, true, false},           {"lowleg", Landmark::knee, true, false},
    {"lowerleg", Landmark::knee, true, false},      {"shin", Landmark::knee, true, false},
    {"tibia", Landmark::knee, true, false},         {"knee", Landmark::knee, true, false},
    {"calf", Landmark::knee, true, false},          {"ankle", Landmark::ankle, true, false},
    {"foot", Landmark::ankle, true, true},          {"toe", Landmark::toe, true, false},
    {"toes", Landmark::toe, true, false},
}};

}  // namespace detail

/// The place a joint's name stands for, on its own: BVH (LeftUpLeg, Character1_LeftLeg, mixamorig:LeftFoot), Acclaim (lfemur),
/// MuJoCo and DeepMimic bodies and joints (left_thigh, left_hip), SMPL (L_Hip).
inline NamedLandmark recognise_joint(std::string_view name) {
  auto [word, side] = detail::split_joint_name(name);
  if (word.size() > 3 && word.ends_with("base")) word.resize(word.size() - 4);
  if (word.size() > 5 && word.ends_with("dummy")) return {};
  const auto look = [](std::string_view w, Side s) -> NamedLandmark {
    for (const detail::LandmarkWord& known : detail::landmark_words)
      if (known.sided == (s != Side::middle) && known.word == w) return {known.landmark, s, known.vague};
    return {};
  };
  if (const NamedLandmark found = look(word, side); found.landmark != Landmark::none) return found;
  // One word with its side in front, as in "lfemur".
  if (side == Side::middle && word.size() > 1 && (word[0] == 'l' || word[0] == 'r'))
    return look(std::string_view(word).substr(1), word[0] == 'l' ? Side::left : Side::right);
  return {};
}

inline std::string to_string(Landmark landmark, Side side) {
  constexpr std::array<const char*, 13> names{"none",  "pelvis", "spine", "neck", "head", "clavicle", "shoulder",
                                              "elbow", "wrist",  "hip",   "knee", "ankle", "toe"};
  const char* prefix = side == Side::left ? "left_" : side == Side::right ? "right_" : "";
  return std::string(prefix) + names[static_cast<std::size_t>(landmark)];
}

/// Where a skeleton has its landmarks: joint indices, -1 for none.
struct BodyPlan {
  struct Limbs {
    int shoulder = -1, elbow = -1, wrist = -1;
    int hip = -1, knee = -1, ankle = -1;
    int toe = -1;  ///< a joint or end of the foot in front of the ankle
  };
  int pelvis = 0;             ///< the root
  int chest = -1;             ///< the body that carries both arms
  int neck = -1;              ///< base of the neck, or of the head where there is no neck
  int head = -1;              ///< the joint that turns the head
  int head_top = -1;          ///< a joint or end above `head`
  std::array<Limbs, 2> side;  ///< left, right

  const Limbs& left() const { return side[0]; }
  const Limbs& right() const { return side[1]; }

  /// The joint at a landmark, -1 for none. Spine and clavicle are not kept.
  int at(Landmark landmark, Side which) const {
    const int* p = slot(*this, landmark, which);
    return p != nullptr ? *p : -1;
  }
  /// Sets a landmark; false when the plan has no place for it.
  bool set(Landmark landmark, Side which, int joint) {
    int* p = slot(*this, landmark, which);
    if (p != nullptr) *p = joint;
    return p != nullptr;
  }

 private:
  template <class Plan>
  static auto slot(Plan& plan, Landmark landmark, Side which) -> decltype(&plan.pelvis) {
    auto& limbs = plan.side[which == Side::right ? 1 : 0];
    switch (landmark) {
      case Landmark::pelvis: return &plan.pelvis;
      case Landmark::neck: return &plan.neck;
      case Landmark::head: return &plan.head;
      case Landmark::shoulder: return &limbs.shoulder;
      case Landmark::elbow: return &limbs.elbow;
      case Landmark::wrist: return &limbs.wrist;
      case Landmark::hip: return &limbs.hip;
      case Landmark::knee: return &limbs.knee;
      case Landmark::ankle: return &limbs.ankle;
      case Landmark::toe: return &limbs.toe;
      default: return nullptr;
    }
  }
};

namespace detail {

/// The first joint below `joint`, itself excluded, that lies further than `least` (m) away along its chain; -1 for none.
/// Of several children it takes the one that leads farthest.
inline int next_below(const body::Skeleton& s, int joint, double least) {
  int best = -1;
  double farthest = least;
  std::vector<double> reach(static_cast<std::size_t>(s.size()), -1.0);
  reach[static_cast<std::size_t>(joint)] = 0;
  for (int i = joint + 1; i < s.size(); ++i) {
    const int p = s[i].parent;
    if (p < 0 || reach[static_cast<std::size_t>(p)] < 0) continue;
    const double at = reach[static_cast<std::size_t>(p)] + norm(s[i].offset);
    reach[static_cast<std::size_t>(i)] = at;
    if (at > farthest) {
      farthest = at;
      best = i;
    }
  }
  // Back towards the joint while that stays far enough away.
  while (best >= 0 && s[best].parent != joint && reach[static_cast<std::size_t>(s[best].parent)] > least) best = s[best].parent;
  return best;
}

inline int common_ancestor(const body::Skeleton& s, int a, int b) {
  while (a != b) {
    if (a > b)
      a = s[a].parent;
    else
      b = s[b].parent;
    if (a < 0 || b < 0) return 0;
  }
  return a;
}

inline bool is_below(const body::Skeleton& s, int joint, int ancestor) {
  while (joint > ancestor) joint = s[joint].parent;
  return joint == ancestor;
}

}  // namespace detail

/// Finds a skeleton's landmarks by the names of its joints, then of its bodies; the first joint from the root that bears a
/// name counts. Toes, wrists and the head's end may be any joint below foot, forearm and head. `chosen` settles landmarks
/// beforehand: entries other than -1 (and its pelvis 0) stay.
inline BodyPlan find_body_plan(const body::Skeleton& s, const BodyPlan& chosen = {}) {
  BodyPlan plan = chosen;
  for (const bool vague : {false, true})
    for (const bool by_body : {false, true})
      for (int i = 1; i < s.size(); ++i) {
        const NamedLandmark found = recognise_joint(by_body ? s[i].body : s[i].name);
        if (found.landmark == Landmark::none || found.landmark == Landmark::pelvis || found.vague != vague) continue;
        if (plan.at(found.landmark, found.side) < 0) {
          plan.set(found.landmark, found.side, i);
        } else if (vague && found.landmark == Landmark::ankle && plan.at(Landmark::toe, found.side) < 0 &&
                   detail::is_below(s, i, plan.at(Landmark::ankle, found.side)) && i != plan.at(Landmark::ankle, found.side)) {
          plan.set(Landmark::toe, found.side, i);
        }
      }
  for (BodyPlan::Limbs& limbs : plan.side) {
    if (limbs.wrist < 0 && limbs.elbow >= 0) limbs.wrist = detail::next_below(s, limbs.elbow, 0.05);
    if (limbs.ankle >= 0 && limbs.toe < 0) limbs.toe = detail::next_below(s, limbs.ankle, 0.02);
  }
  if (plan.left().shoulder >= 0 && plan.right().shoulder >= 0)
    plan.chest = detail::common_ancestor(s, plan.left().shoulder, plan.right().shoulder);
  if (plan.neck < 0) plan.neck = plan.head;
  if (plan.head < 0) plan.head = plan.neck;
  if (plan.head >= 0) plan.head_top = detail::next_below(s, plan.head, 0.02);
  return plan;
}

/// Names given by hand, target joint, body or landmark ("left_toe") to source joint.
using JointNames = std::map<std::string, std::string>;

/// Reads a map file: one JSON object whose keys are joints or bodies of the target, or landmarks such as "left_toe", and
/// whose values are joints of the source. `where` names the text in messages. Throws Error that names line and expectation.
inline JointNames parse_joint_names(std::string_view text, const std::string& where) {
  JointNames out;
  std::size_t at = 0;
  int line = 1;
  const auto fail = [&](const std::string& expected) {
    throw Error(where + ":" + std::to_string(line) + ": joint map: expected " + expected);
  };
  const auto next = [&]() -> char {
    for (; at < text.size(); ++at) {
      if (text[at] == '\n') ++line;
      if (text[at] != ' ' && text[at] != '\t' && text[at] != '\r' && text[at] != '\n') return text[at];
    }
    return '\0';
  };
  const auto expect = [&](char c) {
    if (next() != c) fail(std::string("'") + c + "'");
    ++at;
  };
  const auto string = [&] {
    if (next() != '"') fail("a name in quotes");
    std::string value;
    for (++at; at < text.size() && text[at] != '"'; ++at) {
      if (static_cast<unsigned char>(text[at]) < 0x20) fail("a name without control characters");
      if (text[at] == '\\') {
        ++at;
        if (at >= text.size() || (text[at] != '"' && text[at] != '\\' && text[at] != '/')) fail("no escapes but \\\" \\\\ \\/");
      }
      value += text[at];
    }
    if (at >= text.size()) fail("a closing quote");
    ++at;
    return value;
  };
  expect('{');
  if (next() == '}') {
    ++at;
  } else {
    while (true) {
      const std::string key = string();
      expect(':');
      const std::string value = string();
      if (!out.emplace(key, value).second) fail("each name once, found a second '" + key + "'");
      if (next() != ',') break;
      ++at;
    }
    expect('}');
  }
  if (next() != '\0') fail("nothing after the closing brace");
  return out;
}

/// Which joint of a source skeleton goes with which joint of the character.
struct JointMap {
  BodyPlan source, target;
  std::vector<int> source_of;         ///< for each target joint: the source joint at its landmark, or -1
  std::vector<std::string> unmapped;  ///< landmarks the motion can do without and the source lacks: "left_toe"
};

/// Maps by name, `names` first. Throws Error, in one line, that lists what the target needs and the source lacks, and the
/// source's joints; or names an entry of `names` that exists on neither side.
inline JointMap map_joints(const body::Skeleton& source, const body::Skeleton& target, const JointNames& names = {},
                           const std::string& where = "joint map") {
  JointMap map;
  map.target = find_body_plan(target);
  const auto landmark_of = [&](int joint) -> NamedLandmark {
    for (const Side side : {Side::left, Side::right, Side::middle})
      for (int l = static_cast<int>(Landmark::pelvis); l <= static_cast<int>(Landmark::toe); ++l) {
        const auto landmark = static_cast<Landmark>(l);
        if (map.target.at(landmark, side) == joint && (side == Side::middle) == (landmark <= Landmark::head))
          return {landmark, side, false};
      }
    return {};
  };
  BodyPlan chosen;
  for (const auto& [to, from] : names) {
    int joint = target.find(to);
    if (joint < 0) joint = target.find_body(to);
    NamedLandmark place = joint >= 0 ? landmark_of(joint) : recognise_joint(to);
    if (place.landmark == Landmark::none) place = recognise_joint(to);
    const int other = source.find(from);
    if (other < 0) throw Error(where + ": the source has no joint '" + from + "', given for '" + to + "'");
    if (place.landmark == Landmark::spine || place.landmark == Landmark::clavicle) continue;
    if (!chosen.set(place.landmark, place.side, other))
      throw Error(where + ": '" + to + "' is no joint, body or landmark of the target");
  }
  map.source = find_body_plan(source, chosen);

  std::string missing;
  const auto need = [&](Landmark landmark, Side side) {
    const int joint = map.target.at(landmark, side);
    if (joint < 0 || map.source.at(landmark, side) >= 0) return;
    const bool optional = landmark == Landmark::head || landmark == Landmark::neck;
    if (optional) {
      map.unmapped.push_back(to_string(landmark, side));
    } else {
      missing += (missing.empty() ? "" : ", ") + to_string(landmark, side) + " ('" + target[joint].name + "')";
    }
  };
  std::string target_missing;
  for (const Side side : {Side::left, Side::right})
    for (const Landmark l : {Landmark::hip, Landmark::knee, Landmark::ankle, Landmark::shoulder, Landmark::elbow, Landmark::wrist}) {
      if (map.target.at(l, side) < 0) target_missing += (target_missing.empty() ? "" : ", ") + to_string(l, side);
      need(l, side);
    }
  need(Landmark::neck, Side::middle);
  if (!target_missing.empty()) throw Error(where + ": the character has no joint at " + target_missing);
  if (!missing.empty()) {
    std::string known;
    for (const body::Joint& j : source.joints())
      if (j.type != body::JointType::fixed) known += (known.empty() ? "" : ", ") + j.name;
    throw Error(where + ": no source joint for " + missing + "; name them in a joint map; the source has " + known);
  }
  for (const Side side : {Side::left, Side::right})
    if (map.source.at(Landmark::toe, side) < 0) map.unmapped.push_back(to_string(Landmark::toe, side));

  map.source_of.assign(static_cast<std::size_t>(target.size()), -1);
  for (int i = 0; i < target.size(); ++i) {
    if (i == map.target.pelvis) {
      map.source_of[0] = map.source.pelvis;
    } else if (i == map.target.chest) {
      map.source_of[static_cast<std::size_t>(i)] = map.source.chest;
    } else if (const NamedLandmark place = landmark_of(i); place.landmark != Landmark::none) {
      map.source_of[static_cast<std::size_t>(i)] = map.source.at(place.landmark, place.side);
    }
  }
  return map;
}

}  // namespace traceur::motion
