// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "traceur/io/asf_amc.hpp"
#include "traceur/io/bvh.hpp"
#include "traceur/io/clip_file.hpp"
#include "traceur/io/deepmimic.hpp"
#include "traceur/io/motion_json.hpp"

namespace traceur::io {

/// Options of all readers; one that the file's format has no use for is an error, not ignored.
struct LoadOptions {
  std::filesystem::path skeleton;  ///< AMC: the ASF file; DeepMimic: the character file; empty: see those readers
  std::optional<double> unit;      ///< BVH, AMC: metres in one unit of the file
  UpAxis up = UpAxis::detect;      ///< BVH, AMC: the file's axis away from the ground
  std::optional<double> fps;       ///< frames a second; by default what the file says, if its format does
  int skip_frames = 0;             ///< BVH, AMC: frames to drop at the start
  std::optional<bool> cyclic;      ///< whether the clip repeats; without it what the file says, if it says anything
};

enum class ClipFormat { bvh, amc, deepmimic, json, clip };

/// The format of a motion file, by its content where that is telling and by its extension otherwise. `where` names the
/// file in messages. Throws Error when it is none of those that can be read.
inline ClipFormat find_format(std::string_view text, const std::filesystem::path& path, const std::string& where) {
  using namespace detail;
  const std::string extension = lowered(path.extension().string());
  if (extension == ".asf") throw Error(where + ": a skeleton; expected a motion, such as the .amc file of a take");
  Lines lines(text);
  std::string_view line;
  if (!lines.next_filled(line)) throw Error(where + ": expected a motion, found an empty file");
  std::string_view rest = line;
  if (lowered(next_word(rest)) == "hierarchy" || extension == ".bvh") return ClipFormat::bvh;
  if (extension == ".amc") return ClipFormat::amc;
  if (line.front() == '{') {
    if (extension == ".jsonl" ||
        line.substr(0, 200).find(std::string("\"") + clip_format + "\"") != std::string_view::npos)
      return ClipFormat::clip;
    if (text.find("\"Frames\"") != std::string_view::npos) return ClipFormat::deepmimic;
    if (text.find("\"Skeleton\"") != std::string_view::npos)
      throw Error(where + ": a DeepMimic character; expected a motion");
    return ClipFormat::json;
  }
  throw Error(where +
              ": expected a motion in BVH (.bvh), Acclaim (.amc), DeepMimic (.txt), JSON (.json) or our own format "
              "(.jsonl), found " +
              shown(line));
}

/// Reads a motion file of any format we know.
inline LoadedClip load_clip(const std::filesystem::path& path, const LoadOptions& options = {}) {
  const std::string where = path.string();
  const std::string text = detail::read_text(path);
  const ClipFormat format = find_format(text, path, where);
  const bool has_skeleton = format == ClipFormat::amc || format == ClipFormat::deepmimic;
  const bool is_capture = format == ClipFormat::bvh || format == ClipFormat::amc;
  if (!options.skeleton.empty() && !has_skeleton)
    throw Error(where + ": option skeleton: this format brings its own skeleton");
  if (options.unit && !is_capture) throw Error(where + ": option unit: this format is in metres");
  if (options.up != UpAxis::detect && !is_capture) throw Error(where + ": option up: this format fixes the up axis");
  if (options.fps && !(*options.fps > 0 && std::isfinite(*options.fps)))
    throw Error(where + ": option fps: expected a positive rate");
  if (options.skip_frames != 0 && !is_capture) throw Error(where + ": option skip_frames: only for BVH and AMC");

  LoadedClip out;
  switch (format) {
    case ClipFormat::bvh:
      out = parse_bvh(text, where, {options.unit, options.up, options.skip_frames});
      break;
    case ClipFormat::amc: {
      AsfAmcOptions amc;
      amc.skeleton = options.skeleton;
      amc.unit = options.unit;
      amc.up = options.up;
      if (options.fps) amc.fps = *options.fps;
      amc.skip_frames = options.skip_frames;
      out = read_asf_amc(path, amc);
      break;
    }
    case ClipFormat::deepmimic:
      out = read_deepmimic(path, {options.skeleton});
      break;
    case ClipFormat::json:
      out = parse_motion_json(text, where);
      break;
    case ClipFormat::clip:
      out = parse_clip(text, where);
      break;
  }
  if (options.fps && format != ClipFormat::amc && out.report.fps != *options.fps) {
    out.clip.times *= out.report.fps / *options.fps;
    char note[96];
    std::snprintf(note, sizeof note, "the file says %.6g frames a second; taken as %.6g, as asked", out.report.fps,
                  *options.fps);
    out.report.notes.emplace_back(note);
    out.report.fps = *options.fps;
    out.report.fps_reason = "option fps";
  }
  if (options.cyclic && *options.cyclic != out.clip.cyclic) {
    out.clip.cyclic = false;
    if (*options.cyclic) make_cyclic(out);
    out.report.notes.push_back(*options.cyclic ? "cyclic, as asked" : "not cyclic, as asked");
  }
  return out;
}

}  // namespace traceur::io
