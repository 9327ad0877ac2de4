// SPDX-License-Identifier: MIT
//
// A policy learns to track motion clips in simulation (Peng et al. 2018, "DeepMimic"), or to move at any wanted speed in their
// style (Peng et al. 2021, "AMP").
//
//   clips ─ retarget ─ reference ─┬─ environments ─ rollout ─ advantages ─ PPO ─┐
//                                 │        └────────── policy ─────────────────┘
//                                 └─ test of the mean action ─ replay, curves
//
// Of the speed task the clips are where episodes begin, and what a discriminator compares the policy's motion with; its doubt
// is the style reward, added to what a rollout earned before advantages are taken.
//
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <thread>

#include "../common/command_line.hpp"
#include "../common/files.hpp"
#include "../common/plot.hpp"
#include "../common/progress.hpp"
#include "../common/results.hpp"
#include "options.hpp"
#include "processes.hpp"
#include "speed.hpp"
#include "traceur/core/error.hpp"
#include "traceur/core/version.hpp"
#include "traceur/io/atomic_file.hpp"
#include "traceur/io/policy_file.hpp"
#include "trainer.hpp"

namespace {

using namespace track;
using namespace traceur;
using example::rounded;
using Json = nlohmann::ordered_json;
using Facts = std::vector<std::pair<std::string, std::string>>;
namespace fs = std::filesystem;

Json to_json(const Evaluation& e) {
  return Json{{"normalized_return", e.normalized_return}, {"episodes", e.episodes}, {"completed", e.completed},
              {"fell", e.falls},                          {"drifted", e.drifts},    {"failed", e.failures},
              {"mean_joint_error_m", e.joint_error_m},    {"mean_episode_s", e.seconds}};
}

void write_curves(const Options& o, const Training& t, const Facts& facts) {
  example::Curve value{"all over", {}}, begin{"from the begin", {}}, length{"episode", {}}, divergence{"divergence", {}},
      variance{"explained variance", {}}, rate{"rate", {}};
  for (const Milestone& m : t.milestones) {
    const double x = m.samples / 1e6;
    value.points.emplace_back(x, m.normalized_return);
    begin.points.emplace_back(x, m.from_begin);
    length.points.emplace_back(x, m.episode_s);
    divergence.points.emplace_back(x, m.divergence);
    variance.points.emplace_back(x, m.explained_variance);
    rate.points.emplace_back(x, m.policy_rate);
  }
  const std::string x = "million samples";
  io::write_atomically(o.out / "curves.html",
                       example::plot_page("Learning curves", facts,
                                          {example::plot("normalised return of the mean action", x, {value, begin}),
                                           example::plot("episode length in training, s", x, {length}),
                                           example::plot("divergence (KL) of an update", x, {divergence}),
                                           example::plot("explained variance of returns", x, {variance}),
                                           example::plot("learning rate of the policy", x, {rate})}));
}

void write_replay(const fs::path& path, const std::string& title, const Scene& scene, const Recording& r,
                  const Facts& facts) {
  const body::Skeleton& skeleton = scene.model.character.skeleton;
  io::Replay replay;
  replay.title = title;
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
  replay.tracks = {simulated};
  if (r.references.cols() > 0) {
    reference.name = "clip";
    reference.ghost = true;
    reference.color = {0.85F, 0.6F, 0.3F};
    reference.poses = example::replay_poses(skeleton, r.references);
    replay.tracks.push_back(reference);
  }
  io::write_replay(path, replay);
  std::printf("replay: %s\n", path.string().c_str());
}

/// Tests and shows a policy; puts what it finds into the report. Returns whether it tracks at all.
bool judge(const Options& o, const Scene& scene, learn::Policy<float>& policy, Json& report,
           Facts& facts) {
  constexpr double usual_s = 20, long_s = 60;
  const int trials = o.quick ? 16 : 100;
  const auto spread = test(scene, o, policy, learn::TrackingStart::spread, trials, usual_s);
  const auto begin = test(scene, o, policy, learn::TrackingStart::begin, 1, usual_s);
  // Engines take minutes for what the bundled simulator does in seconds.
  const bool cycles = !o.quick && o.simulator == "bundled" && std::any_of(scene.motions.begin(), scene.motions.end(), [](const auto& m) { return m.cyclic; });
  const auto lasting = cycles ? test(scene, o, policy, learn::TrackingStart::spread, trials, long_s) : std::vector<Evaluation>{};
  Json clips = Json::array();
  bool tracks = true;
  for (std::size_t m = 0; m < scene.motions.size(); ++m) {
    Json clip{{"clip", scene.motions[m].name}, {"duration_s", scene.motions[m].ticks * scene.motions[m].tick},
              {"cyclic", scene.motions[m].cyclic}};
    clip.update(to_json(spread[m]));
    clip["from_begin"] = to_json(begin[m]);
    if (cycles && scene.motions[m].cyclic) clip["for_60_s"] = to_json(lasting[m]);
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

Json to_json(const learn::SpeedBand& band) {
  const learn::LocomotionEvaluation& e = band.result;
  return Json{{"slowest_m_s", band.slowest},           {"fastest_m_s", band.fastest},
              {"episodes", e.episodes},                {"completed", e.completed},
              {"fell", e.falls},                       {"failed", e.failures},
              {"speed_error_m_s", e.speed_error_m_s},  {"greatest_speed_error_m_s", e.greatest_error_m_s},
              {"normalized_return", e.normalized_return}, {"mean_episode_s", e.seconds}};
}

/// The same for a policy of the speed task.
bool judge_speed(const Options& o, const Scene& scene, learn::Policy<float>& policy, Json& report, Facts& facts) {
  const auto bands = test_speed(scene, o, policy, o.quick ? 16 : 100);
  Json all = to_json(bands[0]), parts = Json::array();
  for (std::size_t b = 1; b < bands.size(); ++b) parts.push_back(to_json(bands[b]));
  report.update(all);
  report["bands"] = parts;
  const learn::LocomotionEvaluation& e = bands[0].result;
  const std::string text = "speed off by " + rounded(e.speed_error_m_s, 3) + " m/s, " + std::to_string(e.completed) + " of " +
                           std::to_string(e.episodes) + " episodes completed";
  facts.emplace_back("wanted " + rounded(o.slowest, 1) + " to " + rounded(o.fastest, 1) + " m/s", text);
  std::printf("%s\n", text.c_str());
  return 2 * e.completed >= e.episodes;
}

void write_speed_curves(const Options& o, const SpeedTraining& t, const Facts& facts) {
  using Points = std::vector<std::pair<double, double>>;
  const auto of = [&](double SpeedMilestone::*x) {
    Points points;
    for (const SpeedMilestone& m : t.milestones) points.emplace_back(m.samples / 1e6, m.*x);
    return points;
  };
  const std::string x = "million samples";
  io::write_atomically(
      o.out / "curves.html",
      example::plot_page(
          "Learning curves", facts,
          {example::plot("the mean action's task reward", x, {{"score", of(&SpeedMilestone::score)}}),
           example::plot("speed's error, m/s", x, {{"error", of(&SpeedMilestone::speed_error)}}),
           example::plot("share of tests without a fall", x, {{"completed", of(&SpeedMilestone::completed)}}),
           example::plot("the discriminator's accuracy", x,
                         {{"real", of(&SpeedMilestone::real_accuracy)}, {"own", of(&SpeedMilestone::fake_accuracy)}}),
           example::plot("rewards of a step in training", x,
                         {{"style", of(&SpeedMilestone::style_reward)}, {"task", of(&SpeedMilestone::task_reward)}}),
           example::plot("episode length in training, s", x, {{"episode", of(&SpeedMilestone::episode_s)}}),
           example::plot("divergence (KL) of an update", x, {{"divergence", of(&SpeedMilestone::divergence)}}),
           example::plot("explained variance of returns", x, {{"explained variance", of(&SpeedMilestone::explained_variance)}}),
           example::plot("learning rate of the policy", x, {{"rate", of(&SpeedMilestone::policy_rate)}})}));
}

/// What a run was, and how fast.
template <class T>
void tell_training(const T& training, Json& report, Facts& facts) {
  report["samples"] = training.samples;
  report["learning_wall_s"] = training.wall_s;
  report["samples_per_s"] = training.wall_s > 0 ? training.samples / training.wall_s : 0.0;
  report["warnings"] = training.warnings;
  facts.emplace_back("samples", rounded(training.samples / 1e6, 2) + " million in " + rounded(training.wall_s, 0) + " s");
}

void do_tracking(const Options& o, const Scene& scene, learn::ProcessGroup& processes, Json& report, std::string& why) {
  Facts facts;
  Training training;
  if (o.play.empty()) training = train(scene, o, processes);
  // What is left to do is the first process's.
  if (processes.rank() > 0) return;
  if (o.play.empty()) tell_training(training, report, facts);
  learn::Policy<float> policy = io::get_policy(example::read_tensors(o.play.empty() ? o.out / "policy.safetensors" : o.play));
  if (!judge(o, scene, policy, report, facts)) why = "the policy does not track: more than half of the episodes of a clip ended early";
  for (std::size_t m = 0; m < scene.motions.size(); ++m)
    write_replay(o.out / (scene.motions.size() == 1 ? "replay.html" : "replay_" + std::to_string(m + 1) + ".html"), scene.motions[m].name,
                 scene, record(scene, o, policy, static_cast<int>(m)), facts);
  if (o.play.empty()) write_curves(o, training, facts);
}

void do_speed(const Options& o, const Scene& scene, learn::ProcessGroup& processes, Json& report, std::string& why) {
  Facts facts;
  SpeedTraining training;
  if (o.play.empty()) training = train_speed(scene, o, processes);
  if (processes.rank() > 0) return;
  if (o.play.empty()) {
    tell_training(training, report, facts);
    Json curve = Json::array();
    for (const SpeedMilestone& m : training.milestones)
      curve.push_back(Json{{"samples", m.samples}, {"real_accuracy", m.real_accuracy}, {"fake_accuracy", m.fake_accuracy}});
    report["discriminator"] = curve;
  }
  learn::Policy<float> policy = io::get_policy(example::read_tensors(o.play.empty() ? o.out / "policy.safetensors" : o.play));
  if (!judge_speed(o, scene, policy, report, facts)) why = "the policy does not move about: more than half of the episodes ended early";
  write_replay(o.out / "replay.html", "as fast as asked", scene, record_speed(scene, o, policy), facts);
  if (o.play.empty()) write_speed_curves(o, training, facts);
}

int run(const Options& o) {
  example::listen_for_interruption();
  const example::Clock clock;
  const auto processes = find_processes();
  const bool first = processes->rank() == 0;
  if (!first && std::freopen("/dev/null", "w", stdout) == nullptr) return 1;
  const Scene scene = load_scene(o);
  if (first) example::check_writable(o.out, o.report);
  Json report{{"program", "track"}, {"version", core::version_string}, {"arguments", job_arguments(o)}, {"seed", o.seed}};
  bool fault = false;
  example::Ending ending = example::ending_of("track --resume " + o.out.string(), [&] {
    std::string why;
    try {
      if (o.task == "speed") {
        do_speed(o, scene, *processes, report, why);
      } else {
        do_tracking(o, scene, *processes, report, why);
      }
    } catch (const std::exception& e) {
      fault = true;
      // The others may wait for this process for ever. What all of them met is reported by the first, given the time.
      if (!first) {
        std::fprintf(stderr, "track: process %d: %s\n", processes->rank(), e.what());
        std::this_thread::sleep_for(std::chrono::seconds(5));
        processes->abort(1);
      }
      throw;
    }
    if (!why.empty()) throw Error(why);
  });
  if (!first) return ending.status == "done" ? 0 : 1;
  const int status = example::write_report(o.report, report, clock.seconds(), ending);
  if (fault && processes->size() > 1) processes->abort(1);
  return status;
}

}  // namespace

int main(int argc, char** argv) { return example::main_of("track", argc, argv, track::read_options, run); }
