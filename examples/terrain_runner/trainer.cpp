// SPDX-License-Identifier: MIT
#include "trainer.hpp"

#include <functional>
#include <numbers>
#include <numeric>

#include "../common/progress.hpp"
#include "right_hand.hpp"
#include "traceur/control/hand_grip.hpp"
#include "traceur/control/resimulate.hpp"
#include "traceur/control/sampling_control.hpp"
#include "traceur/core/error.hpp"

namespace terrain_runner {

namespace fs = std::filesystem;
using namespace traceur;
using example::interruption_asked;
using example::Interrupted;
using parameterize::Continuation;
using parameterize::ContinuationResult;
using parameterize::ContinuationTask;

namespace {

constexpr double degree = std::numbers::pi / 180;
// Streams of starts that learning never draws from.
constexpr std::uint64_t test_stream = 77, state_stream = 78;
// Courses of training are none that anyone asks for.
constexpr std::uint64_t course_stream = std::uint64_t{1} << 32;
// Within them, those that choose.
constexpr std::uint64_t choice_stream = std::uint64_t{1} << 31;

std::vector<double> spaced(double first, double last, int count) {
  std::vector<double> out;
  for (int i = 0; i < count; ++i) out.push_back(first + (last - first) * i / (count - 1));
  return out;
}

Eigen::VectorXd to_vector(const std::vector<double>& x) { return Eigen::Map<const Eigen::VectorXd>(x.data(), static_cast<Eigen::Index>(x.size())); }

std::string text(const char* format, auto... values) {
  char line[300];
  std::snprintf(line, sizeof line, format, values...);
  return line;
}

/// One runner of trials for each worker, made when first needed.
template <class Trials, class Make>
class PerWorker {
public:
  PerWorker(int workers, Make make) : trials_(static_cast<std::size_t>(workers)), make_(std::move(make)) {}
  Trials& operator[](int worker) {
    auto& t = trials_[static_cast<std::size_t>(worker)];
    if (!t) t = make_();
    return *t;
  }

private:
  std::vector<std::unique_ptr<Trials>> trials_;
  Make make_;
};
template <class Trials, class Make>
PerWorker<Trials, Make> per_worker(int workers, Make make) {
  return {workers, std::move(make)};
}

/// Sampling around a plan that is nearly right already.
control::SamplingParameters narrowed(control::SamplingParameters p) {
  for (double* sigma : {&p.hip, &p.leg, &p.trunk, &p.head}) *sigma *= 0.25;
  p.rounds = (p.rounds + 1) / 2;
  return p;
}

/// The joints' targets of a motion, up to its end, as they were refined.
void put_targets(const control::RefinedTargets& r, MotionFamily& f, std::size_t k) {
  const Eigen::Index joints = r.targets.rows() - 7;
  f.targets[k].leftCols(f.end).bottomRows(joints) = r.targets.leftCols(f.end).bottomRows(joints);
}

/// Eq. 8's frequencies are the clip's own.
control::RunningSearch for_gait(control::RunningSearch p, const Body& body) {
  p.run.frequency = {2 / body.narrow.table.duration(), body.narrow.table.speed()};
  return p;
}

}  // namespace

Effort Effort::of(bool quick, std::uint64_t seed) {
  Effort e;
  e.gait.run.seed = e.running.run.seed = seed;
  // Who runs a course turns in the middle of a run, whichever foot is next.
  e.gait.run.either_foot = e.running.run.either_foot = true;
  // And every step is at another speed, from wherever the one before led.
  e.gait.run.push = 0.1;
  e.gait.run.wander = {1 * degree, 0.15};
  e.running.run.push = 0.2;
  e.running.run.wander = {1 * degree, 0.3};
  e.hardest_push = 0.3;
  e.hardest_wander = {2 * degree, 0.5};
  e.gait.good_cost = 1.0;
  e.gait.generations = 120;
  e.gait.starts = 4;
  e.running.good_cost = 1.0;
  e.running.generations = 60;
  // The reference's clock and size stay while the gait itself is learned.
  e.gait.alpha_scale = e.gait.beta_scale = 1e-7;
  e.turns = spaced(0, 6, 4);
  e.speeds = spaced(2, 5, 7);
  e.running.starts = 8;
  for (const Kind kind : {Kind::jump, Kind::vault}) {
    e.kinds[index_of(kind)].refined_below = 0.95;
    e.kinds[index_of(kind)].refined_longer_below = 0.9;
  }
  e.wider = {{0.1, {0.5 * degree, 0.15}, 400000}};
  const auto family = [&](Kind kind, double first, double last, int plans_at) {
    constexpr double every = 0.05;  // m
    ManoeuvreEffort& m = e.kinds[index_of(kind)];
    m.family_heights = spaced(first, last, plans_at);
    m.round_heights = spaced(first, last, std::min(8, core::lane_count<Lane>));
    m.heights = spaced(first, last, 1 + static_cast<int>(std::lround((last - first) / every)));
    m.first_height = m.heights[m.heights.size() / 2];
  };
  family(Kind::jump, 0.1, 0.7, 7);
  // Above that, what lies between two of them would be like neither.
  std::vector<double>& steps = e.kinds[index_of(Kind::jump)].family_heights;
  steps.insert(steps.end() - 1, 0.65);
  family(Kind::vault, 0.6, 1.0, 9);
  family(Kind::drop, 0.9, 2.0, 12);
  e.clearing.seed = e.practice.seed = seed;
  e.practice.rounds = 5;
  e.practice.rank = 12;
  // States of courses are as they are; what is not steady after so many steps falls later.
  e.clearing.place = 0.1;
  e.clearing.velocity = 0.1;
  e.clearing.steps_after = 10;
  e.clearing.settle = 1;
  if (quick) {
    e.turns = {0, 1, 2};
    e.speeds = {3.25, 3.5, 3.75};
    e.running.starts = 4;
    e.running_evaluations = 2000;
    e.wider[0].evaluations = 2500;
    e.hardest_push = e.running.run.push;
    e.hardest_wander = e.running.run.wander;
    for (ManoeuvreEffort& k : e.kinds) {
      k.family_heights = k.heights = {k.family_heights[0], k.family_heights[1]};
      k.round_heights = {k.heights[0]};
      k.first_height = k.heights[0];
      k.sampling_rounds = 2;
      k.plans = 1;
      k.most_error = 10;
      k.share = 0;
    }
    e.practice.rounds = 1;
    e.refinement.generations = 1;
    e.practice.rollouts = e.practice.trials = 64;
    e.clearing_trials = 16;
    e.round_generations = e.recovery_generations = 10;
    e.arrival_courses = e.choice_courses = 16;
    e.clearing.place = e.clearing.velocity = 0.05;
    e.clearing.steps_after = 2;
    e.gait.generations = e.running.generations = 20;
    e.max_attempts = 1;
  }
  return e;
}

Trainer::Trainer(const sim::Model& model, const control::Roles& roles, const Effort& effort, std::filesystem::path folder, int threads,
                 Progress progress)
    : model_(model), roles_(roles), effort_(effort), folder_(std::move(folder)), executor_(threads), progress_(std::move(progress)) {}

control::Controller Trainer::make_gait(const control::Controller& from) {
  const Body body(model_, roles_, from);
  control::RunningTrials<Lane> trials(model_, roles_, from.simulation, flat_, from, body.narrow);
  const double speed = std::round(4 * body.narrow.table.speed()) / 4;
  const control::RunningSearch p = for_gait(effort_.gait, body);
  const control::RunningFound found =
      control::search_running(trials, body.narrow.shape, {0, speed}, body.narrow.shape.neutral(from.law), p);
  if (!found.works) throw Error("gait: it cannot be run at " + std::to_string(speed) + " m/s");
  progress_("gait", text("runs at %.2f m/s, cost %.3g after %d generations", speed, found.judgement.cost, found.generations));
  control::RunningSettings e = p.run;
  e.perturbation = 0.3;
  e.push = 0;
  e.wander = {};
  control::Controller gait = control::resimulated(trials, model_, roles_, from, body.narrow, found.control, speed, e);
  write_gait(folder_, gait);
  return gait;
}

Continuation Trainer::learn_running(const control::Controller& gait, std::optional<Continuation> from) {
  const Body body(model_, roles_, gait);
  const control::AffineShape& shape = body.narrow.shape;
  const control::RunningSearch p = for_gait(effort_.running, body);
  if (!from) {
    control::RunningTrials<Lane> trials(model_, roles_, gait.simulation, flat_, gait, body.narrow);
    const control::RunningTask seed{0, body.narrow.table.speed()};
    // Everything else starts from this one, so it is made to stand more than the others are asked to.
    control::RunningSearch first = p;
    first.good_cost = 0;
    control::RunningFound found = control::search_running(trials, shape, seed, shape.neutral(gait.law), first);
    progress_("running", text("%.2f m/s: %.0f %% of disturbed runs", seed.speed, 100 * found.judgement.share));
    first.run.push = effort_.hardest_push;
    first.run.wander = effort_.hardest_wander;
    if (!interruption_asked()) found = control::search_running(trials, shape, seed, found.control, first);
    if (interruption_asked()) throw Interrupted{};
    progress_("running", text("%.2f m/s: %.0f %% of runs as disturbed as can be", seed.speed, 100 * found.judgement.share));
    if (!found.works) throw Error("running: the gait does not hold at its own speed");
    parameterize::ContinuationParameters grid;
    grid.axes = {to_vector(effort_.turns), to_vector(effort_.speeds)};
    grid.unit = to_vector({6, 1.5});
    grid.max_attempts = effort_.max_attempts;
    const double near = std::round(2 * seed.speed) / 2;
    from.emplace(grid, Eigen::Vector2d(0, near), found.control);
  }
  return spread_running(gait, body, std::move(*from), p, effort_.running_evaluations, "running");
}

Continuation Trainer::widen_running(const control::Controller& gait, Continuation from, int step) {
  const Body body(model_, roles_, gait);
  const Effort::Wider& wider = effort_.wider[static_cast<std::size_t>(step)];
  control::RunningSearch p = for_gait(effort_.running, body);
  p.run.push = wider.push;
  p.run.wander = wider.wander;
  return spread_running(gait, body, std::move(from), p, wider.evaluations, wider_name(step));
}

Continuation Trainer::spread_running(const control::Controller& gait, const Body& body, Continuation c, const control::RunningSearch& p,
                                     std::int64_t evaluations, const std::string& file) {
  const control::AffineShape& shape = body.narrow.shape;
  auto trials = per_worker<control::RunningTrials<Lane>>(executor_.concurrency(), [&] {
    return std::make_unique<control::RunningTrials<Lane>>(model_, roles_, gait.simulation, flat_, gait, body.narrow);
  });
  const auto solve = [&](const ContinuationTask& t, int worker) {
    if (interruption_asked()) return ContinuationResult{};
    const control::RunningTask task{t.parameter[0] * degree, t.parameter[1]};
    ContinuationResult r;
    if (t.kind == ContinuationTask::Kind::test) {
      const Eigen::VectorXd x = task.turn == 0 ? shape.symmetric(t.control) : t.control;
      const control::RunningJudgement j = control::judge_running(trials[worker], task, x, p, p.trials, 1);
      r.works = j.share >= p.least_share;
      r.cost = j.cost;
      r.evaluations = j.runs;
    } else {
      const control::RunningFound found = control::search_running(trials[worker], shape, task, t.control, p);
      r.works = found.works;
      r.control = found.control;
      r.cost = found.judgement.cost;
      r.evaluations = found.runs;
    }
    return r;
  };
  std::vector<ContinuationResult> results;
  while (!c.finished() && c.evaluations() < evaluations) {
    const auto& tasks = c.ask();
    results.assign(tasks.size(), {});
    executor_.run(static_cast<int>(tasks.size()), [&](int i, int worker) {
      results[static_cast<std::size_t>(i)] = solve(tasks[static_cast<std::size_t>(i)], worker);
    });
    // What was cut short must not count.
    if (interruption_asked()) throw Interrupted{};
    c.tell(results);
    write_stage(folder_, file.c_str(), c);
    if (on_range) on_range(c);
    progress_(file.c_str(), text("%.0f %% of the range, %ld runs", 100 * c.coverage(), static_cast<long>(c.evaluations())));
  }
  return c;
}

GaitEvents Trainer::watch(const control::Controller& gait, const Continuation& running) {
  const Body body(model_, roles_, gait);
  const double speed = body.narrow.table.speed();
  const Eigen::VectorXd x = RunningModel(running, body.narrow.shape, body.wide.shape)({0, speed});
  control::RunningTrials<Lane> trials(model_, roles_, body.gait.simulation, flat_, body.gait, body.wide);
  const int n = body.gait.ticks();
  std::vector<std::array<int, 2>> down(static_cast<std::size_t>(n), {0, 0});
  control::RunningSettings e;
  e.cycles = 10;
  const auto observe = [&](int tick, const sim::Lanes<Lane>& lanes, const auto& players) {
    if (tick < n * e.cycles / 2) return;
    for (int l = 0; l < core::lane_count<Lane>; ++l) {
      const auto t = static_cast<std::size_t>(body.wide.table.tick_of(players[static_cast<std::size_t>(l)].phase() - 0.5));
      for (std::size_t side = 0; side < 2; ++side) {
        const int foot = roles_.legs[side].foot;
        down[t][side] += core::lane_of(lanes.body_force()[static_cast<std::size_t>(foot)].z, l) > 20.0F;
      }
    }
  };
  trials.run(
      e, core::lane_count<Lane>, [&](int) { return x.data(); }, [&](int) { return control::RunningTask{0, speed}; }, [](int l) { return l; },
      observe);
  const auto half = [&](std::size_t side) {
    int most = 0;
    for (const auto& d : down) most = std::max(most, d[side]);
    return most / 2;
  };
  const std::array<int, 2> enough{half(0), half(1)};
  GaitEvents events;
  for (int t = 0; t < n; ++t) {
    const auto before = static_cast<std::size_t>((t + n - 1) % n), now = static_cast<std::size_t>(t);
    if (down[before][0] > enough[0] && down[now][0] <= enough[0]) events.right_take_off = t;
    if (down[before][1] <= enough[1] && down[now][1] > enough[1]) events.left_landing = t;
  }
  return events;
}

control::Controller Trainer::steady_running(const Body& body, const Eigen::VectorXd& control, double speed) {
  control::RunningTrials<Lane> trials(model_, roles_, body.gait.simulation, flat_, body.gait, body.wide);
  control::RunningSettings e;
  e.cycles = 10;
  e.seed = effort_.running.run.seed;
  e.stream = state_stream;
  // As courses have them: after steps at other speeds, and not quite straight.
  e.push = 0.5 * effort_.running.run.push;
  e.wander = effort_.running.run.wander;
  return control::resimulated(trials, model_, roles_, body.gait, body.wide, control, speed, e);
}

Trainer::OnCourses Trainer::run_courses(Kind kind, const RunningModel& running, const Body& body, const ManoeuvreModel& manoeuvre,
                                        const plan::StepLength<double>& length, int obstacles, int count, std::uint64_t first) {
  constexpr int width = core::lane_count<Lane>;
  const ManoeuvreEffort& effort = effort_.kinds[index_of(kind)];
  CourseShape shape;
  shape.obstacles = obstacles;
  shape.kinds = {kind};
  shape.heights[index_of(kind)] = {effort.round_heights.front(), effort.round_heights.back()};
  CourseSettings settings;
  settings.seed = effort_.clearing.seed;
  OfKinds<ManoeuvreModel> models;
  models[index_of(kind)] = manoeuvre;
  const CourseRunner runner(body, running, models, length, settings);
  std::vector<OnCourses> groups(static_cast<std::size_t>(count / width));
  executor_.run(count / width, [&](int g, int) {
    if (interruption_asked()) return;
    OnCourses& mine = groups[static_cast<std::size_t>(g)];
    const std::uint64_t number = course_stream + first + static_cast<std::uint64_t>(g * width);
    std::vector<Course> courses;
    for (int i = 0; i < width; ++i) courses.push_back(random_course(shape, settings.seed, number + static_cast<std::uint64_t>(i)));
    CourseRunner own = runner;
    for (const CourseOutcome& o : own.run(courses, number, nullptr, &mine.arrivals)) mine.cleared += o.cleared;
  });
  if (interruption_asked()) throw Interrupted{};
  OnCourses out;
  for (OnCourses& g : groups) {
    out.cleared += g.cleared;
    for (control::RunningState& state : g.arrivals) out.arrivals.push_back(std::move(state));
  }
  return out;
}

std::vector<control::RunningState> Trainer::arrivals(Kind kind, const RunningModel& running, const Body& body, const ManoeuvreModel& manoeuvre,
                                                     const plan::StepLength<double>& length, std::uint64_t first) {
  OnCourses found = run_courses(kind, running, body, manoeuvre, length, 4, effort_.arrival_courses, first);
  if (found.arrivals.empty()) throw Error(std::string(name_of(kind)) + ": no runner gets to an obstacle");
  return std::move(found.arrivals);
}

RegulatedStarts Trainer::regulated_starts(Kind kind, const RunningModel& running, const Body& body, const MotionFamily& first,
                                          const plan::StepLength<double>& length) {
  // Where a manoeuvre begins is all one to what comes of it, so that any motion does to see that.
  Body with(body);
  with.add_family(kind, first);
  // Files hold poses in fewer digits than the plan had when it was first asked.
  if (first.plan_offsets.size() > 0) with.skills[index_of(kind)].distance = first.plan_distance;
  const ManoeuvreNumbers& n = with.skill(kind).numbers;
  Eigen::VectorXd x = Eigen::VectorXd::Zero(n.size());
  x[n.beta()] = 1;
  const auto begins = [&] {
    OnCourses found = run_courses(kind, running, with, [&](double) { return x; }, length, 1, 4 * effort_.arrival_courses, 0);
    if (found.arrivals.empty()) throw Error(std::string(name_of(kind)) + ": no runner gets to an obstacle");
    return std::move(found.arrivals);
  };
  const auto off = begins();
  for (const control::RunningState& state : off) x[n.distance()] += state.off / static_cast<double>(off.size());
  RegulatedStarts starts;
  starts.states = begins();
  starts.distance = with.skill(kind).distance + x[n.distance()];
  starts.place = effort_.clearing.place;
  starts.velocity = effort_.clearing.velocity;
  starts.joint_angle = 0;
  starts.slide = slide_of(kind);
  return starts;
}

MotionFamily Trainer::sample_family(Kind kind, const RunningModel& running, const Body& body, const Measured& measured, std::optional<MotionFamily> from) {
  const ManoeuvreEffort& effort = effort_.kinds[index_of(kind)];
  const control::Controller& gait = body.gait;
  const fs::path path = folder_ / (std::string(name_of(kind)) + ".safetensors");
  // It begins and ends as runners on courses are, which is not quite as the gait's own reference is.
  const double speed = body.wide.table.speed();
  const Eigen::VectorXd control = running({0, speed});
  const control::Controller steady = steady_running(body, control, speed);
  GaitClock clock(model_, steady, measured.events);
  clock.rate = 1 / control[body.wide.shape.beta()];
  control::SamplingParameters p;
  p.steps_per_tick = gait.steps_per_tick;
  p.seed = effort_.clearing.seed;
  p.rounds = effort.sampling_rounds;
  // What comes after a landing cannot be searched before there is one.
  p.horizon = 10;
  p.stride = 4;
  control::TrackingCostWeights w;
  w.center_velocity = 3;
  w.root_rotation = 10;
  w.root_angular_velocity = 0.2;
  const control::TrackingCost cost(model_, roles_, control::tracked_points(model_, roles_), w);
  std::optional<RegulatedStarts> starts;
  double first_distance = 0;
  MotionFamily f = from ? std::move(*from) : MotionFamily{};
  if (!f.heights.empty()) starts = regulated_starts(kind, running, body, f, measured.length);
  for (std::size_t k = f.heights.size(); k < effort.family_heights.size(); ++k) {
    const double h = effort.family_heights[k];
    Authored a = author(kind, model_, roles_, clock, h);
    a.reference.velocities.col(0) = steady.reference.velocities.col(clock.left_step);
    control::measure_reference(model_, roles_, cost.points(), a.reference);
    const control::Hurdle hurdle = hurdle_of(kind, h, a.depth);
    const ClearingAid aid(model_, roles_, hurdle, a.hold_from, a.hold_to);
    p.targets = a.targets;
    // The next height is sought around the one before, or what lies between them would be like neither.
    p.offsets = f.plan_offsets;
    const control::SamplingParameters narrow = narrowed(p);
    const auto ground = ground_of(hurdle);
    MotionFamily one;
    one.heights = {h};
    one.stance = a.stance;
    one.phase = a.phase;
    one.parts = a.parts;
    one.end = a.end;
    one.placed = a.placed;
    one.hold_from = a.hold_from;
    one.hold_to = a.hold_to;
    one.depth = a.depth;
    if (k == 0) {
      f = one;
      f.heights.clear();
    }
    // Plans that end alike differ in how well they can be kept to: of some the best is taken.
    control::PractisedRegulator best;
    best.share = -1;
    MotionFamily best_one;
    Eigen::MatrixXd offsets;
    for (int plan = 0; plan < effort.plans && best.share < effort.good_plan; ++plan) {
      // Where nothing does near the one before, it is sought farther away.
      const bool near = k > 0 && (best.share >= 0 || plan < effort.plans / 2);
      control::SamplingParameters of_plan = near ? narrow : p;
      of_plan.seed = effort_.clearing.seed + static_cast<std::uint64_t>(plan);
      const control::SampledControl s = control::sample_control<Lane>(
          model_, gait.simulation, ground, cost, a.reference, of_plan, executor_, [](int, double) { return !interruption_asked(); }, aid);
      if (interruption_asked()) throw Interrupted{};
      one.targets = {s.targets};
      one.poses = {s.poses};
      one.velocities = {s.velocities};
      if (s.mean_joint_error > effort.most_error) {
        progress_(name_of(kind), text("over %.2f m, plan %d: joints %.1f cm off what was meant, which is too much", h, plan + 1, 100 * s.mean_joint_error));
        continue;
      }
      if (!starts) {
        starts = regulated_starts(kind, running, body, one, measured.length);
        first_distance = -one.controller(model_, roles_, gait, 0).reference.center_of_mass(0, 0);
      }
      const control::PractisedRegulator r = practise({&model_, roles_, &gait, hurdle, &one, 0, &*starts}, effort_.practice, executor_);
      if (interruption_asked()) throw Interrupted{};
      progress_(name_of(kind), text("over %.2f m, plan %d: joints %.1f cm off what was meant, kept to from %.0f %% of starts after %d rounds of practice", h, plan + 1,
                                    100 * s.mean_joint_error, 100 * r.share, r.round));
      if (r.share <= best.share) continue;
      best = r;
      best_one = one;
      offsets = s.offsets;
    }
    if (best.share < 0 && k == 0) throw Error(std::string(name_of(kind)) + ": no plan gets over " + text("%.2f m", h));
    if (best.share < 0) {
      progress_(name_of(kind), text("no plan gets over %.2f m", h));
      f.plan_offsets = {};
      write_family(path, f);
      return f;
    }
    if (best.share < effort.refined_below) {
      const control::RefinedTargets r =
          refine({&model_, roles_, &gait, hurdle, &best_one, 0, &*starts}, best.gains, effort_.practice, effort_.refinement, executor_);
      if (interruption_asked()) throw Interrupted{};
      progress_(name_of(kind), text("over %.2f m: kept to from %.0f %% of starts after %d generations of refinement", h, 100 * r.share, r.generation));
      put_targets(r, best_one, 0);
    }
    f.heights.push_back(h);
    f.targets.push_back(best_one.targets[0]);
    f.poses.push_back(best_one.poses[0]);
    f.velocities.push_back(best_one.velocities[0]);
    f.gains.push_back(best.gains);
    if (k == 0) f.plan_distance = first_distance;
    // As long as there are any, the family is not done.
    f.plan_offsets = offsets;
    write_family(path, f);
    // What goes on is what a resumed job would read.
    f = read_family(path, model_);
  }
  // The next height was not to wait for it.
  control::RefinementSettings none = effort_.refinement, longer = none;
  none.generations = 0;
  longer.generations *= 3;
  for (std::size_t k = 0; k < f.heights.size() && effort.refined_longer_below > 0; ++k) {
    const Regulated of{&model_, roles_, &gait, hurdle_of(kind, f.heights[k], f.depth), &f, k, &*starts};
    if (refine(of, f.gains[k], effort_.practice, none, executor_).share >= effort.refined_longer_below) continue;
    const control::RefinedTargets r = refine(of, f.gains[k], effort_.practice, longer, executor_);
    if (interruption_asked()) throw Interrupted{};
    progress_(name_of(kind), text("over %.2f m: kept to from %.0f %% of starts after %d generations more", f.heights[k], 100 * r.share, r.generation));
    put_targets(r, f, k);
  }
  f.plan_offsets = {};
  write_family(path, f);
  return read_family(path, model_);
}

/// Trials of one way to clear obstacles of several heights, many at a time.
class Trainer::Trials {
public:
  static constexpr int width = core::lane_count<Lane>;
  using Clearing = control::ClearingTrials<Lane>;

  /// There are 1, 2, 4 or 8 heights (m), for numbers of starts that are multiples of them. All must outlive it.
  Trials(Trainer& owner, const RunningModel& running, const Body& body, Kind kind, std::vector<double> heights,
         std::vector<control::RunningState> states, const control::ClearingSettings& trial)
      : settings(trial), skill_(&body.skill(kind)), heights_(std::move(heights)), executor_(owner.executor_), states_(std::move(states)), running_(&running),
        workers_(static_cast<std::size_t>(executor_.concurrency())) {
    if (width % heights_.size() != 0) throw Error("manoeuvre: expected a number of heights that divides " + std::to_string(width));
    settings.follow_reference = true;
    settings.uncleared = 4;
    for (const double h : heights_) grounds_.push_back(ground_of(skill_->hurdle(h)));
    make_ = [this, &owner, &body] {
      const control::Controller& gait = body.gait;
      auto t = std::make_unique<Clearing>(owner.model_, owner.roles_, gait.simulation, grounds_[0], skill_->hurdle(heights_[0]), gait.tick,
                                          gait.steps_per_tick, body.wide);
      for (int l = 0; l < width; ++l) t->place(l, grounds_[height_of(l)], skill_->hurdle(heights_[height_of(l)]));
      return t;
    };
  }

  const std::vector<double>& heights() const { return heights_; }
  const ObstacleSkill& skill() const { return *skill_; }
  /// Starts of `per` of each candidate, numbered from `first`: `manoeuvre(candidate, height)`.
  template <class Of>
  std::vector<control::ClearingOutcome> run(int candidates, int per, std::uint64_t stream, Of&& manoeuvre) {
    const int jobs = candidates * per, groups = (jobs + width - 1) / width;
    control::ClearingSettings e = settings;
    e.stream = stream;
    std::vector<control::ClearingOutcome> out(static_cast<std::size_t>(jobs));
    executor_.run(groups, [&](int g, int worker) {
      auto& trials = workers_[static_cast<std::size_t>(worker)];
      if (!trials) trials = make_();
      const int first = g * width, used = std::min(width, jobs - first);
      const auto result = trials->run(
          e, used, [&](int l) -> const control::Manoeuvre& { return manoeuvre((first + l) / per, static_cast<int>(height_of(l))); },
          [&](int l) { return (first + l) % per; }, states_, [&](double v) { return (*running_)({0, v}); });
      for (int l = 0; l < used; ++l) out[static_cast<std::size_t>(first + l)] = result[static_cast<std::size_t>(l)];
    });
    return out;
  }

  control::ClearingSettings settings;

private:
  std::size_t height_of(int lane) const { return static_cast<std::size_t>(lane) % heights_.size(); }

  const ObstacleSkill* skill_;
  std::vector<double> heights_;
  std::vector<sim::Ground<float>> grounds_;
  core::ThreadExecutor& executor_;
  std::vector<control::RunningState> states_;
  const RunningModel* running_;
  std::function<std::unique_ptr<Clearing>()> make_;
  std::vector<std::unique_ptr<Clearing>> workers_;
};

/// What is searched, and how long.
struct Trainer::Search {
  Eigen::VectorXd begin;
  double share = 0;          ///< of trials that must do what is asked for
  std::vector<int> free;     ///< which of its numbers
  int starts = 4, generations = 80;
  double sigma = 0.4;
  std::uint64_t seed = 1;
};

Trainer::Found Trainer::search(Trials& trials, const Search& s) {
  const ManoeuvreNumbers& n = trials.skill().numbers;
  const std::vector<double>& heights = trials.heights();
  const int population = effort_.clearing_population;
  const auto free = static_cast<Eigen::Index>(s.free.size());
  const auto whole = [&](const Eigen::VectorXd& part) {
    Eigen::VectorXd x = s.begin;
    for (Eigen::Index i = 0; i < free; ++i) x[s.free[static_cast<std::size_t>(i)]] = part[i];
    return x;
  };
  const auto manoeuvres = [&](const Eigen::VectorXd& x, std::vector<control::Manoeuvre>& out) {
    for (const double h : heights) out.push_back(trials.skill().manoeuvre(x, h));
  };
  optimize::CmaEsParameters cp;
  cp.population = population;
  cp.sigma = s.sigma;
  cp.seed = s.seed;
  cp.tolerance_cost = 0;
  cp.tolerance_x = 0;
  Eigen::VectorXd scale = Eigen::VectorXd::Constant(n.size(), 0.08), begin(free);
  scale.head(n.laws()).setConstant(0.03);
  scale[n.beta()] = 0.03;
  scale[n.distance()] = 0.1;
  scale.segment(n.recovery(), n.running.law.size()).setConstant(0.03);
  scale.tail(n.recoveries() - n.running.law.size()).setConstant(0.05);
  cp.scale.resize(free);
  for (Eigen::Index i = 0; i < free; ++i) {
    cp.scale[i] = scale[s.free[static_cast<std::size_t>(i)]];
    begin[i] = s.begin[s.free[static_cast<std::size_t>(i)]];
  }
  Found r;
  double best = std::numeric_limits<double>::infinity();
  bool done = false;
  const auto consider = [&](const Eigen::VectorXd& x) {
    std::vector<control::Manoeuvre> m;
    manoeuvres(x, m);
    double cost = 0;
    int good = 0;
    for (const auto& o : trials.run(1, effort_.clearing_trials, 1, [&](int, int h) -> const control::Manoeuvre& { return m[static_cast<std::size_t>(h)]; })) {
      cost += o.cost / effort_.clearing_trials;
      good += o.survived && o.cleared;
    }
    r.evaluations += effort_.clearing_trials;
    if (cost >= best) return;
    best = r.cost = cost;
    r.control = x;
    r.works = good >= s.share * effort_.clearing_trials;
    r.share = static_cast<double>(good) / effort_.clearing_trials;
    done = good == effort_.clearing_trials && cost < effort_.clearing_good_cost;
  };
  consider(s.begin);
  if (s.generations == 0) return r;
  optimize::CmaEs cma(begin, cp);
  Eigen::VectorXd costs(population);
  std::vector<control::Manoeuvre> m;
  for (int g = 0; g < s.generations && !done && !interruption_asked(); ++g) {
    const Eigen::MatrixXd& x = cma.ask();
    m.clear();
    for (int k = 0; k < population; ++k) manoeuvres(whole(x.col(k)), m);
    const auto out = trials.run(population, s.starts, 1000 + static_cast<std::uint64_t>(g), [&](int k, int h) -> const control::Manoeuvre& {
      return m[static_cast<std::size_t>(k) * heights.size() + static_cast<std::size_t>(h)];
    });
    costs.setZero();
    for (std::size_t i = 0; i < out.size(); ++i) {
      costs[static_cast<Eigen::Index>(i) / s.starts] += out[i].cost / s.starts;
    }
    r.evaluations += static_cast<std::int64_t>(out.size());
    cma.tell(costs);
    if (g % 10 == 9) consider(whole(cma.mean()));
  }
  return r;
}

Continuation Trainer::learn_clearing(Kind kind, const RunningModel& running, const Body& body, const plan::StepLength<double>& length,
                                     std::optional<Continuation> from) {
  const ObstacleSkill& skill = body.skill(kind);
  const ManoeuvreNumbers& n = skill.numbers;
  const ManoeuvreEffort& effort = effort_.kinds[index_of(kind)];
  const char* const name = name_of(kind);
  const auto range = [](int first, int count) {
    std::vector<int> out(static_cast<std::size_t>(count));
    std::iota(out.begin(), out.end(), first);
    return out;
  };
  const auto check = [&] {
    if (interruption_asked()) throw Interrupted{};
  };
  const double h = effort.first_height;
  // A regulator keeps it on its way already: a law has but to learn what is left.
  Eigen::VectorXd x = Eigen::VectorXd::Zero(n.size());
  x[n.beta()] = 1;
  // What was learned already is improved.
  const bool known = from && from->parameters().axes[0] != to_vector(effort.heights);
  if (known) x = from->model()(Eigen::VectorXd::Constant(1, h));
  if (!from || known) {
    // Trials end ten steps after a manoeuvre, courses do not, and what is better in one may be worse in the other: of what the
    // rounds lead to, with transOut's own numbers and without, that is kept which clears most obstacles of courses.
    Eigen::VectorXd best;
    int most = -1;
    const auto on_courses = [&](const Eigen::VectorXd& candidate) {
      const OnCourses r = run_courses(kind, running, body, [&](double) { return candidate; }, length, 10, effort_.choice_courses, choice_stream);
      if (r.cleared > most) {
        most = r.cleared;
        best = candidate;
      }
      return r;
    };
    const auto begins = [&](int round) {
      return arrivals(kind, running, body, [&](double) { return x; }, length, static_cast<std::uint64_t>(round * effort_.arrival_courses));
    };
    // A simulated motion has its place before the obstacle, and runners tend to begin before they are there.
    const auto off = begins(0);
    for (const control::RunningState& state : off) x[n.distance()] += state.off / static_cast<double>(off.size());
    progress_(name, text("on %d courses of ten %d obstacles cleared by the regulator alone", effort_.choice_courses, on_courses(x).cleared));
    for (int round = 0; round < effort.rounds; ++round) {
      const auto found = begins(round);
      Trials trials(*this, running, body, kind, effort.round_heights, found, effort_.clearing);
      const auto improve = [&](const char* what, std::vector<int> free, int generations) {
        const Found r = search(
            trials, {x, 0, std::move(free), effort_.round_starts, generations, effort_.clearing_sigma, effort_.clearing.seed + 10 + static_cast<std::uint64_t>(round)});
        check();
        x = r.control;
        progress_(name, text("round %d, %s, from %d states: cost %.3g, %.0f %% of trials", round + 1, what, static_cast<int>(found.size()), r.cost, 100 * r.share));
      };
      // Offsets would lead elsewhere what a regulator keeps on its way.
      improve("manoeuvre", range(0, n.laws()), effort_.round_generations);
      Eigen::VectorXd plain = x;
      plain.segment(n.recovery(), n.recoveries()).setZero();
      const OnCourses without = on_courses(plain);
      improve("transOut", range(n.recovery(), n.recoveries()), effort_.recovery_generations);
      const OnCourses with = on_courses(x);
      progress_(name, text("round %d: on %d courses of ten %d obstacles cleared, %d without transOut's own numbers", round + 1, effort_.choice_courses, with.cleared, without.cleared));
    }
    x = best;
    parameterize::ContinuationParameters grid;
    grid.axes = {to_vector(effort.heights)};
    grid.max_attempts = 1;
    from.emplace(grid, Eigen::VectorXd::Constant(1, h), x);
    write_stage(folder_, name, *from);
  }
  Continuation c = std::move(*from);
  const auto found = arrivals(kind, running, body, manoeuvre_model(c), length, static_cast<std::uint64_t>(effort.rounds * effort_.arrival_courses));
  std::vector<ContinuationResult> results;
  while (!c.finished()) {
    const auto& tasks = c.ask();
    results.assign(tasks.size(), {});
    for (std::size_t i = 0; i < tasks.size(); ++i) {
      const ContinuationTask& t = tasks[i];
      Trials trials(*this, running, body, kind, {t.parameter[0]}, found, effort_.clearing);
      // The law stays as it is, so that it does for what lies between as well.
      results[i] = search(trials, {t.control, effort.share, {}, effort_.round_starts, 0, effort_.clearing_sigma, effort_.clearing.seed});
      check();
    }
    c.tell(results);
    write_stage(folder_, name, c);
    progress_(name, text("%.0f %% of the range, %ld trials", 100 * c.coverage(), static_cast<long>(c.evaluations())));
  }
  return c;
}

std::vector<NodeResult> Trainer::test_running(const control::Controller& gait, const Continuation& c, int count, double most_turn, bool disturbed) {
  const Body body(model_, roles_, gait);
  control::RunningSearch p = for_gait(effort_.running, body);
  if (!disturbed) {
    p.run.push = 0;
    p.run.wander = {};
  }
  auto trials = per_worker<control::RunningTrials<Lane>>(executor_.concurrency(), [&] {
    return std::make_unique<control::RunningTrials<Lane>>(model_, roles_, gait.simulation, flat_, gait, body.wide);
  });
  const RunningModel running(c, body.narrow.shape, body.wide.shape);
  std::vector<NodeResult> out;
  for (int node = 0; node < c.node_count(); ++node) {
    const Eigen::VectorXd theta = c.parameter(node);
    if (theta[0] > most_turn) continue;
    for (const double sign : {1.0, -1.0})
      if (sign > 0 || theta[0] > 0) out.push_back({{sign * theta[0] * degree, theta[1]}, c.status(node), {}});
  }
  executor_.run(static_cast<int>(out.size()), [&](int i, int worker) {
    NodeResult& r = out[static_cast<std::size_t>(i)];
    r.judgement = control::judge_running(trials[worker], r.task, running(r.task), p, count, test_stream);
  });
  return out;
}

std::vector<ClearingResult> Trainer::test_clearing(Kind kind, const RunningModel& running, const Body& body, const ManoeuvreModel& manoeuvre,
                                                   const plan::StepLength<double>& length, const std::vector<double>& heights, int count) {
  const auto starts = arrivals(kind, running, body, manoeuvre, length, 1000000);
  std::vector<ClearingResult> out;
  for (const double h : heights) {
    Trials trials(*this, running, body, kind, {h}, starts, effort_.clearing);
    const control::Manoeuvre m = body.skill(kind).manoeuvre(manoeuvre(h), h);
    ClearingResult r;
    r.height = h;
    r.trials = count;
    for (const auto& o : trials.run(1, count, test_stream, [&](int, int) -> const control::Manoeuvre& { return m; })) {
      r.survived += o.survived;
      r.cleared += o.survived && o.cleared;
      r.exit_speed += o.survived ? o.exit_speed : 0;
    }
    if (r.survived > 0) r.exit_speed /= r.survived;
    out.push_back(r);
  }
  return out;
}

plan::StepLength<double> Trainer::step_length(const std::vector<NodeResult>& nodes) const {
  std::vector<double> speeds, lengths;
  for (const NodeResult& n : nodes)
    if (n.judgement.share > 0.5) {
      speeds.push_back(n.judgement.speed);
      lengths.push_back(n.judgement.step_length);
    }
  return plan::StepLength<double>::fit(speeds, lengths);
}

}  // namespace terrain_runner
