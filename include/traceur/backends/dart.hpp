// SPDX-License-Identifier: MIT
#pragma once

#include <dart/collision/CollisionObject.hpp>
#include <dart/collision/CollisionResult.hpp>
#include <dart/collision/dart/DARTCollide.hpp>
#include <dart/collision/dart/DARTCollisionDetector.hpp>
#include <dart/constraint/BallJointConstraint.hpp>
#include <dart/constraint/ConstraintSolver.hpp>
#include <dart/dynamics/BallJoint.hpp>
#include <dart/dynamics/BodyNode.hpp>
#include <dart/dynamics/FreeJoint.hpp>
#include <dart/dynamics/RevoluteJoint.hpp>
#include <dart/dynamics/ShapeNode.hpp>
#include <dart/dynamics/Skeleton.hpp>
#include <dart/dynamics/SphereShape.hpp>
#include <dart/dynamics/WeldJoint.hpp>
#include <dart/simulation/World.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "traceur/backends/detail/joint_terms.hpp"
#include "traceur/backends/detail/near_columns.hpp"
#include "traceur/body/momentum.hpp"
#include "traceur/sim/parameters.hpp"
#include "traceur/sim/scene.hpp"
#include "traceur/sim/simulator.hpp"

namespace traceur::backends {

#ifndef TRACEUR_DART_HAS_AVX
static_assert(EIGEN_MAX_ALIGN_BYTES <= 16,
              "DART as Debian builds it knows no AVX: compile what includes this header without -march=native, or define "
              "TRACEUR_DART_HAS_AVX if your DART was built with it");
#endif

/// DART (6.12) as a model of `sim::Simulator`.
///
/// A lane is one dart::simulation::World that holds a skeleton of free, ball and revolute joints, welds merged; articulated
/// bodies give its accelerations and a boxed complementarity problem its contact and grip impulses. Motors and stops are
/// forces and DART's implicit dampers, which here resist impulses as well, such that each is a spring-damper taken at the end
/// of the step, contacts included (stable PD, Tan et al. 2011, inside the recursion). A step in which a motor goes beyond
/// the limit of its torque's norm is taken again with that torque, shrunk to the limit, held constant.
///
/// DART integrates a free root in its own turning axes, which costs a tumbling body a few per cent of its momentum each
/// second. Here velocities of the root are summed in world axes and poses in our own coordinates, and a character that
/// neither touches nor holds anything keeps its momenta (Parameters::conserve_momentum). DART is handed pose and velocity
/// at every step, so they are a lane's whole state.
///
/// Of Parameters it reads dt, gravity, friction, stop_stiffness, stop_damping and conserve_momentum: contacts and grips are
/// rigid. Friction is a pyramid with an edge down the slope. Bodies touch the world, not each other. Boxes meet boxes and
/// columns by DART's own routine; a sphere, and of a capsule its ends and the point nearest to the box, meet them as
/// spheres; spheres, ends of capsules and corners of boxes meet the plane.
///
/// DART shares Eigen types with its callers, whose alignment depends on compiler flags: compile code that includes this
/// header with those of the library (Debian's has no AVX, so not with -march=native). Lanes are advanced one after another,
/// by one thread at a time.
class Dart {
 public:
  using Vector = core::Vector3<double>;

  /// Throws Error, one line, when the character, the parameters or the number of lanes is refused.
  Dart(const body::Character& character, int lanes, const sim::Parameters& parameters = {}, const sim::Scene& scene = {})
      : setup_(std::make_unique<Setup>()) {
    setup_->model = sim::make_model(character);
    setup_->parameters = parameters;
    setup_->scene = scene;
    parameters.check();
    detail::check_engine("dart", setup_->model, lanes);
    const auto n = setup_->model.bodies.size();
    drives_.resize(n);
    frames_ = body::Frames<double>(model().character.skeleton);
    twists_ = body::Twists<double>(model().character.skeleton);
    lanes_.reserve(static_cast<std::size_t>(lanes));
    for (int i = 0; i < lanes; ++i) lanes_.push_back(make_lane());
  }

  int lanes() const { return static_cast<int>(lanes_.size()); }
  const body::Character& character() const { return model().character; }
  const sim::Parameters& parameters() const { return setup_->parameters; }
  double dt() const { return setup_->parameters.dt; }

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
    write(l);
  }

  /// Target pose of the joint motors (nq numbers, the root's are ignored).
  template <class Q>
  void set_target(int lane, const Eigen::MatrixBase<Q>& q) {
    at(lane).target = q;
  }

  /// Force (N, world) on the body of joint `joint` at a point of that joint's frame (m), during the next call of `step`.
  void push(int lane, int joint, const Vector& force, const Vector& point = {0, 0, 0}) {
    const int b = moving(joint);
    if (b >= 0) at(lane).pushes[static_cast<std::size_t>(b)] = {force, on_body(joint, point)};
  }

  /// Ties a point of the joint's frame (m) to a place in the world (m) by a ball joint that does not give, in place of an
  /// earlier grip of that joint. A fifth of a gap closes in every time step.
  void hold(int lane, int joint, const Vector& point, const Vector& anchor) {
    Lane& l = at(lane);
    const auto j = static_cast<std::size_t>(joint);
    drop(l, j);
    const int b = moving(joint);
    if (b < 0 || !std::isfinite(squared_norm(point) + squared_norm(anchor))) return;
    l.grips[j].tie = std::make_shared<Tie>(l.bodies[static_cast<std::size_t>(b)], on_body(joint, point).eigen(), anchor.eigen(), dt());
    l.world->getConstraintSolver()->addConstraint(l.grips[j].tie);
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
    if (b < 0 || model().bodies[static_cast<std::size_t>(b)].joint != joint) return Vector::zero();
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
  using Object = std::shared_ptr<::dart::collision::CollisionObject>;

  struct Setup {
    sim::Model model;
    sim::Parameters parameters;
    sim::Scene scene;
  };

  static Vector vector(const Eigen::Vector3d& v) { return Vector::from(v); }

  /// A joint of DART's whose implicit dampers resist impulses too. DART's own let contact impulses pass by them, and a
  /// character with strong motors then stands as if it had none.
  template <class Joint>
  class Damped final : public Joint {
   public:
    explicit Damped(const typename Joint::Properties& properties) : Joint(properties) {}

   protected:
    void updateInvProjArtInertia(const Eigen::Matrix<double, 6, 6>& inertia) override {
      Joint::updateInvProjArtInertiaImplicit(inertia, this->getSkeleton()->getTimeStep());
      this->mInvProjArtInertia = this->mInvProjArtInertiaImplicit;
    }
  };

  /// A shape of the character on its moving body.
  struct Part {
    std::size_t body = 0;
    const ::dart::dynamics::BodyNode* node = nullptr;
    body::Shape::Kind kind = body::Shape::Kind::sphere;
    Vector center{0, 0, 0};  ///< in the moving body's frame, m
    Quaternion turn = Quaternion::identity();
    Vector size{0, 0, 0};
    double reach = 0;  ///< no point of it is further from its centre, m
    Object object;
  };

  /// Contacts of one lane's character with the scene, in the place of DART's own search over all pairs of shapes: the ground
  /// is unbounded and a terrain has more columns than a character has neighbours.
  class Detector final : public ::dart::collision::DARTCollisionDetector {
   public:
    explicit Detector(const Setup& setup) : setup_(&setup) { near_.reserve(4 * setup.scene.boxes.boxes().size()); }

    using DARTCollisionDetector::collide;
    bool collide(::dart::collision::CollisionGroup*, const ::dart::collision::CollisionOption&,
                 ::dart::collision::CollisionResult* result) override {
      if (!result) return false;
      for (const Part& part : parts_) find(part, *result);
      return result->getNumContacts() > 0;
    }

    void add(Part part, const ::dart::dynamics::ShapeFrame* frame) {
      part.object = claimCollisionObject(frame);
      parts_.push_back(std::move(part));
    }
    void set_world(const ::dart::dynamics::ShapeFrame* frame) { world_ = claimCollisionObject(frame); }
    std::size_t body_of(const ::dart::collision::CollisionObject* object) const {
      for (const Part& part : parts_)
        if (part.object.get() == object) return part.body;
      return parts_.size();
    }

   private:
    void find(const Part& part, ::dart::collision::CollisionResult& result) {
      const Eigen::Isometry3d& frame = part.node->getWorldTransform();
      const Quaternion body = Quaternion::from(Eigen::Quaterniond(frame.linear()));
      const Vector center = vector(frame.translation()) + body.rotate(part.center);
      const Quaternion turn = body * part.turn;
      const sim::Ground<double>& ground = setup_->scene.ground;
      if (const terrain::HeightGrid* grid = ground.grid()) {
        const Vector r{part.reach, part.reach, part.reach};
        if (center.z - part.reach <= grid->highest())
          detail::near_columns(*grid, center - r, center + r, 1.0, [&](const Vector& middle, const Vector& half) {
            meet_box(part, center, turn, {middle, half, Quaternion::identity()}, grid, result);
          });
      } else {
        meet_plane(part, center, turn, ground.normal(), ground.offset(), result);
      }
      near_.clear();
      setup_->scene.boxes.near(center, part.reach, near_);
      for (int i : near_) meet_box(part, center, turn, setup_->scene.boxes.boxes()[static_cast<std::size_t>(i)], nullptr, result);
    }

    void add_contact(const Part& part, const Vector& point, const Vector& normal, double depth,
                     ::dart::collision::CollisionResult& result) const {
      ::dart::collision::Contact c;
      c.collisionObject1 = part.object.get();
      c.collisionObject2 = world_.get();
      c.point = point.eigen();
      c.normal = normal.eigen();
      c.penetrationDepth = depth;
      result.addContact(c);
    }

    void meet_plane(const Part& part, const Vector& center, const Quaternion& turn, const Vector& normal, double offset,
                    ::dart::collision::CollisionResult& result) const {
      if (dot(normal, center) - offset > part.reach) return;
      const auto sphere = [&](const Vector& at, double radius) {
        const double distance = dot(normal, at) - offset - radius;
        if (distance < 0) add_contact(part, at - (radius + 0.5 * distance) * normal, normal, -distance, result);
      };
      if (part.kind == body::Shape::Kind::sphere) sphere(center, part.size.x);
      if (part.kind == body::Shape::Kind::capsule)
        for (double end : {-1.0, 1.0}) sphere(center + turn.rotate(Vector{0, 0, end * part.size.y}), part.size.x);
      if (part.kind == body::Shape::Kind::box)
        for (int k = 0; k < 8; ++k)
          sphere(center + turn.rotate(Vector{(k & 1 ? 1 : -1) * part.size.x, (k & 2 ? 1 : -1) * part.size.y,
                                             (k & 4 ? 1 : -1) * part.size.z}), 0);
    }

    void meet_box(const Part& part, const Vector& center, const Quaternion& turn, const terrain::Box& box,
                  const terrain::HeightGrid* grid, ::dart::collision::CollisionResult& result) {
      const auto sample = [&](const Vector& at) {
        return terrain::box_distance(box.rotation.conjugate().rotate(at - box.center), box.half_size);
      };
      const auto keep = [&](const Vector& point, const Vector& normal, double depth) {
        if (grid && detail::on_seam(*grid, point, normal)) return;
        add_contact(part, point, normal, depth, result);
      };
      const auto sphere = [&](const Vector& at) {
        const auto s = sample(at);
        const double distance = s.distance - part.size.x;
        const Vector normal = box.rotation.rotate(s.normal);
        if (distance < 0) keep(at - (part.size.x + 0.5 * distance) * normal, normal, -distance);
      };
      if (part.kind == body::Shape::Kind::sphere) sphere(center);
      if (part.kind == body::Shape::Kind::capsule) {
        const Vector axis = turn.rotate(Vector{0, 0, 1});
        sphere(center - part.size.y * axis);
        sphere(center + part.size.y * axis);
        // Along a segment the distance from a convex body is convex: thirds close in on the nearest point.
        double low = -part.size.y, high = part.size.y;
        for (int i = 0; i < 24; ++i) {
          const double a = low + (high - low) / 3, b = high - (high - low) / 3;
          if (sample(center + a * axis).distance < sample(center + b * axis).distance) {
            high = b;
          } else {
            low = a;
          }
        }
        const double nearest = 0.5 * (low + high);
        if (std::abs(nearest) < 0.9 * part.size.y) sphere(center + nearest * axis);
      }
      if (part.kind == body::Shape::Kind::box) {
        const auto frame = [](const Vector& at, const Quaternion& rotation) {
          Eigen::Isometry3d t = Eigen::Isometry3d::Identity();
          t.linear() = rotation.eigen().toRotationMatrix();
          t.translation() = at.eigen();
          return t;
        };
        found_.clear();
        ::dart::collision::collideBoxBox(part.object.get(), world_.get(), 2 * part.size.eigen(), frame(center, turn),
                                         2 * box.half_size.eigen(), frame(box.center, box.rotation), found_);
        for (const ::dart::collision::Contact& c : found_.getContacts()) keep(vector(c.point), vector(c.normal), c.penetrationDepth);
      }
    }

    const Setup* setup_;
    std::vector<Part> parts_;
    Object world_;
    std::vector<int> near_;
    ::dart::collision::CollisionResult found_;
  };

  /// A ball joint between a body and a place in the world that takes back a share of its gap in every step and remembers its
  /// impulse.
  class Tie final : public ::dart::constraint::BallJointConstraint {
   public:
    /// `point` in the body's frame, `anchor` in the world, m.
    Tie(::dart::dynamics::BodyNode* body, const Eigen::Vector3d& point, const Eigen::Vector3d& anchor, double dt)
        : BallJointConstraint(body, body->getWorldTransform() * point), body_(body), point_(point), anchor_(anchor), dt_(dt) {}

    Vector force() const { return vector((body_->getWorldTransform().linear() * impulse_) / dt_); }
    void clear() { impulse_.setZero(); }

   private:
    void getInformation(::dart::constraint::ConstraintInfo* info) override {
      BallJointConstraint::getInformation(info);
      // The base pulls towards where the point was when the tie was made, and does so slowly.
      const Eigen::Isometry3d& t = body_->getWorldTransform();
      const Eigen::Vector3d speed = body_->getSpatialVelocity().tail<3>() + body_->getSpatialVelocity().head<3>().cross(point_);
      const Eigen::Vector3d gap = point_ - t.inverse() * anchor_;
      for (int k = 0; k < 3; ++k) info->b[k] = -speed[k] - share / dt_ * gap[k];
    }
    void applyImpulse(double* lambda) override {
      impulse_ = Eigen::Map<const Eigen::Vector3d>(lambda);
      BallJointConstraint::applyImpulse(lambda);
    }

    static constexpr double share = 0.2;
    ::dart::dynamics::BodyNode* body_;
    Eigen::Vector3d point_, anchor_, impulse_ = Eigen::Vector3d::Zero();
    double dt_;
  };

  struct Push {
    Vector force{0, 0, 0}, point{0, 0, 0};
  };
  struct Grip {
    std::shared_ptr<Tie> tie;
    Vector force{0, 0, 0};
  };
  struct Motion {
    Vector linear{0, 0, 0}, angular{0, 0, 0}, center{0, 0, 0};
  };
  /// What acts on a joint in a step: force - damping x (velocity at its end), of which the motor's share.
  struct Drive {
    Vector motor{0, 0, 0}, rest{0, 0, 0}, rest_damping{0, 0, 0};
    double motor_damping = 0;
    bool fixed = false;
  };

  struct Lane {
    ::dart::simulation::WorldPtr world;
    ::dart::dynamics::SkeletonPtr skeleton;
    std::shared_ptr<Detector> detector;
    std::vector<::dart::dynamics::BodyNode*> bodies;
    std::vector<std::size_t> first;  ///< first coordinate of each body's joint in DART's vectors
    std::vector<Vector> contact_force, motor_torque;
    std::vector<Push> pushes;
    std::vector<Grip> grips;  ///< of each joint
    Eigen::VectorXd q, v, target;
    Eigen::VectorXd positions, velocities;  ///< in DART's coordinates
    bool failed = false;
  };

  const sim::Model& model() const { return setup_->model; }
  Lane& at(int lane) { return lanes_[static_cast<std::size_t>(lane)]; }
  const Lane& at(int lane) const { return lanes_[static_cast<std::size_t>(lane)]; }
  int moving(int joint) const { return model().moving_of_joint[static_cast<std::size_t>(joint)]; }
  /// A point of a joint's frame in the frame of the moving body that carries it.
  Vector on_body(int joint, const Vector& point) const {
    return model().on_moving_body(joint, point);
  }
  static Eigen::Matrix3d matrix(const Quaternion& q) { return q.normalized().eigen().toRotationMatrix(); }

  Lane make_lane() const {
    namespace dyn = ::dart::dynamics;
    const sim::Parameters& p = setup_->parameters;
    Lane l;
    l.world = ::dart::simulation::World::create();
    l.world->setTimeStep(p.dt);
    l.world->setGravity(Eigen::Vector3d(0, 0, -p.gravity));
    l.detector = std::make_shared<Detector>(*setup_);
    l.world->getConstraintSolver()->setCollisionDetector(l.detector);
    l.skeleton = dyn::Skeleton::create("character");
    const auto n = model().bodies.size();
    for (std::size_t b = 0; b < n; ++b) {
      const sim::MovingBody& m = model().bodies[b];
      dyn::BodyNode* parent = m.parent < 0 ? nullptr : l.bodies[static_cast<std::size_t>(m.parent)];
      dyn::Joint* joint = nullptr;
      dyn::BodyNode* body = nullptr;
      if (m.type == body::JointType::free) std::tie(joint, body) = l.skeleton->createJointAndBodyNodePair<dyn::FreeJoint>(parent);
      if (m.type == body::JointType::ball) std::tie(joint, body) = l.skeleton->createJointAndBodyNodePair<Damped<dyn::BallJoint>>(parent);
      if (m.type == body::JointType::hinge) {
        const auto made = l.skeleton->createJointAndBodyNodePair<Damped<dyn::RevoluteJoint>>(parent);
        made.first->setAxis(m.axis.eigen());
        joint = made.first;
        body = made.second;
      }
      joint->setName("joint" + std::to_string(b));
      body->setName("body" + std::to_string(b));
      if (m.type != body::JointType::free) {
        Eigen::Isometry3d t = Eigen::Isometry3d::Identity();
        t.linear() = matrix(m.rest);
        t.translation() = m.offset.eigen();
        joint->setTransformFromParentBodyNode(t);
      }
      const body::Inertia in = detail::merged_inertia(m);
      const core::Symmetric3<double>& i = in.about_center;
      Eigen::Matrix3d moments;
      moments << i.xx, i.xy, i.xz, i.xy, i.yy, i.yz, i.xz, i.yz, i.zz;
      body->setInertia(dyn::Inertia(in.mass, in.center.eigen(), moments));
      l.bodies.push_back(body);
    }
    const auto touchable = [&](dyn::BodyNode* body) {
      const auto shape = std::make_shared<dyn::SphereShape>(0.01);
      dyn::ShapeNode* node = body->createShapeNodeWith<dyn::CollisionAspect, dyn::DynamicsAspect>(shape);
      node->getDynamicsAspect()->setFrictionCoeff(p.friction);
      node->getDynamicsAspect()->setRestitutionCoeff(0);
      return node;
    };
    for (const body::Shape& s : model().character.shapes) {
      const int b = moving(s.body);
      if (b < 0) continue;
      Part part;
      part.body = static_cast<std::size_t>(b);
      part.node = l.bodies[part.body];
      part.kind = s.kind;
      part.center = on_body(s.body, s.position);
      part.turn = model().welded_rotation[static_cast<std::size_t>(s.body)] * s.rotation;
      part.size = s.size;
      part.reach = s.kind == body::Shape::Kind::box ? norm(s.size) : s.kind == body::Shape::Kind::capsule ? s.size.x + s.size.y : s.size.x;
      l.detector->add(std::move(part), touchable(l.bodies[static_cast<std::size_t>(b)]));
    }
    const dyn::SkeletonPtr scene = dyn::Skeleton::create("scene");
    l.detector->set_world(touchable(scene->createJointAndBodyNodePair<dyn::WeldJoint>(nullptr).second));
    scene->setMobile(false);
    l.world->addSkeleton(scene);
    l.world->addSkeleton(l.skeleton);
    for (const dyn::BodyNode* body : l.bodies) l.first.push_back(body->getParentJoint()->getIndexInSkeleton(0));
    l.contact_force.assign(n, Vector::zero());
    l.motor_torque.assign(n, Vector::zero());
    l.pushes.resize(n);
    l.grips.resize(static_cast<std::size_t>(model().character.skeleton.size()));
    l.q = model().character.skeleton.neutral_pose();
    l.v = Eigen::VectorXd::Zero(model().nv);
    l.target = l.q;
    l.positions = l.velocities = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(l.skeleton->getNumDofs()));
    write(l);
    return l;
  }

  static void drop(Lane& l, std::size_t joint) {
    Grip& g = l.grips[joint];
    if (g.tie) l.world->getConstraintSolver()->removeConstraint(g.tie);
    g.tie.reset();
    g.force = Vector::zero();
  }
  static void forget(Lane& l) {
    for (Vector& f : l.contact_force) f = Vector::zero();
    for (Vector& t : l.motor_torque) t = Vector::zero();
    for (Push& p : l.pushes) p = {};
  }
  void fail(Lane& l) const {
    for (std::size_t j = 0; j < l.grips.size(); ++j) drop(l, j);
    forget(l);
    l.failed = true;
    l.q = model().character.skeleton.neutral_pose();
    l.target = l.q;
    l.v.setZero();
    write(l);
  }

  /// The root's rotation from body to world.
  static Quaternion root_rotation(const sim::MovingBody& m, const Lane& l) {
    return (m.rest * Quaternion::from(l.q.data() + m.q_index + 3)).normalized();
  }

  /// Hands a lane's pose and velocity to DART.
  void write(Lane& l) const {
    for (std::size_t b = 0; b < l.bodies.size(); ++b) {
      const sim::MovingBody& m = model().bodies[b];
      const double* q = l.q.data() + m.q_index;
      const double* v = l.v.data() + m.v_index;
      double* position = l.positions.data() + l.first[b];
      double* velocity = l.velocities.data() + l.first[b];
      if (m.type == body::JointType::free) {
        const Quaternion turn = root_rotation(m, l);
        log_map(turn).store(position);
        Vector::from(q).store(position + 3);
        turn.conjugate().rotate(Vector::from(v + 3)).store(velocity);
        turn.conjugate().rotate(Vector::from(v)).store(velocity + 3);
      } else if (m.type == body::JointType::ball) {
        log_map(Quaternion::from(q).normalized()).store(position);
        Vector::from(v).store(velocity);
      } else {
        position[0] = q[0];
        velocity[0] = v[0];
      }
    }
    l.skeleton->setPositions(l.positions);
    l.skeleton->setVelocities(l.velocities);
  }

  void advance(Lane& l) {
    if (!l.target.tail(l.target.size() - (model().character.skeleton.free_root() ? 7 : 0)).allFinite()) return fail(l);
    write(l);
    l.skeleton->clearExternalForces();
    for (std::size_t b = 0; b < l.bodies.size(); ++b) {
      const Push& p = l.pushes[b];
      if (!std::isfinite(squared_norm(p.force) + squared_norm(p.point))) return fail(l);
      if (squared_norm(p.force) > 0) l.bodies[b]->addExtForce(p.force.eigen(), p.point.eigen(), false, true);
      set_drive(l, b);
    }
    for (int pass = 0;; ++pass) {
      if (!solve(l)) return fail(l);
      if (within_limits(l) || pass == 2) break;
      fix_motors(l, pass == 0 ? 0.9 : 0.0);
      write(l);
    }
    for (const ::dart::collision::Contact& c : l.world->getConstraintSolver()->getLastCollisionResult().getContacts()) {
      const std::size_t b = l.detector->body_of(c.collisionObject1);
      if (b < l.contact_force.size()) l.contact_force[b] += vector(c.force);
    }
    for (Grip& g : l.grips)
      if (g.tie) g.force += g.tie->force();
    const bool flying = setup_->parameters.conserve_momentum && model().bodies[0].type == body::JointType::free &&
                        l.world->getConstraintSolver()->getLastCollisionResult().getNumContacts() == 0 &&
                        std::none_of(l.grips.begin(), l.grips.end(), [](const Grip& g) { return g.tie != nullptr; });
    const Motion goal = flying ? expected_motion(l) : Motion{};
    integrate(l);
    if (flying) steer(l, goal);
    if (!l.q.allFinite() || !l.v.allFinite()) fail(l);
  }

  /// Finds the velocities at the end of the step; false when one is not finite.
  bool solve(Lane& l) const {
    for (std::size_t b = 0; b < l.bodies.size(); ++b) {
      apply(l, b);
      // DART does not notice that a damper changed.
      l.bodies[b]->dirtyArticulatedInertia();
    }
    l.skeleton->computeForwardDynamics();
    l.velocities = dt() * l.skeleton->getAccelerations();
    if (!l.velocities.allFinite()) return false;
    add_old_velocities(l);
    l.skeleton->setVelocities(l.velocities);
    for (Grip& g : l.grips)
      if (g.tie) g.tie->clear();
    l.world->getConstraintSolver()->solve();
    if (l.skeleton->isImpulseApplied()) {
      l.skeleton->computeImpulseForwardDynamics();
      l.skeleton->setImpulseApplied(false);
      l.velocities = l.skeleton->getVelocities();
    }
    return l.velocities.allFinite();
  }

  /// From velocity increments to velocities. DART's accelerate the root in its own turning axes: the turning is taken out.
  void add_old_velocities(Lane& l) const {
    for (std::size_t b = 0; b < l.bodies.size(); ++b) {
      const sim::MovingBody& m = model().bodies[b];
      const double* v = l.v.data() + m.v_index;
      double* velocity = l.velocities.data() + l.first[b];
      if (m.type == body::JointType::free) {
        const Quaternion back = root_rotation(m, l).conjugate();
        const Vector linear = back.rotate(Vector::from(v)), angular = back.rotate(Vector::from(v + 3));
        (Vector::from(velocity) + angular).store(velocity);
        (Vector::from(velocity + 3) + linear + dt() * cross(angular, linear)).store(velocity + 3);
      } else {
        for (int k = 0; k < body::velocity_size(m.type); ++k) velocity[k] += v[k];
      }
    }
  }

  /// Reads new velocities and moves the pose along them.
  void integrate(Lane& l) const {
    const double h = dt();
    for (std::size_t b = 0; b < l.bodies.size(); ++b) {
      const sim::MovingBody& m = model().bodies[b];
      double* q = l.q.data() + m.q_index;
      double* v = l.v.data() + m.v_index;
      const double* velocity = l.velocities.data() + l.first[b];
      if (m.type == body::JointType::free) {
        const Quaternion turn = root_rotation(m, l);
        const Vector linear = turn.rotate(Vector::from(velocity + 3)), angular = turn.rotate(Vector::from(velocity));
        linear.store(v);
        angular.store(v + 3);
        (Vector::from(q) + h * linear).store(q);
        (m.rest.conjugate() * (exp_map(h * angular) * turn)).normalized().store(q + 3);
      } else if (m.type == body::JointType::ball) {
        const Vector w = Vector::from(velocity);
        w.store(v);
        (Quaternion::from(q) * exp_map(h * w)).normalized().store(q);
      } else {
        v[0] = velocity[0];
        q[0] += h * v[0];
      }
    }
  }

  /// Momenta (the angular one about the centre of mass) and centre of mass of a lane as it is.
  body::Momentum<double> measure(const Lane& l) {
    const body::Skeleton& sk = model().character.skeleton;
    body::forward_kinematics(sk, l.q.data(), frames_);
    body::forward_velocities(sk, frames_, l.v.data(), twists_);
    return body::momentum(model().character, frames_, twists_);
  }
  /// Where gravity and pushes alone take momenta and centre of mass in one step.
  Motion expected_motion(const Lane& l) {
    const body::Momentum<double> now = measure(l);
    Vector force{0, 0, -now.mass * setup_->parameters.gravity}, moment{0, 0, 0};
    for (std::size_t b = 0; b < l.pushes.size(); ++b) {
      const Push& p = l.pushes[b];
      if (!(squared_norm(p.force) > 0)) continue;
      force += p.force;
      moment += cross(frames_.point(model().bodies[b].joint, p.point) - now.center_of_mass, p.force);
    }
    Motion m;
    m.linear = now.linear + dt() * force;
    m.angular = now.angular + dt() * moment;
    m.center = now.center_of_mass + (dt() / now.mass) * m.linear;
    return m;
  }
  /// Gives the whole character the small rigid motion that brings it there: an articulated body's generalised velocities,
  /// summed over steps, do not keep momenta by themselves.
  void steer(Lane& l, const Motion& goal) {
    const body::Momentum<double> now = measure(l);
    core::Symmetric3<double> inertia = core::Symmetric3<double>::zero();
    for (int j = 0; j < model().character.skeleton.size(); ++j) {
      const body::Inertia& in = model().character.inertias[static_cast<std::size_t>(j)];
      const Vector arm = frames_.point(j, in.center) - now.center_of_mass;
      inertia += rotated(in.about_center, frames_.rotation[static_cast<std::size_t>(j)].matrix()) +
                 core::Symmetric3<double>::scalar(in.mass * squared_norm(arm)) - core::Symmetric3<double>::outer(in.mass, arm);
    }
    const Vector spin = inertia.inverse() * (goal.angular - now.angular);
    const sim::MovingBody& root = model().bodies[0];
    double* q = l.q.data() + root.q_index;
    double* v = l.v.data() + root.v_index;
    const Vector arm = Vector::from(q) - now.center_of_mass;
    (Vector::from(v) + (1 / now.mass) * (goal.linear - now.linear) + cross(spin, arm)).store(v);
    (Vector::from(v + 3) + spin).store(v + 3);
    (Vector::from(q) + goal.center - now.center_of_mass).store(q);
  }

  static bool powered(const body::Actuator& a) { return a.torque_limit > 0 && a.stiffness + a.damping > 0; }
  Vector rate(const Lane& l, std::size_t b) const {
    const double* v = l.v.data() + model().bodies[b].v_index;
    return model().bodies[b].type == body::JointType::ball ? Vector::from(v) : Vector{v[0], 0, 0};
  }

  void set_drive(Lane& l, std::size_t b) {
    const sim::MovingBody& m = model().bodies[b];
    if (m.type == body::JointType::free) return;
    const body::Actuator& a = m.actuator;
    const sim::Parameters& p = setup_->parameters;
    const bool ball = m.type == body::JointType::ball;
    const double h = p.dt;
    const double* q = l.q.data() + m.q_index;
    const double* goal = l.target.data() + m.q_index;
    Drive& d = drives_[b];
    d = {};
    if (powered(a)) {
      Vector error{goal[0] - q[0], 0, 0};
      if (ball) error = log_map(Quaternion::from(q).conjugate() * Quaternion::from(goal).normalized());
      d.motor = a.stiffness * error;
      d.motor_damping = h * a.stiffness + a.damping;
    }
    // A rotor resists a change of velocity.
    const double rotor = a.armature / h;
    d.rest = rotor * rate(l, b);
    d.rest_damping = {rotor, rotor, rotor};
    if (a.limited || std::isfinite(a.cone)) {
      const Vector excess = detail::stop_excess(a, ball, ball ? log_map(Quaternion::from(q)) : Vector{q[0], 0, 0});
      if (squared_norm(excess) > 0) {
        const double damping = h * p.stop_stiffness + p.stop_damping;
        d.rest -= p.stop_stiffness * excess;
        d.rest_damping += {damping, damping, damping};
      }
    }
  }

  /// Gives DART a joint's drive: it takes its dampers at the end of the step.
  void apply(Lane& l, std::size_t b) const {
    const sim::MovingBody& m = model().bodies[b];
    if (m.type == body::JointType::free) return;
    const Drive& d = drives_[b];
    ::dart::dynamics::Joint* joint = l.bodies[b]->getParentJoint();
    const Vector force = d.motor + d.rest;
    const double motor = d.fixed ? 0.0 : d.motor_damping;
    const std::array<double, 3> f{force.x, force.y, force.z};
    const std::array<double, 3> damping{d.rest_damping.x + motor, d.rest_damping.y + motor, d.rest_damping.z + motor};
    for (std::size_t k = 0; k < static_cast<std::size_t>(body::velocity_size(m.type)); ++k) {
      joint->setForce(k, f[k]);
      joint->setDampingCoefficient(k, damping[k]);
    }
  }

  /// Finds motor torques from the velocities; false when one is beyond its limit.
  bool within_limits(Lane& l) const {
    bool within = true;
    for (std::size_t b = 0; b < l.bodies.size(); ++b) {
      const sim::MovingBody& m = model().bodies[b];
      if (m.type == body::JointType::free || drives_[b].fixed) continue;
      const double* w = l.velocities.data() + l.first[b];
      const Vector after = m.type == body::JointType::ball ? Vector::from(w) : Vector{w[0], 0, 0};
      l.motor_torque[b] = drives_[b].motor - drives_[b].motor_damping * after;
      if (norm(l.motor_torque[b]) > m.actuator.torque_limit * (1 + 1e-6)) within = false;
    }
    return within;
  }

  /// Holds motors above a share of their limit at the torque just found, shrunk to the limit. Torque that one motor loses
  /// may go to others, so the last pass fixes them all.
  void fix_motors(Lane& l, double share) {
    for (std::size_t b = 0; b < l.bodies.size(); ++b) {
      const sim::MovingBody& m = model().bodies[b];
      if (m.type == body::JointType::free || drives_[b].fixed || !std::isfinite(m.actuator.torque_limit)) continue;
      const double size = norm(l.motor_torque[b]), limit = m.actuator.torque_limit;
      if (size <= share * limit) continue;
      if (size > limit) l.motor_torque[b] *= limit / size;
      drives_[b].motor = l.motor_torque[b];
      drives_[b].fixed = true;
    }
  }

  std::unique_ptr<Setup> setup_;  ///< lanes' detectors point into it
  std::vector<Drive> drives_;     ///< of the lane being advanced
  body::Frames<double> frames_;
  body::Twists<double> twists_;
  std::vector<Lane> lanes_;
};

}  // namespace traceur::backends
