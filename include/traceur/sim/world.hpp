// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "traceur/core/executor.hpp"
#include "traceur/sim/lanes.hpp"
#include "traceur/sim/scene.hpp"
#include "traceur/sim/simulator.hpp"

namespace traceur::sim {

/// The bundled simulator: any number of lanes of one character on one ground, `core::lane_count<S>` of them stepped
/// together. S is `double` or `float` for one at a time, `core::Pack<float>` for throughput. A model of `Simulator`.
/// Gravity, friction, scene and body may differ from lane to lane.
template <class S>
class World {
 public:
  using T = core::Element<S>;
  using Vector = Eigen::Matrix<T, Eigen::Dynamic, 1>;

  /// Throws Error when the character, the parameters or the extras are refused or `lanes` is not positive.
  World(const body::Character& character, int lanes, const Parameters& parameters = {}, const Ground<T>& ground = {},
        const Extras& extras = {})
      : shared_(std::make_unique<Shared>(Shared{make_model(character), parameters, ground, extras})), lanes_(lanes) {
    parameters.check();
    if (lanes < 1) throw Error("simulator: expected at least one lane, found " + std::to_string(lanes));
    groups_.reserve(static_cast<std::size_t>((lanes + width - 1) / width));
    for (int i = 0; i < lanes; i += width) groups_.emplace_back(shared_->model, shared_->parameters, shared_->ground, shared_->extras);
    scenes_.resize(static_cast<std::size_t>(lanes));
  }
  /// The same, all lanes in one scene.
  World(const body::Character& character, int lanes, const Parameters& parameters, const Scene& scene, const Extras& extras = {})
      : World(character, lanes, parameters, scene.ground.template cast<T>(), with_obstacles(extras, !scene.boxes.empty())) {
    if (scene.boxes.empty()) return;
    const auto shared = std::make_shared<const Scene>(scene);
    for (int lane = 0; lane < lanes; ++lane) set_scene(lane, shared);
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
    g.reset_extras(l);
    g.clear_failed(l);
  }

  /// What one lane lives in and with; it stays so until changed, resets included. Throws Error on a value out of range, boxes
  /// where Extras::obstacles is off, or a body that is not built like the others.
  void set_gravity(int lane, double gravity) {
    if (!(gravity >= 0) || !std::isfinite(gravity)) throw Error(where(lane) + "gravity: expected zero or more");
    group(lane).set_gravity(lane % width, static_cast<T>(gravity));
  }
  void set_friction(int lane, double friction) {
    if (!(friction >= 0) || !std::isfinite(friction)) throw Error(where(lane) + "friction: expected zero or more");
    group(lane).set_friction(lane % width, static_cast<T>(friction));
  }
  void set_scene(int lane, std::shared_ptr<const Scene> scene) {
    if (!scene) throw Error(where(lane) + "expected a scene");
    group(lane).set_place(lane % width, scene->ground.template cast<T>(), &scene->boxes);
    scenes_[static_cast<std::size_t>(lane)] = std::move(scene);
  }
  void set_body(int lane, const body::Character& character) {
    group(lane).set_body(lane % width, make_model(character));
  }
  void set_object_shape(int lane, int object, const ObjectShape& shape) {
    check_object(object);
    group(lane).set_object_shape(lane % width, object, shape);
  }

  /// Puts an object of a lane somewhere: centre (m), rotation, velocity (m/s), angular velocity (rad/s), world axes.
  void set_object(int lane, int object, const core::Vector3<double>& position,
                  const core::Quaternion<double>& rotation = core::Quaternion<double>::identity(),
                  const core::Vector3<double>& velocity = {0, 0, 0}, const core::Vector3<double>& angular = {0, 0, 0}) {
    check_object(object);
    S* x = group(lane).object_state(object);
    const double numbers[object_coordinates] = {position.x, position.y, position.z, rotation.x, rotation.y, rotation.z, rotation.w,
                                                velocity.x, velocity.y, velocity.z, angular.x,  angular.y,  angular.z};
    for (int i = 0; i < object_coordinates; ++i) core::set_lane(x[i], lane % width, static_cast<T>(numbers[i]));
  }
  core::Vector3<T> object_position(int lane, int object) const { return object_numbers(lane, object, 0); }
  core::Quaternion<T> object_rotation(int lane, int object) const {
    const core::Vector3<T> v = object_numbers(lane, object, 3);
    return {v.x, v.y, v.z, core::lane_of(group(lane).object_state(object)[6], lane % width)};
  }
  core::Vector3<T> object_velocity(int lane, int object) const { return object_numbers(lane, object, 7); }
  core::Vector3<T> object_angular_velocity(int lane, int object) const { return object_numbers(lane, object, 10); }
  double object_mass(int lane, int object) const {
    return static_cast<double>(core::lane_of(group(lane).object(object).mass, lane % width));
  }
  /// Impulse that the character gave the object over the last call of `step`, N s.
  core::Vector3<T> object_impulse(int lane, int object) const { return vector(group(lane).object(object).impulse, lane); }

  /// Closes a grip (index in Extras::grips) where it is: on the world there, or on its object. Call after `refresh` or `step`.
  /// It opens by itself when its force passes `breaking` N.
  void hold(int lane, int grip, double breaking = std::numeric_limits<double>::infinity()) {
    const core::Vector3<T> at = vector(checked_grip(lane, grip).grip_place(grip), lane);
    const int object = shared_->extras.grips[static_cast<std::size_t>(grip)].object;
    hold_at(lane, grip, object < 0 ? at : object_rotation(lane, object).conjugate().rotate(at - object_position(lane, object)), breaking);
  }
  /// Closes a grip on an anchor: m, world, or in its object's frame. Farther than some millimetres it pulls hard.
  void hold_at(int lane, int grip, const core::Vector3<T>& anchor, double breaking = std::numeric_limits<double>::infinity()) {
    if (!(breaking > 0)) throw Error(where(lane) + "grip: expected a breaking force above zero");
    checked_grip(lane, grip).hold(lane % width, grip, anchor, static_cast<T>(breaking));
  }
  void release(int lane, int grip) { checked_grip(lane, grip).release(lane % width, grip); }
  bool holds(int lane, int grip) const { return group(lane).holds(lane % width, grip); }
  /// Mean force of a grip on the character over the last call of `step`, N.
  core::Vector3<T> grip_force(int lane, int grip) const { return vector(group(lane).grip_force(grip), lane); }

  /// Target pose of the joint motors (nq numbers, the root's are ignored).
  template <class Q>
  void set_target(int lane, const Eigen::MatrixBase<Q>& q) {
    S* target = group(lane).target();
    const int l = lane % width;
    for (int i = 0; i < model().nq; ++i) core::set_lane(target[i], l, static_cast<T>(q[i]));
  }

  /// Force (N, world) on the body of joint `joint` at a point of that joint's frame (m), during the next call of `step`.
  void push(int lane, int joint, const core::Vector3<double>& force, const core::Vector3<double>& point = {0, 0, 0}) {
    const int b = model().moving_of_joint[static_cast<std::size_t>(joint)];
    if (b < 0) return;
    group(lane).push(lane % width, b, force.cast<T>(), model().on_moving_body(joint, point).template cast<T>());
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
  /// Kinetic energy of moving body `b`, J.
  T kinetic_energy(int lane, int b) const { return core::lane_of(group(lane).kinetic_energy(b), lane % width); }
  /// Kinetic energy of the whole character, J.
  T kinetic_energy(int lane) const {
    T sum = 0;
    for (std::size_t b = 0; b < model().bodies.size(); ++b) sum += kinetic_energy(lane, static_cast<int>(b));
    return sum;
  }
  /// Power of the motor of moving body `b` at the end of the last time step, W; positive where it does work.
  T joint_power(int lane, int b) const {
    const core::Vector3<T> torque = joint_torque(lane, b);
    const MovingBody& m = model().bodies[static_cast<std::size_t>(b)];
    const S* v = group(lane).v() + m.v_index;
    const auto rate = [&](int k) { return core::lane_of(v[k], lane % width); };
    if (m.type == body::JointType::free) return 0;
    if (m.type == body::JointType::hinge) return torque.x * rate(0);
    return torque.x * rate(0) + torque.y * rate(1) + torque.z * rate(2);
  }
  /// How moving body `b` slides on ground and boxes while these carry it, mean over the last call of `step`.
  LoadedSlide<T> contact_slide(int lane, int b) const {
    const auto& m = group(lane).body_slide()[static_cast<std::size_t>(b)];
    return {core::lane_of(m.load, lane % width), core::lane_of(m.sum, lane % width)};
  }
  /// Impulse of the contacts on moving body `b` over the last call of `step`, N s.
  core::Vector3<T> contact_impulse(int lane, int b) const { return group(lane).last_seconds() * contact_force(lane, b); }
  /// Whether moving body `b` touched anything during the last call of `step`: its contact label.
  bool contact_label(int lane, int b, T least_force = T(1)) const { return norm(contact_force(lane, b)) > least_force; }

  /// Poses (nq x lanes) and velocities (nv x lanes) of all lanes, one column each, into matrices of that size.
  template <class Q, class V>
  void read(Eigen::MatrixBase<Q>& q, Eigen::MatrixBase<V>& v) const {
    for (std::size_t g = 0; g < groups_.size(); ++g) {
      const int first = static_cast<int>(g) * width, used = std::min(width, lanes_ - first);
      for (int i = 0; i < model().nq; ++i)
        for (int l = 0; l < used; ++l) q(i, first + l) = core::lane_of(groups_[g].q()[i], l);
      for (int i = 0; i < model().nv; ++i)
        for (int l = 0; l < used; ++l) v(i, first + l) = core::lane_of(groups_[g].v()[i], l);
    }
  }
  /// Targets of all lanes, one column each (nq x lanes).
  template <class Q>
  void set_targets(const Eigen::MatrixBase<Q>& q) {
    for (std::size_t g = 0; g < groups_.size(); ++g) {
      const int first = static_cast<int>(g) * width, used = std::min(width, lanes_ - first);
      for (int i = 0; i < model().nq; ++i)
        for (int l = 0; l < used; ++l) core::set_lane(groups_[g].target()[i], l, static_cast<T>(q(i, first + l)));
    }
  }

  core::Vector3<T> center_of_mass(int lane) const { return vector(group(lane).work().center_of_mass, lane); }
  core::Vector3<T> linear_momentum(int lane) const { return vector(group(lane).work().linear_momentum, lane); }
  core::Vector3<T> angular_momentum(int lane) const { return vector(group(lane).work().angular_momentum, lane); }

  /// Numbers in a lane's whole state.
  int state_size() const { return Lanes<S>::state_size(model(), shared_->extras); }
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
    Extras extras;
  };
  static Extras with_obstacles(Extras extras, bool obstacles) {
    extras.obstacles = extras.obstacles || obstacles;
    return extras;
  }
  static std::string where(int lane) { return "simulator: lane " + std::to_string(lane) + ": "; }
  void check_object(int object) const {
    if (object < 0 || object >= static_cast<int>(shared_->extras.objects.size()))
      throw Error("simulator: no object " + std::to_string(object));
  }
  Lanes<S>& checked_grip(int lane, int grip) {
    if (grip < 0 || grip >= static_cast<int>(shared_->extras.grips.size())) throw Error("simulator: no grip " + std::to_string(grip));
    return group(lane);
  }
  core::Vector3<T> object_numbers(int lane, int object, int from) const {
    const S* x = group(lane).object_state(object) + from;
    const int l = lane % width;
    return {core::lane_of(x[0], l), core::lane_of(x[1], l), core::lane_of(x[2], l)};
  }

  Lanes<S>& group(int lane) { return groups_[static_cast<std::size_t>(lane / width)]; }
  const Lanes<S>& group(int lane) const { return groups_[static_cast<std::size_t>(lane / width)]; }
  const BodyWork<S>& work(int lane, int b) const { return group(lane).work().bodies[static_cast<std::size_t>(b)]; }
  static core::Vector3<T> vector(const core::Vector3<S>& v, int lane) {
    const int l = lane % width;
    return {core::lane_of(v.x, l), core::lane_of(v.y, l), core::lane_of(v.z, l)};
  }

  std::unique_ptr<Shared> shared_;
  std::vector<Lanes<S>> groups_;
  std::vector<std::shared_ptr<const Scene>> scenes_;  ///< kept for the lanes that look at them
  int lanes_;
};

}  // namespace traceur::sim
