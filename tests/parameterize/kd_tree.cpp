// SPDX-License-Identifier: MIT
#include <traceur/parameterize/kd_tree.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace traceur::parameterize;
using support::fails_with;
using traceur::core::RandomStream;

static_assert(NeighborSource<KdTree>);
static_assert(!NeighborSource<std::vector<double>>);

namespace {

using Vector = Eigen::VectorXd;

/// The same points in a list, searched one by one.
struct List {
  Vector unit;
  std::vector<Vector> points;

  double squared(int i, const Vector& a) const {
    return (points[static_cast<std::size_t>(i)] - a).cwiseQuotient(unit).squaredNorm();
  }
  void remove(int i) {
    points[static_cast<std::size_t>(i)] = points.back();
    points.pop_back();
  }
};

void check_same(const KdTree& tree, const List& list, const Vector& a, double radius, int k) {
  REQUIRE(tree.size() == static_cast<int>(list.points.size()));
  std::vector<int> found, expected;
  tree.for_each_within(a, radius, [&](int i, double squared) {
    CHECK(std::abs(squared - list.squared(i, a)) < 1e-12);
    found.push_back(i);
    return true;
  });
  std::vector<Neighbor> all;
  for (int i = 0; i < tree.size(); ++i) {
    const double squared = list.squared(i, a);
    if (squared < radius * radius) expected.push_back(i);
    all.push_back({i, squared});
  }
  std::sort(found.begin(), found.end());
  CHECK(found == expected);
  std::sort(all.begin(), all.end(), [](const Neighbor& p, const Neighbor& q) {
    return p.squared_distance < q.squared_distance || (p.squared_distance == q.squared_distance && p.index < q.index);
  });
  std::vector<Neighbor> nearest(static_cast<std::size_t>(k));
  const int count = tree.nearest(a, nearest);
  REQUIRE(count == std::min(k, tree.size()));
  for (int i = 0; i < count; ++i)
    CHECK(nearest[static_cast<std::size_t>(i)].index == all[static_cast<std::size_t>(i)].index);
}

}  // namespace

TEST_CASE("k-d tree: searches find what comparing every point finds, while points come and go") {
  for (const Eigen::Index n : {1, 2, 4, 7}) {
    RandomStream random(3, static_cast<std::uint64_t>(n));
    List list{Vector::LinSpaced(n, 0.5, 2.0), {}};
    KdTree tree(n, list.unit);
    for (int step = 0; step < 3000; ++step) {
      // Grows, then shrinks to nothing and grows again, in stretches.
      const bool grow = list.points.empty() || random.uniform() < (step / 500 % 2 == 0 ? 0.9 : 0.2);
      if (grow) {
        // Half of them near the others' corner: the tree gets lopsided.
        Vector a = support::uniform(random, n, 1).col(0);
        if (random.bernoulli(0.5)) a *= 0.01;
        tree.insert(a);
        list.points.push_back(a);
      } else {
        const int i = static_cast<int>(random.below(static_cast<std::uint32_t>(tree.size())));
        tree.remove(i);
        list.remove(i);
      }
      if (step % 37 == 0) {
        const Vector a = support::uniform(random, n, 1, -0.1, 1.1).col(0);
        check_same(tree, list, a, random.uniform(0.0, 0.6), 5);
      }
    }
    for (int i = 0; i < tree.size(); ++i)
      CHECK((tree.point(i) - list.points[static_cast<std::size_t>(i)]).norm() < 1e-15);
    while (tree.size() > 0) {
      tree.remove(tree.size() / 2);
      list.remove(static_cast<int>(list.points.size()) / 2);
      if (tree.size() % 50 == 0) check_same(tree, list, Vector::Constant(n, 0.3), 0.4, 3);
    }
  }
}

TEST_CASE("k-d tree: points that coincide, and ties, are told apart by their numbers") {
  KdTree tree(2);
  List list{Vector::Ones(2), {}};
  for (int i = 0; i < 200; ++i) {
    // A grid of 9 places, each many times over.
    Vector a(2);
    a << i % 3, i / 3 % 3;
    tree.insert(a);
    list.points.push_back(a);
  }
  for (const double x : {0.0, 0.5, 1.0, 3.0}) {
    check_same(tree, list, Vector::Constant(2, x), 1.0, 40);
    check_same(tree, list, Vector::Constant(2, x), std::sqrt(2.0), 7);
  }
}

TEST_CASE("k-d tree: points that single precision cannot tell apart are found all the same") {
  for (const double scale : {1e-30, 1e-9, 1e-3, 1e6}) {
    CAPTURE(scale);
    RandomStream random(5);
    KdTree tree(3);
    List list{Vector::Ones(3), {}};
    const Vector corner = Vector::Constant(3, 1e4 * scale);
    for (int i = 0; i < 400; ++i) {
      const Vector a = corner + scale * 3e-3 * support::uniform(random, 3, 1).col(0);
      tree.insert(a);
      list.points.push_back(a);
    }
    for (int i = 0; i < 20; ++i) {
      const Vector a = corner + scale * 3e-3 * support::uniform(random, 3, 1).col(0);
      check_same(tree, list, a, scale * 3e-3 * random.uniform(0.05, 0.5), 5);
    }
  }
}

TEST_CASE("k-d tree: a search stops when it is told to, and a radius of nothing finds nothing") {
  RandomStream random(4);
  KdTree tree(3);
  for (int i = 0; i < 300; ++i) tree.insert(support::uniform(random, 3, 1).col(0));
  int calls = 0;
  tree.for_each_within(Vector::Constant(3, 0.5), 10.0, [&](int, double) { return ++calls < 5; });
  CHECK(calls == 5);
  calls = 0;
  tree.for_each_within(tree.point(7), 0.0, [&](int, double) { return ++calls > 0; });
  CHECK(calls == 0);
  CHECK(tree.nearest(Vector::Zero(3), {}) == 0);
}

TEST_CASE("k-d tree: what does not fit is refused") {
  CHECK(fails_with([] { KdTree(0); }, "1 to 32 dimensions"));
  CHECK(fails_with([] { KdTree(33); }, "got 33"));
  CHECK(fails_with([] { KdTree(2, Vector::Ones(3)); }, "unit"));
  CHECK(fails_with([] { KdTree(2, Vector::Zero(2)); }, "above 0"));
  KdTree tree(2);
  CHECK(fails_with([&] { tree.insert(Vector::Ones(3)); }, "2 finite numbers"));
  CHECK(fails_with([&] { tree.insert(Vector::Constant(2, std::numeric_limits<double>::quiet_NaN())); }, "finite"));
  CHECK(fails_with([&] { tree.insert(Vector::Constant(2, -1e18)); }, "below 1e18 units"));
  CHECK(tree.size() == 0);
}
