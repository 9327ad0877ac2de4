// SPDX-License-Identifier: MIT
#pragma once

#include <BulletCollision/CollisionShapes/btBoxShape.h>
#include <BulletCollision/CollisionShapes/btCapsuleShape.h>
#include <BulletCollision/CollisionShapes/btCompoundShape.h>
#include <BulletCollision/CollisionShapes/btEmptyShape.h>
#include <BulletCollision/CollisionShapes/btSphereShape.h>
#include <BulletCollision/CollisionShapes/btStaticPlaneShape.h>
#include <BulletDynamics/Featherstone/btMultiBody.h>
#include <BulletDynamics/Featherstone/btMultiBodyConstraintSolver.h>
#include <BulletDynamics/Featherstone/btMultiBodyDynamicsWorld.h>
#include <BulletDynamics/Featherstone/btMultiBodyLinkCollider.h>
#include <BulletDynamics/Featherstone/btMultiBodyPoint2Point.h>
#include <btBulletCollisionCommon.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "traceur/backends/detail/engine.hpp"
#include "traceur/sim/dynamics.hpp"
#include "traceur/sim/simulator.hpp"

namespace traceur::backends {

/// Bullet as a `sim::Simulator`: one world per lane with one articulated body (btMultiBody) whose links have their axes
/// along the bodies' principal ones, welds merged. The bodies touch the scene and not one another. Bullet is single
/// precision as distributions ship it.
///
/// Motors and stops follow the bundled simulator's law, and so that its dampers may be taken implicitly their torques are
/// worked out before each time step from a prediction of the joint accelerations (stable proportional-derivative control:
/// Tan, Liu and Turk 2011), contact forces taken as in the step before. btMultiBody knows no armature: it enters that way
/// too, as a torque against the predicted acceleration. Motor torques never pass their limits. Of the parameters dt,
/// gravity, friction and the stops' constants are used. An object is for one thread at a time.
class Bullet {
 public:
  /// Throws Error, one line, when the character or the parameters are refused.
  Bullet(const body::Character& character, int lanes, const sim::Parameters& parameters = {}, const sim::Scene& scene = {})
      : parameters_(parameters),
        model_(sim::make_model(character)),
        free_(character.skeleton.free_root()),
        neutral_(character.skeleton.neutral_pose()),
        numbers_(model_),
        work_(model_) {
    parameters.check();
    detail::check_engine("bullet", model_, lanes);
    make_scene(scene);
    for (std::size_t i = 0; i < model_.bodies.size(); ++i) {
      const body::Inertia merged = detail::merged_inertia(model_.bodies[i]);
      inertias_.push_back(detail::principal_inertia(merged.about_center));
      centers_.push_back(merged.center);
      shapes_.push_back(make_shape(static_cast<int>(i)));
    }
    lanes_.resize(static_cast<std::size_t>(lanes));
    for (Lane& l : lanes_) {
      const std::vector<Vector> none(model_.bodies.size(), Vector::zero());
      l.q = l.target = neutral_;
      l.v = Eigen::VectorXd::Zero(model_.nv);
      l.push_force = l.push_point = l.contact = l.grip_force = l.touch_force = l.touch_moment = l.rate = none;
      l.held.resize(model_.bodies.size());
      start(l);
    }
  }

  int lanes() const { return static_cast<int>(lanes_.size()); }
  const body::Character& character() const { return model_.character; }
  const sim::Parameters& parameters() const { return parameters_; }
  double dt() const { return parameters_.dt; }

  /// Puts a lane at pose q (nq) and velocity v (nv), holding nothing, its target the pose itself.
  template <class Q, class V>
  void reset(int index, const Eigen::MatrixBase<Q>& q, const Eigen::MatrixBase<V>& v) {
    Lane& l = lane(index);
    l.q = q;
    l.v = v;
    l.target = q;
    start(l);
    l.failed = false;
  }

  /// Target pose of the joint motors (nq numbers, the root's are ignored).
  template <class Q>
  void set_target(int index, const Eigen::MatrixBase<Q>& q) {
    lane(index).target = q;
  }

  /// Force (N, world) on the body of joint `joint` at a point of that joint's frame (m), during the next call of `step`.
  void push(int index, int joint, const core::Vector3<double>& force, const core::Vector3<double>& point = {0, 0, 0}) {
    const int b = carrier(joint);
    if (b < 0) return;
    Lane& l = lane(index);
    l.push_force[static_cast<std::size_t>(b)] = force;
    l.push_point[static_cast<std::size_t>(b)] = on_carrier(joint, point);
  }

  /// Ties a point of a joint's frame (m) to a place in the world (m) by a ball joint, until released or reset. A body holds
  /// one place at a time, the last asked for; what is welded together is one body.
  void hold(int index, int joint, const core::Vector3<double>& point, const core::Vector3<double>& anchor) {
    const int b = carrier(joint);
    if (b < 0) return;
    release(index, joint);
    Lane& l = lane(index);
    const auto k = static_cast<std::size_t>(b);
    const Vector local = inertias_[k].axes.conjugate().rotate(on_carrier(joint, point) - centers_[k]);
    l.held[k] = std::make_unique<btMultiBodyPoint2Point>(l.body.get(), link(b), nullptr, to_bullet(local), to_bullet(anchor));
    // Far beyond what anyone can hold, and not so far that a grip on a distant place would tear the body apart.
    const double strongest = 50 * model_.total_mass * std::max(parameters_.gravity, 1.0);
    l.held[k]->setMaxAppliedImpulse(static_cast<btScalar>(strongest * parameters_.dt));
    l.world->addMultiBodyConstraint(l.held[k].get());
  }
  void release(int index, int joint) {
    const int b = carrier(joint);
    if (b < 0) return;
    Lane& l = lane(index);
    auto& grip = l.held[static_cast<std::size_t>(b)];
    if (grip) l.world->removeMultiBodyConstraint(grip.get());
    grip.reset();
  }

  /// Mean contact force on a joint's body, and all that is welded to it, over the last call of `step`, N, world.
  core::Vector3<double> contact_force(int index, int joint) const {
    const int b = carrier(joint);
    return b < 0 ? Vector::zero() : lane(index).contact[static_cast<std::size_t>(b)];
  }
  /// Mean force of a grip on a joint's body over the last call of `step`, N, world.
  core::Vector3<double> grip_force(int index, int joint) const {
    const int b = carrier(joint);
    return b < 0 ? Vector::zero() : lane(index).grip_force[static_cast<std::size_t>(b)];
  }

  /// Advances all lanes by `count` time steps.
  void step(int count) {
    for (Lane& l : lanes_) advance(l, count);
  }

  template <class Q>
  void pose(int index, Eigen::MatrixBase<Q>& out) const {
    out = lane(index).q;
  }
  template <class V>
  void velocity(int index, Eigen::MatrixBase<V>& out) const {
    out = lane(index).v;
  }
  /// Whether a lane met a number that is not finite since it was reset. Such a lane was put at rest into the neutral pose.
  bool failed(int index) const { return lane(index).failed; }

 private:
  using Vector = core::Vector3<double>;
  using Quaternion = core::Quaternion<double>;

  // Members are destroyed from the last to the first: the world goes before what it points to.
  struct Lane {
    Eigen::VectorXd q, v, target;
    std::vector<Vector> push_force, push_point;    ///< per moving body; points in its frame
    std::vector<Vector> contact, grip_force;       ///< means over a call of step, N
    std::vector<Vector> touch_force, touch_moment;  ///< contact of the last time step, N and N m about the joint, world
    std::vector<Vector> rate;                      ///< joint accelerations of the last time step, joint axes
    bool failed = false;
    std::unique_ptr<btDefaultCollisionConfiguration> configuration;
    std::unique_ptr<btCollisionDispatcher> dispatcher;
    std::unique_ptr<btDbvtBroadphase> broadphase;
    std::unique_ptr<btMultiBodyConstraintSolver> solver;
    std::unique_ptr<btMultiBody> body;
    std::vector<std::unique_ptr<btMultiBodyLinkCollider>> colliders;
    std::vector<std::unique_ptr<btCollisionObject>> grounds;
    std::vector<std::unique_ptr<btMultiBodyPoint2Point>> held;
    std::unique_ptr<btMultiBodyDynamicsWorld> world;
  };

  static constexpr int scene_group = 1, character_group = 2;

  Lane& lane(int i) { return lanes_[static_cast<std::size_t>(i)]; }
  const Lane& lane(int i) const { return lanes_[static_cast<std::size_t>(i)]; }
  /// Bullet's number of a moving body: -1 is the base, which is the root or, if that does not move, the world.
  int link(int b) const { return free_ ? b - 1 : b; }
  int carrier(int joint) const { return model_.moving_of_joint[static_cast<std::size_t>(joint)]; }
  Vector on_carrier(int joint, const Vector& point) const {
    return model_.on_moving_body(joint, point);
  }

  static btVector3 to_bullet(const Vector& v) {
    return {static_cast<btScalar>(v.x), static_cast<btScalar>(v.y), static_cast<btScalar>(v.z)};
  }
  static btQuaternion to_bullet(const Quaternion& q) {
    return {static_cast<btScalar>(q.x), static_cast<btScalar>(q.y), static_cast<btScalar>(q.z), static_cast<btScalar>(q.w)};
  }
  static Vector from_bullet(const btVector3& v) {
    return {static_cast<double>(v.x()), static_cast<double>(v.y()), static_cast<double>(v.z())};
  }
  static Quaternion from_bullet(const btQuaternion& q) {
    return {static_cast<double>(q.x()), static_cast<double>(q.y()), static_cast<double>(q.z()), static_cast<double>(q.w())};
  }
  static btTransform placed(const Vector& position, const Quaternion& rotation) {
    return btTransform(to_bullet(rotation), to_bullet(position));
  }

  /// A compound of shapes, or the shape itself where there is one and it sits in the middle; the parts are kept apart.
  btCollisionShape* add(std::unique_ptr<btCollisionShape> shape) {
    parts_.push_back(std::move(shape));
    return parts_.back().get();
  }

  void make_scene(const sim::Scene& scene) {
    std::vector<terrain::Box> boxes = scene.boxes.boxes();
    const sim::Ground<double>& g = scene.ground;
    if (g.grid()) {
      // No further than single precision can tell millimetres apart.
      const std::vector<terrain::Box> columns = detail::columns(*g.grid(), 100, 10);
      boxes.insert(boxes.end(), columns.begin(), columns.end());
    } else {
      grounds_.push_back(add(std::make_unique<btStaticPlaneShape>(to_bullet(g.normal()), static_cast<btScalar>(g.offset()))));
    }
    if (boxes.empty()) return;
    auto all = std::make_unique<btCompoundShape>(true, static_cast<int>(boxes.size()));
    for (const terrain::Box& b : boxes)
      all->addChildShape(placed(b.center, b.rotation), add(std::make_unique<btBoxShape>(to_bullet(b.half_size))));
    grounds_.push_back(add(std::move(all)));
  }

  btCollisionShape* make_shape(int moving) {
    const auto m = static_cast<std::size_t>(moving);
    const Quaternion to_principal = inertias_[m].axes.conjugate();
    auto all = std::make_unique<btCompoundShape>(true);
    for (const body::Shape& s : model_.character.shapes) {
      if (carrier(s.body) != moving) continue;
      const Quaternion turn = to_principal * model_.welded_rotation[static_cast<std::size_t>(s.body)] * s.rotation;
      const Vector at = to_principal.rotate(on_carrier(s.body, s.position) - centers_[m]);
      btCollisionShape* part = nullptr;
      if (s.kind == body::Shape::Kind::sphere) part = add(std::make_unique<btSphereShape>(static_cast<btScalar>(s.size.x)));
      if (s.kind == body::Shape::Kind::capsule)
        part = add(std::make_unique<btCapsuleShapeZ>(static_cast<btScalar>(s.size.x), static_cast<btScalar>(2 * s.size.y)));
      if (s.kind == body::Shape::Kind::box) part = add(std::make_unique<btBoxShape>(to_bullet(s.size)));
      all->addChildShape(placed(at, turn), part);
    }
    if (all->getNumChildShapes() == 0) return add(std::make_unique<btEmptyShape>());
    return add(std::move(all));
  }

  /// Everything anew from the lane's q and v: Bullet's collision detection would remember.
  void start(Lane& l) {
    for (auto& grip : l.held) {
      if (grip) l.world->removeMultiBodyConstraint(grip.get());
      grip.reset();
    }
    l.world.reset();
    l.colliders.clear();
    l.grounds.clear();
    l.body.reset();
    l.solver.reset();
    l.broadphase.reset();
    l.dispatcher.reset();
    for (auto* list : {&l.push_force, &l.push_point, &l.contact, &l.grip_force, &l.touch_force, &l.touch_moment, &l.rate})
      std::fill(list->begin(), list->end(), Vector::zero());

    if (!l.configuration) {
      btDefaultCollisionConstructionInfo sizes;
      sizes.m_defaultMaxPersistentManifoldPoolSize = 256;
      sizes.m_defaultMaxCollisionAlgorithmPoolSize = 256;
      l.configuration = std::make_unique<btDefaultCollisionConfiguration>(sizes);
      l.configuration->setPlaneConvexMultipointIterations();
    }
    l.dispatcher = std::make_unique<btCollisionDispatcher>(l.configuration.get());
    l.broadphase = std::make_unique<btDbvtBroadphase>();
    l.solver = std::make_unique<btMultiBodyConstraintSolver>();
    l.world = std::make_unique<btMultiBodyDynamicsWorld>(l.dispatcher.get(), l.broadphase.get(), l.solver.get(), l.configuration.get());
    l.world->getDispatchInfo().m_deterministicOverlappingPairs = true;
    l.world->setGravity(to_bullet(Vector{0, 0, -parameters_.gravity}));
    btContactSolverInfo& solver = l.world->getSolverInfo();
    solver.m_numIterations = 50;
    solver.m_erp2 = btScalar(0.1);
    solver.m_solverMode |= SOLVER_USE_2_FRICTION_DIRECTIONS;

    for (btCollisionShape* shape : grounds_) {
      l.grounds.push_back(std::make_unique<btCollisionObject>());
      l.grounds.back()->setCollisionShape(shape);
      l.grounds.back()->setFriction(static_cast<btScalar>(parameters_.friction));
      l.world->addCollisionObject(l.grounds.back().get(), scene_group, character_group);
    }
    make_body(l);
    write(l);
    l.world->addMultiBody(l.body.get());
    add_colliders(l);
  }

  void make_body(Lane& l) const {
    const auto n = static_cast<int>(model_.bodies.size());
    const Vector base = free_ ? inertias_[0].moments : Vector{0, 0, 0};
    const double mass = free_ ? model_.bodies[0].mass : 0;
    l.body = std::make_unique<btMultiBody>(free_ ? n - 1 : n, static_cast<btScalar>(mass), to_bullet(base), !free_, false);
    for (int b = free_ ? 1 : 0; b < n; ++b) {
      const auto k = static_cast<std::size_t>(b);
      const sim::MovingBody& m = model_.bodies[k];
      const bool on_body = m.parent >= 0;
      const auto p = static_cast<std::size_t>(std::max(m.parent, 0));
      const Quaternion parent_axes = on_body ? inertias_[p].axes : Quaternion::identity();
      const Vector parent_center = on_body ? centers_[p] : Vector::zero();
      const Quaternion own = inertias_[k].axes.conjugate();
      const btQuaternion turn = to_bullet(own * m.rest.conjugate() * parent_axes);
      const btVector3 pivot = to_bullet(parent_axes.conjugate().rotate(m.offset - parent_center));
      const btVector3 center = to_bullet(own.rotate(centers_[k]));
      const btVector3 moments = to_bullet(inertias_[k].moments);
      const int parent = on_body ? link(m.parent) : -1;
      if (m.type == body::JointType::hinge)
        l.body->setupRevolute(link(b), static_cast<btScalar>(m.mass), moments, parent, turn, to_bullet(own.rotate(m.axis)), pivot, center, true);
      else
        l.body->setupSpherical(link(b), static_cast<btScalar>(m.mass), moments, parent, turn, pivot, center, true);
    }
    l.body->finalizeMultiDof();
    l.body->setHasSelfCollision(false);
    l.body->setLinearDamping(0);
    l.body->setAngularDamping(0);
    l.body->setUseGyroTerm(true);
    l.body->setMaxCoordinateVelocity(btScalar(1e4));
  }

  void add_colliders(Lane& l) const {
    for (std::size_t b = 0; b < model_.bodies.size(); ++b) {
      const int index = link(static_cast<int>(b));
      l.colliders.push_back(std::make_unique<btMultiBodyLinkCollider>(l.body.get(), index));
      btMultiBodyLinkCollider* c = l.colliders.back().get();
      c->setCollisionShape(shapes_[b]);
      c->setFriction(1);
      // Friction that remembers where it took hold, so that standing feet do not wander.
      c->setCollisionFlags(c->getCollisionFlags() | btCollisionObject::CF_HAS_FRICTION_ANCHOR);
      c->setUserIndex(static_cast<int>(b));
      if (index < 0)
        l.body->setBaseCollider(c);
      else
        l.body->getLink(index).m_collider = c;
    }
    btAlignedObjectArray<btQuaternion> rotations;
    btAlignedObjectArray<btVector3> origins;
    l.body->forwardKinematics(rotations, origins);
    l.body->updateCollisionObjectWorldTransforms(rotations, origins);
    for (auto& c : l.colliders) l.world->addCollisionObject(c.get(), character_group, scene_group);
  }

  void write(Lane& l) const {
    for (std::size_t i = 0; i < model_.bodies.size(); ++i) {
      const sim::MovingBody& b = model_.bodies[i];
      const double* q = l.q.data() + b.q_index;
      const double* v = l.v.data() + b.v_index;
      const Quaternion own = inertias_[i].axes;
      const int index = link(static_cast<int>(i));
      if (b.type == body::JointType::free) {
        const Quaternion r = b.rest * Quaternion::from(q + 3);
        const Vector arm = r.rotate(centers_[i]);
        const Vector w = Vector::from(v + 3);
        l.body->setBasePos(to_bullet(Vector::from(q) + arm));
        l.body->setWorldToBaseRot(to_bullet((r * own).conjugate()));
        l.body->setBaseVel(to_bullet(Vector::from(v) + cross(w, arm)));
        l.body->setBaseOmega(to_bullet(w));
      } else if (b.type == body::JointType::ball) {
        const Quaternion r = own.conjugate() * Quaternion::from(q) * own;
        const Vector w = own.conjugate().rotate(Vector::from(v));
        const double position[4] = {r.x, r.y, r.z, r.w}, velocity[3] = {w.x, w.y, w.z};
        l.body->setJointPosMultiDof(index, position);
        l.body->setJointVelMultiDof(index, velocity);
      } else {
        l.body->setJointPosMultiDof(index, q);
        l.body->setJointVelMultiDof(index, v);
      }
    }
  }

  void read(Lane& l) const {
    for (std::size_t i = 0; i < model_.bodies.size(); ++i) {
      const sim::MovingBody& b = model_.bodies[i];
      double* q = l.q.data() + b.q_index;
      double* v = l.v.data() + b.v_index;
      const Quaternion own = inertias_[i].axes;
      const int index = link(static_cast<int>(i));
      if (b.type == body::JointType::free) {
        const Quaternion r = from_bullet(l.body->getWorldToBaseRot()).conjugate() * own.conjugate();
        const Vector arm = r.rotate(centers_[i]);
        const Vector w = from_bullet(l.body->getBaseOmega());
        (from_bullet(l.body->getBasePos()) - arm).store(q);
        (b.rest.conjugate() * r).normalized().store(q + 3);
        (from_bullet(l.body->getBaseVel()) - cross(w, arm)).store(v);
        w.store(v + 3);
        continue;
      }
      const btScalar* x = l.body->getJointPosMultiDof(index);
      const btScalar* u = l.body->getJointVelMultiDof(index);
      if (b.type == body::JointType::hinge) {
        q[0] = static_cast<double>(x[0]);
        v[0] = static_cast<double>(u[0]);
      } else {
        (own * Quaternion::from(x) * own.conjugate()).normalized().store(q);
        own.rotate(Vector::from(u)).store(v);
      }
    }
  }

  /// Torques for the next time step, handed to Bullet together with pushes. False if one is not finite.
  bool actuate(Lane& l) {
    const double dt = parameters_.dt;
    sim::update_kinematics(model_, numbers_, l.q.data(), l.v.data(), work_);
    sim::load_inertias(model_, numbers_, parameters_.gravity, work_);
    for (std::size_t i = 0; i < model_.bodies.size(); ++i) {
      const sim::MovingBody& b = model_.bodies[i];
      sim::BodyWork<double>& k = work_.bodies[i];
      const Vector arm = k.rotation * l.push_point[i];
      k.f -= l.push_force[i] + l.touch_force[i];
      k.n -= cross(arm, l.push_force[i]) + l.touch_moment[i];
      const detail::Drive d = detail::drive(b, parameters_, dt, l.q.data(), l.v.data(), l.target.data(), l.rate[i]);
      Vector w = Vector::zero();
      if (b.type == body::JointType::ball) w = Vector::from(l.v.data() + b.v_index);
      if (b.type == body::JointType::hinge) w.x = l.v[b.v_index];
      k.motor = d.motor - d.motor_damping * w;
      k.stop = d.stop - d.stop_damping * w;
      k.motor_inertia = dt * d.motor_damping;
      k.stop_inertia = dt * d.stop_damping;
    }
    sim::articulated_body(model_, work_);
    bool finite = true;
    for (std::size_t i = 0; i < model_.bodies.size(); ++i) {
      const sim::MovingBody& b = model_.bodies[i];
      const sim::BodyWork<double>& k = work_.bodies[i];
      const int index = link(static_cast<int>(i));
      if (b.type != body::JointType::free) {
        Vector motor = k.motor - k.motor_inertia * k.joint_rate;
        const double size = norm(motor);
        if (size > b.actuator.torque_limit) motor *= b.actuator.torque_limit / size;
        const Vector torque = motor + k.stop - (k.stop_inertia + b.actuator.armature) * k.joint_rate;
        finite = finite && std::isfinite(torque.x + torque.y + torque.z);
        if (b.type == body::JointType::hinge) {
          l.body->addJointTorqueMultiDof(index, 0, static_cast<btScalar>(torque.x));
        } else {
          const Vector local = inertias_[i].axes.conjugate().rotate(torque);
          l.body->addJointTorqueMultiDof(index, 0, static_cast<btScalar>(local.x));
          l.body->addJointTorqueMultiDof(index, 1, static_cast<btScalar>(local.y));
          l.body->addJointTorqueMultiDof(index, 2, static_cast<btScalar>(local.z));
        }
      }
      const Vector& f = l.push_force[i];
      if (f.x == 0 && f.y == 0 && f.z == 0) continue;
      const Vector moment = cross(k.rotation * (l.push_point[i] - centers_[i]), f);
      if (index < 0) {
        l.body->addBaseForce(to_bullet(f));
        l.body->addBaseTorque(to_bullet(moment));
      } else {
        l.body->addLinkForce(index, to_bullet(f));
        l.body->addLinkTorque(index, to_bullet(moment));
      }
    }
    return finite;
  }

  /// Contact and grip forces of the time step just made, from the impulses Bullet keeps with each point.
  void collect(Lane& l) const {
    const double per_dt = 1 / parameters_.dt;
    for (auto* list : {&l.touch_force, &l.touch_moment}) std::fill(list->begin(), list->end(), Vector::zero());
    for (int m = 0; m < l.dispatcher->getNumManifolds(); ++m) {
      const btPersistentManifold* manifold = l.dispatcher->getManifoldByIndexInternal(m);
      const btMultiBodyLinkCollider* first = btMultiBodyLinkCollider::upcast(manifold->getBody0());
      const btMultiBodyLinkCollider* second = btMultiBodyLinkCollider::upcast(manifold->getBody1());
      const btMultiBodyLinkCollider* own = first ? first : second;
      if (!own) continue;
      const auto b = static_cast<std::size_t>(own->getUserIndex());
      // The normal is that of the second body's surface.
      const double sign = first ? per_dt : -per_dt;
      for (int c = 0; c < manifold->getNumContacts(); ++c) {
        const btManifoldPoint& point = manifold->getContactPoint(c);
        const Vector force = sign * (static_cast<double>(point.m_appliedImpulse) * from_bullet(point.m_normalWorldOnB) +
                                     static_cast<double>(point.m_appliedImpulseLateral1) * from_bullet(point.m_lateralFrictionDir1) +
                                     static_cast<double>(point.m_appliedImpulseLateral2) * from_bullet(point.m_lateralFrictionDir2));
        const Vector place = from_bullet(first ? point.m_positionWorldOnA : point.m_positionWorldOnB);
        l.touch_force[b] += force;
        l.touch_moment[b] += cross(place - work_.bodies[b].position, force);
      }
    }
    for (std::size_t b = 0; b < l.held.size(); ++b) {
      l.contact[b] += l.touch_force[b];
      if (!l.held[b]) continue;
      btMultiBodyPoint2Point& grip = *l.held[b];
      const Vector force = -per_dt * Vector{static_cast<double>(grip.getAppliedImpulse(0)), static_cast<double>(grip.getAppliedImpulse(1)),
                                            static_cast<double>(grip.getAppliedImpulse(2))};
      l.grip_force[b] += force;
      // To the prediction of motors a grip is one more contact.
      const Vector place = from_bullet(grip.getPivotInB());
      l.touch_force[b] += force;
      l.touch_moment[b] += cross(place - work_.bodies[b].position, force);
    }
  }

  void advance(Lane& l, int count) {
    for (auto* sums : {&l.contact, &l.grip_force}) std::fill(sums->begin(), sums->end(), Vector::zero());
    for (int s = 0; s < count; ++s) {
      const bool sound = l.q.allFinite() && l.v.allFinite() && actuate(l);
      if (sound) {
        for (std::size_t i = 0; i < model_.bodies.size(); ++i) l.rate[i] = work_.bodies[i].joint_rate;
        l.world->stepSimulation(static_cast<btScalar>(parameters_.dt), 0);
        read(l);
      }
      if (!sound || !l.q.allFinite() || !l.v.allFinite()) {
        l.q = l.target = neutral_;
        l.v.setZero();
        start(l);
        l.failed = true;
        return;
      }
      collect(l);
    }
    const double share = count > 0 ? 1.0 / count : 0;
    for (std::size_t i = 0; i < model_.bodies.size(); ++i) {
      l.contact[i] *= share;
      l.grip_force[i] *= share;
      l.push_force[i] = Vector::zero();
    }
  }

  sim::Parameters parameters_;
  sim::Model model_;
  bool free_;
  Eigen::VectorXd neutral_;
  sim::Numbers<double> numbers_;
  sim::DynamicsWork<double> work_;
  std::vector<detail::PrincipalInertia> inertias_;
  std::vector<Vector> centers_;  ///< centres of mass in the bodies' frames, m
  std::vector<std::unique_ptr<btCollisionShape>> parts_;
  std::vector<btCollisionShape*> grounds_, shapes_;
  std::vector<Lane> lanes_;
};

}  // namespace traceur::backends
