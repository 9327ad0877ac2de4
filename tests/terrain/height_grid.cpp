// SPDX-License-Identifier: MIT
#include <traceur/terrain/height_grid.hpp>

#include <limits>
#include <string>

#include <doctest/doctest.h>

#include "../error_message.hpp"

namespace {

using traceur::Error;
using traceur::terrain::HeightGrid;

/// Height of cell (i, j) is i + 10 j.
HeightGrid staircase(int nx, int ny, double cell, double x0, double y0) {
  Eigen::MatrixXd h(nx, ny);
  for (int j = 0; j < ny; ++j)
    for (int i = 0; i < nx; ++i) h(i, j) = i + 10 * j;
  return HeightGrid(h, cell, x0, y0);
}

using traceur_test::message;

}  // namespace

TEST_CASE("height grid: every point of a cell has its height, also in float") {
  const HeightGrid g = staircase(4, 3, 0.5, -1, 2);
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < 4; ++i)
      for (const double share : {0.0, 0.25, 0.999}) {
        const double x = -1 + (i + share) * 0.5, y = 2 + (j + share) * 0.5;
        CHECK(g.height(x, y) == i + 10 * j);
        CHECK(g.table<float>().height(g.table<float>().column(static_cast<float>(x)),
                                      g.table<float>().row(static_cast<float>(y))) == static_cast<float>(i + 10 * j));
      }
  CHECK(g.center_x(0) == -0.75);
  CHECK(g.center_y(2) == 3.25);
  CHECK(g.height(g.center_x(3), g.center_y(1)) == 13);
  CHECK(g.lowest() == 0);
  CHECK(g.highest() == 23);
}

TEST_CASE("height grid: the border goes on outside, and no number is an unsafe index") {
  const HeightGrid g = staircase(4, 3, 0.5, -1, 2);
  const double huge = std::numeric_limits<double>::max(), infinity = std::numeric_limits<double>::infinity();
  for (const double far : {-100.0, -huge, -infinity}) {
    CHECK(g.height(far, 2.7) == 10);
    CHECK(g.height(-0.4, far) == 1);
  }
  for (const double far : {100.0, huge, infinity}) {
    CHECK(g.height(far, 2.7) == 13);
    CHECK(g.height(-0.4, far) == 21);
  }
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(g.column(nan) == 3);
  CHECK(g.row(nan) == 2);
}

TEST_CASE("height grid: the tops are the highest of nine") {
  const HeightGrid g = staircase(4, 3, 0.5, 0, 0);
  const auto top = [&](int i, int j) { return g.table<double>().tops[static_cast<std::size_t>(i + 4 * j)]; };
  CHECK(top(0, 0) == 11);
  CHECK(top(3, 2) == 23);
  CHECK(top(1, 1) == 22);
}

TEST_CASE("height grid: level ground") {
  const HeightGrid g = HeightGrid::flat(0.3);
  CHECK(g.is_flat());
  CHECK(g.height(-5, 80) == 0.3);
  CHECK(g.nx() * g.ny() == 1);
  CHECK(!staircase(2, 1, 1, 0, 0).is_flat());
  CHECK(HeightGrid(Eigen::MatrixXd::Ones(5, 5)).is_flat());
}

TEST_CASE("height grid: what cannot be a grid is refused") {
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
  const Eigen::MatrixXd one = Eigen::MatrixXd::Zero(1, 1);
  CHECK(message([&] { HeightGrid(Eigen::MatrixXd(0, 3)); }) == "height grid: expected at least one cell");
  CHECK(message([&] { HeightGrid(Eigen::MatrixXd(3, 0)); }).find("at least one cell") != std::string::npos);
  for (const double cell : {0.0, -1.0, nan, infinity})
    CHECK(message([&] { HeightGrid(one, cell); }).find("cell size above zero") != std::string::npos);
  CHECK(message([&] { HeightGrid(one, 1, nan, 0); }).find("finite origin") != std::string::npos);
  CHECK(message([&] { HeightGrid(one, 1, 0, infinity); }).find("finite origin") != std::string::npos);
  Eigen::MatrixXd h = Eigen::MatrixXd::Zero(3, 4);
  h(1, 2) = nan;
  CHECK(message([&] { HeightGrid(h, 1, 0, 0, "map.json"); }) == "map.json: height of cell (1, 2) is not finite");
}
