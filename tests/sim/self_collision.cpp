// SPDX-License-Identifier: MIT
#include <traceur/sim/self_collision.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

#include <doctest/doctest.h>

#include <traceur/core/random.hpp>

namespace {

using traceur::core::Pack;
using traceur::core::RandomStream;
using traceur::sim::closest_points;
using traceur::sim::Parameters;
using traceur::sim::SegmentPair;
using traceur::sim::self_collision_force;
using Vector = traceur::core::Vector3<double>;

Vector in_cube(RandomStream& random, double half) {
  return {random.uniform(-half, half), random.uniform(-half, half), random.uniform(-half, half)};
}

struct Segment {
  Vector middle, half;
};

Segment any_segment(RandomStream& random, double largest) { return {in_cube(random, 0.6), in_cube(random, largest)}; }

/// The least distance of any two points, by ever finer grids about the best so far.
double brute_force(const Segment& a, const Segment& b) {
  double s0 = 0, t0 = 0, reach = 1, best = std::numeric_limits<double>::infinity();
  for (int round = 0; round < 16; ++round) {
    double s1 = s0, t1 = t0;
    for (int i = -10; i <= 10; ++i)
      for (int j = -10; j <= 10; ++j) {
        const double s = std::clamp(s0 + reach * i / 10, -1.0, 1.0), t = std::clamp(t0 + reach * j / 10, -1.0, 1.0);
        const double d = norm(a.middle + s * a.half - b.middle - t * b.half);
        if (d < best) {
          best = d;
          s1 = s;
          t1 = t;
        }
      }
    s0 = s1;
    t0 = t1;
    // Slowly, for a valley may lie across the grid.
    reach *= 0.5;
  }
  return best;
}

double off_segment(const Segment& s, const Vector& p) {
  const double t = std::clamp(dot(p - s.middle, s.half) / std::max(squared_norm(s.half), 1e-30), -1.0, 1.0);
  return norm(p - s.middle - t * s.half);
}

SegmentPair<double> closest(const Segment& a, const Segment& b) { return closest_points(a.middle, a.half, b.middle, b.half); }

double distance(const Segment& a, const Segment& b) {
  const SegmentPair<double> p = closest(a, b);
  CHECK(off_segment(a, p.on_a) < 1e-12);
  CHECK(off_segment(b, p.on_b) < 1e-12);
  return norm(p.on_a - p.on_b);
}

}  // namespace

TEST_CASE("closest points: no two points of the segments are closer") {
  RandomStream random(501);
  double worst = 0;
  for (int trial = 0; trial < 1500; ++trial) {
    const Segment a = any_segment(random, 0.5), b = any_segment(random, trial % 3 ? 0.5 : 0.05);
    const double found = distance(a, b), expected = brute_force(a, b);
    worst = std::max(worst, std::abs(found - expected));
    CHECK(found <= expected + 1e-12);
    CHECK(found >= expected - 1e-6);
    CHECK(distance(b, a) == doctest::Approx(found));
    // Neither point can be moved along its segment towards the other: the condition of a closest pair.
    const SegmentPair<double> p = closest(a, b);
    CHECK(off_segment(a, p.on_b) == doctest::Approx(found));
    CHECK(off_segment(b, p.on_a) == doctest::Approx(found));
  }
  MESSAGE("closest points: off by up to " << worst << " m from a search");
}

TEST_CASE("closest points: segments of no length are points") {
  RandomStream random(502);
  for (int trial = 0; trial < 300; ++trial) {
    const Segment line = any_segment(random, 0.5);
    const Segment point{in_cube(random, 1), {0, 0, 0}}, other{in_cube(random, 1), {0, 0, 0}};
    CHECK(distance(point, line) == doctest::Approx(off_segment(line, point.middle)));
    CHECK(distance(line, point) == doctest::Approx(off_segment(line, point.middle)));
    CHECK(norm(closest(point, line).on_a - point.middle) == 0);
    CHECK(distance(point, other) == doctest::Approx(norm(point.middle - other.middle)));
  }
}

TEST_CASE("closest points: parallel segments, side by side and one after the other") {
  RandomStream random(503);
  for (int trial = 0; trial < 300; ++trial) {
    const Segment a = any_segment(random, 0.5);
    if (norm(a.half) < 0.05) continue;
    const Vector along = (1 / norm(a.half)) * a.half;
    Vector across = cross(along, in_cube(random, 1));
    across = (1 / norm(across)) * across;
    const double scale = (trial % 2 ? 1 : -1) * random.uniform(0.2, 2);
    const double shift = random.uniform(-3, 3), gap = random.uniform(0, 0.5);
    const Segment b{a.middle + shift * a.half + gap * across, scale * a.half};
    // In units of a's half length the ends are 1 + |scale| apart at the touch.
    const double beyond = std::max(std::abs(shift) - 1 - std::abs(scale), 0.0) * norm(a.half);
    CHECK(distance(a, b) == doctest::Approx(std::hypot(gap, beyond)));
    CHECK(distance(b, a) == doctest::Approx(std::hypot(gap, beyond)));
  }
  // Side by side the middle is taken, and does not jump when one turns by very little.
  const Vector half{0.3, 0, 0}, up{0, 0, 0.1};
  for (const double turn : {0.0, 1e-5, -1e-5, 1e-4, -1e-4}) {
    const SegmentPair<double> p = closest_points<double>({0, 0, 0}, half, up, {0.3, 0, 0.3 * turn});
    CHECK(norm(p.on_a) < 1e-4);
    CHECK(norm(p.on_b - up) < 1e-4);
  }
}

TEST_CASE("closest points: nearly parallel segments are off by no more than they lean") {
  RandomStream random(504);
  for (int trial = 0; trial < 500; ++trial) {
    const Segment a = any_segment(random, 0.5);
    const double angle = std::pow(10.0, random.uniform(-7, -1));
    Vector across = cross(a.half, in_cube(random, 1));
    across = (norm(a.half) / norm(across)) * across;
    const Segment b{a.middle + random.uniform(-1, 1) * a.half + 0.2 * in_cube(random, 1), a.half + angle * across};
    const double lean = std::min(angle, 2e-3) * norm(a.half);
    CHECK(distance(a, b) <= brute_force(a, b) + 2 * lean + 1e-12);
  }
}

TEST_CASE("closest points: crossing segments meet") {
  RandomStream random(505);
  for (int trial = 0; trial < 300; ++trial) {
    const Vector meeting = in_cube(random, 1), u = in_cube(random, 0.5), v = in_cube(random, 0.5);
    if (norm(cross(u, v)) < 0.02 * norm(u) * norm(v) || norm(u) * norm(v) < 0.01) continue;
    const double s = random.uniform(-1, 1), t = random.uniform(-1, 1);
    const SegmentPair<double> p = closest_points<double>(meeting - s * u, u, meeting - t * v, v);
    CHECK(norm(p.on_a - meeting) < 1e-9);
    CHECK(norm(p.on_b - meeting) < 1e-9);
  }
  // Skew at right angles: the common perpendicular.
  const SegmentPair<double> p = closest_points<double>({0.1, 0, 0}, {0.5, 0, 0}, {0.2, 0.1, 0.3}, {0, 0.4, 0});
  CHECK(norm(p.on_a - Vector{0.2, 0, 0}) < 1e-12);
  CHECK(norm(p.on_b - Vector{0.2, 0, 0.3}) < 1e-12);
}

TEST_CASE("self-collision: the force pushes apart, never pulls, and is zero apart") {
  RandomStream random(506);
  Parameters p;
  p.self_stiffness = 1e4;
  p.self_damping = 40;
  int pushes = 0, lets_go = 0;
  for (int trial = 0; trial < 1000; ++trial) {
    const Vector raw = in_cube(random, 1);
    const Vector normal = (1 / norm(raw)) * raw;
    const double depth = random.uniform(-0.02, 0.05), approach = random.uniform(-5, 5);
    const Vector f = self_collision_force(p, depth, normal, approach);
    const double along = dot(f, normal);
    CHECK(along >= 0);
    CHECK(norm(f - along * normal) < 1e-9);
    if (depth <= 0) CHECK(norm(f) == 0);
    const double law = p.self_stiffness * depth + p.self_damping * approach;
    if (depth > 0 && law > 0) CHECK(along == doctest::Approx(law));
    if (depth > 0 && law <= 0) CHECK(along == 0);
    pushes += along > 0;
    lets_go += depth > 0 && along == 0;
    // Faster together never pushes less.
    CHECK(dot(self_collision_force(p, depth, normal, approach + 0.1), normal) >= along);
  }
  CHECK(pushes > 300);
  CHECK(lets_go > 50);
  CHECK(norm(self_collision_force(p, 0.0, Vector{0, 0, 1}, 5.0)) == 0);
}

TEST_CASE("self-collision: packs do the arithmetic of plain numbers") {
  using P = Pack<double, 4>;
  using Lanes = traceur::core::Vector3<P>;
  const Parameters p;
  RandomStream random(507);
  const auto put = [](Lanes& to, int lane, const Vector& from) {
    to.x.set(lane, from.x);
    to.y.set(lane, from.y);
    to.z.set(lane, from.z);
  };
  for (int trial = 0; trial < 300; ++trial) {
    Lanes a, u, b, v, normal;
    P depth, approach;
    SegmentPair<double> one[4];
    Vector force[4];
    for (int l = 0; l < 4; ++l) {
      Segment x = any_segment(random, 0.5), y = any_segment(random, 0.5);
      // Parallel ones and points beside ordinary ones.
      if (l == 1) y.half = -0.7 * x.half;
      if (l == 2) x.half = {0, 0, 0};
      one[l] = closest(x, y);
      put(a, l, x.middle);
      put(u, l, x.half);
      put(b, l, y.middle);
      put(v, l, y.half);
      const double d = random.uniform(-0.02, 0.05), w = random.uniform(-5, 5);
      const Vector n = random.uniform() * in_cube(random, 1);
      force[l] = self_collision_force(p, d, n, w);
      put(normal, l, n);
      depth.set(l, d);
      approach.set(l, w);
    }
    const SegmentPair<P> all = closest_points(a, u, b, v);
    const Lanes forces = self_collision_force(p, depth, normal, approach);
    for (int l = 0; l < 4; ++l) {
      CHECK(all.on_a.x[l] == doctest::Approx(one[l].on_a.x));
      CHECK(all.on_a.z[l] == doctest::Approx(one[l].on_a.z));
      CHECK(all.on_b.y[l] == doctest::Approx(one[l].on_b.y));
      CHECK(forces.x[l] == doctest::Approx(force[l].x));
      CHECK(forces.z[l] == doctest::Approx(force[l].z));
    }
  }
}
