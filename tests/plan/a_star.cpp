// SPDX-License-Identifier: MIT
#include <traceur/plan/a_star.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <queue>
#include <string>
#include <utility>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/terrain/generators.hpp>

namespace {

using namespace traceur;
using core::RandomStream;
using plan::AStar;
using plan::LeastTerrainCost;
using plan::NavigationGraph;
using plan::PathPlanner;
using plan::TerrainCost;
using terrain::HeightGrid;

constexpr double infinity = std::numeric_limits<double>::infinity();

HeightGrid any_terrain(std::uint64_t seed) {
  RandomStream random(seed);
  const int n = 6 + static_cast<int>(random.below(10));
  if (seed % 3 == 0) {
    terrain::RandomBoxes p;
    p.nx = n;
    p.ny = n + 2;
    return terrain::random_boxes(p, random);
  }
  if (seed % 3 == 1) {
    terrain::RandomWalks p;
    p.nx = p.ny = n;
    p.steps = 3 * n;
    p.paths = 4;
    p.ground = -1;
    return terrain::random_walks(p, random);
  }
  Eigen::MatrixXd h(n, n);
  for (Eigen::Index k = 0; k < h.size(); ++k) h.data()[k] = random.uniform(-1.5, 1.5);
  return HeightGrid(h, 0.4, -1, 2);
}

/// The definition of a price, apart from the noise.
double price(const NavigationGraph& graph, int a, int b, const TerrainCost& c) {
  const core::Vector3<double> d = graph.position(b) - graph.position(a);
  return c.horizontal * (d.x * d.x + d.y * d.y) + c.vertical * d.z * d.z;
}

/// Dijkstra's search in its plain form: costs from every node to the goal, along the reversed edges.
std::vector<double> costs_to(const NavigationGraph& graph, int goal, const std::vector<double>& prices) {
  std::vector<std::vector<std::pair<int, double>>> into(static_cast<std::size_t>(graph.size()));
  for (int node = 0; node < graph.size(); ++node)
    graph.for_each_edge(node, [&](int target, int e) {
      into[static_cast<std::size_t>(target)].push_back({node, prices[static_cast<std::size_t>(e)]});
    });
  std::vector<double> cost(static_cast<std::size_t>(graph.size()), infinity);
  std::priority_queue<std::pair<double, int>, std::vector<std::pair<double, int>>, std::greater<>> open;
  cost[static_cast<std::size_t>(goal)] = 0;
  open.push({0, goal});
  while (!open.empty()) {
    const auto [c, node] = open.top();
    open.pop();
    if (c > cost[static_cast<std::size_t>(node)]) continue;
    for (const auto& [before, p] : into[static_cast<std::size_t>(node)])
      if (c + p < cost[static_cast<std::size_t>(before)]) {
        cost[static_cast<std::size_t>(before)] = c + p;
        open.push({c + p, before});
      }
  }
  return cost;
}

/// What a path costs; NaN if it uses an edge that is not there.
double cost_of(const NavigationGraph& graph, const std::vector<int>& path, const std::vector<double>& prices) {
  double sum = 0;
  for (std::size_t k = 0; k + 1 < path.size(); ++k) {
    double p = std::numeric_limits<double>::quiet_NaN();
    graph.for_each_edge(path[k], [&](int target, int e) {
      if (target == path[k + 1]) p = prices[static_cast<std::size_t>(e)];
    });
    sum += p;
  }
  return sum;
}

/// A ring road with a chord, to see that the search is any graph's.
struct Ring {
  int n = 10;
  int size() const { return n; }
  template <class F>
  void for_each_edge(int node, F&& f) const {
    f((node + 1) % n, 2 * node);
    f((node + 3) % n, 2 * node + 1);
  }
};

struct NoGraph {
  int size() const { return 1; }
};

static_assert(plan::Graph<NavigationGraph>);
static_assert(plan::Graph<Ring>);
static_assert(!plan::Graph<NoGraph>);
static_assert(plan::Heuristic<LeastTerrainCost, double>);
static_assert(plan::Heuristic<plan::NoHeuristic, float>);

}  // namespace

TEST_CASE("A*: as cheap as Dijkstra's on a thousand terrains, without noise and with") {
  std::vector<int> path;
  int unreachable = 0, jumps = 0;
  double expanded = 0, nodes = 0;
  for (std::uint64_t seed = 0; seed < 1000; ++seed) {
    const NavigationGraph graph(any_terrain(seed));
    TerrainCost cost;
    // Half of them as the sums are; every fourth with PARC's noise, every fourth with one that is never zero.
    if (seed % 2 == 0) cost.noise_max = 0;
    if (seed % 4 == 1) cost.noise_min = 0.1;
    PathPlanner planner(cost);
    RandomStream random(seed, 1);
    const auto n = static_cast<std::uint32_t>(graph.size());
    const int start = static_cast<int>(random.below(n)), goal = static_cast<int>(random.below(n));
    const double found = planner.plan(graph, start, goal, 9, seed, path);
    const std::vector<double> prices(planner.prices().begin(), planner.prices().end());
    const double least = costs_to(graph, goal, prices)[static_cast<std::size_t>(start)];
    if (least == infinity) {
      ++unreachable;
      CHECK(found == infinity);
      CHECK(path.empty());
      continue;
    }
    CHECK(found == doctest::Approx(least).epsilon(1e-10).scale(1e-10));
    CHECK(path.front() == start);
    CHECK(path.back() == goal);
    CHECK(cost_of(graph, path, prices) == doctest::Approx(found).epsilon(1e-12).scale(1e-12));
    if (cost.noise_max == 0) {
      expanded += planner.expanded();
      nodes += graph.size();
    }
    for (std::size_t k = 0; k + 1 < path.size(); ++k)
      for (const auto& e : graph.edges(path[k])) jumps += e.target == path[k + 1] && e.jump ? 1 : 0;
  }
  CHECK(unreachable < 200);
  CHECK(jumps > 20);
  // The heuristic is worth something.
  CHECK(expanded < 0.4 * nodes);
}

TEST_CASE("heuristic: never above the true cost, and consistent along every edge") {
  for (std::uint64_t seed = 0; seed < 150; ++seed) {
    const NavigationGraph graph(any_terrain(seed));
    RandomStream random(seed, 2);
    TerrainCost cost;
    cost.horizontal = random.uniform(0, 2);
    cost.vertical = seed % 5 == 0 ? 0 : random.uniform(0, 2);
    cost.noise_min = seed % 2 == 0 ? 0 : random.uniform(0, 0.3);
    std::vector<double> prices(static_cast<std::size_t>(graph.edge_count()));
    for (int node = 0; node < graph.size(); ++node)
      graph.for_each_edge(node, [&](int target, int e) {
        prices[static_cast<std::size_t>(e)] = price(graph, node, target, cost) + cost.noise_min;
      });
    const int goal = static_cast<int>(random.below(static_cast<std::uint32_t>(graph.size())));
    const std::vector<double> truth = costs_to(graph, goal, prices);
    const LeastTerrainCost least(graph, goal, cost);
    CHECK(least(goal) == 0);
    int above = 0, inconsistent = 0;
    for (int node = 0; node < graph.size(); ++node) {
      if (least(node) > truth[static_cast<std::size_t>(node)] + 1e-12) ++above;
      graph.for_each_edge(node, [&](int target, int e) {
        if (least(node) > prices[static_cast<std::size_t>(e)] + least(target) + 1e-9) ++inconsistent;
      });
    }
    CHECK(above == 0);
    CHECK(inconsistent == 0);
  }
}

TEST_CASE("heuristic: exact on flat ground, where the search stays in the rectangle between its ends") {
  const NavigationGraph graph(HeightGrid(Eigen::MatrixXd::Zero(40, 40)));
  TerrainCost cost;
  cost.noise_max = 0;
  PathPlanner planner(cost);
  std::vector<int> path;
  const int start = graph.node(3, 5), goal = graph.node(33, 28);
  const double found = planner.plan(graph, start, goal, 0, 0, path);
  CHECK(found == doctest::Approx(0.16 * (30 + 23)));
  CHECK(LeastTerrainCost(graph, goal, cost)(start) == doctest::Approx(found));
  CHECK(planner.expanded() <= 31 * 24);
  // The straight distance, which looks like a bound, is none: squares make short edges cheap.
  CHECK(std::hypot(30, 23) * 0.4 > found);
}

TEST_CASE("prices: PARC Eq. 6, noise between its bounds, an edge's own") {
  const NavigationGraph graph(any_terrain(6));
  TerrainCost cost;
  PathPlanner planner(cost), again(cost);
  std::vector<int> path, other;
  planner.plan(graph, 0, graph.size() - 1, 3, 4, path);
  const std::vector<double> prices(planner.prices().begin(), planner.prices().end());
  double sum = 0, least = 1, most = 0;
  for (int node = 0; node < graph.size(); ++node)
    graph.for_each_edge(node, [&](int target, int e) {
      const double noise = prices[static_cast<std::size_t>(e)] - price(graph, node, target, cost);
      least = std::min(least, noise);
      most = std::max(most, noise);
      sum += noise;
    });
  CHECK(least >= -1e-12);
  CHECK(least < 0.01);
  CHECK(most <= 0.5 + 1e-12);
  CHECK(most > 0.49);
  CHECK(sum / graph.edge_count() == doctest::Approx(0.25).epsilon(0.05));
  again.plan(graph, 0, graph.size() - 1, 3, 5, other);
  CHECK(again.prices()[0] != prices[0]);
  again.plan(graph, graph.size() - 1, 0, 3, 4, other);
  CHECK(std::equal(prices.begin(), prices.end(), again.prices().begin()));
  again.plan(graph, 0, graph.size() - 1, 3, 4, other);
  CHECK(path == other);
}

TEST_CASE("noise makes paths differ") {
  const NavigationGraph graph(HeightGrid(Eigen::MatrixXd::Zero(16, 16)));
  PathPlanner planner;
  std::vector<std::vector<int>> paths;
  for (std::uint64_t step = 0; step < 20; ++step) {
    std::vector<int> path;
    planner.plan(graph, 17, 238, 1, step, path);
    if (std::find(paths.begin(), paths.end(), path) == paths.end()) paths.push_back(path);
  }
  CHECK(paths.size() > 15);
}

TEST_CASE("A*: an inconsistent heuristic costs time, not the optimum; one memory serves many graphs") {
  AStar<double> search;
  std::vector<int> path;
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    const NavigationGraph graph(any_terrain(seed));
    std::vector<double> prices(static_cast<std::size_t>(graph.edge_count()));
    RandomStream random(seed, 3);
    for (double& p : prices) p = random.uniform();
    const auto n = static_cast<std::uint32_t>(graph.size());
    const int start = static_cast<int>(random.below(n)), goal = static_cast<int>(random.below(n));
    const auto truth = costs_to(graph, goal, prices);
    // The truth on every other node, nothing elsewhere: admissible, and it falls by more than an edge costs.
    const auto patchy = [&](int node) {
      const double t = truth[static_cast<std::size_t>(node)];
      return node % 2 == 0 && t < infinity ? (1 - 1e-12) * t : 0.0;
    };
    const double found = search.search(
        graph, start, goal, [&](int e) { return prices[static_cast<std::size_t>(e)]; }, patchy, path);
    const double expected = truth[static_cast<std::size_t>(start)];
    if (expected == infinity) {
      CHECK(found == infinity);
    } else {
      CHECK(found == doctest::Approx(expected).epsilon(1e-10).scale(1e-10));
    }
  }
}

TEST_CASE("A*: closed edges, a start that is the goal, any graph, any scalar") {
  const Ring ring;
  AStar<float> search(10);
  std::vector<int> path;
  const auto one = [](int) { return 1.0f; };
  CHECK(search.search(ring, 2, 2, one, plan::NoHeuristic{}, path) == 0);
  CHECK(path == std::vector<int>{2});
  CHECK(search.search(ring, 0, 7, one, plan::NoHeuristic{}, path) == 3);
  CHECK(path.size() == 4);
  // Chords closed: the long way round.
  const auto closed = [](int e) { return e % 2 == 0 ? 1.0f : std::numeric_limits<float>::infinity(); };
  CHECK(search.search(ring, 0, 7, closed, plan::NoHeuristic{}, path) == 7);
  CHECK(path == std::vector<int>{0, 1, 2, 3, 4, 5, 6, 7});
  const auto none = [](int) { return std::numeric_limits<float>::infinity(); };
  CHECK(search.search(ring, 0, 7, none, plan::NoHeuristic{}, path) == std::numeric_limits<float>::infinity());
  CHECK(path.empty());
}

TEST_CASE("A*: what is no node or no cost is refused") {
  const auto message = [](const auto& f) {
    try {
      f();
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  AStar<double> search;
  std::vector<int> path;
  const auto one = [](int) { return 1.0; };
  CHECK(message([&] { search.search(Ring{}, 0, 10, one, plan::NoHeuristic{}, path); }) ==
        "A*: expected start and goal to be nodes of the graph");
  TerrainCost cost;
  cost.vertical = -1;
  CHECK(message([&] { PathPlanner planner(cost); }) ==
        "path planner: expected weights of zero or more and 0 <= noise_min <= noise_max");
  PathPlanner planner;
  const NavigationGraph graph(HeightGrid::flat());
  CHECK(message([&] { planner.plan(graph, 0, 1, 0, 0, path); }) ==
        "path planner: expected start and goal to be nodes of the graph");
}
