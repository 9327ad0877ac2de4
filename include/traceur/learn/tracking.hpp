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

#include "traceur/core/executor.hpp"
#include "traceur/core/random.hpp"
#include "traceur/learn/environment.hpp"
#include "traceur/learn/lane_group.hpp"
#include "traceur/learn/prioritized_clips.hpp"
#include "traceur/learn/reference_motion.hpp"
#include "traceur/learn/tracking_reward.hpp"

namespace traceur::learn {

/// Where in its motion an episode begins, and in which: `anywhere` draws a part of a motion by how often episodes from there
/// fail, the others give the environments motions in turn.
enum class TrackingStart {
  anywhere,  ///< at a random tick of the part
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
  TrackingRewardParameters reward;  ///< DeepMimic's by default
  bool meet_again = true;     ///< whether the reference is put back over the root, horizontally, after each cycle
  TrackingStart start = TrackingStart::anywhere;
  double part_s = 0.25;          ///< about how long the parts are that motions are divided into
  double priority_floor = 0.01;  ///< of `PrioritizedClips`; 1: every part is begun from as often as any other
  bool spread_ages = false;   ///< whether the first episodes end at different times, so that later ones do not end together
  TrackingEndings endings;
  std::int64_t first_environment = 0;  ///< which of all environments the first is, where a task is shared out
  std::int64_t all_environments = 0;   ///< of the whole task; 0: these are all
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
        parts_(divide(motions_, settings)),
        priorities_(std::max(1, static_cast<int>(parts_.size())), settings.priority_floor),
        reward_(model.character.skeleton, end_effectors(model, roles), settings.reward) {
    if (motions_.empty()) throw Error("tracking: expected a motion");
    for (const ReferenceMotion& m : motions_) {
      if (m.poses.rows() != model.nq) throw Error("tracking: motion '" + m.name + "' is of another character");
      if (std::abs(m.tick * settings_.control_hz - 1) > 1e-9) throw Error("tracking: motion '" + m.name + "' has other ticks");
    }
    settings_.simulation.dt = 1 / (settings_.control_hz * settings_.steps_per_control);
    groups_ = LaneGroups<Group>("tracking", environments, model, settings_.simulation, ground_, extras, observations());
    reset(0);
  }

  Tracking(const Tracking&) = delete;
  Tracking& operator=(const Tracking&) = delete;

  Eigen::Index environments() const noexcept { return groups_.environments(); }
  Eigen::Index observations() const noexcept {
    const Eigen::Index joints = model_->nv - 6;
    return 13 + 2 * joints + 3 * (model_->character.skeleton.size() - 1) + 8 + 2 * (9 + joints);
  }
  Eigen::Index actions() const noexcept { return model_->nv - 6; }

  const std::vector<ReferenceMotion>& motions() const { return motions_; }
  const TrackingSettings& settings() const { return settings_; }
  const sim::Lanes<S>& lanes(Eigen::Index environment) const { return groups_.of(environment).lanes; }
  /// The tick of its motion that an environment is at, and how far its reference was moved (m).
  int tick(Eigen::Index environment) const { return groups_.seat(environment).tick; }
  int motion(Eigen::Index environment) const { return groups_.seat(environment).motion; }
  std::array<float, 2> shift(Eigen::Index environment) const { return groups_.seat(environment).shift; }

  /// How the last step ended the episode of an environment, if it did, and how far the joints were from the reference then,
  /// on average, m.
  TrackingEnd ending(Eigen::Index environment) const { return groups_.seat(environment).ending; }
  double joint_error(Eigen::Index environment) const { return groups_.seat(environment).joint_error; }
  /// Steps that the episode of an environment may still last.
  int steps_left(Eigen::Index environment) const { return groups_.seat(environment).left; }
  /// Which parts of motions episodes fail from, and so begin at more often, those of the first motion first. All there is to
  /// save beside the policy.
  PrioritizedClips& priorities() { return priorities_; }

  /// What the others of a task that is shared out must know of an episode's end: from which part, and whether it failed; -1
  /// while it goes on. `witness` takes it in, in the place of a `restart` that happens elsewhere.
  std::int32_t outcome(Eigen::Index environment) const noexcept {
    const Seat& s = groups_.seat(environment);
    return s.ending == TrackingEnd::running ? -1 : 2 * s.part + (s.ending != TrackingEnd::completed ? 1 : 0);
  }
  void witness(std::int32_t outcome) noexcept {
    if (outcome >= 0) priorities_.record(outcome / 2, outcome % 2 != 0);
  }

  /// Lets engines move the lanes, one for each `group_width()` environments; none: the bundled dynamics. Takes effect with
  /// the next `reset`. Throws Error when there are too few, or one is for another character.
  void use(const std::vector<std::shared_ptr<control::Engine<S>>>& engines) { groups_.use(engines); }
  static constexpr int group_width() { return width; }

  void reset(std::uint64_t seed) {
    seed_ = seed;
    groups_.reset(seed, settings_.first_environment, settings_.spread_ages, [&](Eigen::Index e) { restart(e); });
  }

  void observe(Columns<float> out) const noexcept { groups_.observe(out); }

  void step(ConstColumns<float> actions, StepResult<float>& result) noexcept {
    executor_->run(groups_.size(), [&](int g) {
      Group& of = groups_[g];
      const Eigen::Index first = groups_.first(g);
      act(of, actions, first);
      of.advance(1 / settings_.control_hz, settings_.steps_per_control);
      judge(of, result, first);
      look(of);
    });
  }

  void restart(Eigen::Index environment) noexcept {
    Seat& s = groups_.seat(environment);
    core::RandomStream random(seed_, stream_of(environment), s.episode++);
    witness(outcome(environment));
    s.ending = TrackingEnd::running;
    const std::int64_t number = settings_.first_environment + environment;
    if (settings_.start == TrackingStart::anywhere) {
      s.part = priorities_.sample(random);
      const Part& part = parts_[static_cast<std::size_t>(s.part)];
      s.motion = part.motion;
      s.tick = part.first + std::min(part.ticks - 1, static_cast<int>(random.uniform() * part.ticks));
    } else {
      const auto motions = static_cast<std::int64_t>(motions_.size());
      const std::int64_t all = settings_.all_environments > 0 ? settings_.all_environments : environments();
      s.motion = static_cast<int>(number % motions);
      s.tick = 0;
      if (settings_.start == TrackingStart::spread)
        s.tick = static_cast<int>(number / motions * of(s).ticks / std::max<std::int64_t>(1, all / motions));
      s.tick = std::min(s.tick, of(s).ticks - 1);
      s.part = part_of(s);
    }
    const ReferenceMotion& m = of(s);
    s.shift = {0, 0};
    s.left = length(s);
    Group& g = groups_.of(environment);
    g.place(groups_.lane(environment), m.poses.col(s.tick).data(), m.velocities.col(s.tick).data());
    g.measure();
    look(g);
  }

 private:
  /// One lane's place in its motion.
  struct Seat {
    int motion = 0, tick = 0, left = 0;
    int part = 0;  ///< that its episode began in
    std::array<float, 2> shift{0, 0};  ///< of the reference, m
    std::uint64_t episode = 0;
    TrackingEnd ending = TrackingEnd::running;
    double joint_error = 0;  ///< m
  };
  /// Ticks of a motion that episodes begin at together.
  struct Part {
    int motion, first, ticks;
  };
  struct Group : SeatedGroup<S, Seat> {
    TrackingState<S> reference;
    std::vector<S> ahead;  ///< a pose
    std::vector<S> contacts, reference_contacts;

    Group(const sim::Model& of, const sim::Parameters& p, const sim::Ground<T>& ground, const sim::Extras& extras, Eigen::Index observed)
        : SeatedGroup<S, Seat>(of, p, ground, extras, observed),
          reference(of.character),
          ahead(static_cast<std::size_t>(of.nq)),
          contacts(of.bodies.size()),
          reference_contacts(of.bodies.size()) {}
  };

  static S constant(double x) { return S(static_cast<T>(x)); }

  /// The parts of all motions, of one motion alike long but for a tick.
  static std::vector<Part> divide(const std::vector<ReferenceMotion>& motions, const TrackingSettings& settings) {
    if (!(settings.part_s > 0)) throw Error("tracking: part_s must be positive");
    std::vector<Part> out;
    for (std::size_t k = 0; k < motions.size(); ++k) {
      const int ticks = motions[k].ticks;
      const double wanted = std::round(ticks / (settings.part_s * settings.control_hz));
      const int count = static_cast<int>(std::clamp(wanted, 1.0, static_cast<double>(std::max(1, ticks))));
      for (int i = 0, first = 0; i < count; ++i) {
        const int end = (i + 1) * ticks / count;
        out.push_back({static_cast<int>(k), first, end - first});
        first = end;
      }
    }
    return out;
  }
  int part_of(const Seat& s) const noexcept {
    int p = 0;
    while (parts_[static_cast<std::size_t>(p)].motion != s.motion ||
           s.tick >= parts_[static_cast<std::size_t>(p)].first + parts_[static_cast<std::size_t>(p)].ticks)
      ++p;
    return p;
  }

  std::uint64_t stream_of(Eigen::Index e) const noexcept { return static_cast<std::uint64_t>(settings_.first_environment + e); }
  const ReferenceMotion& of(const Seat& s) const { return motions_[static_cast<std::size_t>(s.motion)]; }
  int length(const Seat& s) const {
    const ReferenceMotion& m = of(s);
    return m.cyclic ? std::max(1, static_cast<int>(std::lround(settings_.episode_s * settings_.control_hz))) : m.ticks - s.tick;
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
    gather(g, 1, g.ahead.data(), nullptr);
    g.turn_targets(g.ahead.data(), actions, first, settings_.action_scale, settings_.action_limit);
  }

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
    g.measure();
    gather(g, 0, g.reference.q.data(), g.reference.v.data());
    g.reference.measure(model_->character);
    const S reward = reward_(g.state, g.reference, evidence(g));
    const TrackingEndings& limits = settings_.endings;
    S farthest = constant(0), distance = constant(0);
    for (std::size_t j = 0; j < g.state.frames.position.size(); ++j) {
      const S d2 = squared_norm(g.state.frames.position[j] - g.reference.frames.position[j]);
      farthest = core::max(farthest, d2);
      using std::sqrt;
      distance += sqrt(d2);
    }
    const S touch = g.greatest_force(trunk_);
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

  /// What a reward asks about a group that was measured.
  TrackingEvidence<S> evidence(Group& g) const noexcept {
    TrackingEvidence<S> out{{}, {}, constant(0)};
    if (reward_.reads_power()) out.power = g.motor_power();
    if (!reward_.reads_contacts()) return out;
    const S touching = constant(settings_.endings.contact_force * settings_.endings.contact_force);
    for (std::size_t b = 0; b < g.contacts.size(); ++b) {
      g.contacts[b] = core::select(touching < squared_norm(g.lanes.body_force()[b]), constant(1), constant(0));
      for (int lane = 0; lane < width; ++lane) {
        const Seat& s = g.seats[static_cast<std::size_t>(lane)];
        const ReferenceMotion& m = of(s);
        const auto row = static_cast<Eigen::Index>(b);
        core::set_lane(g.reference_contacts[b], lane, static_cast<T>(row < m.contacts.rows() ? m.contacts(row, std::min(s.tick, m.ticks)) : 0.0f));
      }
    }
    out.contacts = g.contacts;
    out.reference_contacts = g.reference_contacts;
    return out;
  }

  /// Writes what the policy sees of a group that was measured.
  void look(Group& g) noexcept {
    using core::Quaternion;
    using core::Vector3;
    FeatureWriter<S> to = g.writer();
    const body::Skeleton& skeleton = model_->character.skeleton;
    const S* q = g.state.q.data();
    const S* v = g.state.v.data();
    const Vector3<S> root = Vector3<S>::from(q);
    const Quaternion<S> turn = Quaternion<S>::from(q + 3);
    to.put(q[2]);
    to.put_axes(turn);
    to.put(Vector3<S>::from(v));
    to.put(Vector3<S>::from(v + 3));
    to.put_joints(skeleton, q);
    for (int i = 6; i < model_->nv; ++i) to.put(v[i]);
    for (std::size_t j = 1; j < g.state.frames.position.size(); ++j) to.put(g.state.frames.position[j] - root);
    gather(g, 0, g.ahead.data(), nullptr);
    to.put(Vector3<S>::from(g.ahead.data()) - root);
    to.put(log_map(Quaternion<S>::from(g.ahead.data() + 3) * turn.conjugate()));
    float* const turns = to.skip(2);
    for (int lane = 0; lane < width; ++lane) {
      const Seat& s = g.seats[static_cast<std::size_t>(lane)];
      const ReferenceMotion& m = of(s);
      const double phase = (m.cyclic ? 2 : 1) * std::numbers::pi * s.tick / m.ticks;
      turns[lane * to.stride()] = static_cast<float>(std::sin(phase));
      turns[lane * to.stride() + 1] = static_cast<float>(std::cos(phase));
    }
    for (const int ticks : {1, 3}) {
      gather(g, ticks, g.ahead.data(), nullptr);
      to.put(Vector3<S>::from(g.ahead.data()) - root);
      to.put_axes(Quaternion<S>::from(g.ahead.data() + 3));
      to.put_joints(skeleton, g.ahead.data());
    }
  }

  const sim::Model* model_;
  std::vector<int> trunk_;
  std::vector<ReferenceMotion> motions_;
  TrackingSettings settings_;
  sim::Ground<T> ground_;
  E* executor_;
  std::vector<Part> parts_;
  PrioritizedClips priorities_;
  TrackingReward reward_;
  LaneGroups<Group> groups_;
  std::uint64_t seed_ = 0;
};

}  // namespace traceur::learn
