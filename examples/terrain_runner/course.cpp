// SPDX-License-Identifier: MIT
#include "course.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "../common/lane.hpp"
#include "traceur/control/composition.hpp"
#include "traceur/core/error.hpp"

namespace terrain_runner {

using namespace traceur;
using example::Lane;

namespace {

constexpr double cell = 0.2;             // m, of the ground along the way
constexpr double slowest = 2.75, fastest = 4.5;  // m/s, what the planner may ask for
constexpr double least_load = 20;        // N, on a foot that is on the ground
constexpr int horizon = 13;              // steps; obstacles as far as this are not planned for
constexpr double slower_than_balanced = 0.6;     // m/s below cruising: still coming back to balance
constexpr double most_turn = 2 * std::numbers::pi / 180;  // rad per step, and over how far the way back to the middle leads,
constexpr double lookahead = 10;                          // m

/// The state of a lane in which a manoeuvre begins, in the mirror if it begins with a step on the right foot.
template <class Lane>
control::RunningState arrival(const sim::Model& model, const control::Roles& roles, const sim::Lanes<Lane>& lanes, int l,
                              const control::SkillPlayer& player, int side, double off) {
  control::RunningState s;
  s.pose.resize(model.nq);
  s.velocity.resize(model.nv);
  for (int i = 0; i < model.nq; ++i) s.pose[i] = core::lane_of(lanes.q()[i], l);
  for (int i = 0; i < model.nv; ++i) s.velocity[i] = core::lane_of(lanes.v()[i], l);
  body::normalize(model.character.skeleton, s.pose.data());
  const double x = core::lane_of(lanes.work().center_of_mass.x, l), y = core::lane_of(lanes.work().center_of_mass.y, l);
  s.frame = player.frame();
  s.pose[0] -= x;
  s.pose[1] -= y;
  s.pose[2] -= s.frame.z;
  s.frame.x -= x;
  s.frame.y -= y;
  s.frame.z = 0;
  s.speed = player.speed();
  s.off = off;
  if (side == 0) {
    s.pose = control::mirrored_pose(model, roles, s.pose);
    s.velocity = control::mirrored_tangent(model, roles, s.velocity);
    s.frame.y = -s.frame.y;
    s.frame.heading = -s.frame.heading;
  }
  return s;
}

/// Has an engine do what the lanes' grips began or ended to do.
template <class Lane>
void tell_grips(control::Engine<Lane>& engine, const sim::Lanes<Lane>& lanes, const std::array<sim::GripPoint, 2>& hands, int l, const std::array<bool, 2>& held) {
  for (std::size_t h = 0; h < 2; ++h) {
    const bool now = lanes.holds(l, static_cast<int>(h));
    if (now == held[h]) continue;
    const auto at = lanes.grip_place(static_cast<int>(h));
    if (now)
      engine.hold(l, hands[h], {core::lane_of(at.x, l), core::lane_of(at.y, l), core::lane_of(at.z, l)});
    else
      engine.release(l, hands[h]);
  }
}

}  // namespace

double Course::height(double x) const { return ground.height(x, 0); }

Course course_of(std::vector<CourseObstacle> obstacles, double depth) {
  const double before = 10, last = obstacles.empty() ? 0 : obstacles.back().x;
  const int cells = static_cast<int>((last + 2 * before) / cell) + 1;
  Eigen::MatrixXd heights = Eigen::MatrixXd::Zero(cells, 1);
  for (const CourseObstacle& o : obstacles) {
    const int from = static_cast<int>(std::lround((o.x + before) / cell));
    const int to = o.kind == Kind::vault ? from + static_cast<int>(std::lround(depth / cell)) : cells;
    for (int k = from; k < std::min(to, cells); ++k) heights(k, 0) += o.kind == Kind::drop ? -o.height : o.height;
  }
  return {std::move(obstacles), terrain::HeightGrid(heights, cell, -before, 0)};
}

Course random_course(const CourseShape& shape, std::uint64_t seed, std::uint64_t number) {
  if (shape.kinds.empty()) throw Error("course: expected a kind of obstacle");
  core::RandomStream random(seed, 4000, number);
  std::vector<CourseObstacle> obstacles;
  double x = 0;
  for (int i = 0; i < shape.obstacles; ++i) {
    x += std::round(random.uniform(shape.nearest, shape.farthest) / cell) * cell;
    const std::size_t which = shape.kinds.size() > 1 ? static_cast<std::size_t>(random.next_u32()) % shape.kinds.size() : 0;
    const Kind kind = shape.kinds[which];
    const auto& range = shape.heights[index_of(kind)];
    obstacles.push_back({kind, x, random.uniform(range[0], range[1])});
  }
  return course_of(std::move(obstacles), shape.depth);
}

struct CourseRunner::Runner {
  control::Composer composer;
  control::Manoeuvre manoeuvre{};
  bool alive = false;
  int next = 0;              ///< obstacle ahead
  double floor = 0;          ///< height of the ground that is run on, m
  double step_x = 0, step_seconds = 0, speed = 0;  ///< where the present step began, since when, and how fast the last was
  bool clearing = false;
  int since = -1;            ///< steps begun since the last manoeuvre
  Labels labels{};           ///< of the present manoeuvre
  double flight = 0;         ///< since when no foot was on the ground, s
  double asked = 0;          ///< speed of the present step, m/s
};

std::vector<double> learned_heights(const parameterize::Continuation& c) {
  std::vector<double> learned;
  for (int n = 0; n < c.node_count(); ++n)
    if (c.status(n) == parameterize::NodeStatus::solved) learned.push_back(c.parameter(n)[0]);
  return learned;
}

ManoeuvreModel manoeuvre_model(const parameterize::Continuation& c, bool interpolation) {
  return [rbf = c.model(), learned = learned_heights(c), interpolation](double height) -> Eigen::VectorXd {
    if (!interpolation)
      height = *std::min_element(learned.begin(), learned.end(),
                                 [&](double a, double b) { return std::abs(a - height) < std::abs(b - height); });
    return rbf(Eigen::VectorXd::Constant(1, height));
  };
}

CourseRunner::CourseRunner(const Body& body, const RunningModel& running, OfKinds<ManoeuvreModel> clearing, const plan::StepLength<double>& length,
                           const CourseSettings& settings)
    : body_(body), running_(running), settings_(settings), clearing_(std::move(clearing)), planner_([&] {
        plan::StepPlanner<double>::Parameters p;
        p.length = length;
        p.distance_weight = 4;
        p.most_steps = horizon;
        return plan::StepPlanner<double>(p);
      }()),
      direction_{most_turn, lookahead}, exit_(running({0, body.wide.table.speed()})) {}

void CourseRunner::decide(Runner& r, const Course& course, double x, double y, double speed_now) {
  control::Composer& c = r.composer;
  const double cruise = body_.wide.table.speed();
  double speed = cruise;
  // Straight ahead while balance comes back.
  const bool balancing = c.stage() == control::RunStage::trans_out || r.speed < cruise - slower_than_balanced;
  const double turn = balancing ? 0 : direction_.turn(c.player().frame().heading, 0, y);
  if (balancing) speed = control::ExitSpeed{}(speed_now, cruise);
  if (r.next < static_cast<int>(course.obstacles.size()) && c.stage() == control::RunStage::run) {
    const auto k = static_cast<std::size_t>(r.next);
    const CourseObstacle& o = course.obstacles[k];
    const ObstacleSkill& skill = body_.skill(o.kind);
    const double distance = o.x - x;
    r.manoeuvre = skill.manoeuvre(clearing_[index_of(o.kind)](o.height), o.height, c.side());
    if (!settings_.feedback) {
      r.manoeuvre.control.head(skill.numbers.laws()).setZero();
      r.manoeuvre.regulator = nullptr;
    }
    if (!settings_.recovery) r.manoeuvre.recovery.setZero();
    const plan::Approach<double> approach{r.manoeuvre.distance, r.manoeuvre.speed_in};
    // Runners are not quite as fast as they are asked to be, and planning from that alone asks ever less of them.
    const double now = r.asked > 0 ? 0.5 * (r.speed + r.asked) : r.speed;
    const int steps = planner_.steps(distance, now, approach);
    if (steps <= 0) {
      c.clear(r.manoeuvre, {0, o.x, y, r.floor}, x, y);
      r.clearing = true;
      r.labels = {o.kind, o.height};
      return;
    }
    // A plan begins at the speed of the last step, whatever that was; farther away running finds back to its own.
    if (settings_.planner && !balancing && steps < horizon)
      speed = std::clamp(planner_.plan(distance, now, approach, steps).speeds[0], slowest, fastest);
  }
  r.asked = speed;
  c.step(running_({turn, speed}), speed, turn);
}

std::vector<CourseOutcome> CourseRunner::run(const std::vector<Course>& courses, std::uint64_t first_number, CourseRecording* recording,
                                             std::vector<control::RunningState>* arrivals, example::Engine* engine) {
  return run_in<Lane>(courses, first_number, recording, arrivals, engine);
}

CourseOutcome CourseRunner::run_alone(const Course& course, std::uint64_t number, CourseRecording* recording) {
  return run_in<float>({course}, number, recording, nullptr, nullptr)[0];
}

template <class Lane>
std::vector<CourseOutcome> CourseRunner::run_in(const std::vector<Course>& courses, std::uint64_t first_number, CourseRecording* recording,
                                                std::vector<control::RunningState>* arrivals, control::Engine<Lane>* engine) {
  constexpr int width = core::lane_count<Lane>;
  const sim::Model& model = *body_.model;
  const int used = static_cast<int>(courses.size());
  if (used < 1 || used > width) throw Error("course runner: expected 1 to " + std::to_string(width) + " courses");
  const sim::Ground<float> flat;
  const auto hands = control::find_hands(model);
  sim::Extras extras;
  extras.grips.assign(hands.begin(), hands.end());
  sim::Lanes<Lane> lanes(model, body_.gait.simulation, flat, extras);
  control::Follower<Lane> follower(model, body_.roles, body_.wide.shape.law, body_.gait.limits);
  std::vector<Runner> runners;
  std::vector<CourseOutcome> out(courses.size());
  const double tick = body_.gait.tick, cruise = body_.wide.table.speed();
  for (int l = 0; l < width; ++l) {
    const auto k = static_cast<std::size_t>(std::min(l, used - 1));
    lanes.set_place(l, sim::Ground<float>(courses[k].ground), nullptr);
    const auto start = control::RunningStart::make(model, body_.gait, cruise, cruise, 0.5,
                                                   control::Perturbation{0.15, 0.03}, settings_.seed, 5000, first_number + k);
    control::RunningTrials<Lane>::put(lanes, model, l, start);
    if (l >= used) continue;
    runners.push_back({control::Composer(model, body_.wide, settings_.composition)});
    Runner& r = runners.back();
    r.alive = true;
    r.speed = cruise;
    const core::Vector3<double>& origin = body_.wide.table.start_center();
    r.composer.set_exit(exit_);
    r.composer.start(exit_, cruise, {0, origin.x, origin.y, 0}, 0);
    r.composer.step(exit_, cruise, 0);
    out[k].obstacles = static_cast<int>(courses[k].obstacles.size());
  }
  lanes.refresh();
  if (engine) engine->begin(lanes, used);
  std::array<bool, static_cast<std::size_t>(width)> wanted{};
  int living = used;
  const auto x_of = [&](int l) { return static_cast<double>(core::lane_of(lanes.work().center_of_mass.x, l)); };
  const auto y_of = [&](int l) { return static_cast<double>(core::lane_of(lanes.work().center_of_mass.y, l)); };
  std::array<Lane, control::full_sensors> ds;
  control::TrackingRegulator::Scratch scratch = control::TrackingRegulator::scratch(model);
  const auto speed_of = [&](int l) { return core::lane_of(lanes.work().linear_momentum.x, l) / model.total_mass; };
  const auto tell = [&](double seconds) {
    const Runner& r = runners[0];
    if (watch) watch({seconds, x_of(0), speed_of(0), r.composer.stage(), r.clearing ? name_of(courses[0].obstacles[static_cast<std::size_t>(r.next)].kind) : "running", r.next, out[0].obstacles});
  };
  tell(0);
  for (int n = 0; living > 0; ++n) {
    // Lanes without a course are the last one's doubles.
    for (int l = 0; l < width; ++l) {
      if (l >= used) {
        follower.set(l, runners[static_cast<std::size_t>(used - 1)].composer.player());
        continue;
      }
      Runner& r = runners[static_cast<std::size_t>(l)];
      const Course& course = courses[static_cast<std::size_t>(l)];
      if (r.composer.at_step()) {
        if (r.step_seconds > 0.1) r.speed = (x_of(l) - r.step_x) / r.step_seconds;
        r.step_x = x_of(l);
        r.step_seconds = 0;
        const bool was_clearing = r.clearing;
        const control::SkillPlayer before = r.composer.player();
        const int side = r.composer.side();
        if (r.since >= 0) ++r.since;
        decide(r, course, x_of(l), y_of(l), speed_of(l));
        if (arrivals && r.alive && r.clearing && !was_clearing)
          arrivals->push_back(arrival(model, body_.roles, lanes, l, before, side,
                                      r.manoeuvre.distance - (course.obstacles[static_cast<std::size_t>(r.next)].x - x_of(l))));
      }
      follower.set(l, r.composer.player());
    }
    follower.act(lanes, ds.data());
    for (int l = 0; l < used; ++l) control::regulate(lanes, l, runners[static_cast<std::size_t>(l)].composer, scratch);
    if (engine) {
      for (std::size_t l = 0; l < runners.size(); ++l) wanted[l] = runners[l].alive;
      engine->step(lanes, tick, wanted);
    } else {
      lanes.step(body_.gait.steps_per_tick);
    }
    for (int l = 0; l < used; ++l) {
      const auto k = static_cast<std::size_t>(l);
      Runner& r = runners[k];
      if (!r.alive) continue;
      CourseOutcome& o = out[k];
      const Course& course = courses[k];
      std::array<bool, 2> holding;
      for (int h = 0; h < 2; ++h) holding[static_cast<std::size_t>(h)] = lanes.holds(l, h);
      const bool held = control::hold(lanes, model, hands, l, r.composer);
      if (engine) tell_grips(*engine, lanes, hands, l, holding);
      const bool airborne = !held && std::ranges::all_of(body_.roles.legs, [&](const control::Roles::Leg& leg) {
        return core::lane_of(lanes.body_force()[static_cast<std::size_t>(leg.foot)].z, l) < least_load;
      });
      r.flight = airborne ? r.flight + tick : 0;
      if (r.clearing) {
        r.labels.hand += held ? tick : 0;
        r.labels.flight = std::max(r.labels.flight, r.flight);
        r.labels.turned += core::lane_of(lanes.v()[4], l) * tick;
      } else {
        o.running += tick;
        o.flying += airborne ? tick : 0;
      }
      r.composer.advance(tick, x_of(l), y_of(l));
      r.step_seconds += tick;
      o.seconds = (n + 1) * tick;
      o.distance = x_of(l);
      if (l == 0) tell(o.seconds);
      const double root = core::lane_of(lanes.q()[2], l), up = core::lane_of(lanes.work().bodies[0].rotation.zz, l);
      // Who rolls is as low, and who vaults as near to what is below, as the reference.
      const bool by_reference = r.clearing && r.manoeuvre.regulator;
      const double under = r.clearing ? course.height(core::lane_of(lanes.q()[0], l)) : r.floor;
      const bool fallen = by_reference ? control::off_reference(ds, l, 1.15, 0.35) : root < under + 0.5 || up < std::cos(1.15);
      if (recording && l == 0) {
        Eigen::VectorXd q(model.nq);
        for (int i = 0; i < model.nq; ++i) q[i] = core::lane_of(lanes.q()[i], 0);
        body::normalize(model.character.skeleton, q.data());
        recording->poses.push_back(q);
        recording->stages.push_back(r.composer.stage());
      }
      if (r.clearing && r.composer.stage() == control::RunStage::trans_out) {
        r.clearing = false;
        o.labels.push_back(r.labels);
        r.floor += r.manoeuvre.rise;
        ++r.next;
        r.since = 0;
      }
      // An obstacle counts as cleared when the runner runs on as usual after it.
      if (!r.clearing && r.composer.stage() == control::RunStage::run && o.cleared < r.next) {
        ++o.cleared_of[index_of(course.obstacles[static_cast<std::size_t>(r.next - 1)].kind)];
        o.cleared = r.next;
      }
      const bool lost = lanes.failed(l) || fallen;
      const bool passed = r.next == o.obstacles && o.cleared == o.obstacles && x_of(l) > course.obstacles.back().x + 8;
      const bool late = o.seconds > 30 + (course.obstacles.back().x + 10) / 2.0;
      if (!(lost || passed || late)) continue;
      o.completed = passed;
      if (!passed) {
        const control::RunStage stage = r.composer.stage();
        const bool after = stage == control::RunStage::trans_out && r.next > 0;
        const CourseObstacle& at = course.obstacles[static_cast<std::size_t>(after ? r.next - 1 : std::min(r.next, o.obstacles - 1))];
        const std::string what = name_of(at.kind);
        o.failure = late ? "did not get there"
                    : lanes.failed(l) ? "simulation failed"
                    : stage == control::RunStage::trans_in ? "fell in the step before a " + what
                    : stage == control::RunStage::clear ? "fell in a " + what
                    : stage == control::RunStage::trans_out ? "fell after a " + what
                    : "fell while running";
        o.steps_since = r.since;
        o.failed_at = at.kind;
        o.failed_height = at.height;
      }
      r.alive = false;
      --living;
    }
  }
  return out;
}

}  // namespace terrain_runner
