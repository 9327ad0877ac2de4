// SPDX-License-Identifier: MIT
#include <traceur/sim/contact.hpp>

#include <algorithm>
#include <cmath>
#include <utility>

#include <doctest/doctest.h>

#include <traceur/core/random.hpp>

namespace {

using traceur::core::Pack;
using traceur::core::RandomStream;
using traceur::core::Vector3;
using traceur::sim::ContactMemory;
using traceur::sim::Parameters;
using Vector = Vector3<double>;

constexpr ContactMemory<double> nothing{{0, 0, 0}, 0, 0};

/// One time step of a point mass on the plane through the origin with the given normal, under a constant force.
struct Slider {
  Parameters p;
  Vector normal{0, 0, 1};
  double mass = 2.5;
  Vector x{0, 0, 0}, v{0, 0, 0};
  ContactMemory<double> memory = nothing;
  Vector contact_force{0, 0, 0};

  void step(const Vector& force) {
    const double depth = -dot(normal, x);
    const auto c = linearize_contact(p, p.friction, depth, normal, v, memory);
    // (m + dt K) (v' - v) = dt (force + c - K v)
    auto k = p.dt * c.resistance;
    k += traceur::core::Symmetric3<double>::scalar(mass);
    const Vector after = v + k.inverse() * (p.dt * (force + c.force - c.resistance * v));
    contact_force = c.force - c.resistance * after;
    update_contact(p, p.friction, depth, normal, v, after, contact_force, memory);
    v = after;
    x += p.dt * v;
  }
};

}  // namespace

TEST_CASE("contact: out of touch, or leaving fast, there is no force") {
  const Parameters p;
  for (const auto& [depth, speed] : {std::pair{-1e-3, -5.0}, std::pair{0.0, 0.0}, std::pair{1e-3, 0.5}}) {
    const auto c = linearize_contact(p, 1.0, depth, Vector{0, 0, 1}, Vector{0.3, 0, speed}, nothing);
    CHECK(norm(c.force) == 0);
    CHECK(norm(c.resistance * Vector{1, 2, 3}) == 0);
  }
}

TEST_CASE("contact: a resting mass is carried at the depth its weight takes") {
  Slider s;
  s.normal = {0, 0.6, 0.8};
  const double weight = s.mass * 9.81;
  for (int n = 0; n < 2000; ++n) s.step(-weight * s.normal);
  CHECK(-dot(s.normal, s.x) == doctest::Approx(weight / s.p.contact_stiffness));
  CHECK(norm(s.contact_force - weight * s.normal) < 1e-9);
  CHECK(norm(s.v) < 1e-12);
}

TEST_CASE("contact: below the cone a bristle holds, elastically") {
  Slider s;
  s.p.friction = 0.7;
  const double weight = s.mass * 9.81;
  const Vector pull{0.6 * weight, -0.2 * weight, 0};
  REQUIRE(norm(pull) < 0.7 * weight);
  for (int n = 0; n < 500; ++n) s.step(Vector{0, 0, -weight});
  const Vector before = s.x;
  // Slowly, or the mass would swing beyond the cone.
  for (int n = 0; n < 5000; ++n) s.step(std::min(n / 2000.0, 1.0) * pull - Vector{0, 0, weight});
  CHECK(norm(s.x - before) == doctest::Approx(norm(pull) / s.p.bristle_stiffness));
  for (int n = 0; n < 5000; ++n) s.step(Vector{0, 0, -weight});
  CHECK(norm(s.x - before) < 1e-9);
}

TEST_CASE("contact: beyond the cone friction is Coulomb's, at any speed") {
  for (const double initial : {0.0, 0.01, 3.0}) {
    Slider s;
    s.p.friction = 0.7;
    const double weight = s.mass * 9.81;
    for (int n = 0; n < 500; ++n) s.step(Vector{0, 0, -weight});
    s.v.y = initial;
    const double pull = 0.75 * weight;
    for (int n = 0; n < 100; ++n) s.step(Vector{0, pull, -weight});
    const double v0 = s.v.y;
    for (int n = 0; n < 480; ++n) {
      s.step(Vector{0, pull, -weight});
      CHECK(s.contact_force.y < 0);
      CHECK(-s.contact_force.y < 0.7 * s.contact_force.z * 1.001);
    }
    CHECK(s.v.y - v0 == doctest::Approx((pull - 0.7 * weight) / s.mass).epsilon(1e-3));
  }
}

TEST_CASE("contact: friction stops a slide and does not turn it round") {
  Slider s;
  s.p.friction = 0.5;
  const double weight = s.mass * 9.81;
  for (int n = 0; n < 500; ++n) s.step(Vector{0, 0, -weight});
  s.v.x = 1;
  double farthest = 0;
  for (int n = 0; n < 960; ++n) {
    s.step(Vector{0, 0, -weight});
    farthest = std::max(farthest, s.x.x);
  }
  CHECK(s.x.x == doctest::Approx(1 / (2 * 0.5 * 9.81)).epsilon(0.02));
  CHECK(farthest - s.x.x < 5e-4);
  CHECK(std::abs(s.v.x) < 1e-6);
}

TEST_CASE("contact: without friction nothing holds sideways") {
  Slider s;
  s.p.friction = 0;
  s.v = {1, -2, 0};
  for (int n = 0; n < 200; ++n) s.step(Vector{0, 0, -s.mass * 9.81});
  CHECK(s.v.x == doctest::Approx(1));
  CHECK(s.v.y == doctest::Approx(-2));
}

TEST_CASE("contact: the resistance is symmetric and never drives") {
  RandomStream random(71);
  const auto draw = [&](double size) {
    return Vector{size * random.normal(), size * random.normal(), size * random.normal()};
  };
  const Parameters p;
  for (int trial = 0; trial < 500; ++trial) {
    Vector n = draw(1);
    n = (1 / norm(n)) * n;
    ContactMemory<double> memory{draw(1e-4), std::max(0.0, 100 * random.normal()), std::abs(random.normal())};
    memory.bristle -= dot(n, memory.bristle) * n;
    const Vector u = draw(1);
    const auto c = linearize_contact(p, 0.8, 0.01 * random.normal(), n, u, memory);
    const Vector probe = draw(1);
    CHECK(dot(probe, c.resistance * probe) >= -1e-9);
    CHECK(dot(n, c.force - c.resistance * u) >= 0);

    // A pack lane does the same arithmetic.
    using P = Pack<double, 4>;
    const ContactMemory<P> packed{memory.bristle.cast<P>(), P(memory.normal_force), P(memory.sliding_speed)};
    const auto c4 = linearize_contact(p, P(0.8), P(0.004), n.cast<P>(), u.cast<P>(), packed);
    const auto c1 = linearize_contact(p, 0.8, 0.004, n, u, memory);
    CHECK(c4.force.x[2] == doctest::Approx(c1.force.x));
    CHECK(c4.resistance.xy[2] == doctest::Approx(c1.resistance.xy));
  }
}
