// SPDX-License-Identifier: MIT
#include <traceur/terrain/augmentation.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/terrain/local_map.hpp>

namespace {

using namespace traceur;
using core::RandomStream;
using terrain::HeightBounds;
using terrain::HeightGrid;
using Vector = core::Vector3<double>;
using Quaternion = core::Quaternion<double>;

constexpr double infinity = std::numeric_limits<double>::infinity();

HeightGrid rough(RandomStream& random, int nx, int ny, double low = -1, double high = 1) {
  Eigen::MatrixXd h(nx, ny);
  for (Eigen::Index k = 0; k < h.size(); ++k) h.data()[k] = random.uniform(low, high);
  return HeightGrid(h, 0.4, -2, 1);
}

Quaternion any_rotation(RandomStream& random) {
  return Quaternion{random.normal(), random.normal(), random.normal(), random.normal()}.normalized();
}

/// A body of one shape of each kind on three free-standing joints is not needed: shapes are given where they are.
struct Part {
  body::Shape::Kind kind;
  Vector center, size;
  Quaternion rotation;

  void add_to(HeightBounds& bounds) const {
    if (kind == body::Shape::Kind::sphere) bounds.add_ball(center, size.x);
    if (kind == body::Shape::Kind::capsule) {
      const Vector axis = rotation.rotate({0, 0, size.y});
      bounds.add_capsule(center - axis, center + axis, size.x);
    }
    if (kind == body::Shape::Kind::box) bounds.add_box(center, size, rotation);
  }

  /// A point of the surface or of the inside.
  Vector point(RandomStream& random) const {
    const Vector u{random.normal(), random.normal(), random.normal()};
    const Vector unit = (1 / norm(u)) * u;
    if (kind == body::Shape::Kind::sphere) return center + size.x * unit;
    if (kind == body::Shape::Kind::capsule)
      return center + rotation.rotate({0, 0, random.uniform(-size.y, size.y)}) + size.x * unit;
    const double most = std::max({std::abs(u.x), std::abs(u.y), std::abs(u.z)});
    return center + rotation.rotate({u.x / most * size.x, u.y / most * size.y, u.z / most * size.z});
  }
};

Part any_part(RandomStream& random, const HeightGrid& grid, double above) {
  const auto kind = static_cast<body::Shape::Kind>(random.below(3));
  const double x = grid.x0() + random.uniform(-1, grid.nx() * grid.cell() + 1);
  const double y = grid.y0() + random.uniform(-1, grid.ny() * grid.cell() + 1);
  return {kind,
          {x, y, grid.height(x, y) + random.uniform(0, above)},
          {random.uniform(0.04, 0.3), random.uniform(0.02, 0.5), random.uniform(0.02, 0.4)},
          any_rotation(random)};
}

std::string message(const auto& f) {
  try {
    f();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE(
    "bounds: no point of the body has higher ground over it on an augmented terrain than it had, or than itself") {
  RandomStream random(11);
  int raised = 0, lowered = 0;
  for (int trial = 0; trial < 60; ++trial) {
    const HeightGrid grid = rough(random, 14, 12);
    HeightBounds bounds(grid);
    std::vector<Part> parts;
    for (int k = 0; k < 20; ++k) {
      parts.push_back(any_part(random, grid, 1.5));
      parts.back().add_to(bounds);
    }
    for (int variant = 0; variant < 4; ++variant) {
      const HeightGrid other = terrain::augmented(bounds, {}, random);
      int bad = 0;
      for (const Part& part : parts)
        for (int n = 0; n < 60; ++n) {
          const Vector p = part.point(random);
          const double before = grid.height(p.x, p.y), after = other.height(p.x, p.y);
          // A point whose ground rose stays clear of it by the margin.
          if (after > before && after > p.z - 0.02 + 1e-9) ++bad;
        }
      CHECK(bad == 0);
      raised += static_cast<int>((other.heights().array() > grid.heights().array()).count());
      lowered += static_cast<int>((other.heights().array() < grid.heights().array()).count());
      CHECK((other.heights().array() <= bounds.upper().array()).all());
      CHECK((other.heights().array() >= bounds.lower().array()).all());
    }
  }
  CHECK(raised > 1000);
  CHECK(lowered > 1000);
}

TEST_CASE("bounds: the terrain as it is lies within them") {
  RandomStream random(12);
  const HeightGrid grid = rough(random, 10, 10);
  HeightBounds bounds(grid);
  // Half the parts are in the ground.
  for (int k = 0; k < 60; ++k) {
    Part part = any_part(random, grid, 1);
    part.center.z -= 0.5;
    part.add_to(bounds);
  }
  Eigen::MatrixXd h = grid.heights();
  bounds.clamp(h);
  CHECK(h == grid.heights());
  CHECK((bounds.lower().array() <= bounds.upper().array()).all());
}

TEST_CASE("bounds: ground that carried the body, and walls beside it, stay") {
  RandomStream random(13);
  for (int trial = 0; trial < 200; ++trial) {
    const HeightGrid grid = rough(random, 10, 10);
    HeightBounds bounds(grid);
    // A foot that just touches the top of a cell, and one that is 4 cm off.
    const int i = 1 + static_cast<int>(random.below(8)), j = 1 + static_cast<int>(random.below(8));
    const double off = trial % 2 == 0 ? 0 : 0.04;
    bounds.add_ball({grid.center_x(i), grid.center_y(j), grid(i, j) + 0.1 + off}, 0.1);
    CHECK(bounds.lower()(i, j) == grid(i, j));
    CHECK(bounds.upper()(i, j) <= grid(i, j) + 0.02 + 1e-12);
  }
  // A hand at 1 m pushes against a wall of 2 m to its east; the wall may lose what is above the hand, no more.
  Eigen::MatrixXd h = Eigen::MatrixXd::Zero(6, 6);
  h.rightCols(6).bottomRows(3).setConstant(2);
  const HeightGrid grid(h, 0.4, 0, 0);
  HeightBounds bounds(grid);
  bounds.add_ball({1.2 - 0.06, 1.0, 1.0}, 0.05);
  CHECK(bounds.lower()(3, 2) == doctest::Approx(1.05));
  CHECK(bounds.upper()(3, 2) == infinity);
  CHECK(bounds.lower()(2, 2) == -infinity);
  CHECK(bounds.upper()(2, 2) == doctest::Approx(0.95 - 0.02));
  CHECK(bounds.lower()(4, 2) == -infinity);
}

TEST_CASE("bounds: of a ball exact, of a capsule at most 3 % of its radius lower than exact, of a box exact") {
  RandomStream random(14);
  const HeightGrid grid(Eigen::MatrixXd::Constant(12, 12, -5), 0.4, 0, 0);
  for (int trial = 0; trial < 60; ++trial) {
    Part part = any_part(random, grid, 0);
    part.center = {random.uniform(1, 3.8), random.uniform(1, 3.8), random.uniform(-1, 1)};
    HeightBounds bounds(grid, {0, 0.05});
    part.add_to(bounds);
    // Lowest of very many points of the surface, cell by cell.
    Eigen::MatrixXd lowest = Eigen::MatrixXd::Constant(12, 12, infinity);
    for (int n = 0; n < 20000; ++n) {
      const Vector p = part.point(random);
      double& z = lowest(grid.column(p.x), grid.row(p.y));
      z = std::min(z, p.z);
    }
    const double slack = part.kind == body::Shape::Kind::capsule ? 0.032 * part.size.x : 1e-9;
    int bad = 0, loose = 0, covered = 0;
    for (int j = 0; j < 12; ++j)
      for (int i = 0; i < 12; ++i) {
        if (lowest(i, j) == infinity) continue;
        ++covered;
        if (bounds.upper()(i, j) > lowest(i, j) + 1e-9) ++bad;
        // Sampling misses some of the depth where it meets little of the body.
        if (bounds.upper()(i, j) < lowest(i, j) - slack - 0.06) ++loose;
      }
    CHECK(covered > 0);
    CHECK(bad == 0);
    CHECK(loose <= covered / 4);
  }
}

TEST_CASE("bounds: beyond the grid the border's cells go on") {
  const HeightGrid grid(Eigen::MatrixXd::Zero(4, 4), 0.4, 0, 0);
  HeightBounds ball(grid), box(grid);
  ball.add_ball({-3, 0.6, 0.5}, 0.1);
  box.add_box({-3, 0.6, 0.5}, {0.1, 0.1, 0.1}, Quaternion::identity());
  for (const HeightBounds* bounds : {&ball, &box}) {
    CHECK(bounds->upper()(0, 1) == doctest::Approx(0.38));
    CHECK(bounds->upper()(1, 1) == infinity);
    CHECK(bounds->upper()(0, 3) == infinity);
  }
}

TEST_CASE("bounds: a character's shapes are those parts") {
  body::Character c;
  c.name = "three";
  body::Joint root;
  root.name = root.body = "root";
  root.type = body::JointType::free;
  c.skeleton.add(root);
  RandomStream random(15);
  const HeightGrid grid = rough(random, 12, 12);
  HeightBounds whole(grid), parts(grid);
  const Vector position{0.3, 3.1, 1.4};
  const Quaternion rotation = any_rotation(random);
  for (const body::Shape::Kind kind : {body::Shape::Kind::sphere, body::Shape::Kind::capsule, body::Shape::Kind::box}) {
    body::Shape s;
    s.kind = kind;
    s.body = 0;
    s.position = {random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5)};
    s.rotation = any_rotation(random);
    s.size = {0.1, 0.3, 0.2};
    c.shapes.push_back(s);
    Part{kind, position + rotation.rotate(s.position), s.size, rotation * s.rotation}.add_to(parts);
  }
  body::Frames<double> frames(c.skeleton);
  frames.position[0] = position;
  frames.rotation[0] = rotation;
  whole.add(c, frames);
  CHECK(whole.upper() == parts.upper());
  CHECK(whole.lower() == parts.lower());
}

TEST_CASE("augmentation: the same for the same seed, and none where nothing is asked for") {
  RandomStream make(16);
  const HeightGrid grid = rough(make, 16, 16);
  const HeightBounds free(grid);
  RandomStream one(3), two(3), three(4);
  const Eigen::MatrixXd first = terrain::augmented(free, {}, one).heights();
  CHECK(first == terrain::augmented(free, {}, two).heights());
  CHECK(first != terrain::augmented(free, {}, three).heights());
  terrain::Augmentation nothing;
  nothing.boxes = nothing.flattenings = 0;
  nothing.shift_chance = 0;
  CHECK(terrain::augmented(free, nothing, one).heights() == grid.heights());
  nothing.rise_min = 3;
  CHECK(message([&] { terrain::augmented(free, nothing, one); }) ==
        "augmentation: expected numbers of zero or more and ranges that are not empty");
}

TEST_CASE("augmentation: a view is augmented as a terrain of its own") {
  RandomStream random(17);
  const HeightGrid grid = rough(random, 30, 30);
  const terrain::SquareMap square;
  const terrain::LocalMap<double> map(square);
  const auto frame = terrain::HeadingFrame<double>::at({3, 6, 1.2}, 0.7);
  std::vector<double> heights(static_cast<std::size_t>(map.size()));
  map.sample(grid, frame, heights);
  HeightBounds bounds(terrain::local_grid<double>(square, heights));
  const Vector foot{0.5, -0.2, bounds.grid().height(0.5, -0.2) + 0.1};
  bounds.add_ball(foot, 0.1);
  for (int k = 0; k < 20; ++k) {
    const HeightGrid other = terrain::augmented(bounds, {}, random);
    CHECK(other.height(foot.x, foot.y) == bounds.grid().height(foot.x, foot.y));
  }
}

TEST_CASE("bounds: what is no place is refused") {
  HeightBounds bounds(HeightGrid::flat());
  CHECK(message([&] { bounds.add_ball({0, infinity, 0}, 0.1); }) == "height bounds: a place is not finite");
  CHECK(message([] {
          HeightBounds(HeightGrid::flat(), {-1, 0});
        }) == "height bounds: expected clearance and support of zero or more");
}
