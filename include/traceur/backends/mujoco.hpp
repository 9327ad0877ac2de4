// SPDX-License-Identifier: MIT
#pragma once

#include <mujoco/mujoco.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "traceur/backends/detail/engine.hpp"
#include "traceur/sim/simulator.hpp"

namespace traceur::backends {

/// How hard MuJoCo's ground is.
enum class MujocoGround {
  stiff,  ///< as stiff as the time step allows
  given,  ///< a spring and a damper of the parameters' constants at every point that touches
};

/// MuJoCo as a `sim::Simulator`: Euler integration with motors taken implicitly, Newton solver, elliptic friction cones.
///
/// The engine's model is made from the character, welds merged; the bodies touch the scene and not one another. Grips and,
/// unless the ground is to be as given, contacts are as stiff as the time step allows, and friction constraints a hundred
/// times stiffer than normal ones, which keeps standing feet where they are. Motors and stops follow the bundled simulator's
/// law. Of the parameters dt, gravity, friction and the stops' constants are used, and of given ground contact_stiffness and
/// contact_damping. Lanes share one model; an object is for one thread at a time.
class Mujoco {
 public:
  /// Throws Error, one line, when the character or the parameters are refused, by us or by MuJoCo.
  Mujoco(const body::Character& character, int lanes, const sim::Parameters& parameters = {}, const sim::Scene& scene = {},
         MujocoGround ground = MujocoGround::stiff)
      : parameters_(parameters), prepared_(sim::make_model(character)), neutral_(character.skeleton.neutral_pose()) {
    parameters.check();
    detail::check_engine("mujoco", prepared_, lanes);
    compile(scene);
    if (ground == MujocoGround::given) soften();
    find_addresses();
    const auto n = static_cast<std::size_t>(lanes);
    lanes_.resize(n);
    before_ = Eigen::VectorXd::Zero(prepared_.nv);
    for (int i = 0; i < lanes; ++i) {
      Lane& l = lane(i);
      l.data.reset(mj_makeData(model_.get()));
      if (!l.data) throw Error("mujoco: no memory for lane " + std::to_string(i));
      l.target = l.q = neutral_;
      l.v = before_;
      l.rate.assign(prepared_.bodies.size(), core::Vector3<double>::zero());
      l.push_force = l.push_point = l.contact = l.grip_sum = l.rate;
      l.grips.resize(prepared_.bodies.size());
      start(l);
    }
  }

  int lanes() const { return static_cast<int>(lanes_.size()); }
  const body::Character& character() const { return prepared_.character; }
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
    l.pushed = true;
  }

  /// Ties a point of a joint's frame (m) to a place in the world (m) by a ball joint, until released or reset. A body holds
  /// one place at a time, the last asked for; what is welded together is one body.
  void hold(int index, int joint, const core::Vector3<double>& point, const core::Vector3<double>& anchor) {
    const int b = carrier(joint);
    if (b >= 0) lane(index).grips[static_cast<std::size_t>(b)] = {true, on_carrier(joint, point), anchor};
  }
  void release(int index, int joint) {
    const int b = carrier(joint);
    if (b >= 0) lane(index).grips[static_cast<std::size_t>(b)].held = false;
  }

  /// Mean contact force on a joint's body, and all that is welded to it, over the last call of `step`, N, world.
  core::Vector3<double> contact_force(int index, int joint) const { return mean(index, joint, &Lane::contact); }
  /// Mean force of a grip on a joint's body over the last call of `step`, N, world.
  core::Vector3<double> grip_force(int index, int joint) const { return mean(index, joint, &Lane::grip_sum); }

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
  /// Whether a lane met a number that is not finite, or that MuJoCo takes for a diverged one, since it was reset. Such a
  /// lane was put at rest into the neutral pose.
  bool failed(int index) const { return lane(index).failed; }

 private:
  struct Free {
    void operator()(mjModel* m) const { mj_deleteModel(m); }
    void operator()(mjData* d) const { mj_deleteData(d); }
  };
  struct Grip {
    bool held = false;
    core::Vector3<double> point{0, 0, 0}, anchor{0, 0, 0};
  };
  struct Lane {
    std::unique_ptr<mjData, Free> data;
    Eigen::VectorXd q, v, target;
    std::vector<core::Vector3<double>> rate;  ///< joint accelerations of the last time step
    std::vector<core::Vector3<double>> push_force, push_point, contact, grip_sum;
    std::vector<Grip> grips;
    bool pushed = false, failed = false;
  };
  /// Where a moving body's joint lies in MuJoCo's arrays.
  struct Address {
    int body = 0, q = 0, v = 0, equality = 0;
  };

  // A count that no warning reaches: MuJoCo prints and logs the first of each kind only, and a reset of its own shows.
  static constexpr int quiet = 1 << 20;

  Lane& lane(int i) { return lanes_[static_cast<std::size_t>(i)]; }
  const Lane& lane(int i) const { return lanes_[static_cast<std::size_t>(i)]; }
  int carrier(int joint) const { return prepared_.moving_of_joint[static_cast<std::size_t>(joint)]; }
  core::Vector3<double> on_carrier(int joint, const core::Vector3<double>& point) const {
    return prepared_.on_moving_body(joint, point);
  }
  core::Vector3<double> mean(int index, int joint, std::vector<core::Vector3<double>> Lane::*sums) const {
    const int b = carrier(joint);
    return b < 0 ? core::Vector3<double>::zero() : (lane(index).*sums)[static_cast<std::size_t>(b)];
  }

  static void number(std::string& out, double x) {
    std::array<char, 32> buffer;
    const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), x).ptr;
    out.append(buffer.data(), end);
    out += ' ';
  }
  template <class... X>
  static std::string text(const X&... x) {
    std::string out = "\"";
    (number(out, static_cast<double>(x)), ...);
    out.back() = '"';
    return out;
  }
  static std::string text(const core::Vector3<double>& v) { return text(v.x, v.y, v.z); }
  static std::string text(const core::Quaternion<double>& q) { return text(q.w, q.x, q.y, q.z); }

  static void append_box(std::string& out, const terrain::Box& b) {
    out += "<geom type=\"box\" pos=" + text(b.center) + " quat=" + text(b.rotation) + " size=" + text(b.half_size) + "/>\n";
  }

  void append_shapes(std::string& out, int moving) const {
    for (const body::Shape& s : prepared_.character.shapes) {
      if (carrier(s.body) != moving) continue;
      const core::Quaternion<double> turn = prepared_.welded_rotation[static_cast<std::size_t>(s.body)] * s.rotation;
      out += "<geom class=\"character\" pos=" + text(on_carrier(s.body, s.position)) + " quat=" + text(turn);
      if (s.kind == body::Shape::Kind::sphere) out += " type=\"sphere\" size=" + text(s.size.x);
      if (s.kind == body::Shape::Kind::capsule) out += " type=\"capsule\" size=" + text(s.size.x, s.size.y);
      if (s.kind == body::Shape::Kind::box) out += " type=\"box\" size=" + text(s.size);
      out += "/>\n";
    }
  }

  void append_body(std::string& out, int index) const {
    const sim::MovingBody& b = prepared_.bodies[static_cast<std::size_t>(index)];
    const std::string name = std::to_string(index);
    out += "<body name=\"b" + name + "\" pos=" + text(b.offset) + " quat=" + text(b.rest) + ">\n";
    if (b.type == body::JointType::free) out += "<freejoint name=\"j" + name + "\"/>\n";
    if (b.type != body::JointType::free) {
      const bool hinge = b.type == body::JointType::hinge;
      out += "<joint name=\"j" + name + (hinge ? "\" type=\"hinge\" axis=" + text(b.axis) : "\" type=\"ball\"") +
             " armature=" + text(b.actuator.armature) + "/>\n";
    }
    const body::Inertia merged = detail::merged_inertia(b);
    detail::PrincipalInertia inertia = detail::principal_inertia(merged.about_center);
    core::Vector3<double>& m = inertia.moments;
    // MuJoCo wants moments of which no one exceeds the others' sum, and forgives no rounding.
    const double least = 1e-7 * (m.x + m.y + m.z);
    m = {m.x + least, m.y + least, m.z + least};
    out += "<inertial pos=" + text(merged.center) + " quat=" + text(inertia.axes) + " mass=" + text(b.mass) +
           " diaginertia=" + text(m) + "/>\n";
    append_shapes(out, index);
    for (std::size_t child = 0; child < prepared_.bodies.size(); ++child)
      if (prepared_.bodies[child].parent == index) append_body(out, static_cast<int>(child));
    out += "</body>\n";
  }

  std::string describe(const sim::Scene& scene) const {
    const sim::Parameters& p = parameters_;
    const auto shapes = prepared_.character.shapes.size(), bodies = prepared_.bodies.size();
    const std::size_t contacts = 50 + 10 * shapes;
    std::string out = "<mujoco>\n<compiler angle=\"radian\" inertiafromgeom=\"false\" autolimits=\"false\"/>\n";
    out += "<option timestep=" + text(p.dt) + " gravity=" + text(0, 0, -p.gravity) +
           " integrator=\"Euler\" solver=\"Newton\" cone=\"elliptic\" impratio=\"100\" tolerance=\"1e-10\"/>\n";
    out += "<size nconmax=" + text(contacts) + " njmax=" + text(3 * contacts + 3 * bodies) + "/>\n";
    const std::string stiff = " solref=" + text(2.5 * p.dt, 1);
    const std::string friction = " friction=" + text(p.friction, 0, 0) + stiff + " solimp=\"0.95 0.99 0.001\" condim=\"3\"";
    out += "<default><geom contype=\"0\" conaffinity=\"1\"" + friction + "/>";
    out += "<default class=\"character\"><geom contype=\"1\" conaffinity=\"0\"" + friction + "/></default></default>\n";
    out += "<worldbody>\n";
    const sim::Ground<double>& g = scene.ground;
    if (g.grid()) {
      for (const terrain::Box& b : detail::columns(*g.grid(), 1000, 10)) append_box(out, b);
    } else {
      out += "<geom type=\"plane\" size=\"0 0 1\" pos=" + text(g.offset() * g.normal()) + " zaxis=" + text(g.normal()) + "/>\n";
    }
    for (const terrain::Box& b : scene.boxes.boxes()) append_box(out, b);
    for (std::size_t b = 0; b < bodies; ++b)
      if (prepared_.bodies[b].parent < 0) append_body(out, static_cast<int>(b));
    out += "</worldbody>\n<equality>\n";
    for (std::size_t b = 0; b < bodies; ++b)
      out += "<connect active=\"false\" anchor=\"0 0 0\" name=\"g" + std::to_string(b) + "\" body1=\"b" + std::to_string(b) +
             "\" solref=" + text(2 * p.dt, 1) + " solimp=\"0.99 0.999 0.001\"/>\n";
    return out + "</equality>\n</mujoco>\n";
  }

  void compile(const sim::Scene& scene) {
    const std::string description = describe(scene);
    const auto files = std::make_unique<mjVFS>();
    mj_defaultVFS(files.get());
    constexpr const char* name = "character.xml";
#if mjVERSION_HEADER >= 302
    mj_addBufferVFS(files.get(), name, description.data(), static_cast<int>(description.size()));
#else
    mj_makeEmptyFileVFS(files.get(), name, static_cast<int>(description.size()));
    std::memcpy(files->filedata[mj_findFileVFS(files.get(), name)], description.data(), description.size());
#endif
    std::array<char, 1000> message{};
    model_.reset(mj_loadXML(name, files.get(), message.data(), static_cast<int>(message.size())));
    mj_deleteVFS(files.get());
    if (model_) return;
    std::string line(message.data());
    std::replace(line.begin(), line.end(), '\n', ' ');
    throw Error("mujoco: character '" + prepared_.character.name + "': " + line);
  }

  /// MuJoCo's constraint force is D (-b v - k d r - a), with r the penetration, v its rate, a its acceleration and the
  /// regulariser D = d / ((1 - d) A) of an impedance d, A the inverse mass of the body that the model was compiled with. So D
  /// is an inertia that the ground adds, D k d its stiffness and D b its damping, which acts at the old velocity and needs
  /// b dt < 1: D = 2 dt contact_damping is the least inertia that leaves a margin of two.
  void soften() {
    mjModel& m = *model_;
    const sim::Parameters& p = parameters_;
    const double inertia = std::max(2 * p.dt * p.contact_damping, 1e-3);
    for (int g = 0; g < m.ngeom; ++g) {
      const int body = m.geom_bodyid[g];
      if (body == 0) continue;
      const double share = inertia * m.body_invweight0[2 * body], d = std::min(share / (1 + share), 0.9999);
      m.geom_priority[g] = 1;
      mjtNum* reference = m.geom_solref + mjNREF * g;
      mjtNum* impedance = m.geom_solimp + mjNIMP * g;
      reference[0] = -d * std::max(p.contact_stiffness, 1e-3) / inertia;
      reference[1] = -d * std::max(p.contact_damping, 1e-3) / inertia;
      impedance[0] = impedance[1] = d;
    }
  }

  void find_addresses() {
    addresses_.resize(prepared_.bodies.size());
    moving_of_body_.assign(static_cast<std::size_t>(model_->nbody), -1);
    moving_of_equality_.assign(static_cast<std::size_t>(model_->neq), -1);
    for (std::size_t b = 0; b < addresses_.size(); ++b) {
      const std::string name = std::to_string(b);
      Address& a = addresses_[b];
      a.body = mj_name2id(model_.get(), mjOBJ_BODY, ("b" + name).c_str());
      a.equality = mj_name2id(model_.get(), mjOBJ_EQUALITY, ("g" + name).c_str());
      const int joint = mj_name2id(model_.get(), mjOBJ_JOINT, ("j" + name).c_str());
      a.q = model_->jnt_qposadr[joint];
      a.v = model_->jnt_dofadr[joint];
      moving_of_body_[static_cast<std::size_t>(a.body)] = static_cast<int>(b);
      moving_of_equality_[static_cast<std::size_t>(a.equality)] = static_cast<int>(b);
    }
  }

  /// Everything anew from the lane's q and v.
  void start(Lane& l) {
    mjData* d = l.data.get();
    mj_resetData(model_.get(), d);
    for (auto& w : d->warning) w.number = quiet;
    for (auto* list : {&l.rate, &l.push_force, &l.push_point, &l.contact, &l.grip_sum})
      std::fill(list->begin(), list->end(), core::Vector3<double>::zero());
    std::fill(l.grips.begin(), l.grips.end(), Grip{});
    l.pushed = false;
    for (std::size_t i = 0; i < addresses_.size(); ++i) {
      const sim::MovingBody& b = prepared_.bodies[i];
      double* q = d->qpos + addresses_[i].q;
      double* v = d->qvel + addresses_[i].v;
      const double* qj = l.q.data() + b.q_index;
      const double* vj = l.v.data() + b.v_index;
      if (b.type == body::JointType::hinge) {
        q[0] = qj[0];
        v[0] = vj[0];
        continue;
      }
      const bool free = b.type == body::JointType::free;
      core::Quaternion<double> r = core::Quaternion<double>::from(qj + (free ? 3 : 0));
      if (free) {
        r = b.rest * r;
        std::copy_n(qj, 3, q);
        std::copy_n(vj, 3, v);
        // MuJoCo's angular velocity of a free body is in the body's axes.
        r.conjugate().rotate(core::Vector3<double>::from(vj + 3)).store(v + 3);
        q += 3;
      } else {
        std::copy_n(vj, 3, v);
      }
      q[0] = r.w;
      r.vec().store(q + 1);
    }
  }

  void read(Lane& l) const {
    const mjData* d = l.data.get();
    for (std::size_t i = 0; i < addresses_.size(); ++i) {
      const sim::MovingBody& b = prepared_.bodies[i];
      const double* q = d->qpos + addresses_[i].q;
      const double* v = d->qvel + addresses_[i].v;
      double* qj = l.q.data() + b.q_index;
      double* vj = l.v.data() + b.v_index;
      if (b.type == body::JointType::hinge) {
        qj[0] = q[0];
        vj[0] = v[0];
        continue;
      }
      const bool free = b.type == body::JointType::free;
      const double* w = q + (free ? 3 : 0);
      const core::Quaternion<double> r{w[1], w[2], w[3], w[0]};
      std::copy_n(v, 3, vj);
      if (free) {
        std::copy_n(q, 3, qj);
        (b.rest.conjugate() * r).store(qj + 3);
        r.rotate(core::Vector3<double>::from(v + 3)).store(vj + 3);
      } else {
        r.store(qj);
      }
    }
  }

  void set_drives(Lane& l) {
    mjData* d = l.data.get();
    for (std::size_t i = 0; i < addresses_.size(); ++i) {
      const sim::MovingBody& b = prepared_.bodies[i];
      if (b.type == body::JointType::free) continue;
      const detail::Drive drive =
          detail::drive(b, parameters_, parameters_.dt, l.q.data(), l.v.data(), l.target.data(), l.rate[i]);
      // A damper at the velocity that the step ends with is one at the velocity that it begins with, and inertia dt times as
      // large. MuJoCo's own implicit damping knows nothing of contacts, nor they of it.
      const double damping = drive.motor_damping + drive.stop_damping;
      const double inertia = b.actuator.armature + parameters_.dt * damping;
      double* applied = d->qfrc_applied + addresses_[i].v;
      double* armature = model_->dof_armature + addresses_[i].v;
      const bool ball = b.type == body::JointType::ball;
      const double* v = l.v.data() + b.v_index;
      const core::Vector3<double> speed{v[0], ball ? v[1] : 0, ball ? v[2] : 0};
      const core::Vector3<double> torque = drive.motor + drive.stop - damping * speed;
      applied[0] = torque.x;
      armature[0] = inertia;
      if (!ball) continue;
      applied[1] = torque.y;
      applied[2] = torque.z;
      armature[1] = armature[2] = inertia;
    }
  }

  void set_grips(Lane& l) {
    for (std::size_t i = 0; i < addresses_.size(); ++i) {
      const Grip& g = l.grips[i];
#if mjVERSION_HEADER >= 300
      l.data->eq_active[addresses_[i].equality] = g.held;
#else
      model_->eq_active[addresses_[i].equality] = g.held;
#endif
      if (!g.held) continue;
      double* at = model_->eq_data + mjNEQDATA * addresses_[i].equality;
      g.point.store(at);
      g.anchor.store(at + 3);
    }
  }

  void apply_pushes(Lane& l) {
    mjData* d = l.data.get();
    for (std::size_t i = 0; i < addresses_.size(); ++i) {
      const int body = addresses_[i].body;
      const double* x = d->xpos + 3 * body;
      const double* r = d->xquat + 4 * body;
      const core::Vector3<double> point =
          core::Vector3<double>::from(x) + core::Quaternion<double>{r[1], r[2], r[3], r[0]}.rotate(l.push_point[i]);
      double* applied = d->xfrc_applied + 6 * body;
      l.push_force[i].store(applied);
      cross(point - core::Vector3<double>::from(d->xipos + 3 * body), l.push_force[i]).store(applied + 3);
    }
  }

  void add_forces(Lane& l) const {
    mjData* d = l.data.get();
    for (int c = 0; c < d->ncon; ++c) {
      const mjContact& contact = d->contact[c];
      if (contact.efc_address < 0) continue;
      std::array<double, 6> f{};
      mj_contactForce(model_.get(), d, c, f.data());
      const double* r = contact.frame;
      // Rows of the frame; the first points from the first shape to the second, which the force is on.
      const core::Vector3<double> force{r[0] * f[0] + r[3] * f[1] + r[6] * f[2], r[1] * f[0] + r[4] * f[1] + r[7] * f[2],
                                        r[2] * f[0] + r[5] * f[1] + r[8] * f[2]};
      const int first = moving_of_body_[static_cast<std::size_t>(model_->geom_bodyid[contact.geom1])];
      const int second = moving_of_body_[static_cast<std::size_t>(model_->geom_bodyid[contact.geom2])];
      if (first >= 0) l.contact[static_cast<std::size_t>(first)] -= force;
      if (second >= 0) l.contact[static_cast<std::size_t>(second)] += force;
    }
    for (int e = 0; e + 2 < d->nefc; e += 3) {
      // Equality constraints come first, three rows each.
      if (d->efc_type[e] != mjCNSTR_EQUALITY) break;
      const int b = moving_of_equality_[static_cast<std::size_t>(d->efc_id[e])];
      l.grip_sum[static_cast<std::size_t>(b)] += core::Vector3<double>::from(d->efc_force + e);
    }
  }

  static bool diverged(const mjData* d) {
    for (const int kind : {mjWARN_BADQPOS, mjWARN_BADQVEL, mjWARN_BADQACC})
      if (d->warning[kind].number != quiet) return true;
    return false;
  }

  void advance(Lane& l, int count) {
    mjData* d = l.data.get();
    for (auto* sums : {&l.contact, &l.grip_sum}) std::fill(sums->begin(), sums->end(), core::Vector3<double>::zero());
    set_grips(l);
    for (int s = 0; s < count; ++s) {
      set_drives(l);
      mj_step1(model_.get(), d);
      if (l.pushed) apply_pushes(l);
      if (!diverged(d)) mj_step2(model_.get(), d);
      const bool finite = l.q.allFinite() && l.v.allFinite();
      before_ = l.v;
      read(l);
      if (diverged(d) || !finite || !l.q.allFinite() || !l.v.allFinite()) {
        fail(l);
        return;
      }
      add_forces(l);
      for (std::size_t i = 0; i < addresses_.size(); ++i) {
        const sim::MovingBody& b = prepared_.bodies[i];
        const double* v = l.v.data() + b.v_index;
        const double* u = before_.data() + b.v_index;
        l.rate[i].x = (v[0] - u[0]) / parameters_.dt;
        if (b.type != body::JointType::ball) continue;
        l.rate[i].y = (v[1] - u[1]) / parameters_.dt;
        l.rate[i].z = (v[2] - u[2]) / parameters_.dt;
      }
    }
    const double share = count > 0 ? 1.0 / count : 0;
    for (std::size_t i = 0; i < addresses_.size(); ++i) {
      l.contact[i] *= share;
      l.grip_sum[i] *= share;
      l.push_force[i] = core::Vector3<double>::zero();
    }
    if (l.pushed) std::fill_n(d->xfrc_applied, 6 * model_->nbody, 0.0);
    l.pushed = false;
  }

  void fail(Lane& l) {
    l.q = l.target = neutral_;
    l.v.setZero();
    start(l);
    l.failed = true;
  }

  sim::Parameters parameters_;
  sim::Model prepared_;
  Eigen::VectorXd neutral_, before_;
  std::unique_ptr<mjModel, Free> model_;
  std::vector<Address> addresses_;
  std::vector<int> moving_of_body_, moving_of_equality_;
  std::vector<Lane> lanes_;
};

}  // namespace traceur::backends
