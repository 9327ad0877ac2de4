// SPDX-License-Identifier: MIT
#include <traceur/body/character.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace body_test;

namespace {

bool inside(const Shape& s, const Vector& p) {
  switch (s.kind) {
    case Shape::Kind::sphere:
      return norm(p) < s.size.x;
    case Shape::Kind::capsule:
      return norm(p - Vector{0, 0, std::clamp(p.z, -s.size.y, s.size.y)}) < s.size.x;
    case Shape::Kind::box:
      return std::abs(p.x) < s.size.x && std::abs(p.y) < s.size.y && std::abs(p.z) < s.size.z;
  }
  return false;
}

/// Mass and inertia about the origin by summing cells of a grid around the shape.
Inertia by_cells(const Shape& s, double density, const Vector& reach) {
  constexpr int n = 120;
  const Vector cell = (2.0 / n) * reach;
  const double m = density * cell.x * cell.y * cell.z;
  Inertia sum;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
      for (int k = 0; k < n; ++k) {
        const Vector p{(i + 0.5) * cell.x - reach.x, (j + 0.5) * cell.y - reach.y, (k + 0.5) * cell.z - reach.z};
        if (!inside(s, p)) continue;
        sum.mass += m;
        sum.about_center += traceur::core::Symmetric3<double>::scalar(m * squared_norm(p)) -
                            traceur::core::Symmetric3<double>::outer(m, p);
      }
  return sum;
}

void check_solid(const Shape& s, const Vector& reach) {
  const Inertia exact = solid(s, 800), summed = by_cells(s, 800, reach);
  CHECK(exact.mass == doctest::Approx(summed.mass).epsilon(2e-3));
  CHECK(exact.about_center.xx == doctest::Approx(summed.about_center.xx).epsilon(4e-3));
  CHECK(exact.about_center.yy == doctest::Approx(summed.about_center.yy).epsilon(4e-3));
  CHECK(exact.about_center.zz == doctest::Approx(summed.about_center.zz).epsilon(4e-3));
  CHECK(norm(Vector{exact.about_center.xy, exact.about_center.xz, exact.about_center.yz}) == 0);
}

Shape shape(Shape::Kind kind, const Vector& size) {
  Shape s;
  s.kind = kind;
  s.size = size;
  return s;
}

double off(const Inertia& a, const Inertia& b) {
  return std::abs(a.mass - b.mass) + norm(a.center - b.center) +
         (a.about_center.full().eigen() - b.about_center.full().eigen()).norm();
}

}  // namespace

TEST_CASE("character: solid shapes weigh what their volume sums to") {
  check_solid(shape(Shape::Kind::sphere, {0.3, 0, 0}), {0.3, 0.3, 0.3});
  check_solid(shape(Shape::Kind::capsule, {0.1, 0.25, 0}), {0.1, 0.1, 0.35});
  check_solid(shape(Shape::Kind::box, {0.1, 0.2, 0.3}), {0.1, 0.2, 0.3});
}

TEST_CASE("character: a capsule of no length is a sphere") {
  const Inertia capsule = solid(shape(Shape::Kind::capsule, {0.2, 1e-12, 0}), 1000);
  const Inertia sphere = solid(shape(Shape::Kind::sphere, {0.2, 0, 0}), 1000);
  CHECK(off(capsule, sphere) < 1e-9);
}

TEST_CASE("character: parts combined are the whole, in any frame") {
  // A box cut in two across x.
  const Inertia whole = solid(shape(Shape::Kind::box, {0.4, 0.2, 0.3}), 900);
  const Inertia left = solid(shape(Shape::Kind::box, {0.1, 0.2, 0.3}), 900),
                right = solid(shape(Shape::Kind::box, {0.3, 0.2, 0.3}), 900);
  const auto one = Quaternion<double>::identity();
  const Inertia sum = combined(transformed(left, {-0.3, 0, 0}, one), transformed(right, {0.1, 0, 0}, one));
  CHECK(off(sum, whole) < 1e-12);

  RandomStream random(11);
  for (int trial = 0; trial < 20; ++trial) {
    const auto place = random_vector(random, 1);
    const auto turn = random_rotation(random);
    const Inertia a = transformed(left, random_vector(random, 1), random_rotation(random));
    const Inertia b = transformed(right, random_vector(random, 1), random_rotation(random));
    CHECK(off(combined(a, b), combined(b, a)) < 1e-12);
    CHECK(off(transformed(combined(a, b), place, turn),
              combined(transformed(a, place, turn), transformed(b, place, turn))) < 1e-10);
    CHECK(off(transformed(transformed(a, place, turn), turn.conjugate().rotate(-place), turn.conjugate()), a) < 1e-11);
    CHECK(off(combined(a, Inertia{}), a) < 1e-13);
  }
  CHECK(combined(Inertia{}, Inertia{}).mass == 0);
}

TEST_CASE("character: what cannot be simulated is refused by name") {
  CHECK_NOTHROW(check_character(creature(), "creature"));
  CHECK(creature().total_mass() > 0);
  const auto refused = [](auto change, const std::string& name) {
    Character c = creature();
    change(c);
    std::string what;
    try {
      check_character(c, "file.xml");
    } catch (const traceur::Error& e) {
      what = e.what();
    }
    CHECK_MESSAGE(what.rfind("file.xml: ", 0) == 0, what);
    CHECK_MESSAGE(what.find(name) != std::string::npos, what);
    CHECK(what.find('\n') == std::string::npos);
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  refused([](Character& c) { c = Character{}; }, "at least one body");
  refused([](Character& c) { c.inertias.pop_back(); }, "7 joints");
  refused([](Character& c) { c.actuators.pop_back(); }, "7 joints");
  refused([](Character& c) { c.inertias[3].mass = -1; }, "'head_body'");
  refused([&](Character& c) { c.inertias[3].mass = nan; }, "'head_body'");
  refused([](Character& c) { c.inertias[3].mass = 0; }, "'head_body'");
  refused([&](Character& c) { c.inertias[3].center.x = nan; }, "'head_body'");
  refused([](Character& c) { c.inertias[3].about_center.yy = -1; }, "'head_body'");
  refused([](Character& c) { c.actuators[4].stiffness = -1; }, "'elbow'");
  refused([&](Character& c) { c.actuators[4].damping = nan; }, "'elbow'");
  refused([&](Character& c) { c.actuators[4].torque_limit = nan; }, "'elbow'");
  refused(
      [](Character& c) {
        c.actuators[4].limited = true;
        c.actuators[4].lower.x = 1;
        c.actuators[4].upper.x = -1;
      },
      "'elbow'");
  refused([](Character& c) { c.shapes[2].body = 99; }, "'plate'");
  refused([](Character& c) { c.shapes[2].size.z = 0; }, "'plate'");
  refused([&](Character& c) { c.shapes[2].size.x = nan; }, "'plate'");
  // A weld may weigh nothing; a joint may, where something welded to it does not.
  Character c = creature();
  c.inertias[2].mass = 0;
  CHECK_NOTHROW(check_character(c, "creature"));
}
