// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <array>
#include <vector>

#include "traceur/control/controller.hpp"
#include "traceur/control/sampling_control.hpp"

namespace traceur::control {

/// What an open-loop motion looks like to the sensors, tick by tick.
struct OpenLoopRecord {
  Eigen::MatrixXd raw;            ///< full_sensors x ticks, with the right foot as stance foot
  Eigen::MatrixXd raw_left;       ///< the same with the left foot as stance foot
  Eigen::MatrixXd foot_force;     ///< 2 x ticks, vertical contact force on right and left foot during each tick, N
  Eigen::VectorXd body_force;     ///< on the whole body, norm of the sum, N
  Eigen::MatrixXd poses;          ///< nq x (ticks + 1)
  Eigen::MatrixXd velocities;     ///< nv x (ticks + 1)
};

/// Simulates targets (nq x ticks) from a state and records what the sensors read against a reference of as many ticks.
template <class S>
OpenLoopRecord record_open_loop(sim::Lanes<S>& lanes, const sim::Model& model, const Roles& roles, const TrackingReference& reference,
                                const Eigen::MatrixXd& targets, const Eigen::VectorXd& q, const Eigen::VectorXd& v, int steps_per_tick) {
  using T = core::Element<S>;
  const auto ticks = targets.cols();
  OpenLoopRecord out;
  out.raw.resize(full_sensors, ticks);
  out.raw_left.resize(full_sensors, ticks);
  out.foot_force.resize(2, ticks);
  out.body_force.resize(ticks);
  out.poses.resize(model.nq, ticks + 1);
  out.velocities.resize(model.nv, ticks + 1);
  for (S& x : lanes.state()) x = S(T(0));
  for (int k = 0; k < model.nq; ++k) lanes.q()[k] = S(static_cast<T>(q[k]));
  for (int k = 0; k < model.nv; ++k) lanes.v()[k] = S(static_cast<T>(v[k]));
  lanes.refresh();
  const auto keep = [&](Eigen::Index t) {
    for (int k = 0; k < model.nq; ++k) out.poses(k, t) = core::lane_of(lanes.q()[k], 0);
    for (int k = 0; k < model.nv; ++k) out.velocities(k, t) = core::lane_of(lanes.v()[k], 0);
  };
  std::array<S, full_sensors> raw;
  for (Eigen::Index t = 0; t < ticks; ++t) {
    keep(t);
    measure(lanes, model, roles, reference, static_cast<int>(t), CycleCarry{}, 0, raw.data());
    for (int i = 0; i < full_sensors; ++i) out.raw(i, t) = core::lane_of(raw[static_cast<std::size_t>(i)], 0);
    measure(lanes, model, roles, reference, static_cast<int>(t), CycleCarry{}, 1, raw.data());
    for (int i = 0; i < full_sensors; ++i) out.raw_left(i, t) = core::lane_of(raw[static_cast<std::size_t>(i)], 0);
    for (int k = 7; k < model.nq; ++k) lanes.target()[k] = S(static_cast<T>(targets(k, t)));
    lanes.step(steps_per_tick);
    core::Vector3<T> sum{T(0), T(0), T(0)};
    for (std::size_t b = 0; b < model.bodies.size(); ++b) {
      const auto& f = lanes.body_force()[b];
      sum += core::Vector3<T>{core::lane_of(f.x, 0), core::lane_of(f.y, 0), core::lane_of(f.z, 0)};
    }
    out.body_force[t] = norm(sum);
    for (std::size_t side = 0; side < 2; ++side)
      out.foot_force(static_cast<Eigen::Index>(side), t) =
          core::lane_of(lanes.body_force()[static_cast<std::size_t>(roles.legs[side].foot)].z, 0);
  }
  keep(ticks);
  return out;
}

/// First and last tick of the longest stretch without contact, or {-1, -1} where none lasts `shortest` ticks.
inline std::array<int, 2> longest_flight(const Eigen::VectorXd& body_force, int shortest) {
  std::array<int, 2> best{-1, -1};
  int length = 0;
  for (int t = 0, begin = -1; t <= body_force.size(); ++t) {
    const bool free = t < body_force.size() && body_force[t] < 1.0;
    if (free && begin < 0) begin = t;
    if (!free && begin >= 0) {
      if (t - begin > length && t - begin >= shortest) {
        length = t - begin;
        best = {begin, t - 1};
      }
      begin = -1;
    }
  }
  return best;
}

namespace detail {

/// What every controller takes over from the search it comes from.
inline Controller begin_controller(const sim::Model& model, const sim::Parameters& simulation, const TrackingReference& reference,
                                   const SamplingParameters& sampling, const FeedbackShape& shape) {
  Controller c;
  c.character = model.character.name;
  c.tick = reference.dt;
  c.steps_per_tick = sampling.steps_per_tick;
  c.simulation = simulation;
  c.shape = shape;
  return c;
}

}  // namespace detail

/// A controller for a motion done once: the sampled targets, and a law of three phases, before, during and after flight
/// (equal thirds of the time where nothing flies). The law's numbers are zero.
template <class S>
Controller make_one_shot(sim::Lanes<S>& lanes, const sim::Model& model, const sim::Parameters& simulation, const Roles& roles,
                         const TrackingReference& reference, const SampledControl& sampled, const SamplingParameters& sampling,
                         const FeedbackShape& shape) {
  Controller c = detail::begin_controller(model, simulation, reference, sampling, shape);
  c.targets = sampled.targets;
  c.reference = reference;
  c.start_pose = reference.poses.col(0);
  c.start_velocity = reference.velocities.col(0);
  const OpenLoopRecord record =
      record_open_loop(lanes, model, roles, reference, c.targets, c.start_pose, c.start_velocity, c.steps_per_tick);
  c.sensory = record.raw;
  const int ticks = c.ticks();
  c.stance.assign(static_cast<std::size_t>(ticks), 0);
  c.phase.assign(static_cast<std::size_t>(ticks), 0);
  const std::array<int, 2> flight = longest_flight(record.body_force, 6);
  for (int t = 0; t < ticks; ++t) {
    int phase = std::min(shape.phases - 1, shape.phases * t / ticks);
    if (shape.phases == 3 && flight[0] >= 0) phase = t < flight[0] ? 0 : t <= flight[1] ? 1 : 2;
    c.phase[static_cast<std::size_t>(t)] = phase;
  }
  c.law = Eigen::VectorXd::Zero(shape.size());
  return c;
}

/// A controller for a cyclic motion: the plan common to all cycles, the law of one phase mirrored from stance to stance
/// when the plan is. Sensory references are means over the open-loop cycles but the first. The law is step_placement_law.
template <class S>
Controller make_cyclic(sim::Lanes<S>& lanes, const sim::Model& model, const sim::Parameters& simulation, const Roles& roles,
                       const TrackingReference& reference, const SampledControl& sampled, const SamplingParameters& sampling,
                       const FeedbackShape& shape) {
  Controller c = detail::begin_controller(model, simulation, reference, sampling, shape);
  c.cyclic = true;
  if (!sampling.tied() || sampled.tied_offsets.cols() != static_cast<Eigen::Index>(sampling.period_starts.size()))
    throw Error("cyclic controller: expected targets sampled with tied windows");
  const int part = sampling.period_ticks;
  const int period = sampling.mirrored ? 2 * part : part;
  if (reference.ticks < 2 * period) throw Error("cyclic controller: expected a reference of at least two periods");
  TrackingReference& r = c.reference;
  r = reference;
  r.ticks = period;
  r.poses = reference.poses.leftCols(period + 1);
  r.velocities = reference.velocities.leftCols(period + 1);
  r.points = reference.points.leftCols(period + 1);
  r.center_of_mass = reference.center_of_mass.leftCols(period + 1);
  r.center_velocity = reference.center_velocity.leftCols(period + 1);
  r.feet = reference.feet.leftCols(period + 1);
  r.heading = reference.heading.head(period + 1);
  const Eigen::MatrixXd base = led_targets(model, r, sampling.lead);
  c.targets.resize(model.nq, period);
  for (int t = 0; t < period; ++t) {
    const bool second = t >= part;
    int window = 0;
    for (std::size_t k = 0; k < sampling.period_starts.size(); ++k)
      if (sampling.period_starts[k] <= t % part) window = static_cast<int>(k);
    const Eigen::VectorXd shared = sampled.tied_offsets.col(window);
    const Eigen::VectorXd d = second ? mirrored_tangent(model, roles, shared) : shared;
    body::displace(model.character.skeleton, base.col(t).data(), d.data(), c.targets.col(t).data());
  }
  const OpenLoopRecord record = record_open_loop(lanes, model, roles, reference, sampled.targets, reference.poses.col(0),
                                                 reference.velocities.col(0), c.steps_per_tick);
  // Stance: the half period in which one foot carries more than the other, summed over cycles.
  const auto ticks = static_cast<int>(record.raw.cols());
  Eigen::VectorXd lead = Eigen::VectorXd::Zero(period);  // right minus left
  for (int t = 0; t < ticks; ++t) lead[t % period] += record.foot_force(0, t) - record.foot_force(1, t);
  c.stance.assign(static_cast<std::size_t>(period), 0);
  if (sampling.mirrored) {
    int best = 0;
    double most = -1e300;
    for (int from = 0; from < period; ++from) {
      double sum = 0;
      for (int k = 0; k < part; ++k) sum += lead[(from + k) % period] - lead[(from + part + k) % period];
      if (sum > most) {
        most = sum;
        best = from;
      }
    }
    for (int k = 0; k < part; ++k) c.stance[static_cast<std::size_t>((best + part + k) % period)] = 1;
  }
  c.phase.assign(static_cast<std::size_t>(period), 0);
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(full_sensors, part);
  Eigen::VectorXd members = Eigen::VectorXd::Zero(part);
  for (int t = period; t < ticks; ++t) {
    const bool left = c.stance[static_cast<std::size_t>(t % period)] == 1;
    sum.col(t % part) += left ? record.raw_left.col(t) : record.raw.col(t);
    members[t % part] += 1;
  }
  c.sensory.resize(full_sensors, period);
  for (int t = 0; t < period; ++t) c.sensory.col(t) = sum.col(t % part) / std::max(1.0, members[t % part]);
  // Start where the open-loop motion is after its first period, moved back by it.
  const CycleCarry carry = CycleCarry::after(r, 1);
  c.start_pose = record.poses.col(period);
  c.start_velocity = record.velocities.col(period);
  const CycleCarry back{-carry.turn, 0, 0};
  core::Vector3<double> p = core::Vector3<double>::from(c.start_pose.data());
  p = back.rotate(core::Vector3<double>{p.x - carry.x, p.y - carry.y, p.z});
  p.store(c.start_pose.data());
  const auto turn = core::about_axis(core::Vector3<double>{0, 0, 1}, -carry.turn);
  (turn * core::Quaternion<double>::from(c.start_pose.data() + 3)).store(c.start_pose.data() + 3);
  back.rotate(core::Vector3<double>::from(c.start_velocity.data())).store(c.start_velocity.data());
  back.rotate(core::Vector3<double>::from(c.start_velocity.data() + 3)).store(c.start_velocity.data() + 3);
  c.law = step_placement_law(shape);
  return c;
}

}  // namespace traceur::control
