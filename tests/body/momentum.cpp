// SPDX-License-Identifier: MIT
#include <traceur/body/momentum.hpp>

#include <vector>

#include <doctest/doctest.h>

#include "../core/support.hpp"
#include "support.hpp"
#include <traceur/body/pose.hpp>

using namespace body_test;

namespace {

struct Particle {
  int body;
  Vector place;
  double mass;
};

/// Each body as particles: its corners' masses stand in for its inertia.
std::vector<Particle> particles(Character& c) {
  std::vector<Particle> all;
  RandomStream random(12);
  for (int i = 0; i < c.skeleton.size(); ++i) {
    Inertia sum;
    for (int n = 0; n < 6; ++n) {
      const Particle p{i, random_vector(random, 0.4), random.uniform(0.1, 1.0)};
      all.push_back(p);
      sum = combined(sum, Inertia{p.mass, p.place, traceur::core::Symmetric3<double>::zero()});
    }
    c.inertias[static_cast<std::size_t>(i)] = sum;
  }
  return all;
}

}  // namespace

TEST_CASE("momentum: a body of particles has their momenta, by finite differences") {
  Character c = creature();
  const auto parts = particles(c);
  const Skeleton& s = c.skeleton;
  RandomStream random(13);
  Frames<double> f(s), later(s), earlier(s);
  Twists<double> t(s);
  const double h = 1e-5;
  for (int trial = 0; trial < 20; ++trial) {
    const Eigen::VectorXd q = random_pose(s, random), v = random_tangent(s, random, 3);
    forward_kinematics(s, q.data(), f);
    forward_velocities(s, f, v.data(), t);
    const Momentum<double> m = momentum(c, f, t);
    Eigen::VectorXd moved = q;
    const Eigen::VectorXd step = h * v, back = -h * v;
    displace(s, q.data(), step.data(), moved.data());
    forward_kinematics(s, moved.data(), later);
    displace(s, q.data(), back.data(), moved.data());
    forward_kinematics(s, moved.data(), earlier);

    double mass = 0, energy = 0;
    Vector moment{0, 0, 0}, linear{0, 0, 0}, angular{0, 0, 0};
    for (const Particle& p : parts) {
      const Vector x = f.point(p.body, p.place);
      const Vector u = (1 / (2 * h)) * (later.point(p.body, p.place) - earlier.point(p.body, p.place));
      mass += p.mass;
      moment += p.mass * x;
      linear += p.mass * u;
      angular += p.mass * cross(x, u);
      energy += 0.5 * p.mass * squared_norm(u);
    }
    const Vector center = (1 / mass) * moment;
    angular -= cross(center, linear);
    CHECK(m.mass == doctest::Approx(mass));
    CHECK(norm(m.center_of_mass - center) < 1e-12);
    CHECK(norm(m.linear - linear) < 1e-5);
    CHECK(norm(m.angular - angular) < 1e-5);
    CHECK(m.kinetic_energy == doctest::Approx(energy).epsilon(1e-6));
    CHECK(norm(m.velocity() - (1 / mass) * linear) < 1e-6);
    CHECK(norm(center_of_mass(c, f) - center) < 1e-12);
    const Vector rate = (1 / (2 * h)) * (center_of_mass(c, later) - center_of_mass(c, earlier));
    CHECK(norm(rate - m.velocity()) < 1e-6);
  }
}

TEST_CASE("momentum: a spinning body by the textbook") {
  Character c;
  Joint root;
  root.name = root.body = "top";
  root.type = JointType::free;
  c.skeleton.add(root);
  c.inertias = {{2, {0, 0, 0}, {1, 2, 3, 0, 0, 0}}};
  c.actuators.resize(1);
  Frames<double> f(c.skeleton);
  Twists<double> t(c.skeleton);
  const Eigen::VectorXd q = c.skeleton.neutral_pose();
  Eigen::VectorXd v(6);
  v << 1, 0, 0, 4, 5, 6;
  forward_kinematics(c.skeleton, q.data(), f);
  forward_velocities(c.skeleton, f, v.data(), t);
  const auto m = momentum(c, f, t);
  CHECK(norm(m.linear - Vector{2, 0, 0}) == 0);
  CHECK(norm(m.angular - Vector{4, 10, 18}) == 0);
  CHECK(m.kinetic_energy == 0.5 * (2 * 1 + 1 * 16 + 2 * 25 + 3 * 36));
}

TEST_CASE_TEMPLATE("momentum: every scalar gives what double gives", S, TRACEUR_TEST_SCALARS) {
  const Character c = creature();
  RandomStream random(14);
  const Eigen::VectorXd q = random_pose(c.skeleton, random), v = random_tangent(c.skeleton, random, 3);
  const auto of = [&]<class N>(N) {
    std::vector<N> nq, nv;
    for (const double x : q) nq.push_back(N(static_cast<traceur::core::Element<N>>(x)));
    for (const double x : v) nv.push_back(N(static_cast<traceur::core::Element<N>>(x)));
    Frames<N> frames(c.skeleton);
    Twists<N> twists(c.skeleton);
    forward_kinematics(c.skeleton, nq.data(), frames);
    forward_velocities(c.skeleton, frames, nv.data(), twists);
    return momentum(c, frames, twists);
  };
  const Momentum<double> exact = of(0.0);
  const Momentum<S> m = of(S(0));
  const double tolerance = 100 * law::unit<S>() * c.total_mass();
  for (int l = 0; l < traceur::core::lane_count<S>; ++l) {
    CHECK(std::abs(law::number(m.center_of_mass.x, l) - exact.center_of_mass.x) < tolerance);
    CHECK(std::abs(law::number(m.linear.z, l) - exact.linear.z) < tolerance);
    CHECK(std::abs(law::number(m.angular.y, l) - exact.angular.y) < tolerance);
    CHECK(std::abs(law::number(m.kinetic_energy, l) - exact.kinetic_energy) < tolerance * (1 + exact.kinetic_energy));
  }
}
