// SPDX-License-Identifier: MIT
#include "options.hpp"

#include <fstream>
#include <map>

#include "../common/command_line.hpp"
#include "../common/results.hpp"
#include "../common/simulators.hpp"
#include "job_folder.hpp"
#include "traceur/core/error.hpp"
#include "traceur/core/version.hpp"

namespace perform {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;
using example::absolute_path;
using example::default_character;

namespace {

/// What the job in the folder was begun with, in place of what this command line leaves open.
void take_over(Options& o, const Json& begun, const CLI::App& app) {
  const Json given = job_arguments(o);
  const std::map<std::string, std::string> option_names{{"clip", "CLIP"},
                                                        {"joint_map", "--joint-map"},
                                                        {"dt_hz", "--dt-hz"},
                                                        {"open_loop", "--open-loop"},
                                                        {"fine_tune_s", "--fine-tune"},
                                                        {"up_axis", "--up"},
                                                        {"unit_m", "--unit"}};
  for (const auto& [key, value] : given.items()) {
    const auto named = option_names.find(key);
    const std::string option = named != option_names.end() ? named->second : "--" + key;
    if (begun.contains(key) && begun[key] != value && app.count(option) > 0)
      throw traceur::Error("--resume: " + option + " was " + begun[key].dump() + " when the job began, now " +
                           value.dump());
  }
  const auto path = [&](const char* key) { return fs::path(begun.at(key).get<std::string>()); };
  const auto number = [&](const char* key) {
    return begun.at(key).is_null() ? std::nullopt : std::optional<double>(begun.at(key).get<double>());
  };
  o.clip = path("clip");
  o.character = path("character");
  o.terrain = path("terrain");
  o.skeleton = path("skeleton");
  o.joint_map = path("joint_map");
  o.controller = path("controller");
  o.unit = number("unit_m");
  o.fps = number("fps");
  o.up = begun.at("up_axis").get<std::string>();
  o.motion = begun.at("motion").get<std::string>();
  o.feedback = begun.at("feedback").get<std::string>();
  o.simulator = begun.at("simulator").get<std::string>();
  o.fine_tune_s = begun.at("fine_tune_s").get<double>();
  if (const auto& robust = begun.at("robust"); !robust.is_null()) o.robust = robust.get<bool>();
  o.dt_hz = begun.at("dt_hz").get<int>();
  o.seed = begun.at("seed").get<std::uint64_t>();
  o.perturb = begun.at("perturb").get<bool>();
  o.quick = begun.at("quick").get<bool>();
  o.open_loop = begun.at("open_loop").get<bool>();
}

}  // namespace

Json job_arguments(const Options& o) {
  const auto number = [](const std::optional<double>& x) { return x ? Json(*x) : Json(nullptr); };
  return Json{{"clip", o.clip.string()},
              {"character", o.character.string()},
              {"terrain", o.terrain.string()},
              {"skeleton", o.skeleton.string()},
              {"joint_map", o.joint_map.string()},
              {"controller", o.controller.string()},
              {"unit_m", number(o.unit)},
              {"fps", number(o.fps)},
              {"up_axis", o.up},
              {"motion", o.motion},
              {"feedback", o.feedback},
              {"simulator", o.simulator},
              {"fine_tune_s", o.fine_tune_s},
              {"robust", o.robust ? nlohmann::ordered_json(*o.robust) : nlohmann::ordered_json()},
              {"dt_hz", o.dt_hz},
              {"seed", o.seed},
              {"perturb", o.perturb},
              {"quick", o.quick},
              {"open_loop", o.open_loop}};
}

std::optional<Options> read_options(int argc, char** argv) {
  Options o;
  fs::path resume;
  CLI::App app(
      "perform teaches a simulated character the motion of a clip: it finds motor targets by sampling,\n"
      "learns a feedback law around them, tests it on unseen starts and pushes, and writes a replay.",
      "perform");
  app.set_version_flag("--version", std::string(traceur::core::version_string));
  app.add_option("CLIP", o.clip, "motion: BVH, AMC, DeepMimic, AMP or PARC JSON, or our own .jsonl");
  app.add_option("--character", o.character, "body to simulate, MJCF (default: the examples' humanoid)");
  app.add_option("--terrain", o.terrain,
                 "height grid, JSON, in the clip's coordinates (default: the clip's own, or level ground)");
  app.add_flag("--perturb", o.perturb, "begin the replay from a perturbed start and push the character on the way");
  app.add_option("--out", o.out, "folder for controller.json, motion.jsonl, open_loop.jsonl, replay.html");
  app.add_option("--report", o.report, "report file, JSON (default: report.json in the --out folder)");
  app.add_option("--seed", o.seed, "of all random numbers (default 1)");
  app.add_option("--threads", o.threads, "number of threads, 0 for all (default); results do not depend on it")
      ->check(CLI::Range(0, 1024));
  app.add_option("--resume", resume, "continue the interrupted job in this folder");
  app.add_flag("--open-loop", o.open_loop, "stop after the open-loop search");
  app.add_flag("--quick", o.quick, "a run of under a minute, with less effort and poorer results");
  app.add_option("--skeleton", o.skeleton, "skeleton of an AMC or DeepMimic clip (default: found beside it)");
  app.add_option("--joint-map", o.joint_map, "JSON object: the character's joint or landmark -> the clip's joint");
  app.add_option("--unit", o.unit, "metres in one length unit of a BVH or AMC clip")->check(CLI::PositiveNumber);
  app.add_option("--up", o.up, "up axis of a BVH or AMC clip")->check(CLI::IsMember({"detect", "x", "y", "z"}));
  app.add_option("--fps", o.fps, "frames a second, where the clip's file does not say or is wrong")
      ->check(CLI::PositiveNumber);
  app.add_option("--controller", o.controller, "test and replay this controller instead of learning one");
  app.add_option("--simulator", o.simulator,
                 "what tests, pushes and the replay run on: bundled (default), mujoco, dart, ode or bullet;\n"
                 "search and learning are always on the bundled one");
  app.add_option("--fine-tune", o.fine_tune_s,
                 "seconds to go on learning on that simulator before the test (default 0)")
      ->check(CLI::Range(0.0, 1e6));
  // Into an optional, a flag that was not given would come as false.
  bool robust = false;
  const CLI::Option* const robust_flag =
      app.add_flag("--robust,!--no-robust", robust,
                   "go on learning where ground, friction and time step differ and pushes come, so that the law holds\n"
                   "elsewhere; by default a gait's law does, but for --quick");
  app.add_option("--motion", o.motion, "auto (default), cyclic (a gait without end) or once")
      ->check(CLI::IsMember({"auto", "cyclic", "once"}));
  app.add_option("--feedback", o.feedback,
                 "size of the feedback law: small (63 numbers a phase) or large (99, default)")
      ->check(CLI::IsMember({"small", "large"}));
  app.add_option("--dt-hz", o.dt_hz, "simulation steps a second, a multiple of 60 (default 240)")
      ->check(CLI::Range(120, 60000));
  app.get_option("CLIP")->type_name("FILE");
  if (!example::parse(app, argc, argv)) return std::nullopt;
  if (robust_flag->count() > 0) o.robust = robust;
  o.resume = !resume.empty();
  for (fs::path* p :
       {&o.clip, &o.character, &o.terrain, &o.skeleton, &o.joint_map, &o.controller, &o.out, &o.report, &resume})
    *p = absolute_path(*p);
  if (o.character.empty()) o.character = default_character();
  if (o.resume) {
    if (app.count("--out") > 0 && o.out != resume)
      throw traceur::Error("--resume: results go to the same folder, leave out --out");
    o.out = resume;
    const Json job = JobFolder(o.out).read_job();
    try {
      take_over(o, job.at("arguments"), app);
    } catch (const Json::exception&) {
      throw traceur::Error((o.out / "state" / "job.json").string() + ": expected the arguments of a job");
    }
  }
  if (o.out.empty()) throw traceur::Error("expected --out DIR (--help lists the options)");
  if (o.report.empty()) o.report = o.out / "report.json";
  if (o.clip.empty() && o.controller.empty()) throw traceur::Error("expected a CLIP (--help lists the options)");
  example::find_simulator(o.simulator);
  if (o.dt_hz % 60 != 0) throw traceur::Error("--dt-hz: expected a multiple of 60, got " + std::to_string(o.dt_hz));
  return o;
}

}  // namespace perform
