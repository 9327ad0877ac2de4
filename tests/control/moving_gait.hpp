// SPDX-License-Identifier: MIT
// Controllers with references that several tests of composed running read: gaits and motions done once, of any pose and law.
#pragma once

#include <algorithm>

#include <traceur/control/running.hpp>

#include "support.hpp"

namespace figures {

/// Smooth joint motion about some pose, heading for +x at `speed` m/s: a gait of `ticks` ticks whose first half is on the
/// right foot, or a motion done once. Laws, targets and sensory records are random.
inline control::Controller any_controller(const Figure& f, int ticks, bool cyclic, double speed, std::uint64_t seed = 1,
                                          const control::FeedbackShape& shape = {}) {
  core::RandomStream random(77, seed);
  control::Controller c;
  c.clip = "any";
  c.character = f.model.character.name;
  c.cyclic = cyclic;
  c.shape = shape;
  Eigen::VectorXd q0 = any_pose(f, random, 0.3), sway(f.model.nv), phase(f.model.nv);
  Quaternion::identity().store(q0.data() + 3);
  for (Eigen::Index k = 0; k < f.model.nv; ++k) {
    sway[k] = (k < 6 ? 0.05 : 0.25) * random.uniform(-1.0, 1.0);
    phase[k] = random.uniform(0.0, 6.28);
  }
  const auto pose = [&](double t) {
    Eigen::VectorXd d(f.model.nv), q(f.model.nq);
    const double period = ticks / 60.0;
    for (Eigen::Index k = 0; k < d.size(); ++k) d[k] = sway[k] * std::sin(2 * std::numbers::pi * t / period + phase[k]);
    d[0] += speed * t;
    body::displace(f.skeleton(), q0.data(), d.data(), q.data());
    return q;
  };
  control::TrackingReference& r = c.reference;
  r.dt = c.tick = 1.0 / 60;
  r.poses.resize(f.model.nq, ticks + 1);
  r.velocities.resize(f.model.nv, ticks + 1);
  for (int t = 0; t <= ticks; ++t) {
    r.poses.col(t) = pose(t / 60.0);
    Eigen::VectorXd v(f.model.nv);
    const Eigen::VectorXd a = pose(t / 60.0 - 1e-4), b = pose(t / 60.0 + 1e-4);
    body::difference(f.skeleton(), a.data(), b.data(), v.data());
    r.velocities.col(t) = v / 2e-4;
  }
  control::measure_reference(f.model, f.roles, f.points, r);
  c.targets = r.poses.leftCols(ticks);
  c.sensory.resize(control::full_sensors, ticks);
  for (int t = 0; t < ticks; ++t) {
    Eigen::VectorXd d(f.model.nv);
    for (double& x : d) x = 0.1 * random.uniform(-1.0, 1.0);
    body::displace(f.skeleton(), c.targets.col(t).data(), d.data(), c.targets.col(t).data());
    for (int i = 0; i < control::full_sensors; ++i) c.sensory(i, t) = 0.02 * random.uniform(-1.0, 1.0);
  }
  c.stance.assign(static_cast<std::size_t>(ticks), 0);
  c.phase.assign(static_cast<std::size_t>(ticks), 0);
  for (int t = ticks / 2; t < ticks; ++t) {
    if (cyclic) c.stance[static_cast<std::size_t>(t)] = 1;
    if (!cyclic && shape.phases > 1) c.phase[static_cast<std::size_t>(t)] = 1;
  }
  c.law.resize(shape.size());
  for (double& x : c.law) x = 0.2 * random.uniform(-1.0, 1.0);
  c.start_pose = r.poses.col(0);
  c.start_velocity = r.velocities.col(0);
  return c;
}

/// The humanoid swaying where it stands, as a gait that goes nowhere.
struct Sway {
  const Figure& f = humanoid();
  sim::Parameters parameters;
  sim::Ground<float> ground;
  control::Controller c;
  control::Skill gait;
  Eigen::VectorXd numbers;

  Sway() {
    const int ticks = 60;
    c.cyclic = true;
    c.reference = reference_of(f, sway_clip(ticks, 0.01), 1);
    c.steps_per_tick = 8;
    c.targets = c.reference.poses.leftCols(ticks);
    c.sensory = Eigen::MatrixXd::Zero(control::full_sensors, ticks);
    c.stance.assign(ticks, 0);
    std::fill(c.stance.begin() + ticks / 2, c.stance.end(), 1);
    c.phase.assign(ticks, 0);
    c.law = Eigen::VectorXd::Zero(c.shape.size());
    c.start_pose = c.reference.poses.col(0);
    c.start_velocity = c.reference.velocities.col(0);
    gait = {control::MotionTable(f.model, f.roles, c, {0.5, 1.0}), {c.shape, 2}, c.limits};
    numbers = gait.shape.neutral(c.law);
  }
  static control::RunningSettings settings() {
    control::RunningSettings e;
    e.cycles = 2;
    e.perturbation = 0.1;
    e.frequency = {2, 1};
    return e;
  }
};

}  // namespace figures
