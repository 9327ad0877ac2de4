// SPDX-License-Identifier: MIT
#include "options.hpp"

#include <random>

#include "../common/command_line.hpp"
#include "../common/results.hpp"
#include "traceur/core/error.hpp"
#include "traceur/core/version.hpp"

namespace terrain_runner {

namespace fs = std::filesystem;
using example::absolute_path;

std::optional<Options> read_options(int argc, char** argv) {
  Options o;
  fs::path resume;
  CLI::App app(
      "terrain_runner teaches a simulated character to run at any speed and turn, jump, vault and drop-roll (train), sends it over a\n"
      "random course (run), and over many (evaluate); plot shows what was learned, and\n"
      "compare explores what running can do in two ways.",
      "terrain_runner");
  app.set_version_flag("--version", std::string(traceur::core::version_string));
  app.require_subcommand(1);
  CLI::App* train = app.add_subcommand("train", "learn the skills from a running controller");
  CLI::App* run = app.add_subcommand("run", "run a course and write a replay");
  CLI::App* evaluate = app.add_subcommand("evaluate", "run many courses and count");
  CLI::App* plot = app.add_subcommand("plot", "write a page of plots of the skills: what is explored, and how long steps are");
  CLI::App* compare =
      app.add_subcommand("compare", "explore running's range by predictor-corrector and axis by axis, from the same gait and first node");
  train->add_option("GAIT", o.gait, "controller of a run, as perform --feedback small writes it (controller.json; default: the examples' own gait, as it is)")->type_name("FILE");
  for (CLI::App* c : {train, compare}) c->add_option("--resume", resume, "continue the interrupted job in this folder");
  compare->add_option("--runs", o.runs, "of each way, after which no new round begins (default: as training has it)")->check(CLI::Range(1, 1000000000));
  for (CLI::App* c : {run, evaluate, plot, compare})
    c->add_option("SKILLS", o.skills, "folder that train wrote (default: the examples' own)")->type_name("DIR");
  for (CLI::App* c : {run, evaluate}) {
    c->add_option("--obstacles", o.obstacles, "of a course (default 2)")->check(CLI::Range(1, 100));
    c->add_option("--jump", o.heights[index_of(Kind::jump)], "lowest and highest step up, m (default: as learned)")->check(CLI::Range(0.05, 0.8));
    c->add_option("--vault", o.heights[index_of(Kind::vault)], "lowest and highest box, m (default: as learned)")->check(CLI::Range(0.3, 1.5));
    c->add_option("--drop", o.heights[index_of(Kind::drop)], "lowest and highest cliff down, m (default: as learned)")->check(CLI::Range(0.5, 3.0));
  }
  for (CLI::App* c : {run, evaluate})
    c->add_option("--simulator", o.simulator, "what to run on: bundled (default), mujoco, dart, ode or bullet");
  evaluate->add_option("--courses", o.courses, "number of courses (default 100)")->check(CLI::Range(1, 100000));
  evaluate->add_option("--without", o.without, "leave out a part: planner, feedback, recovery, blending or interpolation")
      ->check(CLI::IsMember({"planner", "feedback", "recovery", "blending", "interpolation"}));
  evaluate->add_flag("--ablations", o.ablations, "the same courses with the whole system and without each part in turn");
  evaluate->add_flag("--approach", o.approach, "no courses: one obstacle of default height, started 30 to 100 m before it");
  evaluate->add_flag("--running", o.running, "no courses: 13 speeds of 2 to 5 m/s by 13 turns of up to 6 degrees per step to either side, 20 starts each");
  evaluate->add_option("--trials", o.trials, "of --approach, evenly spaced (default 701, every 0.1 m)")->check(CLI::Range(2, 701));
  bool fresh = false;
  CLI::Option* choose = run->add_flag("--fresh", fresh, "a course that nobody has seen: a seed of the moment, which is said");
  run->add_flag("--live", o.live, "no faster than real time, and say where the runner is");
  std::vector<std::string> names;
  for (CLI::App* c : {train, run, evaluate})
    c->add_option("--kinds", names, "obstacles: jump, vault, drop (default: all that the skills are for)")
        ->delimiter(',')
        ->allow_extra_args(false)
        ->check(CLI::IsMember({"jump", "vault", "drop"}));
  for (CLI::App* c : {train, run, evaluate, plot, compare}) {
    c->add_option("--character", o.character, "body to simulate, MJCF (default: the examples' humanoid)");
    c->add_option("--out", o.out, "folder for the results");
    c->add_option("--report", o.report, "report file, JSON (default: report.json in the --out folder)");
    CLI::Option* seed = c->add_option("--seed", o.seed, "of all random numbers (default 1)");
    if (c == run) choose->excludes(seed);
    c->add_option("--threads", o.threads, "number of threads, 0 for all (default); results do not depend on it")->check(CLI::Range(0, 1024));
    c->add_flag("--quick", o.quick, "a run of under a minute, with less effort and poorer results");
  }
  if (!example::parse(app, argc, argv)) return std::nullopt;
  o.command = train->parsed() ? Command::train : run->parsed() ? Command::run : evaluate->parsed() ? Command::evaluate : plot->parsed() ? Command::plot : Command::compare;
  for (fs::path* p : {&o.gait, &o.skills, &o.character, &o.out, &o.report, &resume}) *p = absolute_path(*p);
  if (!resume.empty()) {
    if (!o.out.empty() || !o.gait.empty()) throw traceur::Error("--resume: the folder knows its gait; leave GAIT and --out out");
    if (!o.skills.empty()) throw traceur::Error("--resume: the folder knows its skills; leave SKILLS out");
    o.resume = true;
    o.out = resume;
    if (o.command == Command::compare) o.skills = resume;
  }
  if (o.character.empty()) o.character = absolute_path(example::default_character());
  if (o.out.empty()) throw traceur::Error("expected --out DIR (--help lists the options)");
  if (o.report.empty()) o.report = o.out / "report.json";
  if (o.ablations && !o.without.empty()) throw traceur::Error("--ablations: it leaves out every part in turn; leave --without out");
  if (o.ablations && o.approach) throw traceur::Error("--ablations: expected without --approach");
  if (o.running && (o.ablations || o.approach || !o.without.empty() || o.simulator != "bundled"))
    throw traceur::Error("--running: expected without --ablations, --approach, --without and --simulator");
  if (!o.approach && evaluate->count("--trials") > 0) throw traceur::Error("--trials: expected with --approach");
  for (const Kind kind : kinds) {
    const auto& range = o.heights[index_of(kind)];
    if (range && (*range)[1] < (*range)[0]) throw traceur::Error(std::string("--") + name_of(kind) + ": expected the lowest first");
    if (std::find(names.begin(), names.end(), name_of(kind)) != names.end()) o.kinds.push_back(kind);
  }
  const fs::path own = absolute_path(example::default_character()).parent_path().parent_path() / "skills";
  if (o.command == Command::train && o.gait.empty()) {
    o.gait = own / "gait.json";
    o.learn_gait = false;
  }
  if (o.command != Command::train && o.skills.empty()) o.skills = own;
  if (fresh) o.seed = std::random_device{}() % 1000000;
  if (o.quick && o.command == Command::evaluate && evaluate->count("--courses") == 0) o.courses = 16;
  return o;
}

}  // namespace terrain_runner
