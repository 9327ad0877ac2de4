// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "traceur/control/controller.hpp"
#include "traceur/core/error.hpp"
#include "traceur/motion/scaling.hpp"

namespace traceur::control {

/// Where the numbers of one moment of a motion are: what its motors aim at, and what a law compares the character with.
/// All in the motion's own frame: heading for +x from its origin on the ground.
struct MomentLayout {
  int joints = 0;  ///< numbers of the joints' target pose: nq - 7, the first of a moment

  int root() const { return joints; }           ///< root rotation, 4
  int yaw() const { return joints + 4; }        ///< heading of the root, rad: sensors are seen from it
  int center() const { return joints + 5; }     ///< centre of mass, 3, m; of a gait without what it travels
  int velocity() const { return joints + 8; }   ///< of the centre of mass, 3, m/s; of a gait without its mean
  int feet() const { return joints + 11; }      ///< from the centre of mass to the right and the left foot, 6, m
  int spin() const { return joints + 17; }      ///< angular velocity of the root, 3, rad/s
  int sensory() const { return joints + 20; }   ///< what sensors read along the open-loop motion, full_sensors
  int size() const { return joints + 20 + full_sensors; }
};

/// The reference states and actions of a skill, ready to be looked up at any time and amplitude (Terrain Runner, Eq. 5 and
/// 6): state and action are scaled about their means by alpha, the root's rotation towards upright, velocities with them.
/// Scaled exactly at some amplitudes and linear in between; linear between ticks.
///
/// Beside it stands what does not scale: which foot is the stance foot and which law is in force at each tick.
class MotionTable {
public:
  MotionTable() = default;

  /// Tabulates a controller at increasing amplitudes (one will do, for motions that are not to be scaled). A gait must
  /// head for +x without turning. Throws Error on amplitudes that do not increase or are not positive, or on a gait that
  /// turns.
  MotionTable(const sim::Model& model, const Roles& roles, const Controller& c, const std::vector<double>& amplitudes)
      : layout_{model.nq - 7}, amplitudes_(amplitudes), tick_(c.tick), ticks_(c.ticks()), cyclic_(c.cyclic),
        stance_(c.stance), phase_(c.phase) {
    const std::string where = "motion table of '" + c.clip + "': ";
    if (amplitudes_.empty()) throw Error(where + "expected an amplitude");
    for (std::size_t k = 0; k < amplitudes_.size(); ++k)
      if (!(amplitudes_[k] > (k == 0 ? 0.0 : amplitudes_[k - 1])))
        throw Error(where + "expected amplitudes above zero that increase");
    const TrackingReference& r = c.reference;
    if (ticks_ < 2 || r.ticks < ticks_) throw Error(where + "expected a reference as long as its targets");
    if (cyclic_ && std::abs(std::remainder(r.heading[ticks_] - r.heading[0], 6.283185307179586)) > 0.05)
      throw Error(where + "expected a gait that does not turn");
    if (cyclic_) speed_ = (r.center_of_mass(0, ticks_) - r.center_of_mass(0, 0)) / (ticks_ * tick_);
    start_center_ = core::Vector3<double>::from(r.center_of_mass.col(0).data());
    // Sideways the frame is in the middle, so that mirrored motions have mirrored frames.
    if (cyclic_) start_center_.y = r.center_of_mass.row(1).head(ticks_).mean();
    for (const double alpha : amplitudes_) tabulate(model, roles, c, alpha);
  }

  /// Tabulates several controllers of one skill, done for increasing values of a parameter such as an obstacle's height,
  /// which takes the amplitude's place. They must agree in length, stance and phases. Throws Error where they do not.
  MotionTable(const sim::Model& model, const Roles& roles, const std::vector<Controller>& family, const std::vector<double>& values)
      : layout_{model.nq - 7}, amplitudes_(values) {
    if (family.empty() || family.size() != values.size()) throw Error("motion table: expected a value for each controller, and one or more");
    const Controller& first = family.front();
    const std::string where = "motion table of '" + first.clip + "': ";
    for (std::size_t k = 1; k < values.size(); ++k)
      if (!(values[k] > values[k - 1])) throw Error(where + "expected values that increase");
    tick_ = first.tick;
    ticks_ = first.ticks();
    stance_ = first.stance;
    phase_ = first.phase;
    start_center_ = core::Vector3<double>::from(first.reference.center_of_mass.col(0).data());
    if (ticks_ < 2) throw Error(where + "expected two ticks or more");
    for (const Controller& c : family) {
      if (c.cyclic || c.ticks() != ticks_ || c.reference.ticks < ticks_ || c.tick != tick_ || c.stance != stance_ || c.phase != phase_)
        throw Error(where + "expected motions done once, alike in length, stance and phases");
      tabulate(model, roles, c, 1);
    }
  }

  const MomentLayout& layout() const { return layout_; }
  const std::vector<double>& amplitudes() const { return amplitudes_; }
  double tick() const { return tick_; }
  int ticks() const { return ticks_; }
  bool cyclic() const { return cyclic_; }
  double duration() const { return ticks_ * tick_; }
  /// Mean speed of a gait, m/s.
  double speed() const { return speed_; }
  /// Where a gait's frame begins, m, in the controller's own world: at the centre of mass, sideways in the middle of its sway.
  const core::Vector3<double>& start_center() const { return start_center_; }

  /// Tick of a phase (in ticks, any number): wrapped if the motion is a gait, else its last.
  int tick_of(double phase) const noexcept {
    const int t = static_cast<int>(std::floor(phase));
    if (cyclic_) return ((t % ticks_) + ticks_) % ticks_;
    return std::clamp(t, 0, ticks_ - 1);
  }
  /// Side of the stance foot, 0 right, 1 left, and index of the law.
  int stance(double phase) const noexcept { return stance_[static_cast<std::size_t>(tick_of(phase))]; }
  int law(double phase) const noexcept { return phase_[static_cast<std::size_t>(tick_of(phase))]; }
  /// Index of the offset a_hat that is in force: the stance side of a gait; of others the law's, unless divided.
  int offset(double phase) const noexcept {
    const auto t = static_cast<std::size_t>(tick_of(phase));
    return !offsets_.empty() ? offsets_[t] : cyclic_ ? stance_[t] : phase_[t];
  }
  /// Divides the motion into parts with offsets of their own. Throws Error unless there is an index for every tick.
  void divide(std::vector<int> offset_of_tick) {
    if (offset_of_tick.size() != static_cast<std::size_t>(ticks_)) throw Error("motion table: expected an offset for every tick");
    offsets_ = std::move(offset_of_tick);
  }
  /// Ticks on which the stance foot changes, increasing.
  std::vector<int> step_starts() const {
    std::vector<int> starts;
    for (int t = 0; t < ticks_; ++t) {
      const int before = t > 0 ? t - 1 : cyclic_ ? ticks_ - 1 : -1;
      if (before >= 0 && stance_[static_cast<std::size_t>(t)] != stance_[static_cast<std::size_t>(before)])
        starts.push_back(t);
    }
    return starts;
  }

  /// The moment (layout().size() numbers) at a phase (ticks), amplitude alpha (held to the tabulated ones) and with time
  /// stretched by beta, which divides velocities. Quaternions are not of unit length.
  void sample(double alpha, double beta, double phase, float* out) const noexcept {
    double p = cyclic_ ? phase - std::floor(phase / ticks_) * ticks_ : std::clamp(phase, 0.0, static_cast<double>(ticks_));
    const int t = std::min(static_cast<int>(p), ticks_ - 1);
    const auto u = static_cast<float>(p - t);
    std::size_t k = 0;
    float w = 0;
    if (amplitudes_.size() > 1) {
      while (k + 2 < amplitudes_.size() && alpha > amplitudes_[k + 1]) ++k;
      w = static_cast<float>(std::clamp((alpha - amplitudes_[k]) / (amplitudes_[k + 1] - amplitudes_[k]), 0.0, 1.0));
    }
    const std::size_t next = amplitudes_.size() > 1 ? k + 1 : k;
    const float* a = tables_[k].data() + t * tables_[k].rows();
    const float* b = tables_[next].data() + t * tables_[next].rows();
    const int n = layout_.size();
    for (int i = 0; i < n; ++i) {
      const float low = a[i] + u * (a[n + i] - a[i]), high = b[i] + u * (b[n + i] - b[i]);
      out[i] = low + w * (high - low);
    }
    const auto rate = static_cast<float>(1 / beta);
    for (int i = 0; i < 3; ++i) out[layout_.velocity() + i] *= rate;
    for (int i = 0; i < 3; ++i) out[layout_.spin() + i] *= rate;
  }

private:
  void tabulate(const sim::Model& model, const Roles& roles, const Controller& c, double alpha) {
    const TrackingReference& r = c.reference;
    const body::Skeleton& sk = model.character.skeleton;
    const int columns = ticks_ + 1;
    motion::Clip states{c.clip, sk, Eigen::VectorXd::LinSpaced(columns, 0, duration()), r.poses.leftCols(columns), {}, false};
    motion::Clip actions = states;
    for (int t = 0; t < columns; ++t)
      actions.poses.col(t).tail(layout_.joints) =
          c.targets.col(t < ticks_ ? t : cyclic_ ? 0 : ticks_ - 1).tail(layout_.joints);
    motion::AmplitudeScaling scaling;
    scaling.travel = false;
    // At its own amplitude a motion stays as it is, to the bit.
    if (std::abs(alpha - 1) > 1e-12) {
      states = motion::scale_amplitude(states, alpha, scaling);
      actions = motion::scale_amplitude(actions, alpha, scaling);
    }
    TrackingReference scaled;
    scaled.dt = c.tick;
    scaled.poses = states.poses;
    scaled.velocities = alpha * r.velocities.leftCols(columns);
    // What travels is not scaled: the runner's speed is asked for, not copied.
    scaled.velocities.topRows(2) = r.velocities.topLeftCorner(2, columns);
    measure_reference(model, roles, {}, scaled);

    Eigen::MatrixXf table(layout_.size(), columns);
    for (int t = 0; t < columns; ++t) {
      const int at = t < ticks_ ? t : cyclic_ ? 0 : ticks_;
      auto column = table.col(t);
      const auto put = [&](int row, const auto& values) { column.segment(row, values.size()) = values.template cast<float>(); };
      const Eigen::Vector3d center = scaled.center_of_mass.col(at), velocity = scaled.center_velocity.col(at);
      put(0, Eigen::VectorXd(actions.poses.col(t).tail(layout_.joints)));
      put(layout_.root(), Eigen::Vector4d(scaled.poses.col(at).segment(3, 4)));
      column[layout_.yaw()] = static_cast<float>(scaled.heading[at]);
      Eigen::Vector3d own = center, pace = velocity;
      if (cyclic_) {
        own.x() -= start_center_.x + speed_ * at * tick_;
        own.y() -= start_center_.y;
        pace.x() -= speed_;
      }
      put(layout_.center(), own);
      put(layout_.velocity(), pace);
      for (int side = 0; side < 2; ++side)
        put(layout_.feet() + 3 * side, Eigen::Vector3d(Eigen::Vector3d(scaled.feet.col(at).segment(3 * side, 3)) - center));
      put(layout_.spin(), Eigen::Vector3d(scaled.velocities.col(at).segment(3, 3)));
      put(layout_.sensory(), Eigen::VectorXd(c.sensory.col(at < ticks_ ? at : ticks_ - 1)));
    }
    align(model, table);
    tables_.push_back(std::move(table));
  }

  /// Gives every quaternion of the first table the sign of the one before it, and of the others that of the same tick in the
  /// table before, so that numbers in between mean rotations in between.
  void align(const sim::Model& model, Eigen::MatrixXf& table) const {
    const auto turn = [&](int row) {
      for (Eigen::Index t = 0; t < table.cols(); ++t) {
        auto q = table.col(t).segment(row, 4);
        const float same = !tables_.empty() ? q.dot(tables_.back().col(t).segment(row, 4))
                           : t > 0          ? q.dot(table.col(t - 1).segment(row, 4))
                                            : q[3];
        if (same < 0) q = -q;
      }
    };
    for (const sim::MovingBody& b : model.bodies)
      if (b.type == body::JointType::ball) turn(b.q_index - 7);
    turn(layout_.root());
  }

  MomentLayout layout_;
  std::vector<double> amplitudes_;
  double tick_ = 1.0 / 60;
  int ticks_ = 0;
  bool cyclic_ = false;
  double speed_ = 0;
  core::Vector3<double> start_center_{0, 0, 0};
  std::vector<int> stance_, phase_, offsets_;
  std::vector<Eigen::MatrixXf> tables_;  ///< layout_.size() x (ticks + 1), one for each amplitude
};

}  // namespace traceur::control
