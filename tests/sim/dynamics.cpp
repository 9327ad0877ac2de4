// SPDX-License-Identifier: MIT
#include <traceur/sim/dynamics.hpp>

#include <algorithm>
#include <array>
#include <cmath>

#include <doctest/doctest.h>

#include "support.hpp"

namespace {

using scene::Character;
using scene::JointType;
using scene::Vector;

constexpr double l1 = 0.7;            // length of the upper rod, m
constexpr double c1 = 0.3, c2 = 0.2;  // joint to centre of mass, m
constexpr double m1 = 2.0, m2 = 1.5, i1 = 0.09, i2 = 0.04, gravity = 9.81;

/// Two rods on hinges about y, hanging down at zero angles.
Character pendulum() {
  Character c;
  c.name = "pendulum";
  traceur::body::Joint base, upper, lower;
  base.name = base.body = "base";
  base.type = JointType::fixed;
  upper.name = upper.body = "upper";
  upper.parent = 0;
  upper.type = JointType::hinge;
  upper.axis = {0, 1, 0};
  upper.offset = {0.1, 0.2, 3};
  lower = upper;
  lower.name = lower.body = "lower";
  lower.parent = 1;
  lower.offset = {0, 0, -l1};
  for (const auto& j : {base, upper, lower}) c.skeleton.add(j);
  c.inertias.resize(3);
  c.inertias[1] = {m1, {0, 0, -c1}, {0.02, i1, 0.03, 0, 0, 0}};
  c.inertias[2] = {m2, {0, 0, -c2}, {0.01, i2, 0.02, 0, 0, 0}};
  c.actuators.resize(3);
  return c;
}

/// Lagrange's equations of the double pendulum with relative angles, solved for the accelerations.
std::array<double, 2> pendulum_acceleration(double a, double b, double da, double db, double t1, double t2) {
  const double m11 = i1 + i2 + m1 * c1 * c1 + m2 * (l1 * l1 + c2 * c2 + 2 * l1 * c2 * std::cos(b));
  const double m12 = i2 + m2 * (c2 * c2 + l1 * c2 * std::cos(b));
  const double m22 = i2 + m2 * c2 * c2;
  const double s = m2 * l1 * c2 * std::sin(b);
  const double g2 = m2 * gravity * c2 * std::sin(a + b);
  const double g1 = (m1 * c1 + m2 * l1) * gravity * std::sin(a) + g2;
  const double r1 = t1 + s * (2 * da * db + db * db) - g1;
  const double r2 = t2 - s * da * da - g2;
  const double det = m11 * m22 - m12 * m12;
  return {(m22 * r1 - m12 * r2) / det, (m11 * r2 - m12 * r1) / det};
}

/// Largest error of the angles against a fine Runge-Kutta solution along one second.
double pendulum_error(double dt) {
  traceur::sim::Parameters p;
  p.dt = dt;
  traceur::sim::World<double> world(pendulum(), 1, p);
  std::array<double, 4> x{1.2, -0.7, 0.5, -1.0};
  world.reset(0, Eigen::Vector2d(x[0], x[1]), Eigen::Vector2d(x[2], x[3]));
  const int steps = static_cast<int>(std::lround(1 / dt));
  constexpr int fine = 20;
  const double h = dt / fine;
  const auto rate = [](const std::array<double, 4>& y) {
    const auto a = pendulum_acceleration(y[0], y[1], y[2], y[3], 0, 0);
    return std::array<double, 4>{y[2], y[3], a[0], a[1]};
  };
  const auto along = [](const std::array<double, 4>& y, double step, const std::array<double, 4>& k) {
    std::array<double, 4> out{};
    for (std::size_t i = 0; i < 4; ++i) out[i] = y[i] + step * k[i];
    return out;
  };
  double worst = 0;
  for (int n = 0; n < steps; ++n) {
    world.step(1);
    for (int f = 0; f < fine; ++f) {
      const auto k1 = rate(x), k2 = rate(along(x, h / 2, k1)), k3 = rate(along(x, h / 2, k2)),
                 k4 = rate(along(x, h, k3));
      for (std::size_t i = 0; i < 4; ++i) x[i] += h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
    }
    const Eigen::VectorXd q = world.pose(0);
    worst = std::max({worst, std::abs(q[0] - x[0]), std::abs(q[1] - x[1])});
  }
  return worst;
}

template <class S>
void check_pendulum(double tolerance) {
  using T = traceur::core::Element<S>;
  const auto model = traceur::sim::make_model(pendulum());
  traceur::sim::DynamicsWork<S> work(model);
  traceur::core::RandomStream random(3);
  for (int trial = 0; trial < 100; ++trial) {
    std::array<double, 6> x{};
    for (double& value : x) value = random.uniform(-3.0, 3.0);
    std::array<S, 2> q{S(static_cast<T>(x[0])), S(static_cast<T>(x[1]))},
        v{S(static_cast<T>(x[2])), S(static_cast<T>(x[3]))}, tau{S(static_cast<T>(x[4])), S(static_cast<T>(x[5]))},
        out{};
    traceur::sim::forward_dynamics(model, q.data(), v.data(), tau.data(), S(static_cast<T>(gravity)), work, out.data());
    const auto expected = pendulum_acceleration(x[0], x[1], x[2], x[3], x[4], x[5]);
    const double scale = 1 + std::abs(expected[0]) + std::abs(expected[1]);
    for (std::size_t i = 0; i < 2; ++i) {
      const auto got = static_cast<double>(traceur::core::lane_of(out[i], 0));
      CHECK(std::abs(got - expected[i]) < tolerance * scale);
    }
  }
}

}  // namespace

TEST_CASE("forward dynamics of a double pendulum is Lagrange's") {
  check_pendulum<double>(1e-12);
  check_pendulum<traceur::core::Pack<double, 4>>(1e-12);
  check_pendulum<float>(1e-4);
  check_pendulum<traceur::core::Pack<float>>(1e-4);
}

TEST_CASE("the simulated double pendulum converges in the first order") {
  const double coarse = pendulum_error(1.0 / 240), middle = pendulum_error(1.0 / 480), fine = pendulum_error(1.0 / 960);
  CHECK(fine < 0.02);
  CHECK(coarse / middle == doctest::Approx(2).epsilon(0.1));
  CHECK(middle / fine == doctest::Approx(2).epsilon(0.1));
}

TEST_CASE("a free rigid body obeys Newton and Euler") {
  Character c = scene::box({0.1, 0.2, 0.4}, 3);
  c.inertias[0].center = {0.05, -0.1, 0.2};
  const auto model = traceur::sim::make_model(c);
  traceur::sim::DynamicsWork<double> work(model);
  traceur::core::RandomStream random(5);
  for (int trial = 0; trial < 50; ++trial) {
    const Eigen::VectorXd q = scene::random_pose(c, random, 1);
    const Eigen::VectorXd v = scene::random_velocity(c, random, 5);
    const Eigen::VectorXd none = Eigen::VectorXd::Zero(6);
    Eigen::VectorXd a(6);
    traceur::sim::forward_dynamics(model, q.data(), v.data(), none.data(), gravity, work, a.data());
    const auto r = scene::Quaternion::from(q.data() + 3);
    const Vector omega = Vector::from(v.data() + 3), alpha = Vector::from(a.data() + 3);
    const auto inertia = rotated(c.inertias[0].about_center, r.matrix());
    CHECK(norm(inertia * alpha + cross(omega, inertia * omega)) < 1e-12);
    const Vector arm = r.rotate(c.inertias[0].center);
    const Vector center = Vector::from(a.data()) + cross(alpha, arm) + cross(omega, cross(omega, arm));
    CHECK(norm(center - Vector{0, 0, -gravity}) < 1e-12);
  }
}

TEST_CASE("kinetic energy rises by the work of the joint torques") {
  // A law of the whole tree: d/dt of the kinetic energy is torque times rate, without weight.
  const Character& c = scene::humanoid();
  Character bare = c;
  for (auto& a : bare.actuators) a.armature = 0;
  const auto model = traceur::sim::make_model(bare);
  traceur::sim::DynamicsWork<double> work(model);
  traceur::core::RandomStream random(6);
  for (int trial = 0; trial < 20; ++trial) {
    const Eigen::VectorXd q = scene::random_pose(c, random, 1);
    const Eigen::VectorXd v = scene::random_velocity(c, random, 5);
    Eigen::VectorXd tau = scene::random_velocity(c, random, 5);
    tau.head(6).setZero();
    Eigen::VectorXd a(v.size());
    traceur::sim::forward_dynamics(model, q.data(), v.data(), tau.data(), 0.0, work, a.data());
    const double h = 1e-6;
    const auto energy = [&](double t) {
      Eigen::VectorXd moved(q.size());
      const Eigen::VectorXd way = t * v + 0.5 * t * t * a;
      displace(c.skeleton, q.data(), way.data(), moved.data());
      return scene::momentum_of(bare, moved, v + t * a).kinetic_energy;
    };
    CHECK((energy(h) - energy(-h)) / (2 * h) == doctest::Approx(tau.dot(v)).epsilon(1e-4));
  }
}

TEST_CASE("momenta of the simulator are those of the body module") {
  const Character& c = scene::humanoid();
  const auto model = traceur::sim::make_model(c);
  traceur::sim::DynamicsWork<double> work(model);
  traceur::core::RandomStream random(7);
  const Eigen::VectorXd q = scene::random_pose(c, random, 2);
  const Eigen::VectorXd v = scene::random_velocity(c, random, 5);
  traceur::sim::update_kinematics(model, traceur::sim::Numbers<double>(model), q.data(), v.data(), work);
  const auto m = scene::momentum_of(c, q, v);
  CHECK(norm(work.center_of_mass - m.center_of_mass) < 1e-12);
  CHECK(norm(work.linear_momentum - m.linear) < 1e-10);
  CHECK(norm(work.angular_momentum - m.angular) < 1e-10);
}
