// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "traceur/control/engine.hpp"
#include "traceur/core/executor.hpp"
#include "traceur/core/random.hpp"
#include "traceur/learn/deepmimic_reward.hpp"
#include "traceur/learn/environment.hpp"
#include "traceur/learn/prioritized_clips.hpp"
#include "traceur/learn/reference_motion.hpp"
#include "traceur/learn/tracking_error.hpp"
#include "traceur/sim/lanes.hpp"

namespace traceur::learn {

/// Where in its motion an episode begins, and in which: `anywhere` draws the motion by how often it fails, the others give
/// the environments motions in turn.
enum class TrackingStart {
  anywhere,  ///< at a random tick
  begin,     ///< at the first
  spread     ///< environments evenly over the ticks
};

/// When an episode of tracking ends before its time.
struct TrackingEndings {
  double part_distance = 1;  ///< m, of any joint from the reference: a drift
  double root_angle = 1.6;   ///< rad, of the root from the reference: a fall
  double contact_force = 1;  ///< N, on trunk or head, unless the motion itself puts them on the ground: a fall
};

/// How motions are tracked.
struct TrackingSettings {
  double control_hz = 30;
  int steps_per_control = 16;
  double action_scale = 0.1;  ///< rad that an action of 1 turns a joint's target away from the reference
  double action_limit = 15;   ///< actions are limited to this size
  double episode_s = 20;      ///< of cyclic motions; others last as long as they do
  DeepMimicRewardParameters reward;
  bool meet_again = true;     ///< whether the reference is put back over the root, horizontally, after each cycle
  TrackingStart start = TrackingStart::anywhere;
  bool spread_ages = false;   ///< whether the first episodes end at different times, so that later ones do not end together
  TrackingEndings endings;
  sim::Parameters simulation;  ///< its dt is replaced by 1 / (control_hz x steps_per_control)
};

/// How an episode of tracking ended.
enum class TrackingEnd {
  running,    ///< it has not
  completed,  ///< in its time, tracking
  fall,       ///< a forbidden touch, or the root turned too far from the reference
  drift,      ///< a joint too far from the reference
  failure     ///< the simulation gave a number that is not finite
};

/// The task of tracking motions (Peng et al. 2018, "DeepMimic"): each environment holds one lane of the bundled simulator,
/// or of another engine, and follows one motion. A model of `Environments`.
///
/// Actions turn the joints' targets away from the reference pose of the next tick: a rotation vector for each ball joint, an
/// angle for each hinge, times `action_scale`. Observations are in world axes (motions begin heading along +x): height, axes
/// and velocities of the root, the joints' rotations and speeds, their places from the root, the reference's root from the
/// simulated one, the phase, and the reference one and three ticks ahead.
template <class S, core::Executor E>
class Tracking {
 public:
  using T = core::Element<S>;
  static constexpr int width = core::lane_count<S>;

  /// Throws Error when there is no motion, a motion is of another length of tick or character, or the number of
  /// environments is no positive multiple of the pack's width.
  Tracking(const sim::Model& model, const control::Roles& roles, std::vector<ReferenceMotion> motions, Eigen::Index environments,
           const TrackingSettings& settings, const sim::Ground<T>& ground, const sim::Extras& extras, E& executor)
      : model_(&model),
        trunk_(trunk_bodies(roles)),
        motions_(std::move(motions)),
        settings_(settings),
        ground_(ground),
        executor_(&executor),
        priorities_(std::max(1, static_cast<int>(motions_.size()))),
        reward_(model.character.skeleton, joint_weights(model.character.skeleton, deepmimic_joint_weights),
                end_effectors(model, roles), settings.reward) {
    if (motions_.empty()) throw Error("tracking: expected a motion");
    if (environments < 1 || environments % width != 0)
      throw Error("tracking: expected a positive multiple of " + std::to_string(width) + " environments, got " +
                  std::to_string(environments));
    for (const ReferenceMotion& m : motions_) {
      if (m.poses.rows() != model.nq) throw Error("tracking: motion '" + m.name + "' is of another character");
      if (std::abs(m.tick * settings_.control_hz - 1) > 1e-9) throw Error("tracking: motion '" + m.name + "' has other ticks");
    }
    settings_.simulation.dt = 1 / (settings_.control_hz * settings_.steps_per_control);
    const auto groups = static_cast<std::size_t>(environments / width);
    groups_.reserve(groups);
    for (std::size_t g = 0; g < groups; ++g) groups_.emplace_back(model, settings_.simulation, ground_, extras, observations());
    reset(0);
  }

  Tracking(const Tracking&) = delete;
  Tracking& operator=(const Tracking&) = delete;

  Eigen::Index environments() const noexcept { return static_cast<Eigen::Index>(groups_.size()) * width; }
  Eigen::Index observations() const noexcept {
    const Eigen::Index joints = model_->nv - 6;
    return 13 + 2 * joints + 3 * (model_->character.skeleton.size() - 1) + 8 + 2 * (9 + joints);
  }
  Eigen::Index actions() const noexcept { return model_->nv - 6; }

  const std::vector<ReferenceMotion>& motions() const { return motions_; }
  const TrackingSettings& settings() const { return settings_; }
  const sim::Lanes<S>& lanes(Eigen::Index environment) const { return group(environment).lanes; }
  /// The tick of its motion that an environment is at, and how far its reference was moved (m).
  int tick(Eigen::Index environment) const { return place(environment).tick; }
  int motion(Eigen::Index environment) const { return place(environment).motion; }
  std::array<float, 2> shift(Eigen::Index environment) const { return place(environment).shift; }

  /// How the last step ended the episode of an environment, if it did, and how far the joints were from the reference then,
  /// on average, m.
  TrackingEnd ending(Eigen::Index environment) const { return place(environment).ending; }
  double joint_error(Eigen::Index environment) const { return place(environment).joint_error; }
  /// Steps that the episode of an environment may still last.
  int steps_left(Eigen::Index environment) const { return place(environment).left; }
  /// Which motions fail, and so are begun more often. All there is to save beside the policy.
  PrioritizedClips& priorities() { return priorities_; }

  /// Lets engines move the lanes, one for each `group_width()` environments; none: the bundled dynamics. Takes effect with
  /// the next `reset`. Throws Error when there are too few, or one is for another character.
  void use(std::vector<std::shared_ptr<control::Engine<S>>> engines) {
    if (!engines.empty() && engines.size() < groups_.size()) throw Error("tracking: expected an engine for each group of lanes");
    for (std::size_t g = 0; g < groups_.size(); ++g) {
      groups_[g].engine = engines.empty() ? nullptr : engines[g];
      if (groups_[g].engine && !groups_[g].engine->fits(*model_)) throw Error("tracking: the engine holds another character");
    }
  }
  static constexpr int group_width() { return width; }

  void reset(std::uint64_t seed) {
    seed_ = seed;
    for (Eigen::Index e = 0; e < environments(); ++e) {
      Seat& s = place(e);
      s = Seat{};
      restart(e);
      if (!settings_.spread_ages) continue;
      core::RandomStream random(seed_, static_cast<std::uint64_t>(e), age_step);
      s.left = 1 + static_cast<int>(random.uniform() * (s.left - 1));
    }
  }

  void observe(Columns<float> out) const noexcept {
    for (std::size_t g = 0; g < groups_.size(); ++g) out.middleCols(static_cast<Eigen::Index>(g) * width, width) = groups_[g].seen;
  }

  void step(ConstColumns<float> actions, StepResult<float>& result) noexcept {
    executor_->run(static_cast<int>(groups_.size()), [&](int g) {
      Group& of = groups_[static_cast<std::size_t>(g)];
      const Eigen::Index first = static_cast<Eigen::Index>(g) * width;
      act(of, actions, first);
      if (of.engine) {
        std::array<bool, static_cast<std::size_t>(width)> all;
        all.fill(true);
        of.engine->step(of.lanes, 1 / settings_.control_hz, all);
      } else {
        of.lanes.step(settings_.steps_per_control);
      }
      judge(of, result, first);
      look(of);
    });
  }

  void restart(Eigen::Index environment) noexcept {
    Seat& s = place(environment);
    core::RandomStream random(seed_, static_cast<std::uint64_t>(environment), s.episode++);
    if (s.ending != TrackingEnd::running) priorities_.record(s.motion, s.ending != TrackingEnd::completed);
    s.ending = TrackingEnd::running;
    s.motion = settings_.start == TrackingStart::anywhere ? priorities_.sample(random)
                                                          : static_cast<int>(environment % static_cast<Eigen::Index>(motions_.size()));
    const ReferenceMotion& m = of(s);
    s.tick = 0;
    if (settings_.start == TrackingStart::anywhere)
      s.tick = std::min(m.ticks - 1, static_cast<int>(random.uniform() * m.ticks));
    if (settings_.start == TrackingStart::spread) {
      const auto motions = static_cast<Eigen::Index>(motions_.size());
      s.tick = static_cast<int>(environment / motions * m.ticks / std::max<Eigen::Index>(1, environments() / motions));
      s.tick = std::min(s.tick, m.ticks - 1);
    }
    s.shift = {0, 0};
    s.left = length(s);
    Group& g = group(environment);
    const int lane = static_cast<int>(environment % width);
    for (S& x : g.lanes.state()) core::set_lane(x, lane, T(0));
    g.lanes.clear_failed(lane);
    g.lanes.reset_extras(lane);
    for (int i = 0; i < model_->nq; ++i) core::set_lane(g.lanes.q()[i], lane, static_cast<T>(m.poses(i, s.tick)));
    for (int i = 0; i < model_->nv; ++i) core::set_lane(g.lanes.v()[i], lane, static_cast<T>(m.velocities(i, s.tick)));
    g.changed = true;
    measure(g);
    look(g);
  }

 private:
  static constexpr std::uint64_t age_step = ~std::uint64_t{0};

  /// One lane's place in its motion.
  struct Seat {
    int motion = 0, tick = 0, left = 0;
    std::array<float, 2> shift{0, 0};  ///< of the reference, m
    std::uint64_t episode = 0;
    TrackingEnd ending = TrackingEnd::running;
    double joint_error = 0;  ///< m
  };
  struct Group {
    sim::Lanes<S> lanes;
    std::shared_ptr<control::Engine<S>> engine;
    std::array<Seat, static_cast<std::size_t>(width)> seats;
    TrackingState<S> state, reference;
    std::vector<S> ahead, target;  ///< poses
    Eigen::MatrixXf seen;
    bool changed = true;  ///< whether a lane was put somewhere since the last look

    Group(const sim::Model& model, const sim::Parameters& p, const sim::Ground<T>& ground, const sim::Extras& extras, Eigen::Index observed)
        : lanes(model, p, ground, extras),
          state(model.character),
          reference(model.character),
          ahead(static_cast<std::size_t>(model.nq)),
          target(static_cast<std::size_t>(model.nq)),
          seen(observed, width) {}
  };

  static S constant(double x) { return S(static_cast<T>(x)); }

  Group& group(Eigen::Index e) { return groups_[static_cast<std::size_t>(e / width)]; }
  const Group& group(Eigen::Index e) const { return groups_[static_cast<std::size_t>(e / width)]; }
  Seat& place(Eigen::Index e) { return group(e).seats[static_cast<std::size_t>(e % width)]; }
  const Seat& place(Eigen::Index e) const { return group(e).seats[static_cast<std::size_t>(e % width)]; }
  const ReferenceMotion& of(const Seat& s) const { return motions_[static_cast<std::size_t>(s.motion)]; }
  int length(const Seat& s) const {
    const ReferenceMotion& m = of(s);
    return m.cyclic ? std::max(1, static_cast<int>(std::lround(settings_.episode_s * settings_.control_hz))) : m.ticks - s.tick;
  }

  /// What hands and feet are to a skeleton: where its chains below the root end, the head left out.
  static std::vector<int> end_effectors(const sim::Model& model, const control::Roles& roles) {
    const body::Skeleton& skeleton = model.character.skeleton;
    std::vector<bool> leaf(static_cast<std::size_t>(skeleton.size()), true);
    for (int i = 1; i < skeleton.size(); ++i) leaf[static_cast<std::size_t>(skeleton[i].parent)] = false;
    for (const int h : roles.head) leaf[static_cast<std::size_t>(model.bodies[static_cast<std::size_t>(h)].joint)] = false;
    std::vector<int> out;
    for (int i = 1; i < skeleton.size(); ++i)
      if (leaf[static_cast<std::size_t>(i)]) out.push_back(i);
    return out;
  }

  /// The reference of every lane, `ticks` ahead of where it is. A cycle goes on; what is done once stays at its end.
  void gather(Group& g, int ticks, S* pose, S* velocity) const {
    for (int lane = 0; lane < width; ++lane) {
      const Seat& s = g.seats[static_cast<std::size_t>(lane)];
      const ReferenceMotion& m = of(s);
      int t = s.tick + ticks;
      float x = s.shift[0], y = s.shift[1];
      if (!m.cyclic) t = std::min(t, m.ticks);
      for (; m.cyclic && t >= m.ticks; t -= m.ticks) {
        x += m.carry[0];
        y += m.carry[1];
      }
      const float* q = m.poses.col(t).data();
      core::set_lane(pose[0], lane, static_cast<T>(q[0] + x));
      core::set_lane(pose[1], lane, static_cast<T>(q[1] + y));
      for (int i = 2; i < model_->nq; ++i) core::set_lane(pose[i], lane, static_cast<T>(q[i]));
      if (!velocity) continue;
      const float* v = m.velocities.col(t).data();
      for (int i = 0; i < model_->nv; ++i) core::set_lane(velocity[i], lane, static_cast<T>(v[i]));
    }
  }

  void act(Group& g, ConstColumns<float> actions, Eigen::Index first) noexcept {
    using core::Quaternion;
    using core::Vector3;
    if (g.changed) {
      g.lanes.refresh();
      if (g.engine) g.engine->begin(g.lanes, width);
      g.changed = false;
    }
    gather(g, 1, g.ahead.data(), nullptr);
    const S scale = constant(settings_.action_scale);
    const auto action = [&](int i) {
      S a = constant(0);
      for (int lane = 0; lane < width; ++lane) {
        const float x = actions(i, first + lane);
        core::set_lane(a, lane, static_cast<T>(std::clamp(x, -limit(), limit())));
      }
      return scale * a;
    };
    S* target = g.lanes.target();
    for (const sim::MovingBody& b : model_->bodies) {
      const auto at = static_cast<std::size_t>(b.q_index);
      if (b.type == body::JointType::ball) {
        const Vector3<S> turn{action(b.v_index - 6), action(b.v_index - 5), action(b.v_index - 4)};
        (Quaternion<S>::from(&g.ahead[at]) * exp_map(turn)).store(target + b.q_index);
      } else if (b.type == body::JointType::hinge) {
        target[at] = g.ahead[at] + action(b.v_index - 6);
      }
    }
  }
  float limit() const { return static_cast<float>(settings_.action_limit); }

  /// Moves the references on by a tick and tells what the step gave.
  void judge(Group& g, StepResult<float>& result, Eigen::Index first) noexcept {
    for (int lane = 0; lane < width; ++lane) {
      Seat& s = g.seats[static_cast<std::size_t>(lane)];
      const ReferenceMotion& m = of(s);
      --s.left;
      if (++s.tick < m.ticks || !m.cyclic) continue;
      s.tick = 0;
      s.shift[0] += m.carry[0];
      s.shift[1] += m.carry[1];
      if (!settings_.meet_again) continue;
      const float x = static_cast<float>(core::lane_of(g.lanes.q()[0], lane)), y = static_cast<float>(core::lane_of(g.lanes.q()[1], lane));
      if (std::isfinite(x) && std::isfinite(y)) s.shift = {x - m.poses(0, 0), y - m.poses(1, 0)};
    }
    measure(g);
    gather(g, 0, g.reference.q.data(), g.reference.v.data());
    g.reference.measure(model_->character);
    const S reward = reward_(g.state, g.reference);
    const TrackingEndings& limits = settings_.endings;
    S farthest = constant(0), distance = constant(0);
    for (std::size_t j = 0; j < g.state.frames.position.size(); ++j) {
      const S d2 = squared_norm(g.state.frames.position[j] - g.reference.frames.position[j]);
      farthest = core::max(farthest, d2);
      using std::sqrt;
      distance += sqrt(d2);
    }
    S touch = constant(0);
    for (const int b : trunk_) touch = core::max(touch, squared_norm(g.lanes.body_force()[static_cast<std::size_t>(b)]));
    const S turned = squared_angle(g.state.frames.rotation[0], g.reference.frames.rotation[0]);
    for (int lane = 0; lane < width; ++lane) {
      Seat& s = g.seats[static_cast<std::size_t>(lane)];
      const Eigen::Index e = first + lane;
      const double earned = static_cast<double>(core::lane_of(reward, lane));
      s.ending = TrackingEnd::running;
      s.joint_error = static_cast<double>(core::lane_of(distance, lane)) / static_cast<double>(g.state.frames.position.size());
      if (g.lanes.failed(lane) || !std::isfinite(earned)) {
        s.ending = TrackingEnd::failure;
        result.end[e] = End::failed;
        continue;
      }
      const bool touched = core::lane_of(touch, lane) > T(limits.contact_force * limits.contact_force);
      if (core::lane_of(turned, lane) > T(limits.root_angle * limits.root_angle) || (touched && !of(s).trunk_touches)) {
        s.ending = TrackingEnd::fall;
      } else if (core::lane_of(farthest, lane) > T(limits.part_distance * limits.part_distance)) {
        s.ending = TrackingEnd::drift;
      } else {
        result.reward[e] = static_cast<float>(earned);
        if (s.left <= 0) s.ending = TrackingEnd::completed;
      }
      if (s.ending == TrackingEnd::running) continue;
      result.end[e] = s.ending == TrackingEnd::completed ? End::timed_out : End::terminated;
    }
  }

  /// Frames and velocities of the simulated characters.
  void measure(Group& g) const noexcept {
    std::copy_n(g.lanes.q(), model_->nq, g.state.q.data());
    std::copy_n(g.lanes.v(), model_->nv, g.state.v.data());
    g.state.measure(model_->character);
  }

  void put(Group& g, Eigen::Index& row, const S& x) const noexcept {
    for (int lane = 0; lane < width; ++lane) g.seen(row, lane) = static_cast<float>(core::lane_of(x, lane));
    ++row;
  }
  void put(Group& g, Eigen::Index& row, const core::Vector3<S>& v) const noexcept {
    put(g, row, v.x);
    put(g, row, v.y);
    put(g, row, v.z);
  }
  void put_joints(Group& g, Eigen::Index& row, const S* q) const noexcept {
    for (const sim::MovingBody& b : model_->bodies) {
      if (b.type == body::JointType::ball) put(g, row, log_map(core::Quaternion<S>::from(q + b.q_index)));
      if (b.type == body::JointType::hinge) put(g, row, q[b.q_index]);
    }
  }
  void put_axes(Group& g, Eigen::Index& row, const core::Quaternion<S>& r) const noexcept {
    const core::Matrix3<S> m = r.matrix();
    put(g, row, core::Vector3<S>{m.xx, m.yx, m.zx});
    put(g, row, core::Vector3<S>{m.xz, m.yz, m.zz});
  }

  /// Writes what the policy sees of a group that was measured.
  void look(Group& g) noexcept {
    using core::Quaternion;
    using core::Vector3;
    Eigen::Index row = 0;
    const S* q = g.state.q.data();
    const S* v = g.state.v.data();
    const Vector3<S> root = Vector3<S>::from(q);
    const Quaternion<S> turn = Quaternion<S>::from(q + 3);
    put(g, row, q[2]);
    put_axes(g, row, turn);
    put(g, row, Vector3<S>::from(v));
    put(g, row, Vector3<S>::from(v + 3));
    put_joints(g, row, q);
    for (int i = 6; i < model_->nv; ++i) put(g, row, v[i]);
    for (std::size_t j = 1; j < g.state.frames.position.size(); ++j) put(g, row, g.state.frames.position[j] - root);
    gather(g, 0, g.ahead.data(), nullptr);
    put(g, row, Vector3<S>::from(g.ahead.data()) - root);
    put(g, row, log_map(Quaternion<S>::from(g.ahead.data() + 3) * turn.conjugate()));
    for (int lane = 0; lane < width; ++lane) {
      const Seat& s = g.seats[static_cast<std::size_t>(lane)];
      const ReferenceMotion& m = of(s);
      const double phase = (m.cyclic ? 2 : 1) * std::numbers::pi * s.tick / m.ticks;
      g.seen(row, lane) = static_cast<float>(std::sin(phase));
      g.seen(row + 1, lane) = static_cast<float>(std::cos(phase));
    }
    row += 2;
    for (const int ticks : {1, 3}) {
      gather(g, ticks, g.ahead.data(), nullptr);
      put(g, row, Vector3<S>::from(g.ahead.data()) - root);
      put_axes(g, row, Quaternion<S>::from(g.ahead.data() + 3));
      put_joints(g, row, g.ahead.data());
    }
  }

  const sim::Model* model_;
  std::vector<int> trunk_;
  std::vector<ReferenceMotion> motions_;
  TrackingSettings settings_;
  sim::Ground<T> ground_;
  E* executor_;
  PrioritizedClips priorities_;
  DeepMimicReward reward_;
  std::vector<Group> groups_;
  std::uint64_t seed_ = 0;
};

}  // namespace traceur::learn
