// SPDX-License-Identifier: MIT
#include <traceur/body/surface_points.hpp>

#include <cmath>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/pack.hpp>

#include "../error_message.hpp"

using namespace traceur;
using body::Shape;
using body::SurfacePoint;
using body::SurfaceSampling;
using Vec = core::Vector3<double>;

namespace {

Shape shape(Shape::Kind kind, Vec size) {
  Shape s;
  s.kind = kind;
  s.name = "thing";
  s.body = 1;
  s.position = {0.1, -0.2, 0.3};
  s.rotation = core::exp_map(Vec{0.4, -0.7, 0.2});
  s.size = size;
  return s;
}

/// Distance of a point in the body's frame from the shape's surface, by definition.
double off_surface(const Shape& s, const Vec& p) {
  const Vec at = s.rotation.conjugate().rotate(p - s.position);
  if (s.kind == Shape::Kind::sphere) return std::abs(norm(at) - s.size.x);
  if (s.kind == Shape::Kind::capsule) {
    const double z = std::clamp(at.z, -s.size.y, s.size.y);
    return std::abs(norm(at - Vec{0, 0, z}) - s.size.x);
  }
  const Vec out{std::abs(at.x) - s.size.x, std::abs(at.y) - s.size.y, std::abs(at.z) - s.size.z};
  return std::abs(std::max(out.x, std::max(out.y, out.z)));
}

}  // namespace

TEST_CASE("surface points: as many as PARC's code has, all on the surface, none twice") {
  struct Case {
    Shape::Kind kind;
    Vec size;
    std::size_t count;
  };
  for (const Case& c : {Case{Shape::Kind::sphere, {0.1, 0, 0}, 12}, Case{Shape::Kind::capsule, {0.05, 0.2, 0}, 16},
                        Case{Shape::Kind::box, {0.09, 0.05, 0.03}, 36}}) {
    const Shape s = shape(c.kind, c.size);
    const std::vector<SurfacePoint> points = body::surface_points(s);
    REQUIRE(points.size() == c.count);
    Vec mean{0, 0, 0};
    for (std::size_t i = 0; i < points.size(); ++i) {
      CHECK(points[i].body == 1);
      CHECK(off_surface(s, points[i].local) < 1e-12);
      mean += (1.0 / static_cast<double>(points.size())) * points[i].local;
      for (std::size_t j = 0; j < i; ++j) CHECK(norm(points[i].local - points[j].local) > 1e-3);
    }
    CHECK(norm(mean - s.position) < 1e-12);
  }
}

TEST_CASE("surface points: the box's corners and the capsule's poles are among them") {
  const Shape box = shape(Shape::Kind::box, {0.09, 0.05, 0.03});
  int corners = 0;
  for (const SurfacePoint& p : body::surface_points(box)) {
    const Vec at = box.rotation.conjugate().rotate(p.local - box.position);
    corners += std::abs(norm(at) - norm(box.size)) < 1e-9;
  }
  CHECK(corners == 8);
  SurfaceSampling with_poles;
  with_poles.capsule_poles = true;
  const Shape capsule = shape(Shape::Kind::capsule, {0.05, 0.2, 0});
  const auto points = body::surface_points(capsule, with_poles);
  CHECK(points.size() == 18);
  CHECK(norm(points.back().local - points[points.size() - 2].local) == doctest::Approx(0.5));
  for (const SurfacePoint& p : points) CHECK(off_surface(capsule, p.local) < 1e-12);
}

TEST_CASE("surface points: subdivided spheres are finer everywhere") {
  double before = 10;
  for (int n = 0; n < 4; ++n) {
    SurfaceSampling s;
    s.sphere_subdivisions = n;
    const auto points = body::surface_points(shape(Shape::Kind::sphere, {1, 0, 0}), s);
    CHECK(points.size() == static_cast<std::size_t>(10 * (1 << (2 * n)) + 2));
    double widest = 0;
    for (const SurfacePoint& p : points) {
      double nearest = 10;
      for (const SurfacePoint& o : points)
        if (norm(p.local - o.local) > 0) nearest = std::min(nearest, norm(p.local - o.local));
      widest = std::max(widest, nearest);
    }
    CHECK(widest < 0.6 * before);
    before = widest;
  }
}

TEST_CASE("surface points: of a character body after body, and where they are in the world") {
  body::Character c;
  body::Joint root, rod;
  root.name = root.body = "root";
  root.type = body::JointType::free;
  rod.name = rod.body = "rod";
  rod.type = body::JointType::ball;
  rod.offset = {0, 0, -0.1};
  rod.parent = c.skeleton.add(root);
  c.skeleton.add(rod);
  c.shapes = {shape(Shape::Kind::box, {0.1, 0.1, 0.1}), shape(Shape::Kind::sphere, {0.1, 0, 0})};
  c.shapes[1].body = 0;
  const auto points = body::surface_points(c);
  REQUIRE(points.size() == 48);
  for (std::size_t k = 1; k < points.size(); ++k) CHECK(points[k].body >= points[k - 1].body);
  Eigen::VectorXd q = c.skeleton.neutral_pose();
  q.head<3>() << 1, 2, 3;
  core::exp_map(Vec{0.3, 0.1, 0}).store(q.data() + 7);
  body::Frames<double> frames(c.skeleton);
  body::forward_kinematics(c.skeleton, q.data(), frames);
  std::vector<double> places(3 * points.size());
  body::place_points<double>(points, frames, places.data());
  for (std::size_t k = 0; k < points.size(); ++k)
    CHECK(norm(Vec::from(&places[3 * k]) - frames.point(points[k].body, points[k].local)) == 0);
}

TEST_CASE("surface points: place many characters at once") {
  body::Skeleton s;
  body::Joint root;
  root.name = root.body = "root";
  root.type = body::JointType::free;
  s.add(root);
  using P = core::Pack<float>;
  std::vector<P> q(7, P(0.0));
  q[6] = P(1.0);
  for (int l = 0; l < P::width; ++l) q[0].set(l, static_cast<float>(l));
  body::Frames<P> frames(s);
  body::forward_kinematics(s, q.data(), frames);
  const std::vector<SurfacePoint> points{{0, {0.5, 0, 0}}};
  std::vector<P> places(3);
  body::place_points<P>(points, frames, places.data());
  for (int l = 0; l < P::width; ++l) CHECK(places[0][l] == doctest::Approx(static_cast<double>(l) + 0.5));
}

TEST_CASE("surface points: numbers out of range are refused") {
  SurfaceSampling s;
  s.sphere_subdivisions = -1;
  CHECK(traceur_test::message([&] { body::surface_points(shape(Shape::Kind::sphere, {1, 0, 0}), s); }).find("'thing'") !=
        std::string::npos);
  s.capsule_circle = 2;
  CHECK_THROWS_AS(body::surface_points(shape(Shape::Kind::capsule, {1, 1, 0}), s), Error);
  s.box_z = 1;
  CHECK_THROWS_AS(body::surface_points(shape(Shape::Kind::box, {1, 1, 1}), s), Error);
}
