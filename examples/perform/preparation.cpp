// SPDX-License-Identifier: MIT
#include "preparation.hpp"

#include <cstdio>
#include <cstring>

#include "../common/files.hpp"
#include "../common/retargeting.hpp"
#include "traceur/io/load_clip.hpp"
#include "traceur/io/terrain_file.hpp"
#include "traceur/motion/loop.hpp"
#include "traceur/motion/repeats.hpp"
#include "traceur/motion/retarget.hpp"
#include "traceur/motion/scaling.hpp"
#include "traceur/motion/smooth.hpp"

namespace perform {

using namespace traceur;
using core::Quaternion;
using core::Vector3;

namespace {

constexpr double tick = 1.0 / 60;

double travel(const motion::Clip& c) { return (c.poses.col(c.keys() - 1).head(2) - c.poses.col(0).head(2)).norm(); }

double turn(const motion::Clip& c) {
  const auto heading = [&](int k) { return core::heading(Quaternion<double>::from(c.poses.col(k).data() + 3)); };
  return core::twist_angle(heading(c.keys() - 1) * heading(0).conjugate(), Vector3<double>{0, 0, 1});
}

bool upright(const motion::Clip& c) {
  for (int k = 0; k < c.keys(); ++k)
    if (Quaternion<double>::from(c.poses.col(k).data() + 3).rotate(Vector3<double>{0, 0, 1}).z < 0.5) return false;
  return true;
}

/// Mean distance of joints from their places half a cycle later, seen in a mirror; both in the frame below the root. m.
double half_cycle_misfit(const motion::Clip& c, const motion::Mirror& mirror) {
  const body::Skeleton& s = c.skeleton;
  body::Frames<double> a(s), b(s);
  double sum = 0;
  constexpr int samples = 20;
  for (int i = 0; i < samples; ++i) {
    const double phi = 0.5 * c.duration() * i / samples;
    Eigen::VectorXd here = c.sample(phi), there = mirror.pose(c.sample(phi + 0.5 * c.duration()));
    for (Eigen::VectorXd* q : {&here, &there}) motion::ground_frame(*q).inverse().apply_root(*q);
    body::forward_kinematics(s, here.data(), a);
    body::forward_kinematics(s, there.data(), b);
    for (std::size_t k = 0; k < a.position.size(); ++k) sum += norm(a.position[k] - b.position[k]);
  }
  return sum / (samples * s.size());
}

/// The half cycles of a gait are about mirror images. Of jumps and dances that end as they begin they are not.
constexpr double most_half_misfit = 0.12;

bool alternates(const motion::Clip& cycle) {
  return half_cycle_misfit(cycle, motion::Mirror(cycle.skeleton)) < most_half_misfit && std::abs(turn(cycle)) < 0.35;
}

/// A gait gets on: it travels, upright, from foot to foot, in cycles of two steps' length in time.
bool is_gait(const motion::Clip& cycle) {
  return travel(cycle) > 0.4 && upright(cycle) && cycle.duration() >= 0.4 && cycle.duration() <= 2.0 &&
         alternates(cycle);
}

/// What can be taken for one cycle of the clip: all of it if the file says so or its ends match, else the best interval
/// if that one's ends do. With `gaits` only what is one.
std::optional<motion::Clip> cycle_in(const motion::Clip& clip, bool gaits, std::vector<std::string>& notes) {
  if (clip.cyclic) return !gaits || is_gait(clip) ? std::optional(clip) : std::nullopt;
  // Of a gait one half is taken and closed, so that its whole need not end quite as it began.
  const motion::CycleLimits strict, lenient{0.3, 5.0, 1.0, 0.3};
  const auto closes = [&](const motion::CycleMisfit& m, const motion::CycleLimits& limits) {
    return m.position_m <= limits.position_m && m.velocity_m_s <= limits.velocity_m_s &&
           m.joint_rad <= limits.joint_rad && m.tilt_rad <= limits.tilt_rad;
  };
  motion::CycleSearch search;
  search.longest = 2.0;
  struct Interval {
    double from, to;
  };
  std::vector<Interval> candidates{{0, clip.duration()}};
  if (const auto found = motion::find_cycle(clip, search)) candidates.push_back({found->start, found->end});
  for (const bool gait : {true, false})
    for (const Interval& i : candidates) {
      const motion::CycleMisfit misfit = motion::cycle_misfit(clip, i.from, i.to);
      if ((gaits && !gait) || !closes(misfit, gait ? lenient : strict)) continue;
      const motion::Clip part = motion::cut(clip, i.from, i.to);
      if (gait && !is_gait(part)) continue;
      char text[120];
      std::snprintf(text, sizeof text, "a cycle from %.3f to %.3f s, its ends %.3f m apart", i.from, i.to,
                    misfit.position_m);
      notes.emplace_back(text);
      return part;
    }
  return std::nullopt;
}

void finish(Motion& m, const motion::Clip& clip, double seconds, const Scene& scene, const Effort& effort) {
  const auto points = control::tracked_points(scene.model, scene.roles);
  m.clip = clip;
  m.measured = control::make_reference(scene.model, scene.roles, points, clip, seconds, tick);
  m.reference = control::make_reference(scene.model, scene.roles, points, motion::smooth(clip, effort.smoothing_s),
                                        seconds, tick);
}

Motion once(motion::Clip clip, const Scene& scene, const Effort& effort) {
  Motion m;
  m.name = "open_loop";
  clip.cyclic = false;
  finish(m, clip, clip.duration(), scene, effort);
  return m;
}

Motion gait(const motion::Clip& cycle, const std::string& name, const Scene& scene, const Effort& effort,
            std::vector<std::string>& notes) {
  Motion m;
  m.name = name;
  m.cyclic = true;
  m.flies = cycle.contacts.cols() == cycle.keys() && motion::check_flight(cycle, scene.model.character).flights > 0;
  const motion::Mirror mirror(scene.model.character.skeleton);
  m.mirrored = alternates(cycle);
  char text[160];
  std::snprintf(text, sizeof text, "a cycle of %.3f s, its halves %.3f m from each other's mirror image: %s",
                cycle.duration(), half_cycle_misfit(cycle, mirror), m.mirrored ? "made symmetric" : "kept apart");
  notes.emplace_back(text);
  motion::Clip clip =
      m.mirrored ? motion::symmetrize_gait(cycle, mirror, motion::GaitHalf::first) : motion::close_cycle(cycle);
  const int parts = m.mirrored ? 2 : 1;
  m.period_ticks = std::max(12, static_cast<int>(std::lround(clip.duration() / parts / tick)));
  clip = motion::scale_duration(clip, m.period_ticks * parts * tick / clip.duration());
  const int windows = std::max(1, static_cast<int>(std::lround(m.period_ticks / 6.0)));
  for (int i = 0; i < windows; ++i)
    m.window_starts.push_back(static_cast<int>(std::lround(i * m.period_ticks / static_cast<double>(windows))));
  finish(m, clip, clip.duration() * std::max(3, static_cast<int>(std::ceil(effort.least_search_s / clip.duration()))),
         scene, effort);
  return m;
}

nlohmann::ordered_json retarget_json(const motion::RetargetReport& r) {
  return {{"rotations_copied", r.direct},
          {"scale", r.scale},
          {"ground_offset_m", r.ground_offset},
          {"foot_slide_before_m_s", r.foot_slide_before},
          {"foot_slide_after_m_s", r.foot_slide_after},
          {"foot_drift_after_m", r.foot_drift_after},
          {"penetration_before_m", r.penetration_before},
          {"penetration_after_m", r.penetration_after},
          {"direction_error_rad", r.direction_error},
          {"direction_error_max_rad", r.direction_error_max},
          {"limits_clipped", r.limits_clipped},
          {"limits_excess_rad", r.limits_excess},
          {"contact_share", r.contact_share},
          {"iterations", r.iterations},
          {"unmapped", r.unmapped},
          {"notes", r.notes}};
}

}  // namespace

Scene load_scene(const Options& o) {
  Scene s;
  s.model = example::read_model(o.character);
  s.roles = control::find_roles(s.model);
  s.character_text = example::read_file(o.character);
  if (!o.terrain.empty()) s.terrain = io::read_terrain(o.terrain);
  return s;
}

Preparation prepare(const Options& o, const Effort& effort, Scene& scene) {
  Preparation out;
  io::LoadOptions load;
  load.skeleton = o.skeleton;
  load.unit = o.unit;
  load.fps = o.fps;
  if (o.up != "detect") load.up = o.up == "x" ? io::UpAxis::x : o.up == "y" ? io::UpAxis::y : io::UpAxis::z;
  motion::RetargetOptions options;
  if (!o.joint_map.empty()) options.joints = motion::parse_joint_names(example::read_file(o.joint_map), o.joint_map.string());
  const io::LoadedClip loaded = example::load_clip(o.clip, load);
  out.loaded = loaded.report;
  std::printf("%s", loaded.report.text().c_str());
  if (loaded.terrain && !scene.terrain) {
    const io::TerrainHeights& t = *loaded.terrain;
    scene.terrain.emplace(t.heights, t.dx, t.min_point.x() - 0.5 * t.dx, t.min_point.y() - 0.5 * t.dx,
                          o.clip.string() + ": terrain");
  }
  // A clip on terrain belongs where it is.
  options.align = !scene.terrain;
  options.flat_ground = !scene.terrain || scene.terrain->is_flat();
  motion::Clip source = loaded.clip;
  if (const int dropped = motion::drop_repeats(source))
    out.notes.emplace_back(std::to_string(dropped) + " of " + std::to_string(loaded.clip.keys()) +
                           " keys repeat the one before: dropped");
  const auto put_on_character = [&] {
    const motion::Retargeted on_character = example::retarget(source, scene.model.character, options);
    out.retarget = retarget_json(on_character.report);
    out.clip = on_character.clip;
    std::printf("on '%s': %s", scene.model.character.name.c_str(), on_character.report.text().c_str());
    if (out.clip.contacts.cols() == out.clip.keys()) out.flight = motion::check_flight(out.clip, scene.model.character);
  };
  put_on_character();
  if (const double times = motion::played_too_fast(out.flight); times > 1 && !o.fps) {
    char text[160];
    std::snprintf(text, sizeof text,
                  "falls at %.0f m/s^2 in flight: taken to play %.0f times too fast (--fps %.6g keeps its rate)",
                  -out.flight.fall_acceleration_m_s2, times, loaded.report.fps);
    out.notes.emplace_back(text);
    source = motion::scale_duration(source, times);
    put_on_character();
  }

  const bool level = !scene.terrain || scene.terrain->is_flat();
  std::optional<motion::Clip> cycle;
  if (o.motion != "once" && level) cycle = cycle_in(out.clip, o.motion == "auto", out.notes);
  if (o.motion == "cyclic" && !cycle)
    throw Error(o.clip.string() +
                ": --motion cyclic: " + (level ? "no part of the clip ends as it begins" : "expected level ground"));
  if (!cycle) out.notes.emplace_back("no gait: done once");
  if (!cycle || !out.clip.cyclic) out.motions.push_back(once(out.clip, scene, effort));
  if (cycle) out.motions.push_back(gait(*cycle, out.motions.empty() ? "open_loop" : "cycle", scene, effort, out.notes));
  for (const std::string& note : out.notes) std::printf("motion: %s\n", note.c_str());
  return out;
}

std::string digest(const Scene& scene, const Preparation& p) {
  std::uint64_t h = 0xcbf29ce484222325u;  // FNV-1a
  const auto add = [&](const void* data, std::size_t bytes) {
    const auto* c = static_cast<const unsigned char*>(data);
    for (std::size_t i = 0; i < bytes; ++i) h = (h ^ c[i]) * 0x100000001b3u;
  };
  const auto add_matrix = [&](const Eigen::MatrixXd& m) {
    add(m.data(), static_cast<std::size_t>(m.size()) * sizeof(double));
  };
  add(scene.character_text.data(), scene.character_text.size());
  if (scene.terrain) add_matrix(scene.terrain->heights());
  for (const Motion& m : p.motions) {
    add_matrix(m.reference.poses);
    add_matrix(m.reference.velocities);
  }
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(h));
  return text;
}

}  // namespace perform
