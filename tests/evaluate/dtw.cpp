// SPDX-License-Identifier: MIT
#include <traceur/evaluate/dtw.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/random.hpp>

namespace {

using namespace traceur;
using core::RandomStream;
using evaluate::Dtw;
using evaluate::Envelope;
using evaluate::FramePair;
using evaluate::no_band;

template <class T>
using Matrix = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;

template <class T>
Matrix<T> noise(RandomStream& random, int features, int frames) {
  Matrix<T> m(features, frames);
  for (Eigen::Index k = 0; k < m.size(); ++k) m.data()[k] = static_cast<T>(random.normal());
  return m;
}

/// A walk: neighbouring frames are alike, as in motions.
template <class T>
Matrix<T> walk(RandomStream& random, int features, int frames) {
  Matrix<T> m = noise<T>(random, features, frames);
  for (Eigen::Index t = 1; t < m.cols(); ++t) m.col(t) = m.col(t - 1) + T(0.3) * m.col(t);
  return m;
}

/// The definition, in O(T T').
template <class T>
double definition(const Matrix<T>& a, const Matrix<T>& b, int band = no_band) {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  Eigen::MatrixXd d = Eigen::MatrixXd::Constant(a.cols() + 1, b.cols() + 1, infinity);
  d(0, 0) = 0;
  for (Eigen::Index i = 0; i < a.cols(); ++i)
    for (Eigen::Index j = 0; j < b.cols(); ++j)
      if (std::abs(i - j) <= band)
        d(i + 1, j + 1) =
            (a.col(i) - b.col(j)).template cast<double>().norm() + std::min({d(i, j), d(i, j + 1), d(i + 1, j)});
  return d(a.cols(), b.cols());
}

/// All paths, one by one.
template <class T>
double exhaustive(const Matrix<T>& a, const Matrix<T>& b, Eigen::Index i = 0, Eigen::Index j = 0) {
  const double here = static_cast<double>((a.col(i) - b.col(j)).norm());
  if (i + 1 == a.cols() && j + 1 == b.cols()) return here;
  double best = std::numeric_limits<double>::infinity();
  if (i + 1 < a.cols()) best = std::min(best, exhaustive(a, b, i + 1, j));
  if (j + 1 < b.cols()) best = std::min(best, exhaustive(a, b, i, j + 1));
  if (i + 1 < a.cols() && j + 1 < b.cols()) best = std::min(best, exhaustive(a, b, i + 1, j + 1));
  return here + best;
}

template <class T>
void check_definition() {
  RandomStream random(61);
  const double close = sizeof(T) == 4 ? 1e-5 : 1e-12;
  Dtw<T> dtw;
  std::vector<FramePair> path;
  for (int trial = 0; trial < 400; ++trial) {
    const int features = 1 + static_cast<int>(random.below(9));
    const int n = 1 + static_cast<int>(random.below(trial % 4 == 0 ? 80 : 20)),
              m = 1 + static_cast<int>(random.below(70));
    const Matrix<T> a = walk<T>(random, features, n), b = walk<T>(random, features, m);
    CHECK(static_cast<double>(dtw.distance(a, b)) == doctest::Approx(definition(a, b)).epsilon(close));
    const int band = static_cast<int>(random.below(40));
    const double banded = definition(a, b, band);
    const double found = static_cast<double>(dtw.distance(a, b, band));
    const double aligned = static_cast<double>(dtw.align(a, b, path, band));
    if (std::isinf(banded)) {
      CHECK(std::abs(n - m) > band);
      CHECK(std::isinf(found));
      CHECK(std::isinf(aligned));
      CHECK(path.empty());
    } else {
      CHECK(found == doctest::Approx(banded).epsilon(close));
      CHECK(aligned == doctest::Approx(banded).epsilon(close));
    }
  }
}

}  // namespace

TEST_CASE("dtw: the definition, with a band and without, float and double, lengths that fill no register") {
  check_definition<double>();
  check_definition<float>();
}

TEST_CASE("dtw: the least over all paths") {
  RandomStream random(62);
  Dtw<double> dtw;
  for (int n = 1; n <= 6; ++n)
    for (int m = 1; m <= 6; ++m) {
      const Matrix<double> a = noise<double>(random, 2, n), b = noise<double>(random, 2, m);
      CHECK(dtw.distance(a, b) == doctest::Approx(exhaustive(a, b)));
    }
}

TEST_CASE("dtw: the path is one, and costs what it says") {
  RandomStream random(63);
  Dtw<double> dtw;
  std::vector<FramePair> path;
  for (int trial = 0; trial < 100; ++trial) {
    const int n = 1 + static_cast<int>(random.below(40)), m = 1 + static_cast<int>(random.below(40));
    const Matrix<double> a = walk<double>(random, 3, n), b = walk<double>(random, 3, m);
    const int band = trial % 2 == 0 ? no_band : 40;
    const double total = dtw.align(a, b, path, band);
    CHECK(path.front().a == 0);
    CHECK(path.front().b == 0);
    CHECK(path.back().a == n - 1);
    CHECK(path.back().b == m - 1);
    double sum = 0;
    for (std::size_t k = 0; k < path.size(); ++k) {
      sum += (a.col(path[k].a) - b.col(path[k].b)).norm();
      if (k == 0) continue;
      const int da = path[k].a - path[k - 1].a, db = path[k].b - path[k - 1].b;
      CHECK((da == 0 || da == 1));
      CHECK((db == 0 || db == 1));
      CHECK(da + db > 0);
    }
    CHECK(sum == doctest::Approx(total));
  }
}

TEST_CASE("dtw: a band that covers all is none; a narrower one never helps") {
  RandomStream random(64);
  Dtw<double> dtw;
  for (int trial = 0; trial < 60; ++trial) {
    const int n = 1 + static_cast<int>(random.below(50)), m = 1 + static_cast<int>(random.below(50));
    const Matrix<double> a = walk<double>(random, 4, n), b = walk<double>(random, 4, m);
    const double exact = dtw.distance(a, b);
    CHECK(dtw.distance(a, b, std::max(n, m) - 1) == exact);
    CHECK(dtw.distance(a, b, 1000000) == exact);
    double wider = std::numeric_limits<double>::infinity();
    for (int band = 0; band < std::max(n, m); ++band) {
      const double d = dtw.distance(a, b, band);
      CHECK(d <= wider);
      CHECK(d >= exact);
      wider = d;
    }
  }
}

TEST_CASE("dtw: symmetric, zero exactly for a motion and itself at another pace") {
  RandomStream random(65);
  Dtw<float> dtw;
  for (int trial = 0; trial < 40; ++trial) {
    // Large numbers, so that distances by products would not be zero.
    Matrix<float> a = walk<float>(random, 30, 25);
    a.array() += 1000.0f;
    const Matrix<float> b = walk<float>(random, 30, 40);
    CHECK(dtw.distance(a, b) == dtw.distance(b, a));
    CHECK(dtw.distance(a, a) == 0);
    Matrix<float> slow(30, 75);
    for (int t = 0; t < 75; ++t) slow.col(t) = a.col(t / 3);
    CHECK(dtw.distance(a, slow) == 0);
    CHECK(dtw.distance(a, slow, 50) == 0);
    CHECK(dtw.distance(a, slow, 49) == std::numeric_limits<float>::infinity());
    // In step the distance is at most that frame by frame.
    const Matrix<float> c = b.leftCols(25);
    CHECK(dtw.distance(a, c) <= (a - c).colwise().norm().sum() * 1.00001f);
    CHECK(dtw.distance(a, c, 0) == doctest::Approx((a - c).colwise().norm().sum()).epsilon(1e-5));
  }
}

TEST_CASE("dtw: a cutoff spares work, and changes nothing that is below it") {
  RandomStream random(66);
  Dtw<double> dtw;
  constexpr double infinity = std::numeric_limits<double>::infinity();
  for (int trial = 0; trial < 100; ++trial) {
    const Matrix<double> a = walk<double>(random, 4, 60), b = walk<double>(random, 4, 55);
    const double d = dtw.distance(a, b);
    CHECK(dtw.distance(a, b, no_band, d) == d);
    CHECK(dtw.distance(a, b, no_band, 1.5 * d) == d);
    CHECK(dtw.distance(a, b, no_band, 0.999 * d) == infinity);
    CHECK(dtw.distance(a, b, no_band, 0.1 * d) == infinity);
  }
}

TEST_CASE("dtw: parts of larger matrices, and memory that was used before") {
  RandomStream random(67);
  const Matrix<double> large = walk<double>(random, 12, 200);
  const Matrix<double> a = large.block(2, 10, 7, 33), b = large.block(2, 90, 7, 51);
  Dtw<double> fresh, used(10, 2);
  used.distance(walk<double>(random, 12, 300), walk<double>(random, 12, 150), 160);
  CHECK(used.distance(large.block(2, 10, 7, 33), large.block(2, 90, 7, 51)) == fresh.distance(a, b));
}

TEST_CASE("envelope: extremes of every window") {
  RandomStream random(68);
  for (const int n : {1, 2, 5, 16, 37})
    for (const int w : {0, 1, 3, 8, 50, no_band}) {
      const Matrix<double> b = noise<double>(random, 3, n);
      const Envelope<double> e(b, w);
      for (int j = 0; j < n; ++j) {
        const int from = w >= j ? 0 : j - w, to = w >= n - 1 - j ? n - 1 : j + w;
        CHECK(e.lower.col(j) == b.middleCols(from, to - from + 1).rowwise().minCoeff());
        CHECK(e.upper.col(j) == b.middleCols(from, to - from + 1).rowwise().maxCoeff());
      }
    }
}

TEST_CASE("bounds: at most the distance, whatever lengths and band; worth something for motions") {
  RandomStream random(69);
  Dtw<double> dtw;
  double kim = 0, keogh = 0, truth = 0;
  for (int trial = 0; trial < 600; ++trial) {
    const int n = 1 + static_cast<int>(random.below(40));
    const int m = trial % 3 == 0 ? n : 1 + static_cast<int>(random.below(40));
    Matrix<double> a = walk<double>(random, 3, n);
    const Matrix<double> b = walk<double>(random, 3, m);
    if (trial % 4 == 1) a.array() += 3;
    const int band = trial % 5 == 0 ? no_band : static_cast<int>(random.below(20));
    const double d = dtw.distance(a, b, band), slack = 1 + 1e-12;
    const double by_ends = evaluate::kim_bound<double>(a, b),
                 by_boxes = evaluate::keogh_bound(a, Envelope<double>(b, band));
    CHECK(by_ends <= d * slack);
    CHECK(by_boxes <= d * slack);
    CHECK(evaluate::keogh_bound(b, Envelope<double>(a, band)) <= d * slack);
    if (std::isinf(d)) {
      CHECK(std::isinf(by_boxes));
    } else {
      kim += by_ends;
      keogh += by_boxes;
      truth += d;
    }
  }
  CHECK(kim > 0.05 * truth);
  CHECK(keogh > 0.3 * truth);
  // With a band of nothing and equal lengths LB_Keogh is the distance.
  const Matrix<double> a = walk<double>(random, 3, 20), b = walk<double>(random, 3, 20);
  CHECK(evaluate::keogh_bound(a, Envelope<double>(b, 0)) == doctest::Approx(dtw.distance(a, b, 0)));
  // LB_Kim is the distance of sequences that are nothing but ends.
  const Matrix<double> one = a.leftCols(1), other = b.leftCols(1);
  CHECK(evaluate::kim_bound<double>(one, other) == doctest::Approx(dtw.distance(one, other)));
}

TEST_CASE("dtw: numbers that are none never look like a distance") {
  RandomStream random(70);
  Dtw<double> dtw;
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()})
    for (const int frame : {0, 7, 29})
      for (const bool first : {true, false}) {
        Matrix<double> a = walk<double>(random, 3, 30), b = walk<double>(random, 3, 22);
        (first ? a : b)(1, std::min(frame, first ? 29 : 21)) = bad;
        CHECK(!std::isfinite(dtw.distance(a, b)));
        CHECK(!std::isfinite(dtw.distance(b, a, 20)));
      }
}

TEST_CASE("dtw: sequences that do not fit are refused") {
  const auto message = [](const auto& f) {
    try {
      f();
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  Dtw<double> dtw;
  const Matrix<double> a = Matrix<double>::Zero(3, 4), b = Matrix<double>::Zero(2, 4), none(3, 0);
  CHECK(message([&] { dtw.distance(a, b); }) ==
        "dynamic time warping: expected as many features in both sequences, found 3 and 2");
  CHECK(message([&] { dtw.distance(a, none); }) ==
        "dynamic time warping: expected at least one frame in each sequence");
  CHECK(message([&] { Envelope<double>(none, 1); }) == "envelope: expected at least one frame");
  CHECK(message([&] { Envelope<double>(a, -1); }) == "envelope: expected a band of zero or more");
}
