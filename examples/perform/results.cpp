// SPDX-License-Identifier: MIT
#include "results.hpp"

#include <algorithm>

#include "traceur/core/version.hpp"
#include "traceur/io/clip_file.hpp"
#include "traceur/io/replay.hpp"

namespace perform {

using namespace traceur;
using namespace example;
using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

namespace {

std::string rounded(double x, int digits, const char* unit) { return example::rounded(x, digits) + " " + unit; }

}  // namespace

Report::Report(const Options& options, const Scene& scene) : options_(options) {
  check_writable(options.out, options.out / "replay.html");
  check_writable(options.report.parent_path(), options.report);
  Json arguments = job_arguments(options);
  arguments["out"] = options.out.string();
  arguments["report"] = options.report.string();
  arguments["threads"] = options.threads;
  arguments["resume"] = options.resume;
  json_ = Json{{"program", "perform"},
               {"version", core::version_string},
               {"arguments", arguments},
               {"clip", options.clip.filename().string()},
               {"character", scene.model.character.name},
               {"simulator", options.simulator},
               {"seed", options.seed},
               {"status", "failed"}};
  if (options.simulator != "bundled") facts_.emplace_back("simulator", options.simulator);
  facts_.emplace_back("character", scene.model.character.name + ", " + rounded(scene.model.total_mass, 1, "kg"));
}

void Report::add(const Preparation& p) {
  json_["clip_format"] = p.loaded.format;
  json_["clip_notes"] = p.loaded.notes;
  json_["duration_s"] = p.clip.duration();
  json_["cyclic"] = p.motions.back().cyclic;
  json_["motion_notes"] = p.notes;
  json_["retarget"] = p.retarget;
  if (p.flight.flights > 0) {
    const motion::FlightConsistency& f = p.flight;
    json_["flight_consistency"] = Json{{"flights", f.flights},
                                       {"flight_s", f.flight_s},
                                       {"fall_acceleration_m_s2", f.fall_acceleration_m_s2},
                                       {"horizontal_acceleration_rms_m_s2", f.horizontal_acceleration_rms_m_s2},
                                       {"horizontal_acceleration_max_m_s2", f.horizontal_acceleration_max_m_s2},
                                       {"vertical_error_rms_m_s2", f.vertical_error_rms_m_s2},
                                       {"ballistic_error_max_m", f.ballistic_error_max_m},
                                       {"angular_momentum_drift_kg_m2_s", f.angular_momentum_drift_kg_m2_s}};
  }
  facts_.emplace_back("clip", p.clip.name + ", " + rounded(p.clip.duration(), 2, "s"));
}

void Report::add(const OpenLoopResult& r) {
  json_["open_loop"] = Json{{"mean_joint_error_m", r.mean_joint_error_m},
                            {"mean_local_error_m", r.mean_local_error_m},
                            {"worst_tick_error_m", r.worst_tick_error_m},
                            {"fell", r.fell},
                            {"wall_s", r.wall_s},
                            {"simulated_s", r.simulated_s}};
  simulated_s_ += r.simulated_s;
  facts_.emplace_back("open loop, mean joint error", rounded(100 * r.mean_joint_error_m, 1, "cm"));
}

void Report::add_hardening(const Learned& l) {
  json_["robust"] = Json{{"generations", l.generations}, {"wall_s", l.wall_s}, {"simulated_s", l.simulated_s}};
  simulated_s_ += l.simulated_s;
  facts_.emplace_back("hardened in other worlds for", std::to_string(l.generations) + " generations");
}

void Report::add_fine_tuning(const Learned& l) {
  json_["fine_tuning"] = Json{{"generations", l.generations}, {"wall_s", l.wall_s}, {"simulated_s", l.simulated_s}};
  simulated_s_ += l.simulated_s;
  facts_.emplace_back("fine-tuned for", rounded(l.wall_s, 0, "s"));
}

void Report::add(const TrialResult& t, const Learned& l) {
  const bool cyclic = l.controller.cyclic;
  const Json survivors_only = t.survived > 0 ? Json(t.mean_joint_error_m) : Json(nullptr);
  json_["cyclic"] = cyclic;
  json_["closed_loop"] = Json{{"trials", t.trials},
                              {"survived", t.survived},
                              {"reached_end", cyclic ? Json(nullptr) : Json(t.reached_end)},
                              {"held", cyclic ? Json(nullptr) : Json(t.held)},
                              {"mean_joint_error_m", survivors_only},
                              {"mean_speed_m_s", t.survived > 0 ? Json(t.mean_speed_m_s) : Json(nullptr)},
                              {"clip_speed_m_s", t.clip_speed_m_s},
                              {"start_root_velocity_m_s", t.root_velocity_m_s},
                              {"start_joint_angle_rad", t.joint_angle_rad},
                              {"law_numbers", l.controller.shape.size()},
                              {"generations", l.generations},
                              {"went_on", l.persisted},
                              {"wall_s", l.wall_s},
                              {"simulated_s", l.simulated_s}};
  simulated_s_ += l.simulated_s + t.simulated_s;
  facts_.emplace_back("survived", std::to_string(t.survived) + " of " + std::to_string(t.trials) + " unseen starts");
  if (!cyclic) facts_.emplace_back("held the end pose", std::to_string(t.held) + " of " + std::to_string(t.trials));
  if (t.survived > 0)
    facts_.emplace_back("closed loop, mean joint error", rounded(100 * t.mean_joint_error_m, 1, "cm, root taken off"));
  if (cyclic)
    facts_.emplace_back("speed", rounded(t.mean_speed_m_s, 2, "m/s, ") + "clip " + rounded(t.clip_speed_m_s, 2, "m/s"));
  if (2 * t.survived < t.trials)
    failed_test_ = "the closed loop fell in " + std::to_string(t.trials - t.survived) + " of " + std::to_string(t.trials) + " trials";
}

void Report::add(const PushResult& r) {
  Json pushes;
  for (std::size_t d = 0; d < push_directions.size(); ++d) pushes[push_directions[d]] = r.tolerance_Ns[d];
  json_["push_Ns"] = pushes;
  simulated_s_ += r.simulated_s;
  const auto [least, most] = std::minmax_element(r.tolerance_Ns.begin(), r.tolerance_Ns.end());
  facts_.emplace_back("pushes survived", rounded(*least, 0, "to ") + rounded(*most, 0, "N s, by direction"));
}

void Report::add(const Recording& r) {
  const SlideShares& s = r.sole_slide;
  if (options_.simulator == "bundled") {
    json_["sole_slide_m_s"] = Json{{"slip", s.slip_m_s}, {"give", s.give_m_s}, {"drift", s.drift_m_s}, {"moved", s.moved_m_s}};
    facts_.emplace_back("loaded soles slip", rounded(100 * s.slip_m_s, 2, "cm/s"));
  } else {
    json_["sole_slide_m_s"] = Json{{"moved", s.moved_m_s}};
    facts_.emplace_back("loaded soles move", rounded(100 * s.moved_m_s, 2, "cm/s"));
  }
}

int Report::write(double wall_s, Ending ending) {
  json_["simulated_s"] = simulated_s_;
  if (ending.status == "done" && !failed_test_.empty()) ending = {"failed", failed_test_};
  return write_report(options_.report, json_, wall_s, ending);
}

void write_recording(const Options& options, const Scene& scene, const Recording& r, const Report& report) {
  const body::Skeleton& skeleton = scene.model.character.skeleton;
  io::write_clip(options.out / "motion.jsonl", r.clip);
  io::Replay replay;
  replay.title = r.clip.name;
  replay.facts = report.facts();
  replay.characters = {replay_character(scene.model.character)};
  io::ReplayTrack simulated, reference;
  simulated.name = "simulated";
  simulated.fps = static_cast<float>((r.clip.keys() - 1) / r.clip.duration());
  simulated.poses = replay_poses(skeleton, r.clip.poses);
  const auto triple = [](const core::Vector3<double>& v) {
    return std::array<float, 3>{static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z)};
  };
  bool any_push = false;
  for (std::size_t k = 0; k < r.contacts.size(); ++k) {
    std::vector<std::array<float, 6>>& frame = simulated.contacts.emplace_back();
    for (const Recording::Contact& c : r.contacts[k]) {
      const auto p = triple(c.point), f = triple(c.force);
      frame.push_back({p[0], p[1], p[2], f[0], f[1], f[2]});
    }
    const bool pushed = squared_norm(r.push_impulses[k]) > 0;
    any_push = any_push || pushed;
    for (const auto& v : {pushed ? r.push_points[k] : core::Vector3<double>{0, 0, 0}, r.push_impulses[k]})
      for (const float x : triple(v)) simulated.pushes.push_back(x);
  }
  if (!any_push) simulated.pushes.clear();
  reference.name = "clip";
  reference.ghost = true;
  reference.color = {0.85F, 0.6F, 0.3F};
  reference.fps = simulated.fps;
  reference.poses = replay_poses(skeleton, r.reference);
  replay.tracks = {simulated, reference};
  if (scene.terrain) replay.terrain = replay_terrain(*scene.terrain);
  io::write_replay(options.out / "replay.html", replay);
  std::printf("replay: %s\n", (options.out / "replay.html").string().c_str());
}

void write_open_loop(const Options& options, const Scene& scene, const Motion& motion, const SavedSearch& search) {
  motion::Clip clip;
  clip.name = motion.clip.name + ", open loop";
  clip.skeleton = scene.model.character.skeleton;
  clip.poses = search.result.poses;
  for (Eigen::Index k = 0; k < clip.poses.cols(); ++k) body::normalize(clip.skeleton, clip.poses.col(k).data());
  clip.times = Eigen::VectorXd::LinSpaced(clip.poses.cols(), 0,
                                          static_cast<double>(clip.poses.cols() - 1) * motion.reference.dt);
  io::write_clip(options.out / "open_loop.jsonl", clip);
}

}  // namespace perform
