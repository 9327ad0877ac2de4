// SPDX-License-Identifier: MIT
#include <traceur/terrain/generators.hpp>

#include <algorithm>
#include <cmath>
#include <set>
#include <string>

#include <doctest/doctest.h>

#include "../error_message.hpp"

namespace {

using namespace traceur;
using core::RandomStream;
using terrain::HeightGrid;
using traceur_test::message;

/// The shortest run of equal heights along x or y.
int thinnest(const Eigen::MatrixXd& h) {
  int least = static_cast<int>(h.size());
  const auto scan = [&](const Eigen::MatrixXd& m) {
    for (Eigen::Index i = 0; i < m.rows(); ++i) {
      int run = 1;
      for (Eigen::Index j = 1; j <= m.cols(); ++j) {
        if (j < m.cols() && m(i, j) == m(i, j - 1)) {
          ++run;
        } else {
          least = std::min(least, run);
          run = 1;
        }
      }
    }
  };
  scan(h);
  scan(h.transpose());
  return least;
}

}  // namespace

TEST_CASE("max_pool: every block has the height of its highest cell, and nothing is thinner than the window") {
  RandomStream random(1);
  for (const int window : {1, 2, 3, 5})
    for (const int nx : {1, 2, 7, 16})
      for (const int ny : {3, 8}) {
        Eigen::MatrixXd h(nx, ny);
        for (Eigen::Index k = 0; k < h.size(); ++k) h.data()[k] = random.uniform(-2, 2);
        const Eigen::MatrixXd pooled = terrain::max_pool(h, window);
        CHECK((pooled.array() >= h.array()).all());
        CHECK(pooled.maxCoeff() == h.maxCoeff());
        CHECK(thinnest(pooled) >= std::min({window, nx, ny}));
        // Pooling again changes nothing.
        CHECK(terrain::max_pool(pooled, window) == pooled);
        if (window == 1) CHECK(pooled == h);
      }
  Eigen::MatrixXd h(5, 2);
  h << 1, 0, 0, 0, 3, 0, 0, 4, 0, 5;
  Eigen::MatrixXd expected(5, 2);
  expected << 1, 1, 1, 1, 5, 5, 5, 5, 5, 5;
  CHECK(terrain::max_pool(h, 2) == expected);
  CHECK(message([&] { terrain::max_pool(h, 0); }) == "max_pool: expected a window of one cell or more");
}

TEST_CASE("random boxes: PARC's size, range and thickness, the same for the same seed") {
  const terrain::RandomBoxes p;
  std::set<double> heights;
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    RandomStream random(seed), again(seed);
    const HeightGrid grid = terrain::random_boxes(p, random);
    CHECK(grid.nx() == 16);
    CHECK(grid.ny() == 16);
    CHECK(grid.cell() == 0.4);
    CHECK(grid.lowest() >= -2);
    CHECK(grid.highest() <= 2);
    CHECK(thinnest(grid.heights()) >= 2);
    CHECK(grid.heights() == terrain::random_boxes(p, again).heights());
    heights.insert(grid.heights().data(), grid.heights().data() + grid.heights().size());
  }
  CHECK(*heights.begin() < -1.8);
  CHECK(*heights.rbegin() > 1.8);
}

TEST_CASE("random boxes: a single box has the sides asked for") {
  terrain::RandomBoxes p;
  p.nx = p.ny = 41;
  p.boxes = 1;
  p.window = 1;
  p.height_min = 0.5;
  int largest = 0, smallest = 1000;
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    RandomStream random(seed);
    const Eigen::MatrixXd h = terrain::random_boxes(p, random).heights();
    const auto raised = (h.array() != 0).cast<int>();
    const int rows = raised.rowwise().maxCoeff().sum(), cols = raised.colwise().maxCoeff().sum();
    CHECK(raised.sum() == rows * cols);
    CHECK(rows <= 10);
    CHECK(cols <= 10);
    largest = std::max(largest, rows);
    // One away from the border is not cut.
    if (raised.row(0).sum() == 0 && raised.row(40).sum() == 0) smallest = std::min(smallest, rows);
  }
  CHECK(largest == 10);
  CHECK(smallest == 5);
  p.boxes = 0;
  RandomStream random(1);
  CHECK(terrain::random_boxes(p, random).is_flat());
}

TEST_CASE("random walks: a path is connected, of one height, as long and wide as asked") {
  terrain::RandomWalks p;
  p.paths = 1;
  p.height_min = 1;
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    RandomStream random(seed), again(seed);
    const HeightGrid grid = terrain::random_walks(p, random);
    CHECK(grid.nx() == 32);
    const Eigen::MatrixXd h = grid.heights();
    CHECK(h == terrain::random_walks(p, again).heights());
    Eigen::MatrixXi raised = (h.array() != 0).cast<int>();
    const int cells = raised.sum();
    CHECK(cells >= 2);
    CHECK(cells <= 64 * 4);
    CHECK((h.array() == 0 || h.array() == h.maxCoeff()).all());
    // Flooding from one raised cell reaches all of them.
    Eigen::Index i = 0, j = 0;
    raised.maxCoeff(&i, &j);
    raised(i, j) = 2;
    for (bool grown = true; grown;) {
      grown = false;
      for (int b = 0; b < 32; ++b)
        for (int a = 0; a < 32; ++a) {
          if (raised(a, b) != 1) continue;
          const bool beside = (a > 0 && raised(a - 1, b) == 2) || (a < 31 && raised(a + 1, b) == 2) ||
                              (b > 0 && raised(a, b - 1) == 2) || (b < 31 && raised(a, b + 1) == 2);
          if (beside) {
            raised(a, b) = 2;
            grown = true;
          }
        }
    }
    CHECK((raised.array() != 1).all());
  }
}

TEST_CASE("random walks: the numbers of PARC's code, and a grid of one cell") {
  RandomStream random(3);
  const HeightGrid grid = terrain::random_walks(terrain::RandomWalks::parc_code(), random);
  CHECK(grid.lowest() == -2);
  CHECK(grid.highest() <= 2);
  CHECK(grid.highest() > -1.6);
  terrain::RandomWalks tiny;
  tiny.nx = tiny.ny = 1;
  CHECK(terrain::random_walks(tiny, random).is_flat());
}

TEST_CASE("stairs: heights are whole numbers of one flight's rise, and every step differs from the next by it") {
  terrain::Stairs p;
  p.flights = 1;
  p.nx = p.ny = 40;
  int whole = 0;
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    RandomStream random(seed);
    const Eigen::MatrixXd h = terrain::stairs(p, random).heights();
    std::set<double> levels(h.data(), h.data() + h.size());
    CHECK(levels.size() >= 2);
    const double rise = *std::next(levels.begin());
    CHECK(rise >= 0.15);
    CHECK(rise <= 0.25);
    double expected = 0;
    for (const double level : levels) {
      CHECK(level == doctest::Approx(expected));
      expected += rise;
    }
    whole += levels.size() > 3 ? 1 : 0;
  }
  CHECK(whole > 80);
}

TEST_CASE("stairs: several flights go up and down from landing to landing") {
  const terrain::Stairs p;
  int down = 0;
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    RandomStream random(seed), again(seed);
    const HeightGrid grid = terrain::stairs(p, random);
    CHECK(grid.heights() == terrain::stairs(p, again).heights());
    CHECK(grid.highest() > 0);
    // Never more than every step of every flight up.
    CHECK(grid.highest() <= 4 * 8 * 0.25);
    down += grid.lowest() < 0 ? 1 : 0;
  }
  CHECK(down > 5);
}

TEST_CASE("slices: the world under them stays where it was") {
  terrain::RandomBoxes p;
  p.nx = p.ny = 100;
  p.boxes = 300;
  RandomStream random(5);
  const HeightGrid flat_corner = terrain::random_boxes(p, random);
  const HeightGrid large(flat_corner.heights(), 0.4, -7, 3);
  int left = 0, right = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const HeightGrid part = terrain::random_slice(large, 16, 12, random);
    CHECK(part.nx() == 16);
    CHECK(part.ny() == 12);
    for (int k = 0; k < 20; ++k) {
      const double x = part.x0() + random.uniform(0.01, 6.39), y = part.y0() + random.uniform(0.01, 4.79);
      CHECK(part.height(x, y) == large.height(x, y));
    }
    left += part.x0() < large.x0() + 4 ? 1 : 0;
    right += part.x0() + 16 * 0.4 > large.x0() + 36 ? 1 : 0;
  }
  CHECK(left > 5);
  CHECK(right > 5);
  const HeightGrid all = terrain::random_slice(large, 100, 100, random);
  CHECK(all.heights() == large.heights());
  CHECK(message([&] { terrain::slice(large, 90, 0, 16, 16); }) == "slice: expected cells within a grid of 100 by 100");
  CHECK(message([&] { terrain::random_slice(large, 101, 1, random); }) ==
        "slice: expected cells within a grid of 100 by 100");
}

TEST_CASE("generators: what cannot be made is refused by name") {
  RandomStream random(1);
  const auto boxes = [&](auto&& change) {
    terrain::RandomBoxes p;
    change(p);
    return message([&] { terrain::random_boxes(p, random); });
  };
  CHECK(boxes([](auto& p) { p.nx = 0; }) == "random boxes: expected at least one cell each way");
  CHECK(boxes([](auto& p) { p.side_min = 11; }) == "random boxes: expected 1 <= side_min <= side_max");
  CHECK(boxes([](auto& p) { p.height_min = 3; }) == "random boxes: expected height_min <= height_max");
  CHECK(boxes([](auto& p) { p.cell = 0; }) == "random boxes: expected a cell size above zero");
  terrain::RandomWalks walks;
  walks.turn = 1.5;
  CHECK(message([&] { terrain::random_walks(walks, random); }) == "random walks: expected a chance to turn in [0, 1]");
  terrain::Stairs stairs;
  stairs.steps_min = 0;
  CHECK(message([&] { terrain::stairs(stairs, random); }) == "stairs: expected 1 <= steps_min <= steps_max");
}
