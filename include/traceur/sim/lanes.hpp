// SPDX-License-Identifier: MIT
#pragma once

#include <memory>

#include "traceur/sim/contact.hpp"
#include "traceur/sim/dynamics.hpp"
#include "traceur/sim/ground.hpp"

namespace traceur::sim {

/// As many independent characters as the scalar S has lanes, stepped together. `World` is the usual way to hold them.
///
/// State is one flat array per lane: pose, velocity, joint accelerations of the last step (they predict which motors will
/// saturate) and contact memories. Copying it out and in restores a lane exactly.
///
/// One step of dt: articulated-body dynamics with joint springs, contacts and stops implicit in velocity, velocities first
/// and positions with the new velocities. Motors are exact: a motor that would pass its torque limit is given the limit as
/// a constant torque and the pass is repeated. Integration errors in whole-body momentum are removed by a rigid correction
/// of all velocities (and, in free flight, of position), so momenta change by external impulses only.
template <class S>
class Lanes {
 public:
  using T = core::Element<S>;
  using Vector3 = core::Vector3<S>;
  static constexpr int width = core::lane_count<S>;

  Lanes(const Model& model, const Parameters& parameters, const Ground<T>& ground)
      : model_(&model),
        parameters_(&parameters),
        ground_(&ground),
        work_(model),
        state_(static_cast<std::size_t>(state_size(model)), S(0.0)),
        target_(static_cast<std::size_t>(model.nq), S(0.0)),
        contacts_(model.contacts.size()),
        push_force_(model.bodies.size(), Vector3::zero()),
        push_arm_(model.bodies.size(), Vector3::zero()),
        body_force_(model.bodies.size(), Vector3::zero()) {
    const Eigen::VectorXd neutral = model.character.skeleton.neutral_pose();
    for (int i = 0; i < model.nq; ++i) {
      q()[i] = S(static_cast<T>(neutral[i]));
      target_[static_cast<std::size_t>(i)] = S(static_cast<T>(neutral[i]));
    }
    failed_ = none();
    refresh();
  }

  /// Numbers in a lane's state.
  static int state_size(const Model& m) { return m.nq + 2 * m.nv + 5 * static_cast<int>(m.contacts.size()); }

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

  /// Recomputes frames and momenta; needed after the state was written from outside.
  void refresh() { update_kinematics(*model_, q(), v(), work_); }

  /// Advances all lanes by `count` time steps towards the joint targets.
  [[gnu::flatten]] void step(int count) noexcept {
    for (auto& f : body_force_) f = Vector3::zero();
    refresh();
    // A restored lane may remember contacts that this group did not have: the first step looks at every memory.
    for (ContactWork& c : contacts_) c.active = true;
    for (int s = 0; s < count; ++s) advance();
    const S share(static_cast<T>(1.0 / count));
    for (auto& f : body_force_) f *= share;
    if (pushed_) {
      for (auto& f : push_force_) f = Vector3::zero();
      pushed_ = false;
    }
    freeze_failed();
  }

 private:
  using LaneMask = core::MaskOf<S>;
  struct ContactWork {
    bool active = false;
    S depth;
    Vector3 normal, arm, velocity, centripetal;
    LinearContact<S> linear;
  };

  static LaneMask none() { return S(0.0) < S(0.0); }
  static void set_mask(LaneMask& mask, int lane, bool value) {
    if constexpr (std::is_same_v<LaneMask, bool>) {
      mask = value;
    } else {
      mask.set(lane, value);
    }
  }
  [[gnu::always_inline]] static S constant(double x) { return S(static_cast<T>(x)); }

  S* rates() { return state_.data() + model_->nq + model_->nv; }
  S* memory(std::size_t contact) {
    return state_.data() + model_->nq + 2 * model_->nv + 5 * static_cast<std::ptrdiff_t>(contact);
  }

  [[gnu::always_inline]] void advance() {
    const Parameters& p = *parameters_;
    const S dt = constant(p.dt);
    load_inertias(*model_, constant(p.gravity), work_);
    find_contacts();
    if (pushed_) add_pushes();
    prepare_joints();
    solve();

    const Vector3 center = work_.center_of_mass;
    Vector3 force = Vector3::zero(), moment = Vector3::zero();
    settle_contacts(center, force, moment);
    const auto in_flight = !(constant(0) < squared_norm(force));
    if (pushed_)
      for (std::size_t i = 0; i < push_force_.size(); ++i) {
        const BodyWork<S>& k = work_.bodies[i];
        force += push_force_[i];
        moment += cross(k.position + k.rotation * push_arm_[i] - center, push_force_[i]);
      }
    force.z -= constant(p.gravity * model_->total_mass);
    const Vector3 linear = work_.linear_momentum + dt * force;
    const Vector3 angular = work_.angular_momentum + dt * moment;
    integrate();
    update_kinematics(*model_, q(), v(), work_);
    if (p.conserve_momentum && model_->bodies[0].type == body::JointType::free)
      correct_momentum(linear, angular, center + (dt * constant(1.0 / model_->total_mass)) * linear, in_flight);
  }

  [[gnu::always_inline]] void find_contacts() {
    const Parameters& p = *parameters_;
    const S friction = constant(p.friction);
    for (std::size_t i = 0; i < model_->bodies.size(); ++i) {
      const MovingBody& b = model_->bodies[i];
      BodyWork<S>& k = work_.bodies[i];
      const bool near = b.contacts > 0 && core::any(k.position.z < S(ground_->highest()) + constant(b.reach));
      for (int c = 0; c < b.contacts; ++c) {
        const auto index = static_cast<std::size_t>(b.first_contact + c);
        ContactWork& w = contacts_[index];
        const bool was_active = w.active;
        w.active = false;
        S* m = memory(index);
        if (near) {
          const ContactSphere& sphere = model_->contacts[index];
          const Vector3 center = k.rotation * sphere.center.template cast<T>().template cast<S>();
          const S radius = constant(sphere.radius);
          const Vector3 point = k.position + center;
          if (core::any(point.z < S(ground_->highest()) + radius)) {
            const GroundSample<S> sample = ground_->sample(point, static_cast<T>(sphere.radius));
            w.depth = radius - sample.distance;
            if (core::any(w.depth > constant(0))) {
              w.active = true;
              w.normal = sample.normal;
              w.arm = center - radius * sample.normal;
              w.velocity = k.linear + cross(k.angular, w.arm);
              w.centripetal = cross(k.angular, cross(k.angular, w.arm));
              const ContactMemory<S> memory{Vector3::from(m), m[3], m[4]};
              w.linear = linearize_contact(p, friction, w.depth, w.normal, w.velocity, memory);
              add_contact(w, k);
            }
          }
        }
        if (!w.active && was_active)
          for (int n = 0; n < 5; ++n) m[n] = constant(0);
      }
    }
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
      const S kp = constant(a.stiffness), kv = constant(a.stiffness * p.dt + a.damping);
      const S inertia = constant(p.dt * (a.stiffness * p.dt + a.damping));
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
        const S limit = constant(a.torque_limit);
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
        load_inertias(*model_, constant(parameters_->gravity), work_);
        for (std::size_t c = 0; c < contacts_.size(); ++c)
          if (contacts_[c].active) add_contact(contacts_[c], work_.bodies[static_cast<std::size_t>(model_->contacts[c].body)]);
        if (pushed_) add_pushes();
      }
      articulated_body(*model_, work_);
      LaneMask beyond = none();
      for (std::size_t i = 0; i < model_->bodies.size(); ++i) {
        const MovingBody& b = model_->bodies[i];
        if (b.type == body::JointType::free) continue;
        BodyWork<S>& k = work_.bodies[i];
        k.torque = k.motor - k.motor_inertia * k.joint_rate;
        if (!std::isfinite(b.actuator.torque_limit)) continue;
        beyond = beyond | (squared_norm(k.torque) > constant(b.actuator.torque_limit * b.actuator.torque_limit * 1.001));
      }
      if (pass == 2 || !core::any(beyond)) return;
      for (std::size_t i = 0; i < model_->bodies.size(); ++i) {
        const MovingBody& b = model_->bodies[i];
        if (b.type == body::JointType::free || !std::isfinite(b.actuator.torque_limit)) continue;
        BodyWork<S>& k = work_.bodies[i];
        const S limit = constant(b.actuator.torque_limit);
        const S size = norm(k.torque);
        const auto fix = beyond & (size > (pass == 0 ? constant(0.9) * limit : constant(-1)));
        const S shrink = select(size > limit, limit / core::max(size, constant(1e-20)), constant(1));
        k.motor = select(fix, shrink * k.torque, k.motor);
        k.motor_inertia = select(fix, constant(0), k.motor_inertia);
      }
    }
  }

  [[gnu::always_inline]] void settle_contacts(const Vector3& center, Vector3& force, Vector3& moment) {
    const Parameters& p = *parameters_;
    const S dt = constant(p.dt), friction = constant(p.friction);
    for (std::size_t i = 0; i < model_->bodies.size(); ++i) {
      const MovingBody& b = model_->bodies[i];
      const BodyWork<S>& k = work_.bodies[i];
      for (int c = 0; c < b.contacts; ++c) {
        const auto index = static_cast<std::size_t>(b.first_contact + c);
        ContactWork& w = contacts_[index];
        if (!w.active) continue;
        const Vector3 after = w.velocity + dt * (k.acceleration + cross(k.alpha, w.arm) + w.centripetal);
        const Vector3 f = w.linear.force - w.linear.resistance * after;
        S* m = memory(index);
        ContactMemory<S> memory{Vector3::from(m), m[3], m[4]};
        update_contact(p, friction, w.depth, w.normal, w.velocity, after, f, memory);
        memory.bristle.store(m);
        m[3] = memory.normal_force;
        m[4] = memory.sliding_speed;
        force += f;
        moment += cross(k.position + w.arm - center, f);
        body_force_[i] += f;
      }
    }
  }

  [[gnu::always_inline]] void integrate() {
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
      const S mass = constant(model_->bodies[i].mass);
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
    const Vector3 dv = constant(1.0 / model_->total_mass) * (linear - work_.linear_momentum);
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
    refresh();
  }

  const Model* model_;
  const Parameters* parameters_;
  const Ground<T>* ground_;
  DynamicsWork<S> work_;
  std::vector<S> state_, target_;
  std::vector<ContactWork> contacts_;
  std::vector<Vector3> push_force_, push_arm_, body_force_;
  LaneMask failed_;
  bool pushed_ = false;
};

}  // namespace traceur::sim
