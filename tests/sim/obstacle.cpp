// SPDX-License-Identifier: MIT
#include <traceur/sim/obstacle.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include <doctest/doctest.h>

#include <traceur/core/random.hpp>

namespace {

using traceur::core::Pack;
using traceur::core::RandomStream;
using traceur::sim::Obstacle;
using traceur::sim::obstacle_distance;
using traceur::sim::Touch;
using traceur::sim::touch_capsule;
using traceur::sim::touch_sphere;
using Vector = traceur::core::Vector3<double>;
using Quaternion = traceur::core::Quaternion<double>;

Vector in_cube(RandomStream& random, double half) {
  return {random.uniform(-half, half), random.uniform(-half, half), random.uniform(-half, half)};
}

Obstacle<double> any_obstacle(RandomStream& random, double rounding) {
  const Quaternion q = Quaternion{random.normal(), random.normal(), random.normal(), random.normal()}.normalized();
  const Vector half_size{random.uniform(0.05, 0.8), random.uniform(0.05, 0.8), random.uniform(0.05, 0.8)};
  return {in_cube(random, 2), q.matrix(), half_size, rounding, 3};
}

/// Written out by itself: the closest point of the solid, or the nearest face seen from within.
double brute_force(const Obstacle<double>& o, const Vector& point) {
  const Vector e[3] = {o.rotation.column_x(), o.rotation.column_y(), o.rotation.column_z()};
  const double h[3] = {o.half_size.x, o.half_size.y, o.half_size.z};
  Vector closest = o.center;
  double face = std::numeric_limits<double>::infinity();
  for (int k = 0; k < 3; ++k) {
    const double along = dot(point - o.center, e[k]);
    closest += std::clamp(along, -h[k], h[k]) * e[k];
    face = std::min(face, h[k] - std::abs(along));
  }
  return (face > 0 ? -face : norm(point - closest)) - o.rounding;
}

struct Minimum {
  double distance, at;
};

/// Over the axis, from one end (-1) to the other (1).
Minimum minimum(const Obstacle<double>& o, const Vector& center, const Vector& half_axis) {
  constexpr int samples = 5000;
  Minimum best{std::numeric_limits<double>::infinity(), 0};
  for (int n = 0; n < samples; ++n) {
    const double t = -1 + 2.0 * n / (samples - 1);
    const double distance = brute_force(o, center + t * half_axis);
    if (distance < best.distance) best = {distance, t};
  }
  return best;
}

template <class S>
void put(traceur::core::Vector3<S>& to, int lane, const Vector& from) {
  using T = traceur::core::Element<S>;
  to.x.set(lane, static_cast<T>(from.x));
  to.y.set(lane, static_cast<T>(from.y));
  to.z.set(lane, static_cast<T>(from.z));
}

}  // namespace

TEST_CASE("obstacle: a sphere's distance is its centre's less the radius, its normal the gradient") {
  RandomStream random(401);
  constexpr double h = 1e-6;
  for (int trial = 0; trial < 2000; ++trial) {
    const Obstacle<double> o = any_obstacle(random, trial % 3 ? 0.0 : 0.07);
    const Vector center = o.center + in_cube(random, 1.2);
    const double radius = random.uniform(0.01, 0.3);
    const Touch<double> t = touch_sphere(o, center, radius);
    CHECK(std::abs(t.distance - (brute_force(o, center) - radius)) < 1e-12);
    CHECK(std::abs(obstacle_distance(o, center) - brute_force(o, center)) < 1e-12);
    CHECK(std::abs(norm(t.normal) - 1) < 1e-12);
    CHECK(norm(t.arm) == 0);
    // A normal of a convex function is a slope that lies below it everywhere: the gradient wherever there is one.
    const Vector step = h * in_cube(random, 1), wide = in_cube(random, 1);
    CHECK(brute_force(o, center + step) - radius >= t.distance + dot(t.normal, step) - 1e-14);
    CHECK(brute_force(o, center + wide) - radius >= t.distance + dot(t.normal, wide) - 1e-12);
  }
}

TEST_CASE("obstacle: half sizes of zero and a rounding make a sphere") {
  RandomStream random(402);
  for (int trial = 0; trial < 300; ++trial) {
    Obstacle<double> o = any_obstacle(random, 0.3);
    o.half_size = {0, 0, 0};
    const Vector center = o.center + in_cube(random, 1);
    const Touch<double> t = touch_sphere(o, center, 0.1);
    const Vector out = center - o.center;
    CHECK(t.distance == doctest::Approx(norm(out) - 0.4));
    CHECK(norm(t.normal - (1 / norm(out)) * out) < 1e-12);
    const Vector half_axis = in_cube(random, 1);
    const double at = std::clamp(-dot(out, half_axis) / squared_norm(half_axis), -1.0, 1.0);
    const Touch<double> along = touch_capsule(o, center, half_axis, 0.1);
    if (along.distance < 0) CHECK(std::abs(norm(out + along.arm) - norm(out + at * half_axis)) < norm(half_axis) / 256);
  }
}

TEST_CASE("obstacle: a capsule's deepest point is that of all points of its axis") {
  RandomStream random(403);
  int full = 0, part = 0, none = 0, apart = 0;
  double worst = 0;
  for (int trial = 0; trial < 3000; ++trial) {
    const Obstacle<double> o = any_obstacle(random, trial % 3 ? 0.0 : 0.05);
    const Vector center = o.center + in_cube(random, trial % 2 ? 0.3 : 1.2), half_axis = in_cube(random, trial % 5 ? 0.6 : 2);
    const double radius = random.uniform(0.01, 0.1), length = norm(half_axis);
    const double expected = minimum(o, center, half_axis).distance - radius;
    const Touch<double> t = touch_capsule(o, center, half_axis, radius);
    const double ends = std::min(brute_force(o, center - half_axis), brute_force(o, center + half_axis)) - radius;
    if (expected >= 0) {
      CHECK(t.distance >= -1e-12);
      ++apart;
      continue;
    }
    if (ends <= expected + 1e-9) {
      CHECK(t.distance >= -1e-9);
      ++none;
      continue;
    }
    if (t.distance > 0) {
      // Left to the ends: it is no deeper than they are by a hundredth of what counts in full.
      CHECK(ends - expected < 0.002 * 0.01 + length / 4999);
      continue;
    }
    CHECK(std::abs(norm(t.normal) - 1) < 1e-12);
    const double at = dot(t.arm, half_axis) / squared_norm(half_axis);
    CHECK(norm(t.arm - at * half_axis) < 1e-12);
    CHECK(std::abs(at) <= 1);
    // Eight halvings of an interval of 2 end within 1/256 of the deepest point, and distance changes by no more than the
    // way gone. Samples are 2/4999 apart.
    const double depth = brute_force(o, center + t.arm) - radius;
    CHECK(depth <= expected + length / 256);
    CHECK(depth >= expected - length / 4999);
    worst = std::max(worst, (depth - expected) / length);
    // Along the axis the distance is flat where it is least.
    CHECK(std::abs(dot(t.normal, half_axis)) < 1e-9);
    // It counts in full where the ends are clearly less deep, and before by how much it is deeper.
    CHECK(std::abs(t.distance - std::min(depth, 0.0) * std::clamp((ends - depth) / 0.002, 0.0, 1.0)) < 1e-9);
    (ends > depth + 0.002 ? full : part)++;
  }
  MESSAGE("deepest point of a capsule: off by up to " << worst << " of its half length");
  CHECK(full > 300);
  CHECK(part > 3);
  CHECK(none > 100);
  CHECK(apart > 100);
}

TEST_CASE("obstacle: turning a capsule from one end to the other its contact comes and goes without a jump") {
  // Over the edge of a block: first one end lies on top, then the middle crosses the edge.
  const Obstacle<double> o{{0, 0, 0}, traceur::core::Matrix3<double>::identity(), {1, 1, 1}, 0, 0};
  double last = 0;
  constexpr int steps = 200000;
  for (int n = 0; n <= steps; ++n) {
    const double angle = -0.3 + 0.6 * n / steps;
    const Vector along{0.5 * std::cos(angle), 0, -0.5 * std::sin(angle)};
    const double now = std::min(0.0, touch_capsule(o, {1, 0, 1.03}, along, 0.05).distance);
    // The search steps by 1/256 of the half length, where distance is flat; 2 mm deeper is the whole depth.
    if (n > 0 && std::abs(now - last) > 1e-3) FAIL_CHECK("from " << last << " to " << now << " at " << angle);
    last = now;
  }
  CHECK(last < -0.01);
}

TEST_CASE("obstacle: lying flat on a face is left to the ends") {
  RandomStream random(405);
  for (int trial = 0; trial < 200; ++trial) {
    Obstacle<double> o = any_obstacle(random, 0);
    o.half_size = {2, 2, 0.5};
    // Within the face's rim, above and below its surface; parallel but for rounding, or by less than 1e-3.
    const double height = random.uniform(-0.1, 0.4), tilt = trial % 2 ? 0.0 : 5e-4;
    const double angle = random.uniform(0, 6.28);
    const Vector local{random.uniform(-1, 1), random.uniform(-1, 1), 0.5 + height};
    const Vector axis{0.4 * std::cos(angle), 0.4 * std::sin(angle), 0.4 * tilt};
    const Touch<double> t = touch_capsule(o, o.center + o.rotation * local, o.rotation * axis, 0.05);
    CHECK(t.distance > -1e-6);
  }
}

TEST_CASE("obstacle: a rod over an edge touches where it crosses") {
  // The edge along y at x = 1, z = 1; the rod leans over it by 45 degrees and dips in by 0.01.
  const Obstacle<double> o{{0, 0, 0}, traceur::core::Matrix3<double>::identity(), {1, 1, 1}, 0, 0};
  const double root = std::sqrt(0.5), radius = 0.05;
  const Vector normal{root, 0, root}, along{root, 0, -root};
  for (const double shift : {-0.6, -0.2, 0.0, 0.35, 0.7}) {
    const Vector middle = Vector{1, 0.2, 1} + (radius - 0.01) * normal - shift * along;
    const Touch<double> t = touch_capsule(o, middle, along, radius);
    CHECK(std::abs(t.distance + 0.01) < 1.0 / 256);
    CHECK(norm(t.arm - shift * along) < 1.0 / 256 + 1e-9);
  }
}

TEST_CASE("obstacle: an axis of no length is left to the spheres at its ends") {
  RandomStream random(406);
  for (int trial = 0; trial < 200; ++trial) {
    const Obstacle<double> o = any_obstacle(random, 0.02);
    const Vector center = o.center + in_cube(random, 1);
    CHECK(touch_capsule(o, center, {0, 0, 0}, 0.1).distance > 0);
  }
}

TEST_CASE("obstacle: packs do the arithmetic of plain numbers") {
  using P = Pack<double, 4>;
  RandomStream random(407);
  for (int trial = 0; trial < 500; ++trial) {
    Obstacle<P> all;
    traceur::core::Vector3<P> center, half_axis;
    P radius;
    Touch<double> sphere[4], capsule[4];
    for (int l = 0; l < 4; ++l) {
      const Obstacle<double> o = any_obstacle(random, random.uniform(0, 0.1));
      const Vector c = o.center + in_cube(random, 0.9), a = in_cube(random, 0.8);
      const double r = random.uniform(0.01, 0.2);
      sphere[l] = touch_sphere(o, c, r);
      capsule[l] = touch_capsule(o, c, a, r);
      put(all.center, l, o.center);
      put(all.half_size, l, o.half_size);
      const traceur::core::Matrix3<double>& m = o.rotation;
      const double from[] = {m.xx, m.xy, m.xz, m.yx, m.yy, m.yz, m.zx, m.zy, m.zz};
      traceur::core::Matrix3<P>& n = all.rotation;
      P* const to[] = {&n.xx, &n.xy, &n.xz, &n.yx, &n.yy, &n.yz, &n.zx, &n.zy, &n.zz};
      for (std::size_t k = 0; k < 9; ++k) to[k]->set(l, from[k]);
      all.rounding.set(l, o.rounding);
      all.id.set(l, o.id);
      put(center, l, c);
      put(half_axis, l, a);
      radius.set(l, r);
    }
    const Touch<P> spheres = touch_sphere(all, center, radius), capsules = touch_capsule(all, center, half_axis, radius);
    for (int l = 0; l < 4; ++l) {
      CHECK(spheres.distance[l] == doctest::Approx(sphere[l].distance));
      CHECK(spheres.normal.y[l] == doctest::Approx(sphere[l].normal.y));
      CHECK(std::min(0.0, static_cast<double>(capsules.distance[l])) == doctest::Approx(std::min(0.0, capsule[l].distance)));
      if (!(capsule[l].distance < 0)) continue;
      CHECK(capsules.normal.x[l] == doctest::Approx(capsule[l].normal.x));
      CHECK(capsules.normal.z[l] == doctest::Approx(capsule[l].normal.z));
      CHECK(capsules.arm.y[l] == doctest::Approx(capsule[l].arm.y));
    }
  }
}
