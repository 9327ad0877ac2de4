// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include "traceur/core/error.hpp"
#include "traceur/core/random.hpp"
#include "traceur/plan/navigation_graph.hpp"

namespace traceur::plan {

namespace detail {
struct AnyVisitor {
  void operator()(int, int) const {}
};
}  // namespace detail

/// A directed graph whose nodes are 0 ... size() - 1 and whose edges have numbers: `for_each_edge(node, f)` calls
/// f(target, edge) for every edge that leaves the node, each time in the same order.
template <class G>
concept Graph = requires(const G& graph, int node, detail::AnyVisitor visit) {
  { graph.size() } -> std::convertible_to<int>;
  graph.for_each_edge(node, visit);
};

/// What an edge costs, by its number; zero or more, the same whenever it is asked. An infinite cost closes the edge.
template <class C, class S>
concept EdgeCost = requires(const C& cost, int edge) {
  { cost(edge) } -> std::convertible_to<S>;
};

/// At most what the cheapest way from a node to the goal costs; zero or more. With `NoHeuristic` the search is
/// Dijkstra's.
template <class H, class S>
concept Heuristic = requires(const H& least, int node) {
  { least(node) } -> std::convertible_to<S>;
};

struct NoHeuristic {
  double operator()(int) const { return 0; }
};

/// The search A* (Hart, Nilsson and Raphael 1968) with its memory, which one plan leaves to the next: once a graph has
/// been searched, no plan in it or in a smaller one allocates, and starting anew touches only the nodes that are
/// reached.
///
/// A node whose price falls after it was expanded is expanded again, so a heuristic need only be admissible. Of nodes
/// that look equally good the one nearer to the goal by the heuristic comes first, then the one of lower number: the
/// path depends on nothing but graph, costs and heuristic.
template <std::floating_point S = double>
class AStar {
public:
  explicit AStar(int nodes = 0) { reserve(nodes); }

  /// The cost of the cheapest path, infinite where there is none, and in `path` its nodes from start to goal (empty
  /// where there is none). Throws Error if start or goal is no node.
  template <Graph G, EdgeCost<S> C, Heuristic<S> H>
  S search(const G& graph, int start, int goal, const C& cost, const H& least, std::vector<int>& path) {
    const int n = static_cast<int>(graph.size());
    if (start < 0 || start >= n || goal < 0 || goal >= n)
      throw Error("A*: expected start and goal to be nodes of the graph");
    reserve(n);
    renew();
    path.clear();
    expanded_ = 0;
    open(start, -1, S(0), least);
    while (!heap_.empty()) {
      const int node = pop();
      if (node == goal) {
        for (int at = goal; at >= 0; at = record(at).parent) path.push_back(at);
        std::reverse(path.begin(), path.end());
        return record(goal).price;
      }
      ++expanded_;
      const S price = record(node).price;
      graph.for_each_edge(node,
                          [&](int target, int edge) { open(target, node, price + static_cast<S>(cost(edge)), least); });
    }
    return std::numeric_limits<S>::infinity();
  }

  /// How many nodes the last search expanded.
  int expanded() const { return expanded_; }

private:
  static constexpr int not_open = -1;

  struct Record {
    S price;  // of the best way known from the start
    S left;   // the heuristic
    int parent;
    int place;  // in the heap, or not_open
    std::uint32_t search;
  };
  // The keys sit in the heap itself: sifting would otherwise look up every record it passes.
  struct Item {
    S total, left;
    int node;
    bool before(const Item& o) const {
      if (total != o.total) return total < o.total;
      if (left != o.left) return left < o.left;
      return node < o.node;
    }
  };

  void reserve(int nodes) {
    if (nodes <= static_cast<int>(records_.size())) return;
    records_.resize(static_cast<std::size_t>(nodes), Record{S(0), S(0), -1, not_open, 0});
    heap_.reserve(static_cast<std::size_t>(nodes));
  }
  void renew() {
    heap_.clear();
    if (++search_ != 0) return;
    for (Record& r : records_) r.search = 0;
    search_ = 1;
  }
  Record& record(int node) { return records_[static_cast<std::size_t>(node)]; }

  template <class H>
  void open(int node, int parent, S price, const H& least) {
    Record& r = record(node);
    if (r.search != search_) {
      if (!(price < std::numeric_limits<S>::infinity())) return;
      r = {price, static_cast<S>(least(node)), parent, not_open, search_};
    } else {
      if (!(price < r.price)) return;
      r.price = price;
      r.parent = parent;
    }
    if (r.place == not_open) {
      r.place = static_cast<int>(heap_.size());
      heap_.push_back({});
    }
    raise(static_cast<std::size_t>(r.place), {price + r.left, r.left, node});
  }

  // A heap of four children to a node: half as deep as one of two, and the four lie side by side.
  void raise(std::size_t at, const Item& item) {
    while (at > 0) {
      const std::size_t above = (at - 1) / 4;
      if (!item.before(heap_[above])) break;
      put(at, heap_[above]);
      at = above;
    }
    put(at, item);
  }
  int pop() {
    const int node = heap_.front().node;
    record(node).place = not_open;
    const Item item = heap_.back();
    heap_.pop_back();
    if (heap_.empty()) return node;
    std::size_t at = 0;
    for (;;) {
      const std::size_t first = 4 * at + 1, last = std::min(first + 4, heap_.size());
      if (first >= last) break;
      std::size_t best = first;
      for (std::size_t child = first + 1; child < last; ++child)
        if (heap_[child].before(heap_[best])) best = child;
      if (!heap_[best].before(item)) break;
      put(at, heap_[best]);
      at = best;
    }
    put(at, item);
    return node;
  }
  void put(std::size_t at, const Item& item) {
    heap_[at] = item;
    record(item.node).place = static_cast<int>(at);
  }

  std::vector<Record> records_;
  std::vector<Item> heap_;
  std::uint32_t search_ = 0;
  int expanded_ = 0;
};

/// The price of a way over terrain, PARC Eq. 6: of an edge, w_xy times its squared horizontal length, plus w_z times
/// its squared rise, plus a random number.
struct TerrainCost {
  double horizontal = 1;   ///< w_xy, 1/m^2
  double vertical = 0.15;  ///< w_z, 1/m^2
  double noise_min = 0, noise_max = 0.5;
};

/// Least price of a way between two nodes of a navigation graph: admissible and consistent for `TerrainCost`, which
/// distance is not, since squares make many short edges cheaper than one long one.
///
/// Let M be the number of cells to go, |di| + |dj|, H the difference in height and a the side of a cell. An edge of di
/// by dj cells costs at least w_xy a^2 (|di| + |dj|), its whole numbers being no larger than their squares. On a way of
/// n edges these sum to w_xy a^2 M or more and, every edge crossing at least one cell, to w_xy a^2 n or more; the
/// squares of the rises sum to H^2 / n or more; and the noise to n times its minimum c. The least over real n > 0 of
///
///     w_xy a^2 max(M, n) + w_z H^2 / n + c n
///
/// is exact on flat ground without noise.
class LeastTerrainCost {
public:
  LeastTerrainCost(const NavigationGraph& graph, int goal, const TerrainCost& cost)
      : graph_(graph),
        goal_i_(graph.column(goal)),
        goal_j_(graph.row(goal)),
        goal_height_(graph.height(goal)),
        per_cell_(cost.horizontal * graph.cell() * graph.cell()),
        vertical_(cost.vertical),
        per_edge_(cost.noise_min) {}

  double operator()(int node) const {
    const double cells = std::abs(graph_.column(node) - goal_i_) + std::abs(graph_.row(node) - goal_j_);
    const double rise = graph_.height(node) - goal_height_, climb = vertical_ * rise * rise;
    const double both = per_cell_ + per_edge_;
    // Rounding may not lift the bound over the price of a path it is exact for.
    constexpr double slack = 1 - 1e-12;
    if (climb >= both * cells * cells) return slack * 2 * std::sqrt(climb * both);
    if (climb <= per_edge_ * cells * cells) return slack * (per_cell_ * cells + 2 * std::sqrt(climb * per_edge_));
    return slack * (both * cells + climb / cells);
  }

private:
  const NavigationGraph& graph_;
  int goal_i_, goal_j_;
  double goal_height_, per_cell_, vertical_, per_edge_;
};

/// Paths over terrain by `TerrainCost`. Keeps its memory from one plan to the next.
class PathPlanner {
public:
  /// Throws Error on a weight or a least noise below zero, or a range of noise that is empty.
  explicit PathPlanner(const TerrainCost& cost = {}) : cost_(cost) {
    if (!(cost.horizontal >= 0 && cost.vertical >= 0 && cost.noise_min >= 0 && cost.noise_min <= cost.noise_max) ||
        !std::isfinite(cost.horizontal + cost.vertical + cost.noise_max))
      throw Error("path planner: expected weights of zero or more and 0 <= noise_min <= noise_max");
  }

  const TerrainCost& cost() const { return cost_; }

  /// The cheapest path's price, infinite where there is no path, and its nodes from start to goal. The noise of an edge
  /// is a function of (seed, step, node, which of the node's edges): however the search goes, an edge keeps its price,
  /// so the path is the cheapest under one draw of all prices. Throws Error if start or goal is no node.
  double plan(const NavigationGraph& graph, int start, int goal, std::uint64_t seed, std::uint64_t step,
              std::vector<int>& path) {
    if (start < 0 || start >= graph.size() || goal < 0 || goal >= graph.size())
      throw Error("path planner: expected start and goal to be nodes of the graph");
    draw(graph, seed, step);
    const auto cost = [this](int edge) { return prices_[static_cast<std::size_t>(edge)]; };
    return search_.search(graph, start, goal, cost, LeastTerrainCost(graph, goal, cost_), path);
  }

  /// The price of every edge in the last plan.
  std::span<const double> prices() const { return prices_; }
  /// How many nodes the last plan expanded.
  int expanded() const { return search_.expanded(); }

private:
  void draw(const NavigationGraph& graph, std::uint64_t seed, std::uint64_t step) {
    prices_.resize(static_cast<std::size_t>(graph.edge_count()));
    const bool noisy = cost_.noise_max > cost_.noise_min;
    const double per_square_cell = cost_.horizontal * graph.cell() * graph.cell();
    for (int node = 0; node < graph.size(); ++node) {
      core::RandomStream random(seed, static_cast<std::uint64_t>(node), step);
      const int i = graph.column(node), j = graph.row(node);
      const double height = graph.height(node);
      graph.for_each_edge(node, [&](int target, int edge) {
        const int di = graph.column(target) - i, dj = graph.row(target) - j;
        const double rise = graph.height(target) - height;
        double price = per_square_cell * (di * di + dj * dj) + cost_.vertical * rise * rise;
        price += cost_.noise_min;
        if (noisy) price += (cost_.noise_max - cost_.noise_min) * random.uniform<float>();
        prices_[static_cast<std::size_t>(edge)] = price;
      });
    }
  }

  TerrainCost cost_;
  AStar<double> search_;
  std::vector<double> prices_;
};

}  // namespace traceur::plan
