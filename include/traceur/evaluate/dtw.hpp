// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <limits>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "traceur/core/error.hpp"
#include "traceur/core/pack.hpp"

namespace traceur::evaluate {

/// A sequence of feature vectors, features x frames.
template <class T>
using Sequence = Eigen::Ref<const Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>>;

/// A band that holds every pair of frames.
inline constexpr int no_band = std::numeric_limits<int>::max();

namespace detail {

/// The lanes of a pack moved up by one, with `first` in lane 0.
template <class T, int N, std::size_t... I>
[[gnu::always_inline]] inline core::Pack<T, N> shifted(const core::Pack<T, N>& x, T first, std::index_sequence<I...>) {
  return core::Pack<T, N>(typename core::Pack<T, N>::Vector(
      __builtin_shufflevector(x.v, core::Pack<T, N>(first).v, N, static_cast<int>(I)...)));
}
template <class T, int N>
[[gnu::always_inline]] inline core::Pack<T, N> shifted(const core::Pack<T, N>& x, T first) {
  return shifted(x, first, std::make_index_sequence<N - 1>{});
}

inline void require_sequences(Eigen::Index fa, Eigen::Index ta, Eigen::Index fb, Eigen::Index tb, const char* what) {
  if (fa != fb)
    throw Error(std::string(what) + ": expected as many features in both sequences, found " + std::to_string(fa) +
                " and " + std::to_string(fb));
  if (ta == 0 || tb == 0) throw Error(std::string(what) + ": expected at least one frame in each sequence");
}

template <class A, class B>
inline auto frame_distance(const A& a, const B& b) {
  return (a - b).norm();
}

}  // namespace detail

/// A pair of frames that an alignment puts together.
struct FramePair {
  int a, b;
};

/// Dynamic time warping (Mueller 2007; HIL C.3): the least sum of Euclidean distances between frames of two sequences
/// along a path of pairs (i, j) that begins at the first frames, ends at the last and goes on by (1, 0), (0, 1) or (1,
/// 1),
///
///     D(i, j) = |a_i - b_j| + min(D(i - 1, j), D(i, j - 1), D(i - 1, j - 1)).
///
/// The sum is over the whole path and not divided by anything. A band w admits pairs with |i - j| <= w only (Sakoe and
/// Chiba 1978); no path remains, and the distance is infinite, where the lengths differ by more. Features are compared
/// as they are: scale them to a common unit first.
///
/// The object is memory that one call leaves to the next, so one per thread; a call allocates only for sequences larger
/// than any before. `T`: `float` or `double`.
///
/// How it is fast. A strip of as many frames of `a` as a register has lanes is compared with the frames of `b` one
/// after the other; the differences are squared as they are, where products |a|^2 + |b|^2 - 2ab would lose the distance
/// of similar frames to rounding. Along the recursion lane l then works on column s - l at step s: its upper neighbour
/// is what the lane before it found one step ago, and its diagonal one is what it took for its upper one a step ago.
///
///     step       s         s+1       s+2
///     lane 0   D(0,s)    D(0,s+1)   ...
///     lane 1   D(1,s-1)  D(1,s)     ...      D(1,s) wants D(0,s), D(0,s-1), D(1,s-1)
template <std::floating_point T = double>
class Dtw {
public:
  /// Memory for sequences of up to so many frames and features; none is fine.
  explicit Dtw(int frames = 0, int features = 0) { reserve(frames, features); }

  /// The distance; infinite as soon as it is sure to be above `cutoff`. Throws Error if the sequences have no frames or
  /// not the same features. A number that is not finite makes the distance infinite or NaN, never a finite one.
  T distance(const Sequence<T>& a, const Sequence<T>& b, int band = no_band, T cutoff = infinity) {
    detail::require_sequences(a.rows(), a.cols(), b.rows(), b.cols(), "dynamic time warping");
    // The longer sequence along the strips: fewer lanes are filled in vain.
    return a.cols() >= b.cols() ? strips(b, a, band, cutoff) : strips(a, b, band, cutoff);
  }

  /// The same by the definition, with the path of least cost in `path`, first pair first; empty where no path exists.
  /// Of equal ways it takes the diagonal one. Needs memory for every pair of frames.
  T align(const Sequence<T>& a, const Sequence<T>& b, std::vector<FramePair>& path, int band = no_band) {
    detail::require_sequences(a.rows(), a.cols(), b.rows(), b.cols(), "dynamic time warping");
    path.clear();
    const auto n = static_cast<int>(a.cols()), m = static_cast<int>(b.cols());
    table_.assign(static_cast<std::size_t>(n + 1) * static_cast<std::size_t>(m + 1), infinity);
    const auto at = [&](int i, int j) -> T& {
      return table_[static_cast<std::size_t>(i) * static_cast<std::size_t>(m + 1) + static_cast<std::size_t>(j)];
    };
    at(0, 0) = 0;
    for (int i = 1; i <= n; ++i)
      for (int j = first_column(i, band); j <= last_column(i, m, band); ++j)
        at(i, j) = detail::frame_distance(a.col(i - 1), b.col(j - 1)) +
                   std::min({at(i - 1, j - 1), at(i - 1, j), at(i, j - 1)});
    const T total = at(n, m);
    if (!(total < infinity)) return total;
    int i = n, j = m;
    while (i > 0 && j > 0) {
      path.push_back({i - 1, j - 1});
      const T diagonal = at(i - 1, j - 1), up = at(i - 1, j), left = at(i, j - 1);
      if (diagonal <= up && diagonal <= left) {
        --i;
        --j;
      } else if (up <= left) {
        --i;
      } else {
        --j;
      }
    }
    std::reverse(path.begin(), path.end());
    return total;
  }

private:
  using P = core::Pack<T>;
  static constexpr int lanes = P::width;
  static_assert(lanes > 1);
  static constexpr T infinity = std::numeric_limits<T>::infinity();

  static int first_column(int i, int band) { return band < i ? i - band : 1; }
  static int last_column(int i, int m, int band) { return band < m - i ? i + band : m; }

  void reserve(int frames, int features) {
    const auto grow = [](std::vector<T>& v, std::size_t n) {
      if (v.size() < n) v.resize(n);
    };
    const auto l = static_cast<std::size_t>(lanes);
    grow(strip_, l * static_cast<std::size_t>(std::max(features, 1)));
    grow(skewed_, l * (static_cast<std::size_t>(frames) + l));
    grow(above_, static_cast<std::size_t>(frames) + 1);
  }

  // a is the shorter sequence; its frames are the rows.
  T strips(const Sequence<T>& a, const Sequence<T>& b, int band, T cutoff) {
    const auto n = static_cast<int>(a.cols()), m = static_cast<int>(b.cols()), features = static_cast<int>(a.rows());
    if (band < 0 || m - n > band) return infinity;
    reserve(m, features);
    // above_[j + 1] is D of the last row of the strip before at column j; entry 0 is the way into the first pair.
    std::fill(above_.begin(), above_.begin() + m + 1, infinity);
    above_[0] = 0;
    for (int first = 0; first < n; first += lanes) {
      const int rows = std::min(lanes, n - first);
      load_strip(a, first, rows, features);
      const int j0 = band < first ? first - band : 0;
      const int j1 = band < m - first - rows ? first + rows - 1 + band : m - 1;
      skew_distances(b, features, j0, j1, first, band);
      const T least = recur(j0, j1, rows, first + rows == n);
      if (first + rows == n) return least <= cutoff || !(least == least) ? least : infinity;
      if (least > cutoff) return infinity;
      if (first == 0) above_[0] = infinity;
    }
    return infinity;
  }

  // Feature k of the strip's frames is entries lanes k ... lanes (k + 1). Lanes beyond the last frame repeat it:
  // nothing flows back from them.
  void load_strip(const Sequence<T>& a, int first, int rows, int features) {
    for (int l = 0; l < lanes; ++l) {
      const auto column = a.col(first + std::min(l, rows - 1));
      for (int k = 0; k < features; ++k) strip_[static_cast<std::size_t>(lanes * k + l)] = column[k];
    }
  }

  // skewed_[lanes s + l] = |a_(first + l) - b_(j0 + s - l)|, infinite outside the columns and the band.
  void skew_distances(const Sequence<T>& b, int features, int j0, int j1, int first, int band) {
    const int columns = j1 - j0 + 1;
    T* const skewed = skewed_.data();
    for (int s = 0; s < lanes - 1; ++s)
      for (int l = 0; l < lanes; ++l) {
        if (l > s) skewed[lanes * s + l] = infinity;
        if (l <= s) skewed[lanes * (columns + s) + l] = infinity;
      }
    constexpr int block = 8;
    int c = 0;
    for (; c + block <= columns; c += block) distances(b, features, j0 + c, c, std::make_index_sequence<block>{});
    for (; c < columns; ++c) distances(b, features, j0 + c, c, std::make_index_sequence<1>{});
    if (band == no_band) return;
    for (int l = 0; l < lanes; ++l)
      for (int j = j0; j <= j1; ++j)
        if (std::abs(first + l - j) > band) skewed[lanes * (j - j0 + l) + l] = infinity;
  }

  // From the strip's frames to frames j, j + 1, ... of b. The sums are named one by one, so that they stay in
  // registers.
  template <std::size_t... Q>
  void distances(const Sequence<T>& b, int features, int j, int c, std::index_sequence<Q...>) {
    const T* const first = b.data() + static_cast<std::ptrdiff_t>(j) * b.outerStride();
    const T* const frame[] = {first + static_cast<std::ptrdiff_t>(Q) * b.outerStride()...};
    P sum[] = {(static_cast<void>(Q), P(0))...};
    const T* const strip = strip_.data();
    for (int k = 0; k < features; ++k) {
      const P mine = P::load(strip + static_cast<std::ptrdiff_t>(lanes) * k);
      // A number less a vector, without making a pack of the number: that would cost as much again.
      (add_square(sum[Q], P(typename P::Vector(mine.v - frame[Q][k]))), ...);
    }
    (scatter(sqrt(sum[Q]), skewed_.data() + static_cast<std::ptrdiff_t>(lanes) * (c + static_cast<int>(Q))), ...);
  }
  [[gnu::always_inline]] static void add_square(P& sum, const P& d) { sum += d * d; }
  [[gnu::always_inline]] static void scatter(const P& x, T* to) {
    T lane[lanes];
    x.store(lane);
    for (int l = 0; l < lanes; ++l) to[(lanes + 1) * l] = lane[l];
  }

  // Runs the recursion through the strip; returns D at its last pair if it is the last strip, else the least of its
  // last row, which no path can avoid.
  T recur(int j0, int j1, int rows, bool last) {
    const int columns = j1 - j0 + 1;
    P value(infinity), up = shifted_in(value, above_[static_cast<std::size_t>(j0)]);
    T least = infinity;
    for (int s = 0; s < columns + rows - 1; ++s) {
      const P diagonal = up;
      up = shifted_in(value, s < columns ? above_[static_cast<std::size_t>(j0 + s + 1)] : infinity);
      // A NaN may be dropped here, but a frame that has one makes a whole row or column NaN, which no path gets past.
      const P best = core::min(core::min(diagonal, up), value);
      value = P::load(skewed_.data() + static_cast<std::ptrdiff_t>(lanes) * s) + best;
      const int j = s - (rows - 1);
      if (j >= 0) {
        const T reached = value[rows - 1];
        above_[static_cast<std::size_t>(j0 + j + 1)] = reached;
        least = last ? reached : std::min(least, reached);
      }
    }
    return least;
  }
  static P shifted_in(const P& x, T first) { return detail::shifted(x, first); }

  std::vector<T> strip_, skewed_, above_, table_;
};

/// For every frame, the least and the greatest value of each feature within w frames of it: what `keogh_bound` compares
/// a sequence with (Keogh 2002). Features x frames.
template <std::floating_point T = double>
struct Envelope {
  using Matrix = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;
  Matrix lower, upper;
  int band = no_band;

  Envelope() = default;
  /// Throws Error on a sequence without frames or a negative band.
  Envelope(const Sequence<T>& b, int w) : band(w) {
    if (b.cols() == 0) throw Error("envelope: expected at least one frame");
    if (w < 0) throw Error("envelope: expected a band of zero or more");
    lower = running_least(b, w);
    upper = -running_least(-b, w);
  }

private:
  // Van Herk's: the least of a window from those of prefixes and suffixes of blocks as long as a window.
  static Matrix running_least(const Matrix& b, int w) {
    const Eigen::Index n = b.cols(), half = std::min<Eigen::Index>(w, n), length = 2 * half + 1;
    Matrix prefix = b, suffix = b, out(b.rows(), n);
    for (Eigen::Index j = 1; j < n; ++j)
      if (j % length != 0) prefix.col(j) = prefix.col(j).cwiseMin(prefix.col(j - 1));
    for (Eigen::Index j = n - 2; j >= 0; --j)
      if ((j + 1) % length != 0) suffix.col(j) = suffix.col(j).cwiseMin(suffix.col(j + 1));
    for (Eigen::Index j = 0; j < n; ++j) {
      const Eigen::Index from = std::max<Eigen::Index>(j - half, 0), to = std::min(j + half, n - 1);
      // A window cut short at an end may lie within one block; then one of the two runs holds all of it.
      if (from / length != to / length) {
        out.col(j) = suffix.col(from).cwiseMin(prefix.col(to));
      } else if (from % length == 0) {
        out.col(j) = prefix.col(to);
      } else {
        out.col(j) = suffix.col(from);
      }
    }
    return out;
  }
};

/// LB_Keogh: every frame of `a` is matched with some frame of `b` within the band, which is no nearer than the box that
/// the envelope of `b` puts around them. At most the banded distance of the two, whatever their lengths; infinite where
/// no path exists. Throws Error if `a` has other features.
template <std::floating_point T>
inline T keogh_bound(const Sequence<std::type_identity_t<T>>& a, const Envelope<T>& b) {
  detail::require_sequences(a.rows(), a.cols(), b.lower.rows(), b.lower.cols(), "LB_Keogh");
  const Eigen::Index n = a.cols(), m = b.lower.cols();
  if ((n > m ? n - m : m - n) > b.band) return std::numeric_limits<T>::infinity();
  T sum = 0;
  for (Eigen::Index i = 0; i < n; ++i) {
    // Beyond the end of b the window of the last frame holds all that is within the band, and more.
    const Eigen::Index j = std::min(i, m - 1);
    sum += (a.col(i) - a.col(i).cwiseMax(b.lower.col(j)).cwiseMin(b.upper.col(j))).norm();
  }
  return sum;
}

/// LB_Kim, for sums along the path (Kim, Park and Chu 2001, in the form that looks at ends only): every path holds the
/// first pair and the last, and one of three pairs next to each. At most the distance of the two sequences, banded or
/// not.
template <std::floating_point T>
inline T kim_bound(const Sequence<T>& a, const Sequence<T>& b) {
  detail::require_sequences(a.rows(), a.cols(), b.rows(), b.cols(), "LB_Kim");
  const Eigen::Index n = a.cols(), m = b.cols();
  const auto d = [&](Eigen::Index i, Eigen::Index j) { return detail::frame_distance(a.col(i), b.col(j)); };
  T sum = d(0, 0);
  if (n == 1 && m == 1) return sum;
  sum += d(n - 1, m - 1);
  // Pairs next to the ends are pairs of their own where one sequence at least has four frames.
  if (std::min(n, m) < 2 || std::max(n, m) < 4) return sum;
  sum += std::min({d(0, 1), d(1, 0), d(1, 1)});
  sum += std::min({d(n - 1, m - 2), d(n - 2, m - 1), d(n - 2, m - 2)});
  return sum;
}

}  // namespace traceur::evaluate
