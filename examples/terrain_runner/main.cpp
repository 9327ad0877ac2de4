// SPDX-License-Identifier: MIT
//
// A simulated character runs over terrain (Liu, Yin, van de Panne and Guo 2012, "Terrain Runner").
//
//   train:  gait ── running ──────── jump, vault, drop-roll ─────────────── skills
//           (law,   (controls over   (keys ── sampling ── regulator ── law,
//           Eq. 8)  speed and turn,   each over heights)
//                   continuation)
//
//   run:    at every step  planner ─ speed, turn ─ RBF ─ control ──┐
//                             └─── jump, vault, drop ─ RBF ─ control ┴ composition ─ laws, regulator ─ motors
//
// Figure 2 of the paper, and s6. The gait is a running controller, learned from one clip by `perform`.
#include <cstdio>
#include <functional>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "../common/command_line.hpp"
#include "../common/files.hpp"
#include "../common/progress.hpp"
#include "../common/results.hpp"
#include "../common/simulators.hpp"
#include "compare.hpp"
#include "live.hpp"
#include "options.hpp"
#include "protocols.hpp"
#include "report.hpp"
#include "trainer.hpp"
#include "traceur/core/error.hpp"
#include "traceur/core/version.hpp"
#include "traceur/io/controller_file.hpp"

namespace {

using namespace terrain_runner;
using namespace traceur;
using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

void say(const char* stage, const std::string& what) {
  std::printf("%s: %s\n", stage, what.c_str());
  std::fflush(stdout);
}

const char* name(parameterize::NodeStatus s) {
  constexpr const char* names[] = {"untried", "solved", "extrapolated", "failed"};
  return names[static_cast<std::size_t>(s)];
}

Json to_json(const std::vector<NodeResult>& nodes, int trials) {
  Json list = Json::array();
  int stable = 0;
  for (const NodeResult& n : nodes) {
    stable += n.judgement.survived >= 0.95;
    list.push_back({{"turn_deg_per_step", n.task.turn * 180 / std::numbers::pi},
                    {"speed_m_s", n.task.speed},
                    {"status", name(n.status)},
                    {"survived", n.judgement.survived},
                    {"as_asked", n.judgement.share},
                    {"measured_speed_m_s", n.judgement.speed},
                    {"measured_turn_deg_per_step", n.judgement.turn * 180 / std::numbers::pi},
                    {"step_length_m", n.judgement.step_length}});
  }
  return {{"trials", trials}, {"nodes", list.size()}, {"stable_nodes", stable}, {"grid", list}};
}

/// `skills` is what there is already: of a new job, the gait that it begins with.
void train(const Options& o, const sim::Model& model, const control::Roles& roles, Skills skills, Json& report) {
  const Effort effort = Effort::of(o.quick, o.seed);
  Trainer trainer(model, roles, effort, o.out, o.threads, say);
  const example::Clock clock;
  if (!o.resume && o.learn_gait) skills.gait = trainer.make_gait(skills.gait);
  if (!o.resume && !o.learn_gait) write_gait(o.out, skills.gait);
  const double gait_s = clock.seconds();
  skills.running = trainer.learn_running(skills.gait, std::move(skills.running));
  const double running_s = clock.seconds();
  const int trials = o.quick ? 4 : 16;
  const std::vector<NodeResult> nodes = trainer.test_running(skills.gait, *skills.running, trials);
  report["running"] = to_json(nodes, trials);
  report["running"]["evaluations"] = skills.running->evaluations();
  const auto length = trainer.step_length(nodes);
  report["step_length"] = {{"slope_s", length.slope}, {"offset_m", length.offset}};
  skills.measured = Measured{length, trainer.watch(skills.gait, *skills.running)};
  write_measured(o.out, *skills.measured);
  const double tested_s = clock.seconds();
  // Manoeuvres are learned from the narrower range: what is wider is none of their business.
  std::vector<parameterize::Continuation> wider = std::exchange(skills.wider, {});
  Json walls = Json::object();
  for (const Kind kind : kinds) {
    if (!o.kinds.empty() && std::find(o.kinds.begin(), o.kinds.end(), kind) == o.kinds.end()) continue;
    const std::size_t k = index_of(kind);
    const double begun_s = clock.seconds();
    const Player runner(model, roles, skills, {});
    // As long as there are more heights to come, it says where to seek the next.
    if (!skills.family[k] || skills.family[k]->plan_offsets.size() > 0)
      skills.family[k] = trainer.sample_family(kind, runner.running, runner.body, *skills.measured, std::move(skills.family[k]));
    const Player player(model, roles, skills, {kind});
    skills.clearing[k] = trainer.learn_clearing(kind, player.running, player.body, length, std::move(skills.clearing[k]));
    Json& part = report[name_of(kind)] = Json{{"evaluations", skills.clearing[k]->evaluations()}, {"heights", Json::array()}};
    for (const ClearingResult& j : trainer.test_clearing(kind, player.running, player.body, manoeuvre_model(*skills.clearing[k]), length,
                                                         effort.kinds[k].heights, o.quick ? 16 : 128)) {
      part["heights"].push_back({{"height_m", j.height}, {"trials", j.trials}, {"survived", j.survived}, {"cleared", j.cleared}, {"exit_speed_m_s", j.exit_speed}});
      std::printf("%s %.2f m: %d of %d\n", name_of(kind), j.height, j.cleared, j.trials);
    }
    walls[name_of(kind)] = clock.seconds() - begun_s;
  }
  const double widening_s = clock.seconds();
  for (std::size_t k = 0; k < effort.wider.size(); ++k) {
    if (k == wider.size()) {
      wider.push_back(k > 0 ? wider[k - 1] : *skills.running);
      wider[k].retry();
    }
    wider[k] = trainer.widen_running(skills.gait, std::move(wider[k]), static_cast<int>(k));
  }
  report["wider"] = to_json(trainer.test_running(skills.gait, wider.back(), trials), trials);
  report["wider"]["evaluations"] = wider.back().evaluations();
  report["wall_widening_s"] = clock.seconds() - widening_s;
  report["wall_gait_s"] = gait_s;
  report["wall_running_s"] = running_s - gait_s;
  report["wall_tests_s"] = tested_s - running_s;
  report["wall_clearing_s"] = walls;
}

void write_recording(const Options& o, const sim::Model& model, const Course& course, const CourseRecording& r, const CourseOutcome& c,
                     double tick) {
  io::Replay replay;
  replay.title = "Terrain Runner";
  char text[120];
  std::snprintf(text, sizeof text, "%d of %d, %.0f m in %.1f s", c.cleared, c.obstacles, c.distance, c.seconds);
  replay.facts = {{"obstacles cleared", text}, {"seed", std::to_string(o.seed)}, {"failure", c.failure.empty() ? "none" : c.failure}};
  replay.characters = {example::replay_character(model.character)};
  io::ReplayTrack track;
  track.name = "simulated";
  track.fps = static_cast<float>(1 / tick);
  Eigen::MatrixXd poses(model.nq, static_cast<Eigen::Index>(r.poses.size()));
  for (Eigen::Index k = 0; k < poses.cols(); ++k) poses.col(k) = r.poses[static_cast<std::size_t>(k)];
  // Nothing is shown below the floor.
  const terrain::HeightGrid& g = course.ground;
  double lowest = 0;
  for (int i = 0; i < g.nx(); ++i) lowest = std::min(lowest, g(i, 0));
  poses.row(2).array() -= lowest;
  track.poses = example::replay_poses(model.character.skeleton, poses);
  replay.tracks = {track};
  // The grid is one cell wide, which is too narrow a strip to look at.
  constexpr int rows = 8;
  Eigen::MatrixXd heights(g.nx(), rows);
  for (int i = 0; i < g.nx(); ++i) heights.row(i).setConstant(g(i, 0) - lowest);
  replay.terrain = example::replay_terrain(terrain::HeightGrid(heights, g.cell(), g.center_x(0) - 0.5 * g.cell(), -0.5 * rows * g.cell()));
  io::write_replay(o.out / "replay.html", replay);
  std::printf("replay: %s\n", (o.out / "replay.html").string().c_str());
}

void run(const Options& o, const sim::Model& model, const Player& player, const Skills& skills, Json& report) {
  CourseRunner runner = course_runner(player, skills, o.seed, o.without);
  const Course course = random_course(course_shape(o, skills), o.seed, 0);
  CourseRecording recording;
  Pace pace(o.live);
  runner.watch = std::ref(pace);
  const auto engine = OnSimulator(o, model, skills.gait.simulation)({course});
  // An engine moves the first lane of a pack.
  const CourseOutcome c = engine ? runner.run({course}, 0, &recording, nullptr, engine.get())[0] : runner.run_alone(course, 0, &recording);
  report["cleared"] = c.cleared;
  report["obstacles"] = c.obstacles;
  report["completed"] = c.completed;
  report["failure"] = c.failure;
  report["distance_m"] = c.distance;
  report["simulated_s"] = c.seconds;
  report["running_s"] = c.running;
  report["running_flight_s"] = c.flying;
  report["manoeuvres"] = Json::array();
  for (const Labels& l : c.labels)
    report["manoeuvres"].push_back({{"kind", name_of(l.kind)}, {"height_m", l.height}, {"hand_s", l.hand}, {"flight_s", l.flight}, {"turned_rad", l.turned}});
  report["live"] = o.live;
  report["real_time_factor"] = pace.real_time_factor();
  report["core_time_factor"] = pace.core_time_factor();
  std::printf("seed %llu: %d of %d obstacles, %.0f m in %.1f s%s%s\n%.0f times as fast as real time, %.0f by the core's time\n", static_cast<unsigned long long>(o.seed), c.cleared, c.obstacles, c.distance, c.seconds,
              c.failure.empty() ? "" : ": ", c.failure.c_str(), pace.real_time_factor(), pace.core_time_factor());
  write_recording(o, model, course, recording, c, skills.gait.tick);
}

int carry_out(const Options& o) {
  example::listen_for_interruption();
  const example::Clock clock;
  const sim::Model model = example::read_model(o.character);
  const control::Roles roles = control::find_roles(model);
  Skills skills;
  std::vector<Kind> asked;
  example::find_simulator(o.simulator);
  if (o.command == Command::train) {
    if (o.resume)
      skills = read_skills(o.out, model, roles);
    else
      skills.gait = io::read_controller(o.gait, model, roles);
  } else {
    skills = read_skills(o.skills, model, roles);
    if (!skills.running || !skills.measured) throw Error(o.skills.string() + ": expected running.txt and measured.json; train writes them");
    if (o.command == Command::run || o.command == Command::evaluate) asked = obstacle_kinds(o, skills);
  }
  example::check_writable(o.out, o.report);
  constexpr const char* commands[] = {"train", "run", "evaluate", "plot", "compare"};
  Json report{{"program", "terrain_runner"}, {"version", core::version_string}, {"command", commands[static_cast<int>(o.command)]},
              {"seed", o.seed}, {"quick", o.quick}};
  const bool lasts = o.command == Command::train || o.command == Command::compare;
  const std::string resume = lasts ? std::string("terrain_runner ") + commands[static_cast<int>(o.command)] + " --resume " + o.out.string() : "";
  const example::Ending ending = example::ending_of(resume, [&] {
    if (o.command == Command::train)
      train(o, model, roles, std::move(skills), report);
    else if (o.command == Command::run)
      run(o, model, Player(model, roles, skills, asked), skills, report);
    else if (o.command == Command::plot)
      write_skill_report(o, model, roles, skills, report);
    else if (o.command == Command::compare)
      compare(o, model, roles, skills, report);
    else
      evaluate(o, Player(model, roles, skills, asked), skills, report);
  });
  return example::write_report(o.report, report, clock.seconds(), ending);
}

}  // namespace

int main(int argc, char** argv) { return example::main_of("terrain_runner", argc, argv, read_options, carry_out); }
