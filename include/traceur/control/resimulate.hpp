// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cmath>
#include <vector>

#include "traceur/control/mirror.hpp"
#include "traceur/control/running.hpp"

namespace traceur::control {

namespace detail {

/// The mean of poses near one another, in the tangent space of the first.
class PoseMean {
public:
  void add(const sim::Model& model, const Eigen::VectorXd& q) {
    if (count_ == 0) {
      first_ = q;
      sum_ = Eigen::VectorXd::Zero(model.nv);
    }
    Eigen::VectorXd d(model.nv);
    body::difference(model.character.skeleton, first_.data(), q.data(), d.data());
    sum_ += d;
    ++count_;
  }
  int count() const { return count_; }
  Eigen::VectorXd mean(const sim::Model& model) const {
    Eigen::VectorXd q(model.nq);
    const Eigen::VectorXd d = sum_ / count_;
    body::displace(model.character.skeleton, first_.data(), d.data(), q.data());
    body::normalize(model.character.skeleton, q.data());
    return q;
  }

private:
  Eigen::VectorXd first_, sum_;
  int count_ = 0;
};

}  // namespace detail

/// A runner's controller with its reference reset to its own closed-loop motion (Terrain Runner, s5.2): states are the means
/// over many simulated cycles, targets those that were really given, mirrored halves made alike; the law stays. What it
/// holds is then simulated throughout, and feedback is idle where all goes well. The controls that led to it are `control`'s,
/// which must leave time as it is (beta = 1). Throws Error when a run falls.
template <class S>
Controller resimulated(RunningTrials<S>& trials, const sim::Model& model, const Roles& roles, const Controller& c, const Skill& gait,
                       const Eigen::VectorXd& control, double speed, RunningSettings e) {
  constexpr int width = core::lane_count<S>;
  const int n = c.ticks(), half = n / 2;
  std::vector<detail::PoseMean> states(static_cast<std::size_t>(n)), targets(states.size());
  std::vector<Eigen::VectorXd> velocities(states.size(), Eigen::VectorXd::Zero(model.nv));
  Eigen::VectorXd q(model.nq), v(model.nv);
  const auto observe = [&](int tick, const sim::Lanes<S>& lanes, const auto& players) {
    if (tick < n * e.cycles / 2) return;
    for (int l = 0; l < width; ++l) {
      const SkillPlayer& p = players[static_cast<std::size_t>(l)];
      const int now = p.skill().table.tick_of(p.phase() + 1e-6), before = (now + n - 1) % n;
      const auto read = [&](const S* from, Eigen::VectorXd& to) {
        for (Eigen::Index i = 0; i < to.size(); ++i) to[i] = core::lane_of(from[i], l);
      };
      // A root has no target; the state's stands in for it.
      read(lanes.q(), q);
      read(lanes.v(), v);
      body::normalize(model.character.skeleton, q.data());
      q[0] -= p.frame().x;
      q[1] -= p.frame().y;
      const auto put = [&](int t, std::vector<detail::PoseMean>& into, const Eigen::VectorXd& pose) {
        const int other = (t + half) % n;
        into[static_cast<std::size_t>(t)].add(model, pose);
        into[static_cast<std::size_t>(other)].add(model, mirrored_pose(model, roles, pose));
      };
      put(now, states, q);
      velocities[static_cast<std::size_t>(now)] += v;
      velocities[static_cast<std::size_t>((now + half) % n)] += mirrored_tangent(model, roles, v);
      read(const_cast<sim::Lanes<S>&>(lanes).target(), q);
      q.head(7) = model.character.skeleton.neutral_pose().head(7);
      body::normalize(model.character.skeleton, q.data());
      put(before, targets, q);
    }
  };
  const auto outcomes = trials.run(
      e, width, [&](int) { return control.data(); }, [&](int) { return RunningTask{0, speed}; }, [](int l) { return l; }, observe);
  for (const RunningOutcome& o : outcomes)
    if (!o.survived) throw Error("resimulation of '" + c.clip + "': a run fell after " + std::to_string(o.record.seconds) + " s");
  Controller out = c;
  out.clip = c.clip + ", simulated";
  out.law = control.head(gait.shape.law.size());
  out.targets.resize(model.nq, n);
  TrackingReference& r = out.reference;
  r.poses.resize(model.nq, n + 1);
  r.velocities.resize(model.nv, n + 1);
  for (int t = 0; t < n; ++t) {
    const auto k = static_cast<std::size_t>(t);
    r.poses.col(t) = states[k].mean(model);
    r.poses(0, t) += speed * t * c.tick;
    r.velocities.col(t) = velocities[k] / states[k].count();
    out.targets.col(t) = targets[k].mean(model);
  }
  r.poses.col(n) = r.poses.col(0);
  r.poses(0, n) += speed * n * c.tick;
  r.velocities.col(n) = r.velocities.col(0);
  measure_reference(model, roles, {}, r);
  out.sensory = Eigen::MatrixXd::Zero(full_sensors, n);
  out.start_pose = r.poses.col(0);
  out.start_velocity = r.velocities.col(0);
  return out;
}

}  // namespace traceur::control
