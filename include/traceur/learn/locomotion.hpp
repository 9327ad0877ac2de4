// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "traceur/core/executor.hpp"
#include "traceur/core/random.hpp"
#include "traceur/learn/character_observation.hpp"
#include "traceur/learn/environment.hpp"
#include "traceur/learn/lane_group.hpp"
#include "traceur/learn/reference_transitions.hpp"
#include "traceur/learn/target_speed.hpp"
#include "traceur/learn/termination.hpp"

namespace traceur::learn {

/// Where episodes begin, and with which goals.
enum class LocomotionStart {
  anywhere,  ///< at a random tick of a random motion; goals change at random, the first is the motion's own speed as often as not
  spread     ///< environments evenly over the ticks, their goals evenly over the speeds, straight ahead and for good
};

/// How a character moves about.
struct LocomotionSettings {
  double control_hz = 30;
  int steps_per_control = 16;
  double action_scale = 0.1;  ///< rad that an action of 1 turns a joint's target away from the rest pose
  double action_limit = 15;   ///< actions are limited to this size
  double episode_s = 20;
  TargetSpeed task;
  int history = 10;           ///< steps that a discriminator sees
  double contact_force = 1;   ///< N, on trunk or head: a fall
  double head_height = 0.3;   ///< m, of the head: a fall below it
  LocomotionStart start = LocomotionStart::anywhere;
  bool spread_ages = false;   ///< whether the first episodes end at different times
  std::int64_t first_environment = 0;  ///< which of all environments the first is, where a task is shared out
  std::int64_t all_environments = 0;   ///< of the whole task; 0: these are all
  sim::Parameters simulation;  ///< its dt is replaced by 1 / (control_hz x steps_per_control)
};

/// The task of moving at a wanted speed along a wanted heading (`TargetSpeed`), in the style that a discriminator judges
/// (Peng et al. 2021, "AMP"): each environment holds one lane of the bundled simulator, or of another engine. A model of
/// `Environments`; `observe_style` gives the histories that the discriminator reads. Motions serve as starts and to say what
/// pose actions turn joints away from: the mean over all of them.
///
/// Observations are `CharacterObservation` and the goal: no phase, no reference. Nothing but the start knows the motions.
template <class S, core::Executor E>
class Locomotion {
 public:
  using T = core::Element<S>;
  static constexpr int width = core::lane_count<S>;

  /// Throws Error when there is no motion, a motion is of another length of tick or character, the number of environments is
  /// no positive multiple of the pack's width, or a setting is out of its range.
  Locomotion(const sim::Model& model, const control::Roles& roles, std::vector<ReferenceMotion> motions, Eigen::Index environments,
             const LocomotionSettings& settings, const sim::Ground<T>& ground, const sim::Extras& extras, E& executor)
      : model_(&model),
        trunk_(trunk_bodies(roles)),
        motions_(std::move(motions)),
        settings_(settings),
        ground_(ground),
        executor_(&executor),
        features_(model.character.skeleton, end_effectors(model, roles)),
        transitions_(model.character, features_, motions_, settings.history),
        history_(features_.size(), settings.history, std::max<Eigen::Index>(1, environments)) {
    for (const ReferenceMotion& m : motions_)
      if (std::abs(m.tick * settings_.control_hz - 1) > 1e-9) throw Error("locomotion: motion '" + m.name + "' has other ticks");
    settings_.task.check();
    settings_.simulation.dt = 1 / (settings_.control_hz * settings_.steps_per_control);
    for (const int h : roles.head) head_.push_back(static_cast<std::size_t>(model.bodies[static_cast<std::size_t>(h)].joint));
    rest_ = mean_pose();
    for (const double x : rest_) rest_lanes_.push_back(constant(x));
    groups_ = LaneGroups<Group>("locomotion", environments, model, settings_.simulation, ground_, extras, observations(), features_.size());
    reset(0);
  }

  Locomotion(const Locomotion&) = delete;
  Locomotion& operator=(const Locomotion&) = delete;

  Eigen::Index environments() const noexcept { return groups_.environments(); }
  Eigen::Index observations() const noexcept { return CharacterObservation::size(model_->character.skeleton) + TargetSpeed::observations; }
  Eigen::Index actions() const noexcept { return model_->nv - 6; }
  /// Numbers in the history that a discriminator reads.
  Eigen::Index style_features() const noexcept { return transitions_.size(); }
  /// The same histories of the motions.
  const ReferenceTransitions& reference() const noexcept { return transitions_; }

  const std::vector<ReferenceMotion>& motions() const noexcept { return motions_; }
  const LocomotionSettings& settings() const noexcept { return settings_; }
  const sim::Lanes<S>& lanes(Eigen::Index environment) const noexcept { return groups_.of(environment).lanes; }
  const MovingGoal& goal(Eigen::Index environment) const noexcept { return groups_.seat(environment).goal; }
  /// Asks an environment for something else from now on.
  void ask(Eigen::Index environment, const MovingGoal& goal) noexcept {
    groups_.seat(environment).goal = goal;
    look(groups_.of(environment));
  }
  /// Speed of the centre of mass along the goal's heading in the last step, m/s.
  double speed(Eigen::Index environment) const noexcept { return groups_.seat(environment).along; }
  /// Steps that the episode of an environment may still last.
  int steps_left(Eigen::Index environment) const noexcept { return groups_.seat(environment).left; }
  /// The pose (nq) that actions turn joints away from.
  const Eigen::VectorXd& rest_pose() const noexcept { return rest_; }

  /// Lets engines move the lanes, one for each `group_width()` environments; none: the bundled dynamics. Takes effect with
  /// the next `reset`. Throws Error when there are too few, or one is for another character.
  void use(const std::vector<std::shared_ptr<control::Engine<S>>>& engines) { groups_.use(engines); }
  static constexpr int group_width() { return width; }

  void reset(std::uint64_t seed) {
    seed_ = seed;
    groups_.reset(seed, settings_.first_environment, settings_.spread_ages, [&](Eigen::Index e) { restart(e); });
  }

  void observe(Columns<float> out) const noexcept { groups_.observe(out); }
  /// The histories up to the state that `observe` shows, `style_features()` x environments.
  void observe_style(Columns<float> out) const noexcept { out = history_.columns(); }

  void step(ConstColumns<float> actions, StepResult<float>& result) noexcept {
    executor_->run(groups_.size(), [&](int g) {
      Group& of = groups_[g];
      const Eigen::Index first = groups_.first(g);
      of.turn_targets(rest_lanes_.data(), actions, first, settings_.action_scale, settings_.action_limit);
      of.advance(1 / settings_.control_hz, settings_.steps_per_control);
      of.measure();
      judge(of, result, first);
      FeatureWriter<S> style(of.style.data(), of.style.rows());
      features_.write(of.state, style);
      for (int lane = 0; lane < width; ++lane) std::copy_n(of.style.col(lane).data(), of.style.rows(), history_.push(first + lane));
      look(of);
    });
  }

  void restart(Eigen::Index environment) noexcept {
    Seat& s = groups_.seat(environment);
    core::RandomStream random(seed_, stream_of(environment), s.episode++ << goal_bits);
    const auto number = settings_.first_environment + environment;
    const auto all = settings_.all_environments > 0 ? settings_.all_environments : environments();
    const auto count = static_cast<std::int64_t>(motions_.size());
    const bool spread = settings_.start == LocomotionStart::spread;
    const int motion = spread ? static_cast<int>(number % count) : static_cast<int>(random.below(static_cast<std::uint32_t>(count)));
    const ReferenceMotion& m = motions_[static_cast<std::size_t>(motion)];
    const int first = transitions_.first(motion), choice = std::max(1, m.ticks - first);
    const int tick = first + (spread ? static_cast<int>(number / count * choice / std::max<std::int64_t>(1, all / count)) % choice
                                     : static_cast<int>(random.below(static_cast<std::uint32_t>(choice))));
    const float facing = heading_of(m, tick);
    s.goals = 1;
    s.goal = settings_.task.draw(facing, random);
    if (spread) {
      s.goal.heading = facing;
      s.goal.left_s = std::numeric_limits<float>::infinity();
      s.goal.speed = static_cast<float>(settings_.task.slowest + (settings_.task.fastest - settings_.task.slowest) *
                                                                     (static_cast<double>(number) + 0.5) / static_cast<double>(all));
    } else if (random.bernoulli(0.5)) {
      const float speed = std::hypot(m.velocities(0, tick), m.velocities(1, tick));
      s.goal.speed = std::clamp(speed, static_cast<float>(settings_.task.slowest), static_cast<float>(settings_.task.fastest));
      s.goal.heading = facing;
    }
    s.left = std::max(1, static_cast<int>(std::lround(settings_.episode_s * settings_.control_hz)));
    Group& g = groups_.of(environment);
    const int lane = groups_.lane(environment);
    g.place(lane, m.poses.col(tick).data(), m.velocities.col(tick).data());
    history_.fill(environment, transitions_.history(motion, tick));
    g.measure();
    s.along = static_cast<double>(std::cos(s.goal.heading)) * static_cast<double>(core::lane_of(g.state.center_velocity.x, lane)) +
              static_cast<double>(std::sin(s.goal.heading)) * static_cast<double>(core::lane_of(g.state.center_velocity.y, lane));
    look(g);
  }

 private:
  static constexpr int goal_bits = 16;

  struct Seat {
    int left = 0;
    std::uint64_t episode = 0, goals = 0;
    MovingGoal goal;
    double along = 0;  ///< m/s
  };
  struct Group : SeatedGroup<S, Seat> {
    Eigen::MatrixXf style;  ///< features of the newest step

    Group(const sim::Model& of, const sim::Parameters& p, const sim::Ground<T>& ground, const sim::Extras& extras, Eigen::Index observed,
          Eigen::Index features)
        : SeatedGroup<S, Seat>(of, p, ground, extras, observed), style(Eigen::MatrixXf::Zero(features, width)) {}
  };

  static S constant(double x) { return S(static_cast<T>(x)); }
  std::uint64_t stream_of(Eigen::Index e) const noexcept { return static_cast<std::uint64_t>(settings_.first_environment + e); }

  static float heading_of(const ReferenceMotion& m, int tick) noexcept {
    const auto q = core::Quaternion<float>::from(m.poses.col(tick).data() + 3);
    const core::Vector3<float> forward = q.rotate(core::Vector3<float>{1, 0, 0});
    return std::atan2(forward.y, forward.x);
  }

  /// The joints' mean over all ticks: rotations averaged in the tangent space of the neutral pose.
  Eigen::VectorXd mean_pose() const {
    const body::Skeleton& skeleton = model_->character.skeleton;
    const Eigen::VectorXd neutral = skeleton.neutral_pose();
    Eigen::VectorXd sum = Eigen::VectorXd::Zero(skeleton.nv()), d(skeleton.nv()), mean = neutral;
    double ticks = 0;
    for (const ReferenceMotion& m : motions_)
      for (int t = 0; t < m.ticks; ++t) {
        const Eigen::VectorXd q = m.poses.col(t).cast<double>();
        body::difference(skeleton, neutral.data(), q.data(), d.data());
        sum += d;
        ++ticks;
      }
    sum.head(6).setZero();
    sum /= std::max(1.0, ticks);
    body::displace(skeleton, neutral.data(), sum.data(), mean.data());
    body::normalize(skeleton, mean.data());
    return mean;
  }

  /// The goals of a group's lanes: speed, cosine and sine of the heading.
  std::array<S, 3> goals(const Group& g) const noexcept {
    std::array<S, 3> out{constant(0), constant(0), constant(0)};
    for (int lane = 0; lane < width; ++lane) {
      const MovingGoal& goal = g.seats[static_cast<std::size_t>(lane)].goal;
      core::set_lane(out[0], lane, static_cast<T>(goal.speed));
      core::set_lane(out[1], lane, static_cast<T>(std::cos(goal.heading)));
      core::set_lane(out[2], lane, static_cast<T>(std::sin(goal.heading)));
    }
    return out;
  }

  /// Tells what the step gave, then lets goals go on.
  void judge(Group& g, StepResult<float>& result, Eigen::Index first) noexcept {
    const std::array<S, 3> wanted = goals(g);
    const core::Vector3<S>& velocity = g.state.center_velocity;
    const S reward = settings_.task.reward(velocity, heading_frame(g.state), wanted[0], wanted[1], wanted[2]);
    const S along = wanted[1] * velocity.x + wanted[2] * velocity.y;
    const S touch = g.greatest_force(trunk_);
    S lowest = constant(std::numeric_limits<float>::max());
    for (const std::size_t h : head_) lowest = core::min(lowest, g.state.frames.position[h].z);
    for (int lane = 0; lane < width; ++lane) {
      Seat& s = g.seats[static_cast<std::size_t>(lane)];
      const Eigen::Index e = first + lane;
      const double earned = static_cast<double>(core::lane_of(reward, lane));
      --s.left;
      s.along = static_cast<double>(core::lane_of(along, lane));
      if (g.lanes.failed(lane) || !std::isfinite(earned)) {
        result.end[e] = End::failed;
        continue;
      }
      if (core::lane_of(touch, lane) > T(settings_.contact_force * settings_.contact_force) ||
          head_down(static_cast<double>(core::lane_of(lowest, lane)), settings_.head_height)) {
        result.end[e] = End::terminated;
        continue;
      }
      result.reward[e] = static_cast<float>(earned);
      if (s.left <= 0) {
        result.end[e] = End::timed_out;
        continue;
      }
      s.goal.left_s -= static_cast<float>(1 / settings_.control_hz);
      if (s.goal.left_s > 0) continue;
      core::RandomStream random(seed_, stream_of(e), ((s.episode - 1) << goal_bits) + s.goals++);
      s.goal = settings_.task.draw(s.goal.heading, random);
    }
  }

  /// Writes what the policy sees of a group that was measured.
  void look(Group& g) noexcept {
    FeatureWriter<S> to = g.writer();
    CharacterObservation::write(model_->character.skeleton, g.state, constant(0), to);
    const std::array<S, 3> wanted = goals(g);
    TargetSpeed::observe(heading_frame(g.state), wanted[0], wanted[1], wanted[2], to);
  }

  const sim::Model* model_;
  std::vector<int> trunk_;
  std::vector<std::size_t> head_;  ///< joints
  std::vector<ReferenceMotion> motions_;
  LocomotionSettings settings_;
  sim::Ground<T> ground_;
  E* executor_;
  DiscriminatorFeatures features_;
  ReferenceTransitions transitions_;
  FeatureHistory history_;
  Eigen::VectorXd rest_;
  std::vector<S> rest_lanes_;
  LaneGroups<Group> groups_;
  std::uint64_t seed_ = 0;
};

}  // namespace traceur::learn
