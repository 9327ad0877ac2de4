// SPDX-License-Identifier: MIT
#include <traceur/terrain/signed_distance.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <tuple>
#include <vector>

#include <doctest/doctest.h>

namespace {

using traceur::core::Pack;
using traceur::terrain::contact_surface;
using traceur::terrain::HeightGrid;
using traceur::terrain::signed_distance;
using traceur::terrain::surface;
using traceur::terrain::SurfaceSample;
using Vector = traceur::core::Vector3<double>;
using Lanes = Pack<float>;

HeightGrid random_grid(unsigned seed, int nx, int ny, double cell) {
  std::mt19937 generator(seed);
  // Few different heights, so that neighbours of one height occur.
  std::uniform_int_distribution<int> step(-3, 3);
  Eigen::MatrixXd h(nx, ny);
  for (int j = 0; j < ny; ++j)
    for (int i = 0; i < nx; ++i) h(i, j) = 0.3 * step(generator);
  return HeightGrid(h, cell, -0.7, 0.3);
}

/// A rectangle of the surface, given by one corner and two sides; a side may be zero.
struct Face {
  Vector corner, u, v;
};

/// Every face of the surface listed one by one: tops, and the part of each wall that one neighbour leaves bare. The
/// border cells are continued by `margin` metres.
std::vector<Face> faces(const HeightGrid& g, double margin) {
  std::vector<Face> out;
  const auto low_x = [&](int i) { return g.x0() + i * g.cell() - (i == 0 ? margin : 0); };
  const auto high_x = [&](int i) { return g.x0() + (i + 1) * g.cell() + (i == g.nx() - 1 ? margin : 0); };
  const auto low_y = [&](int j) { return g.y0() + j * g.cell() - (j == 0 ? margin : 0); };
  const auto high_y = [&](int j) { return g.y0() + (j + 1) * g.cell() + (j == g.ny() - 1 ? margin : 0); };
  for (int j = 0; j < g.ny(); ++j)
    for (int i = 0; i < g.nx(); ++i) {
      const double wide = high_x(i) - low_x(i), deep = high_y(j) - low_y(j);
      out.push_back({{low_x(i), low_y(j), g(i, j)}, {wide, 0, 0}, {0, deep, 0}});
      if (i + 1 < g.nx() && g(i, j) != g(i + 1, j))
        out.push_back({{high_x(i), low_y(j), g(i, j)}, {0, deep, 0}, {0, 0, g(i + 1, j) - g(i, j)}});
      if (j + 1 < g.ny() && g(i, j) != g(i, j + 1))
        out.push_back({{low_x(i), high_y(j), g(i, j)}, {wide, 0, 0}, {0, 0, g(i, j + 1) - g(i, j)}});
    }
  return out;
}

double brute_force(const HeightGrid& g, const std::vector<Face>& all, const Vector& p) {
  double best = std::numeric_limits<double>::infinity();
  for (const Face& f : all) {
    const double s = std::clamp(dot(p - f.corner, f.u) / squared_norm(f.u), 0.0, 1.0);
    const double t = std::clamp(dot(p - f.corner, f.v) / squared_norm(f.v), 0.0, 1.0);
    best = std::min(best, norm(p - (f.corner + s * f.u + t * f.v)));
  }
  return p.z < g.height(p.x, p.y) ? -best : best;
}

struct Points {
  std::mt19937 generator;
  std::uniform_real_distribution<double> x, y, z;
  Points(unsigned seed, const HeightGrid& g)
      : generator(seed),
        x(g.x0() - 1, g.x0() + g.nx() * g.cell() + 1),
        y(g.y0() - 1, g.y0() + g.ny() * g.cell() + 1),
        z(g.lowest() - 1, g.highest() + 1) {}
  Vector operator()() { return {x(generator), y(generator), z(generator)}; }
};

}  // namespace

TEST_CASE("signed distance: equals that to a list of all faces, inside and outside") {
  const int sizes[][2] = {{1, 1}, {2, 1}, {1, 5}, {6, 7}, {12, 9}};
  unsigned seed = 0;
  for (const auto& size : sizes)
    for (const double cell : {0.1, 0.4}) {
      const HeightGrid g = random_grid(++seed, size[0], size[1], cell);
      const std::vector<Face> all = faces(g, 50);
      Points next(seed, g);
      int inside = 0;
      for (int k = 0; k < 3000; ++k) {
        const Vector p = next();
        const double expected = brute_force(g, all, p);
        inside += expected < 0;
        REQUIRE(signed_distance(g, p) == doctest::Approx(expected).epsilon(1e-12));
      }
      CHECK(inside > 300);
    }
}

TEST_CASE("signed distance: between two columns of one height there is no surface") {
  const HeightGrid g(Eigen::MatrixXd::Ones(4, 4), 0.5);
  CHECK(signed_distance(g, Vector{1.0, 1.0, 0.2}) == doctest::Approx(-0.8));
  Eigen::MatrixXd h = Eigen::MatrixXd::Ones(4, 4);
  h(0, 0) = 0;
  // The corner of the lower cell at (0.5, 0.5): 0.5 and 0.5 away, and bare only above 0.
  CHECK(signed_distance(HeightGrid(h, 0.5), Vector{1.0, 1.0, 0.2}) == doctest::Approx(-std::sqrt(0.5)));
  CHECK(signed_distance(HeightGrid(h, 0.5), Vector{1.0, 1.0, -0.3}) == doctest::Approx(-std::sqrt(0.5 + 0.09)));
}

TEST_CASE("signed distance: the normal is its gradient and of unit length") {
  const HeightGrid g = random_grid(5, 8, 8, 0.4);
  Points next(6, g);
  const double e = 1e-6;
  int compared = 0;
  for (int k = 0; k < 3000; ++k) {
    const Vector p = next();
    const SurfaceSample<double> s = surface(g, p);
    REQUIRE(norm(s.normal) == doctest::Approx(1.0));
    // One step against the gradient meets the surface: the nearest point is on it.
    CHECK(std::abs(signed_distance(g, p - s.distance * s.normal)) < 1e-12);
    const auto slope = [&](const Vector& d) {
      const double ahead = signed_distance(g, p + e * d) - s.distance,
                   behind = s.distance - signed_distance(g, p - e * d);
      // At a ridge of the distance the two slopes differ and there is no gradient.
      return std::abs(ahead - behind) < 1e-9 ? (ahead + behind) / (2 * e) : std::numeric_limits<double>::quiet_NaN();
    };
    const Vector n{slope({1, 0, 0}), slope({0, 1, 0}), slope({0, 0, 1})};
    if (!std::isfinite(n.x + n.y + n.z)) continue;
    ++compared;
    CHECK(norm(n - s.normal) < 1e-3);
  }
  CHECK(compared > 2900);
}

TEST_CASE("signed distance: on the surface itself the normal is still one of its own") {
  Eigen::MatrixXd h = Eigen::MatrixXd::Zero(3, 3);
  h(0, 1) = h(1, 0) = h(0, 0) = 1;
  const HeightGrid g(h, 1.0);
  const auto check = [&](const Vector& p, const Vector& n) {
    const SurfaceSample<double> s = surface(g, p);
    CHECK(std::abs(s.distance) < 1e-12);
    CHECK(norm(s.normal - n) < 1e-12);
  };
  check({1.5, 1.5, 0}, {0, 0, 1});
  check({0.5, 0.5, 1}, {0, 0, 1});
  check({1.0, 1.5, 0.5}, {1, 0, 0});
  check({1.5, 1.0, 0.5}, {0, 1, 0});
  h.setZero();
  h(0, 0) = 1;
  const SurfaceSample<double> edge = surface(HeightGrid(h, 1.0), Vector{1, 1, 0.5});
  CHECK(edge.distance == doctest::Approx(0.0));
  CHECK(norm(edge.normal) == doctest::Approx(1.0));
}

TEST_CASE("signed distance: is 1-Lipschitz") {
  const HeightGrid g = random_grid(8, 10, 10, 0.4);
  Points next(9, g);
  for (int k = 0; k < 2000; ++k) {
    const Vector a = next(), b = next();
    CHECK(std::abs(signed_distance(g, a) - signed_distance(g, b)) <= norm(a - b) + 1e-12);
  }
}

TEST_CASE("signed distance: packs and floats agree with double") {
  const HeightGrid g = random_grid(10, 9, 6, 0.4);
  Points next(11, g);
  for (int k = 0; k < 500; ++k) {
    traceur::core::Vector3<Lanes> p{Lanes(0), Lanes(0), Lanes(0)};
    Vector each[Lanes::width];
    for (int l = 0; l < Lanes::width; ++l) {
      each[l] = next();
      p.x.set(l, static_cast<float>(each[l].x));
      p.y.set(l, static_cast<float>(each[l].y));
      p.z.set(l, static_cast<float>(each[l].z));
    }
    const float reach = 0.3f;
    const SurfaceSample<Lanes> exact = surface(g, p), contact = contact_surface(g, p, reach),
                               wide = contact_surface(g, p, 2.0f);
    for (int l = 0; l < Lanes::width; ++l) {
      const Vector q{p.x[l], p.y[l], p.z[l]};
      const SurfaceSample<double> s = surface(g, q);
      CHECK(std::abs(exact.distance[l] - s.distance) < 1e-5);
      CHECK(wide.distance[l] == exact.distance[l]);
      const Vector n{contact.normal.x[l], contact.normal.y[l], contact.normal.z[l]};
      CHECK(std::abs(norm(n) - 1) < 1e-5);
      if (s.distance <= 0.299) {
        CHECK(std::abs(contact.distance[l] - s.distance) < 1e-5);
        // The normal leads to the surface, whichever of two equally near points it belongs to.
        CHECK(std::abs(signed_distance(g, q - static_cast<double>(contact.distance[l]) * n)) < 2e-5);
      } else if (s.distance > 0.301) {
        CHECK(contact.distance[l] > reach);
      }
    }
  }
}

TEST_CASE("signed distance: contacts near walls and tops have the right normals") {
  Eigen::MatrixXd h = Eigen::MatrixXd::Zero(5, 5);
  h(2, 2) = 0.5;
  const HeightGrid g(h, 0.4);
  const auto at = [&](float x, float y, float z) {
    return contact_surface(g, traceur::core::Vector3<Lanes>{Lanes(x), Lanes(y), Lanes(z)}, 0.1f);
  };
  CHECK(at(0.75f, 1.0f, 0.3f).normal.x[0] == doctest::Approx(-1.0));
  CHECK(at(0.75f, 1.0f, 0.3f).distance[0] == doctest::Approx(0.05));
  CHECK(at(0.85f, 1.0f, 0.3f).normal.x[0] == doctest::Approx(-1.0));
  CHECK(at(0.85f, 1.0f, 0.3f).distance[0] == doctest::Approx(-0.05));
  CHECK(at(1.0f, 1.0f, 0.5f).normal.z[0] == doctest::Approx(1.0));
  CHECK(std::abs(at(1.0f, 1.0f, 0.5f).distance[0]) < 1e-6);
  CHECK(at(0.2f, 0.2f, 0.0f).normal.z[0] == doctest::Approx(1.0));
  CHECK(at(0.2f, 0.2f, -0.2f).distance[0] == doctest::Approx(-0.2));
}

TEST_CASE("signed distance: a lane that is not finite stays by itself") {
  const HeightGrid g = random_grid(12, 5, 5, 0.4);
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
  for (const HeightGrid& grid : {g, HeightGrid::flat()})
    for (const float bad : {nan, infinity, -infinity})
      for (int axis = 0; axis < 3; ++axis) {
        traceur::core::Vector3<Lanes> p{Lanes(0.5), Lanes(0.8), Lanes(0.1)};
        const SurfaceSample<Lanes> good = contact_surface(grid, p, 0.1f);
        (axis == 0 ? p.x : axis == 1 ? p.y : p.z).set(3, bad);
        const SurfaceSample<Lanes> exact = surface(grid, p), contact = contact_surface(grid, p, 0.1f);
        CHECK(std::isnan(exact.distance[3]));
        CHECK(std::isnan(contact.distance[3]));
        for (int l = 0; l < Lanes::width; ++l)
          if (l != 3) CHECK(contact.distance[l] == good.distance[l]);
      }
}

TEST_CASE("signed distance: far points") {
  const HeightGrid g = random_grid(13, 20, 20, 0.4);
  CHECK(signed_distance(g, Vector{1, 2, 1e6}) == doctest::Approx(1e6 - g.highest()).epsilon(1e-6));
  CHECK(signed_distance(g, Vector{1, 2, -1e6}) == doctest::Approx(-1e6 - g.lowest()).epsilon(1e-6));
  // Outside all that matters is the border row.
  CHECK(signed_distance(g, Vector{-1e6, 2, 3}) == doctest::Approx(signed_distance(g, Vector{-1e3, 2, 3})));
}

namespace {

/// The distance to the union of all columns of ground, or of air for a point inside, each looked at.
double union_of_columns(const HeightGrid& g, const Vector& p) {
  const bool inside = p.z < g.height(p.x, p.y);
  double best = std::numeric_limits<double>::infinity();
  for (int j = 0; j < g.ny(); ++j)
    for (int i = 0; i < g.nx(); ++i) {
      // The border's cells have no outer side.
      const double west = i == 0 ? 0 : g.x0() + i * g.cell() - p.x;
      const double east = i == g.nx() - 1 ? 0 : p.x - (g.x0() + (i + 1) * g.cell());
      const double south = j == 0 ? 0 : g.y0() + j * g.cell() - p.y;
      const double north = j == g.ny() - 1 ? 0 : p.y - (g.y0() + (j + 1) * g.cell());
      const double a = std::max({west, east, 0.0}), b = std::max({south, north, 0.0});
      const double c = std::max(inside ? g(i, j) - p.z : p.z - g(i, j), 0.0);
      best = std::min(best, a * a + b * b + c * c);
    }
  return inside ? -std::sqrt(best) : std::sqrt(best);
}

/// Heights within `spread` of each other: few cells that could be nearest, or nearly all of them.
HeightGrid rough_grid(unsigned seed, int nx, int ny, double cell, double spread) {
  std::mt19937 generator(seed);
  std::uniform_real_distribution<double> height(0, spread);
  Eigen::MatrixXd h(nx, ny);
  for (int j = 0; j < ny; ++j)
    for (int i = 0; i < nx; ++i) h(i, j) = height(generator);
  return HeightGrid(h, cell, -2.1, 0.3);
}

}  // namespace

TEST_CASE("signed distance: alone, of a float and of a pack, equals that to the union of all columns") {
  unsigned seed = 20;
  int points = 0;
  double worst = 0, worst_float = 0;
  // Near and far beyond the four columns on either side that are looked at first.
  for (const auto& [nx, ny, cell, spread] : {std::tuple{16, 16, 0.4, 1.0},
                                             {30, 7, 0.4, 4.0},
                                             {40, 40, 0.1, 0.5},
                                             {9, 25, 0.25, 0.01},
                                             {3, 2, 0.4, 2.0},
                                             {20, 20, 0.05, 3.0}}) {
    const HeightGrid g = rough_grid(++seed, nx, ny, cell, spread);
    Points next(seed, g);
    std::uniform_real_distribution<double> above(-0.5, 2.2);
    for (int k = 0; k < 170000; k += Lanes::width) {
      traceur::core::Vector3<Lanes> lanes{Lanes(0), Lanes(0), Lanes(0)};
      for (int l = 0; l < Lanes::width; ++l) {
        Vector p = next();
        if (l % 2 == 0) p.z = g.height(p.x, p.y) + above(next.generator);
        lanes.x.set(l, static_cast<float>(p.x));
        lanes.y.set(l, static_cast<float>(p.y));
        lanes.z.set(l, static_cast<float>(p.z));
      }
      const Lanes together = signed_distance(g, lanes);
      for (int l = 0; l < Lanes::width; ++l) {
        const traceur::core::Vector3<float> q{lanes.x[l], lanes.y[l], lanes.z[l]};
        const Vector p{q.x, q.y, q.z};
        const double expected = union_of_columns(g, p);
        worst =
            std::max({worst, std::abs(signed_distance(g, p) - expected), std::abs(surface(g, p).distance - expected)});
        // On which side of a wall or a top a point is, rounding may decide.
        worst_float = std::max({worst_float, std::abs(std::abs(signed_distance(g, q)) - std::abs(expected)),
                                static_cast<double>(std::abs(together[l] - signed_distance(g, q)))});
        ++points;
      }
    }
  }
  CHECK(points >= 1000000);
  CHECK(worst < 1e-12);
  CHECK(worst_float < 5e-6);
}

TEST_CASE("signed distance: alone, a number that is not finite has none") {
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
  for (const HeightGrid& grid : {random_grid(12, 5, 5, 0.4), HeightGrid::flat()})
    for (const float bad : {nan, infinity, -infinity})
      for (int axis = 0; axis < 3; ++axis) {
        traceur::core::Vector3<float> p{0.5f, 0.8f, 0.1f};
        (axis == 0 ? p.x : axis == 1 ? p.y : p.z) = bad;
        CHECK(std::isnan(signed_distance(grid, p)));
        CHECK(std::isnan(signed_distance(grid, Vector{p.x, p.y, p.z})));
        traceur::core::Vector3<Lanes> lanes{Lanes(0.5), Lanes(0.8), Lanes(0.1)};
        const Lanes good = signed_distance(grid, lanes);
        (axis == 0 ? lanes.x : axis == 1 ? lanes.y : lanes.z).set(3, bad);
        const Lanes some = signed_distance(grid, lanes);
        for (int l = 0; l < Lanes::width; ++l) CHECK((l == 3 ? std::isnan(some[l]) : some[l] == good[l]));
      }
}
