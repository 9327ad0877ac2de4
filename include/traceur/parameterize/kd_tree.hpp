// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <limits>
#include <numeric>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <traceur/core/error.hpp>

namespace traceur::parameterize {

/// A point found by its number, with the squared distance to what was searched for.
struct Neighbor {
  int index = -1;
  double squared_distance = 0.0;
};

/// Points of R^n that are searched for by distance. Laws: the points are numbered 0 to size() - 1; `for_each_within`
/// calls back once for every point nearer than the radius, in any order, until it is told false; `nearest` writes the
/// nearest points in order of distance, those as far in order of their numbers, and returns how many it wrote.
template <class P>
concept NeighborSource = requires(const P& points, const Eigen::VectorXd& a, double radius, std::span<Neighbor> out) {
  { points.dimension() } -> std::convertible_to<Eigen::Index>;
  { points.size() } -> std::convertible_to<int>;
  { points.unit() } -> std::convertible_to<const Eigen::VectorXd&>;
  points.for_each_within(a, radius, [](int, double) { return true; });
  { points.nearest(a, out) } -> std::convertible_to<int>;
};

/// Points that come and go, indexed by a k-d tree in which every operation is logarithmic. The distance is
/// (a - b)^T A (a - b) with A = diag(1 / unit^2).
///
/// Leaves hold up to 32 points. A search screens a leaf at once by single-precision copies that lie coordinate by
/// coordinate, and takes in double precision only the few points which those cannot rule out. A removal takes the point
/// out of its leaf: nothing is left behind, however many points come and go (a forest of static trees that marks its
/// dead would grow). A subtree that gets lopsided is built anew, which costs O(log n) a change on average.
///
/// What a search finds depends on the points alone, not on the order in which they came.
class KdTree {
public:
  static constexpr Eigen::Index max_dimension = 32;

  /// `unit`: of each coordinate, > 0; none for all 1. Throws Error otherwise.
  explicit KdTree(Eigen::Index dimension, const Eigen::VectorXd& unit = {})
      : unit_(unit.size() > 0 ? unit : Eigen::VectorXd(Eigen::VectorXd::Ones(dimension))) {
    if (dimension < 1 || dimension > max_dimension) {
      throw Error("KdTree: expected 1 to " + std::to_string(max_dimension) + " dimensions, got " +
                  std::to_string(dimension));
    }
    if (unit_.size() != dimension || !unit_.allFinite() || !(unit_.minCoeff() > 0.0)) {
      throw Error("KdTree: unit: expected none or " + std::to_string(dimension) + " finite numbers above 0");
    }
    inverse_unit_ = unit_.cwiseInverse();
    root_ = make_leaf(-1);
  }

  Eigen::Index dimension() const noexcept { return unit_.size(); }
  int size() const noexcept { return static_cast<int>(place_.size()); }
  const Eigen::VectorXd& unit() const noexcept { return unit_; }

  /// Adds a point (n), whose number is then size() - 1. Throws Error if its size differs, it is not finite or it is 1e18
  /// units away.
  void insert(const Eigen::Ref<const Eigen::VectorXd>& point) {
    Coordinates x;
    scale(point, x);
    place_.push_back(0);
    int node = root_;
    for (;;) {
      ++at(node).count;
      if (at(node).axis < 0) break;
      node = x[index(at(node).axis)] < at(node).split ? at(node).left : at(node).right;
    }
    if (at(node).count > leaf_size) {
      --at(node).count;
      rebuild(node, true);
      ++at(node).count;
      const int child = x[index(at(node).axis)] < at(node).split ? at(node).left : at(node).right;
      ++at(child).count;
      node = child;
    }
    put(node, at(node).count - 1, x, size() - 1);
    rebalance(node);
    count_change();
  }

  /// Removes point `i`; the last point takes its number.
  void remove(int i) {
    const int place = place_[index(i)];
    const int block = place / leaf_size;
    const int node = owner_[index(block)];
    const int last = block * leaf_size + at(node).count - 1;
    if (place != last) move(last, place);
    for (int up = node; up >= 0; up = at(up).parent) --at(up).count;
    const int back = size() - 1;
    if (i != back) {
      place_[index(i)] = place_[index(back)];
      ids_[index(place_[index(i)])] = i;
    }
    place_.pop_back();
    rebalance(node);
    count_change();
  }

  /// Point `i` (n).
  Eigen::VectorXd point(int i) const {
    Eigen::VectorXd x(dimension());
    const int place = place_[index(i)];
    for (Eigen::Index d = 0; d < dimension(); ++d) x(d) = coordinates_[coordinate(place, d)] * unit_(d);
    return x;
  }

  /// Calls `f(index, squared distance)` for the points whose distance to `a` (n) is below `radius`, until it returns
  /// false.
  template <class F>
  requires std::predicate<F&, int, double>
  void for_each_within(const Eigen::Ref<const Eigen::VectorXd>& a, double radius, F&& f) const {
    Query<F> query{*this, {}, {}, radius * radius, f};
    if (!(radius > 0.0)) return;
    scale(a, query.x);
    query.screen.begin(query.x, dimension());
    query.screen.set_limit(query.limit);
    query.visit(root_, 0.0);
  }

  /// Writes the `out.size()` points nearest to `a` (n), or all there are, and returns how many.
  int nearest(const Eigen::Ref<const Eigen::VectorXd>& a, std::span<Neighbor> out) const {
    Nearest query{*this, {}, {}, out, 0, {}};
    if (out.empty()) return 0;
    scale(a, query.x);
    query.screen.begin(query.x, dimension());
    query.visit(root_, 0.0);
    return query.found;
  }

private:
  static constexpr int leaf_size = 32;
  // So that no sum of squares overflows in single precision.
  static constexpr double farthest = 1e18;
  // A bound is a sum of rounded parts: without a margin it could hide a point on the very edge of a search.
  static constexpr double rounding = 1.0 - 1e-12;
  using Coordinates = std::array<double, static_cast<std::size_t>(max_dimension)>;

  struct Node {
    double split = 0.0;  // coordinates in `left` are at most this, in `right` at least
    int axis = -1;       // -1 for a leaf
    int left = -1;       // of a leaf, its block
    int right = -1;
    int parent = -1;
    int count = 0;
  };

  // What single precision may rule out. A point as near as the square root of the limit has coordinates of at most the
  // query's and that, so each difference is off by less than 2^-22 of it, and the distance, by the triangle inequality, by
  // sqrt(n) times as much; the sum of squares adds n roundings.
  struct Screen {
    std::array<float, static_cast<std::size_t>(max_dimension)> x;
    double largest = 0.0, root_dimension = 0.0;
    float threshold = std::numeric_limits<float>::infinity();

    void begin(const Coordinates& query, Eigen::Index n) {
      root_dimension = std::sqrt(static_cast<double>(n));
      for (std::size_t d = 0; d < static_cast<std::size_t>(n); ++d) {
        x[d] = static_cast<float>(query[d]);
        largest = std::max(largest, std::abs(query[d]));
      }
    }
    void set_limit(double limit) {
      const double distance = std::sqrt(limit);
      const double wide = distance * (1.0 + 1e-5) + root_dimension * (largest + distance) * 0x1p-21;
      const double square = wide * wide * (1.0 + 1e-6) + static_cast<double>(std::numeric_limits<float>::min());
      threshold = square < 1e38 ? static_cast<float>(square) : std::numeric_limits<float>::infinity();
    }
  };

  // The lower bound of the distance to a node is kept by the part of each axis, as in Arya and Mount, "Algorithms for
  // Fast Vector Quantization" (1993).
  template <class F>
  struct Query {
    const KdTree& tree;
    Coordinates x;
    Coordinates part;
    double limit;
    F& f;
    Screen screen = {};

    bool visit(int number, double bound) {
      if (number == tree.root_) std::fill_n(part.begin(), tree.dimension(), 0.0);
      const Node& node = tree.nodes_[index(number)];
      if (node.axis < 0) {
        std::array<float, leaf_size> rough;
        if (!tree.may_be_near(node.left, screen, rough)) return true;
        const int first = node.left * leaf_size;
        for (int i = 0; i < node.count; ++i) {
          if (!(rough[index(i)] <= screen.threshold)) continue;
          const double squared = tree.squared_distance(first + i, x);
          if (squared < limit && !f(tree.ids_[index(first + i)], squared)) return false;
        }
        return true;
      }
      tree.fetch_children(node);
      const std::size_t axis = index(node.axis);
      const double gap = x[axis] - node.split;
      const bool below = gap < 0.0;
      if (!visit(below ? node.left : node.right, bound)) return false;
      const double before = part[axis];
      const double beyond = bound - before + gap * gap;
      if (!(beyond * rounding < limit)) return true;
      part[axis] = gap * gap;
      const bool go_on = visit(below ? node.right : node.left, beyond);
      part[axis] = before;
      return go_on;
    }
  };

  struct Nearest {
    const KdTree& tree;
    Coordinates x;
    Coordinates part;
    std::span<Neighbor> out;
    int found;
    Screen screen;

    void visit(int number, double bound) {
      if (number == tree.root_) std::fill_n(part.begin(), tree.dimension(), 0.0);
      const Node& node = tree.nodes_[index(number)];
      if (node.axis < 0) {
        // Most leaves of a search hold nothing near enough, which one comparison of all tells.
        std::array<float, leaf_size> rough;
        if (!tree.may_be_near(node.left, screen, rough)) return;
        const int first = node.left * leaf_size;
        for (int i = 0; i < node.count; ++i)
          if (rough[index(i)] <= screen.threshold) offer({tree.ids_[index(first + i)], tree.squared_distance(first + i, x)});
        return;
      }
      tree.fetch_children(node);
      const std::size_t axis = index(node.axis);
      const double gap = x[axis] - node.split;
      const bool below = gap < 0.0;
      visit(below ? node.left : node.right, bound);
      const double before = part[axis];
      const double beyond = bound - before + gap * gap;
      if (found == static_cast<int>(out.size()) && beyond * rounding > out.back().squared_distance) return;
      part[axis] = gap * gap;
      visit(below ? node.right : node.left, beyond);
      part[axis] = before;
    }

    void offer(const Neighbor& candidate) {
      const auto nearer = [](const Neighbor& p, const Neighbor& q) {
        return p.squared_distance < q.squared_distance ||
               (p.squared_distance == q.squared_distance && p.index < q.index);
      };
      const bool full = found == static_cast<int>(out.size());
      if (full && !nearer(candidate, out.back())) return;
      std::size_t i = index(full ? found - 1 : found++);
      for (; i > 0 && nearer(candidate, out[i - 1]); --i) out[i] = out[i - 1];
      out[i] = candidate;
      if (found == static_cast<int>(out.size())) screen.set_limit(out.back().squared_distance);
    }
  };

  // The second child is asked for by the time the first is done; what is in a distant cache comes meanwhile.
  void fetch_children(const Node& node) const noexcept {
    __builtin_prefetch(&at(node.left));
    __builtin_prefetch(&at(node.right));
  }

  static std::size_t index(int i) noexcept { return static_cast<std::size_t>(i); }
  Node& at(int i) noexcept { return nodes_[index(i)]; }
  const Node& at(int i) const noexcept { return nodes_[index(i)]; }

  std::size_t coordinate(int place, Eigen::Index d) const noexcept {
    return index(place) * static_cast<std::size_t>(dimension()) + static_cast<std::size_t>(d);
  }
  // Block after block, coordinate by coordinate.
  std::size_t rough_coordinate(int place, Eigen::Index d) const noexcept {
    const int block = place / leaf_size;
    return (index(block) * static_cast<std::size_t>(dimension()) + static_cast<std::size_t>(d)) * leaf_size + index(place % leaf_size);
  }

  void scale(const Eigen::Ref<const Eigen::VectorXd>& point, Coordinates& x) const {
    if (point.size() != dimension() || !point.allFinite()) {
      throw Error("KdTree: expected a point of " + std::to_string(dimension()) + " finite numbers, got " +
                  std::to_string(point.size()));
    }
    for (Eigen::Index d = 0; d < dimension(); ++d) {
      x[static_cast<std::size_t>(d)] = point(d) * inverse_unit_(d);
      if (!(std::abs(x[static_cast<std::size_t>(d)]) < farthest))
        throw Error("KdTree: expected coordinates below 1e18 units, got " + std::to_string(point(d)));
    }
  }

  bool may_be_near(int block, const Screen& screen, std::array<float, leaf_size>& rough) const noexcept {
    rough.fill(0.0F);
    const float* c = rough_.data() + rough_coordinate(block * leaf_size, 0);
    for (std::size_t d = 0; d < static_cast<std::size_t>(dimension()); ++d, c += leaf_size) {
      for (std::size_t i = 0; i < leaf_size; ++i) {
        const float difference = c[i] - screen.x[d];
        rough[i] += difference * difference;
      }
    }
    bool some = false;
    for (const float squared : rough) some |= squared <= screen.threshold;
    return some;
  }
  double squared_distance(int place, const Coordinates& x) const noexcept {
    const double* c = coordinates_.data() + coordinate(place, 0);
    double squared = 0.0;
    for (std::size_t d = 0; d < static_cast<std::size_t>(dimension()); ++d) {
      const double difference = c[d] - x[d];
      squared += difference * difference;
    }
    return squared;
  }

  int make_node(int parent) {
    int node = static_cast<int>(nodes_.size());
    if (free_nodes_.empty()) {
      nodes_.emplace_back();
    } else {
      node = free_nodes_.back();
      free_nodes_.pop_back();
      at(node) = Node{};
    }
    at(node).parent = parent;
    return node;
  }

  int make_leaf(int parent) {
    const int node = make_node(parent);
    make_block(node);
    return node;
  }

  void make_block(int node) {
    int block = static_cast<int>(owner_.size());
    if (free_blocks_.empty()) {
      owner_.push_back(node);
      ids_.resize(ids_.size() + leaf_size);
      coordinates_.resize(coordinates_.size() + static_cast<std::size_t>(dimension() * leaf_size));
      rough_.resize(coordinates_.size());
    } else {
      block = free_blocks_.back();
      free_blocks_.pop_back();
      owner_[index(block)] = node;
    }
    at(node).axis = -1;
    at(node).left = block;
    at(node).right = -1;
  }

  void put(int leaf, int slot, const Coordinates& x, int id) {
    const int place = at(leaf).left * leaf_size + slot;
    for (Eigen::Index d = 0; d < dimension(); ++d) {
      coordinates_[coordinate(place, d)] = x[static_cast<std::size_t>(d)];
      rough_[rough_coordinate(place, d)] = static_cast<float>(x[static_cast<std::size_t>(d)]);
    }
    ids_[index(place)] = id;
    place_[index(id)] = place;
  }

  void move(int from, int to) {
    for (Eigen::Index d = 0; d < dimension(); ++d) {
      coordinates_[coordinate(to, d)] = coordinates_[coordinate(from, d)];
      rough_[rough_coordinate(to, d)] = rough_[rough_coordinate(from, d)];
    }
    ids_[index(to)] = ids_[index(from)];
    place_[index(ids_[index(to)])] = to;
  }

  // Takes all points below `node` out of the tree and gives it a balanced subtree of them instead.
  void rebuild(int node, bool must_split) {
    gathered_.clear();
    gathered_ids_.clear();
    gather(node, true);
    order_.resize(gathered_ids_.size());
    std::iota(order_.begin(), order_.end(), 0);
    grow(node, order_, must_split);
  }

  // Neighbours end up in distant blocks as points come and go; now and then all are laid out anew, in the order of the
  // tree.
  void count_change() {
    if (++changes_ < 2 * size() + 64) return;
    changes_ = 0;
    gathered_.clear();
    gathered_ids_.clear();
    gather(root_, true);
    nodes_.clear();
    owner_.clear();
    ids_.clear();
    coordinates_.clear();
    rough_.clear();
    free_nodes_.clear();
    free_blocks_.clear();
    order_.resize(gathered_ids_.size());
    std::iota(order_.begin(), order_.end(), 0);
    root_ = make_node(-1);
    grow(root_, order_, false);
  }

  // Copies the points below `node` and frees all but the node itself.
  void gather(int node, bool keep) {
    const Node old = at(node);
    if (old.axis >= 0) {
      gather(old.left, false);
      gather(old.right, false);
    } else {
      const int first = old.left * leaf_size;
      for (int place = first; place < first + old.count; ++place) {
        gathered_ids_.push_back(ids_[index(place)]);
        for (Eigen::Index d = 0; d < dimension(); ++d) gathered_.push_back(coordinates_[coordinate(place, d)]);
      }
      free_blocks_.push_back(old.left);
    }
    if (!keep) free_nodes_.push_back(node);
  }

  double gathered(int i, int axis) const noexcept {
    return gathered_[index(i) * static_cast<std::size_t>(dimension()) + index(axis)];
  }

  void grow(int node, std::span<int> points, bool must_split) {
    at(node).count = static_cast<int>(points.size());
    if (points.size() <= leaf_size && !must_split) {
      make_block(node);
      for (std::size_t i = 0; i < points.size(); ++i) {
        Coordinates x;
        for (int d = 0; d < static_cast<int>(dimension()); ++d) x[index(d)] = gathered(points[i], d);
        put(node, static_cast<int>(i), x, gathered_ids_[index(points[i])]);
      }
      return;
    }
    int axis = 0;
    double widest = -1.0;
    for (int d = 0; d < static_cast<int>(dimension()); ++d) {
      const auto [low, high] = std::minmax_element(points.begin(), points.end(),
                                                   [&](int p, int q) { return gathered(p, d) < gathered(q, d); });
      const double width = gathered(*high, d) - gathered(*low, d);
      if (width > widest) {
        widest = width;
        axis = d;
      }
    }
    const auto half = points.begin() + static_cast<std::ptrdiff_t>(points.size() / 2);
    std::nth_element(points.begin(), half, points.end(), [&](int p, int q) {
      const double a = gathered(p, axis), b = gathered(q, axis);
      return a < b || (a == b && gathered_ids_[index(p)] < gathered_ids_[index(q)]);
    });
    const int left = make_node(node), right = make_node(node);
    at(node).axis = axis;
    at(node).split = gathered(*half, axis);
    at(node).left = left;
    at(node).right = right;
    const std::size_t lower = points.size() / 2;
    grow(left, points.first(lower), false);
    grow(right, points.subspan(lower), false);
  }

  // Rebuilds the highest subtree above the leaf `node` that is lopsided or has become small enough for a leaf.
  void rebalance(int node) {
    int worst = -1;
    for (int up = at(node).parent; up >= 0; up = at(up).parent) {
      const int count = at(up).count;
      const int larger = std::max(at(at(up).left).count, at(at(up).right).count);
      if (count <= leaf_size / 2 || larger > (3 * count) / 4 + leaf_size) worst = up;
    }
    if (worst >= 0) rebuild(worst, false);
  }

  Eigen::VectorXd unit_, inverse_unit_;
  std::vector<Node> nodes_;
  std::vector<int> owner_;           // the leaf of each block
  std::vector<int> ids_;             // the point at each place
  std::vector<double> coordinates_;  // in units
  std::vector<float> rough_;         // the same
  std::vector<int> place_;           // of each point
  std::vector<int> free_nodes_, free_blocks_;
  int root_ = -1;
  int changes_ = 0;

  // Scratch of a rebuild.
  std::vector<double> gathered_;
  std::vector<int> gathered_ids_;
  std::vector<int> order_;
};

}  // namespace traceur::parameterize
