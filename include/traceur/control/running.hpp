// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "traceur/control/episodes.hpp"
#include "traceur/control/follower.hpp"
#include "traceur/control/mirror.hpp"
#include "traceur/control/running_cost.hpp"

namespace traceur::control {

/// A start for a runner: the controller's own, its whole body moving at the wanted speed, perturbed. Equal seeds, streams
/// and numbers give equal starts.
struct RunningStart {
  Eigen::VectorXd pose, velocity;

  /// The same in the mirror, where it begins half a gait later.
  RunningStart mirrored(const sim::Model& model, const Roles& roles) const {
    return {mirrored_pose(model, roles, pose), mirrored_tangent(model, roles, velocity)};
  }

  static RunningStart make(const sim::Model& model, const Controller& c, double gait_speed, double speed, double perturbation,
                           const Perturbation& by, std::uint64_t seed, std::uint64_t stream, std::uint64_t number) {
    RunningStart s{c.start_pose, c.start_velocity};
    s.velocity[0] += speed - gait_speed;
    if (!(perturbation > 0)) return s;
    core::RandomStream random(seed, stream, number);
    Eigen::VectorXd d = Eigen::VectorXd::Zero(model.nv);
    for (int k = 0; k < 3; ++k) s.velocity[k] += perturbation * by.root_velocity * random.uniform(-1.0, 1.0);
    for (int k = 6; k < model.nv; ++k) d[k] = perturbation * by.joint_angle * random.uniform(-1.0, 1.0);
    body::displace(model.character.skeleton, s.pose.data(), d.data(), s.pose.data());
    return s;
  }
};

/// Settings of running trials.
struct RunningSettings {
  int cycles = 20;            ///< N_d
  double perturbation = 1;    ///< factor on `starts`
  Perturbation starts{0.15, 0.03};
  bool either_foot = false;   ///< every other start begins on the other foot, in the mirror
  double push = 0;            ///< at every step the root is pushed within a tick along x and y, each by up to so much
                              ///< change of the whole body's velocity, m/s
  RunningTask wander;         ///< at every step the reference's turn and speed are off the task's by up to so much
  double least_root = 0.55;   ///< a runner has fallen with its root lower than this, m,
  double most_tilt = 1.15;    ///< or tilted by more than this, rad
  StepFrequency frequency;    ///< c_f, c_v
  RunningCostWeights weights;
  std::uint64_t seed = 1, stream = 0;
};

/// What became of one run.
struct RunningOutcome {
  RunningRecord record;
  double cost = 0;             ///< Eq. 8
  bool survived = false;
  double turn = 0;             ///< mean of the cycles but the first two, rad per step
  double speed = 0, step_length = 0;  ///< m/s, m

  /// Whether it ran all the time, at the speed and turn asked for.
  bool solves(const RunningTask& task, double speed_tolerance = 0.25, double turn_tolerance = 0.0175) const noexcept {
    return survived && std::abs(speed - task.speed) <= speed_tolerance && std::abs(turn - task.turn) <= turn_tolerance;
  }
};

/// Runs parameterized running controls (Terrain Runner, s4.1) on a pack of lanes, one run in each. One per worker.
template <class S>
class RunningTrials {
public:
  using T = core::Element<S>;
  static constexpr int width = core::lane_count<S>;
  using Players = std::array<SkillPlayer, static_cast<std::size_t>(width)>;
  struct Unobserved {
    void operator()(int, const sim::Lanes<S>&, const Players&) const {}
  };

  /// All must outlive it. The gait is the table of `controller`.
  RunningTrials(const sim::Model& model, const Roles& roles, const sim::Parameters& simulation, const sim::Ground<T>& ground,
                const Controller& controller, const Skill& gait)
      : model_(&model), roles_(roles), controller_(&controller), gait_(&gait), lanes_(model, simulation, ground),
        follower_(model, roles, gait.shape.law, gait.limits) {
    for (SkillPlayer& p : players_) p.know(model);
  }

  sim::Lanes<S>& lanes() { return lanes_; }

  /// One run in each of the first `used` lanes: `control(lane)` points to gait.shape.size() numbers that stay, `task(lane)` is
  /// what is asked for, `start(lane)` the number of its start. `observe(tick, lanes, players)` is called after every tick.
  template <class Control, class Task, class Start, class Observer = Unobserved>
  std::array<RunningOutcome, static_cast<std::size_t>(width)> run(const RunningSettings& e, int used, Control&& control, Task&& task,
                                                                  Start&& start, Observer&& observe = {}) {
    const MotionTable& table = gait_->table;
    std::array<RunningOutcome, static_cast<std::size_t>(width)> out{};
    std::array<Progress, static_cast<std::size_t>(width)> progress{};
    int steps_per_cycle = 2;
    double longest = 0;
    for (int l = 0; l < width; ++l) {
      const int lane = std::min(l, used - 1);
      const auto k = static_cast<std::size_t>(l);
      const RunningTask t = task(lane);
      const RunningStart first = RunningStart::make(*model_, *controller_, table.speed(), t.speed, e.perturbation, e.starts, e.seed,
                                                    e.stream, static_cast<std::uint64_t>(start(lane)));
      // Who turns to the right starts in the mirror, so that the mirrored control of a left turn makes the mirrored run.
      const bool right = (t.turn < 0) != (e.either_foot && start(lane) % 2 != 0);
      put(lanes_, *model_, l, right ? first.mirrored(*model_, roles_) : first);
      follower_.forget(l);
      const core::Vector3<double>& origin = table.start_center();
      players_[k].start(*gait_, control(lane), {0, origin.x, origin.y, 0}, right ? 0.5 * table.ticks() : 0.0);
      Progress& p = progress[k];
      p.alive = l < used;
      p.task = t;
      p.cycle_seconds = table.duration() * players_[k].beta();
      p.random = core::RandomStream(e.seed, e.stream, static_cast<std::uint64_t>(start(lane)) + disturbances);
      p.frequency_error = std::abs(steps_per_cycle / p.cycle_seconds - e.frequency(t.speed));
      players_[k].steer(t.speed, steps_per_cycle * t.turn / p.cycle_seconds);
      out[k].record.wanted_seconds = e.cycles * p.cycle_seconds;
      if (l < used) longest = std::max(longest, out[k].record.wanted_seconds);
    }
    lanes_.refresh();
    const double tick = controller_->tick;
    const int ticks = static_cast<int>(std::ceil(longest / tick - 1e-9));
    head_.resize(static_cast<std::size_t>(3 * width * ticks));
    for (int l = 0; l < used; ++l) mark(progress[static_cast<std::size_t>(l)], l);
    int living = used;
    for (int n = 0; n < ticks && living > 0; ++n) {
      if (e.push > 0 || e.wander.turn > 0 || e.wander.speed > 0)
        for (int l = 0; l < width; ++l) disturb(progress[static_cast<std::size_t>(l)], l, n, e, steps_per_cycle);
      for (int l = 0; l < width; ++l) follower_.set(l, players_[static_cast<std::size_t>(l)]);
      follower_.act(lanes_);
      lanes_.step(controller_->steps_per_tick);
      for (int l = 0; l < width; ++l) players_[static_cast<std::size_t>(l)].advance(tick);
      observe(n, lanes_, players_);
      const core::Vector3<S> head = head_place();
      for (int l = 0; l < used; ++l) {
        const auto k = static_cast<std::size_t>(l);
        Progress& p = progress[k];
        if (!p.alive) continue;
        RunningRecord& r = out[k].record;
        if (fallen(l, e)) {
          p.alive = false;
          --living;
          continue;
        }
        r.seconds = (n + 1) * tick;
        double* h = head_.data() + 3 * (n * width + l);
        h[0] = core::lane_of(head.x, l);
        h[1] = core::lane_of(head.y, l);
        h[2] = core::lane_of(head.z, l);
        p.ticks = n + 1;
        if (r.seconds >= (r.cycles + 1) * p.cycle_seconds - 1e-9) finish_cycle(p, l, out[k]);
        if (r.seconds >= r.wanted_seconds - 1e-9) {
          out[k].survived = true;
          r.seconds = r.wanted_seconds;
          p.alive = false;
          --living;
          continue;
        }
        keep_close(players_[k], l);
      }
    }
    for (int l = 0; l < used; ++l) {
      const auto k = static_cast<std::size_t>(l);
      const Progress& p = progress[k];
      RunningOutcome& o = out[k];
      o.record.head_movement = head_movement(l, p.ticks);
      o.cost = running_cost(o.record, e.weights);
      if (!std::isfinite(o.cost)) o.cost = 1e3;
      const int counted = std::max(1, o.record.cycles - 2);
      o.turn = p.turn_sum / (counted * steps_per_cycle);
      o.speed = p.speed_sum / counted;
      o.step_length = o.speed * p.cycle_seconds / steps_per_cycle;
    }
    return out;
  }

  /// Puts a lane of a pack into a start state at rest in memory. Lanes need a refresh afterwards.
  static void put(sim::Lanes<S>& lanes, const sim::Model& model, int lane, const RunningStart& s) {
    for (S& x : lanes.state()) core::set_lane(x, lane, T(0));
    lanes.clear_failed(lane);
    for (int k = 0; k < model.nq; ++k) core::set_lane(lanes.q()[k], lane, static_cast<T>(s.pose[k]));
    for (int k = 0; k < model.nv; ++k) core::set_lane(lanes.v()[k], lane, static_cast<T>(s.velocity[k]));
  }

private:
  struct Progress {
    bool alive = false;
    RunningTask task;
    double cycle_seconds = 0, frequency_error = 0;
    double x = 0, y = 0, course = 0;  ///< where the last cycle ended, and its direction of travel, rad
    double turn_sum = 0, speed_sum = 0;
    int ticks = 0;
    int steps = 0;  ///< begun
    core::RandomStream random{0, 0, 0};
  };
  /// Numbers of starts are far below it.
  static constexpr std::uint64_t disturbances = std::uint64_t{1} << 40;

  /// At the beginning of a step pushes the root, and gives the reference another turn and speed.
  void disturb(Progress& p, int l, int n, const RunningSettings& e, int steps_per_cycle) {
    if (n * controller_->tick * steps_per_cycle < p.steps * p.cycle_seconds - 1e-9) return;
    ++p.steps;
    SkillPlayer& player = players_[static_cast<std::size_t>(l)];
    const double turn = p.task.turn + e.wander.turn * p.random.uniform(-1.0, 1.0);
    player.steer(p.task.speed + e.wander.speed * p.random.uniform(-1.0, 1.0), steps_per_cycle * turn / p.cycle_seconds);
    const double force = e.push * model_->total_mass / controller_->tick;
    const auto x = static_cast<T>(force * p.random.uniform(-1.0, 1.0)), y = static_cast<T>(force * p.random.uniform(-1.0, 1.0));
    // It acts during the next call of step only, which is this tick's.
    lanes_.push(l, 0, {x, y, T(0)}, core::Vector3<T>::zero());
  }

  void mark(Progress& p, int l) {
    const auto& w = lanes_.work();
    p.x = core::lane_of(w.center_of_mass.x, l);
    p.y = core::lane_of(w.center_of_mass.y, l);
  }

  void finish_cycle(Progress& p, int l, RunningOutcome& o) {
    const double x = p.x, y = p.y, before = p.course;
    mark(p, l);
    const double speed = std::hypot(p.x - x, p.y - y) / p.cycle_seconds;
    p.course = std::atan2(p.y - y, p.x - x);
    RunningRecord& r = o.record;
    ++r.cycles;
    // The first course has none before it: it began along +x and turned for half a cycle until its middle.
    const double turned = std::remainder(p.course - before, 2 * std::numbers::pi);
    const double per_step = r.cycles == 1 ? turned : 0.5 * turned;
    r.turn_error += std::abs(per_step - p.task.turn);
    r.speed_error += std::abs(speed - p.task.speed);
    r.frequency_error += p.frequency_error;
    if (r.cycles > 2) {
      p.turn_sum += turned;
      p.speed_sum += speed;
    }
  }

  bool fallen(int l, const RunningSettings& e) const {
    const double up = core::lane_of(lanes_.work().bodies[0].rotation.zz, l);
    return lanes_.failed(l) || core::lane_of(lanes_.q()[2], l) < e.least_root || up < std::cos(e.most_tilt);
  }

  /// The head from the centre of mass, turned into each lane's facing frame.
  core::Vector3<S> head_place() const {
    const auto& w = lanes_.work();
    const int head = roles_.head.empty() ? roles_.waist : roles_.head.front();
    const core::Vector3<S> d = w.bodies[static_cast<std::size_t>(head)].position - w.center_of_mass;
    const S fx = w.bodies[0].rotation.xx, fy = w.bodies[0].rotation.yx;
    using std::sqrt;
    const S inverse = S(T(1)) / sqrt(core::max(fx * fx + fy * fy, S(T(1e-6))));
    const S c = inverse * fx, s = inverse * fy;
    return {c * d.x + s * d.y, c * d.y - s * d.x, d.z};
  }

  double head_movement(int l, int ticks) const {
    if (ticks == 0) return 0;
    core::Vector3<double> mean{0, 0, 0};
    const auto at = [&](int n) { return core::Vector3<double>::from(head_.data() + 3 * (n * width + l)); };
    for (int n = 0; n < ticks; ++n) mean += at(n);
    mean = (1.0 / ticks) * mean;
    double sum = 0;
    for (int n = 0; n < ticks; ++n) sum += norm(at(n) - mean);
    return sum / ticks;
  }

  /// A reference that has got away waits, and one that lags behind follows: it stays within the law's limits.
  void keep_close(SkillPlayer& player, int l) const {
    const auto& w = lanes_.work();
    player.move_frame(near_frame(player.frame(), core::lane_of(w.center_of_mass.x, l), core::lane_of(w.center_of_mass.y, l),
                                 gait_->limits));
  }

  const sim::Model* model_;
  Roles roles_;
  const Controller* controller_;
  const Skill* gait_;
  sim::Lanes<S> lanes_;
  Follower<S> follower_;
  Players players_;
  std::vector<double> head_;
};

}  // namespace traceur::control
