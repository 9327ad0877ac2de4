// SPDX-License-Identifier: MIT
#include <traceur/plan/navigation_graph.hpp>

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <utility>

#include <doctest/doctest.h>

#include <traceur/terrain/generators.hpp>

namespace {

using namespace traceur;
using core::RandomStream;
using plan::NavigationGraph;
using plan::NavigationParameters;
using terrain::HeightGrid;
using Vector = core::Vector3<double>;

HeightGrid boxes(std::uint64_t seed, int n = 16) {
  terrain::RandomBoxes p;
  p.nx = p.ny = n;
  p.side_min = 2;
  p.side_max = 6;
  p.boxes = 10 * n * n / 256;
  p.window = seed % 2 == 0 ? 1 : 2;
  RandomStream random(seed);
  return terrain::random_boxes(p, random);
}

std::set<std::pair<int, bool>> targets(const NavigationGraph& graph, int node) {
  std::set<std::pair<int, bool>> out;
  for (const auto& e : graph.edges(node)) out.insert({e.target, e.jump});
  return out;
}

/// The least that the line of flight is above the columns under it, except those it leads between. A line between
/// middles of cells at most 7 apart stays over a column for 1/84 of its way or more, if it does not just touch a
/// corner.
double clearance(const HeightGrid& grid, const NavigationGraph& graph, int from, int to) {
  const double up = graph.parameters().jump_clearance;
  const Vector a = graph.position(from) + Vector{0, 0, up}, b = graph.position(to) + Vector{0, 0, up};
  double least = 1e9;
  for (int k = 0; k <= 301; ++k) {
    const Vector p = a + (k / 301.0) * (b - a);
    const int cell = graph.node(grid.column(p.x), grid.row(p.y));
    if (cell != from && cell != to) least = std::min(least, p.z - graph.height(cell));
  }
  return least;
}

}  // namespace

TEST_CASE("graph: on flat ground everyone goes to all neighbours and nobody jumps") {
  const NavigationGraph graph(HeightGrid(Eigen::MatrixXd::Zero(7, 5), 0.4, -1, 2));
  CHECK(graph.size() == 35);
  CHECK(graph.edge_count() == 8 * 15 + 5 * 2 * (5 + 3) + 3 * 4);
  CHECK(norm(graph.position(graph.node(2, 3)) - Vector{0, 3.4, 0}) < 1e-12);
  CHECK(targets(graph, 0) == std::set<std::pair<int, bool>>{{1, false}, {7, false}, {8, false}});
  for (int node = 0; node < graph.size(); ++node) {
    CHECK(graph.node(graph.column(node), graph.row(node)) == node);
    CHECK(!graph.on_cliff(node));
    int edges = 0;
    graph.for_each_edge(node, [&](int target, int e) {
      CHECK(graph.edge(e).target == target);
      CHECK(e == graph.first_edge(node) + edges);
      ++edges;
    });
    CHECK(edges == static_cast<int>(graph.edges(node).size()));
  }
}

TEST_CASE("graph: steps are the adjacent cells within 2.1 m, up and down") {
  int refused = 0;
  for (std::uint64_t seed = 0; seed < 30; ++seed) {
    const HeightGrid grid = boxes(seed);
    const NavigationGraph graph(grid);
    for (int j = 0; j < 16; ++j)
      for (int i = 0; i < 16; ++i) {
        const auto edges = targets(graph, graph.node(i, j));
        for (int b = 0; b < 16; ++b)
          for (int a = 0; a < 16; ++a) {
            const bool adjacent = std::max(std::abs(a - i), std::abs(b - j)) == 1;
            const bool expected = adjacent && std::abs(grid(a, b) - grid(i, j)) <= 2.1;
            refused += adjacent && !expected ? 1 : 0;
            if ((edges.count({graph.node(a, b), false}) != 0) != expected) CHECK(false);
          }
      }
    CHECK(graph.edge_count() > 0);
  }
  CHECK(refused > 100);
}

TEST_CASE("graph: jumps are all pairs of cliff cells in reach with a free line, and no other") {
  int jumps = 0, walls = 0;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const HeightGrid grid = boxes(seed);
    const NavigationGraph graph(grid);
    const auto cliff = [&](int node) {
      const int i = graph.column(node), j = graph.row(node);
      if (i == 0 || j == 0 || i == 15 || j == 15) return false;
      return grid(i, j) - std::min({grid(i - 1, j), grid(i + 1, j), grid(i, j - 1), grid(i, j + 1)}) >= 0.5;
    };
    for (int from = 0; from < graph.size(); ++from) {
      CHECK(graph.on_cliff(from) == cliff(from));
      const auto edges = targets(graph, from);
      for (int to = 0; to < graph.size(); ++to) {
        const Vector d = graph.position(to) - graph.position(from);
        const bool adjacent =
            std::max(std::abs(graph.column(to) - graph.column(from)), std::abs(graph.row(to) - graph.row(from))) <= 1;
        const bool reach =
            !adjacent && std::hypot(d.x, d.y) <= 3.0 + 1e-9 && d.z >= -1.0 && d.z <= 0.5 && cliff(from) && cliff(to);
        const bool has = edges.count({to, true}) != 0;
        if (has) {
          ++jumps;
          if (!reach || !(clearance(grid, graph, from, to) > 0)) CHECK(false);
        } else if (reach) {
          ++walls;
          // Something is there, if only a corner that the line touches.
          if (clearance(grid, graph, from, to) > 0.01) {
            const int di = graph.column(to) - graph.column(from), dj = graph.row(to) - graph.row(from);
            bool touches_corner = false;
            for (int k = 1; k < 2 * std::abs(di); k += 2) {
              const double y = std::abs(dj) * k / (2.0 * std::abs(di)) + 0.5;
              touches_corner = touches_corner || std::abs(y - std::round(y)) < 1e-9;
            }
            if (!touches_corner) CHECK(false);
          }
        }
      }
    }
  }
  CHECK(jumps > 1000);
  CHECK(walls > 100);
}

TEST_CASE("graph: a gap is jumped, a wall in it is not, a low wall is") {
  const auto gap = [](double wall) {
    Eigen::MatrixXd h = Eigen::MatrixXd::Zero(12, 7);
    h.middleRows(4, 4).setConstant(-5);
    h.row(6).setConstant(std::max(wall, -5.0));
    return NavigationGraph(HeightGrid(h));
  };
  const auto crossed = [](const NavigationGraph& g) {
    return targets(g, g.node(3, 3)).count({g.node(8, 3), true}) != 0;
  };
  CHECK(crossed(gap(-5)));
  CHECK(crossed(gap(0.49)));
  CHECK(!crossed(gap(0.5)));
  CHECK(!crossed(gap(2)));
  NavigationParameters none;
  none.jump_radius = 0;
  Eigen::MatrixXd h = Eigen::MatrixXd::Zero(12, 7);
  h.middleRows(4, 4).setConstant(-5);
  const NavigationGraph walking(HeightGrid(h), none);
  for (int node = 0; node < walking.size(); ++node)
    for (const auto& e : walking.edges(node)) CHECK(!e.jump);
}

TEST_CASE("graph: a line through a corner is stopped by either of the cells beside it") {
  Eigen::MatrixXd h = Eigen::MatrixXd::Constant(9, 9, -3);
  h(2, 2) = h(5, 5) = 0;
  const auto jumps = [](const Eigen::MatrixXd& heights) {
    const NavigationGraph g{HeightGrid(heights)};
    return targets(g, g.node(2, 2)).count({g.node(5, 5), true}) != 0 &&
           targets(g, g.node(5, 5)).count({g.node(2, 2), true}) != 0;
  };
  CHECK(jumps(h));
  for (const auto& [i, j] : {std::pair{2, 3}, {3, 2}, {3, 3}, {4, 3}, {5, 4}}) {
    Eigen::MatrixXd blocked = h;
    blocked(i, j) = 1;
    CHECK(!jumps(blocked));
  }
  h(2, 5) = h(4, 2) = 1;
  CHECK(jumps(h));
}

TEST_CASE("graph: without clearance a landing higher up stands in its own way") {
  Eigen::MatrixXd h = Eigen::MatrixXd::Constant(9, 5, -3);
  h(2, 2) = 0;
  h(5, 2) = 0.4;
  NavigationParameters p;
  const auto jumps = [&](int from, int to) {
    const NavigationGraph g(HeightGrid(h), p);
    return targets(g, g.node(from, 2)).count({g.node(to, 2), true}) != 0;
  };
  CHECK(jumps(2, 5));
  CHECK(jumps(5, 2));
  p.jump_clearance = 0;
  CHECK(!jumps(2, 5));
  CHECK(!jumps(5, 2));
}

TEST_CASE("endpoints: on the ring near the border, far enough apart, any of them") {
  const NavigationGraph graph(HeightGrid(Eigen::MatrixXd::Zero(16, 16)));
  RandomStream random(5);
  std::set<int> seen;
  for (int trial = 0; trial < 3000; ++trial) {
    const auto ends = plan::random_endpoints(graph, {}, random);
    REQUIRE(ends.has_value());
    for (const int node : {ends->start, ends->goal}) {
      const int i = graph.column(node), j = graph.row(node);
      CHECK(std::min({i, j, 15 - i, 15 - j}) == 1);
    }
    const Vector d = graph.position(ends->goal) - graph.position(ends->start);
    CHECK(std::hypot(d.x, d.y) >= 5 - 1e-9);
    seen.insert(ends->start);
  }
  CHECK(seen.size() == 4 * 13);
  CHECK(!plan::random_endpoints(graph, {1, 8}, random).has_value());
  CHECK(!plan::random_endpoints(graph, {8, 1}, random).has_value());
}

TEST_CASE("graph: parameters that make no sense are refused") {
  NavigationParameters p;
  p.jump_rise_min = 1;
  std::string what;
  try {
    NavigationGraph(HeightGrid::flat(), p);
  } catch (const Error& error) {
    what = error.what();
  }
  CHECK(what == "navigation graph: expected lengths of zero or more and jump_rise_min <= jump_rise_max");
}
