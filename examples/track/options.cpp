// SPDX-License-Identifier: MIT
#include "options.hpp"

#include "../common/command_line.hpp"
#include "../common/results.hpp"
#include "../common/simulators.hpp"
#include "traceur/core/error.hpp"
#include "traceur/core/version.hpp"

namespace track {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;
using example::absolute_path;

namespace {

/// A policy may be shown on another simulator than it was learnt on.
void take_over(Options& o, const fs::path& path, bool simulator_given) {
  const Json saved = example::saved_arguments(path, "track");
  try {
    if (o.clips.empty())
      for (const Json& clip : saved.at("clips")) o.clips.emplace_back(clip.get<std::string>());
    if (o.character.empty()) o.character = saved.at("character").get<std::string>();
    o.task = saved.value("task", o.task);
    o.reward = saved.value("reward", o.reward);
    o.priority_floor = saved.value("priority_floor", o.priority_floor);
    o.slowest = saved.value("slowest_m_s", o.slowest);
    o.fastest = saved.value("fastest_m_s", o.fastest);
    if (!simulator_given) o.simulator = saved.value("simulator", o.simulator);
    o.samples = saved.at("samples").get<double>();
    o.seed = saved.at("seed").get<std::uint64_t>();
    o.quick = o.quick || saved.at("quick").get<bool>();
  } catch (const Json::exception&) {
    throw example::not_written_by(path, "track");
  }
}

}  // namespace

Json job_arguments(const Options& o) {
  Json clips = Json::array();
  for (const fs::path& clip : o.clips) clips.push_back(clip.string());
  return Json{{"clips", clips},   {"character", o.character.string()},
              {"task", o.task}, {"reward", o.reward},
              {"priority_floor", o.priority_floor}, {"simulator", o.simulator}, {"slowest_m_s", o.slowest}, {"fastest_m_s", o.fastest},
              {"samples", o.samples}, {"seed", o.seed},
              {"quick", o.quick}};
}

std::optional<Options> read_options(int argc, char** argv) {
  Options o;
  fs::path resume;
  CLI::App app(
      "track learns a policy with which a simulated character tracks motion clips, or moves at any wanted speed in their\n"
      "style: proximal policy optimisation on a tracking reward, or beside adversarial imitation. It tests the policy and\n"
      "writes a replay and learning curves.",
      "track");
  app.set_version_flag("--version", std::string(traceur::core::version_string));
  app.add_option("CLIP", o.clips, "motions: BVH, AMC, DeepMimic, AMP or PARC JSON, or our own .jsonl")->type_name("FILE...");
  app.add_option("--character", o.character, "body to simulate, MJCF (default: the examples' humanoid)");
  app.add_option("--out", o.out, "folder for policy.safetensors, checkpoint.safetensors, replay.html, curves.html");
  app.add_option("--report", o.report, "report file, JSON (default: report.json in the --out folder)");
  app.add_option("--task", o.task, "track the clips (default), or speed: move as fast as asked, in their style (AMP)")
      ->check(CLI::IsMember({"track", "speed"}));
  app.add_option("--reward", o.reward, "of tracking: deepmimic (default), parc or hil")->check(CLI::IsMember({"deepmimic", "parc", "hil"}));
  app.add_option("--priority-floor", o.priority_floor,
                 "episodes begin more often where they fail, but nowhere less than this share of where they always do\n"
                 "(default 0.01; 1: everywhere alike)")
      ->check(CLI::Range(1e-6, 1.0));
  app.add_option("--simulator", o.simulator, "what to learn or show it on: bundled (default), mujoco, dart, ode or bullet");
  app.add_option("--slowest", o.slowest, "speed that the speed task asks for at least, m/s (default 1)")->check(CLI::NonNegativeNumber);
  app.add_option("--fastest", o.fastest, "and at most (default 4)")->check(CLI::PositiveNumber);
  app.add_option("--samples", o.samples, "control steps to learn from (default 8e6, of several clips 8e6 for each; speed 3e7)")
      ->check(CLI::PositiveNumber);
  app.add_option("--minutes", o.minutes, "stop learning early after so much wall time (default: no limit)")
      ->check(CLI::PositiveNumber);
  app.add_option("--seed", o.seed, "of all random numbers (default 1)");
  app.add_option("--threads", o.threads, "number of threads, 0 for all (default); results do not depend on it")
      ->check(CLI::Range(0, 1024));
  app.add_option("--resume", resume, "continue the interrupted job in this folder");
  app.add_option("--play", o.play, "test and show this policy instead of learning one");
  app.add_flag("--quick", o.quick, "a run of under a minute, with less effort and poorer results");
  if (!example::parse(app, argc, argv)) return std::nullopt;
  for (fs::path* p : {&o.character, &o.out, &o.report, &o.play, &resume}) *p = absolute_path(*p);
  for (fs::path& p : o.clips) p = absolute_path(p);
  o.resume = !resume.empty();
  if (o.resume && !o.play.empty()) throw traceur::Error("--resume and --play: expected one of them");
  if (o.resume) {
    if (!o.clips.empty() || app.count("--out") + app.count("--samples") + app.count("--seed") + app.count("--quick") + app.count("--task") +
                                app.count("--reward") + app.count("--slowest") + app.count("--fastest") + app.count("--simulator") + app.count("--priority-floor") > 0)
      throw traceur::Error("--resume: the job knows its clips, task, samples, seed and folder; leave them out");
    o.out = resume;
    take_over(o, o.out / "checkpoint.safetensors", false);
  }
  if (!o.play.empty()) take_over(o, o.play, app.count("--simulator") > 0);
  if (o.character.empty()) o.character = absolute_path(example::default_character());
  if (o.clips.empty()) throw traceur::Error("expected a CLIP (--help lists the options)");
  if (o.out.empty()) throw traceur::Error("expected --out DIR (--help lists the options)");
  if (o.report.empty()) o.report = o.out / "report.json";
  example::find_simulator(o.simulator);
  if (o.fastest < o.slowest) throw traceur::Error("--fastest: expected no less than --slowest");
  if (o.samples <= 0) o.samples = o.quick ? 2.5e5 : o.task == "speed" ? 3e7 : 8e6 * static_cast<double>(o.clips.size());
  return o;
}

}  // namespace track
