// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "traceur/control/clearing_cost.hpp"
#include "traceur/control/composition.hpp"
#include "traceur/control/hand_grip.hpp"

namespace traceur::control {

/// A state in which a running step on the left foot begins, seen from the centre of mass' place on the ground: x and y zero,
/// heading for +x.
struct RunningState {
  Eigen::VectorXd pose, velocity;
  double off = 0;     ///< how far it is beyond the place where a manoeuvre should begin, m
  double speed = 0;   ///< of the reference, m/s; 0: as the manoeuvre has it
  SkillFrame frame{};  ///< of the reference, from the centre of mass
};

/// States of a runner at the moments when a step on the left foot begins, once it runs steadily: from `runs` perturbed runs
/// of `cycles` cycles each, those after the first half that survived. Throws Error when none did.
template <class S>
std::vector<RunningState> running_states(RunningTrials<S>& trials, const sim::Model& model, const Skill& gait, const RunningTask& task,
                                         const Eigen::VectorXd& control, RunningSettings e, int runs) {
  constexpr int width = core::lane_count<S>;
  double left = 0;
  for (const int t : gait.table.step_starts())
    if (gait.table.stance(t) == 1) left = t;
  std::vector<RunningState> out;
  const double n = gait.table.ticks();
  for (int first = 0; first < runs; first += width) {
    const int used = std::min(width, runs - first);
    std::array<std::vector<RunningState>, static_cast<std::size_t>(width)> found;
    std::array<double, static_cast<std::size_t>(width)> before{};
    const auto observe = [&](int, const sim::Lanes<S>& lanes, const auto& players) {
      for (int l = 0; l < used; ++l) {
        const auto k = static_cast<std::size_t>(l);
        const double now = players[k].phase();
        const bool crossed = std::floor((now - left) / n + 1e-9) > std::floor((before[k] - left) / n + 1e-9);
        before[k] = now;
        if (!crossed || now < n * e.cycles / 2) continue;
        RunningState s;
        s.pose.resize(model.nq);
        s.velocity.resize(model.nv);
        for (int i = 0; i < model.nq; ++i) s.pose[i] = core::lane_of(lanes.q()[i], l);
        for (int i = 0; i < model.nv; ++i) s.velocity[i] = core::lane_of(lanes.v()[i], l);
        body::normalize(model.character.skeleton, s.pose.data());
        s.pose[0] -= core::lane_of(lanes.work().center_of_mass.x, l);
        s.pose[1] -= core::lane_of(lanes.work().center_of_mass.y, l);
        found[k].push_back(std::move(s));
      }
    };
    const auto outcomes = trials.run(
        e, used, [&](int) { return control.data(); }, [&](int) { return task; }, [&](int l) { return first + l; }, observe);
    for (int l = 0; l < used; ++l)
      if (outcomes[static_cast<std::size_t>(l)].survived)
        for (RunningState& s : found[static_cast<std::size_t>(l)]) out.push_back(std::move(s));
  }
  if (out.empty()) throw Error("running states: every run fell");
  return out;
}

/// One tick of a composed runner's hands, which are the lanes' grips 0 (right) and 1 (left): they hold on to what they touch
/// where its manoeuvre has them do so. Returns whether one holds.
template <class S>
bool hold(sim::Lanes<S>& lanes, const sim::Model& model, const std::array<sim::GripPoint, 2>& hands, int lane, const Composer& composer) noexcept {
  bool any = false;
  for (int h = 0; h < 2; ++h) {
    const int body = model.moving_of_joint[static_cast<std::size_t>(hands[static_cast<std::size_t>(h)].joint)];
    any = hold_until_passed(lanes, lane, h, body, {1, 0, 0}, composer.may_hold(h)) || any;
  }
  return any;
}

/// Adds to a lane's targets what the regulator of the manoeuvre that its runner is in says, if there is one; after the Follower.
template <class S>
void regulate(sim::Lanes<S>& lanes, int lane, const Composer& composer, TrackingRegulator::Scratch& scratch) noexcept {
  const Manoeuvre* m = composer.manoeuvre();
  if (m && m->regulator)
    m->regulator->apply(lanes, lane, m->size, composer.player().phase(), composer.player().frame(), m->in_mirror, scratch);
}

/// Whether a manoeuvring runner has fallen: turned by more than `most_tilt` (rad) away from its reference, or its centre of mass
/// lower than that by more than `most_sunk` (m). `ds`: what its Follower sensed.
template <class S>
bool off_reference(const std::array<S, full_sensors>& ds, int lane, double most_tilt, double most_sunk) noexcept {
  const auto at = [&](std::size_t i) { return static_cast<double>(core::lane_of(ds[i], lane)); };
  return norm(core::Vector3<double>{at(0), at(1), at(2)}) > most_tilt || at(5) < -most_sunk;
}

/// At which speed a runner goes on after a manoeuvre (theta_out): a little faster than it is, until it is as fast as before.
struct ExitSpeed {
  double slowest = 2.5, gain = 0.2;  ///< m/s; the gain is that of one step

  double operator()(double now, double cruise) const noexcept { return std::clamp(now + gain, std::min(slowest, cruise), cruise); }
};

/// What is in a runner's way: ground at 0 before x = 0, at `top` from there to `depth`, at `rise` beyond. All m.
struct Hurdle {
  double top = 0, depth = 0, rise = 0;

  /// A step up, or down where `height` is negative.
  static Hurdle step(double height) noexcept { return {height, 0, height}; }
  /// A box on the ground.
  static Hurdle box(double height, double depth) noexcept { return {height, depth, 0}; }

  /// Height of the ground.
  double floor(double x) const noexcept { return x < 0 ? 0 : x < depth ? top : rise; }
  /// Whether a foot must be over `top` at x, `toes` and `heel` reaching so far before and behind its ankle.
  bool in_the_way(double x, double toes, double heel) const noexcept { return top > 0 && x > -toes && x < depth + heel; }
};

/// How a trial of clearing an obstacle goes.
struct ClearingSettings {
  double place = 0.2;        ///< starts are moved by up to so much along the run, m
  double velocity = 0.1;     ///< and pushed by up to so much along each axis, m/s
  int steps_after = 6;       ///< running steps to be done after it
  ExitSpeed exit;            ///< their speeds
  double least_root = 0.5;   ///< fallen with the root lower over the ground than this, m,
  double most_tilt = 1.15;   ///< or tilted by more than this, rad
  ClearingWeights weights;
  double lost = 20;          ///< cost of the whole time lost, beside Eq. 10
  double settle = 0;         ///< cost of each unit by which the last half of the steps after it are off the reference
  double uncleared = 0;      ///< cost of not being beyond it when the manoeuvre ends, or of never coming so far
  double no_hand = 0.2;      ///< added to E_c where a hand should hold on and never does, m
  double overlap = 0.02;     ///< soles shall pass the edge by this much, m
  /// Whether a fall is told from the manoeuvre's reference (off it by `most_tilt`, or its centre of mass lower by `most_sunk`
  /// m) instead, as where it rolls.
  bool follow_reference = false;
  double most_sunk = 0.35;
  std::uint64_t seed = 1, stream = 0;
};

/// What became of one trial.
struct ClearingOutcome {
  bool survived = false, cleared = false;  ///< to the end; beyond it with both feet, in the manoeuvre's last stance,
                                           ///< a hand having held on where one should
  bool held = false;                       ///< a hand held on to it
  double seconds = 0, cost = 0;
  double contact = 0, balance = 0, pose = 0;  ///< E_c, E_b (m), mean of the sensed distances
  double exit_speed = 0;                      ///< mean over the steps after it, m/s
  double unsettled = 0;  ///< mean over the last half of those steps: off the reference by rad + m/s + m of the stance foot
};

/// Tries compositions of running and the clearing of an obstacle on a pack of lanes: a running step leads into the manoeuvre,
/// and running steps follow it. Hands hold on where the manoeuvre has them do so. One per worker and ground.
template <class S>
class ClearingTrials {
public:
  using T = core::Element<S>;
  static constexpr int width = core::lane_count<S>;

  /// The ground has `hurdle` in it, in all lanes that have no place of their own. All must outlive it.
  ClearingTrials(const sim::Model& model, const Roles& roles, const sim::Parameters& simulation, const sim::Ground<T>& ground,
                 const Hurdle& hurdle, double tick, int steps_per_tick, const Skill& gait, const Composer::Settings& composition = {})
      : model_(&model), roles_(roles), tick_(tick), steps_(steps_per_tick), gait_(&gait), hands_(find_hands(model)),
        lanes_(model, simulation, ground, with_hands(hands_)), follower_(model, roles, gait.shape.law, gait.limits) {
    for (int l = 0; l < width; ++l) composers_.emplace_back(model, gait, composition);
    hurdles_.fill(hurdle);
    scratch_ = TrackingRegulator::scratch(model);
  }

  /// Gives a lane another ground, with `hurdle` in it.
  void place(int lane, const sim::Ground<T>& ground, const Hurdle& hurdle) {
    lanes_.set_place(lane, ground, nullptr);
    hurdles_[static_cast<std::size_t>(lane)] = hurdle;
  }

  sim::Lanes<S>& lanes() { return lanes_; }
  const Hurdle& hurdle(int lane) const { return hurdles_[static_cast<std::size_t>(lane)]; }

  /// One trial in each of the first `used` lanes. `manoeuvre(lane)` refers to what is tried, `start(lane)` is the number of
  /// its start, taken from `states`; `running(speed)` is the control for running straight ahead at a speed, before and after.
  template <class Of, class Start, class Running>
  std::array<ClearingOutcome, static_cast<std::size_t>(width)> run(const ClearingSettings& e, int used, Of&& manoeuvre, Start&& start,
                                                                   const std::vector<RunningState>& states,
                                                                   Running&& running) {
    std::array<ClearingOutcome, static_cast<std::size_t>(width)> out{};
    std::array<bool, static_cast<std::size_t>(width)> alive{};
    std::array<Marks, static_cast<std::size_t>(width)> marks{};
    double longest = 0;
    for (int l = 0; l < width; ++l) {
      const auto k = static_cast<std::size_t>(l);
      const int lane = std::min(l, used - 1);
      const Manoeuvre& m = manoeuvre(lane);
      core::RandomStream random(e.seed, e.stream, static_cast<std::uint64_t>(start(lane)));
      const RunningState& from = states[static_cast<std::size_t>(random.next_u32()) % states.size()];
      RunningStart s{from.pose, from.velocity};
      const double x = -m.distance + from.off + e.place * random.uniform(-1.0, 1.0);
      s.pose[0] += x;
      for (int i = 0; i < 3; ++i) s.velocity[i] += e.velocity * random.uniform(-1.0, 1.0);
      RunningTrials<S>::put(lanes_, *model_, l, s);
      follower_.forget(l);
      Composer& c = composers_[k];
      const Eigen::VectorXd before = running(m.speed_in);
      c.set_exit(before);
      c.start(before, from.speed > 0 ? from.speed : m.speed_in, {from.frame.heading, x + from.frame.x, from.frame.y, 0}, c.step_start(1));
      c.clear(m, {0, 0, 0, 0}, x, 0);
      alive[k] = l < used;
      const double ticks_of = m.end > 0 ? m.end : m.skill->table.ticks();
      const double whole = ticks_of * m.skill->table.tick() * m.control[m.skill->shape.beta()] + e.steps_after * 0.5 * gait_->table.duration();
      marks[k].whole = whole;
      marks[k].settled = whole - 0.5 * e.steps_after * 0.5 * gait_->table.duration();
      longest = std::max(longest, whole);
    }
    lanes_.refresh();
    int living = used;
    const int ticks = static_cast<int>(std::ceil(longest / tick_));
    std::array<S, full_sensors> ds;
    for (int n = 0; n < ticks && living > 0; ++n) {
      for (int l = 0; l < width; ++l) {
        Composer& c = composers_[static_cast<std::size_t>(l)];
        if (c.at_step()) {
          const double now = core::lane_of(lanes_.work().linear_momentum.x, l) / model_->total_mass;
          const double speed = e.exit(now, manoeuvre(std::min(l, used - 1)).speed_out);
          c.step(running(speed), speed, 0);
        }
        follower_.set(l, c.player());
      }
      follower_.act(lanes_, ds.data());
      for (int l = 0; l < width; ++l) regulate(lanes_, l, composers_[static_cast<std::size_t>(l)], scratch_);
      lanes_.step(steps_);
      const auto& w = lanes_.work();
      using core::Vector3;
      const S distance = norm(Vector3<S>{ds[0], ds[1], ds[2]}) + core::min(norm(Vector3<S>{ds[3], ds[4], ds[5]}), S(T(1)));
      const S off_gait = norm(Vector3<S>{ds[0], ds[1], ds[2]}) + core::min(norm(Vector3<S>{ds[6], ds[7], ds[8]}), S(T(2))) +
                         norm(Vector3<S>{ds[9], ds[10], ds[11]});
      for (int l = 0; l < used; ++l) {
        const auto k = static_cast<std::size_t>(l);
        if (!alive[k]) continue;
        Composer& c = composers_[k];
        Marks& m = marks[k];
        ClearingOutcome& o = out[k];
        const RunStage before = c.stage();
        o.held = hold(lanes_, *model_, hands_, l, c) || o.held;
        c.advance(tick_, core::lane_of(w.center_of_mass.x, l), core::lane_of(w.center_of_mass.y, l));
        const bool manoeuvring = before == RunStage::trans_in || before == RunStage::clear;
        if (lanes_.failed(l) || (e.follow_reference && manoeuvring ? off_reference(ds, l, e.most_tilt, e.most_sunk) : fallen(l, e))) {
          alive[k] = false;
          --living;
          continue;
        }
        o.seconds = (n + 1) * tick_;
        if (manoeuvring) {
          o.pose += core::lane_of(distance, l);
          ++m.clearing;
          watch_feet(l, e, o);
        }
        if (before != RunStage::trans_out && c.stage() == RunStage::trans_out) {
          o.balance = off_balance(l, ds);
          o.cleared = foot(0, l).x > hurdle(l).depth && foot(1, l).x > hurdle(l).depth && (o.held || manoeuvre(l).hand < 0);
          m.left = n;
          m.x = core::lane_of(w.center_of_mass.x, l);
        }
        if (o.seconds > m.settled) {
          o.unsettled += core::lane_of(off_gait, l);
          ++m.settling;
        }
        if (o.seconds >= m.whole - 1e-9) {
          o.survived = true;
          if (m.left >= 0 && n > m.left) o.exit_speed = (core::lane_of(w.center_of_mass.x, l) - m.x) / ((n - m.left) * tick_);
          alive[k] = false;
          --living;
        }
      }
    }
    for (int l = 0; l < used; ++l) {
      const auto k = static_cast<std::size_t>(l);
      ClearingOutcome& o = out[k];
      if (marks[k].clearing > 0) o.pose /= marks[k].clearing;
      if (marks[k].settling > 0) o.unsettled /= marks[k].settling;
      if (!o.survived) {
        o.balance = std::max(o.balance, 0.3);
        o.unsettled = std::max(o.unsettled, 2.0);
      }
      if (manoeuvre(l).hand >= 0 && !o.held) o.contact += e.no_hand;
      o.cost = clearing_cost(o.contact, o.balance, {o.pose, 0, 0}, e.weights) + e.settle * o.unsettled + e.lost * std::max(0.0, 1 - o.seconds / marks[k].whole) +
               (o.cleared ? 0 : e.uncleared);
      if (!std::isfinite(o.cost)) o.cost = 1e3;
    }
    return out;
  }

private:
  struct Marks {
    double whole = 0, settled = 0, x = 0;
    int clearing = 0, left = -1, settling = 0;
  };

  core::Vector3<double> foot(std::size_t side, int l) const {
    const auto& p = lanes_.work().bodies[static_cast<std::size_t>(roles_.legs[side].foot)].position;
    return {core::lane_of(p.x, l), core::lane_of(p.y, l), core::lane_of(p.z, l)};
  }
  static sim::Extras with_hands(const std::array<sim::GripPoint, 2>& hands) {
    sim::Extras extras;
    extras.grips.assign(hands.begin(), hands.end());
    return extras;
  }
  bool fallen(int l, const ClearingSettings& e) const {
    const double up = core::lane_of(lanes_.work().bodies[0].rotation.zz, l);
    const double floor = hurdle(l).floor(core::lane_of(lanes_.work().bodies[0].position.x, l));
    return core::lane_of(lanes_.q()[2], l) < floor + e.least_root || up < std::cos(e.most_tilt);
  }
  /// E_c: the lowest a sole is while it passes the obstacle, or before it beyond it.
  void watch_feet(int l, const ClearingSettings& e, ClearingOutcome& o) const {
    constexpr double ankle_height = 0.05, toes = 0.15, heel = 0.06;
    for (std::size_t side = 0; side < 2; ++side) {
      const auto f = foot(side, l);
      if (hurdle(l).in_the_way(f.x, toes, heel))
        o.contact = std::max(o.contact, jump_contact_cost(hurdle(l).top + e.overlap, f.z - ankle_height));
    }
  }
  /// E_b: how far the stance foot is from where the reference has it, as the law senses it.
  static double off_balance(int l, const std::array<S, full_sensors>& ds) {
    return norm(core::Vector3<double>{core::lane_of(ds[9], l), core::lane_of(ds[10], l), core::lane_of(ds[11], l)});
  }

  const sim::Model* model_;
  Roles roles_;
  std::array<Hurdle, static_cast<std::size_t>(width)> hurdles_{};
  double tick_;
  int steps_;
  const Skill* gait_;
  std::array<sim::GripPoint, 2> hands_;
  sim::Lanes<S> lanes_;
  Follower<S> follower_;
  std::vector<Composer> composers_;
  TrackingRegulator::Scratch scratch_;
};

}  // namespace traceur::control
