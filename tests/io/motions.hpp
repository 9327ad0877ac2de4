// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <traceur/body/kinematics.hpp>
#include <traceur/motion/clip.hpp>

/// What the tests of motion readers share: a person as a BVH text, and where recorded motions may be found.
namespace motions {

using Vector = traceur::core::Vector3<double>;

/// The folder of recorded motions, if there is one on this machine.
inline std::optional<std::filesystem::path> folder() {
  std::filesystem::path path;
  if (const char* named = std::getenv("TRACEUR_MOTIONS")) path = named;
#ifdef TRACEUR_SOURCE_DIR
  if (path.empty()) path = std::filesystem::path(TRACEUR_SOURCE_DIR) / ".." / "shared" / "motions";
#endif
  std::error_code failure;
  if (path.empty() || !std::filesystem::is_directory(path, failure)) return std::nullopt;
  return path;
}

/// The message of the traceur::Error a call throws; empty when it throws none.
inline std::string error_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const traceur::Error& e) {
    return e.what();
  }
  return {};
}

inline bool contains(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  return at == std::string::npos ? "nothing to replace: " + from : text.replace(at, from.size(), to);
}

inline std::vector<Vector> positions(const traceur::motion::Clip& clip, int key) {
  traceur::body::Frames<double> frames(clip.skeleton);
  traceur::body::forward_kinematics(clip.skeleton, clip.poses.col(key).data(), frames);
  return frames.position;
}

inline Vector position(const traceur::motion::Clip& clip, int key, const std::string& joint) {
  return positions(clip, key)[static_cast<std::size_t>(clip.skeleton.find(joint))];
}

inline double distance(const Vector& a, const Vector& b) { return norm(a - b); }

/// A person of 1.71 m as BVH. Lengths are metres divided by `unit`; `axes` takes (left, up, forward) to file axes for
/// the skeleton, `world` for the root's position; `order` is the rotation order of every joint.
struct Person {
  double unit = 0.01;
  std::function<Vector(double, double, double)> axes = [](double l, double u, double f) { return Vector{l, u, f}; };
  std::function<Vector(double, double, double)> world = [](double l, double u, double f) { return Vector{l, u, f}; };
  std::string order = "ZXY";

  /// Joints in the order of their channels.
  static const std::vector<std::string>& names() {
    static const std::vector<std::string> all{"Hips",    "Spine",    "Head",       "LeftArm",  "RightArm", "LeftUpLeg",
                                              "LeftLeg", "LeftFoot", "RightUpLeg", "RightLeg", "RightFoot"};
    return all;
  }

  std::string hierarchy() const {
    std::string out = "HIERARCHY\n";
    const auto joint = [&](const char* kind, const char* name, double l, double u, double f) {
      const Vector o = axes(l, u, f);
      out += std::string(kind) + (*name ? " " : "") + name + "\n{\nOFFSET " + number(o.x / unit) + " " +
             number(o.y / unit) + " " + number(o.z / unit) + "\n";
      if (std::string(kind) == "End Site") return;
      out += std::string("CHANNELS ") + (std::string(kind) == "ROOT" ? "6 Xposition Yposition Zposition" : "3");
      for (const char axis : order) out += std::string(" ") + axis + "rotation";
      out += "\n";
    };
    joint("ROOT", "Hips", 0, 0, 0);
    joint("JOINT", "Spine", 0, 0.15, 0);
    joint("JOINT", "Head", 0, 0.40, 0);
    joint("End Site", "", 0, 0.20, 0);
    out += "}\n}\n";
    joint("JOINT", "LeftArm", 0.2, 0.35, 0);
    joint("End Site", "", 0.6, 0, 0);
    out += "}\n}\n";
    joint("JOINT", "RightArm", -0.2, 0.35, 0);
    joint("End Site", "", -0.6, 0, 0);
    out += "}\n}\n}\n";
    for (const double side : {1.0, -1.0}) {
      const std::string s = side > 0 ? "Left" : "Right";
      joint("JOINT", (s + "UpLeg").c_str(), 0.09 * side, -0.05, 0);
      joint("JOINT", (s + "Leg").c_str(), 0, -0.42, 0);
      joint("JOINT", (s + "Foot").c_str(), 0, -0.42, 0);
      joint("End Site", "", 0, -0.05, 0.15);
      out += "}\n}\n}\n}\n";
    }
    return out + "}\n";
  }

  /// One line: root at (left, up, forward) metres; angles in degrees in the order of the channels, all joints.
  std::string row(double l, double u, double f, const std::vector<double>& angles = {}) const {
    const Vector p = world(l, u, f);
    std::string out = number(p.x / unit) + " " + number(p.y / unit) + " " + number(p.z / unit);
    for (std::size_t k = 0; k < 3 * names().size(); ++k) out += " " + number(k < angles.size() ? angles[k] : 0.0);
    return out + "\n";
  }

  std::string text(const std::vector<std::string>& rows, const std::string& step = "0.0333333") const {
    std::string out = hierarchy() + "MOTION\nFrames: " + std::to_string(rows.size()) + "\nFrame Time: " + step + "\n";
    for (const std::string& r : rows) out += r;
    return out;
  }

  /// Angles with one joint turned by (a, b, c) in channel order.
  static std::vector<double> turn(const std::string& name, double a, double b, double c) {
    std::vector<double> out(3 * names().size(), 0.0);
    for (std::size_t j = 0; j < names().size(); ++j)
      if (names()[j] == name) out[3 * j] = a, out[3 * j + 1] = b, out[3 * j + 2] = c;
    return out;
  }

  static std::string number(double v) {
    char buffer[32];
    std::snprintf(buffer, sizeof buffer, "%.12g", v);
    return buffer;
  }
};

/// A folder that goes with the test.
class Folder {
public:
  Folder() {
    std::random_device entropy;
    path_ = std::filesystem::temp_directory_path() /
            ("traceur-motion-" + std::to_string(entropy()) + std::to_string(entropy()));
    std::filesystem::create_directory(path_);
  }
  ~Folder() { std::filesystem::remove_all(path_); }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

private:
  std::filesystem::path path_;
};

}  // namespace motions
