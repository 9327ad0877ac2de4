// SPDX-License-Identifier: MIT
#pragma once

#include <ode/ode.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <mutex>
#include <numbers>
#include <type_traits>
#include <utility>
#include <vector>

#include "traceur/backends/detail/joint_terms.hpp"
#include "traceur/backends/detail/near_columns.hpp"
#include "traceur/sim/parameters.hpp"
#include "traceur/sim/scene.hpp"
#include "traceur/sim/simulator.hpp"

namespace traceur::backends {

/// The Open Dynamics Engine (0.16, double precision) as a model of `sim::Simulator`.
///
/// Every body moves freely in six coordinates and joints are constraints; a lane is one dWorld advanced by dWorldStep, a
/// mixed complementarity problem solved directly. Motors, stops and contacts are rows of it, softened so that each is a
/// spring-damper taken at the end of the step: a row J v + cfm f = c with cfm = 1 / (h k + d) and c = k x cfm applies
/// f = k (x - h v) - d v. Gains therefore mean what they mean in the bundled simulator, and stiff ones stay stable.
///
/// Of Parameters it reads dt, gravity, friction, contact_stiffness, contact_damping, spring_depth, stop_stiffness and
/// stop_damping. Bodies touch the world, not each other. The torque limit holds for the norm of a motor's torque: a step in
/// which one exceeds it is taken again with that torque, shrunk to the limit, held constant. Friction is a pyramid
/// with one edge along the sliding direction. Joints drift apart by fractions of a millimetre and are pulled together by
/// the next steps; `pose` reads the joints' rotations and the root's place.
///
/// Lanes are advanced one after another, by one thread at a time. All instances share ODE's own initialisation, which the
/// last one ends. ODE writes to stderr when it meets a singular system.
class Ode {
 public:
  using Vector = core::Vector3<double>;

  /// Throws Error, one line, when the character, the parameters or the number of lanes is refused.
  Ode(const body::Character& character, int lanes, const sim::Parameters& parameters = {}, const sim::Scene& scene = {})
      : model_(sim::make_model(character)), parameters_(parameters), scene_(scene) {
    parameters.check();
    detail::check_engine("ode", model_, lanes);
    make_shapes();
    const std::size_t n = model_.bodies.size();
    kept_.resize(n);
    fixed_.assign(n, 0);
    frames_ = body::Frames<double>(model_.character.skeleton);
    twists_ = body::Twists<double>(model_.character.skeleton);
    lanes_.reserve(static_cast<std::size_t>(lanes));
    for (int i = 0; i < lanes; ++i) lanes_.push_back(make_lane());
  }

  int lanes() const { return static_cast<int>(lanes_.size()); }
  const body::Character& character() const { return model_.character; }
  const sim::Parameters& parameters() const { return parameters_; }
  double dt() const { return parameters_.dt; }

  /// Puts a lane at pose q (nq) and velocity v (nv), its target the pose itself, without grips or pushes.
  template <class Q, class V>
  void reset(int lane, const Eigen::MatrixBase<Q>& q, const Eigen::MatrixBase<V>& v) {
    Lane& l = at(lane);
    for (std::size_t j = 0; j < l.grips.size(); ++j) drop(l, j);
    forget(l);
    l.failed = false;
    l.q = q;
    l.v = v;
    l.target = l.q;
    if (!l.q.allFinite() || !l.v.allFinite()) return fail(l);
    place(l);
  }

  /// Target pose of the joint motors (nq numbers, the root's are ignored).
  template <class Q>
  void set_target(int lane, const Eigen::MatrixBase<Q>& q) {
    at(lane).target = q;
  }

  /// Force (N, world) on the body of joint `joint` at a point of that joint's frame (m), during the next call of `step`.
  void push(int lane, int joint, const Vector& force, const Vector& point = {0, 0, 0}) {
    const int b = moving(joint);
    if (b < 0) return;
    Push& p = at(lane).pushes[static_cast<std::size_t>(b)];
    p.force = force;
    p.arm = on_body(joint, point) - centers_[static_cast<std::size_t>(b)];
  }

  /// Ties a point of the joint's frame (m) to a place in the world (m) by a ball joint that does not give, in place of an
  /// earlier grip of that joint. A fifth of a gap closes in every time step.
  void hold(int lane, int joint, const Vector& point, const Vector& anchor) {
    Lane& l = at(lane);
    const auto j = static_cast<std::size_t>(joint);
    drop(l, j);
    const int b = moving(joint);
    if (b < 0 || !std::isfinite(squared_norm(point) + squared_norm(anchor))) return;
    const dBodyID body = l.bodies[static_cast<std::size_t>(b)];
    const Vector place = position(body) + rotation(body).rotate(on_body(joint, point) - centers_[static_cast<std::size_t>(b)]);
    Grip& g = l.grips[j];
    g.joint = dJointCreateBall(l.world.get(), nullptr);
    dJointAttach(g.joint, body, nullptr);
    dJointSetBallAnchor(g.joint, place.x, place.y, place.z);
    dJointSetBallAnchor2(g.joint, anchor.x, anchor.y, anchor.z);
    dJointSetBallParam(g.joint, dParamERP, grip_erp);
    dJointSetFeedback(g.joint, &g.feedback);
  }
  /// Lets go; without a grip there nothing happens.
  void release(int lane, int joint) { drop(at(lane), static_cast<std::size_t>(joint)); }
  /// Mean force of a joint's grip on its body over the last call of `step`, N, world; zero without a grip.
  Vector grip_force(int lane, int joint) const { return at(lane).grips[static_cast<std::size_t>(joint)].force; }

  /// Mean contact force on the body of a joint over the last call of `step`, N, world.
  Vector contact_force(int lane, int joint) const {
    const int b = moving(joint);
    return b < 0 ? Vector::zero() : at(lane).contact_force[static_cast<std::size_t>(b)];
  }
  /// Motor torque of a joint in the last time step, N m, axes of the joint's frame at its beginning; hinge: x.
  Vector motor_torque(int lane, int joint) const {
    const int b = moving(joint);
    if (b < 0 || model_.bodies[static_cast<std::size_t>(b)].joint != joint) return Vector::zero();
    return at(lane).motor_torque[static_cast<std::size_t>(b)];
  }

  /// Advances all lanes by `count` time steps.
  void step(int count) {
    for (Lane& l : lanes_) {
      for (Vector& f : l.contact_force) f = Vector::zero();
      for (Grip& g : l.grips) g.force = Vector::zero();
      for (int i = 0; i < count && !l.failed; ++i) advance(l);
      const double share = count > 0 ? 1.0 / count : 0.0;
      for (Vector& f : l.contact_force) f *= share;
      for (Grip& g : l.grips) g.force *= share;
      for (Push& p : l.pushes) p = {};
    }
  }

  template <class Q>
  void pose(int lane, Eigen::MatrixBase<Q>& out) const {
    out = at(lane).q;
  }
  template <class V>
  void velocity(int lane, Eigen::MatrixBase<V>& out) const {
    out = at(lane).v;
  }
  Eigen::VectorXd pose(int lane) const { return at(lane).q; }
  Eigen::VectorXd velocity(int lane) const { return at(lane).v; }
  /// Whether the lane met a number that is not finite since its last reset. It rests in the neutral pose until the next.
  bool failed(int lane) const { return at(lane).failed; }

 private:
  using Quaternion = core::Quaternion<double>;

  struct Session {
    Session() {
      const std::lock_guard<std::mutex> lock(mutex());
      if (users()++ == 0) dInitODE2(0);
      dAllocateODEDataForThread(static_cast<unsigned int>(dAllocateMaskAll));
    }
    ~Session() {
      const std::lock_guard<std::mutex> lock(mutex());
      if (--users() == 0) dCloseODE();
    }
    Session(const Session&) = delete;
    Session& operator=(const Session&) = delete;

   private:
    static std::mutex& mutex() {
      static std::mutex m;
      return m;
    }
    static int& users() {
      static int n = 0;
      return n;
    }
  };

  struct DestroyWorld {
    void operator()(dWorldID w) const { dWorldDestroy(w); }
  };
  struct DestroyGroup {
    void operator()(dJointGroupID g) const { dJointGroupDestroy(g); }
  };
  struct DestroyGeom {
    void operator()(dGeomID g) const { dGeomDestroy(g); }
  };
  template <class Id, class Destroy>
  using Owned = std::unique_ptr<std::remove_pointer_t<Id>, Destroy>;
  using Geom = Owned<dGeomID, DestroyGeom>;

  /// A shape of the character on its moving body, and the geometry that stands in for it in every lane.
  struct ShapeGeom {
    int body = 0;
    body::Shape::Kind kind = body::Shape::Kind::sphere;
    Vector center{0, 0, 0};  ///< from the centre of mass, body axes, m
    Quaternion turn = Quaternion::identity();
    Vector size{0, 0, 0};
    double reach = 0;  ///< no point of it is further from its centre, m
    Geom geom, cap;    ///< cap: the sphere at either end of a capsule
  };

  struct Push {
    Vector force{0, 0, 0}, arm{0, 0, 0};
  };
  struct Grip {
    dJointID joint = nullptr;
    dJointFeedback feedback{};
    Vector force{0, 0, 0};
  };
  struct Touch {
    dJointFeedback feedback{};
    std::size_t body = 0;
  };
  struct State {
    Vector position, linear, angular;
    Quaternion rotation;
  };

  struct Lane {
    Owned<dWorldID, DestroyWorld> world;
    Owned<dJointGroupID, DestroyGroup> contacts;
    std::vector<dBodyID> bodies;
    std::vector<dJointID> motors, stops;  ///< of each moving body; null at a free root
    std::vector<dJointFeedback> motor_feedback;
    std::vector<Vector> contact_force, motor_torque;
    std::vector<Push> pushes;
    std::vector<Grip> grips;  ///< of each joint
    std::vector<Touch> touches;
    std::size_t touching = 0;
    Eigen::VectorXd q, v, target;
    bool failed = false;
  };

  static constexpr double joint_erp = 0.8;  ///< share of a joint's drift that one step takes back
  static constexpr double grip_erp = 0.2;   ///< lower, so that a gap closes without a jerk
  static constexpr int contacts_of_pair = 8;
  static constexpr std::size_t contacts_of_shape = 16;

  Lane& at(int lane) { return lanes_[static_cast<std::size_t>(lane)]; }
  const Lane& at(int lane) const { return lanes_[static_cast<std::size_t>(lane)]; }
  int moving(int joint) const { return model_.moving_of_joint[static_cast<std::size_t>(joint)]; }
  /// A point of a joint's frame in the frame of the moving body that carries it.
  Vector on_body(int joint, const Vector& point) const {
    return model_.on_moving_body(joint, point);
  }
  static Vector vector(const dReal* p) { return {p[0], p[1], p[2]}; }
  static Vector position(dBodyID b) { return vector(dBodyGetPosition(b)); }
  static Quaternion rotation(dBodyID b) {
    const dReal* r = dBodyGetQuaternion(b);
    return {r[1], r[2], r[3], r[0]};
  }
  static void set_rotation(dBodyID b, const Quaternion& r) {
    const dQuaternion wxyz = {r.w, r.x, r.y, r.z};
    dBodySetQuaternion(b, wxyz);
  }
  static bool powered(const body::Actuator& a) { return a.torque_limit > 0 && a.stiffness + a.damping > 0; }
  static double limit(const body::Actuator& a) { return powered(a) ? a.torque_limit : 0.0; }
  /// How a motor's row resists the joint's velocity, N m s/rad; the rotor resists a change of it in this step.
  double motor_gain(const body::Actuator& a) const {
    return (powered(a) ? parameters_.dt * a.stiffness + a.damping : 0.0) + rotor_gain(a);
  }
  double rotor_gain(const body::Actuator& a) const { return a.armature / parameters_.dt; }

  void make_shapes() {
    const auto moving_bodies = model_.bodies.size();
    centers_.resize(moving_bodies);
    for (std::size_t b = 0; b < moving_bodies; ++b) centers_[b] = detail::merged_inertia(model_.bodies[b]).center;
    for (const body::Shape& s : model_.character.shapes) {
      const int b = moving(s.body);
      if (b < 0) continue;
      const auto j = static_cast<std::size_t>(s.body);
      ShapeGeom g;
      g.body = b;
      g.kind = s.kind;
      g.center = on_body(s.body, s.position) - centers_[static_cast<std::size_t>(b)];
      g.turn = model_.welded_rotation[j] * s.rotation;
      g.size = s.size;
      switch (s.kind) {
        case body::Shape::Kind::sphere:
          g.geom.reset(dCreateSphere(nullptr, s.size.x));
          g.reach = s.size.x;
          break;
        case body::Shape::Kind::capsule:
          g.geom.reset(dCreateCapsule(nullptr, s.size.x, 2 * s.size.y));
          g.cap.reset(dCreateSphere(nullptr, s.size.x));
          g.reach = s.size.x + s.size.y;
          break;
        case body::Shape::Kind::box:
          g.geom.reset(dCreateBox(nullptr, 2 * s.size.x, 2 * s.size.y, 2 * s.size.z));
          g.reach = norm(s.size);
          break;
      }
      shapes_.push_back(std::move(g));
    }
    const Vector n = scene_.ground.normal();
    plane_.reset(dCreatePlane(nullptr, n.x, n.y, n.z, scene_.ground.offset()));
    column_.reset(dCreateBox(nullptr, 1, 1, 1));
    for (const terrain::Box& b : scene_.boxes.boxes()) {
      boxes_.emplace_back(dCreateBox(nullptr, 2 * b.half_size.x, 2 * b.half_size.y, 2 * b.half_size.z));
      const dQuaternion wxyz = {b.rotation.w, b.rotation.x, b.rotation.y, b.rotation.z};
      dGeomSetPosition(boxes_.back().get(), b.center.x, b.center.y, b.center.z);
      dGeomSetQuaternion(boxes_.back().get(), wxyz);
    }
    near_.reserve(boxes_.size() * 4);
  }

  Lane make_lane() {
    Lane l;
    l.world.reset(dWorldCreate());
    const dWorldID w = l.world.get();
    dWorldSetGravity(w, 0, 0, -parameters_.gravity);
    dWorldSetERP(w, joint_erp);
    dWorldSetAutoDisableFlag(w, 0);
    l.contacts.reset(dJointGroupCreate(0));
    const std::size_t n = model_.bodies.size();
    l.bodies.resize(n);
    l.motors.assign(n, nullptr);
    l.stops.assign(n, nullptr);
    l.motor_feedback.assign(n, dJointFeedback{});
    l.contact_force.assign(n, Vector::zero());
    l.motor_torque.assign(n, Vector::zero());
    l.pushes.resize(n);
    l.grips.resize(static_cast<std::size_t>(model_.character.skeleton.size()));
    l.touches.resize(contacts_of_shape * shapes_.size());
    for (std::size_t b = 0; b < n; ++b) {
      const core::Symmetric3<double> i = detail::merged_inertia(model_.bodies[b]).about_center;
      dMass mass;
      dMassSetParameters(&mass, model_.bodies[b].mass, 0, 0, 0, i.xx, i.yy, i.zz, i.xy, i.xz, i.yz);
      l.bodies[b] = dBodyCreate(w);
      dBodySetMass(l.bodies[b], &mass);
      // Turns by a full rotation about the angular velocity instead of adding a multiple of it to the quaternion.
      dBodySetFiniteRotationMode(l.bodies[b], 1);
    }
    l.q = model_.character.skeleton.neutral_pose();
    l.v = Eigen::VectorXd::Zero(model_.nv);
    l.target = l.q;
    place(l);
    for (std::size_t b = 0; b < n; ++b)
      if (model_.bodies[b].type != body::JointType::free) join(l, b);
    return l;
  }

  /// Makes the joint of moving body `b` with its motor and stop, all bodies being in the neutral pose.
  void join(Lane& l, std::size_t b) {
    const sim::MovingBody& m = model_.bodies[b];
    const dWorldID w = l.world.get();
    const dBodyID child = l.bodies[b];
    const dBodyID parent = m.parent < 0 ? nullptr : l.bodies[static_cast<std::size_t>(m.parent)];
    const Vector& place = frames_.position[static_cast<std::size_t>(m.joint)];
    const Quaternion& turn = frames_.rotation[static_cast<std::size_t>(m.joint)];
    const bool hinge = m.type == body::JointType::hinge;
    const Vector axis = turn.rotate(m.axis);
    if (hinge) {
      const dJointID j = dJointCreateHinge(w, nullptr);
      dJointAttach(j, child, parent);
      dJointSetHingeAnchor(j, place.x, place.y, place.z);
      dJointSetHingeAxis(j, axis.x, axis.y, axis.z);
    } else {
      const dJointID j = dJointCreateBall(w, nullptr);
      dJointAttach(j, child, parent);
      dJointSetBallAnchor(j, place.x, place.y, place.z);
    }
    if (motor_gain(m.actuator) > 0) {
      const dJointID motor = dJointCreateAMotor(w, nullptr);
      dJointAttach(motor, child, parent);
      dJointSetAMotorMode(motor, dAMotorUser);
      dJointSetAMotorNumAxes(motor, hinge ? 1 : 3);
      const std::array<Vector, 3> axes{hinge ? axis : turn.rotate(Vector{1, 0, 0}), turn.rotate(Vector{0, 1, 0}),
                                       turn.rotate(Vector{0, 0, 1})};
      for (int k = 0; k < (hinge ? 1 : 3); ++k) {
        const Vector& a = axes[static_cast<std::size_t>(k)];
        dJointSetAMotorAxis(motor, k, 1, a.x, a.y, a.z);
      }
      dJointSetFeedback(motor, &l.motor_feedback[b]);
      l.motors[b] = motor;
    }
    if (m.actuator.limited || std::isfinite(m.actuator.cone)) {
      const dJointID stop = dJointCreateAMotor(w, nullptr);
      dJointAttach(stop, child, parent);
      dJointSetAMotorMode(stop, dAMotorUser);
      dJointSetAMotorNumAxes(stop, 1);
      dJointSetAMotorParam(stop, dParamCFM, stop_softness());
      l.stops[b] = stop;
    }
  }
  double stop_softness() const {
    return 1 / std::max(parameters_.dt * parameters_.stop_stiffness + parameters_.stop_damping, 1e-12);
  }

  static void drop(Lane& l, std::size_t joint) {
    Grip& g = l.grips[joint];
    if (g.joint) dJointDestroy(g.joint);
    g.joint = nullptr;
    g.force = Vector::zero();
  }

  static void forget(Lane& l) {
    for (Vector& f : l.contact_force) f = Vector::zero();
    for (Vector& t : l.motor_torque) t = Vector::zero();
    for (Push& p : l.pushes) p = {};
  }

  /// Writes pose and velocity of a lane into its bodies.
  void place(Lane& l) {
    const body::Skeleton& sk = model_.character.skeleton;
    body::forward_kinematics(sk, l.q.data(), frames_);
    body::forward_velocities(sk, frames_, l.v.data(), twists_);
    for (std::size_t b = 0; b < l.bodies.size(); ++b) {
      const auto j = static_cast<std::size_t>(model_.bodies[b].joint);
      const Quaternion r = frames_.rotation[j].normalized();
      const Vector arm = r.rotate(centers_[b]);
      write(l.bodies[b], {frames_.position[j] + arm, twists_.linear[j] + cross(twists_.angular[j], arm), twists_.angular[j], r});
    }
  }
  static void write(dBodyID b, const State& s) {
    dBodySetPosition(b, s.position.x, s.position.y, s.position.z);
    set_rotation(b, s.rotation);
    dBodySetLinearVel(b, s.linear.x, s.linear.y, s.linear.z);
    dBodySetAngularVel(b, s.angular.x, s.angular.y, s.angular.z);
    dBodySetForce(b, 0, 0, 0);
    dBodySetTorque(b, 0, 0, 0);
  }
  static State state(dBodyID b) {
    return {position(b), vector(dBodyGetLinearVel(b)), vector(dBodyGetAngularVel(b)), rotation(b)};
  }

  /// Reads a lane's pose and velocity from its bodies. False when a number is not finite.
  bool read(Lane& l) {
    double sum = 0;
    for (std::size_t b = 0; b < l.bodies.size(); ++b) {
      const sim::MovingBody& m = model_.bodies[b];
      const State s = state(l.bodies[b]);
      sum += squared_norm(s.position) + squared_norm(s.linear) + squared_norm(s.angular) + dot(s.rotation, s.rotation);
      double* q = l.q.data() + m.q_index;
      double* v = l.v.data() + m.v_index;
      if (m.type == body::JointType::free) {
        const Vector arm = s.rotation.rotate(centers_[b]);
        (s.position - arm).store(q);
        (m.rest.conjugate() * s.rotation).store(q + 3);
        (s.linear - cross(s.angular, arm)).store(v);
        s.angular.store(v + 3);
        continue;
      }
      Quaternion base = m.rest;
      Vector turning = s.angular;
      if (m.parent >= 0) {
        const dBodyID parent = l.bodies[static_cast<std::size_t>(m.parent)];
        base = rotation(parent) * m.rest;
        turning -= vector(dBodyGetAngularVel(parent));
      }
      Quaternion r = base.conjugate() * s.rotation;
      const Vector w = s.rotation.conjugate().rotate(turning);
      if (m.type == body::JointType::hinge) {
        // The turns that a rotation cannot tell come from the angle before.
        constexpr double turn = 2 * std::numbers::pi;
        const double angle = core::twist_angle(r, m.axis);
        q[0] = angle + turn * std::round((q[0] - angle) / turn);
        v[0] = dot(w, m.axis);
      } else {
        if (dot(r, Quaternion::from(q)) < 0) r = -r;
        r.store(q);
        w.store(v);
      }
    }
    return std::isfinite(sum);
  }

  void fail(Lane& l) {
    for (std::size_t j = 0; j < l.grips.size(); ++j) drop(l, j);
    dJointGroupEmpty(l.contacts.get());
    forget(l);
    l.failed = true;
    l.q = model_.character.skeleton.neutral_pose();
    l.target = l.q;
    l.v.setZero();
    place(l);
  }

  void advance(Lane& l) {
    if (!l.target.tail(l.target.size() - first_target()).allFinite()) return fail(l);
    for (std::size_t b = 0; b < l.bodies.size(); ++b) {
      kept_[b] = state(l.bodies[b]);
      set_motor(l, b);
    }
    find_contacts(l);
    for (int pass = 0;; ++pass) {
      add_fixed_torques(l);
      if (!add_pushes(l) || !dWorldStep(l.world.get(), parameters_.dt)) return fail(l);
      if (within_limits(l) || pass == 2) break;
      fix_motors(l, pass == 0 ? 0.9 : 0.0);
      for (std::size_t b = 0; b < l.bodies.size(); ++b) write(l.bodies[b], kept_[b]);
    }
    for (std::size_t k = 0; k < l.touching; ++k) l.contact_force[l.touches[k].body] += vector(l.touches[k].feedback.f1);
    for (Grip& g : l.grips)
      if (g.joint) g.force += vector(g.feedback.f1);
    dJointGroupEmpty(l.contacts.get());
    if (!read(l)) fail(l);
  }
  Eigen::Index first_target() const { return model_.character.skeleton.free_root() ? 7 : 0; }

  bool add_pushes(const Lane& l) const {
    for (std::size_t b = 0; b < l.bodies.size(); ++b) {
      const Push& p = l.pushes[b];
      if (!std::isfinite(squared_norm(p.force) + squared_norm(p.arm))) return false;
      if (squared_norm(p.force) > 0)
        dBodyAddForceAtRelPos(l.bodies[b], p.force.x, p.force.y, p.force.z, p.arm.x, p.arm.y, p.arm.z);
    }
    return true;
  }

  void set_motor(Lane& l, std::size_t b) {
    const sim::MovingBody& m = model_.bodies[b];
    const bool ball = m.type == body::JointType::ball;
    const double* q = l.q.data() + m.q_index;
    Vector present{0, 0, 0};
    if (l.stops[b]) present = ball ? log_map(Quaternion::from(q)) : Vector{q[0], 0, 0};
    if (const dJointID motor = l.motors[b]) {
      fixed_[b] = false;
      const double gain = motor_gain(m.actuator), kp = powered(m.actuator) ? m.actuator.stiffness : 0.0;
      const double* goal = l.target.data() + m.q_index;
      Vector error{goal[0] - q[0], 0, 0};
      if (ball) error = log_map(Quaternion::from(q).conjugate() * Quaternion::from(goal).normalized());
      set_rows(motor, ball, gain, kp * error + rotor_gain(m.actuator) * rate(l, b));
    }
    if (const dJointID stop = l.stops[b]) {
      const Vector excess = detail::stop_excess(m.actuator, ball, present);
      const double size = norm(excess);
      dJointSetAMotorParam(stop, dParamFMax, size > 0 ? unbounded() : 0.0);
      if (size > 0) {
        const Vector axis = kept_[b].rotation.rotate(ball ? (1 / size) * excess : (excess.x > 0 ? m.axis : -m.axis));
        dJointSetAMotorAxis(stop, 0, 1, axis.x, axis.y, axis.z);
        dJointSetAMotorParam(stop, dParamVel, -parameters_.stop_stiffness * size * stop_softness());
      }
    }
  }
  static double unbounded() { return dInfinity; }
  Vector rate(const Lane& l, std::size_t b) const {
    const double* v = l.v.data() + model_.bodies[b].v_index;
    return model_.bodies[b].type == body::JointType::ball ? Vector::from(v) : Vector{v[0], 0, 0};
  }
  /// Makes a motor's rows apply `torque` - gain x velocity at the end of the step.
  static void set_rows(dJointID motor, bool ball, double gain, const Vector& torque) {
    const std::array<double, 3> t{torque.x, torque.y, torque.z};
    for (int k = 0; k < (ball ? 3 : 1); ++k) {
      dJointSetAMotorParam(motor, dParamFMax + k * dParamGroup, gain > 0 ? unbounded() : 0.0);
      if (!(gain > 0)) continue;
      dJointSetAMotorParam(motor, dParamCFM + k * dParamGroup, 1 / gain);
      dJointSetAMotorParam(motor, dParamVel + k * dParamGroup, t[static_cast<std::size_t>(k)] / gain);
    }
  }

  /// Reads motor torques; false when one is beyond its limit.
  bool within_limits(Lane& l) const {
    bool within = true;
    for (std::size_t b = 0; b < l.bodies.size(); ++b) {
      const sim::MovingBody& m = model_.bodies[b];
      if (!l.motors[b] || fixed_[b] || !powered(m.actuator)) continue;
      const auto in_joint = [&](const Vector& world) {
        const Vector local = kept_[b].rotation.conjugate().rotate(world);
        return m.type == body::JointType::ball ? local : Vector{dot(local, m.axis), 0, 0};
      };
      Vector turning = vector(dBodyGetAngularVel(l.bodies[b]));
      if (m.parent >= 0) turning -= vector(dBodyGetAngularVel(l.bodies[static_cast<std::size_t>(m.parent)]));
      l.motor_torque[b] =
          in_joint(vector(l.motor_feedback[b].t1)) + rotor_gain(m.actuator) * (in_joint(turning) - rate(l, b));
      if (norm(l.motor_torque[b]) > limit(m.actuator) * (1 + 1e-6)) within = false;
    }
    return within;
  }

  /// Replaces the rows of motors above a share of their limit by the torque just found, shrunk to the limit, and leaves them
  /// the rotor. Torque that one motor loses may go to others, so the last pass fixes them all.
  void fix_motors(Lane& l, double share) {
    for (std::size_t b = 0; b < l.bodies.size(); ++b) {
      const body::Actuator& a = model_.bodies[b].actuator;
      if (!l.motors[b] || fixed_[b] || !powered(a) || !std::isfinite(a.torque_limit)) continue;
      const double size = norm(l.motor_torque[b]);
      if (size <= share * limit(a)) continue;
      if (size > limit(a)) l.motor_torque[b] *= limit(a) / size;
      fixed_[b] = true;
      set_rows(l.motors[b], model_.bodies[b].type == body::JointType::ball, rotor_gain(a), rotor_gain(a) * rate(l, b));
    }
  }
  void add_fixed_torques(const Lane& l) const {
    for (std::size_t b = 0; b < l.bodies.size(); ++b) {
      if (!fixed_[b]) continue;
      const sim::MovingBody& m = model_.bodies[b];
      const Vector& t = l.motor_torque[b];
      const Vector world = kept_[b].rotation.rotate(m.type == body::JointType::ball ? t : t.x * m.axis);
      dBodyAddTorque(l.bodies[b], world.x, world.y, world.z);
      if (m.parent >= 0) dBodyAddTorque(l.bodies[static_cast<std::size_t>(m.parent)], -world.x, -world.y, -world.z);
    }
  }

  void find_contacts(Lane& l) {
    l.touching = 0;
    for (const ShapeGeom& s : shapes_) {
      const State& k = kept_[static_cast<std::size_t>(s.body)];
      const Vector center = k.position + k.rotation.rotate(s.center);
      const Quaternion turn = k.rotation * s.turn;
      put(s.geom.get(), center, turn);
      if (const terrain::HeightGrid* grid = scene_.ground.grid()) {
        const Vector r{s.reach, s.reach, s.reach};
        if (center.z - s.reach <= grid->highest())
          detail::near_columns(*grid, center - r, center + r, 1.0, [&](const Vector& middle, const Vector& half) {
            dGeomSetPosition(column_.get(), middle.x, middle.y, middle.z);
            dGeomBoxSetLengths(column_.get(), 2 * half.x, 2 * half.y, 2 * half.z);
            touch_box(l, s, center, turn, column_.get(), grid);
          });
      } else if (dot(scene_.ground.normal(), center) - scene_.ground.offset() < s.reach) {
        touch(l, s, s.geom.get(), plane_.get(), nullptr);
      }
      near_.clear();
      scene_.boxes.near(center, s.reach, near_);
      for (int i : near_) touch_box(l, s, center, turn, boxes_[static_cast<std::size_t>(i)].get(), nullptr);
    }
  }
  static void put(dGeomID g, const Vector& at, const Quaternion& turn) {
    const dQuaternion wxyz = {turn.w, turn.x, turn.y, turn.z};
    dGeomSetPosition(g, at.x, at.y, at.z);
    dGeomSetQuaternion(g, wxyz);
  }

  /// ODE finds one contact of a capsule with a box, on which a capsule lying on it would rock: its ends are asked as well.
  void touch_box(Lane& l, const ShapeGeom& s, const Vector& center, const Quaternion& turn, dGeomID box,
                 const terrain::HeightGrid* grid) {
    if (s.kind != body::Shape::Kind::capsule) return touch(l, s, s.geom.get(), box, grid);
    const Vector axis = turn.rotate(Vector{0, 0, 1});
    for (int end = -1; end <= 1; end += 2) {
      const Vector at = center + (end * s.size.y) * axis;
      dGeomSetPosition(s.cap.get(), at.x, at.y, at.z);
      touch(l, s, s.cap.get(), box, grid);
    }
    touch(l, s, s.geom.get(), box, grid, [&](const Vector& point) {
      return std::abs(dot(point - center, axis)) < 0.9 * s.size.y;
    });
  }

  void touch(Lane& l, const ShapeGeom& s, dGeomID shape, dGeomID other, const terrain::HeightGrid* grid) {
    touch(l, s, shape, other, grid, [](const Vector&) { return true; });
  }
  template <class Wanted>
  void touch(Lane& l, const ShapeGeom& s, dGeomID shape, dGeomID other, const terrain::HeightGrid* grid, Wanted&& wanted) {
    std::array<dContactGeom, contacts_of_pair> found;
    const int n = dCollide(shape, other, contacts_of_pair, found.data(), sizeof(dContactGeom));
    const auto b = static_cast<std::size_t>(s.body);
    for (int i = 0; i < n && l.touching < l.touches.size(); ++i) {
      dContact c{};
      c.geom = found[static_cast<std::size_t>(i)];
      const Vector point = vector(c.geom.pos), normal = vector(c.geom.normal);
      if (!wanted(point) || (grid && detail::on_seam(*grid, point, normal))) continue;
      c.geom.depth = std::min(c.geom.depth, parameters_.spring_depth);
      const double h = parameters_.dt;
      const double give = std::max(h * parameters_.contact_stiffness + parameters_.contact_damping, 1e-12);
      c.surface.mode = dContactApprox1 | dContactSoftERP | dContactSoftCFM | dContactFDir1;
      c.surface.mu = parameters_.friction;
      c.surface.soft_erp = h * parameters_.contact_stiffness / give;
      c.surface.soft_cfm = 1 / give;
      const Vector along = sliding_direction(kept_[b], point, normal);
      along.store(c.fdir1);
      Touch& t = l.touches[l.touching++];
      t.body = b;
      const dJointID j = dJointCreateContact(l.world.get(), l.contacts.get(), &c);
      dJointAttach(j, l.bodies[b], nullptr);
      dJointSetFeedback(j, &t.feedback);
    }
  }
  /// Where friction has to act: against the sliding, or uphill where nothing slides.
  static Vector sliding_direction(const State& k, const Vector& point, const Vector& normal) {
    const auto tangent = [&](const Vector& v) { return v - dot(v, normal) * normal; };
    Vector t = tangent(k.linear + cross(k.angular, point - k.position));
    if (squared_norm(t) < 1e-4) t = tangent(Vector{0, 0, 1});
    if (squared_norm(t) < 1e-8) t = tangent(Vector{1, 0, 0});
    if (squared_norm(t) < 1e-8) t = tangent(Vector{0, 1, 0});
    return (1 / norm(t)) * t;
  }

  std::unique_ptr<Session> session_ = std::make_unique<Session>();
  sim::Model model_;
  sim::Parameters parameters_;
  sim::Scene scene_;
  std::vector<Vector> centers_;
  std::vector<ShapeGeom> shapes_;
  Geom plane_, column_;
  std::vector<Geom> boxes_;
  std::vector<int> near_;
  std::vector<State> kept_;  ///< of the bodies of the lane being advanced, before the step
  std::vector<char> fixed_;  ///< whether a motor's torque is held constant in this step
  body::Frames<double> frames_;
  body::Twists<double> twists_;
  std::vector<Lane> lanes_;
};

}  // namespace traceur::backends
