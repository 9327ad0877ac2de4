// SPDX-License-Identifier: MIT
#include "protocols.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <numbers>

#include "../common/lane.hpp"
#include "../common/files.hpp"
#include "../common/simulators.hpp"
#include "../common/progress.hpp"
#include "traceur/control/running_search.hpp"
#include "traceur/core/error.hpp"
#include "traceur/core/executor.hpp"

namespace terrain_runner {

using namespace traceur;
using Json = nlohmann::ordered_json;

OnSimulator::OnSimulator(const Options& o, const sim::Model& model, const sim::Parameters& parameters)
    : name_(o.simulator), model_(&model), parameters_(parameters) {
  if (example::find_simulator(name_).factory) character_ = example::read_file(o.character);
}

std::shared_ptr<example::Engine> OnSimulator::operator()(const std::vector<Course>& courses) const {
  std::vector<const terrain::HeightGrid*> terrain;
  for (const Course& c : courses) terrain.push_back(&c.ground);
  return example::make_engine(name_, character_, *model_, terrain, parameters_);
}

namespace {

/// Where the paper's trials start, in tenths of a metre from the obstacle: each of them, and what is counted together.
constexpr int nearest_dm = 300, farthest_dm = 1000, bin_dm = 100;
/// Of starts that learning never draws from.
constexpr std::uint64_t running_stream = 79;

/// What became of all courses, in their order, whatever the number of threads. `course(i)` makes the i-th.
std::vector<CourseOutcome> run_all(const CourseRunner& runner, int count, const std::function<Course(int)>& course,
                                   core::ThreadExecutor& executor, const OnSimulator& on) {
  constexpr int width = core::lane_count<example::Lane>;
  const int groups = (count + width - 1) / width;
  std::vector<CourseOutcome> out(static_cast<std::size_t>(count));
  executor.run(groups, [&](int g, int) {
    if (example::interruption_asked()) return;
    const int first = g * width;
    std::vector<Course> courses;
    for (int i = first; i < std::min(count, first + width); ++i) courses.push_back(course(i));
    CourseRunner mine = runner;
    const auto engine = on(courses);
    std::ranges::move(mine.run(courses, static_cast<std::uint64_t>(first), nullptr, nullptr, engine.get()), out.begin() + first);
  });
  if (example::interruption_asked()) throw example::Interrupted{};
  return out;
}

/// Courses counted.
struct Tally {
  int courses = 0, completed = 0, met = 0, cleared = 0;
  double seconds = 0;
  OfKinds<int> cleared_of{}, failed_at{};
  std::map<std::string, int> failures;
  Json falls = Json::array();

  explicit Tally(const std::vector<CourseOutcome>& outcomes) {
    for (const CourseOutcome& c : outcomes) add(c);
  }
  void add(const CourseOutcome& c) {
    completed += c.completed;
    cleared += c.cleared;
    // Of a course that failed, the obstacles behind were not met; who fell past the last one fell at none.
    const bool fell_at_one = !c.completed && c.cleared < c.obstacles;
    met += c.cleared + fell_at_one;
    seconds += c.seconds;
    for (const Kind kind : kinds) cleared_of[index_of(kind)] += c.cleared_of[index_of(kind)];
    failed_at[index_of(c.failed_at)] += fell_at_one;
    if (!c.failure.empty()) {
      ++failures[c.failure];
      falls.push_back({{"course", courses},
                       {"what", c.failure},
                       {"cleared", c.cleared},
                       {"at", name_of(c.failed_at)},
                       {"height_m", c.failed_height},
                       {"steps_since", c.steps_since},
                       {"distance_m", c.distance}});
    }
    ++courses;
  }
  double share() const { return met > 0 ? static_cast<double>(cleared) / met : 0; }
};

double percent_lower(double x, double whole) { return whole > 0 ? 100 * (1 - x / whole) : 0; }

void evaluate_ablations(const Options& o, const Player& player, const Skills& skills,
                        const std::function<Course(int)>& course, core::ThreadExecutor& executor, Json& report) {
  const OnSimulator on(o, *player.body.model, skills.gait.simulation);
  const auto tally = [&](const std::string& without) {
    return Tally(run_all(course_runner(player, skills, o.seed, without), o.courses, course, executor, on));
  };
  std::printf("%-22s %9s  %15s  %20s\n", "", "completed", "cleared", "percent lower");
  std::printf("%-22s %9s  %15s  %9s  %9s\n", "", "", "of those met", "completed", "cleared");
  Json rows = Json::array();
  const Tally whole = tally("");
  const auto tell = [&](const std::string& without, const Tally& t) {
    const double completed = percent_lower(t.completed, whole.completed),
                 cleared = percent_lower(t.share(), whole.share());
    std::printf("%-22s %9d  %6d of %5d  %9.1f  %9.1f\n",
                without.empty() ? "the whole system" : ("without " + without).c_str(), t.completed, t.cleared, t.met,
                completed, cleared);
    std::fflush(stdout);
    rows.push_back({{"without", without},
                    {"completed", t.completed},
                    {"obstacles_cleared", t.cleared},
                    {"obstacles_met", t.met},
                    {"completed_percent_lower", completed},
                    {"cleared_share_percent_lower", cleared},
                    {"failures", t.failures}});
  };
  tell("", whole);
  for (const char* part : parts) tell(part, tally(part));
  report["courses"] = o.courses;
  report["ablations"] = rows;
}

Json evaluate_approach(const Options& o, const Player& player, const Skills& skills, core::ThreadExecutor& executor, Kind kind) {
  const double size = obstacle_sizes[index_of(kind)].default_size;
  const auto distance_dm = [&](int i) {
    const double gap = o.trials > 1 ? static_cast<double>(farthest_dm - nearest_dm) / (o.trials - 1) : 0;
    return nearest_dm + static_cast<int>(std::lround(i * gap));
  };
  const auto outcomes = run_all(
      course_runner(player, skills, o.seed, o.without), o.trials,
      [&](int i) { return course_of({{kind, 0.1 * distance_dm(i), size}}); }, executor,
      OnSimulator(o, *player.body.model, skills.gait.simulation));
  struct Bin {
    int trials = 0, successes = 0;
  };
  std::array<Bin, (farthest_dm - nearest_dm) / bin_dm> bins;
  const Tally all(outcomes);
  for (int i = 0; i < o.trials; ++i) {
    // The farthest trial closes the last bin.
    Bin& b =
        bins[std::min<std::size_t>(bins.size() - 1, static_cast<std::size_t>((distance_dm(i) - nearest_dm) / bin_dm))];
    ++b.trials;
    b.successes += outcomes[static_cast<std::size_t>(i)].completed;
  }
  std::printf("%s of %.2f m, started 30 to 100 m before it: %d of %d trials cleared it and ran on, %.1f %%\n",
              name_of(kind), size, all.completed, o.trials, 100.0 * all.completed / o.trials);
  Json list = Json::array();
  for (std::size_t b = 0; b < bins.size(); ++b) {
    const int from = nearest_dm / 10 + static_cast<int>(b) * bin_dm / 10, to = from + bin_dm / 10;
    std::printf("  %d to %d m: %d of %d\n", from, to, bins[b].successes, bins[b].trials);
    list.push_back({{"from_m", from}, {"to_m", to}, {"trials", bins[b].trials}, {"successes", bins[b].successes}});
  }
  for (const auto& [what, count] : all.failures) std::printf("  %s: %d\n", what.c_str(), count);
  return {{"skill", name_of(kind)},         {"size_m", size},
                        {"without", o.without},       {"trials", o.trials},
                        {"successes", all.completed}, {"share", static_cast<double>(all.completed) / o.trials},
                        {"by_distance", list},        {"failures", all.failures}};
}

/// Tasks evenly over the paper's range (Terrain Runner, Table 1), each from starts that learning never saw.
void evaluate_running(const Options& o, const Player& player, const Skills& skills, core::ThreadExecutor& executor, Json& report) {
  constexpr int per_axis = 13, starts = 20;
  constexpr double most_turn = 6, slowest = 2, fastest = 5, degree = std::numbers::pi / 180;
  const sim::Ground<float> flat;
  std::vector<control::RunningJudgement> judged(per_axis * per_axis);
  const auto task = [&](int i) {
    const double turn = -most_turn + i % per_axis * 2 * most_turn / (per_axis - 1), speed = slowest + i / per_axis * (fastest - slowest) / (per_axis - 1);
    return control::RunningTask{turn * degree, speed};
  };
  executor.run(per_axis * per_axis, [&](int i, int) {
    if (example::interruption_asked()) return;
    control::RunningTrials<example::Lane> trials(*player.body.model, player.body.roles, skills.gait.simulation, flat, player.body.gait, player.body.wide);
    control::RunningSearch p;
    p.run.seed = o.seed;
    p.run.either_foot = true;
    judged[static_cast<std::size_t>(i)] = control::judge_running(trials, task(i), player.running(task(i)), p, starts, running_stream);
  });
  if (example::interruption_asked()) throw example::Interrupted{};
  int all_stand = 0, most_stand = 0, as_asked = 0;
  Json list = Json::array();
  std::printf("runs of 20 cycles, of %d, that end upright; across: degrees per step\n%6s", starts, "m/s");
  for (int i = 0; i < per_axis; ++i) std::printf("%5.0f", task(i).turn / degree);
  for (int i = 0; i < per_axis * per_axis; ++i) {
    const control::RunningJudgement& j = judged[static_cast<std::size_t>(i)];
    const control::RunningTask t = task(i);
    const auto stood = static_cast<int>(std::lround(j.survived * starts));
    all_stand += stood == starts;
    most_stand += stood >= 0.9 * starts;
    as_asked += j.share >= 0.9;
    if (i % per_axis == 0) std::printf("\n%6.2f", t.speed);
    std::printf("%5d", stood);
    list.push_back({{"turn_deg_per_step", t.turn / degree}, {"speed_m_s", t.speed}, {"survived", j.survived}, {"as_asked", j.share}, {"measured_speed_m_s", j.speed}, {"measured_turn_deg_per_step", j.turn / degree}});
  }
  std::printf("\n%d of %d tasks stand in every run, %d in nine of ten, %d as asked in nine of ten\n", all_stand, per_axis * per_axis, most_stand, as_asked);
  report["running"] = {{"starts", starts}, {"tasks", per_axis * per_axis}, {"all_stand", all_stand}, {"nine_of_ten_stand", most_stand}, {"as_asked", as_asked}, {"grid", list}};
}

}  // namespace

Player::Player(const sim::Model& model, const control::Roles& roles, const Skills& skills, const std::vector<Kind>& asked)
    : body(model, roles, skills.gait), running(skills.wider.empty() ? *skills.running : skills.wider.back(), body.narrow.shape, body.wide.shape) {
  for (const Kind kind : asked)
    if (skills.family[index_of(kind)]) body.add_family(kind, *skills.family[index_of(kind)]);
}

CourseRunner course_runner(const Player& player, const Skills& skills, std::uint64_t seed, const std::string& without) {
  CourseSettings s;
  s.seed = seed;
  s.planner = without != "planner";
  s.feedback = without != "feedback";
  s.recovery = without != "recovery";
  s.composition.blend = without != "blending";
  OfKinds<ManoeuvreModel> models;
  for (const Kind kind : kinds)
    if (skills.clearing[index_of(kind)]) models[index_of(kind)] = manoeuvre_model(*skills.clearing[index_of(kind)], without != "interpolation");
  return {player.body, player.running, models, skills.measured->length, s};
}

std::vector<Kind> obstacle_kinds(const Options& o, const Skills& skills) {
  std::vector<Kind> known;
  for (const Kind kind : kinds) {
    const bool asked = std::find(o.kinds.begin(), o.kinds.end(), kind) != o.kinds.end();
    if (skills.clearing[index_of(kind)] && (o.kinds.empty() || asked)) known.push_back(kind);
    if (skills.clearing[index_of(kind)] && (o.kinds.empty() || asked) && !skills.family[index_of(kind)])
      throw Error(o.skills.string() + ": expected " + name_of(kind) + ".safetensors beside " + name_of(kind) + ".txt; train writes both");
    if (asked && !skills.clearing[index_of(kind)]) throw Error(o.skills.string() + ": expected " + name_of(kind) + ".txt; train writes it");
  }
  if (known.empty()) throw Error(o.skills.string() + ": expected jump.txt, vault.txt or drop.txt; train writes them");
  return known;
}

CourseShape course_shape(const Options& o, const Skills& skills) {
  CourseShape shape;
  shape.obstacles = o.obstacles;
  shape.kinds = obstacle_kinds(o, skills);
  for (const Kind kind : shape.kinds) {
    const std::vector<double> learned = learned_heights(*skills.clearing[index_of(kind)]);
    if (learned.empty()) throw Error(o.skills.string() + ": " + name_of(kind) + ".txt: no height was learned");
    shape.heights[index_of(kind)] = o.heights[index_of(kind)].value_or(std::array{learned.front(), learned.back()});
  }
  return shape;
}

void evaluate(const Options& o, const Player& player, const Skills& skills, Json& report) {
  core::ThreadExecutor executor(o.threads);
  if (o.running) {
    evaluate_running(o, player, skills, executor, report);
    return;
  }
  if (o.approach) {
    report["approach"] = Json::array();
    for (const Kind kind : obstacle_kinds(o, skills)) report["approach"].push_back(evaluate_approach(o, player, skills, executor, kind));
    return;
  }
  const CourseShape shape = course_shape(o, skills);
  const auto course = [&](int i) { return random_course(shape, o.seed, static_cast<std::uint64_t>(i)); };
  if (o.ablations) {
    evaluate_ablations(o, player, skills, course, executor, report);
    return;
  }
  const Tally t(run_all(course_runner(player, skills, o.seed, o.without), o.courses, course, executor, OnSimulator(o, *player.body.model, skills.gait.simulation)));
  report["courses"] = t.courses;
  report["completed"] = t.completed;
  report["obstacles_met"] = t.met;
  report["obstacles_cleared"] = t.cleared;
  for (const Kind kind : shape.kinds)
    report["by_kind"][name_of(kind)] = {{"cleared", t.cleared_of[index_of(kind)]}, {"met", t.cleared_of[index_of(kind)] + t.failed_at[index_of(kind)]}};
  report["failures"] = t.failures;
  report["failed"] = t.falls;
  report["without"] = o.without;
  report["simulated_s"] = t.seconds;
  std::printf("%d of %d courses completed, %d of %d obstacles cleared\n", t.completed, t.courses, t.cleared, t.met);
  for (const Kind kind : shape.kinds)
    std::printf("  %s: %d of %d\n", name_of(kind), t.cleared_of[index_of(kind)], t.cleared_of[index_of(kind)] + t.failed_at[index_of(kind)]);
  for (const auto& [what, count] : t.failures) std::printf("  %s: %d\n", what.c_str(), count);
}

}  // namespace terrain_runner
