// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "traceur/core/error.hpp"
#include "traceur/core/random.hpp"
#include "traceur/core/vector3.hpp"
#include "traceur/terrain/height_grid.hpp"

namespace traceur::plan {

/// Who can go where (PARC B.1; the numbers on jumps are those of the authors' code). A `jump_radius` of zero leaves the
/// jumps out.
struct NavigationParameters {
  double step_height = 2.1;     ///< m, most by which adjacent cells may differ, up or down
  double jump_radius = 3.0;     ///< m, horizontally
  double jump_rise_min = -1.0;  ///< m, of the landing over the take-off
  double jump_rise_max = 0.5;   ///< m
  double cliff_drop = 0.5;      ///< m, least by which a cell on a cliff is above one of its four neighbours
  double jump_clearance = 0.5;  ///< m, of the line of flight over the tops it leads from and to
};

/// A terrain as a directed graph for path search: one node per cell, node i + nx j in the middle of the top of cell (i,
/// j); edges to the eight neighbours within reach; and jump edges between cells on cliffs.
///
/// A jump's line of flight is straight, `jump_clearance` above both tops, since a jump rises before it falls: a level
/// jump clears what is lower than the jump is high. No column between the two reaches up to the line. A line through
/// the corner where four cells meet counts as over all four.
class NavigationGraph {
public:
  /// Steps and jumps in one list: a search asks for the target only.
  struct Edge {
    int target;
    bool jump;
  };

  /// Throws Error on a parameter that is not a number or negative where it is a length.
  explicit NavigationGraph(const terrain::HeightGrid& grid, const NavigationParameters& parameters = {})
      : nx_(grid.nx()),
        ny_(grid.ny()),
        cell_(grid.cell()),
        x0_(grid.center_x(0)),
        y0_(grid.center_y(0)),
        parameters_(parameters),
        heights_(grid.heights().data(), grid.heights().data() + grid.heights().size()) {
    const NavigationParameters& p = parameters_;
    if (!(p.step_height >= 0 && p.jump_radius >= 0 && p.cliff_drop >= 0 && p.jump_clearance >= 0) ||
        !(p.jump_rise_min <= p.jump_rise_max) || !std::isfinite(p.jump_radius))
      throw Error("navigation graph: expected lengths of zero or more and jump_rise_min <= jump_rise_max");
    find_cliffs();
    const std::vector<Jump> jumps = all_jumps();
    first_.reserve(heights_.size() + 1);
    first_.push_back(0);
    edges_.reserve(8 * heights_.size());
    for (int j = 0; j < ny_; ++j)
      for (int i = 0; i < nx_; ++i) {
        const double h = heights_[index(i, j)];
        for (int b = std::max(j - 1, 0); b <= std::min(j + 1, ny_ - 1); ++b)
          for (int a = std::max(i - 1, 0); a <= std::min(i + 1, nx_ - 1); ++a)
            if ((a != i || b != j) && std::abs(heights_[index(a, b)] - h) <= p.step_height)
              edges_.push_back({node(a, b), false});
        if (cliff_[index(i, j)] != 0)
          for (const Jump& jump : jumps) {
            const int a = i + jump.di, b = j + jump.dj;
            if (a < 0 || a >= nx_ || b < 0 || b >= ny_ || cliff_[index(a, b)] == 0) continue;
            const double rise = heights_[index(a, b)] - h;
            if (rise >= p.jump_rise_min && rise <= p.jump_rise_max && clear(jump, index(i, j), rise))
              edges_.push_back({node(a, b), true});
          }
        first_.push_back(static_cast<int>(edges_.size()));
      }
  }

  int size() const { return nx_ * ny_; }
  int nx() const { return nx_; }
  int ny() const { return ny_; }
  double cell() const { return cell_; }
  const NavigationParameters& parameters() const { return parameters_; }

  int node(int i, int j) const { return i + nx_ * j; }
  int column(int node) const { return node % nx_; }
  int row(int node) const { return node / nx_; }
  double height(int node) const { return heights_[static_cast<std::size_t>(node)]; }
  /// Middle of a node's top, m, world.
  core::Vector3<double> position(int node) const {
    return {x0_ + column(node) * cell_, y0_ + row(node) * cell_, height(node)};
  }
  /// Whether a jump may begin or end at a node: a cell not on the border that is well above one beside it.
  bool on_cliff(int node) const { return cliff_[static_cast<std::size_t>(node)] != 0; }

  int edge_count() const { return static_cast<int>(edges_.size()); }
  /// The edges of a node are numbers first_edge(node) to first_edge(node + 1), the last not included.
  int first_edge(int node) const { return first_[static_cast<std::size_t>(node)]; }
  const Edge& edge(int e) const { return edges_[static_cast<std::size_t>(e)]; }
  std::span<const Edge> edges(int node) const {
    return {edges_.data() + first_edge(node), static_cast<std::size_t>(first_edge(node + 1) - first_edge(node))};
  }

  /// Calls f(target, edge number) for every edge of a node.
  template <class F>
  void for_each_edge(int node, F&& f) const {
    const int last = first_edge(node + 1);
    for (int e = first_edge(node); e < last; ++e) f(edges_[static_cast<std::size_t>(e)].target, e);
  }

private:
  std::size_t index(int i, int j) const {
    return static_cast<std::size_t>(i) + static_cast<std::size_t>(nx_) * static_cast<std::size_t>(j);
  }

  void find_cliffs() {
    cliff_.assign(heights_.size(), 0);
    for (int j = 1; j + 1 < ny_; ++j)
      for (int i = 1; i + 1 < nx_; ++i) {
        const double lowest = std::min({heights_[index(i - 1, j)], heights_[index(i + 1, j)], heights_[index(i, j - 1)],
                                        heights_[index(i, j + 1)]});
        cliff_[index(i, j)] = heights_[index(i, j)] - lowest >= std::max(parameters_.cliff_drop, 1e-9) ? 1 : 0;
      }
  }

  // A column that a line passes over: how far it is from the take-off's, and between which shares of the way.
  struct Passed {
    std::ptrdiff_t offset;
    double enter, leave;
  };
  struct Jump {
    int di, dj;
    std::vector<Passed> between;
    double leaves_first, enters_last;  // shares of the way
  };

  // What lies under a line depends on where it leads, not on where it begins.
  std::vector<Jump> all_jumps() const {
    const double radius = parameters_.jump_radius;
    const int reach = static_cast<int>(std::min(radius / cell_ * (1 + 1e-9), static_cast<double>(nx_ + ny_)));
    std::vector<Jump> jumps;
    for (int dj = -reach; dj <= reach; ++dj)
      for (int di = -reach; di <= reach; ++di)
        if ((std::abs(di) > 1 || std::abs(dj) > 1) && std::hypot(di, dj) * cell_ <= radius * (1 + 1e-9))
          jumps.push_back(jump(di, dj));
    return jumps;
  }

  // The line crosses the a-th bound between columns at the share (2a + 1) / (2 |di|) of its way, so which bound it
  // comes to first is a comparison of whole numbers, ties (corners) included.
  Jump jump(int di, int dj) const {
    const int nx = std::abs(di), ny = std::abs(dj), si = di < 0 ? -1 : 1, sj = dj < 0 ? -1 : 1;
    const auto offset = [&](int a, int b) { return si * a + static_cast<std::ptrdiff_t>(nx_) * sj * b; };
    Jump out{di, dj, {}, 0, 0};
    int a = 0, b = 0;
    double entered = 0;
    while (a < nx || b < ny) {
      const int to_x = (2 * a + 1) * ny, to_y = (2 * b + 1) * nx;
      const bool step_x = b == ny || (a < nx && to_x <= to_y), step_y = a == nx || (b < ny && to_y <= to_x);
      const double left = step_x ? (2 * a + 1) / (2.0 * nx) : (2 * b + 1) / (2.0 * ny);
      if (a == 0 && b == 0) {
        out.leaves_first = left;
      } else {
        out.between.push_back({offset(a, b), entered, left});
      }
      if (step_x && step_y) {
        out.between.push_back({offset(a + 1, b), left, left});
        out.between.push_back({offset(a, b + 1), left, left});
      }
      if (step_x) ++a;
      if (step_y) ++b;
      entered = left;
    }
    out.enters_last = entered;
    return out;
  }

  bool clear(const Jump& jump, std::size_t from, double rise) const {
    const double* const take_off = heights_.data() + from;
    const double start = *take_off + parameters_.jump_clearance;
    // A line only rises or only falls, so over a column it is lowest at one of the column's ends.
    for (const Passed& p : jump.between)
      if (take_off[p.offset] >= start + rise * (rise > 0 ? p.enter : p.leave)) return false;
    // The two tops it leads between it may touch, but neither may stand in its own way.
    return start + std::min(rise * jump.leaves_first, 0.0) >= *take_off &&
           start + std::min(rise * jump.enters_last, rise) >= *take_off + rise;
  }

  int nx_, ny_;
  double cell_, x0_, y0_;
  NavigationParameters parameters_;
  std::vector<double> heights_;
  std::vector<unsigned char> cliff_;
  std::vector<int> first_;
  std::vector<Edge> edges_;
};

/// Where paths over a new terrain begin and end (PARC B.3; the numbers of the authors' code).
struct EndpointParameters {
  int inset = 1;        ///< cells between the border and the ring of cells that ends are drawn from
  double distance = 5;  ///< m, least between the two, horizontally
};

struct Endpoints {
  int start = 0, goal = 0;  ///< nodes
};

/// A start and a goal on the ring of cells near a terrain's edges, every pair that is far enough apart equally likely;
/// nothing if there is none.
inline std::optional<Endpoints> random_endpoints(const NavigationGraph& graph, const EndpointParameters& p,
                                                 core::RandomStream& random) {
  const int i0 = p.inset, j0 = p.inset, i1 = graph.nx() - 1 - p.inset, j1 = graph.ny() - 1 - p.inset;
  if (i0 < 0 || i1 < i0 || j1 < j0) return std::nullopt;
  std::vector<int> ring;
  for (int j = j0; j <= j1; ++j)
    for (int i = i0; i <= i1; ++i)
      if (i == i0 || i == i1 || j == j0 || j == j1) ring.push_back(graph.node(i, j));
  const auto far_enough = [&](int a, int b) {
    const double dx = graph.column(a) - graph.column(b), dy = graph.row(a) - graph.row(b);
    return a != b && std::hypot(dx, dy) * graph.cell() >= p.distance * (1 - 1e-9);
  };
  std::uint64_t pairs = 0;
  for (const int a : ring)
    for (const int b : ring) pairs += far_enough(a, b) ? 1 : 0;
  if (pairs == 0) return std::nullopt;
  const auto n = static_cast<std::uint32_t>(ring.size());
  for (;;) {
    const int a = ring[random.below(n)], b = ring[random.below(n)];
    if (far_enough(a, b)) return Endpoints{a, b};
  }
}

}  // namespace traceur::plan
