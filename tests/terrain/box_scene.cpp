// SPDX-License-Identifier: MIT
#include <traceur/terrain/box_scene.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/random.hpp>

namespace {

using traceur::Error;
using traceur::core::Pack;
using traceur::core::RandomStream;
using traceur::terrain::Box;
using traceur::terrain::box_distance;
using traceur::terrain::BoxSample;
using traceur::terrain::BoxScene;
using Vector = traceur::core::Vector3<double>;
using Quaternion = traceur::core::Quaternion<double>;

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double no_number = std::numeric_limits<double>::quiet_NaN();
constexpr double pi = 3.14159265358979323846;

Vector in_cube(RandomStream& random, double half) {
  return {random.uniform(-half, half), random.uniform(-half, half), random.uniform(-half, half)};
}

Quaternion any_rotation(RandomStream& random) {
  return Quaternion{random.normal(), random.normal(), random.normal(), random.normal()}.normalized();
}

Box any_box(RandomStream& random, double spread, double largest) {
  Box b;
  b.center = in_cube(random, spread);
  b.half_size = {random.uniform(0.02, largest), random.uniform(0.02, largest), random.uniform(0.02, largest)};
  b.rotation = any_rotation(random);
  return b;
}

std::array<Vector, 3> axes(const Box& b) {
  return {b.rotation.rotate({1, 0, 0}), b.rotation.rotate({0, 1, 0}), b.rotation.rotate({0, 0, 1})};
}

/// Outside the distance from the closest point of the solid, inside that from the nearest of the six faces' planes.
double brute_force(const Box& b, const Vector& point) {
  const std::array<Vector, 3> e = axes(b);
  const double h[3] = {b.half_size.x, b.half_size.y, b.half_size.z};
  Vector closest = b.center;
  double nearest_face = infinity;
  for (std::size_t k = 0; k < 3; ++k) {
    const double along = dot(point - b.center, e[k]);
    closest += std::clamp(along, -h[k], h[k]) * e[k];
    for (const double side : {-1.0, 1.0}) nearest_face = std::min(nearest_face, h[k] - side * along);
  }
  return nearest_face > 0 ? -nearest_face : norm(point - closest);
}

double brute_force(const std::vector<Box>& boxes, const Vector& point) {
  double least = infinity;
  for (const Box& b : boxes) least = std::min(least, brute_force(b, point));
  return least;
}

/// Overlaps are of no matter to most cases here.
BoxScene scene_of(std::vector<Box> boxes) { return BoxScene(std::move(boxes), "scene", infinity); }

std::string message(const std::vector<Box>& boxes, const std::string& where = "hall.json") {
  try {
    BoxScene scene(boxes, where);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

Box upright(const Vector& center, const Vector& half_size) {
  Box b;
  b.center = center;
  b.half_size = half_size;
  return b;
}

}  // namespace

TEST_CASE("box: the signed distance is that of the closest point, inside that of the nearest face") {
  RandomStream random(301);
  int inside = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const Box b = any_box(random, 3, 1.5);
    const BoxScene scene = scene_of({b});
    for (int n = 0; n < 50; ++n) {
      const Vector point = b.center + in_cube(random, n % 2 ? 1.0 : 4.0);
      const double expected = brute_force(b, point);
      const BoxSample<double> s = scene.sample(point);
      CHECK(std::abs(s.distance - expected) < 1e-12);
      CHECK(std::abs(norm(s.normal) - 1) < 1e-12);
      // Going back along the normal by the distance leads to the surface.
      CHECK(std::abs(brute_force(b, point - s.distance * s.normal)) < 1e-12);
      inside += expected < 0;
    }
  }
  CHECK(inside > 500);
  CHECK(inside < 9500);
}

TEST_CASE("box: the normal is the gradient of the distance away from creases") {
  RandomStream random(302);
  constexpr double h = 1e-5;
  int compared = 0;
  for (int trial = 0; trial < 4000; ++trial) {
    const Box b = any_box(random, 3, 1.5);
    const BoxScene scene = scene_of({b});
    const Vector point = b.center + in_cube(random, 2);
    // Inside, the crease is where two faces are equally near.
    const Vector local = b.rotation.conjugate().rotate(point - b.center);
    std::array<double, 3> to_face{std::abs(local.x) - b.half_size.x, std::abs(local.y) - b.half_size.y,
                                  std::abs(local.z) - b.half_size.z};
    std::sort(to_face.begin(), to_face.end());
    if (to_face[2] < 1e-3 && to_face[2] - to_face[1] < 1e-3) continue;
    // Close to an edge the gradient turns faster than a difference over h can tell.
    if (to_face[2] > 0 && to_face[2] < 0.05) continue;
    ++compared;
    const auto along = [&](const Vector& e) {
      return (scene.sample(point + h * e).distance - scene.sample(point - h * e).distance) / (2 * h);
    };
    const Vector gradient{along({1, 0, 0}), along({0, 1, 0}), along({0, 0, 1})};
    CHECK(norm(scene.sample(point).normal - gradient) < 1e-6);
  }
  CHECK(compared > 2000);
}

TEST_CASE("box: on the surface and by rounding off it the normal has length one") {
  for (const double off : {0.0, 5e-17, 1e-16, 1e-15, 1e-13, 0.9e-12, 1.1e-12, 1e-9}) {
    const Vector h{1e-3, 2e-3, 3e-3};
    const BoxSample<double> face = box_distance<double>({h.x + off, 0, 0}, h);
    CHECK(norm(face.normal - Vector{1, 0, 0}) < 1e-12);
    CHECK(std::abs(face.distance - off) < 1e-18);
    const BoxSample<double> corner = box_distance<double>({-h.x - off, h.y + off, -h.z - off}, h);
    CHECK(std::abs(norm(corner.normal) - 1) < 1e-12);
    CHECK(corner.normal.x <= 0);
    CHECK(corner.normal.y >= 0);
    CHECK(corner.normal.z <= 0);
  }
  // 0.1 + 0.2 is just beyond 0.3.
  CHECK(norm(box_distance<double>({0.1 + 0.2, 0, 0}, {0.3, 0.3, 0.3}).normal) == doctest::Approx(1));
  // A box of no size is a point.
  CHECK(norm(box_distance<double>({0, 0, 0}, {0, 0, 0}).normal) == 1);
  CHECK(box_distance<double>({3, 0, -4}, {0, 0, 0}).distance == doctest::Approx(5));
}

TEST_CASE("box: the signed distance is convex, inside too") {
  RandomStream random(303);
  int within = 0, through = 0;
  for (int trial = 0; trial < 4000; ++trial) {
    const Box b = any_box(random, 3, 1.5);
    const BoxScene scene = scene_of({b});
    const Vector from = b.center + in_cube(random, trial % 2 ? 0.8 : 3), to = b.center + in_cube(random, trial % 2 ? 0.8 : 3);
    const double at_from = scene.sample(from).distance, at_to = scene.sample(to).distance;
    within += at_from < 0 && at_to < 0;
    through += (at_from < 0) != (at_to < 0);
    for (const double share : {0.1, 0.35, 0.5, 0.8}) {
      const BoxSample<double> s = scene.sample(from + share * (to - from));
      CHECK(s.distance <= at_from + share * (at_to - at_from) + 1e-12);
      // The normal is a slope that the whole graph stays above.
      CHECK(at_to >= s.distance + (1 - share) * dot(s.normal, to - from) - 1e-12);
      CHECK(at_from >= s.distance - share * dot(s.normal, to - from) - 1e-12);
    }
  }
  CHECK(within > 200);
  CHECK(through > 200);
}

TEST_CASE("box: packs do the arithmetic of plain numbers") {
  using P = Pack<float>;
  RandomStream random(304);
  for (int trial = 0; trial < 1000; ++trial) {
    traceur::core::Vector3<P> p, h;
    traceur::core::Vector3<float> p1[P::width], h1[P::width];
    for (int l = 0; l < P::width; ++l) {
      const auto at = static_cast<std::size_t>(l);
      p1[at] = in_cube(random, 1.5).cast<float>();
      h1[at] = {random.uniform<float>(0, 1), random.uniform<float>(0, 1), random.uniform<float>(0, 1)};
      // Lanes on a face, on an edge and at the middle as well.
      if (l % 4 == 1) p1[at].x = h1[at].x;
      if (l % 4 == 2) p1[at] = {-h1[at].x, h1[at].y, p1[at].z};
      if (trial % 8 == 3 && l == 0) p1[at] = {0, 0, 0};
      p.x.set(l, p1[at].x);
      p.y.set(l, p1[at].y);
      p.z.set(l, p1[at].z);
      h.x.set(l, h1[at].x);
      h.y.set(l, h1[at].y);
      h.z.set(l, h1[at].z);
    }
    const BoxSample<P> all = box_distance(p, h);
    for (int l = 0; l < P::width; ++l) {
      const auto at = static_cast<std::size_t>(l);
      const BoxSample<float> one = box_distance(p1[at], h1[at]);
      CHECK(all.distance[l] == doctest::Approx(one.distance).epsilon(1e-6));
      CHECK(all.normal.x[l] == doctest::Approx(one.normal.x).epsilon(1e-6));
      CHECK(all.normal.y[l] == doctest::Approx(one.normal.y).epsilon(1e-6));
      CHECK(all.normal.z[l] == doctest::Approx(one.normal.z).epsilon(1e-6));
    }
  }
}

TEST_CASE("box: its bounds touch its outermost corners") {
  RandomStream random(305);
  for (int trial = 0; trial < 200; ++trial) {
    const Box b = any_box(random, 3, 1.5);
    const std::array<Vector, 3> e = axes(b);
    Vector most{-infinity, -infinity, -infinity};
    for (int corner = 0; corner < 8; ++corner) {
      const Vector at = ((corner & 1 ? 1 : -1) * b.half_size.x) * e[0] + ((corner & 2 ? 1 : -1) * b.half_size.y) * e[1] +
                        ((corner & 4 ? 1 : -1) * b.half_size.z) * e[2];
      most = {std::max(most.x, at.x), std::max(most.y, at.y), std::max(most.z, at.z)};
    }
    CHECK(norm(b.half_bounds() - most) < 1e-12);
  }
}

TEST_CASE("box scene: the distance is that of the nearest box") {
  RandomStream random(306);
  for (int trial = 0; trial < 30; ++trial) {
    std::vector<Box> boxes;
    for (int n = 0; n < 12; ++n) boxes.push_back(any_box(random, 4, 1));
    const BoxScene scene = scene_of(boxes);
    CHECK(scene.size() == 12);
    CHECK_FALSE(scene.empty());
    for (int n = 0; n < 100; ++n) {
      const Vector point = in_cube(random, 6);
      CHECK(std::abs(scene.sample(point).distance - brute_force(boxes, point)) < 1e-12);
    }
  }
}

TEST_CASE("box scene: near misses no box within the radius, and lists each once in order") {
  RandomStream random(307);
  int found = 0, listed = 0, possible = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const double spread = trial % 3 == 0 ? 5000 : trial % 3 == 1 ? 15 : 1;
    std::vector<Box> boxes;
    const int count = 1 + static_cast<int>(random.uniform(0, 40));
    for (int n = 0; n < count; ++n) boxes.push_back(any_box(random, spread, n % 10 ? 1.5 : 30));
    const BoxScene scene = scene_of(boxes);
    for (int n = 0; n < 40; ++n) {
      // Most places are near some box, some are anywhere, beyond the outermost boxes too.
      const Vector point = n % 4 ? boxes[static_cast<std::size_t>(n % count)].center + in_cube(random, 5)
                                 : in_cube(random, 1.5 * spread);
      const double radius = n % 5 ? random.uniform(0, 6) : n % 2 ? 0 : random.uniform(0, 2 * spread);
      std::vector<int> out{77, -3};
      scene.near(point, radius, out);
      REQUIRE(out.size() >= 2);
      // It appends.
      CHECK(out[0] == 77);
      CHECK(out[1] == -3);
      out.erase(out.begin(), out.begin() + 2);
      for (std::size_t k = 0; k < out.size(); ++k) {
        CHECK(out[k] >= 0);
        CHECK(out[k] < count);
        if (k > 0) CHECK(out[k] > out[k - 1]);
      }
      for (int b = 0; b < count; ++b)
        if (brute_force(boxes[static_cast<std::size_t>(b)], point) <= radius - 1e-9) {
          CHECK(std::binary_search(out.begin(), out.end(), b));
          ++found;
        }
      if (spread == 5000 && radius < 7) {
        listed += static_cast<int>(out.size());
        possible += count;
      }
    }
  }
  CHECK(found > 1000);
  // Far apart, what is listed is a small share of all.
  CHECK(listed < possible / 4);
}

TEST_CASE("box scene: near is safe wherever it is asked") {
  const Vector half{1, 1, 1};
  const BoxScene scene = scene_of({upright({0, 0, 0}, half), upright({2500, 0, 0}, half), upright({-2500, 40, 0}, half)});
  std::vector<int> out;
  for (const Vector& bad : {Vector{no_number, 0, 0}, Vector{0, no_number, 0}, Vector{0, 0, no_number},
                            Vector{infinity, 0, 0}, Vector{0, -infinity, 0}})
    scene.near(bad, 10, out);
  scene.near({0, 0, 0}, no_number, out);
  CHECK(out.empty());
  scene.near({1e300, -1e300, 1e300}, 1, out);
  CHECK(out.empty());
  scene.near({0, 0, 0}, infinity, out);
  CHECK(out == std::vector<int>{0, 1, 2});
  out.clear();
  scene.near({2502, 0, 0}, 1, out);
  CHECK(out == std::vector<int>{1});
}

TEST_CASE("box scene: without boxes everything is far away") {
  const BoxScene none, also_none({}, "scene");
  for (const BoxScene* scene : {&none, &also_none}) {
    CHECK(scene->empty());
    CHECK(scene->size() == 0);
    CHECK(scene->sample({1, 2, 3}).distance == infinity);
    CHECK(norm(scene->sample({1, 2, 3}).normal) == 1);
    std::vector<int> out;
    scene->near({0, 0, 0}, 1e9, out);
    CHECK(out.empty());
  }
}

TEST_CASE("boxes: the overlap of closed cases") {
  const auto overlap = [](const Box& a, const Box& b) {
    CHECK(BoxScene::overlap_of(a, b) == doctest::Approx(BoxScene::overlap_of(b, a)));
    return BoxScene::overlap_of(a, b);
  };
  const Box cube = upright({0, 0, 0}, {0.5, 0.5, 0.5});
  CHECK(std::abs(overlap(cube, upright({1, 0.2, -0.3}, {0.5, 0.5, 0.5}))) < 1e-15);
  CHECK(overlap(cube, upright({0, 0, 0.9}, {0.5, 0.5, 0.5})) == doctest::Approx(0.1));
  CHECK(overlap(cube, upright({3, 0, 0}, {0.5, 0.5, 0.5})) == doctest::Approx(-2));
  // One within the other has to leave by the nearer side.
  CHECK(overlap(upright({0, 0, 0}, {2, 2, 2}), upright({1, 0, 0}, {0.25, 0.25, 0.25})) == doctest::Approx(1.25));
  // A quarter turned the edge is ahead by half the diagonal.
  Box turned = cube;
  turned.rotation = about_axis(Vector{0, 0, 1}, pi / 4);
  turned.center = {0.5 + std::sqrt(0.5), 0.3, 0.1};
  CHECK(std::abs(overlap(cube, turned)) < 1e-12);
  turned.center.x -= 0.02;
  CHECK(overlap(cube, turned) == doctest::Approx(0.02));
  // Two crossed edges: only the axis across both tells the boxes apart.
  Box below = cube, above = cube;
  below.rotation = about_axis(Vector{1, 0, 0}, pi / 4);
  above.rotation = about_axis(Vector{0, 1, 0}, pi / 4);
  above.center = {0, 0, 2 * std::sqrt(0.5)};
  CHECK(std::abs(overlap(below, above)) < 1e-12);
  above.center.z += 0.05;
  CHECK(overlap(below, above) == doctest::Approx(-0.05));
}

TEST_CASE("boxes: they overlap where a point is in both, and no shorter shift parts them") {
  RandomStream random(308);
  int common = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const Box a = any_box(random, 0.7, 0.8), b = any_box(random, 0.7, 0.8);
    const double overlap = BoxScene::overlap_of(a, b);
    const std::array<Vector, 3> e = axes(a);
    bool shared = false;
    double deepest = 0;
    for (int n = 0; n < 300; ++n) {
      const Vector point = a.center + random.uniform(-a.half_size.x, a.half_size.x) * e[0] +
                           random.uniform(-a.half_size.y, a.half_size.y) * e[1] +
                           random.uniform(-a.half_size.z, a.half_size.z) * e[2];
      const double in_b = brute_force(b, point);
      shared = shared || in_b < 0;
      // A ball that fits into both makes them at least its diameter deep.
      deepest = std::max(deepest, -std::max(in_b, brute_force(a, point)));
      // Apart, the gap between the planes is not more than the distance.
      if (overlap < 0) CHECK(in_b >= -overlap - 1e-12);
    }
    if (shared) CHECK(overlap > 0);
    CHECK(overlap >= (shared ? 2 * deepest - 1e-12 : -infinity));
    common += shared;
    if (overlap <= 0) continue;
    // The overlap is the shortest way out.
    double least = infinity;
    for (int n = 0; n < 60; ++n) {
      const Vector raw = in_cube(random, 1);
      const Vector way = (1 / norm(raw)) * raw;
      Box moved = b;
      moved.center += (0.999 * overlap) * way;
      least = std::min(least, BoxScene::overlap_of(a, moved));
    }
    CHECK(least > 0);
  }
  CHECK(common > 100);
  CHECK(common < 390);
}

TEST_CASE("box scene: refuses what is no solid box, and says which") {
  const Box good = upright({0, 0, 0.5}, {0.5, 0.5, 0.5}), other = upright({5, 0, 0.5}, {0.5, 0.5, 0.5});
  CHECK(message({good, other}) == "");
  const std::string second = "hall.json: box 1: ";
  for (const double size : {0.0, -1.0, no_number, infinity}) {
    for (int k = 0; k < 3; ++k) {
      Box bad = other;
      (k == 0 ? bad.half_size.x : k == 1 ? bad.half_size.y : bad.half_size.z) = size;
      CHECK(message({good, bad}) == second + "expected half sizes above zero");
    }
  }
  for (const double place : {no_number, infinity, -infinity}) {
    for (int k = 0; k < 3; ++k) {
      Box bad = other;
      (k == 0 ? bad.center.x : k == 1 ? bad.center.y : bad.center.z) = place;
      CHECK(message({good, bad}) == second + "centre is not finite");
    }
  }
  for (const Quaternion& q : {Quaternion{0, 0, 0, 0}, Quaternion{0, 0, 0, 1.01}, Quaternion{0, no_number, 0, 1},
                              Quaternion{infinity, 0, 0, 1}}) {
    Box bad = other;
    bad.rotation = q;
    CHECK(message({good, bad}) == second + "rotation is not a unit quaternion");
  }
  CHECK(message({upright({1e308, 0, 0}, {1, 1, 1}), upright({-1e308, 0, 0}, {1, 1, 1})}) == "hall.json: boxes are too far apart");
  CHECK(message({upright({0, 1e308, 0}, {1, 1, 1}), upright({0, -1e308, 0}, {1, 1, 1})}) == "hall.json: boxes are too far apart");
  Box bad = good;
  bad.half_size.z = 0;
  CHECK(message({bad}, "stair.json: scene") == "stair.json: scene: box 0: expected half sizes above zero");
}

TEST_CASE("box scene: refuses boxes that overlap, accepts those that touch") {
  const Vector half{0.5, 0.5, 0.5};
  const auto row = [&](double apart) {
    return std::vector<Box>{upright({-9, 0, 0}, half), upright({0, 0, 0}, half), upright({9, 0, 0}, half),
                            upright({apart, 0, 0}, half)};
  };
  CHECK(message(row(1)) == "");
  CHECK(message(row(0.9995)) == "");
  CHECK(message(row(0.998)) == "hall.json: boxes 1 and 3 overlap");
  CHECK(message(row(0)) == "hall.json: boxes 1 and 3 overlap");
  CHECK_NOTHROW(BoxScene(row(0.95), "hall.json", 0.06));
  CHECK_THROWS_AS(BoxScene(row(0.95), "hall.json", 0.04), Error);
  // A small one within a large one, whose middles are far apart, in either order.
  const Box large = upright({0, 0, 0}, {20, 20, 0.1}), small = upright({15, -15, 0}, {0.05, 0.05, 0.05});
  CHECK(message({large, small}) == "hall.json: boxes 0 and 1 overlap");
  CHECK(message({small, large}) == "hall.json: boxes 0 and 1 overlap");
  // Turned by 45 degrees it would touch at half the diagonal.
  Box turned = upright({0.5 + std::sqrt(0.5), 0, 0}, half);
  turned.rotation = about_axis(Vector{0, 0, 1}, pi / 4);
  CHECK(message({upright({0, 0, 0}, half), turned}) == "");
  turned.center.x -= 0.01;
  CHECK(message({upright({0, 0, 0}, half), turned}) == "hall.json: boxes 0 and 1 overlap");
  // A stair of touching steps.
  std::vector<Box> stair;
  for (int n = 0; n < 30; ++n) stair.push_back(upright({0.3 * n, 0, 0.09 * (n + 1)}, {0.15, 0.6, 0.09 * (n + 1)}));
  CHECK(message(stair) == "");
}

TEST_CASE("box scene: every overlapping pair is found, wherever it is") {
  RandomStream random(309);
  int refused = 0;
  for (int trial = 0; trial < 300; ++trial) {
    std::vector<Box> boxes;
    for (int n = 0; n < 8; ++n) boxes.push_back(any_box(random, trial % 2 ? 4 : 3000, trial % 2 ? 1 : 300));
    bool any = false;
    for (std::size_t i = 0; i < boxes.size(); ++i)
      for (std::size_t j = 0; j < i; ++j) any = any || BoxScene::overlap_of(boxes[i], boxes[j]) > 1e-3;
    CHECK((message(boxes) != "") == any);
    refused += any;
  }
  CHECK(refused > 30);
  CHECK(refused < 270);
}

TEST_CASE("docs/terrain.md: boxes") {
  const traceur::terrain::BoxScene scene({traceur::terrain::Box{{2, 0, 0.4}, {0.3, 1, 0.4}}});
  CHECK(scene.sample({2, 0, 1.0}).distance == doctest::Approx(0.2));  // 0.2 m
}
