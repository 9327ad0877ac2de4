// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <vector>

#include "traceur/control/controller.hpp"
#include "traceur/control/engine.hpp"
#include "traceur/control/sole_slide.hpp"
#include "traceur/control/tracking_cost.hpp"
#include "traceur/core/executor.hpp"
#include "traceur/core/random.hpp"

namespace traceur::control {

/// How far starts are moved from a controller's own start state. Uniform, symmetric.
struct Perturbation {
  double root_velocity = 0.3;  ///< m/s, each axis, of the whole body
  double joint_angle = 0.05;   ///< rad, each joint coordinate
};

/// When a lane counts as fallen, measured against the reference so that rolls and crawls are judged fairly.
struct FallLimits {
  double drop = 0.35;  ///< root below the reference's, m
  double tilt = 1.15;  ///< angle between the root's and the reference's up axes, rad
};

/// A push during an episode: a force on the body above the waist for a number of ticks.
struct Push {
  core::Vector3<double> force{0, 0, 0};  ///< N, world
  int first_tick = 0, ticks = 0;
};

/// A world that differs from the one a controller is for.
struct WorldChange {
  double ground = 1;    ///< factor on stiffness and damping of contacts: above 1 the ground gives less
  double friction = 1;  ///< factor
  int finer = 1;        ///< time steps in the place of one
};

/// What happened in one episode.
struct EpisodeResult {
  double seconds = 0;           ///< survived, s
  bool survived = false;        ///< never fell
  bool reached_end = false;     ///< one-shot: in the clip's end pose (height and tilt) at its end
  bool held = false;            ///< one-shot: still so after the hold
  double deviation = 0;         ///< mean distance from the sensory reference, mixed units; what learning minimises
  double local_error_m = 0;     ///< mean over tracked points and ticks, root position taken off
  double slide_m_s = 0;         ///< of the soles, weighted by what their points carry; bundled dynamics only
  double mean_speed = 0;        ///< horizontal travel along the reference's heading over time, m/s
  bool non_finite = false;
};

/// Settings of a batch of episodes.
struct EpisodeSettings {
  double seconds = 20;        ///< cyclic motions: length; one-shot motions run their clip and the hold
  double hold = 0.5;          ///< one-shot: seconds in the last target after the end
  double perturbation = 1;    ///< factor on Perturbation
  Perturbation starts;
  FallLimits fall;
  std::uint64_t seed = 1;     ///< of the starts
  std::uint64_t stream = 0;
  bool measure_joints = false;  ///< whether to fill local_error_m
  bool measure_slide = false;   ///< whether to fill slide_m_s
};

/// Runs controllers on whole packs of lanes. One per worker.
template <class S>
class EpisodeRunner {
 public:
  using T = core::Element<S>;
  static constexpr int width = core::lane_count<S>;

  EpisodeRunner(const sim::Model& model, const sim::Parameters& simulation, const sim::Ground<T>& ground, const TrackingCost& cost)
      : model_(&model),
        cost_(&cost),
        own_(simulation),
        simulation_(std::make_unique<sim::Parameters>(simulation)),
        lanes_(model, *simulation_, ground) {}

  sim::Lanes<S>& lanes() { return lanes_; }

  /// Lets another engine move the lanes; null: the bundled dynamics again. Throws Error unless it is for this character.
  void use(std::shared_ptr<Engine<S>> engine) {
    if (engine && !engine->fits(*model_)) throw Error("episodes: the engine holds another character");
    engine_ = std::move(engine);
  }

  /// Lets the bundled dynamics be those of another world; other engines keep theirs. WorldChange{} is as it was made.
  void change_world(const WorldChange& w) {
    *simulation_ = own_;
    simulation_->dt /= w.finer;
    simulation_->contact_stiffness *= w.ground;
    simulation_->contact_damping *= w.ground;
    simulation_->friction *= w.friction;
    for (int l = 0; l < width; ++l) lanes_.set_friction(l, static_cast<T>(simulation_->friction));
    finer_ = w.finer;
  }

  /// Called after each tick with the tick's index and the lanes.
  using Observer = std::function<void(int tick, const sim::Lanes<S>&)>;

  /// One episode in each lane. `law(lane)` points to that lane's shape.size() parameters, `start(lane)` is the index of its
  /// start state (equal indices give equal starts), `push(lane)` its push. Ends early when every lane has fallen, unless
  /// there is an observer.
  template <class Law, class Start, class PushOf>
  std::array<EpisodeResult, static_cast<std::size_t>(width)> run(const Controller& c, const EpisodeSettings& e, int used, Law&& law,
                                                                 Start&& start, PushOf&& push, const Observer& observer = {}) {
    using core::Vector3;
    const Roles& roles = cost_->roles();
    const int parameters = c.shape.size();
    law_.resize(static_cast<std::size_t>(std::max(1, parameters)));
    for (int l = 0; l < width; ++l) {
      const int lane = std::min(l, used - 1);
      const double* from = law(lane);
      for (int k = 0; k < parameters; ++k) core::set_lane(law_[static_cast<std::size_t>(k)], l, static_cast<T>(from[k]));
      reset(c, e, l, start(lane));
    }
    lanes_.refresh();
    if (engine_) engine_->begin(lanes_, used);
    const int clip_ticks = c.ticks();
    const int ticks = c.cyclic ? std::max(1, static_cast<int>(std::lround(e.seconds / c.tick)))
                               : clip_ticks + static_cast<int>(std::lround(e.hold / c.tick));
    std::array<EpisodeResult, static_cast<std::size_t>(width)> results{};
    std::array<bool, static_cast<std::size_t>(width)> alive{};
    for (int l = 0; l < used; ++l) alive[static_cast<std::size_t>(l)] = true;
    int living = used;
    carried_.fill(0);
    std::array<S, full_sensors> raw;
    std::array<S, full_actions> da;
    CycleCarry carry;
    const Vector3<double> from = Vector3<double>::from(c.reference.center_of_mass.col(0).data());
    for (int tick = 0; tick < ticks && (living > 0 || observer); ++tick) {
      const int t = c.cyclic ? tick % clip_ticks : std::min(tick, clip_ticks - 1);
      if (c.cyclic && t == 0 && tick > 0) carry = CycleCarry::after(c.reference, tick / clip_ticks);
      const auto k = static_cast<std::size_t>(t);
      // Past the end of a one-shot motion the reference stands still in its last pose.
      const bool holding = !c.cyclic && tick >= clip_ticks;
      const int reference_tick = holding ? clip_ticks : t;
      measure(lanes_, *model_, roles, c.reference, reference_tick, carry, c.stance[k], raw.data());
      for (int i = 0; i < full_sensors; ++i) raw[static_cast<std::size_t>(i)] -= S(static_cast<T>(c.sensory(i, t)));
      if (parameters > 0) {
        feedback(c.shape, c.limits, law_.data() + c.phase[k] * c.shape.phase_size(), raw.data(), da.data());
      } else {
        for (S& a : da) a = S(T(0));
      }
      const S deviation = distance(raw);
      apply_action(lanes_, *model_, roles, c.shape.sets, c.targets.col(t).data(), c.stance[k], da.data());
      std::array<bool, static_cast<std::size_t>(width)> wanted = alive;
      if (observer) std::fill_n(wanted.begin(), used, true);
      for (int l = 0; l < used; ++l) {
        const Push p = push(l);
        if (!(p.ticks > 0 && tick >= p.first_tick && tick < p.first_tick + p.ticks)) continue;
        const Vector3<double> at{0, 0, 0.15};
        if (!engine_)
          lanes_.push(l, roles.waist, p.force.template cast<T>(), at.template cast<T>());
        else if (wanted[static_cast<std::size_t>(l)])
          engine_->push(l, roles.waist, p.force, at);
      }
      if (engine_)
        engine_->step(lanes_, c.tick, wanted);
      else
        lanes_.step(finer_ * c.steps_per_tick);
      if (observer) observer(tick, lanes_);
      const int next = c.cyclic ? t + 1 : std::min(tick + 1, clip_ticks);
      judge(c, e, next, carry, tick, used, deviation, alive, living, results);
      if (!c.cyclic && tick + 1 == clip_ticks)
        for (int l = 0; l < used; ++l)
          results[static_cast<std::size_t>(l)].reached_end = alive[static_cast<std::size_t>(l)] && at_end(c, l);
    }
    const double whole = ticks * c.tick;
    for (int l = 0; l < used; ++l) {
      EpisodeResult& r = results[static_cast<std::size_t>(l)];
      r.survived = alive[static_cast<std::size_t>(l)];
      const int lived = std::max(1, static_cast<int>(std::lround(r.seconds / c.tick)));
      r.deviation /= lived;
      r.local_error_m /= lived;
      if (carried_[static_cast<std::size_t>(l)] > 0) r.slide_m_s /= carried_[static_cast<std::size_t>(l)];
      r.held = r.survived && r.reached_end && at_end(c, l);
      const auto& w = lanes_.work();
      const double dx = core::lane_of(w.center_of_mass.x, l) - from.x, dy = core::lane_of(w.center_of_mass.y, l) - from.y;
      const CycleCarry end = CycleCarry::after(c.reference, 1);
      const double ex = end.x, ey = end.y, length = std::hypot(ex, ey);
      r.mean_speed = length > 1e-6 && std::abs(end.turn) < 0.05 ? (dx * ex + dy * ey) / length / whole : std::hypot(dx, dy) / whole;
    }
    return results;
  }

 private:
  void reset(const Controller& c, const EpisodeSettings& e, int lane, int start) {
    for (S& x : lanes_.state()) core::set_lane(x, lane, T(0));
    lanes_.clear_failed(lane);
    Eigen::VectorXd d = Eigen::VectorXd::Zero(model_->nv), v = c.start_velocity;
    if (e.perturbation > 0) {
      core::RandomStream random(e.seed, e.stream, static_cast<std::uint64_t>(start));
      for (int k = 0; k < 3; ++k) v[k] += e.perturbation * e.starts.root_velocity * random.uniform(-1.0, 1.0);
      for (int k = 6; k < model_->nv; ++k) d[k] = e.perturbation * e.starts.joint_angle * random.uniform(-1.0, 1.0);
    }
    Eigen::VectorXd q(model_->nq);
    body::displace(model_->character.skeleton, c.start_pose.data(), d.data(), q.data());
    for (int k = 0; k < model_->nq; ++k) core::set_lane(lanes_.q()[k], lane, static_cast<T>(q[k]));
    for (int k = 0; k < model_->nv; ++k) core::set_lane(lanes_.v()[k], lane, static_cast<T>(v[k]));
  }

  /// Mixed distance: rotation 2/rad, position 2/m (at most 0.5 m), velocity 0.3 s/m.
  static S distance(const std::array<S, full_sensors>& ds) {
    using core::Vector3;
    const S rotation = norm(Vector3<S>{ds[0], ds[1], ds[2]});
    const S position = core::min(norm(Vector3<S>{ds[3], ds[4], ds[5]}), S(T(0.5)));
    const S velocity = norm(Vector3<S>{ds[6], ds[7], ds[8]});
    return S(T(2)) * rotation + S(T(2)) * position + S(T(0.3)) * velocity;
  }

  /// Cosine between the root's and the reference's up axes.
  double up_cosine(const Controller& c, int lane, int t) const {
    const auto& r = lanes_.work().bodies[0].rotation;
    const core::Quaternion<double> ref = core::Quaternion<double>::from(c.reference.poses.col(t).data() + 3);
    const core::Vector3<double> up = ref.rotate({0, 0, 1});
    const core::Vector3<double> mine{core::lane_of(r.xz, lane), core::lane_of(r.yz, lane), core::lane_of(r.zz, lane)};
    // Compared without heading: the tilt of each axis and, where both lean, the heading-free vertical component decides.
    const double s1 = std::hypot(up.x, up.y), s2 = std::hypot(mine.x, mine.y);
    const double aligned = up.x * mine.x + up.y * mine.y + up.z * mine.z;
    return c.cyclic ? up.z * mine.z + s1 * s2 : aligned;
  }

  bool at_end(const Controller& c, int lane) const {
    const double reference = c.reference.poses(2, c.reference.ticks);
    const double height = core::lane_of(lanes_.q()[2], lane);
    const double com = c.reference.center_of_mass(2, c.reference.ticks);
    return !lanes_.failed(lane) && std::abs(height - reference) < 0.25 * std::max(com, 0.4) &&
           up_cosine(c, lane, c.reference.ticks) > std::cos(0.6);
  }

  void judge(const Controller& c, const EpisodeSettings& e, int reference_tick, const CycleCarry& carry, int tick, int used, const S& deviation,
             std::array<bool, static_cast<std::size_t>(width)>& alive, int& living,
             std::array<EpisodeResult, static_cast<std::size_t>(width)>& results) {
    S local(T(0));
    if (e.measure_joints) local = local_error(c, reference_tick, carry);
    sim::LoadedSlide<S> soles{S(T(0)), S(T(0))};
    if (e.measure_slide && !engine_) soles = sole_slide(lanes_, cost_->roles());
    const double floor = c.reference.poses(2, reference_tick) - e.fall.drop;
    for (int l = 0; l < used; ++l) {
      const auto k = static_cast<std::size_t>(l);
      if (!alive[k]) continue;
      EpisodeResult& r = results[k];
      r.non_finite = lanes_.failed(l);
      if (r.non_finite || core::lane_of(lanes_.q()[2], l) < floor || up_cosine(c, l, reference_tick) < std::cos(e.fall.tilt)) {
        alive[k] = false;
        --living;
        continue;
      }
      r.seconds = (tick + 1) * c.tick;
      r.deviation += core::lane_of(deviation, l);
      if (e.measure_joints) r.local_error_m += core::lane_of(local, l);
      r.slide_m_s += core::lane_of(soles.sum, l);
      carried_[k] += core::lane_of(soles.load, l);
    }
  }

  S local_error(const Controller& c, int t, const CycleCarry& carry) const {
    using core::Vector3;
    using std::sqrt;
    S sum(T(0));
    const Vector3<S> root = Vector3<S>::from(lanes_.q());
    const Vector3<double> root_ref = Vector3<double>::from(c.reference.poses.col(t).data());
    const auto& points = cost_->points();
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Vector3<double> ref = carry.rotate(Vector3<double>::from(c.reference.points.col(t).data() + 3 * i) - root_ref);
      sum += norm(cost_->place(lanes_, i) - root - ref.template cast<T>().template cast<S>());
    }
    return S(static_cast<T>(1.0 / static_cast<double>(points.size()))) * sum;
  }

  /// Sums over the points of the feet: normal force times tangential speed, and normal force.
  const sim::Model* model_;
  const TrackingCost* cost_;
  sim::Parameters own_;
  std::unique_ptr<sim::Parameters> simulation_;  ///< the lanes know where it is
  int finer_ = 1;
  sim::Lanes<S> lanes_;
  std::shared_ptr<Engine<S>> engine_;
  std::vector<S> law_;
  std::array<double, static_cast<std::size_t>(width)> carried_{};  ///< by soles, summed over ticks, N
};

/// Runs `count` episodes of one law from numbered starts, spread over an executor.
template <class S, core::Executor E>
std::vector<EpisodeResult> run_episodes(std::vector<EpisodeRunner<S>>& runners, const Controller& c, const EpisodeSettings& e, int count,
                                        E& executor, const std::function<Push(int)>& push = [](int) { return Push{}; }) {
  constexpr int width = core::lane_count<S>;
  std::vector<EpisodeResult> out(static_cast<std::size_t>(count));
  executor.run((count + width - 1) / width, [&](int g, int worker) {
    const int used = std::min(width, count - g * width);
    const auto r = runners[static_cast<std::size_t>(worker)].run(
        c, e, used, [&](int) { return c.law.data(); }, [&](int lane) { return g * width + lane; },
        [&](int lane) { return push(g * width + lane); });
    for (int l = 0; l < used; ++l) out[static_cast<std::size_t>(g * width + l)] = r[static_cast<std::size_t>(l)];
  });
  return out;
}

}  // namespace traceur::control
