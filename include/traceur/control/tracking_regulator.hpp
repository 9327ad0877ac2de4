// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Eigenvalues>

#include "traceur/control/mirror.hpp"
#include "traceur/control/skill_player.hpp"
#include "traceur/sim/lanes.hpp"

namespace traceur::control {

/// A motion that was simulated: where it begins, what the motors were given, and what came of it.
struct SimulatedMotion {
  Eigen::MatrixXd targets;     ///< nq x ticks
  Eigen::MatrixXd poses;       ///< nq x (ticks + 1)
  Eigen::MatrixXd velocities;  ///< nv x (ticks + 1)

  int ticks() const { return static_cast<int>(targets.cols()); }
};

/// Costs of being off a motion, all of squares, and the steps by which the simulator is differenced. Contacts begin and end:
/// steps about as large as what is to be corrected see more of that than small ones.
struct RegulatorSettings {
  double root_place = 40;       ///< 1/m^2
  double root_turn = 30;        ///< 1/rad^2
  double joints = 0.3;          ///< 1/rad^2
  double root_velocity = 1;     ///< s^2/m^2
  double root_spin = 0.3;       ///< s^2/rad^2
  double joint_velocity = 0.01; ///< s^2/rad^2
  double last = 10;             ///< factor on all of these at the end
  double effort = 10;           ///< 1/rad^2, of what is added to targets
  int place_until = std::numeric_limits<int>::max();  ///< tick after which it is all one where on the ground the root is
  double pose_step = 0.06;      ///< m, rad
  double velocity_step = 0.6;   ///< m/s, rad/s
  double target_step = 0.15;    ///< rad
};

/// How a simulated motion's next state depends on its state and targets: x' = A x + B u, where x is the tangent from the
/// motion's pose and the difference of velocities (2 nv), and u a tangent added to the targets of all joints (nv - 6).
struct LinearizedTick {
  Eigen::MatrixXd a, b;
};

/// Linearizes the simulator about a motion, by central differences at every tick; the motion is simulated again for what lanes
/// remember of contacts. `aid(lanes, tick)` does what is done after every tick, as when sampling. The lanes are left anyhow.
template <class S, class Aid>
std::vector<LinearizedTick> linearize(sim::Lanes<S>& lanes, const sim::Model& model, const SimulatedMotion& motion, int steps_per_tick,
                                      const RegulatorSettings& settings, Aid&& aid) {
  using T = core::Element<S>;
  constexpr int width = core::lane_count<S>;
  const body::Skeleton& sk = model.character.skeleton;
  const int nq = model.nq, nv = model.nv, na = nv - 6, n = 2 * nv, columns = n + na, ticks = motion.ticks();
  if (motion.poses.cols() != ticks + 1 || motion.velocities.cols() != ticks + 1 || motion.targets.rows() != nq || motion.poses.rows() != nq ||
      motion.velocities.rows() != nv)
    throw Error("regulator: expected poses and velocities of every tick and the one after it, of the model's size");
  const auto put = [](S* to, int lane, const Eigen::VectorXd& from, int first = 0) {
    for (Eigen::Index i = first; i < from.size(); ++i) core::set_lane(to[i], lane, static_cast<T>(from[i]));
  };
  Eigen::VectorXd q(nq), v(nv), d(nv), target(nq), next_pose(nq), next_velocity(nv);
  const auto get = [&](int lane, Eigen::VectorXd& pose, Eigen::VectorXd& velocity) {
    for (int i = 0; i < nq; ++i) pose[i] = core::lane_of(lanes.q()[i], lane);
    for (int i = 0; i < nv; ++i) velocity[i] = core::lane_of(lanes.v()[i], lane);
    body::normalize(sk, pose.data());
  };
  for (S& x : lanes.state()) x = S(T(0));
  for (int l = 0; l < width; ++l) {
    lanes.clear_failed(l);
    put(lanes.q(), l, motion.poses.col(0));
    put(lanes.v(), l, motion.velocities.col(0));
  }
  lanes.refresh();
  std::vector<T> state(lanes.state().size());
  std::vector<LinearizedTick> out(static_cast<std::size_t>(ticks));
  Eigen::MatrixXd ends(n, 2 * columns);
  for (int t = 0; t < ticks; ++t) {
    for (std::size_t i = 0; i < state.size(); ++i) state[i] = core::lane_of(lanes.state()[i], 0);
    Eigen::VectorXd pose(nq), velocity(nv);
    get(0, pose, velocity);
    for (int l = 0; l < width; ++l) put(lanes.target(), l, motion.targets.col(t), 7);
    lanes.step(steps_per_tick);
    aid(lanes, t);
    get(0, next_pose, next_velocity);
    std::vector<T> after(state.size());
    for (std::size_t i = 0; i < state.size(); ++i) after[i] = core::lane_of(lanes.state()[i], 0);
    for (int first = 0; first < 2 * columns; first += width) {
      for (std::size_t i = 0; i < state.size(); ++i) lanes.state()[i] = S(state[i]);
      for (int l = 0; l < width; ++l) {
        const int j = std::min(first + l, 2 * columns - 1), k = j / 2;
        const double sign = j % 2 == 0 ? 1 : -1;
        q = pose;
        v = velocity;
        target = motion.targets.col(t);
        target.head(7) = sk.neutral_pose().head(7);
        d.setZero();
        if (k < nv) {
          d[k] = sign * settings.pose_step;
          body::displace(sk, q.data(), d.data(), q.data());
        } else if (k < n) {
          v[k - nv] += sign * settings.velocity_step;
        } else {
          d[6 + k - n] = sign * settings.target_step;
          body::displace(sk, target.data(), d.data(), target.data());
        }
        lanes.clear_failed(l);
        put(lanes.q(), l, q);
        put(lanes.v(), l, v);
        put(lanes.target(), l, target, 7);
      }
      lanes.refresh();
      lanes.step(steps_per_tick);
      aid(lanes, t);
      for (int l = 0; l < width && first + l < 2 * columns; ++l) {
        get(l, q, v);
        body::difference(sk, next_pose.data(), q.data(), d.data());
        ends.col(first + l) << d, v - next_velocity;
        if (!ends.col(first + l).allFinite()) throw Error("regulator: the simulation failed beside tick " + std::to_string(t));
      }
    }
    LinearizedTick& x = out[static_cast<std::size_t>(t)];
    x.a.resize(n, n);
    x.b.resize(n, na);
    for (int k = 0; k < columns; ++k) {
      const double step = k < nv ? settings.pose_step : k < n ? settings.velocity_step : settings.target_step;
      const Eigen::VectorXd slope = (ends.col(2 * k) - ends.col(2 * k + 1)) / (2 * step);
      if (k < n)
        x.a.col(k) = slope;
      else
        x.b.col(k - n) = slope;
    }
    for (std::size_t i = 0; i < state.size(); ++i) lanes.state()[i] = S(after[i]);
    lanes.refresh();
  }
  return out;
}

/// Gains K of every tick, u = -K x, that cost least in sum of x' Q x + u' R u over the rest of the motion: Riccati's recursion
/// backwards in time. The diagonals of Q are the columns of `costs`, of every tick and of the end; R is `effort` times the unit
/// matrix. Throws Error where the numbers outgrow what can be computed with.
inline std::vector<Eigen::MatrixXd> regulator_gains(const std::vector<LinearizedTick>& ticks, const Eigen::MatrixXd& costs, double effort) {
  if (costs.cols() != static_cast<Eigen::Index>(ticks.size()) + 1) throw Error("regulator: expected costs of every tick and of the end");
  std::vector<Eigen::MatrixXd> gains(ticks.size());
  Eigen::MatrixXd p = costs.rightCols(1).asDiagonal();
  for (std::size_t t = ticks.size(); t-- > 0;) {
    const LinearizedTick& x = ticks[t];
    const Eigen::MatrixXd bp = x.b.transpose() * p;
    Eigen::MatrixXd h = bp * x.b;
    h.diagonal().array() += effort;
    gains[t] = h.ldlt().solve(bp * x.a);
    const Eigen::MatrixXd closed = x.a - x.b * gains[t];
    p = x.a.transpose() * p * closed;
    p = (0.5 * (p + p.transpose())).eval();
    p.diagonal() += costs.col(static_cast<Eigen::Index>(t));
    if (!(p.cwiseAbs().maxCoeff() < 1e12)) throw Error("regulator: costs outgrow all bounds at tick " + std::to_string(t));
  }
  return gains;
}

/// A gain matrix as a product, of which `right` is applied first; `left` alone where `right` is empty.
struct Gain {
  Eigen::MatrixXf left, right;

  int inputs() const { return static_cast<int>(right.size() > 0 ? right.cols() : left.cols()); }
};

/// The product of that rank that is nearest to a gain matrix; as it is where it has no more than that, or `rank` is 0.
inline Gain reduced_gain(const Eigen::MatrixXd& k, int rank) {
  if (rank < 0) throw Error("regulator: expected a rank of zero or more");
  if (rank == 0 || rank >= std::min(k.rows(), k.cols())) return {k.cast<float>(), {}};
  // The left singular vectors are those of K K', which is small.
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> of(k * k.transpose());
  const Eigen::MatrixXd left = of.eigenvectors().rightCols(rank);
  return {left.cast<float>(), (left.transpose() * k).cast<float>()};
}

/// The diagonals of Q, in the order of x, of so many ticks and of the end: 2 nv x (ticks + 1).
inline Eigen::MatrixXd regulator_costs(const sim::Model& model, const RegulatorSettings& s, int ticks) {
  const int nv = model.nv;
  Eigen::VectorXd q(2 * nv);
  q.head(3).setConstant(s.root_place);
  q.segment(3, 3).setConstant(s.root_turn);
  q.segment(6, nv - 6).setConstant(s.joints);
  q.segment(nv, 3).setConstant(s.root_velocity);
  q.segment(nv + 3, 3).setConstant(s.root_spin);
  q.tail(nv - 6).setConstant(s.joint_velocity);
  Eigen::MatrixXd costs = q.replicate(1, ticks + 1);
  costs.rightCols(1) *= s.last;
  if (s.place_until <= ticks) costs.topRightCorner(2, ticks + 1 - std::max(s.place_until, 0)).setZero();
  return costs;
}

/// Keeps characters on a family of simulated motions (the same manoeuvre at obstacles of several sizes, ticks alike) by adding
/// to their targets what a linear-quadratic regulator says: one gain matrix for each tick and size, linear in between.
class TrackingRegulator {
public:
  /// What a call of `apply` needs to write to; one for each thread.
  struct Scratch {
    Eigen::VectorXd pose, reference, other, velocity, tangent, target;
    Eigen::VectorXf state, reduced, correction;
  };

  TrackingRegulator() = default;
  /// Motions, and gains as `regulator_gains` has them, of each size (increasing). What is added to a joint is no more than
  /// `most` rad in any coordinate. The model must outlive it.
  TrackingRegulator(const sim::Model& model, const Roles& roles, std::vector<double> sizes, std::vector<SimulatedMotion> motions,
                    const std::vector<std::vector<Eigen::MatrixXd>>& gains, double most = 0.6)
      : TrackingRegulator(model, roles, std::move(sizes), std::move(motions), whole(gains), most) {}
  /// The same of gains of low rank.
  TrackingRegulator(const sim::Model& model, const Roles& roles, std::vector<double> sizes, std::vector<SimulatedMotion> motions,
                    std::vector<std::vector<Gain>> gains, double most = 0.6)
      : model_(&model), roles_(roles), sizes_(std::move(sizes)), motions_(std::move(motions)), gains_(std::move(gains)), most_(most) {
    if (sizes_.empty() || motions_.size() != sizes_.size() || gains_.size() != sizes_.size())
      throw Error("regulator: expected a motion and gains for each size, and one or more");
    for (std::size_t k = 0; k < sizes_.size(); ++k) {
      if (k > 0 && !(sizes_[k] > sizes_[k - 1])) throw Error("regulator: expected sizes that increase");
      if (motions_[k].ticks() != motions_[0].ticks() || gains_[k].size() > static_cast<std::size_t>(motions_[k].ticks()) || gains_[k].size() != gains_[0].size())
        throw Error("regulator: expected motions and gains of as many ticks at all sizes");
      for (const Gain& g : gains_[k])
        if (g.left.rows() != model.nv - 6 || g.inputs() != 2 * model.nv || (g.right.size() > 0 && g.right.rows() != g.left.cols()))
          throw Error("regulator: expected gains of the model's size");
    }
  }

  /// How many ticks it has gains for.
  int ticks() const { return gains_.empty() ? 0 : static_cast<int>(gains_[0].size()); }
  static Scratch scratch(const sim::Model& model) {
    const int nq = model.nq, nv = model.nv;
    const auto of = [](int n) { return Eigen::VectorXd(n); };
    return {of(nq), of(nq), of(nq), of(nv), of(nv), of(nq), Eigen::VectorXf(2 * nv), Eigen::VectorXf(nv - 6), Eigen::VectorXf(nv - 6)};
  }

  /// Adds to the targets of a lane what keeps it on the motion for an obstacle of some size at a phase (ticks), seen from a
  /// frame; `in_mirror` where the motion is done on the other foot. Does nothing beyond its ticks, or for a lane that is not
  /// finite.
  template <class S>
  void apply(sim::Lanes<S>& lanes, int lane, double size, double phase, const SkillFrame& frame, bool in_mirror, Scratch& w) const noexcept {
    using core::Quaternion;
    using core::Vector3;
    using T = core::Element<S>;
    const int t = static_cast<int>(std::floor(phase + 1e-6));
    if (t < 0 || t >= ticks()) return;
    const body::Skeleton& sk = model_->character.skeleton;
    const int nq = model_->nq, nv = model_->nv;
    for (int i = 0; i < nq; ++i) w.pose[i] = core::lane_of(lanes.q()[i], lane);
    for (int i = 0; i < nv; ++i) w.velocity[i] = core::lane_of(lanes.v()[i], lane);
    if (!w.pose.allFinite() || !w.velocity.allFinite()) return;
    body::normalize(sk, w.pose.data());
    // Into the frame.
    const Quaternion<double> back = core::about_axis(Vector3<double>{0, 0, 1}, -frame.heading);
    back.rotate(Vector3<double>{w.pose[0] - frame.x, w.pose[1] - frame.y, w.pose[2] - frame.z}).store(w.pose.data());
    (back * Quaternion<double>::from(w.pose.data() + 3)).store(w.pose.data() + 3);
    back.rotate(Vector3<double>::from(w.velocity.data())).store(w.velocity.data());
    back.rotate(Vector3<double>::from(w.velocity.data() + 3)).store(w.velocity.data() + 3);
    if (in_mirror) {
      mirror_pose(*model_, roles_, w.pose, w.other);
      w.pose.swap(w.other);
      mirror_tangent(*model_, roles_, w.velocity, w.tangent);
      w.velocity.swap(w.tangent);
    }
    std::size_t k = 0;
    while (k + 2 < sizes_.size() && size > sizes_[k + 1]) ++k;
    const std::size_t next = std::min(k + 1, sizes_.size() - 1);
    const double share = next > k ? std::clamp((size - sizes_[k]) / (sizes_[next] - sizes_[k]), 0.0, 1.0) : 0.0;
    body::interpolate(sk, motions_[k].poses.col(t).data(), motions_[next].poses.col(t).data(), share, w.reference.data());
    body::difference(sk, w.reference.data(), w.pose.data(), w.tangent.data());
    w.state.head(nv) = w.tangent.cast<float>();
    w.tangent = w.velocity - (1 - share) * motions_[k].velocities.col(t) - share * motions_[next].velocities.col(t);
    w.state.tail(nv) = w.tangent.cast<float>();
    const auto at = static_cast<std::size_t>(t);
    w.correction.setZero();
    subtract(gains_[k][at], static_cast<float>(1 - share), w);
    if (share > 0) subtract(gains_[next][at], static_cast<float>(share), w);
    w.tangent.head(6).setZero();
    for (int i = 6; i < nv; ++i) w.tangent[i] = std::clamp(static_cast<double>(w.correction[i - 6]), -most_, most_);
    if (in_mirror) {
      mirror_tangent(*model_, roles_, w.tangent, w.velocity);
      w.tangent.swap(w.velocity);
    }
    w.target.head(7) = w.pose.head(7);
    for (int i = 7; i < nq; ++i) w.target[i] = core::lane_of(lanes.target()[i], lane);
    body::normalize(sk, w.target.data());
    body::displace(sk, w.target.data(), w.tangent.data(), w.other.data());
    for (int i = 7; i < nq; ++i) core::set_lane(lanes.target()[i], lane, static_cast<T>(w.other[i]));
  }

private:
  static std::vector<std::vector<Gain>> whole(const std::vector<std::vector<Eigen::MatrixXd>>& gains) {
    std::vector<std::vector<Gain>> out(gains.size());
    for (std::size_t k = 0; k < gains.size(); ++k)
      for (const Eigen::MatrixXd& g : gains[k]) out[k].push_back({g.cast<float>(), {}});
    return out;
  }
  static void subtract(const Gain& g, float share, Scratch& w) noexcept {
    if (g.right.size() == 0) {
      w.correction.noalias() -= share * (g.left * w.state);
      return;
    }
    auto middle = w.reduced.head(g.right.rows());
    middle.noalias() = g.right * w.state;
    w.correction.noalias() -= share * (g.left * middle);
  }

  const sim::Model* model_ = nullptr;
  Roles roles_;
  std::vector<double> sizes_;
  std::vector<SimulatedMotion> motions_;
  std::vector<std::vector<Gain>> gains_;
  double most_ = 0.6;
};

}  // namespace traceur::control
