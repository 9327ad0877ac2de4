// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "traceur/core/executor.hpp"
#include "traceur/sim/lanes.hpp"
#include "traceur/sim/simulator.hpp"

namespace traceur::sim {

/// The bundled simulator: any number of lanes of one character on one ground, `core::lane_count<S>` of them stepped
/// together. S is `double` or `float` for one at a time, `core::Pack<float>` for throughput. A model of `Simulator`.
template <class S>
class World {
 public:
  using T = core::Element<S>;
  using Vector = Eigen::Matrix<T, Eigen::Dynamic, 1>;

  /// Throws Error when the character or the parameters are refused or `lanes` is not positive.
  World(const body::Character& character, int lanes, const Parameters& parameters = {}, const Ground<T>& ground = {})
      : shared_(std::make_unique<Shared>(Shared{make_model(character), parameters, ground})), lanes_(lanes) {
    parameters.check();
    if (lanes < 1) throw Error("simulator: expected at least one lane, found " + std::to_string(lanes));
    groups_.reserve(static_cast<std::size_t>((lanes + width - 1) / width));
    for (int i = 0; i < lanes; i += width) groups_.emplace_back(shared_->model, shared_->parameters, shared_->ground);
  }

  int lanes() const { return lanes_; }
  const body::Character& character() const { return shared_->model.character; }
  const Model& model() const { return shared_->model; }
  const Parameters& parameters() const { return shared_->parameters; }
  const Ground<T>& ground() const { return shared_->ground; }
  double dt() const { return shared_->parameters.dt; }

  /// Puts a lane at pose q (nq) and velocity v (nv), with no contact memory, its target the pose itself.
  template <class Q, class V>
  void reset(int lane, const Eigen::MatrixBase<Q>& q, const Eigen::MatrixBase<V>& v) {
    Lanes<S>& g = group(lane);
    const int l = lane % width;
    for (S& x : g.state()) core::set_lane(x, l, T(0));
    for (int i = 0; i < model().nq; ++i) {
      core::set_lane(g.q()[i], l, static_cast<T>(q[i]));
      core::set_lane(g.target()[i], l, static_cast<T>(q[i]));
    }
    for (int i = 0; i < model().nv; ++i) core::set_lane(g.v()[i], l, static_cast<T>(v[i]));
    g.clear_failed(l);
  }

  /// Target pose of the joint motors (nq numbers, the root's are ignored).
  template <class Q>
  void set_target(int lane, const Eigen::MatrixBase<Q>& q) {
    S* target = group(lane).target();
    const int l = lane % width;
    for (int i = 0; i < model().nq; ++i) core::set_lane(target[i], l, static_cast<T>(q[i]));
  }

  /// Force (N, world) on the body of joint `joint` at a point of that joint's frame (m), during the next call of `step`.
  void push(int lane, int joint, const core::Vector3<double>& force, const core::Vector3<double>& point = {0, 0, 0}) {
    const auto j = static_cast<std::size_t>(joint);
    const int b = model().moving_of_joint[j];
    if (b < 0) return;
    const core::Vector3<double> at = model().welded_place[j] + model().welded_rotation[j].rotate(point);
    group(lane).push(lane % width, b, force.cast<T>(), at.cast<T>());
  }

  /// Advances all lanes by `count` time steps.
  void step(int count) {
    for (auto& g : groups_) g.step(count);
  }
  /// The same, groups spread over an executor; the result does not depend on which.
  template <core::Executor E>
  void step(int count, E& executor) {
    executor.run(static_cast<int>(groups_.size()), [&](int i) { groups_[static_cast<std::size_t>(i)].step(count); });
  }
  /// Advances only the group of lanes [group x width, ...) by `count` steps: the unit of work for callers that schedule.
  void step_group(int index, int count) { groups_[static_cast<std::size_t>(index)].step(count); }
  static constexpr int group_width() { return width; }
  /// A whole group of lanes, for kernels that work on packs: lanes [index x width, (index + 1) x width).
  Lanes<S>& group_lanes(int index) { return groups_[static_cast<std::size_t>(index)]; }
  int groups() const { return static_cast<int>(groups_.size()); }

  template <class Q>
  void pose(int lane, Eigen::MatrixBase<Q>& out) const {
    const S* q = group(lane).q();
    for (int i = 0; i < model().nq; ++i) out[i] = core::lane_of(q[i], lane % width);
  }
  template <class V>
  void velocity(int lane, Eigen::MatrixBase<V>& out) const {
    const S* v = group(lane).v();
    for (int i = 0; i < model().nv; ++i) out[i] = core::lane_of(v[i], lane % width);
  }
  Eigen::VectorXd pose(int lane) const {
    Eigen::VectorXd q(model().nq);
    pose(lane, q);
    return q;
  }
  Eigen::VectorXd velocity(int lane) const {
    Eigen::VectorXd v(model().nv);
    velocity(lane, v);
    return v;
  }
  bool failed(int lane) const { return group(lane).failed(lane % width); }

  /// Measures of moving body `b` (index in model().bodies) after the last step, world axes, SI.
  core::Vector3<T> body_position(int lane, int b) const { return vector(work(lane, b).position, lane); }
  core::Vector3<T> body_linear_velocity(int lane, int b) const { return vector(work(lane, b).linear, lane); }
  core::Vector3<T> body_angular_velocity(int lane, int b) const { return vector(work(lane, b).angular, lane); }
  core::Matrix3<T> body_rotation(int lane, int b) const {
    const core::Matrix3<S>& r = work(lane, b).rotation;
    const int l = lane % width;
    return {core::lane_of(r.xx, l), core::lane_of(r.xy, l), core::lane_of(r.xz, l), core::lane_of(r.yx, l), core::lane_of(r.yy, l),
            core::lane_of(r.yz, l), core::lane_of(r.zx, l), core::lane_of(r.zy, l), core::lane_of(r.zz, l)};
  }
  /// Motor torque of the joint of moving body `b` in the last time step, N m, body axes (hinge: first component).
  core::Vector3<T> joint_torque(int lane, int b) const { return vector(work(lane, b).torque, lane); }
  /// Mean contact force on moving body `b` over the last call of `step`, N.
  core::Vector3<T> contact_force(int lane, int b) const {
    return vector(group(lane).body_force()[static_cast<std::size_t>(b)], lane);
  }
  core::Vector3<T> center_of_mass(int lane) const { return vector(group(lane).work().center_of_mass, lane); }
  core::Vector3<T> linear_momentum(int lane) const { return vector(group(lane).work().linear_momentum, lane); }
  core::Vector3<T> angular_momentum(int lane) const { return vector(group(lane).work().angular_momentum, lane); }

  /// Numbers in a lane's whole state.
  int state_size() const { return Lanes<S>::state_size(model()); }
  /// Copies a lane's whole state out; `restore` of it continues to the same bits.
  void save(int lane, T* out) const {
    const auto& state = group(lane).state();
    for (const S& x : state) *out++ = core::lane_of(x, lane % width);
  }
  void restore(int lane, const T* in) {
    Lanes<S>& g = group(lane);
    for (S& x : g.state()) core::set_lane(x, lane % width, *in++);
    g.clear_failed(lane % width);
  }
  /// Brings measures up to date with states written by `reset` or `restore`; `step` does so itself.
  void refresh() {
    for (auto& g : groups_) g.refresh();
  }
  void refresh_group(int index) { groups_[static_cast<std::size_t>(index)].refresh(); }

 private:
  static constexpr int width = core::lane_count<S>;
  struct Shared {
    Model model;
    Parameters parameters;
    Ground<T> ground;
  };

  Lanes<S>& group(int lane) { return groups_[static_cast<std::size_t>(lane / width)]; }
  const Lanes<S>& group(int lane) const { return groups_[static_cast<std::size_t>(lane / width)]; }
  const BodyWork<S>& work(int lane, int b) const { return group(lane).work().bodies[static_cast<std::size_t>(b)]; }
  static core::Vector3<T> vector(const core::Vector3<S>& v, int lane) {
    const int l = lane % width;
    return {core::lane_of(v.x, l), core::lane_of(v.y, l), core::lane_of(v.z, l)};
  }

  std::unique_ptr<Shared> shared_;
  std::vector<Lanes<S>> groups_;
  int lanes_;
};

}  // namespace traceur::sim
