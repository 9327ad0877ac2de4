// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>

#include "traceur/sim/contact.hpp"
#include "traceur/sim/dynamics.hpp"
#include "traceur/sim/grip.hpp"
#include "traceur/sim/ground.hpp"
#include "traceur/sim/object.hpp"
#include "traceur/sim/obstacle.hpp"
#include "traceur/sim/self_collision.hpp"

namespace traceur::sim {

/// What the lanes of a simulator have besides the character and the ground. Settles the size of their state.
struct Extras {
  bool obstacles = false;             ///< whether scenes with boxes can be set; objects imply it
  std::vector<ObjectShape> objects;   ///< free bodies in every lane
  std::vector<GripPoint> grips;
  std::vector<std::array<int, 2>> self_collisions;  ///< pairs of joints whose bodies collide with each other
};

/// As many independent characters as the scalar S has lanes, stepped together. `World` is the usual way to hold them.
///
/// State is one flat array per lane: pose, velocity, joint accelerations of the last step (they predict which motors will
/// saturate), contact memories, objects and grips. Copying it out and in restores a lane exactly.
///
/// One step of dt: articulated-body dynamics with joint springs, contacts, grips and stops implicit in velocity, velocities
/// first and positions with the new velocities. Motors are exact: a motor that would pass its torque limit is given the limit
/// as a constant torque and the pass is repeated. Integration errors in whole-body momentum are removed by a rigid correction
/// of all velocities (and, in free flight, of position), so momenta change by external impulses only.
template <class S>
class Lanes {
 public:
  using T = core::Element<S>;
  using Vector3 = core::Vector3<S>;
  static constexpr int width = core::lane_count<S>;

  /// Throws Error on extras that name joints or objects that do not exist.
  Lanes(const Model& model, const Parameters& parameters, const Ground<T>& ground, const Extras& extras = {})
      : model_(&model),
        parameters_(&parameters),
        ground_(&ground),
        numbers_(model),
        work_(model),
        obstacles_(extras.obstacles || !extras.objects.empty()),
        state_(static_cast<std::size_t>(state_size(model, extras)), S(0.0)),
        target_(static_cast<std::size_t>(model.nq), S(0.0)),
        gravity_(static_cast<T>(parameters.gravity)),
        friction_(static_cast<T>(parameters.friction)),
        highest_(ground.highest()),
        push_force_(model.bodies.size(), Vector3::zero()),
        push_arm_(model.bodies.size(), Vector3::zero()),
        body_force_(model.bodies.size(), Vector3::zero()),
        body_slide_(model.bodies.size(), LoadedSlide<S>{S(T(0)), S(T(0))}) {
    for (const ContactSphere& c : model.contacts) contacts_.emplace_back(c.body);
    widest_.resize(model.contacts.size());
    measure_spheres();
    if (obstacles_) {
      touches_first_ = contacts_.size();
      for (const TouchingFeature& f : model.features)
        for (int entry = 0; entry < 2; ++entry) contacts_.emplace_back(f.body);
    }
    for (const ObjectShape& shape : extras.objects) add_object(shape);
    for (const GripPoint& g : extras.grips) add_grip(g);
    for (const std::array<int, 2>& pair : extras.self_collisions) add_self_collision(pair);
    touching_.assign(model.bodies.size(), 1);
    live_.reserve(contacts_.size());
    places_.resize(width);
    for (Place& place : places_) place.reach = model.reach;
    const Eigen::VectorXd neutral = model.character.skeleton.neutral_pose();
    for (int i = 0; i < model.nq; ++i) {
      q()[i] = S(static_cast<T>(neutral[i]));
      target_[static_cast<std::size_t>(i)] = S(static_cast<T>(neutral[i]));
    }
    for (int lane = 0; lane < width; ++lane) reset_extras(lane);
    failed_ = none();
    refresh();
  }

  /// Numbers in a lane's state.
  static int state_size(const Model& m, const Extras& extras = {}) {
    int size = m.nq + 2 * m.nv + ground_numbers * static_cast<int>(m.contacts.size());
    const int features = static_cast<int>(m.features.size());
    if (extras.obstacles || !extras.objects.empty()) size += 2 * touch_numbers * features;
    for (const ObjectShape& o : extras.objects) {
      const int spheres = o.kind == ObjectShape::Kind::box ? 8 : 1;
      const int own = static_cast<int>(touching_features(o.shape(), true).size());
      size += object_coordinates + ground_numbers * (spheres + features) + 2 * touch_numbers * own;
    }
    return size + grip_numbers * static_cast<int>(extras.grips.size());
  }

  S* q() { return state_.data(); }
  const S* q() const { return state_.data(); }
  S* v() { return state_.data() + model_->nq; }
  const S* v() const { return state_.data() + model_->nq; }
  S* target() { return target_.data(); }
  std::vector<S>& state() { return state_; }
  const std::vector<S>& state() const { return state_; }
  const DynamicsWork<S>& work() const { return work_; }
  /// Contact force on each moving body, mean over the last call of `step`, N, world.
  const std::vector<Vector3>& body_force() const { return body_force_; }
  /// How each moving body slides on ground and boxes while these carry it, mean over the last call of `step`.
  const std::vector<LoadedSlide<S>>& body_slide() const { return body_slide_; }
  /// What the contact of sphere `c` of the model with the ground remembers of the last step.
  ContactMemory<S> contact_memory(std::size_t c) const {
    const S* m = state_.data() + model_->nq + 2 * model_->nv + ground_numbers * static_cast<std::ptrdiff_t>(c);
    return {Vector3::from(m), m[3], m[4]};
  }
  /// Kinetic energy of moving body `b`, J.
  S kinetic_energy(int b) const {
    const BodyWork<S>& k = work_.bodies[static_cast<std::size_t>(b)];
    const S& mass = numbers_.bodies[static_cast<std::size_t>(b)].mass;
    return constant(0.5) * (mass * squared_norm(k.linear) + dot(k.angular, k.inertia * k.angular)) +
           dot(k.linear, cross(k.angular, k.first_moment));
  }
  /// Length of the last call of `step`, s.
  T last_seconds() const { return last_seconds_; }
  /// Force on moving body `b` at a point given in its frame, acting during the next call of `step`.
  void push(int lane, int b, const core::Vector3<T>& force, const core::Vector3<T>& point) {
    auto set = [&](Vector3& to, const core::Vector3<T>& from) {
      core::set_lane(to.x, lane, from.x);
      core::set_lane(to.y, lane, from.y);
      core::set_lane(to.z, lane, from.z);
    };
    set(push_force_[static_cast<std::size_t>(b)], force);
    set(push_arm_[static_cast<std::size_t>(b)], point);
    pushed_ = true;
  }

  /// Whether the lane met a number that is not finite since it was last reset. Such a lane was put at rest into the neutral
  /// pose and goes on from there; what it does means nothing until it is reset.
  bool failed(int lane) const { return core::mask_lane(failed_, lane); }
  void clear_failed(int lane) { set_mask(failed_, lane, false); }
  /// For those who move the lanes by other means than `step`.
  void mark_failed(int lane) { set_mask(failed_, lane, true); }
  void set_body_force(int lane, int b, const core::Vector3<T>& force) {
    Vector3& to = body_force_[static_cast<std::size_t>(b)];
    core::set_lane(to.x, lane, force.x);
    core::set_lane(to.y, lane, force.y);
    core::set_lane(to.z, lane, force.z);
  }

  /// Gravity (m/s^2, downwards) and the friction coefficient of every contact of a lane.
  void set_gravity(int lane, T gravity) { core::set_lane(gravity_, lane, gravity); }
  void set_friction(int lane, T friction) { core::set_lane(friction_, lane, friction); }

  /// Puts a lane into a place of its own: a ground, and boxes (which must outlive the lane; null for none). Throws Error on
  /// boxes where Extras::obstacles is off.
  void set_place(int lane, const Ground<T>& ground, const terrain::BoxScene* boxes) {
    if (boxes && !boxes->empty() && !obstacles_) throw Error("simulator: boxes need Extras::obstacles");
    if (!own_places_)
      for (Place& p : places_) p.ground = *ground_;
    own_places_ = true;
    Place& place = places_[static_cast<std::size_t>(lane)];
    place.ground = ground;
    place.boxes = boxes && !boxes->empty() ? boxes : nullptr;
    has_boxes_ = has_boxes_ || place.boxes;
    place.looked_from.assign(1 + objects_.size(), {std::numeric_limits<double>::infinity(), 0, 0});
    core::set_lane(highest_, lane, ground.highest());
    std::size_t most = 0;
    for (const Place& p : places_) most = std::max(most, p.boxes ? p.boxes->boxes().size() : 0);
    near_.reserve(most);
    // Each of the character and the objects may find every box before doubles are taken out.
    for (Place& p : places_) p.near.reserve((1 + objects_.size()) * most);
  }

  /// Gives a lane the lengths, masses, gains and torque limits of another model. Throws Error unless the two are alike in all
  /// else.
  void set_body(int lane, const Model& other) {
    check_same_build(*model_, other);
    numbers_.set(lane, other);
    Place& place = places_[static_cast<std::size_t>(lane)];
    place.reach = other.reach;
    for (auto& from : place.looked_from) from.x = std::numeric_limits<double>::infinity();
    for (std::size_t g = 0; g < grips_.size(); ++g) place_grip(lane, static_cast<int>(g), other);
    measure_spheres();
  }

  /// Gives a lane's object another size and mass. Throws Error on a bad one or one of another kind.
  void set_object_shape(int lane, int object, const ObjectShape& shape) {
    shape.check("simulator: object " + std::to_string(object) + ": ");
    ObjectWork<S>& o = objects_[static_cast<std::size_t>(object)].work;
    const bool box = shape.kind == ObjectShape::Kind::box;
    if (box != (o.contacts.size() == 8)) throw Error("simulator: an object cannot change from box to sphere");
    const auto number = [&](S& to, double x) { core::set_lane(to, lane, static_cast<T>(x)); };
    const auto vector = [&](Vector3& to, const core::Vector3<double>& x) {
      number(to.x, x.x);
      number(to.y, x.y);
      number(to.z, x.z);
    };
    vector(o.half_size, box ? shape.half_size : core::Vector3<double>{0, 0, 0});
    number(o.rounding, box ? 0.0 : shape.half_size.x);
    number(o.mass, shape.mass);
    vector(o.inertia, shape.inertia());
    number(o.reach, box ? norm(shape.half_size) : shape.half_size.x);
    const core::Vector3<double>& h = shape.half_size;
    for (std::size_t c = 0; c < o.contacts.size(); ++c) {
      vector(o.contacts[c].center,
             box ? core::Vector3<double>{(c & 1 ? 1 : -1) * h.x, (c & 2 ? 1 : -1) * h.y, (c & 4 ? 1 : -1) * h.z}
                 : core::Vector3<double>{0, 0, 0});
      number(o.contacts[c].radius, box ? 0.0 : h.x);
    }
    const std::vector<TouchingFeature> features = touching_features(shape.shape(), true);
    for (std::size_t f = 0; f < features.size(); ++f) {
      vector(o.features[f].center, features[f].center);
      vector(o.features[f].half_axis, features[f].half_axis);
      number(o.features[f].radius, features[f].radius);
    }
  }

  int objects() const { return static_cast<int>(objects_.size()); }
  int grips() const { return static_cast<int>(grips_.size()); }
  const ObjectWork<S>& object(int o) const { return objects_[static_cast<std::size_t>(o)].work; }
  /// An object's coordinates in the state: position, quaternion, velocity, angular velocity.
  S* object_state(int o) { return state_.data() + objects_[static_cast<std::size_t>(o)].at; }
  const S* object_state(int o) const { return state_.data() + objects_[static_cast<std::size_t>(o)].at; }

  /// Lets a grip hold on at an anchor (m; world, or its object's frame) until released or until its force passes `breaking` N.
  void hold(int lane, int grip, const core::Vector3<T>& anchor, T breaking) {
    S* g = grip_state(grip);
    core::set_lane(g[0], lane, T(1));
    core::set_lane(g[1], lane, anchor.x);
    core::set_lane(g[2], lane, anchor.y);
    core::set_lane(g[3], lane, anchor.z);
    // Squares of it must stay finite.
    core::set_lane(g[4], lane, std::min(breaking, T(1e18)));
  }
  void release(int lane, int grip) { core::set_lane(grip_state(grip)[0], lane, T(0)); }
  bool holds(int lane, int grip) const { return core::lane_of(grip_state(grip)[0], lane) > T(0); }
  /// Force of a grip on the character, mean over the last call of `step`, N, world.
  const Vector3& grip_force(int grip) const { return grips_[static_cast<std::size_t>(grip)].force; }
  /// Where on the character a grip is now, m, world.
  Vector3 grip_place(int grip) const {
    const Grip& g = grips_[static_cast<std::size_t>(grip)];
    const BodyWork<S>& k = work_.bodies[static_cast<std::size_t>(g.body)];
    return k.position + k.rotation * g.point;
  }

  /// Puts a lane's objects where they begin, at rest, and opens its grips.
  void reset_extras(int lane) {
    for (std::size_t o = 0; o < objects_.size(); ++o) {
      S* x = object_state(static_cast<int>(o));
      const core::Vector3<double>& p = objects_[o].position;
      const double begin[object_coordinates] = {p.x, p.y, p.z, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0};
      for (int i = 0; i < object_coordinates; ++i) core::set_lane(x[i], lane, static_cast<T>(begin[i]));
    }
    for (std::size_t g = 0; g < grips_.size(); ++g) release(lane, static_cast<int>(g));
  }

  /// Recomputes frames and momenta; needed after the state was written from outside.
  void refresh() { update_kinematics(*model_, numbers_, q(), v(), work_); }

  /// Advances all lanes by `count` time steps towards the joint targets.
  ///
  /// Defined outside the class, so that a program which steps in many places can compile it once: `extern template void
  /// Lanes<S>::step(int) noexcept;` everywhere, and the same without `extern` in one place.
  [[gnu::flatten]] void step(int count) noexcept;

 private:
  using LaneMask = core::MaskOf<S>;
  struct ContactWork {
    int body;
    bool active = false;
    S depth;
    Vector3 normal, arm, velocity, centripetal;
    Vector3 aside;  ///< how far a step at constant joint and root velocities takes it beside dt times its last velocity, m
    LinearContact<S> linear;
    // Of contacts with obstacles: which box, and what was remembered of it. Of contacts with objects: the arm on the object.
    S id;
    ContactMemory<S> memory;
    Vector3 other_arm;

    explicit ContactWork(int of = 0) : body(of) {}
  };
  struct Place {
    Ground<T> ground;
    const terrain::BoxScene* boxes = nullptr;
    double reach = 0;                                 ///< of the lane's character, m
    std::vector<core::Vector3<double>> looked_from;  ///< by the character and by each object, m
    std::vector<int> near;
  };
  struct Object {
    ObjectWork<S> work;
    core::Vector3<double> position;   ///< after a reset, m
    std::ptrdiff_t at = 0;            ///< of its coordinates in the state
    std::ptrdiff_t ground = 0, touches = 0, character = 0;  ///< of its contacts' memories in the state
    std::vector<ContactWork> own_ground, own_touches;
    std::vector<TouchingFeature> kinds;
    std::uint8_t touching = 1;        ///< whether it was near a box
    std::size_t first_contact = 0;    ///< of the character's features with it, in contacts_
  };
  struct Grip {
    int body = 0, joint = 0, object = -1;
    core::Vector3<double> in_joint;
    Vector3 point;                    ///< in the body's frame, m
    std::ptrdiff_t at = 0;
    std::size_t contact = 0;
    Vector3 force;
  };
  struct SelfPair {
    int a = 0, b = 0;                                   ///< moving bodies
    std::vector<std::array<std::size_t, 2>> segments;   ///< of a, of b
  };
  /// A solid that collides with others of its character, and where it is in this step.
  struct SelfSegment {
    std::size_t feature = 0, body = 0;
    Vector3 center, half_axis;
    S reach;  ///< from the centre, a little more than the solid's
  };
  static constexpr int ground_numbers = 5, touch_numbers = 6;
  /// How far a root may move before the boxes near it are looked for again, m.
  static constexpr double look_margin = 0.3;
  /// Boxes closer to each other than this have no gap between them, m.
  static constexpr double seam = 0.002;

  static LaneMask none() { return S(0.0) < S(0.0); }
  static void set_mask(LaneMask& mask, int lane, bool value) {
    if constexpr (std::is_same_v<LaneMask, bool>) {
      mask = value;
    } else {
      mask.set(lane, value);
    }
  }
  [[gnu::always_inline]] static S constant(double x) { return S(static_cast<T>(x)); }

  /// Joint accelerations of the last step; a free root's numbers are load_inertias' look ahead and its angular acceleration.
  S* rates() { return state_.data() + model_->nq + model_->nv; }
  S* memory(std::size_t contact) {
    return state_.data() + model_->nq + 2 * model_->nv + 5 * static_cast<std::ptrdiff_t>(contact);
  }

  [[gnu::always_inline]] void advance() {
    const Parameters& p = *parameters_;
    const S dt = constant(p.dt);
    load_inertias(*model_, numbers_, gravity_, work_, rates());
    find_contacts();
    live_.clear();
    if (has_boxes_) find_touches();
    if (!objects_.empty()) meet_objects();
    if (!grips_.empty()) pull_grips();
    if (!objects_.empty()) share_objects();
    if (!pairs_.empty()) find_self_collisions();
    if (pushed_ || !pairs_.empty()) add_pushes();
    prepare_joints();
    solve();

    const Vector3 center = work_.center_of_mass;
    Vector3 force = Vector3::zero(), moment = Vector3::zero();
    settle_contacts(center, force, moment);
    if (contacts_.size() > model_->contacts.size()) settle_extras(center, force, moment);
    const auto in_flight = !(constant(0) < squared_norm(force));
    if (pushed_)
      for (std::size_t i = 0; i < push_force_.size(); ++i) {
        const BodyWork<S>& k = work_.bodies[i];
        force += push_force_[i];
        moment += cross(k.position + k.rotation * push_arm_[i] - center, push_force_[i]);
      }
    force.z -= gravity_ * numbers_.total_mass;
    const Vector3 linear = work_.linear_momentum + dt * force;
    const Vector3 angular = work_.angular_momentum + dt * moment;
    integrate(in_flight);
    update_kinematics(*model_, numbers_, q(), v(), work_);
    if (p.conserve_momentum && model_->bodies[0].type == body::JointType::free)
      correct_momentum(linear, angular, center + (dt * numbers_.inverse_mass) * linear, in_flight);
  }

  [[gnu::always_inline]] void find_contacts() {
    for (std::size_t i = 0; i < model_->bodies.size(); ++i) {
      const MovingBody& b = model_->bodies[i];
      BodyWork<S>& k = work_.bodies[i];
      const bool near = b.contacts > 0 && core::any(k.position.z < highest_ + numbers_.bodies[i].reach);
      for (int c = 0; c < b.contacts; ++c) {
        const auto index = static_cast<std::size_t>(b.first_contact + c);
        touch_ground(contacts_[index], k, numbers_.contacts[index], widest_[index], near, memory(index));
      }
    }
  }

  /// The contact of one sphere with the ground, of a body or an object. `reach` is the sphere's widest radius over the lanes.
  [[gnu::always_inline]] void touch_ground(ContactWork& w, BodyWork<S>& k, const SphereNumbers<S>& sphere, T reach, bool near, S* m) {
    const bool was_active = w.active;
    w.active = false;
    if (near) {
      const Vector3 center = k.rotation * sphere.center;
      const Vector3 point = k.position + center;
      if (core::any(point.z < highest_ + sphere.radius)) {
        const GroundSample<S> sample = own_places_ ? sample_places(point, reach) : ground_->sample(point, reach);
        w.depth = sphere.radius - sample.distance;
        if (core::any(w.depth > constant(0))) {
          w.active = true;
          w.normal = sample.normal;
          put_contact(w, k, center - sphere.radius * sample.normal);
          w.memory = recall(Vector3::from(m), w.aside, w.normal, m[3], m[4]);
          w.linear = linearize_contact(*parameters_, friction_, w.depth, w.normal, w.velocity, w.memory);
          add_contact(w, k);
        }
      }
    }
    if (!w.active && was_active)
      for (int n = 0; n < ground_numbers; ++n) m[n] = constant(0);
  }

  /// Puts a contact at `arm` on a body (m, from its joint, world) and takes down how that place moves.
  [[gnu::always_inline]] void put_contact(ContactWork& w, const BodyWork<S>& k, const Vector3& arm) {
    w.arm = arm;
    w.velocity = k.linear + cross(k.angular, arm);
    w.centripetal = cross(k.angular, cross(k.angular, arm));
    w.aside = constant(-0.5 * parameters_->dt * parameters_->dt) * (k.turning_linear + cross(k.turning_angular, arm) + w.centripetal);
  }
  /// What a contact remembers, its bristle as it will be found once the step is taken at the velocities that come out of it.
  [[gnu::always_inline]] static ContactMemory<S> recall(const Vector3& bristle, const Vector3& aside, const Vector3& normal,
                                                        const S& force, const S& speed) {
    return {bristle + aside - dot(normal, aside) * normal, force, speed};
  }

  /// f = f0 - K (u + dt (a + alpha x arm + centripetal)) seen as inertia and bias of the body.
  [[gnu::always_inline]] void add_contact(const ContactWork& w, BodyWork<S>& k) {
    const S dt = constant(parameters_->dt);
    const core::Symmetric3<S> m = dt * w.linear.resistance;
    const Vector3& x = w.arm;
    const Vector3 mx = cross(x, Vector3{m.xx, m.xy, m.xz}), my = cross(x, Vector3{m.xy, m.yy, m.yz}),
                  mz = cross(x, Vector3{m.xz, m.yz, m.zz});
    const core::Matrix3<S> xm{mx.x, my.x, mz.x, mx.y, my.y, mz.y, mx.z, my.z, mz.z};
    const Vector3 qx = cross(xm.row_x(), x), qy = cross(xm.row_y(), x), qz = cross(xm.row_z(), x);
    k.j -= core::Symmetric3<S>{qx.x, qy.y, qz.z, qx.y, qx.z, qy.z};
    k.h += xm;
    k.m += m;
    const Vector3 f = w.linear.force - w.linear.resistance * (w.velocity + dt * w.centripetal);
    k.f -= f;
    k.n -= cross(x, f);
  }

  [[gnu::always_inline]] void add_pushes() {
    for (std::size_t i = 0; i < push_force_.size(); ++i) {
      BodyWork<S>& k = work_.bodies[i];
      k.f -= push_force_[i];
      k.n -= cross(k.rotation * push_arm_[i], push_force_[i]);
    }
    if (pairs_.empty()) return;
    for (std::size_t i = 0; i < self_force_.size(); ++i) {
      BodyWork<S>& k = work_.bodies[i];
      k.f -= self_force_[i];
      k.n -= self_moment_[i];
    }
  }

  /// Motors as springs implicit in velocity, weakened by the estimated share of their torque limit; joint stops likewise.
  [[gnu::always_inline]] void prepare_joints() {
    using core::Quaternion;
    const Parameters& p = *parameters_;
    const S zero = constant(0), one = constant(1);
    for (std::size_t i = 0; i < model_->bodies.size(); ++i) {
      const MovingBody& b = model_->bodies[i];
      if (b.type == body::JointType::free) continue;
      BodyWork<S>& k = work_.bodies[i];
      const body::Actuator& a = b.actuator;
      const S* vj = v() + b.v_index;
      const S* rate = rates() + b.v_index;
      const BodyNumbers<S>& c = numbers_.bodies[i];
      const S step = constant(p.dt), kp = c.stiffness, kv = kp * step + c.damping, inertia = step * kv;
      const bool ball = b.type == body::JointType::ball;
      Vector3 present, error, velocity, last;
      if (ball) {
        const Quaternion<S> r = Quaternion<S>::from(q() + b.q_index);
        error = log_map(r.conjugate() * Quaternion<S>::from(target_.data() + b.q_index));
        velocity = Vector3::from(vj);
        last = Vector3::from(rate);
        if (a.limited || std::isfinite(a.cone)) present = log_map(r);
      } else {
        present = Vector3{q()[b.q_index], zero, zero};
        error = Vector3{target_[static_cast<std::size_t>(b.q_index)] - present.x, zero, zero};
        velocity = Vector3{vj[0], zero, zero};
        last = Vector3{rate[0], zero, zero};
      }
      const Vector3 torque = kp * error - kv * velocity;
      S scale = one;
      if (std::isfinite(a.torque_limit)) {
        const S size = norm(torque - inertia * last);
        const S& limit = c.torque_limit;
        scale = select(size > limit, limit / core::max(size, constant(1e-20)), one);
      }
      k.motor = scale * torque;
      k.motor_inertia = scale * inertia;
      k.stop = Vector3::zero();
      k.stop_inertia = zero;
      if (!a.limited && !std::isfinite(a.cone)) continue;
      Vector3 excess = Vector3::zero();
      if (a.limited) {
        const auto beyond = [&](const S& x, double low, double high) {
          return core::max(x - constant(high), zero) + core::min(x - constant(low), zero);
        };
        excess.x = beyond(present.x, a.lower.x, a.upper.x);
        if (ball) {
          excess.y = beyond(present.y, a.lower.y, a.upper.y);
          excess.z = beyond(present.z, a.lower.z, a.upper.z);
        }
      }
      if (std::isfinite(a.cone)) {
        const S angle = norm(present);
        const S over = core::max(angle - constant(a.cone), zero);
        excess += (over / core::max(angle, constant(1e-6))) * present;
      }
      const auto stopped = constant(0) < squared_norm(excess);
      if (!core::any(stopped)) continue;
      const S ks = constant(p.stop_stiffness), kd = constant(p.stop_stiffness * p.dt + p.stop_damping);
      k.stop = select(stopped, -(ks * excess) - kd * velocity, Vector3::zero());
      k.stop_inertia = select(stopped, constant(p.dt * (p.stop_stiffness * p.dt + p.stop_damping)), zero);
    }
  }

  /// The dynamics, repeated with constant torques where a motor came out beyond its limit: first those motors and their
  /// near-saturated company, then every motor of a lane that still has one beyond, which settles it.
  [[gnu::always_inline]] void solve() {
    for (int pass = 0;; ++pass) {
      if (pass > 0) {
        // The pass before has added outboard inertias to inboard ones.
        load_inertias(*model_, numbers_, gravity_, work_, rates());
        const auto add = [&](const ContactWork& c) {
          if (c.active) add_contact(c, work_.bodies[static_cast<std::size_t>(c.body)]);
        };
        for (std::size_t c = 0; c < model_->contacts.size(); ++c) add(contacts_[c]);
        for (const std::size_t c : live_) add(contacts_[c]);
        if (pushed_ || !pairs_.empty()) add_pushes();
      }
      articulated_body(*model_, work_);
      LaneMask beyond = none();
      for (std::size_t i = 0; i < model_->bodies.size(); ++i) {
        const MovingBody& b = model_->bodies[i];
        if (b.type == body::JointType::free) continue;
        BodyWork<S>& k = work_.bodies[i];
        k.torque = k.motor - k.motor_inertia * k.joint_rate;
        if (!std::isfinite(b.actuator.torque_limit)) continue;
        const S limit = numbers_.bodies[i].torque_limit;
        beyond = beyond | (squared_norm(k.torque) > constant(1.001) * (limit * limit));
      }
      if (pass == 2 || !core::any(beyond)) return;
      for (std::size_t i = 0; i < model_->bodies.size(); ++i) {
        const MovingBody& b = model_->bodies[i];
        if (b.type == body::JointType::free || !std::isfinite(b.actuator.torque_limit)) continue;
        BodyWork<S>& k = work_.bodies[i];
        const S& limit = numbers_.bodies[i].torque_limit;
        const S size = norm(k.torque);
        const auto fix = beyond & (size > (pass == 0 ? constant(0.9) * limit : constant(-1)));
        const S shrink = select(size > limit, limit / core::max(size, constant(1e-20)), constant(1));
        k.motor = select(fix, shrink * k.torque, k.motor);
        k.motor_inertia = select(fix, constant(0), k.motor_inertia);
      }
    }
  }

  [[gnu::always_inline]] void settle_contacts(const Vector3& center, Vector3& force, Vector3& moment) {
    for (std::size_t i = 0; i < model_->bodies.size(); ++i) {
      const MovingBody& b = model_->bodies[i];
      const BodyWork<S>& k = work_.bodies[i];
      for (int c = 0; c < b.contacts; ++c) {
        const auto index = static_cast<std::size_t>(b.first_contact + c);
        ContactWork& w = contacts_[index];
        if (!w.active) continue;
        const Vector3 f = settle_touch(w, k, memory(index), Vector3::zero(), Vector3::zero());
        force += f;
        moment += cross(k.position + w.arm - center, f);
        body_force_[i] += f;
        add_slide(i, w.memory);
      }
    }
  }
  [[gnu::always_inline]] void add_slide(std::size_t body, const ContactMemory<S>& m) {
    body_slide_[body].load += m.normal_force;
    body_slide_[body].sum += m.normal_force * m.sliding_speed;
  }

  template <class M>
  [[gnu::always_inline]] void integrate(const M& in_flight) {
    using core::Quaternion;
    const Parameters& p = *parameters_;
    const S dt = constant(p.dt), fastest = constant(p.joint_speed_limit), slowest = constant(-p.joint_speed_limit);
    const auto limited = [&](const S& x) { return core::max(core::min(x, fastest), slowest); };
    for (std::size_t i = 0; i < model_->bodies.size(); ++i) {
      const MovingBody& b = model_->bodies[i];
      const BodyWork<S>& k = work_.bodies[i];
      S* qj = q() + b.q_index;
      S* vj = v() + b.v_index;
      S* rate = rates() + b.v_index;
      if (b.type == body::JointType::free) {
        const Vector3 linear = Vector3::from(vj) + dt * k.acceleration;
        const Vector3 angular = Vector3::from(vj + 3) + dt * k.alpha;
        linear.store(vj);
        angular.store(vj + 3);
        // What a contact did in one step says nothing of the next.
        rate[0] = select(in_flight, constant(0.5) * dt, constant(0));
        k.alpha.store(rate + 3);
        (Vector3::from(qj) + dt * linear).store(qj);
        (core::exp_map_small(dt * angular) * Quaternion<S>::from(qj + 3)).normalized().store(qj + 3);
      } else if (b.type == body::JointType::ball) {
        Vector3 w = Vector3::from(vj) + dt * k.joint_rate;
        w = Vector3{limited(w.x), limited(w.y), limited(w.z)};
        w.store(vj);
        k.joint_rate.store(rate);
        (Quaternion<S>::from(qj) * core::exp_map_small(dt * w)).normalized().store(qj);
      } else {
        vj[0] = limited(vj[0] + dt * k.joint_rate.x);
        rate[0] = k.joint_rate.x;
        qj[0] += dt * vj[0];
      }
    }
  }

  /// Moves all velocities by the one rigid motion that gives the whole body the momenta it should have; a lane in flight
  /// also has its centre of mass put where its momentum takes it.
  template <class M>
  [[gnu::always_inline]] void correct_momentum(const Vector3& linear, const Vector3& angular, const Vector3& center,
                                               const M& in_flight) {
    using core::Symmetric3;
    Symmetric3<S> composite = Symmetric3<S>::zero();
    for (std::size_t i = 0; i < model_->bodies.size(); ++i) {
      const BodyWork<S>& k = work_.bodies[i];
      const Vector3 d = k.position - work_.center_of_mass;
      const S& mass = numbers_.bodies[i].mass;
      const Vector3 e = mass * d + k.first_moment;  // (d e^T + h d^T) with e = m d + h collects all three cross terms
      composite += k.inertia;
      const Vector3& h = k.first_moment;
      const S trace = dot(d, e) + dot(d, h);
      composite.xx += trace - (d.x * e.x + h.x * d.x);
      composite.yy += trace - (d.y * e.y + h.y * d.y);
      composite.zz += trace - (d.z * e.z + h.z * d.z);
      composite.xy -= d.x * e.y + h.x * d.y;
      composite.xz -= d.x * e.z + h.x * d.z;
      composite.yz -= d.y * e.z + h.y * d.z;
    }
    const Vector3 dv = numbers_.inverse_mass * (linear - work_.linear_momentum);
    const Vector3 dw = composite.inverse() * (angular - work_.angular_momentum);
    const Vector3 shift = select(in_flight, center - work_.center_of_mass, Vector3::zero());
    for (auto& k : work_.bodies) {
      k.linear += dv + cross(dw, k.position - work_.center_of_mass);
      k.angular += dw;
      k.position += shift;
    }
    BodyWork<S>& root = work_.bodies[0];
    root.relative = root.angular;
    root.position.store(q());
    root.linear.store(v());
    root.angular.store(v() + 3);
    work_.center_of_mass += shift;
    work_.linear_momentum = linear;
    work_.angular_momentum = angular;
  }

  /// A lane that holds a number that is not finite is put into the neutral pose, at rest, and marked.
  void freeze_failed() noexcept {
    S sum = constant(0);
    for (const S& x : state_) sum += x - x;
    const auto bad = !(sum == constant(0));
    if (!core::any(bad)) return;
    failed_ = failed_ | bad;
    for (S& x : state_) x = select(bad, constant(0), x);
    for (const MovingBody& b : model_->bodies) {
      const int w = b.type == body::JointType::free ? 6 : b.type == body::JointType::ball ? 3 : -1;
      if (w >= 0) q()[b.q_index + w] = select(bad, constant(1), q()[b.q_index + w]);
    }
    for (Object& o : objects_) {
      S* x = state_.data() + o.at;
      x[6] = select(bad, constant(1), x[6]);
    }
    refresh();
  }

  void measure_spheres() {
    for (std::size_t c = 0; c < widest_.size(); ++c) {
      widest_[c] = 0;
      for (int l = 0; l < width; ++l)
        widest_[c] = std::max(widest_[c], core::lane_of(numbers_.contacts[c].radius, l));
    }
  }

  void add_object(const ObjectShape& shape) {
    const int index = static_cast<int>(objects_.size());
    shape.check("simulator: object " + std::to_string(index) + ": ");
    Object o;
    o.position = shape.position;
    const bool box = shape.kind == ObjectShape::Kind::box;
    o.work.contacts.resize(box ? 8 : 1);
    o.kinds = touching_features(shape.shape(), true);
    o.work.features.resize(o.kinds.size());
    o.own_ground.resize(o.work.contacts.size());
    o.own_touches.resize(2 * o.work.features.size());
    const auto take = [&](std::ptrdiff_t numbers) {
      const std::ptrdiff_t at = taken_;
      taken_ += numbers;
      return at;
    };
    if (index == 0)
      taken_ = model_->nq + 2 * model_->nv + ground_numbers * static_cast<std::ptrdiff_t>(model_->contacts.size()) +
               2 * touch_numbers * static_cast<std::ptrdiff_t>(model_->features.size());
    o.at = take(object_coordinates);
    o.ground = take(ground_numbers * static_cast<std::ptrdiff_t>(o.work.contacts.size()));
    o.touches = take(2 * touch_numbers * static_cast<std::ptrdiff_t>(o.work.features.size()));
    o.character = take(ground_numbers * static_cast<std::ptrdiff_t>(model_->features.size()));
    o.first_contact = contacts_.size();
    for (const TouchingFeature& f : model_->features) contacts_.emplace_back(f.body);
    objects_.push_back(std::move(o));
    for (int lane = 0; lane < width; ++lane) set_object_shape(lane, index, shape);
  }

  void add_grip(const GripPoint& point) {
    const std::string where = "simulator: grip " + std::to_string(grips_.size()) + ": ";
    if (point.joint < 0 || point.joint >= model_->character.skeleton.size()) throw Error(where + "names a joint that does not exist");
    if (point.object < -1 || point.object >= static_cast<int>(objects_.size())) throw Error(where + "names an object that does not exist");
    Grip g;
    g.body = model_->moving_of_joint[static_cast<std::size_t>(point.joint)];
    if (g.body < 0) throw Error(where + "its joint does not move");
    g.joint = point.joint;
    g.object = point.object;
    g.in_joint = point.point;
    g.at = static_cast<std::ptrdiff_t>(state_.size()) - grip_numbers * static_cast<std::ptrdiff_t>(1 + grips_.size());
    g.contact = contacts_.size();
    g.force = Vector3::zero();
    contacts_.emplace_back(g.body);
    grips_.push_back(g);
    for (int lane = 0; lane < width; ++lane) place_grip(lane, static_cast<int>(grips_.size()) - 1, *model_);
  }
  void place_grip(int lane, int grip, const Model& model) {
    Grip& g = grips_[static_cast<std::size_t>(grip)];
    const core::Vector3<double> at = model.on_moving_body(g.joint, g.in_joint);
    core::set_lane(g.point.x, lane, static_cast<T>(at.x));
    core::set_lane(g.point.y, lane, static_cast<T>(at.y));
    core::set_lane(g.point.z, lane, static_cast<T>(at.z));
  }
  S* grip_state(int grip) { return state_.data() + grips_[static_cast<std::size_t>(grip)].at; }
  const S* grip_state(int grip) const { return state_.data() + grips_[static_cast<std::size_t>(grip)].at; }

  void add_self_collision(const std::array<int, 2>& joints) {
    SelfPair pair;
    const int size = model_->character.skeleton.size();
    for (std::size_t end = 0; end < 2; ++end) {
      if (joints[end] < 0 || joints[end] >= size) throw Error("simulator: self-collision names a joint that does not exist");
      const int body = model_->moving_of_joint[static_cast<std::size_t>(joints[end])];
      if (body < 0) throw Error("simulator: self-collision with a body that does not move");
      (end == 0 ? pair.a : pair.b) = body;
    }
    if (pair.a == pair.b) throw Error("simulator: self-collision of a body with itself");
    // Segments stand for capsules, their ends included; spheres for themselves.
    const auto solids = [&](int b) {
      const MovingBody& m = model_->bodies[static_cast<std::size_t>(b)];
      std::vector<std::size_t> out;
      bool axes = false;
      for (int f = m.first_feature; f < m.first_feature + m.features; ++f)
        axes = axes || squared_norm(model_->features[static_cast<std::size_t>(f)].half_axis) > 0;
      for (int f = m.first_feature; f < m.first_feature + m.features; ++f)
        if (!axes || squared_norm(model_->features[static_cast<std::size_t>(f)].half_axis) > 0) out.push_back(static_cast<std::size_t>(f));
      return out;
    };
    const auto segment = [&](std::size_t feature, int body) {
      for (std::size_t i = 0; i < segments_.size(); ++i)
        if (segments_[i].feature == feature) return i;
      SelfSegment s{};
      s.feature = feature;
      s.body = static_cast<std::size_t>(body);
      segments_.push_back(s);
      return segments_.size() - 1;
    };
    for (std::size_t a : solids(pair.a))
      for (std::size_t b : solids(pair.b)) pair.segments.push_back({segment(a, pair.a), segment(b, pair.b)});
    pairs_.push_back(std::move(pair));
    self_force_.assign(model_->bodies.size(), Vector3::zero());
    self_moment_.assign(model_->bodies.size(), Vector3::zero());
  }

  /// Each lane asks its own ground.
  [[gnu::noinline]] GroundSample<S> sample_places(const Vector3& point, T reach) const noexcept {
    GroundSample<S> out{constant(0), Vector3::zero()};
    for (int l = 0; l < width; ++l) {
      const core::Vector3<T> at{core::lane_of(point.x, l), core::lane_of(point.y, l), core::lane_of(point.z, l)};
      const GroundSample<T> s = places_[static_cast<std::size_t>(l)].ground.sample(at, reach);
      core::set_lane(out.distance, l, s.distance);
      core::set_lane(out.normal.x, l, s.normal.x);
      core::set_lane(out.normal.y, l, s.normal.y);
      core::set_lane(out.normal.z, l, s.normal.z);
    }
    return out;
  }

  /// Where the character (0) or an object (1 and on) of a lane is, m, and how fast.
  core::Vector3<double> lane_position(std::size_t i, int lane) const { return lane_numbers(i == 0 ? q() : object_state(static_cast<int>(i) - 1), lane); }
  core::Vector3<double> lane_velocity(std::size_t i, int lane) const {
    return lane_numbers(i == 0 ? v() : object_state(static_cast<int>(i) - 1) + 7, lane);
  }
  static core::Vector3<double> lane_numbers(const S* x, int lane) {
    return {static_cast<double>(core::lane_of(x[0], lane)), static_cast<double>(core::lane_of(x[1], lane)),
            static_cast<double>(core::lane_of(x[2], lane))};
  }

  /// Finds the boxes that lanes may meet within the next steps, unless they have hardly moved since that was last done.
  [[gnu::noinline]] void look_around(int count) {
    bool changed = false;
    for (int l = 0; l < width; ++l) {
      Place& place = places_[static_cast<std::size_t>(l)];
      if (!place.boxes) {
        changed = changed || !place.near.empty();
        place.near.clear();
        continue;
      }
      // Around the character and around each object, wherever it has gone.
      bool moved = false;
      for (std::size_t i = 0; i <= objects_.size(); ++i) {
        const core::Vector3<double> at = lane_position(i, l);
        const double ahead = norm(lane_velocity(i, l)) * count * parameters_->dt;
        moved = moved || !(norm(at - place.looked_from[i]) + ahead < look_margin);
      }
      if (!moved) continue;
      place.near.clear();
      for (std::size_t i = 0; i <= objects_.size(); ++i) {
        place.looked_from[i] = lane_position(i, l);
        const double reach =
            i == 0 ? place.reach : static_cast<double>(core::lane_of(objects_[i - 1].work.reach, l));
        const double ahead = norm(lane_velocity(i, l)) * count * parameters_->dt;
        place.boxes->near(place.looked_from[i], look_margin + ahead + reach, place.near);
      }
      if (!objects_.empty()) {
        std::sort(place.near.begin(), place.near.end());
        place.near.erase(std::unique(place.near.begin(), place.near.end()), place.near.end());
      }
      changed = true;
    }
    if (!changed) return;
    std::size_t most = 0;
    for (const Place& place : places_) most = std::max(most, place.near.size());
    near_.resize(most);
    for (std::size_t k = 0; k < most; ++k) {
      Obstacle<S>& o = near_[k];
      o.rounding = constant(0);
      for (int l = 0; l < width; ++l) {
        const Place& place = places_[static_cast<std::size_t>(l)];
        terrain::Box box{{1e4, 1e4, 1e4}, {1e-3, 1e-3, 1e-3}, core::Quaternion<double>::identity()};
        int id = -1;
        if (k < place.near.size()) {
          id = place.near[k];
          box = place.boxes->boxes()[static_cast<std::size_t>(id)];
        }
        const core::Matrix3<double> r = box.rotation.matrix();
        const double numbers[] = {box.center.x,    box.center.y,    box.center.z, box.half_size.x, box.half_size.y, box.half_size.z,
                                  r.xx, r.xy, r.xz, r.yx, r.yy, r.yz, r.zx, r.zy, r.zz, static_cast<double>(id)};
        S* const into[] = {&o.center.x,     &o.center.y,     &o.center.z,    &o.half_size.x, &o.half_size.y, &o.half_size.z,
                           &o.rotation.xx, &o.rotation.xy, &o.rotation.xz, &o.rotation.yx,  &o.rotation.yy, &o.rotation.yz,
                           &o.rotation.zx, &o.rotation.zy, &o.rotation.zz, &o.id};
        for (std::size_t n = 0; n < std::size(numbers); ++n) core::set_lane(*into[n], l, static_cast<T>(numbers[n]));
      }
    }
  }

  [[gnu::always_inline]] static Touch<S> touch(const Obstacle<S>& o, const BodyWork<S>& k, const FeatureNumbers<S>& f, bool sphere) {
    const Vector3 center = k.position + k.rotation * f.center;
    const S& radius = f.radius;
    if (sphere) return touch_sphere(o, center, radius);
    return touch_capsule(o, center, k.rotation * f.half_axis, radius);
  }

  /// Contacts of a body's features with the static boxes: of each feature the two it is deepest in, so that a foot may touch
  /// tread and riser. `works` and the state at `memory` have two entries for each feature.
  void touch_boxes(BodyWork<S>& k, const FeatureNumbers<S>* features, const TouchingFeature* kinds, int count, const S& reach,
                   ContactWork* works, S* memory, std::uint8_t& touching) noexcept {
    candidates_.clear();
    for (std::size_t o = 0; o < near_.size(); ++o)
      if (core::any(obstacle_distance(near_[o], k.position) < reach)) candidates_.push_back(static_cast<int>(o));
    // Most bodies are near nothing most of the time, and what they remember is not worth looking at then.
    if (candidates_.empty() && !touching) return;
    touching = candidates_.empty() ? 0 : 1;
    for (int f = 0; f < count; ++f) {
      ContactWork* w = works + 2 * f;
      S* m = memory + 2 * touch_numbers * f;
      Touch<S> first{constant(1e6), Vector3::zero(), Vector3::zero()}, second = first;
      S first_id = constant(-1), second_id = constant(-1);
      for (int c : candidates_) {
        const Obstacle<S>& o = near_[static_cast<std::size_t>(c)];
        const Touch<S> t = touch(o, k, features[f], squared_norm(kinds[f].half_axis) == 0);
        if (!core::any(t.distance < constant(0))) continue;
        const auto deeper = t.distance < first.distance, middle = t.distance < second.distance;
        const auto pick = [&](const auto& mask, const Touch<S>& x, const Touch<S>& y) {
          return Touch<S>{select(mask, x.distance, y.distance), select(mask, x.normal, y.normal), select(mask, x.arm, y.arm)};
        };
        second = pick(deeper, first, pick(middle, t, second));
        second_id = select(deeper, first_id, select(middle, o.id, second_id));
        first = pick(deeper, t, first);
        first_id = select(deeper, o.id, first_id);
      }
      const Vector3 middle = k.rotation * features[f].center;
      const S& radius = features[f].radius;
      // An edge that two boxes share is none: a contact with the second box at a point that the first has too is left out,
      // or feet and objects would stumble over seams.
      if (core::any(second.distance < constant(0))) {
        const Vector3 point = k.position + middle + second.arm - (second.distance + radius) * second.normal;
        for (int c : candidates_) {
          const Obstacle<S>& o = near_[static_cast<std::size_t>(c)];
          const auto shared = (first_id == o.id) & (second.distance < constant(0));
          if (core::any(shared))
            second.distance = select(shared & (obstacle_distance(o, point) < constant(seam)), constant(1e6), second.distance);
        }
      }
      const Touch<S>* found[2] = {&first, &second};
      const S* ids[2] = {&first_id, &second_id};
      for (int e = 0; e < 2; ++e) {
        ContactWork& x = w[e];
        const bool was_active = x.active;
        x.depth = -found[e]->distance;
        x.active = core::any(x.depth > constant(0));
        if (!x.active) {
          if (was_active)
            for (int n = 0; n < touch_numbers; ++n) m[touch_numbers * e + n] = constant(0);
          continue;
        }
        x.id = *ids[e];
        x.normal = found[e]->normal;
        put_contact(x, k, middle + found[e]->arm - radius * x.normal);
      }
      if (!w[0].active) continue;
      // Zero means no box, so boxes are remembered as one more than their index.
      for (int e = 0; e < 2; ++e) {
        if (!w[e].active) continue;
        const auto remembered = [&](int n) {
          const S mine = w[e].id + constant(1);
          return select(mine == m[5], m[n], select(mine == m[touch_numbers + 5], m[touch_numbers + n], constant(0)));
        };
        w[e].memory = recall({remembered(0), remembered(1), remembered(2)}, w[e].aside, w[e].normal,
                              remembered(3), remembered(4));
        w[e].linear = linearize_contact(*parameters_, friction_, w[e].depth, w[e].normal, w[e].velocity, w[e].memory);
        add_contact(w[e], k);
      }
    }
  }

  [[gnu::noinline]] void find_touches() noexcept {
    for (std::size_t i = 0; i < model_->bodies.size(); ++i) {
      const MovingBody& b = model_->bodies[i];
      if (b.features == 0) continue;
      const auto first = static_cast<std::size_t>(b.first_feature);
      touch_boxes(work_.bodies[i], &numbers_.features[first], &model_->features[first], b.features, numbers_.bodies[i].reach,
                  &contacts_[touches_first_ + 2 * first], state_.data() + touch_memory(first), touching_[i]);
      if (!touching_[i]) continue;
      for (std::size_t c = touches_first_ + 2 * first; c < touches_first_ + 2 * (first + static_cast<std::size_t>(b.features)); ++c)
        if (contacts_[c].active) live_.push_back(c);
    }
  }
  std::ptrdiff_t touch_memory(std::size_t feature) const {
    return model_->nq + 2 * model_->nv + ground_numbers * static_cast<std::ptrdiff_t>(model_->contacts.size()) +
           2 * touch_numbers * static_cast<std::ptrdiff_t>(feature);
  }

  /// The velocity of a contact's place on its body at the end of the step.
  [[gnu::always_inline]] Vector3 velocity_after(const ContactWork& w, const BodyWork<S>& k) const {
    return w.velocity + constant(parameters_->dt) * (k.acceleration + cross(k.alpha, w.arm) + w.centripetal);
  }

  /// The contact after the step: its force, and its memory moved on, in the state at `m`. `other_before` and `other_after` are
  /// the velocities of what it touches.
  [[gnu::always_inline]] Vector3 settle_touch(ContactWork& w, const BodyWork<S>& k, S* m, const Vector3& other_before,
                                              const Vector3& other_after) {
    const Vector3 after = velocity_after(w, k);
    const Vector3 f = w.linear.force - w.linear.resistance * after;
    update_contact(*parameters_, friction_, w.depth, w.normal, w.velocity - other_before, after - other_after, f, w.memory);
    w.memory.bristle.store(m);
    m[3] = w.memory.normal_force;
    m[4] = w.memory.sliding_speed;
    return f;
  }
  void remember_box(const ContactWork& w, S* m) { m[5] = select(w.depth > constant(0), w.id + constant(1), constant(0)); }

  /// Objects as the step finds them: their weight, their contacts with the world, and how they answer forces. Then the
  /// character's contacts with them, so far as if they did not give way.
  [[gnu::noinline]] void meet_objects() noexcept {
    const Parameters& p = *parameters_;
    const S zero = constant(0);
    for (Object& o : objects_) {
      ObjectWork<S>& w = o.work;
      BodyWork<S>& k = w.body;
      const S* x = state_.data() + o.at;
      k.position = Vector3::from(x);
      k.rotation = core::Quaternion<S>::from(x + 3).matrix();
      k.linear = Vector3::from(x + 7);
      k.angular = Vector3::from(x + 10);
      k.inertia = rotated(core::Symmetric3<S>{w.inertia.x, w.inertia.y, w.inertia.z, zero, zero, zero}, k.rotation);
      k.j = k.inertia;
      k.m = core::Symmetric3<S>::scalar(w.mass);
      k.h = core::Matrix3<S>::zero();
      k.n = cross(k.angular, k.inertia * k.angular);
      k.f = Vector3{zero, zero, gravity_ * w.mass};
      k.turning_angular = k.turning_linear = Vector3::zero();
      w.force = w.moment = Vector3::zero();
      w.touching = zero;
      const bool low = core::any(k.position.z < highest_ + w.reach);
      for (std::size_t c = 0; c < w.contacts.size(); ++c)
        touch_ground(o.own_ground[c], k, w.contacts[c], T(1), low, state_.data() + o.ground + ground_numbers * static_cast<std::ptrdiff_t>(c));
      if (has_boxes_)
        touch_boxes(k, w.features.data(), o.kinds.data(), static_cast<int>(w.features.size()), w.reach, o.own_touches.data(),
                    state_.data() + o.touches, o.touching);
      w.mobility = Mobility<S>(k);
      const auto free = w.mobility.answer(-k.n, -k.f);
      k.alpha = free.angular;
      k.acceleration = free.linear;
      Obstacle<S> obstacle{k.position, k.rotation, w.half_size, w.rounding, zero};
      for (std::size_t i = 0; i < model_->bodies.size(); ++i) {
        const MovingBody& b = model_->bodies[i];
        const BodyWork<S>& body = work_.bodies[i];
        const bool close = b.features > 0 && core::any(obstacle_distance(obstacle, body.position) < numbers_.bodies[i].reach);
        for (int f = b.first_feature; f < b.first_feature + b.features; ++f) {
          const auto index = static_cast<std::size_t>(f);
          ContactWork& u = contacts_[o.first_contact + index];
          S* m = state_.data() + o.character + ground_numbers * f;
          const bool was_active = u.active;
          u.active = false;
          if (close) {
            const FeatureNumbers<S>& numbers = numbers_.features[index];
            const Touch<S> t = touch(obstacle, body, numbers, squared_norm(model_->features[index].half_axis) == 0);
            u.depth = -t.distance;
            if (core::any(u.depth > zero)) {
              u.active = true;
              u.normal = t.normal;
              put_contact(u, body, body.rotation * numbers.center + t.arm - numbers.radius * t.normal);
              u.other_arm = body.position + u.arm - k.position;
              u.memory = recall(Vector3::from(m), u.aside - other_aside(k, u), u.normal, m[3], m[4]);
              u.linear = linearize_contact(p, friction_, u.depth, u.normal, u.velocity - other_velocity(k, u), u.memory);
              w.touching += select(u.depth > zero, constant(1), zero);
              live_.push_back(o.first_contact + index);
            }
          }
          if (!u.active && was_active)
            for (int n = 0; n < ground_numbers; ++n) m[n] = zero;
        }
      }
    }
  }

  static Vector3 other_velocity(const BodyWork<S>& object, const ContactWork& u) {
    return object.linear + cross(object.angular, u.other_arm);
  }
  Vector3 other_free_velocity(const BodyWork<S>& o, const ContactWork& u) const {
    return other_velocity(o, u) + constant(parameters_->dt) * (o.acceleration + cross(o.alpha, u.other_arm) +
                                                               cross(o.angular, cross(o.angular, u.other_arm)));
  }

  Vector3 other_aside(const BodyWork<S>& o, const ContactWork& u) const {
    return constant(-0.5 * parameters_->dt * parameters_->dt) * cross(o.angular, cross(o.angular, u.other_arm));
  }

  [[gnu::noinline]] void pull_grips() noexcept {
    const S zero = constant(0);
    for (Grip& g : grips_) {
      ContactWork& u = contacts_[g.contact];
      const S* m = state_.data() + g.at;
      u.active = core::any(m[0] > zero);
      if (!u.active) continue;
      const BodyWork<S>& k = work_.bodies[static_cast<std::size_t>(g.body)];
      put_contact(u, k, k.rotation * g.point);
      Vector3 anchor = Vector3::from(m + 1);
      if (g.object >= 0) {
        ObjectWork<S>& o = objects_[static_cast<std::size_t>(g.object)].work;
        u.other_arm = o.body.rotation * anchor;
        anchor = o.body.position + u.other_arm;
        o.touching += select(m[0] > zero, constant(1), zero);
      }
      live_.push_back(g.contact);
      u.linear = linearize_grip(*parameters_, m[0], k.position + u.arm - anchor);
      if (g.object < 0) add_contact(u, work_.bodies[static_cast<std::size_t>(g.body)]);
    }
  }

  /// Now that it is known how many contacts share each object, lets it give way.
  [[gnu::noinline]] void share_objects() noexcept {
    const S dt = constant(parameters_->dt);
    const auto yield = [&](ContactWork& u, const ObjectWork<S>& o) {
      u.linear = yielding(u.linear, core::max(o.touching, constant(1)) * o.mobility.at(u.other_arm), other_free_velocity(o.body, u), dt);
      add_contact(u, work_.bodies[static_cast<std::size_t>(u.body)]);
    };
    for (Object& o : objects_)
      for (std::size_t f = 0; f < model_->features.size(); ++f)
        if (contacts_[o.first_contact + f].active) yield(contacts_[o.first_contact + f], o.work);
    for (Grip& g : grips_)
      if (g.object >= 0 && contacts_[g.contact].active)
        yield(contacts_[g.contact], objects_[static_cast<std::size_t>(g.object)].work);
  }

  void place_segment(SelfSegment& s) noexcept {
    const BodyWork<S>& k = work_.bodies[s.body];
    const FeatureNumbers<S>& n = numbers_.features[s.feature];
    s.center = k.position + k.rotation * n.center;
    s.half_axis = k.rotation * n.half_axis;
    // The millimetre is more than rounding can come to.
    s.reach = norm(s.half_axis) + n.radius + constant(1e-3);
  }

  [[gnu::noinline]] void find_self_collisions() noexcept {
    const S zero = constant(0);
    for (std::size_t i = 0; i < self_force_.size(); ++i) self_force_[i] = self_moment_[i] = Vector3::zero();
    for (SelfSegment& s : segments_) place_segment(s);
    for (const SelfPair& pair : pairs_) {
      const auto a = static_cast<std::size_t>(pair.a), b = static_cast<std::size_t>(pair.b);
      const BodyWork<S>&ka = work_.bodies[a], &kb = work_.bodies[b];
      const S reach = numbers_.bodies[a].reach + numbers_.bodies[b].reach;
      if (!core::any(squared_norm(ka.position - kb.position) < reach * reach)) continue;
      for (const auto& [sa, sb] : pair.segments) {
        const SelfSegment &first = segments_[sa], &second = segments_[sb];
        const S near = first.reach + second.reach;
        if (!core::any(squared_norm(first.center - second.center) < near * near)) continue;
        const FeatureNumbers<S>&na = numbers_.features[first.feature], &nb = numbers_.features[second.feature];
        const SegmentPair<S> closest = closest_points(first.center, first.half_axis, second.center, second.half_axis);
        const Vector3 d = closest.on_a - closest.on_b;
        const S distance = norm(d), depth = na.radius + nb.radius - distance;
        if (!core::any(depth > zero)) continue;
        const Vector3 normal = (constant(1) / core::max(distance, constant(1e-9))) * d;
        const Vector3 point = closest.on_b + (nb.radius - constant(0.5) * depth) * normal;
        const Vector3 arm_a = point - ka.position, arm_b = point - kb.position;
        const Vector3 relative = ka.linear + cross(ka.angular, arm_a) - kb.linear - cross(kb.angular, arm_b);
        const Vector3 f = self_collision_force(*parameters_, depth, normal, -dot(relative, normal));
        self_force_[a] += f;
        self_moment_[a] += cross(arm_a, f);
        self_force_[b] -= f;
        self_moment_[b] -= cross(arm_b, f);
      }
    }
  }

  /// Contacts with boxes and objects and grips after the accelerations are known; then the objects themselves.
  [[gnu::noinline]] void settle_extras(const Vector3& center, Vector3& force, Vector3& moment) noexcept {
    const S dt = constant(parameters_->dt);
    const Vector3 still = Vector3::zero();
    const auto external = [&](const ContactWork& u, const Vector3& f) {
      const auto body = static_cast<std::size_t>(u.body);
      force += f;
      moment += cross(work_.bodies[body].position + u.arm - center, f);
      body_force_[body] += f;
    };
    if (has_boxes_)
      for (const std::size_t c : live_) {
        if (c < touches_first_ || c >= touches_first_ + 2 * model_->features.size()) continue;
        ContactWork& u = contacts_[c];
        S* m = state_.data() + touch_memory(0) + touch_numbers * static_cast<std::ptrdiff_t>(c - touches_first_);
        external(u, settle_touch(u, work_.bodies[static_cast<std::size_t>(u.body)], m, still, still));
        add_slide(static_cast<std::size_t>(u.body), u.memory);
        remember_box(u, m);
      }
    const auto implicit = [&](const ContactWork& u) {
      return u.linear.force - u.linear.resistance * velocity_after(u, work_.bodies[static_cast<std::size_t>(u.body)]);
    };
    const auto pass_on = [&](Object& o, const ContactWork& u, const Vector3& f) {
      o.work.force -= f;
      o.work.moment -= cross(u.other_arm, f);
    };
    for (Grip& g : grips_) {
      ContactWork& u = contacts_[g.contact];
      if (!u.active) continue;
      S* m = state_.data() + g.at;
      const Vector3 f = implicit(u);
      external(u, f);
      g.force += f;
      if (g.object >= 0) pass_on(objects_[static_cast<std::size_t>(g.object)], u, f);
      m[0] = select(squared_norm(f) > m[4] * m[4], constant(0), m[0]);
    }
    for (Object& o : objects_) {
      for (std::size_t f = 0; f < model_->features.size(); ++f)
        if (contacts_[o.first_contact + f].active) pass_on(o, contacts_[o.first_contact + f], implicit(contacts_[o.first_contact + f]));
      BodyWork<S>& k = o.work.body;
      const auto answer = o.work.mobility.answer(o.work.moment, o.work.force);
      k.alpha += answer.angular;
      k.acceleration += answer.linear;
      o.work.impulse += dt * o.work.force;
      for (std::size_t f = 0; f < model_->features.size(); ++f) {
        ContactWork& u = contacts_[o.first_contact + f];
        if (!u.active) continue;
        S* m = state_.data() + o.character + ground_numbers * static_cast<std::ptrdiff_t>(f);
        external(u, settle_touch(u, work_.bodies[static_cast<std::size_t>(u.body)], m, other_velocity(k, u), other_free_velocity(k, u)));
      }
      for (std::size_t c = 0; c < o.own_ground.size(); ++c)
        if (o.own_ground[c].active)
          settle_touch(o.own_ground[c], k, state_.data() + o.ground + ground_numbers * static_cast<std::ptrdiff_t>(c), still, still);
      for (std::size_t c = 0; c < o.own_touches.size(); ++c) {
        ContactWork& u = o.own_touches[c];
        if (!u.active) continue;
        S* m = state_.data() + o.touches + touch_numbers * static_cast<std::ptrdiff_t>(c);
        settle_touch(u, k, m, still, still);
        remember_box(u, m);
      }
      S* x = state_.data() + o.at;
      const Vector3 linear = k.linear + dt * k.acceleration, angular = k.angular + dt * k.alpha;
      linear.store(x + 7);
      (Vector3::from(x) + dt * linear).store(x);
      const core::Quaternion<S> turned = (core::exp_map_small(dt * angular) * core::Quaternion<S>::from(x + 3)).normalized();
      turned.store(x + 3);
      // The spin that the turned body has with the angular momentum that forces gave it.
      const Vector3 momentum = k.inertia * angular + dt * cross(k.angular, k.inertia * k.angular);
      const core::Matrix3<S> r = turned.matrix();
      const Vector3 local = transpose_times(r, momentum);
      (r * Vector3{local.x / o.work.inertia.x, local.y / o.work.inertia.y, local.z / o.work.inertia.z}).store(x + 10);
    }
  }

  const Model* model_;
  const Parameters* parameters_;
  const Ground<T>* ground_;
  Numbers<S> numbers_;
  DynamicsWork<S> work_;
  bool obstacles_;
  bool own_places_ = false;
  bool has_boxes_ = false;  ///< whether any lane has had boxes
  std::vector<S> state_, target_;
  S gravity_, friction_;
  S highest_;                        ///< no lane's ground is above this, m
  std::vector<T> widest_;            ///< of each contact sphere over the lanes, m
  std::vector<Place> places_;
  std::vector<Obstacle<S>> near_;    ///< boxes near the character, each lane's own
  std::vector<int> candidates_;
  std::vector<std::uint8_t> touching_;  ///< of each body, whether it was near a box
  std::vector<std::size_t> live_;     ///< active contacts in contacts_ beyond those with the ground
  std::vector<Object> objects_;
  std::vector<Grip> grips_;
  std::vector<SelfPair> pairs_;
  std::vector<SelfSegment> segments_;
  std::vector<Vector3> self_force_, self_moment_;
  std::size_t touches_first_ = 0;
  std::ptrdiff_t taken_ = 0;  ///< numbers of the state given away so far
  std::vector<ContactWork> contacts_;
  std::vector<Vector3> push_force_, push_arm_, body_force_;
  std::vector<LoadedSlide<S>> body_slide_;
  LaneMask failed_;
  bool pushed_ = false;
  T last_seconds_ = 0;
};

template <class S>
[[gnu::flatten]] void Lanes<S>::step(int count) noexcept {
  for (auto& f : body_force_) f = Vector3::zero();
  for (auto& m : body_slide_) m = {constant(0), constant(0)};
  refresh();
  if (has_boxes_) look_around(count);
  for (Object& o : objects_) o.work.impulse = Vector3::zero();
  for (Grip& g : grips_) g.force = Vector3::zero();
  // A restored lane may remember contacts that this group did not have: the first step looks at every memory.
  for (ContactWork& c : contacts_) c.active = true;
  std::fill(touching_.begin(), touching_.end(), std::uint8_t{1});
  for (Object& o : objects_) o.touching = 1;
  for (int s = 0; s < count; ++s) advance();
  last_seconds_ = static_cast<T>(count * parameters_->dt);
  const S share(static_cast<T>(1.0 / count));
  for (auto& f : body_force_) f *= share;
  for (auto& m : body_slide_) {
    m.load *= share;
    m.sum *= share;
  }
  for (Grip& g : grips_) g.force *= share;
  if (pushed_) {
    for (auto& f : push_force_) f = Vector3::zero();
    pushed_ = false;
  }
  freeze_failed();
}

}  // namespace traceur::sim
