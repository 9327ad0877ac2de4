// SPDX-License-Identifier: MIT
//
// A policy learns to track motion clips in simulation (Peng et al. 2018, "DeepMimic").
//
//   clips ─ retarget ─ reference ─┬─ environments ─ rollout ─ advantages ─ PPO ─┐
//                                 │        └────────── policy ─────────────────┘
//                                 └─ test of the mean action ─ replay, curves
//
#include "../common/plot.hpp"
#include "../common/progress.hpp"
#include "../common/results.hpp"
#include "options.hpp"
#include "traceur/core/error.hpp"
#include "traceur/core/version.hpp"
#include "traceur/io/atomic_file.hpp"
#include "traceur/io/policy_file.hpp"
#include "trainer.hpp"

namespace {

using namespace track;
using namespace traceur;
using Json = nlohmann::ordered_json;

Json to_json(const Evaluation& e) {
  return Json{{"normalized_return", e.normalized_return}, {"episodes", e.episodes}, {"completed", e.completed},
              {"fell", e.falls},                          {"drifted", e.drifts},    {"failed", e.failures},
              {"mean_joint_error_m", e.joint_error_m},    {"mean_episode_s", e.seconds}};
}

std::string rounded(double x, int digits) {
  char text[32];
  std::snprintf(text, sizeof text, "%.*f", digits, x);
  return text;
}

void write_curves(const Options& o, const Training& t, const std::vector<std::pair<std::string, std::string>>& facts) {
  example::Curve value{"return of the mean action", {}}, length{"episode", {}}, divergence{"divergence", {}},
      variance{"explained variance", {}}, rate{"rate", {}};
  for (const Milestone& m : t.milestones) {
    const double x = m.samples / 1e6;
    value.points.emplace_back(x, m.normalized_return);
    length.points.emplace_back(x, m.episode_s);
    divergence.points.emplace_back(x, m.divergence);
    variance.points.emplace_back(x, m.explained_variance);
    rate.points.emplace_back(x, m.policy_rate);
  }
  const std::string x = "million samples";
  io::write_atomically(o.out / "curves.html",
                       example::plot_page("Learning curves", facts,
                                          {example::plot("normalised return of the mean action", x, {value}),
                                           example::plot("episode length in training, s", x, {length}),
                                           example::plot("divergence (KL) of an update", x, {divergence}),
                                           example::plot("explained variance of returns", x, {variance}),
                                           example::plot("learning rate of the policy", x, {rate})}));
}

void write_replay(const Options& o, const Scene& scene, learn::Policy<float>& policy, int motion,
                  const std::vector<std::pair<std::string, std::string>>& facts) {
  const Recording r = record(scene, policy, motion);
  const body::Skeleton& skeleton = scene.model.character.skeleton;
  io::Replay replay;
  replay.title = scene.motions[static_cast<std::size_t>(motion)].name;
  replay.facts = facts;
  replay.characters = {example::replay_character(scene.model.character)};
  io::ReplayTrack simulated, reference;
  simulated.name = "simulated";
  simulated.fps = reference.fps = static_cast<float>(1 / r.tick);
  simulated.poses = example::replay_poses(skeleton, r.poses);
  for (const auto& contacts : r.contacts) {
    auto& frame = simulated.contacts.emplace_back();
    for (const Recording::Contact& c : contacts)
      frame.push_back({static_cast<float>(c.point.x), static_cast<float>(c.point.y), static_cast<float>(c.point.z),
                       static_cast<float>(c.force.x), static_cast<float>(c.force.y), static_cast<float>(c.force.z)});
  }
  reference.name = "clip";
  reference.ghost = true;
  reference.color = {0.85F, 0.6F, 0.3F};
  reference.poses = example::replay_poses(skeleton, r.references);
  replay.tracks = {simulated, reference};
  const auto path = o.out / (scene.motions.size() == 1 ? "replay.html" : "replay_" + std::to_string(motion + 1) + ".html");
  io::write_replay(path, replay);
  std::printf("replay: %s\n", path.string().c_str());
}

/// Tests and shows a policy; puts what it finds into the report. Returns whether it tracks at all.
bool judge(const Options& o, const Scene& scene, learn::Policy<float>& policy, Json& report,
           std::vector<std::pair<std::string, std::string>>& facts) {
  constexpr int trials = 100;
  const auto spread = test(scene, o, policy, learn::TrackingStart::spread, o.quick ? 16 : trials);
  const auto begin = test(scene, o, policy, learn::TrackingStart::begin, 1);
  Json clips = Json::array();
  bool tracks = true;
  for (std::size_t m = 0; m < scene.motions.size(); ++m) {
    Json clip{{"clip", scene.motions[m].name}, {"duration_s", scene.motions[m].ticks * scene.motions[m].tick},
              {"cyclic", scene.motions[m].cyclic}};
    clip.update(to_json(spread[m]));
    clip["from_begin"] = to_json(begin[m]);
    clips.push_back(clip);
    const std::string text = "return " + rounded(spread[m].normalized_return, 3) + ", " + std::to_string(spread[m].completed) +
                             " of " + std::to_string(spread[m].episodes) + " episodes completed, joints off by " +
                             rounded(100 * spread[m].joint_error_m, 1) + " cm";
    facts.emplace_back(scene.motions[m].name, text);
    std::printf("%s: %s\n", scene.motions[m].name.c_str(), text.c_str());
    tracks = tracks && 2 * spread[m].completed >= spread[m].episodes;
  }
  report["clips"] = clips;
  if (scene.motions.size() == 1) report.update(to_json(spread[0]));
  return tracks;
}

int run(const Options& o) {
  example::listen_for_interruption();
  const example::Clock clock;
  const Scene scene = load_scene(o);
  example::check_writable(o.out, o.report);
  Json report{{"program", "track"}, {"version", core::version_string}, {"arguments", job_arguments(o)}, {"seed", o.seed}};
  std::string status = "done", why;
  try {
    std::vector<std::pair<std::string, std::string>> facts;
    Training training;
    if (o.play.empty()) {
      training = train(scene, o);
      report["samples"] = training.samples;
      report["learning_wall_s"] = training.wall_s;
      report["samples_per_s"] = training.wall_s > 0 ? training.samples / training.wall_s : 0.0;
      report["warnings"] = training.warnings;
      facts.emplace_back("samples", rounded(training.samples / 1e6, 2) + " million in " + rounded(training.wall_s, 0) + " s");
    }
    learn::Policy<float> policy = io::read_policy(o.play.empty() ? o.out / "policy.safetensors" : o.play);
    if (!judge(o, scene, policy, report, facts)) {
      status = "failed";
      why = "the policy does not track: more than half of the episodes of a clip ended early";
    }
    for (std::size_t m = 0; m < scene.motions.size(); ++m) write_replay(o, scene, policy, static_cast<int>(m), facts);
    if (o.play.empty()) write_curves(o, training, facts);
  } catch (const example::Interrupted&) {
    status = "interrupted";
    why = "go on with: track --resume " + o.out.string();
  } catch (const std::exception& e) {
    status = "failed";
    why = e.what();
  }
  report["wall_s"] = clock.seconds();
  report["status"] = status;
  if (!why.empty()) report["why"] = why;
  io::write_atomically(o.report, report.dump(2) + "\n");
  std::printf("%s%s\nreport: %s\n", status.c_str(), why.empty() ? "" : (": " + why).c_str(), o.report.string().c_str());
  return status == "done" ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    const auto options = read_options(argc, argv);
    return options ? run(*options) : 0;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "track: %s\n", e.what());
    return 2;
  }
}
