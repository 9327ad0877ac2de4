// SPDX-License-Identifier: MIT
//
// A motion generator learns from clips and moves a character over terrain they were not made for: the kinematic half of
// PARC (Xu et al. 2025).
//
//   clips ─ retarget, mirror ─┬─ windows on augmented terrain ─ denoising loss ─ Adam ─┐
//                             │                                     └── network ───────┤
//   fresh terrain ─ graph ─ A* path ─────────── windows along the path, a batch ───────┘
//                                                     └─ select ─ cut hesitation ─ correct ─ replay
//
#include <cstdio>

#include "../common/command_line.hpp"
#include "../common/plot.hpp"
#include "../common/progress.hpp"
#include "../common/results.hpp"
#include "generator.hpp"
#include "options.hpp"
#include "traceur/core/error.hpp"
#include "traceur/core/version.hpp"
#include "traceur/io/atomic_file.hpp"
#include "traceur/io/clip_file.hpp"
#include "traceur/io/terrain_file.hpp"

namespace {

using namespace generate;
using namespace traceur;
using example::rounded;
using Json = nlohmann::ordered_json;
using Facts = std::vector<std::pair<std::string, std::string>>;

Json to_json(const Quality& q) {
  return Json{{"duration_s", q.seconds},
              {"penetration_per_frame_m", q.penetration_m},
              {"contact_per_frame_m", q.contact_m},
              {"high_jerk_share", q.high_jerk_share},
              {"foot_slide_m_s", q.foot_slide_m_s},
              {"end_distance_m", q.end_distance_m}};
}

std::string words(const Quality& q) {
  return "penetration " + rounded(100 * q.penetration_m, 2) + " cm and contact " + rounded(100 * q.contact_m, 2) +
         " cm a frame, feet slide " + rounded(100 * q.foot_slide_m_s, 1) + " cm/s, " + rounded(100 * q.high_jerk_share, 1) +
         " % of frames of high jerk";
}

void write_replay(const std::filesystem::path& path, const Scene& scene, const Course& course, const Generated& g,
                  const Facts& facts) {
  io::Replay replay;
  replay.title = "Generated along a path";
  replay.facts = facts;
  replay.characters = {example::replay_character(scene.character)};
  const body::Skeleton& skeleton = scene.character.skeleton;
  io::ReplayTrack corrected, raw;
  corrected.name = "corrected";
  raw.name = "generated";
  raw.ghost = true;
  raw.color = {0.85F, 0.6F, 0.3F};
  corrected.poses = example::replay_poses(skeleton, g.corrected.poses);
  raw.poses = example::replay_poses(skeleton, g.best.poses);
  replay.tracks = {corrected, raw};
  replay.terrain = example::replay_terrain(course.ground);
  io::write_replay(path, replay);
  std::printf("replay: %s\n", path.string().c_str());
}

void write_curves(const std::filesystem::path& path, const Training& t, const Facts& facts) {
  example::Curve loss{"loss", {}};
  for (const Milestone& m : t.milestones) loss.points.emplace_back(m.step, m.loss);
  io::write_atomically(path, example::plot_page("Training", facts, {example::plot("loss of a window", "steps", {loss})}));
}

void work(const Options& o, const Scene& scene, Json& report) {
  Facts facts;
  Training training;
  if (o.play.empty()) {
    training = train(scene, o);
    report["steps"] = training.steps;
    report["parameters"] = training.parameters;
    report["training_wall_s"] = training.wall_s;
    if (!training.milestones.empty()) report["loss"] = training.milestones.back().loss;
    facts.emplace_back("training", std::to_string(training.steps) + " steps in " + rounded(training.wall_s, 0) + " s");
  }
  const Course course = make_course(o);
  io::write_terrain(o.out / "terrain.json", course.ground);
  const std::filesystem::path generator = o.play.empty() ? o.out / "generator.safetensors" : o.play;
  const Generated g = generate_along(scene, o, course, generator);
  io::write_clip(o.out / "motion.jsonl", g.corrected);
  Json path = Json::array();
  for (const auto& node : course.path) path.push_back({node.x, node.y, node.z});
  const Quality clips = quality_of(scene);
  report["path_m"] = path;
  report["motions"] = g.motions;
  report["arrived"] = g.arrived;
  report["not_finite"] = g.not_finite;
  report["generation_wall_s"] = g.generation_wall_s;
  report["correction_wall_s"] = g.correction_wall_s;
  report["correction_iterations"] = g.correction_iterations;
  report["hesitating_frames_cut"] = g.cut_frames;
  report["clips"] = to_json(clips);
  report["generated"] = to_json(g.best_quality);
  report["corrected"] = to_json(g.corrected_quality);
  const WindowsQuality windows = quality_of_windows(scene, o, generator);
  report["windows"] = {{"count", windows.count}, {"generated", to_json(windows.generated)}, {"clips", to_json(windows.clips)}};
  report["windows"]["generated"]["fk_gap_m"] = windows.generated_fk_gap_m;
  report["windows"]["clips"]["fk_gap_m"] = windows.clips_fk_gap_m;
  report["simulated_s"] = g.corrected_quality.seconds;
  facts.emplace_back("motions", std::to_string(g.arrived) + " of " + std::to_string(g.motions) + " came to the end of the path");
  facts.emplace_back("clips", words(clips));
  facts.emplace_back("generated", words(g.best_quality));
  facts.emplace_back("corrected", words(g.corrected_quality));
  facts.emplace_back("windows", std::to_string(windows.count) + " generated: joints " + rounded(1000 * windows.generated_fk_gap_m, 1) +
                                    " mm off their rotations', " + words(windows.generated));
  facts.emplace_back("windows of clips", words(windows.clips));
  facts.emplace_back("time", rounded(g.generation_wall_s, 2) + " s to generate, " + rounded(g.correction_wall_s, 2) + " s to correct");
  for (const auto& [name, text] : facts) std::printf("%s: %s\n", name.c_str(), text.c_str());
  write_replay(o.out / "replay.html", scene, course, g, facts);
  if (o.play.empty()) write_curves(o.out / "curves.html", training, facts);
}

int run(const Options& o) {
  example::listen_for_interruption();
  const example::Clock clock;
  const Scene scene = load_scene(o);
  example::check_writable(o.out, o.report);
  Json report{{"program", "generate"}, {"version", core::version_string}, {"arguments", job_arguments(o)}, {"seed", o.seed}};
  const example::Ending ending = example::ending_of("generate --resume " + o.out.string(), [&] { work(o, scene, report); });
  return example::write_report(o.report, report, clock.seconds(), ending);
}

}  // namespace

int main(int argc, char** argv) { return example::main_of("generate", argc, argv, generate::read_options, run); }
