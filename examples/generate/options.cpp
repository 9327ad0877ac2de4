// SPDX-License-Identifier: MIT
#include "options.hpp"

#include "../common/command_line.hpp"
#include "../common/results.hpp"
#include "traceur/core/error.hpp"
#include "traceur/core/version.hpp"

namespace generate {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;
using example::absolute_path;

namespace {

/// Takes what a generator was made with, and of a whole job the rest too.
void take_over(Options& o, const fs::path& path, bool whole) {
  const Json saved = example::saved_arguments(path, "generate");
  try {
    if (o.clips.empty())
      for (const Json& clip : saved.at("clips")) o.clips.emplace_back(clip.get<std::string>());
    if (o.character.empty()) o.character = saved.at("character").get<std::string>();
    o.size = saved.at("size").get<std::string>();
    if (!whole) return;
    o.terrain = saved.at("terrain").get<std::string>();
    o.relief = saved.at("relief_m").get<double>();
    o.steps = saved.at("steps").get<int>();
    o.batch = saved.at("batch").get<int>();
    o.seconds = saved.at("seconds").get<double>();
    o.seed = saved.at("seed").get<std::uint64_t>();
    o.quick = saved.at("quick").get<bool>();
  } catch (const Json::exception&) {
    throw example::not_written_by(path, "generate");
  }
}

}  // namespace

Json job_arguments(const Options& o) {
  Json clips = Json::array();
  for (const fs::path& clip : o.clips) clips.push_back(clip.string());
  return Json{{"clips", clips},         {"character", o.character.string()},
              {"size", o.size},         {"terrain", o.terrain},
              {"relief_m", o.relief},   {"steps", o.steps},
              {"batch", o.batch},       {"seconds", o.seconds},
              {"seed", o.seed},         {"quick", o.quick}};
}

std::optional<Options> read_options(int argc, char** argv) {
  Options o;
  fs::path resume;
  CLI::App app(
      "generate trains a motion generator on clips, plans a path over a terrain it has not seen, generates motions along it,\n"
      "corrects the best and writes a replay: the kinematic half of PARC (Xu et al. 2025).",
      "generate");
  app.set_version_flag("--version", std::string(traceur::core::version_string));
  app.add_option("CLIP", o.clips, "motions: BVH, AMC, DeepMimic, AMP or PARC JSON (with its terrain), or our own .jsonl")
      ->type_name("FILE...");
  app.add_option("--character", o.character, "body to move, MJCF (default: the examples' humanoid)");
  app.add_option("--out", o.out, "folder for generator.safetensors, checkpoint.safetensors, replay.html, motion.jsonl, ...");
  app.add_option("--report", o.report, "report file, JSON (default: report.json in the --out folder)");
  app.add_option("--size", o.size, "of the network: paper (default) or small")->check(CLI::IsMember({"paper", "small"}));
  app.add_option("--terrain", o.terrain, "to move over: boxes (default), walks or stairs")
      ->check(CLI::IsMember({"boxes", "walks", "stairs"}));
  app.add_option("--relief", o.relief, "m, boxes and walks rise and sink by up to this (default 0.4; PARC 2)")
      ->check(CLI::Range(0.0, 5.0));
  app.add_option("--steps", o.steps, "of training, 32 windows each (default 8000)")->check(CLI::PositiveNumber);
  app.add_option("--minutes", o.minutes, "stop training early after so much wall time (default: no limit)")
      ->check(CLI::PositiveNumber);
  app.add_option("--batch", o.batch, "motions to choose the best from (default 32)")->check(CLI::Range(1, 1024));
  app.add_option("--seconds", o.seconds, "a motion lasts at most (default 10)")->check(CLI::Range(0.5, 120.0));
  app.add_option("--seed", o.seed, "of all random numbers (default 1)");
  app.add_option("--threads", o.threads, "number of threads, 0 for all (default); results do not depend on it")
      ->check(CLI::Range(0, 1024));
  app.add_option("--resume", resume, "continue the interrupted job in this folder");
  app.add_option("--play", o.play, "use this generator instead of training one");
  app.add_flag("--quick", o.quick, "a run of under a minute: a small network, few steps, poor motions");
  if (!example::parse(app, argc, argv)) return std::nullopt;
  for (fs::path* p : {&o.character, &o.out, &o.report, &o.play, &resume}) *p = absolute_path(*p);
  for (fs::path& p : o.clips) p = absolute_path(p);
  o.resume = !resume.empty();
  if (o.resume && !o.play.empty()) throw traceur::Error("--resume and --play: expected one of them");
  if (o.resume) {
    std::size_t given = o.clips.size();
    for (const char* name : {"--out", "--size", "--terrain", "--relief", "--steps", "--batch", "--seconds", "--seed", "--quick"})
      given += app.count(name);
    if (given > 0) throw traceur::Error("--resume: the job knows its clips, sizes, seed and folder; leave them out");
    o.out = resume;
    take_over(o, o.out / "checkpoint.safetensors", true);
  }
  if (!o.play.empty()) take_over(o, o.play, false);
  if (o.character.empty()) o.character = absolute_path(example::default_character());
  if (o.clips.empty()) throw traceur::Error("expected a CLIP (--help lists the options)");
  if (o.out.empty()) throw traceur::Error("expected --out DIR (--help lists the options)");
  if (o.report.empty()) o.report = o.out / "report.json";
  if (o.quick && !o.resume) {
    if (o.play.empty() && app.count("--size") == 0) o.size = "small";
    if (app.count("--batch") == 0) o.batch = 8;
  }
  if (o.steps <= 0) o.steps = o.quick ? 400 : 8000;
  if (o.seconds <= 0) o.seconds = o.quick ? 5 : 10;
  return o;
}

}  // namespace generate
