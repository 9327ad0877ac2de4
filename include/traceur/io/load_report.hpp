// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "traceur/motion/clip.hpp"

namespace traceur::io {

/// The world axis of a file that points away from the ground.
enum class UpAxis { detect, x, y, z };

/// What a reader decided, assumed and left out, for a program to print.
struct LoadReport {
  std::string source;          ///< file, or the name given for a text
  std::string format;          ///< "BVH", "ASF/AMC", "DeepMimic", "AMP JSON", "PARC JSON", "traceur clip"
  double unit = 1;             ///< metres in one length unit of the file
  std::string unit_reason;     ///< where the unit comes from
  std::string up;              ///< the file's up axis
  std::string up_reason;       ///< where the up axis comes from
  std::string rotation_order;  ///< order in which the file's angles multiply, left to right; or the quaternion's layout
  double fps = 0;              ///< keys a second; of the first step where steps differ
  std::string fps_reason;      ///< where the rate comes from
  double standing_height = 0;  ///< body height that the leg bones suggest, m; 0 if not estimated
  double cycle_gap = 0;        ///< cyclic clips: root height, last key less first, m
  double cycle_gap_angle = 0;  ///< cyclic clips: largest joint rotation between first and last key, heading aside, rad
  std::vector<std::string> notes;  ///< one sentence each: what was dropped, assumed or looks odd

  /// All of the above as lines of text.
  std::string text() const {
    const auto number = [](double v) {
      char buffer[32];
      std::snprintf(buffer, sizeof buffer, "%.6g", v);
      return std::string(buffer);
    };
    std::string out = source + ": " + format + "\n  unit " + number(unit) + " m (" + unit_reason + ")\n  up " + up +
                      " (" + up_reason + ")\n  rotations " + rotation_order + "\n  " + number(fps) + " frames/s (" +
                      fps_reason + ")\n";
    if (standing_height > 0) out += "  standing height about " + number(standing_height) + " m\n";
    for (const std::string& note : notes) out += "  note: " + note + "\n";
    return out;
  }
};

/// Ground heights that came with a clip: `heights(i, j)` in m at min_point + dx (i, j), i along x and j along y.
struct TerrainHeights {
  Eigen::MatrixXd heights;
  Eigen::Vector2d min_point = Eigen::Vector2d::Zero();  ///< m
  double dx = 1;                                        ///< m
};

/// A clip in the house convention, and what its reader has to say about it.
struct LoadedClip {
  motion::Clip clip;
  LoadReport report;
  std::optional<TerrainHeights> terrain;  ///< only formats that carry ground
};

/// Marks the clip as cyclic and reports how far its last key is from being the first of the next cycle.
inline void make_cyclic(LoadedClip& loaded) {
  motion::Clip& clip = loaded.clip;
  clip.cyclic = true;
  if (!clip.skeleton.free_root() || clip.keys() < 2) return;
  Eigen::VectorXd last = clip.poses.col(clip.keys() - 1);
  clip.carry_root(-1, last);
  const Eigen::VectorXd first = clip.poses.col(0);
  Eigen::VectorXd d(clip.skeleton.nv());
  body::difference(clip.skeleton, first.data(), last.data(), d.data());
  double angle = d.segment(3, 3).norm();
  for (const body::Joint& j : clip.skeleton.joints())
    if (j.type == body::JointType::hinge || j.type == body::JointType::ball)
      angle = std::max(angle, d.segment(j.v_index, body::velocity_size(j.type)).norm());
  loaded.report.cycle_gap = d[2];
  loaded.report.cycle_gap_angle = angle;
  if (std::abs(d[2]) > 0.01 || angle > 0.1) {
    char buffer[160];
    std::snprintf(buffer, sizeof buffer,
                  "the cycle is not closed: from last to first key the root is off by %.3g m and a joint by %.3g rad",
                  d[2], angle);
    loaded.report.notes.emplace_back(buffer);
  }
}

}  // namespace traceur::io
