// SPDX-License-Identifier: MIT
#include <traceur/control/controller.hpp>

#include <algorithm>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace figures;
using control::CycleCarry;
using control::full_sensors;

namespace {

using Sensors = Eigen::Matrix<double, full_sensors, 1>;

/// One state and one reference of a figure, to be read by its sensors.
struct Scene {
  const Figure& f;
  control::TrackingReference r;
  Eigen::VectorXd q, v;

  Scene(const Figure& figure, std::uint64_t seed) : f(figure) {
    core::RandomStream random(41, seed);
    r.poses = any_pose(f, random).replicate(1, 2);
    r.velocities = any_velocity(f, random).replicate(1, 2);
    const Eigen::VectorXd d = 0.3 * any_velocity(f, random);
    q.resize(f.model.nq);
    body::displace(f.skeleton(), r.poses.col(0).data(), d.data(), q.data());
    v = any_velocity(f, random);
    control::measure_reference(f.model, f.roles, f.points, r);
  }
  void mirror() {
    for (int t = 0; t < 2; ++t) {
      r.poses.col(t) = control::mirrored_pose(f.model, f.roles, r.poses.col(t));
      r.velocities.col(t) = control::mirrored_tangent(f.model, f.roles, r.velocities.col(t));
    }
    control::measure_reference(f.model, f.roles, f.points, r);
    q = control::mirrored_pose(f.model, f.roles, q);
    v = control::mirrored_tangent(f.model, f.roles, v);
  }
  Sensors read(int stance, const CycleCarry& carry = {}) const { return read(q, v, stance, carry); }
  Sensors read(const Eigen::VectorXd& pose, const Eigen::VectorXd& velocity, int stance, const CycleCarry& carry = {}) const {
    const sim::Parameters parameters;
    const sim::Ground<double> ground;
    sim::Lanes<double> lanes(f.model, parameters, ground);
    put(lanes, 0, pose, velocity);
    lanes.refresh();
    Sensors out;
    control::measure(lanes, f.model, f.roles, r, 0, carry, stance, out.data());
    return out;
  }
};

/// The rigid motion in the plane applied to a pose and a velocity.
void carried(const CycleCarry& c, Eigen::VectorXd& q, Eigen::VectorXd& v) {
  c.apply(Vector::from(q.data())).store(q.data());
  (about_axis(Vector{0, 0, 1}, c.turn) * Quaternion::from(q.data() + 3)).store(q.data() + 3);
  c.rotate(Vector::from(v.data())).store(v.data());
  c.rotate(Vector::from(v.data() + 3)).store(v.data() + 3);
}

template <class Law>
void everywhere(Law&& law) {
  for (const Figure* f : {&humanoid(), &small()})
    for (std::uint64_t k = 0; k < 4; ++k) law(Scene(*f, k));
}

/// A reference that turns while it walks.
control::TrackingReference turning_walk(const Figure& f) {
  core::RandomStream random(42);
  const Eigen::VectorXd q0 = any_pose(f, random);
  const motion::Clip clip = clip_of(
      f, "turn", 30,
      [&](double t) {
        Eigen::VectorXd q = q0, v = Eigen::VectorXd::Zero(f.model.nv);
        carried(CycleCarry{0.8 * t, 0.3 + 1.1 * t, -0.4 * t}, q, v);
        return q;
      },
      true);
  return reference_of(f, clip, clip.duration());
}

}  // namespace

TEST_CASE("on the reference the sensors read zero, off it they do not") {
  everywhere([](const Scene& s) {
    for (const int stance : {0, 1}) {
      CHECK(s.read(s.r.poses.col(0), s.r.velocities.col(0), stance).cwiseAbs().maxCoeff() < 1e-10);
      const Sensors off = s.read(stance);
      for (int k = 0; k < full_sensors; k += 3) CHECK(off.segment(k, 3).norm() > 1e-3);
    }
  });
}

TEST_CASE("a mirrored motion on its left foot reads as the motion on its right foot") {
  everywhere([](Scene s) {
    const Sensors right = s.read(0), left = s.read(1);
    s.mirror();
    CHECK((s.read(1) - right).cwiseAbs().maxCoeff() < 1e-10);
    CHECK((s.read(0) - left).cwiseAbs().maxCoeff() < 1e-10);
    CHECK((s.read(0) - right).cwiseAbs().maxCoeff() > 1e-2);
  });
}

TEST_CASE("sensors are differences from the clip, seen in the reference's heading") {
  everywhere([](const Scene& s) {
    Eigen::VectorXd q = s.r.poses.col(0), v = s.r.velocities.col(0);
    const Vector d{0.1, -0.2, 0.3}, u{0.5, 0.1, -0.4};
    (Vector::from(q.data()) + d).store(q.data());
    (Vector::from(v.data()) + u).store(v.data());
    const CycleCarry unturn{-s.r.heading[0], 0, 0};
    const Sensors moved = s.read(q, v, 0);
    CHECK(moved.head(3).norm() < 1e-10);
    CHECK(apart(Vector::from(moved.data() + 3), unturn.rotate(d)) < 1e-10);
    CHECK(apart(Vector::from(moved.data() + 6), unturn.rotate(u)) < 1e-10);
    CHECK(moved.tail(9).norm() < 1e-10);  // the feet have moved along, the spin is the same
    // The root turned about the world's axes by w, and turning faster by e; every other body goes with it.
    q = s.r.poses.col(0), v = s.r.velocities.col(0);
    const Vector w{0.2, -0.1, 0.3}, e{1, 2, -3};
    (exp_map(w) * Quaternion::from(q.data() + 3)).store(q.data() + 3);
    (Vector::from(v.data() + 3) + e).store(v.data() + 3);
    const Sensors turned = s.read(q, v, 0);
    CHECK(apart(Vector::from(turned.data()), unturn.rotate(w)) < 1e-10);
    CHECK(apart(Vector::from(turned.data() + 15), unturn.rotate(e)) < 1e-10);
    const auto foot = [&](const Eigen::VectorXd& pose, int side) {
      const std::string name = s.f.skeleton()[s.f.model.bodies[static_cast<std::size_t>(s.f.roles.legs[static_cast<std::size_t>(side)].foot)].joint].name;
      return place_of(s.f, pose, name) - momentum_of(s.f, pose, v).center_of_mass;
    };
    for (int k = 0; k < 2; ++k)
      CHECK(apart(Vector::from(turned.data() + 9 + 3 * k), unturn.rotate(foot(q, k) - foot(s.r.poses.col(0), k))) < 1e-10);
  });
}

TEST_CASE("a state carried on with its reference reads the same") {
  everywhere([](const Scene& s) {
    for (const CycleCarry& c : {CycleCarry{0, 3, -2}, CycleCarry{2.5, -1, 4}})
      for (const int stance : {0, 1}) {
        Eigen::VectorXd q = s.q, v = s.v;
        carried(c, q, v);
        CHECK((s.read(q, v, stance, c) - s.read(stance)).cwiseAbs().maxCoeff() < 1e-9);
        CHECK((s.read(q, v, stance) - s.read(stance)).cwiseAbs().maxCoeff() > 0.1);
      }
  });
}

TEST_CASE("carries compose, and agree with the clip's own way of going on") {
  const Figure& f = small();
  const control::TrackingReference r = turning_walk(f);
  const motion::Clip clip{"again", f.skeleton(), Eigen::VectorXd::LinSpaced(r.ticks + 1, 0, 0.5), r.poses, {}, true};
  const Vector p{0.7, -0.3, 1.2};
  CHECK(apart(CycleCarry::after(r, 0).apply(p), p) == 0);
  for (const int m : {1, 2, 5})
    for (const int n : {0, 1, 4}) {
      const CycleCarry a = CycleCarry::after(r, m), b = CycleCarry::after(r, n), both = CycleCarry::after(r, m + n);
      CHECK(apart(a.apply(b.apply(p)), both.apply(p)) < 1e-12);
      CHECK(apart(a.rotate(b.rotate(p)), both.rotate(p)) < 1e-12);
    }
  for (const int cycles : {1, 3}) {
    Eigen::VectorXd q = r.poses.col(7), v = r.velocities.col(7), on = q;
    clip.carry_root(cycles, on);
    carried(CycleCarry::after(r, cycles), q, v);
    CHECK((q.head(3) - on.head(3)).norm() < 1e-9);
    CHECK(apart(Quaternion::from(q.data() + 3), Quaternion::from(on.data() + 3)) < 1e-9);
  }
  // The end of one period is the beginning of the next.
  CHECK(apart(CycleCarry::after(r, 1).apply(Vector::from(r.center_of_mass.col(0))), Vector::from(r.center_of_mass.col(r.ticks))) < 1e-9);
}

namespace {

/// The targets that lanes have after an action.
Eigen::VectorXd acted(const Figure& f, const control::FeedbackSets& sets, const Eigen::VectorXd& target, int stance, const Eigen::VectorXd& da) {
  const sim::Parameters parameters;
  const sim::Ground<double> ground;
  sim::Lanes<double> lanes(f.model, parameters, ground);
  control::apply_action(lanes, f.model, f.roles, sets, target.data(), stance, da.data());
  Eigen::VectorXd out = target;
  std::copy(lanes.target() + 7, lanes.target() + f.model.nq, out.data() + 7);
  return out;
}

}  // namespace

TEST_CASE("an action of zero leaves the targets alone") {
  for (const Figure* f : {&humanoid(), &small()}) {
    core::RandomStream random(43);
    const Eigen::VectorXd target = any_pose(*f, random);
    for (const int stance : {0, 1})
      CHECK((acted(*f, {.ankles = true}, target, stance, Eigen::VectorXd::Zero(15)) - target).cwiseAbs().maxCoeff() < 1e-15);
  }
}

TEST_CASE("actions turn swing hip, stance hip, trunk and ankles, and nothing else") {
  for (const Figure* f : {&humanoid(), &small()}) {
    core::RandomStream random(44);
    const Eigen::VectorXd target = any_pose(*f, random, 0.5);
    const auto& legs = f->roles.legs;
    for (const bool ankles : {false, true})
      for (int part = 0; part < (ankles ? 5 : 3); ++part) {
        Eigen::VectorXd da = Eigen::VectorXd::Zero(15);
        da.segment(3 * part, 3) << 0.1, -0.2, 0.05;
        const Eigen::VectorXd out = acted(*f, {.ankles = ankles}, target, 0, da);
        std::vector<int> expected{part == 0 ? legs[1].hip : part == 1 ? legs[0].hip : part == 2 ? f->roles.waist : part == 3 ? legs[1].foot : legs[0].foot};
        if (part == 2) expected.insert(expected.end(), f->roles.upper_trunk.begin(), f->roles.upper_trunk.end());
        for (std::size_t b = 1; b < f->model.bodies.size(); ++b) {
          const sim::MovingBody& m = f->model.bodies[b];
          const bool moves = std::find(expected.begin(), expected.end(), static_cast<int>(b)) != expected.end();
          const double* before = target.data() + m.q_index;
          const double* after = out.data() + m.q_index;
          if (m.type == body::JointType::hinge) {
            CHECK(after[0] - before[0] == doctest::Approx(moves ? dot(Vector{0.1, -0.2, 0.05}, m.axis) : 0));
          } else {
            const Vector turn = log_map(Quaternion::from(after) * Quaternion::from(before).conjugate());
            CHECK(apart(turn, moves ? Vector{0.1, -0.2, 0.05} : Vector{0, 0, 0}) < 1e-12);
          }
        }
      }
  }
}

TEST_CASE("an action on the left foot is the mirror image of the action on the right") {
  // The humanoid's joints are at rest in their parents' axes, in which actions are given.
  const Figure& f = humanoid();
  core::RandomStream random(45);
  const Eigen::VectorXd target = any_pose(f, random, 0.5);
  Eigen::VectorXd da(15);
  for (double& x : da) x = random.uniform(-0.5, 0.5);
  const Eigen::VectorXd right = acted(f, {.ankles = true}, target, 0, da);
  const Eigen::VectorXd left = acted(f, {.ankles = true}, control::mirrored_pose(f.model, f.roles, target), 1, da);
  CHECK((control::mirrored_pose(f.model, f.roles, right) - left).cwiseAbs().maxCoeff() < 1e-12);
}
