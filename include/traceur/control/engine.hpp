// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "traceur/body/pose.hpp"
#include "traceur/core/error.hpp"
#include "traceur/sim/lanes.hpp"
#include "traceur/sim/simulator.hpp"
#include "traceur/sim/world.hpp"

namespace traceur::control {

/// What moves the lanes of a pack in place of the bundled dynamics. Sensing, laws and judging go on reading the lanes. One
/// object is for one pack and one thread at a time.
template <class S>
class Engine {
 public:
  Engine() = default;
  Engine(const Engine&) = delete;
  Engine& operator=(const Engine&) = delete;
  virtual ~Engine() = default;

  /// Whether its character has the joints of this model, one for one.
  virtual bool fits(const sim::Model& model) const = 0;
  /// Takes the first `used` lanes as they are, with no memory of what was before.
  virtual void begin(const sim::Lanes<S>& lanes, int used) = 0;
  /// Force (N, world) on moving body `body` at a point of its frame (m), during the next call of `step`.
  virtual void push(int lane, int body, const core::Vector3<double>& force, const core::Vector3<double>& point) = 0;
  /// Ties a place on the character to one in the world (m) until it is released. Throws Error where it knows no grips.
  virtual void hold(int /*lane*/, const sim::GripPoint&, const core::Vector3<double>& /*anchor*/) { throw Error("engine: it knows no grips"); }
  virtual void release(int /*lane*/, const sim::GripPoint&) {}
  /// Moves the lanes that are wanted by `seconds` towards their targets and writes into them poses, velocities, mean contact
  /// forces and failures, refreshed. Other lanes may stay where they are. Throws Error when it cannot step by that much.
  virtual void step(sim::Lanes<S>& lanes, double seconds, std::span<const bool> wanted) = 0;
};

namespace detail {

/// Mean contact force on a moving body, N; zero of simulators that do not tell.
template <class W>
core::Vector3<double> contact_force(const W& w, int lane, int /*body*/, int joint) {
  if constexpr (requires { w.contact_force(lane, joint).template cast<double>(); })
    return w.contact_force(lane, joint).template cast<double>();
  else
    return {0, 0, 0};
}
template <class U>
core::Vector3<double> contact_force(const sim::World<U>& w, int lane, int body, int /*joint*/) {
  return w.contact_force(lane, body).template cast<double>();
}

}  // namespace detail

/// Any simulators as an engine. Each is stepped while one of its lanes is wanted, so many of one lane save work.
template <class S, sim::Simulator W>
class SimulatorEngine final : public Engine<S> {
 public:
  using T = core::Element<S>;
  static constexpr int width = core::lane_count<S>;

  /// Throws Error when all simulators together have fewer lanes than the pack.
  explicit SimulatorEngine(std::vector<W> simulators) : simulators_(std::move(simulators)) {
    for (std::size_t k = 0; k < simulators_.size(); ++k)
      for (int l = 0; l < simulators_[k].lanes() && seats_.size() < width; ++l) seats_.push_back({k, l});
    if (seats_.size() < width)
      throw Error("engine: expected simulators of " + std::to_string(width) + " lanes, found " + std::to_string(seats_.size()));
    model_ = sim::make_model(simulators_[0].character());
    q_ = model_.character.skeleton.neutral_pose();
    v_ = Eigen::VectorXd::Zero(model_.nv);
  }

  const std::vector<W>& simulators() const { return simulators_; }

  bool fits(const sim::Model& model) const override {
    if (model.nq != model_.nq || model.nv != model_.nv || model.bodies.size() != model_.bodies.size()) return false;
    for (std::size_t b = 0; b < model.bodies.size(); ++b)
      if (model.bodies[b].joint != model_.bodies[b].joint || model.bodies[b].type != model_.bodies[b].type) return false;
    return true;
  }

  void begin(const sim::Lanes<S>& lanes, int used) override {
    for (int l = 0; l < used; ++l) {
      for (int i = 0; i < model_.nq; ++i) q_[i] = core::lane_of(lanes.q()[i], l);
      for (int i = 0; i < model_.nv; ++i) v_[i] = core::lane_of(lanes.v()[i], l);
      // A pack of floats holds unit quaternions to seven digits only.
      body::normalize(model_.character.skeleton, q_.data());
      simulator(l).reset(seat(l).lane, q_, v_);
    }
  }

  void push(int lane, int body, const core::Vector3<double>& force, const core::Vector3<double>& point) override {
    const int joint = model_.bodies[static_cast<std::size_t>(body)].joint;
    if constexpr (requires(W w) { w.push(lane, joint, force, point); })
      simulator(lane).push(seat(lane).lane, joint, force, point);
    else
      throw Error("engine: its simulator knows no pushes");
  }

  void hold(int lane, const sim::GripPoint& grip, const core::Vector3<double>& anchor) override {
    if constexpr (requires(W w) { w.hold(lane, grip.joint, grip.point, anchor); })
      simulator(lane).hold(seat(lane).lane, grip.joint, grip.point, anchor);
    else
      Engine<S>::hold(lane, grip, anchor);
  }
  void release(int lane, const sim::GripPoint& grip) override {
    if constexpr (requires(W w) { w.release(lane, grip.joint); }) simulator(lane).release(seat(lane).lane, grip.joint);
  }

  void step(sim::Lanes<S>& lanes, double seconds, std::span<const bool> wanted) override {
    const auto asked = [&](int l) { return l < static_cast<int>(wanted.size()) && wanted[static_cast<std::size_t>(l)]; };
    for (int l = 0; l < width; ++l) {
      if (!asked(l)) continue;
      for (int i = 0; i < model_.nq; ++i) q_[i] = core::lane_of(lanes.target()[i], l);
      simulator(l).set_target(seat(l).lane, q_);
    }
    for (int l = 0; l < width;) {
      const std::size_t group = seat(l).simulator;
      bool needed = false;
      for (; l < width && seat(l).simulator == group; ++l) needed = needed || asked(l);
      if (needed) simulators_[group].step(steps_of(simulators_[group].dt(), seconds));
    }
    for (int l = 0; l < width; ++l) {
      if (!asked(l)) continue;
      const W& w = simulator(l);
      const int there = seat(l).lane;
      w.pose(there, q_);
      w.velocity(there, v_);
      for (int i = 0; i < model_.nq; ++i) core::set_lane(lanes.q()[i], l, static_cast<T>(q_[i]));
      for (int i = 0; i < model_.nv; ++i) core::set_lane(lanes.v()[i], l, static_cast<T>(v_[i]));
      for (std::size_t b = 0; b < model_.bodies.size(); ++b) {
        const int body = static_cast<int>(b);
        lanes.set_body_force(l, body, detail::contact_force(w, there, body, model_.bodies[b].joint).template cast<T>());
      }
      if (w.failed(there)) lanes.mark_failed(l);
    }
    lanes.refresh();
  }

 private:
  struct Seat {
    std::size_t simulator = 0;
    int lane = 0;
  };

  static int steps_of(double dt, double seconds) {
    const double count = std::round(seconds / dt);
    if (!(count >= 1 && std::abs(count * dt - seconds) <= 1e-6 * seconds))
      throw Error("engine: " + std::to_string(seconds) + " s are not a whole number of its time steps of " + std::to_string(dt) + " s");
    return static_cast<int>(count);
  }
  const Seat& seat(int lane) const { return seats_[static_cast<std::size_t>(lane)]; }
  W& simulator(int lane) { return simulators_[seat(lane).simulator]; }

  std::vector<W> simulators_;
  std::vector<Seat> seats_;  ///< of each lane
  sim::Model model_;
  Eigen::VectorXd q_, v_;
};

/// Simulators of as many lanes as S has, or more, in all, as an engine for packs of S.
template <class S, sim::Simulator W>
std::shared_ptr<Engine<S>> engine_of(std::vector<W> simulators) {
  return std::make_shared<SimulatorEngine<S, W>>(std::move(simulators));
}
template <class S, sim::Simulator W>
std::shared_ptr<Engine<S>> engine_of(W simulator) {
  std::vector<W> one;
  one.push_back(std::move(simulator));
  return engine_of<S>(std::move(one));
}

}  // namespace traceur::control
