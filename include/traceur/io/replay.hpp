// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <locale>
#include <sstream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <traceur/core/error.hpp>
#include <traceur/io/atomic_file.hpp>
#include <traceur/io/detail/replay_page.hpp>

namespace traceur::io {

/// A solid that moves with one body. Lengths in metres.
struct ReplayShape {
  enum class Kind { sphere, capsule, box };
  Kind kind = Kind::sphere;
  int body = 0;                                  ///< index into ReplayCharacter::bodies
  std::array<float, 3> position{0, 0, 0};        ///< centre in the body's frame
  std::array<float, 4> rotation{0, 0, 0, 1};     ///< shape to body, unit quaternion x y z w
  std::array<float, 3> size{0.1F, 0.1F, 0.1F};  ///< sphere: radius; capsule: radius, half length of its axis along the
                                                 ///< shape's z, without the caps; box: half extents
};

struct ReplayBody {
  std::string name;
  int parent = -1;  ///< index of an earlier body, or -1
};

/// What moves. Body 0 is the root, which the camera follows. Without shapes the page draws the bones alone.
struct ReplayCharacter {
  std::vector<ReplayBody> bodies;
  std::vector<ReplayShape> shapes;
};

/// One motion of one character, sampled evenly from time 0. World frame: z up, metres, newtons.
struct ReplayTrack {
  std::string name;
  bool ghost = false;                              ///< drawn translucent, or beside: a reference or a plan
  std::array<float, 3> color{0.30F, 0.55F, 0.85F};  ///< sRGB, each in [0, 1]
  float fps = 30;                                  ///< frames per second
  int character = 0;                               ///< index into Replay::characters
  std::vector<float> poses;                        ///< frames x bodies x 7: position x y z, unit quaternion x y z w
  std::vector<std::vector<std::array<float, 6>>> contacts;  ///< empty, or of each frame: point, force on the character
  std::vector<float> pushes;  ///< empty, or frames x 6: point and impulse (N s) of a push in that frame, zeros for none
};

/// Columns of dx by dx metres: the one around (x0 + ix dx, y0 + iy dx) is heights[ix + nx iy] metres high. Outside, and
/// everywhere if `heights` is empty, the ground is at 0.
struct ReplayTerrain {
  int nx = 0, ny = 0;
  float dx = 1;
  float x0 = 0, y0 = 0;
  std::vector<float> heights;
};

/// Motions to be watched side by side. They share one clock; a track that ends early stays in its last frame.
struct Replay {
  std::string title;
  std::vector<std::pair<std::string, std::string>> facts;  ///< shown as a small table, in this order
  std::vector<ReplayCharacter> characters;
  std::vector<ReplayTrack> tracks;
  ReplayTerrain terrain;
};

namespace detail {

/// Standard base64 with padding.
inline std::string replay_base64(const std::vector<std::uint8_t>& bytes) {
  constexpr std::string_view digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t left = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t word = 0;
    for (std::size_t k = 0; k < 3; ++k) word = word << 8U | (k < left ? bytes[i + k] : 0U);
    for (std::size_t k = 0; k < 4; ++k) text.push_back(k <= left ? digits[word >> (18U - 6U * k) & 63U] : '=');
  }
  return text;
}

/// Little-endian bytes whatever the machine's order.
inline void replay_append(std::vector<std::uint8_t>& bytes, std::uint32_t word, int count) {
  for (int k = 0; k < count; ++k) bytes.push_back(static_cast<std::uint8_t>(word >> (8 * k) & 255U));
}

/// Numbers as int16 multiples of a step, or as float32 where int16 would be too coarse.
struct ReplayNumbers {
  double step = 1;
  bool wide = false;

  /// Steps that just reach `largest` in magnitude; rounding to the nearest stays within `tolerance`.
  static ReplayNumbers reaching(double largest, double tolerance) {
    const double step = largest > 0 ? largest / 32767 : 1;
    if (largest > 0 && step / 2 > tolerance) return {1, true};
    return {step, false};
  }
  void append(std::vector<std::uint8_t>& bytes, double value) const {
    if (wide) {
      replay_append(bytes, std::bit_cast<std::uint32_t>(static_cast<float>(value)), 4);
    } else {
      replay_append(bytes, static_cast<std::uint32_t>(static_cast<std::int32_t>(std::lround(value / step))), 2);
    }
  }
};

/// Length of the well-formed UTF-8 sequence at `at`, 0 if there is none (RFC 3629: no overlong forms, no surrogates).
inline std::size_t replay_utf8_length(std::string_view text, std::size_t at) {
  const auto byte = [&](std::size_t k) { return at + k < text.size() ? static_cast<unsigned char>(text[at + k]) : 0U; };
  const unsigned first = byte(0);
  if (first < 0x80) return 1;
  const std::size_t length = first >= 0xF0 ? 4 : first >= 0xE0 ? 3 : 2;
  if (first < 0xC2 || first > 0xF4) return 0;
  for (std::size_t k = 1; k < length; ++k) {
    if ((byte(k) & 0xC0U) != 0x80) return 0;
  }
  if ((first == 0xE0 && byte(1) < 0xA0) || (first == 0xED && byte(1) > 0x9F)) return 0;
  if ((first == 0xF0 && byte(1) < 0x90) || (first == 0xF4 && byte(1) > 0x8F)) return 0;
  return length;
}

/// A JSON string that is harmless inside a script element, with U+FFFD for bytes that are not UTF-8.
inline std::string replay_json_string(std::string_view text) {
  constexpr std::string_view hex = "0123456789abcdef";
  std::string out = "\"";
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t length = replay_utf8_length(text, at);
    const auto byte = static_cast<unsigned char>(text[at]);
    if (length == 0) {
      out += "\\ufffd";
    } else if (byte < 0x20 || byte == 0x7F || std::string_view("\"\\<>&").find(text[at]) != std::string_view::npos) {
      out += "\\u00";
      out.push_back(hex[byte >> 4U]);
      out.push_back(hex[byte & 15U]);
    } else {
      out.append(text.substr(at, length));
    }
    at += std::max<std::size_t>(1, length);
  }
  return out + "\"";
}

/// Text for an HTML element's content, with U+FFFD for control characters and for bytes that are not UTF-8.
inline std::string replay_html_text(std::string_view text) {
  std::string out;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t length = replay_utf8_length(text, at);
    const auto byte = static_cast<unsigned char>(text[at]);
    if (byte == '<') {
      out += "&lt;";
    } else if (byte == '>') {
      out += "&gt;";
    } else if (byte == '&') {
      out += "&amp;";
    } else if (length == 0 || byte < 0x20 || byte == 0x7F) {
      out += "&#xFFFD;";
    } else {
      out.append(text.substr(at, length));
    }
    at += std::max<std::size_t>(1, length);
  }
  return out;
}

[[noreturn]] inline void replay_fault(const std::string& where, const std::string& expected) {
  throw Error("replay: " + where + ": " + expected);
}

/// "track 0 'walk'", on one line whatever the name holds.
inline std::string replay_label(const char* what, std::size_t index, std::string_view name = {}) {
  std::string label = std::string(what) + " " + std::to_string(index);
  if (name.empty()) return label;
  label += " '";
  for (const char c : name) label.push_back(static_cast<unsigned char>(c) < 0x20 ? ' ' : c);
  return label + "'";
}

template <class Range>
bool replay_finite(const Range& values) {
  return std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); });
}

inline bool replay_unit(const float* q) {
  double square = 0;
  for (int k = 0; k < 4; ++k) square += double{q[k]} * double{q[k]};
  return std::abs(square - 1) < 0.02;
}

inline void replay_check(const ReplayCharacter& character, const std::string& where) {
  if (character.bodies.empty()) replay_fault(where, "expected at least one body");
  for (std::size_t b = 0; b < character.bodies.size(); ++b) {
    const ReplayBody& body = character.bodies[b];
    if (body.parent < -1 || body.parent >= static_cast<int>(b)) {
      replay_fault(where + ", " + replay_label("body", b, body.name),
                   "parent is " + std::to_string(body.parent) + ", expected -1 or an earlier body");
    }
  }
  for (std::size_t s = 0; s < character.shapes.size(); ++s) {
    const ReplayShape& shape = character.shapes[s];
    const std::string here = where + ", " + replay_label("shape", s);
    std::size_t sizes = 0;
    switch (shape.kind) {
      case ReplayShape::Kind::sphere: sizes = 1; break;
      case ReplayShape::Kind::capsule: sizes = 2; break;
      case ReplayShape::Kind::box: sizes = 3; break;
    }
    if (sizes == 0) replay_fault(here, "kind is not one of sphere, capsule, box");
    if (shape.body < 0 || shape.body >= static_cast<int>(character.bodies.size())) {
      replay_fault(here, "body is " + std::to_string(shape.body) + ", expected 0 to " +
                             std::to_string(character.bodies.size() - 1));
    }
    if (!replay_finite(shape.position)) replay_fault(here, "position is not finite");
    if (!replay_finite(shape.rotation) || !replay_unit(shape.rotation.data())) {
      replay_fault(here, "rotation is not a unit quaternion");
    }
    for (std::size_t k = 0; k < sizes; ++k) {
      // A capsule without length is a sphere and harmless.
      const bool may_vanish = shape.kind == ReplayShape::Kind::capsule && k == 1;
      if (!std::isfinite(shape.size[k]) || shape.size[k] < 0 || (shape.size[k] <= 0 && !may_vanish)) {
        replay_fault(here, "size[" + std::to_string(k) + "] is not a positive number");
      }
    }
  }
}

inline void replay_check(const ReplayTrack& track, const Replay& replay, const std::string& where) {
  if (track.character < 0 || track.character >= static_cast<int>(replay.characters.size())) {
    replay_fault(where, "character is " + std::to_string(track.character) + ", expected an index below " +
                            std::to_string(replay.characters.size()));
  }
  if (!std::isfinite(track.fps) || track.fps <= 0) replay_fault(where, "fps is not a positive number");
  for (const float channel : track.color) {
    if (!(channel >= 0 && channel <= 1)) replay_fault(where, "color is not within [0, 1]");
  }
  const auto& bodies = replay.characters[static_cast<std::size_t>(track.character)].bodies;
  const std::size_t width = bodies.size() * 7;
  if (track.poses.empty() || track.poses.size() % width != 0) {
    replay_fault(where, "poses holds " + std::to_string(track.poses.size()) + " numbers, expected frames x " +
                            std::to_string(bodies.size()) + " bodies x 7");
  }
  const std::size_t frames = track.poses.size() / width;
  for (std::size_t f = 0; f < frames; ++f) {
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      const float* pose = track.poses.data() + f * width + b * 7;
      const bool finite = std::all_of(pose, pose + 7, [](float v) { return std::isfinite(v); });
      if (finite && replay_unit(pose + 3)) continue;
      replay_fault(where + ", " + replay_label("frame", f) + ", " + replay_label("body", b, bodies[b].name),
                   finite ? "rotation is not a unit quaternion" : "pose is not finite");
    }
  }
  if (!track.contacts.empty() && track.contacts.size() != frames) {
    replay_fault(where, "contacts holds " + std::to_string(track.contacts.size()) + " frames, expected none or " +
                            std::to_string(frames));
  }
  for (std::size_t f = 0; f < track.contacts.size(); ++f) {
    const std::string here = where + ", " + replay_label("frame", f);
    if (track.contacts[f].size() > 65535) replay_fault(here, "more than 65535 contacts");
    for (std::size_t c = 0; c < track.contacts[f].size(); ++c) {
      if (!replay_finite(track.contacts[f][c])) replay_fault(here + ", " + replay_label("contact", c), "is not finite");
    }
  }
  if (!track.pushes.empty() && track.pushes.size() != frames * 6) {
    replay_fault(where, "pushes holds " + std::to_string(track.pushes.size()) + " numbers, expected none or " +
                            std::to_string(frames) + " frames x 6");
  }
  for (std::size_t i = 0; i < track.pushes.size(); ++i) {
    if (!std::isfinite(track.pushes[i])) {
      replay_fault(where + ", " + replay_label("frame", i / 6), "push is not finite");
    }
  }
}

inline void replay_check(const ReplayTerrain& terrain) {
  if (terrain.heights.empty()) return;
  if (terrain.nx < 1 || terrain.ny < 1 ||
      terrain.heights.size() != static_cast<std::size_t>(terrain.nx) * static_cast<std::size_t>(terrain.ny)) {
    replay_fault("terrain", "heights holds " + std::to_string(terrain.heights.size()) +
                                " numbers, expected nx x ny = " + std::to_string(terrain.nx) + " x " +
                                std::to_string(terrain.ny));
  }
  if (!std::isfinite(terrain.dx) || terrain.dx <= 0) replay_fault("terrain", "dx is not a positive number");
  if (!std::isfinite(terrain.x0) || !std::isfinite(terrain.y0)) replay_fault("terrain", "x0 or y0 is not finite");
  for (std::size_t i = 0; i < terrain.heights.size(); ++i) {
    if (std::isfinite(terrain.heights[i])) continue;
    const std::size_t nx = static_cast<std::size_t>(terrain.nx);
    replay_fault("terrain, column " + std::to_string(i % nx) + ", " + std::to_string(i / nx), "height is not finite");
  }
}

inline constexpr double replay_length_tolerance = 0.0005;  // m

template <class Range>
void replay_json_numbers(std::ostream& out, const Range& values) {
  char separator = '[';
  for (const float value : values) {
    out << separator << value;
    separator = ',';
  }
  out << ']';
}

inline void replay_json(std::ostream& out, const ReplayCharacter& character) {
  out << "{\"bodies\":[";
  for (std::size_t b = 0; b < character.bodies.size(); ++b) {
    out << (b ? "," : "") << "{\"name\":" << replay_json_string(character.bodies[b].name)
        << ",\"parent\":" << character.bodies[b].parent << '}';
  }
  out << "],\"shapes\":[";
  for (std::size_t s = 0; s < character.shapes.size(); ++s) {
    const ReplayShape& shape = character.shapes[s];
    const bool box = shape.kind == ReplayShape::Kind::box, capsule = shape.kind == ReplayShape::Kind::capsule;
    // Sizes that the kind does not use may hold anything, even what JSON cannot say.
    const std::array<float, 3> size{shape.size[0], box || capsule ? shape.size[1] : 0, box ? shape.size[2] : 0};
    out << (s ? "," : "") << "{\"kind\":\"" << (box ? "box" : capsule ? "capsule" : "sphere")
        << "\",\"body\":" << shape.body << ",\"position\":";
    replay_json_numbers(out, shape.position);
    out << ",\"rotation\":";
    replay_json_numbers(out, shape.rotation);
    out << ",\"size\":";
    replay_json_numbers(out, size);
    out << '}';
  }
  out << "]}";
}

inline void replay_json_contacts(std::ostream& out, const ReplayTrack& track, std::size_t width) {
  double reach = 0, strength = 0;
  for (std::size_t f = 0; f < track.contacts.size(); ++f) {
    for (const auto& contact : track.contacts[f]) {
      for (std::size_t k = 0; k < 3; ++k) {
        reach = std::max(reach, std::abs(double{contact[k]} - double{track.poses[f * width + k]}));
        strength = std::max(strength, std::abs(double{contact[3 + k]}));
      }
    }
  }
  ReplayNumbers points = ReplayNumbers::reaching(reach, replay_length_tolerance);
  // Both kinds share one array; a force is read off an arrow, for which 1/65534 of the largest will do.
  ReplayNumbers forces = points.wide ? points : ReplayNumbers{strength > 0 ? strength / 32767 : 1, false};
  std::vector<std::uint8_t> counts, values;
  for (std::size_t f = 0; f < track.contacts.size(); ++f) {
    replay_append(counts, static_cast<std::uint32_t>(track.contacts[f].size()), 2);
    for (const auto& contact : track.contacts[f]) {
      for (std::size_t k = 0; k < 3; ++k) {
        points.append(values, double{contact[k]} - double{track.poses[f * width + k]});
      }
      for (std::size_t k = 3; k < 6; ++k) forces.append(values, double{contact[k]});
    }
  }
  out << "{\"wide\":" << (points.wide ? "true" : "false") << ",\"pointStep\":" << points.step
      << ",\"forceStep\":" << forces.step << ",\"counts\":\"" << replay_base64(counts) << "\",\"values\":\""
      << replay_base64(values) << "\"}";
}

/// Roots are exact; the other positions are told relative to the frame's root, whose neighbourhood int16 can resolve.
inline void replay_json(std::ostream& out, const ReplayTrack& track, std::size_t bodies) {
  const std::size_t width = bodies * 7, frames = track.poses.size() / width;
  const auto offset = [&](std::size_t f, std::size_t b, std::size_t k) {
    return double{track.poses[f * width + b * 7 + k]} - double{track.poses[f * width + k]};
  };
  double reach = 0;
  for (std::size_t f = 0; f < frames; ++f) {
    for (std::size_t b = 0; b < bodies; ++b) {
      for (std::size_t k = 0; k < 3; ++k) reach = std::max(reach, std::abs(offset(f, b, k)));
    }
  }
  const ReplayNumbers positions = ReplayNumbers::reaching(reach, replay_length_tolerance);
  const ReplayNumbers turns = positions.wide ? positions : ReplayNumbers{1.0 / 32767, false};
  std::vector<std::uint8_t> roots, values;
  roots.reserve(frames * 12);
  values.reserve(track.poses.size() * (positions.wide ? 4 : 2));
  for (std::size_t f = 0; f < frames; ++f) {
    for (std::size_t k = 0; k < 3; ++k) {
      replay_append(roots, std::bit_cast<std::uint32_t>(track.poses[f * width + k]), 4);
    }
    for (std::size_t b = 0; b < bodies; ++b) {
      for (std::size_t k = 0; k < 3; ++k) positions.append(values, offset(f, b, k));
      for (std::size_t k = 3; k < 7; ++k) {
        turns.append(values, std::clamp(double{track.poses[f * width + b * 7 + k]}, -1.0, 1.0));
      }
    }
  }
  out << "{\"name\":" << replay_json_string(track.name) << ",\"ghost\":" << (track.ghost ? "true" : "false")
      << ",\"color\":";
  replay_json_numbers(out, track.color);
  out << ",\"fps\":" << track.fps << ",\"character\":" << track.character << ",\"frames\":" << frames
      << ",\"wide\":" << (positions.wide ? "true" : "false") << ",\"step\":" << positions.step << ",\"roots\":\""
      << replay_base64(roots) << "\",\"poses\":\"" << replay_base64(values) << "\",\"contacts\":";
  if (std::all_of(track.contacts.begin(), track.contacts.end(), [](const auto& frame) { return frame.empty(); })) {
    out << "null";
  } else {
    replay_json_contacts(out, track, width);
  }
  out << ",\"pushes\":";
  if (std::all_of(track.pushes.begin(), track.pushes.end(), [](float v) { return v == 0; })) {
    out << "null}";
  } else {
    std::vector<std::uint8_t> pushes;
    for (const float value : track.pushes) replay_append(pushes, std::bit_cast<std::uint32_t>(value), 4);
    out << '"' << replay_base64(pushes) << "\"}";
  }
}

inline void replay_json(std::ostream& out, const ReplayTerrain& terrain) {
  if (terrain.heights.empty()) {
    out << "null";
    return;
  }
  double largest = 0;
  for (const float height : terrain.heights) largest = std::max(largest, std::abs(double{height}));
  const ReplayNumbers numbers = ReplayNumbers::reaching(largest, replay_length_tolerance);
  std::vector<std::uint8_t> heights;
  for (const float height : terrain.heights) numbers.append(heights, double{height});
  out << "{\"nx\":" << terrain.nx << ",\"ny\":" << terrain.ny << ",\"dx\":" << terrain.dx << ",\"x0\":" << terrain.x0
      << ",\"y0\":" << terrain.y0 << ",\"wide\":" << (numbers.wide ? "true" : "false") << ",\"step\":" << numbers.step
      << ",\"heights\":\"" << replay_base64(heights) << "\"}";
}

}  // namespace detail

/// The replay as one HTML page that needs nothing else: no network, no other file. It draws with WebGL2, or with Canvas
/// 2D where that is missing.
///
/// Positions are kept to 0.5 mm or better, rotations to 1e-4 rad, contact forces to 1/65534 of the track's largest
/// component. Text that is not UTF-8 is shown with replacement characters.
///
/// The address can ask for a moment and a view: `?t=1.5` opens paused at 1.5 s, `speed=0.5`,
/// `camera=azimuth,elevation,distance` (degrees, degrees, metres; the azimuth from x towards y of where the camera
/// stands), `ghost=overlay|beside|off`, `view=solid|bones`, `theme=light|dark`, `renderer=2d`.
///
/// Throws traceur::Error that names the track, frame or field that is not as its struct says.
inline std::string replay_page(const Replay& replay) {
  if (replay.tracks.empty()) detail::replay_fault("tracks", "expected at least one");
  for (std::size_t c = 0; c < replay.characters.size(); ++c) {
    detail::replay_check(replay.characters[c], detail::replay_label("character", c));
  }
  for (std::size_t t = 0; t < replay.tracks.size(); ++t) {
    detail::replay_check(replay.tracks[t], replay, detail::replay_label("track", t, replay.tracks[t].name));
  }
  detail::replay_check(replay.terrain);

  std::ostringstream out;
  out.imbue(std::locale::classic());
  out.precision(9);
  out << detail::replay_page_before_title << detail::replay_html_text(replay.title);
  for (const std::string_view part : detail::replay_page_before_data) out << part;
  out << "{\"title\":" << detail::replay_json_string(replay.title) << ",\"facts\":[";
  for (std::size_t i = 0; i < replay.facts.size(); ++i) {
    out << (i ? "," : "") << '[' << detail::replay_json_string(replay.facts[i].first) << ','
        << detail::replay_json_string(replay.facts[i].second) << ']';
  }
  out << "],\"characters\":[";
  for (std::size_t c = 0; c < replay.characters.size(); ++c) {
    if (c) out << ',';
    detail::replay_json(out, replay.characters[c]);
  }
  out << "],\"tracks\":[";
  for (std::size_t t = 0; t < replay.tracks.size(); ++t) {
    if (t) out << ',';
    const auto character = static_cast<std::size_t>(replay.tracks[t].character);
    detail::replay_json(out, replay.tracks[t], replay.characters[character].bodies.size());
  }
  out << "],\"terrain\":";
  detail::replay_json(out, replay.terrain);
  out << '}';
  for (const std::string_view part : detail::replay_page_after_data) out << part;
  return out.str();
}

/// Writes `replay_page(replay)` to `path`, complete or not at all. Throws traceur::Error that names the path, or the
/// track, frame or field at fault.
inline void write_replay(const std::filesystem::path& path, const Replay& replay) {
  write_atomically(path, replay_page(replay));
}

}  // namespace traceur::io
