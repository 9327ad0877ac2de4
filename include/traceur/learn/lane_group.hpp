// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "traceur/control/engine.hpp"
#include "traceur/core/random.hpp"
#include "traceur/learn/environment.hpp"
#include "traceur/learn/feature_writer.hpp"
#include "traceur/learn/tracking_state.hpp"
#include "traceur/sim/lanes.hpp"

namespace traceur::learn {

/// A pack of simulated characters and what a policy sees of them: what tasks on the simulator are made of. The lanes are
/// moved by the bundled dynamics, or by `engine` where there is one.
template <class S>
struct LaneGroup {
  using Scalar = S;
  using T = core::Element<S>;
  static constexpr int width = core::lane_count<S>;

  const sim::Model* model;
  sim::Lanes<S> lanes;
  std::shared_ptr<control::Engine<S>> engine;
  TrackingState<S> state;  ///< as of the last `measure`
  Eigen::MatrixXf seen;    ///< observations x lanes
  bool changed = true;     ///< whether a lane was put somewhere since the last step

  LaneGroup(const sim::Model& of, const sim::Parameters& parameters, const sim::Ground<T>& ground, const sim::Extras& extras,
            Eigen::Index observations)
      : model(&of), lanes(of, parameters, ground, extras), state(of.character), seen(Eigen::MatrixXf::Zero(observations, width)) {}

  /// Puts a lane into a pose (nq) and velocity (nv) with no memory of what was before.
  template <class U>
  void place(int lane, const U* q, const U* v) noexcept {
    for (S& x : lanes.state()) core::set_lane(x, lane, T(0));
    lanes.clear_failed(lane);
    lanes.reset_extras(lane);
    for (int i = 0; i < model->nq; ++i) core::set_lane(lanes.q()[i], lane, static_cast<T>(q[i]));
    for (int i = 0; i < model->nv; ++i) core::set_lane(lanes.v()[i], lane, static_cast<T>(v[i]));
    changed = true;
  }

  /// Asks the motors for `pose` (nq numbers) turned by the actions: a rotation vector for each ball joint, multiplied onto
  /// it from the right, an angle for each hinge. `action(i)` gives number i of nv - 6 for all lanes.
  template <class F>
  void turn_targets(const S* pose, F&& action) noexcept {
    S* const target = lanes.target();
    for (const sim::MovingBody& b : model->bodies) {
      if (b.type == body::JointType::ball) {
        const core::Vector3<S> turn{action(b.v_index - 6), action(b.v_index - 5), action(b.v_index - 4)};
        (core::Quaternion<S>::from(pose + b.q_index) * exp_map(turn)).store(target + b.q_index);
      } else if (b.type == body::JointType::hinge) {
        target[b.q_index] = pose[b.q_index] + action(b.v_index - 6);
      }
    }
  }

  /// The same by a batch's actions, those of lane l in column `first + l`: each number held within +-`limit`, then times
  /// `scale` (rad).
  void turn_targets(const S* pose, ConstColumns<float> actions, Eigen::Index first, double scale, double limit) noexcept {
    const S size(static_cast<T>(scale));
    const float most = static_cast<float>(limit);
    turn_targets(pose, [&](int i) {
      S a(T(0));
      for (int lane = 0; lane < width; ++lane) core::set_lane(a, lane, static_cast<T>(std::clamp(actions(i, first + lane), -most, most)));
      return S(size * a);
    });
  }

  /// One tick of a policy: `steps` of the dynamics, or as much time in the engine.
  void advance(double seconds, int steps) {
    if (changed) {
      lanes.refresh();
      if (engine) engine->begin(lanes, width);
      changed = false;
    }
    if (engine) {
      std::array<bool, static_cast<std::size_t>(width)> all;
      all.fill(true);
      engine->step(lanes, seconds, all);
    } else {
      lanes.step(steps);
    }
  }

  /// Brings `state` up to date with the lanes.
  void measure() noexcept {
    std::copy_n(lanes.q(), model->nq, state.q.data());
    std::copy_n(lanes.v(), model->nv, state.v.data());
    state.measure(model->character);
  }

  /// The greatest squared contact force on one of the named moving bodies in the last step, N^2.
  S greatest_force(const std::vector<int>& bodies) const noexcept {
    S touch(T(0));
    for (const int b : bodies) touch = core::max(touch, squared_norm(lanes.body_force()[static_cast<std::size_t>(b)]));
    return touch;
  }

  /// Sum over joints of |torque x rate|, W, from the law of the motors at the end of the last step: their springs' pull to
  /// the targets, damped, within their limits. A step's own torques are the dynamics' or the engine's secret.
  S motor_power() noexcept {
    S sum(T(0));
    for (const sim::MovingBody& b : model->bodies) {
      if (b.type != body::JointType::ball && b.type != body::JointType::hinge) continue;
      const body::Actuator& a = b.actuator;
      const S kp(static_cast<T>(a.stiffness)), kd(static_cast<T>(a.damping));
      const S* const q = lanes.q() + b.q_index;
      const S* const v = lanes.v() + b.v_index;
      const S* const target = lanes.target() + b.q_index;
      const bool ball = b.type == body::JointType::ball;
      const S none(T(0));
      const core::Vector3<S> rate{v[0], ball ? v[1] : none, ball ? v[2] : none};
      const core::Vector3<S> way = ball ? log_map(core::Quaternion<S>::from(q).conjugate() * core::Quaternion<S>::from(target))
                                        : core::Vector3<S>{target[0] - q[0], none, none};
      core::Vector3<S> torque = kp * way - kd * rate;
      if (std::isfinite(a.torque_limit)) {
        using std::sqrt;
        const S limit(static_cast<T>(a.torque_limit)), size = core::max(sqrt(squared_norm(torque)), limit);
        torque = (limit / core::max(size, S(T(1e-6)))) * torque;
      }
      for (const S& p : {S(torque.x * rate.x), S(torque.y * rate.y), S(torque.z * rate.z)}) sum += core::max(p, S(-p));
    }
    return sum;
  }

  FeatureWriter<S> writer() noexcept { return {seen.data(), seen.rows()}; }
};

/// Gives each group its engine, or the bundled dynamics back when there are none. Throws Error, which begins with `where`,
/// when there are too few, or one is for another character.
template <class S>
void use_engines(const char* where, std::vector<LaneGroup<S>*> groups, const std::vector<std::shared_ptr<control::Engine<S>>>& engines) {
  const std::string name(where);
  if (!engines.empty() && engines.size() < groups.size()) throw Error(name + ": expected an engine for each group of lanes");
  for (std::size_t g = 0; g < groups.size() && !engines.empty(); ++g)
    if (!engines[g]->fits(*groups[g]->model)) throw Error(name + ": the engine holds another character");
  for (std::size_t g = 0; g < groups.size(); ++g) groups[g]->engine = engines.empty() ? nullptr : engines[g];
}

/// A group in which each lane has a seat: what a task keeps of one environment.
template <class S, class Seat>
struct SeatedGroup : LaneGroup<S> {
  std::array<Seat, static_cast<std::size_t>(LaneGroup<S>::width)> seats{};

  using LaneGroup<S>::LaneGroup;
};

/// The environments of a task on the simulator: environment e is lane e % width of group e / width. `Group` is a
/// `SeatedGroup` or derived from one; seats have a count `left` of the steps that their episode may still last.
template <class Group>
class LaneGroups {
 public:
  using S = typename Group::Scalar;
  static constexpr int width = Group::width;

  LaneGroups() = default;
  /// Makes each group of `arguments`. Throws Error, which begins with `where`, unless the number of environments is a positive
  /// multiple of the pack's width.
  template <class... A>
  LaneGroups(const char* where, Eigen::Index environments, const A&... arguments) : where_(where) {
    if (environments < 1 || environments % width != 0)
      throw Error(where_ + ": expected a positive multiple of " + std::to_string(width) + " environments, got " + std::to_string(environments));
    groups_.reserve(static_cast<std::size_t>(environments / width));
    for (Eigen::Index g = 0; g < environments / width; ++g) groups_.push_back(std::make_unique<Group>(arguments...));
  }

  int size() const noexcept { return static_cast<int>(groups_.size()); }
  Eigen::Index environments() const noexcept { return static_cast<Eigen::Index>(groups_.size()) * width; }
  Group& operator[](int g) noexcept { return *groups_[static_cast<std::size_t>(g)]; }
  const Group& operator[](int g) const noexcept { return *groups_[static_cast<std::size_t>(g)]; }
  /// The environment in lane 0 of group g.
  static Eigen::Index first(int g) noexcept { return static_cast<Eigen::Index>(g) * width; }

  /// Where environment e is.
  Group& of(Eigen::Index e) noexcept { return (*this)[static_cast<int>(e / width)]; }
  const Group& of(Eigen::Index e) const noexcept { return (*this)[static_cast<int>(e / width)]; }
  static int lane(Eigen::Index e) noexcept { return static_cast<int>(e % width); }
  auto& seat(Eigen::Index e) noexcept { return of(e).seats[static_cast<std::size_t>(e % width)]; }
  const auto& seat(Eigen::Index e) const noexcept { return of(e).seats[static_cast<std::size_t>(e % width)]; }

  /// Lets engines move the lanes, as `use_engines` does.
  void use(const std::vector<std::shared_ptr<control::Engine<S>>>& engines) {
    std::vector<LaneGroup<S>*> groups;
    for (const auto& g : groups_) groups.push_back(g.get());
    use_engines<S>(where_.c_str(), groups, engines);
  }

  /// Writes what every lane shows.
  void observe(Columns<float> out) const noexcept {
    for (int g = 0; g < size(); ++g) out.middleCols(first(g), width) = (*this)[g].seen;
  }

  /// Empties every seat and has `restart(e)` begin its first episode, as environment `from` + e of the whole task. With
  /// `ages`, each keeps a random number of its steps, from one to all, as if it had begun at another time.
  template <class F>
  void reset(std::uint64_t seed, std::int64_t from, bool ages, F&& restart) {
    for (Eigen::Index e = 0; e < environments(); ++e) {
      auto& s = seat(e);
      s = {};
      restart(e);
      if (!ages) continue;
      core::RandomStream random(seed, static_cast<std::uint64_t>(from + e), age_step);
      s.left = 1 + static_cast<int>(random.uniform() * (s.left - 1));
    }
  }

 private:
  // No episode has this number.
  static constexpr std::uint64_t age_step = ~std::uint64_t{0};

  std::string where_;
  std::vector<std::unique_ptr<Group>> groups_;
};

}  // namespace traceur::learn
