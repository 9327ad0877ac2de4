// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <istream>
#include <limits>
#include <ostream>
#include <string>
#include <type_traits>
#include <vector>

#include <Eigen/Core>

#include <traceur/core/detail/tiles.hpp>
#include <traceur/core/error.hpp>
#include <traceur/core/hex_words.hpp>
#include <traceur/core/pack.hpp>
#include <traceur/core/random.hpp>

namespace traceur::optimize {

/// What the search distribution can learn. `full`: any Gaussian; per generation O(n^2 population), and O(n^3) whenever
/// the basis is renewed. `diagonal`: one variance per coordinate, O(n population), learnt (n + 2) / 3 times as fast;
/// for separable problems and for n in the hundreds (Ros and Hansen, "A Simple Modification in CMA-ES Achieving Linear
/// Time and Space Complexity", PPSN 2008).
enum class Covariance { full, diagonal };

enum class StopReason {
  none,             ///< still running
  target_cost,      ///< a candidate reached `target_cost`
  max_generations,  ///< the budget of generations is used up
  max_evaluations,  ///< another generation would exceed the budget of evaluations
  not_judged,       ///< no candidate had a finite cost for `max_failures` generations in a row
  tolerance_cost,   ///< costs have become the same
  tolerance_x,      ///< the steps have become too short
  condition,        ///< the covariance has become too ill-conditioned to go on
  divergence,       ///< the steps grow without end: no minimum, or `sigma` was far too small
  no_effect         ///< the steps are too short to change the mean in floating point
};

/// The reason's name as it is spelt in the enumeration.
inline const char* name(StopReason reason) noexcept {
  constexpr const char* names[] = {"none",           "target_cost", "max_generations", "max_evaluations", "not_judged",
                                   "tolerance_cost", "tolerance_x", "condition",       "divergence",      "no_effect"};
  return names[static_cast<std::size_t>(reason)];
}

struct CmaEsParameters {
  /// Candidates per generation, lambda >= 2; 0 for 4 + floor(3 ln n). More for noisy or multimodal costs.
  int population = 0;
  /// Initial standard deviation, > 0, in units of `scale`. About a third of the distance the optimum may be away.
  double sigma = 0.3;
  /// Unit of each coordinate, > 0 (n numbers, or none for all 1): what makes an angle comparable to a time.
  Eigen::VectorXd scale;
  Covariance covariance = Covariance::full;
  /// Whether the worst candidates lower the variance along their steps (negative weights).
  bool active = true;
  /// Every candidate lies in [lower, upper] (n numbers, or none). Single bounds may be infinite.
  Eigen::VectorXd lower, upper;
  std::uint64_t seed = 0;
  /// Budgets over all restarts; 0 for none.
  std::int64_t max_generations = 0;
  std::int64_t max_evaluations = 0;
  /// Stops once a cost is at or below this.
  double target_cost = -std::numeric_limits<double>::infinity();
  /// Stops when the costs of a generation and the best ones of the last 10 + ceil(30 n / lambda) differ by less than
  /// this. 0 for never.
  double tolerance_cost = 1e-12;
  /// Stops when every standard deviation is below this multiple of the initial one. 0 for never.
  double tolerance_x = 1e-12;
  /// Stops when the condition number of the covariance exceeds this.
  double max_condition = 1e14;
  /// Stops when a standard deviation exceeds this multiple of the initial one.
  double max_growth = 1e4;
  /// Stops after so many generations in a row without a finite cost.
  int max_failures = 10;
  /// How often to start again, from the initial mean and sigma, with `population_growth` times the population, after a
  /// stop that is not a target or a budget (Auger and Hansen, "A Restart CMA Evolution Strategy With Increasing
  /// Population Size", CEC 2005).
  int restarts = 0;
  int population_growth = 2;
};

/// The constants of the strategy: Hansen, "The CMA Evolution Strategy: A Tutorial", arXiv:1604.00772 (2016), table 1.
struct CmaEsConstants {
  int parents = 0;          ///< mu, the number of positive weights
  Eigen::VectorXd weights;  ///< w, by rank; the positive ones sum to 1
  double mu_eff = 0.0;      ///< variance effective selection mass of the positive weights, eq. 8
  double c_sigma = 0.0;     ///< learning rate of the path of the step size, eq. 55
  double d_sigma = 0.0;     ///< damping of the step size, eq. 55
  double c_c = 0.0;         ///< learning rate of the path of the covariance, eq. 56
  double c_1 = 0.0;         ///< learning rate of the rank-one update, eq. 57
  double c_mu = 0.0;        ///< learning rate of the rank-mu update, eq. 58
  double norm = 0.0;        ///< expected length of a standard normal vector
  int renewal = 1;          ///< generations between two eigen-decompositions, appendix B.2
};

/// For dimension n >= 1 and population >= 2. A diagonal covariance has n instead of n (n + 1) / 2 degrees of freedom,
/// so both learning rates of the covariance are (n + 2) / 3 times those of a full one (Ros and Hansen 2008, section 3).
inline CmaEsConstants cma_es_constants(int dimension, int population, Covariance covariance, bool active) {
  CmaEsConstants k;
  const double n = dimension;
  k.parents = population / 2;
  k.weights.resize(population);
  for (int i = 0; i < population; ++i) k.weights(i) = std::log(0.5 * (population + 1)) - std::log(i + 1.0);
  auto positive = k.weights.head(k.parents);
  auto negative = k.weights.tail(population - k.parents);
  k.mu_eff = positive.sum() * positive.sum() / positive.squaredNorm();
  const double mu_eff_negative = negative.sum() * negative.sum() / negative.squaredNorm();

  k.c_sigma = (k.mu_eff + 2.0) / (n + k.mu_eff + 5.0);
  k.d_sigma = 1.0 + 2.0 * std::max(0.0, std::sqrt((k.mu_eff - 1.0) / (n + 1.0)) - 1.0) + k.c_sigma;
  k.c_c = (4.0 + k.mu_eff / n) / (n + 4.0 + 2.0 * k.mu_eff / n);
  const double speed = covariance == Covariance::diagonal ? (n + 2.0) / 3.0 : 1.0;
  k.c_1 = std::min(1.0, speed * 2.0 / ((n + 1.3) * (n + 1.3) + k.mu_eff));
  k.c_mu = std::min(1.0 - k.c_1,
                    speed * 2.0 * (0.25 + k.mu_eff + 1.0 / k.mu_eff - 2.0) / ((n + 2.0) * (n + 2.0) + k.mu_eff));

  positive /= positive.sum();
  if (active && k.c_mu > 0.0) {
    // Eqs. 50 to 53: the last bound keeps the covariance positive definite.
    const double sum = std::min(
        {1.0 + k.c_1 / k.c_mu, 1.0 + 2.0 * mu_eff_negative / (k.mu_eff + 2.0), (1.0 - k.c_1 - k.c_mu) / (n * k.c_mu)});
    negative *= sum / -negative.sum();
  } else {
    negative.setZero();
  }
  k.norm = std::sqrt(n) * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n));
  k.renewal = static_cast<int>(std::clamp(std::floor(1.0 / (10.0 * n * (k.c_1 + k.c_mu))), 1.0, 1e6));
  return k;
}

namespace detail {

/// Each of `Columns` columns x, `stride` apart, becomes x - beta v (v . x). All are `size` long.
template <int Columns>
inline void reflect(const double* v, double beta, double* x, Eigen::Index stride, Eigen::Index size) noexcept {
  using P = core::Pack<double>;
  P sum[Columns];
  double product[Columns] = {};
  for (P& s : sum) s = P(0.0);
  Eigen::Index i = 0;
  for (; i + P::width <= size; i += P::width) {
    const P w = P::load(v + i);
    for (int j = 0; j < Columns; ++j) sum[j] += w * P::load(x + j * stride + i);
  }
  for (; i < size; ++i) {
    for (int j = 0; j < Columns; ++j) product[j] += v[i] * x[j * stride + i];
  }
  for (int j = 0; j < Columns; ++j) {
    for (int l = 0; l < P::width; ++l) product[j] += sum[j][l];
    product[j] *= beta;
  }
  for (i = 0; i + P::width <= size; i += P::width) {
    const P w = P::load(v + i);
    for (int j = 0; j < Columns; ++j) (P::load(x + j * stride + i) - P(product[j]) * w).store(x + j * stride + i);
  }
  for (; i < size; ++i) {
    for (int j = 0; j < Columns; ++j) x[j * stride + i] -= product[j] * v[i];
  }
}

/// A rotation of two neighbouring columns: (x, y) <- (c x + s y, c y - s x).
struct Rotation {
  double c, s;
};

inline void rotate(const Rotation& r, double* x, double* y, Eigen::Index size) noexcept {
  using P = core::Pack<double>;
  const P c(r.c), s(r.s);
  Eigen::Index i = 0;
  for (; i + P::width <= size; i += P::width) {
    const P a = P::load(x + i), b = P::load(y + i);
    (c * a + s * b).store(x + i);
    (c * b - s * a).store(y + i);
  }
  for (; i < size; ++i) {
    const double a = x[i], b = y[i];
    x[i] = r.c * a + r.s * b;
    y[i] = r.c * b - r.s * a;
  }
}

/// Rotations of columns (first, first + 1), (first + 1, first + 2) and so on.
struct Sweep {
  Eigen::Index first, count;
};

/// All `sweeps`, whose rotations follow each other in memory, on an n by n matrix: by blocks of rows that stay in the
/// nearest cache for all of them.
inline void rotate(const Sweep* sweeps, int count, const Rotation* rotations, double* matrix, Eigen::Index n) noexcept {
  using P = core::Pack<double>;
  constexpr Eigen::Index registers = 2, block = registers * P::width;
  for (Eigen::Index row = 0; row < n; row += block) {
    const Rotation* r = rotations;
    const Eigen::Index rows = std::min(block, n - row);
    const bool whole = rows == block;
    for (int k = 0; k < count; ++k) {
      double* column = matrix + row + sweeps[k].first * n;
      const Rotation* const end = r + sweeps[k].count;
      if (whole) {
        P x[registers];
        for (Eigen::Index i = 0; i < registers; ++i) x[i] = P::load(column + i * P::width);
        for (; r != end; ++r, column += n) {
          const P c(r->c), s(r->s);
          for (Eigen::Index i = 0; i < registers; ++i) {
            const P y = P::load(column + n + i * P::width);
            (c * x[i] + s * y).store(column + i * P::width);
            x[i] = c * y - s * x[i];
          }
        }
        for (Eigen::Index i = 0; i < registers; ++i) x[i].store(column + i * P::width);
      } else {
        for (; r != end; ++r, column += n) rotate(*r, column, column + n, rows);
      }
    }
  }
}

/// Sweeps that are put together where the memory is given for them.
inline constexpr Eigen::Index sweeps_together = 16;

/// How much work memory makes the decomposition of an n by n matrix fastest.
inline Eigen::Index symmetric_eigen_work(Eigen::Index n) noexcept {
  return n < 160 ? 2 * n : 2 * n * (1 + sweeps_together);
}

/// Eigenvalues (`values`, n, in no order) and orthonormal eigenvectors (columns of `vectors`, n by n) of the symmetric
/// matrix whose lower triangle is in `a` (n by n, overwritten). `work` holds 2 n numbers at least. Householder
/// tridiagonalisation and implicit symmetric QR steps with Wilkinson's shift: Golub and Van Loan, "Matrix
/// Computations", sections 8.3.1 to 8.3.3. Written here because Eigen's solver allocates and takes ten seconds to
/// compile. Returns false if it does not converge, as with numbers that are not finite.
///
/// A rotation waits for the one before, so what counts is the way from one to the next. It is kept in squares: with x
/// and z what is rotated, only x^2, z^2 and x z over x^2 + z^2 enter the next x; the root, for the vectors, is taken
/// beside.
inline bool symmetric_eigen(Eigen::MatrixXd& a, Eigen::MatrixXd& vectors, Eigen::VectorXd& values,
                            Eigen::VectorXd& work) noexcept {
  const Eigen::Index n = a.rows();
  auto off = work.head(n);
  auto update = work.segment(n, n);

  // Column k below the diagonal ends up holding the k-th reflector, I - values(k) v v^T.
  for (Eigen::Index k = 0; k + 1 < n; ++k) {
    const Eigen::Index m = n - k - 1;
    auto v = a.col(k).tail(m);
    const double rest = v.tail(m - 1).norm();
    const double head = v(0);
    if (rest == 0.0) {
      off(k) = head;
      values(k) = 0.0;
      continue;
    }
    const double length = -std::copysign(std::hypot(head, rest), head);
    const double beta = (length - head) / length;
    v.tail(m - 1) /= head - length;
    v(0) = 1.0;
    off(k) = length;
    values(k) = beta;
    auto rows = a.bottomRightCorner(m, m);
    auto p = update.head(m);
    p.noalias() = rows.template selfadjointView<Eigen::Lower>() * v;
    p *= beta;
    p -= (0.5 * beta * p.dot(v)) * v;
    for (Eigen::Index j = 0; j < m; ++j) {
      rows.col(j).tail(m - j) -= v(j) * p.tail(m - j) + p(j) * v.tail(m - j);
    }
  }
  off(n - 1) = 0.0;

  // Few columns at a time, so that they stay in the nearest cache; reflector k leaves columns up to k as they are.
  vectors.setIdentity();
  constexpr int together = 4;
  for (Eigen::Index j = 1; j < n; j += together) {
    const Eigen::Index columns = std::min<Eigen::Index>(together, n - j);
    for (Eigen::Index k = j + columns - 2; k >= 0; --k) {
      if (values(k) == 0.0) continue;
      const double* v = a.data() + k + 1 + k * n;
      double* x = vectors.data() + k + 1 + j * n;
      if (columns == together) {
        reflect<together>(v, values(k), x, n, n - k - 1);
      } else {
        for (Eigen::Index c = 0; c < columns; ++c) reflect<1>(v, values(k), x + c * n, n, n - k - 1);
      }
    }
  }
  values = a.diagonal();

  // In squares, numbers must not leave the range of doubles.
  double largest = 0.0;
  for (Eigen::Index i = 0; i < n; ++i) largest = std::max({largest, std::abs(values(i)), std::abs(off(i))});
  if (!std::isfinite(values.sum() + off.sum())) return false;
  const double scale =
      largest > 1e60 || (largest > 0.0 && largest < 1e-60) ? std::ldexp(1.0, -std::ilogb(largest)) : 1.0;
  values *= scale;
  off *= scale;

  Sweep sweeps[sweeps_together];
  Rotation* const rotations = reinterpret_cast<Rotation*>(work.data() + 2 * n);
  const bool later = work.size() >= 2 * n * (1 + sweeps_together);
  int kept = 0;
  Eigen::Index used = 0;
  const double epsilon = std::numeric_limits<double>::epsilon();
  for (Eigen::Index last = n - 1, steps = 0; last > 0;) {
    const auto negligible = [&](Eigen::Index i) {
      return std::abs(off(i)) <= epsilon * (std::abs(values(i)) + std::abs(values(i + 1)));
    };
    if (negligible(last - 1)) {
      off(--last) = 0.0;
      steps = 0;
      continue;
    }
    if (++steps > 60) return false;
    Eigen::Index first = last - 1;
    while (first > 0 && !negligible(first - 1)) --first;

    const double half_gap = 0.5 * (values(last - 1) - values(last));
    const double e = off(last - 1);
    double x = values(first) - values(last) + e * (e / (half_gap + std::copysign(std::hypot(half_gap, e), half_gap)));
    double z = off(first), z_squared = z * z, upper = values(first);
    if (later) sweeps[kept++] = {first, last - first};
    for (Eigen::Index k = first; k < last; ++k) {
      const double x_squared = x * x, square = x_squared + z_squared;
      const bool turns = square > 0.0;
      const double inverse = turns ? 1.0 / square : 0.0, length = std::sqrt(square);
      const double cc = turns ? x_squared * inverse : 1.0, ss = z_squared * inverse, cs = (x * z) * inverse;
      const double over = turns ? 1.0 / length : 0.0;
      const Rotation r{turns ? x * over : 1.0, z * over};
      if (k > first) off(k - 1) = length;
      const double lower = values(k + 1), between = off(k);
      const double mixed = 2.0 * cs * between;
      values(k) = cc * upper + mixed + ss * lower;
      x = cs * (lower - upper) + (cc - ss) * between;
      upper = ss * upper - mixed + cc * lower;
      off(k) = x;
      if (k + 1 < last) {
        const double next = off(k + 1);
        z_squared = ss * (next * next);
        z = r.s * next;
        off(k + 1) = r.c * next;
      }
      if (later) {
        rotations[used++] = r;
      } else {
        rotate(r, vectors.data() + k * n, vectors.data() + (k + 1) * n, n);
      }
    }
    values(last) = upper;
    if (kept == sweeps_together) {
      rotate(sweeps, kept, rotations, vectors.data(), n);
      kept = 0;
      used = 0;
    }
  }
  rotate(sweeps, kept, rotations, vectors.data(), n);
  values /= scale;
  return values.allFinite();
}

/// A smooth map of the real line onto [lower, upper]: the identity but for a margin of width `margin` inside each
/// finite bound, where a parabola that is flat at the bound replaces it, and mirrored beyond:
///
///      upper ........_.-'''-._............
///                 .-'         '-.            slope 1 between the margins, 0 at the bounds
///     -.       .-'               '-.
///       '-._.-'.......................... lower
///
/// An optimum at a bound thus becomes an ordinary minimum, and a search that strays beyond meets the same costs again.
inline double to_box(double v, double lower, double upper, double margin) noexcept {
  const bool above = std::isfinite(lower);
  const bool below = std::isfinite(upper);
  const double first = lower - margin;
  const double end = upper + margin;
  if (above && below && (v < first || v > end)) {
    const double width = end - first;
    double phase = std::fmod(v - first, 2.0 * width);
    if (phase < 0.0) phase += 2.0 * width;
    v = first + (phase > width ? 2.0 * width - phase : phase);
  } else if (above && v < first) {
    v = first + (first - v);
  } else if (below && v > end) {
    v = end - (v - end);
  }
  if (above && v < lower + margin) return std::clamp(lower + (v - first) * (v - first) / (4.0 * margin), lower, upper);
  if (below && v > upper - margin) return std::clamp(upper - (end - v) * (end - v) / (4.0 * margin), lower, upper);
  return v;
}

/// The v in [lower - margin, upper + margin] that `to_box` maps to `x` in [lower, upper].
inline double from_box(double x, double lower, double upper, double margin) noexcept {
  if (x < lower + margin) return lower - margin + 2.0 * std::sqrt(margin * (x - lower));
  if (x > upper - margin) return upper + margin - 2.0 * std::sqrt(margin * (upper - x));
  return x;
}

/// Writes fields as lines `name count words...`, each word the 64 bits of a number.
class StateWriter {
public:
  explicit StateWriter(std::ostream& out) : out_(out) {}

  template <class T>
  void scalar(const char* field, const T& value) {
    begin(field, 1);
    if constexpr (std::is_same_v<T, double>) {
      out_.word(std::bit_cast<std::uint64_t>(value));
    } else {
      out_.word(static_cast<std::uint64_t>(static_cast<std::int64_t>(value)));
    }
    out_.end_line();
  }
  template <class T>
  void choice(const char* field, const T& value, int) {
    scalar(field, static_cast<int>(value));
  }
  void array(const char* field, const Eigen::Ref<const Eigen::MatrixXd>& values) {
    begin(field, static_cast<std::uint64_t>(values.size()));
    for (Eigen::Index j = 0; j < values.cols(); ++j) {
      for (Eigen::Index i = 0; i < values.rows(); ++i) out_.word(std::bit_cast<std::uint64_t>(values(i, j)));
    }
    out_.end_line();
  }
  void vector(const char* field, const Eigen::VectorXd& values) { array(field, values); }

private:
  void begin(const char* field, std::uint64_t count) {
    out_.name(field);
    out_.word(count);
  }

  core::HexWordWriter out_;
};

/// Reads what StateWriter wrote. Throws Error that names the field.
class StateReader {
public:
  explicit StateReader(std::istream& in) : in_(in, where) {}

  template <class T>
  void scalar(const char* field, T& value) {
    begin(field, 1);
    const std::uint64_t bits = in_.word(field);
    if constexpr (std::is_same_v<T, double>) {
      value = std::bit_cast<double>(bits);
    } else if constexpr (std::is_same_v<T, std::uint64_t>) {
      value = bits;
    } else {
      const auto number = static_cast<std::int64_t>(bits);
      if (number < std::numeric_limits<T>::min() || number > std::numeric_limits<T>::max()) {
        fail(field, "the integer " + std::to_string(number) + " is out of range");
      }
      value = static_cast<T>(number);
    }
  }
  /// For bool and enumerations with values 0 to count - 1.
  template <class T>
  void choice(const char* field, T& value, int count) {
    int number = 0;
    scalar(field, number);
    if (number < 0 || number >= count) {
      fail(field, "expected 0 to " + std::to_string(count - 1) + ", got " + std::to_string(number));
    }
    value = static_cast<T>(number);
  }
  /// As many numbers as `values` has room for.
  void array(const char* field, Eigen::Ref<Eigen::MatrixXd> values) {
    begin(field, static_cast<std::uint64_t>(values.size()));
    for (Eigen::Index j = 0; j < values.cols(); ++j) {
      for (Eigen::Index i = 0; i < values.rows(); ++i) values(i, j) = std::bit_cast<double>(in_.word(field));
    }
  }
  /// However many numbers the stream has.
  void vector(const char* field, Eigen::VectorXd& values) {
    expect(field);
    std::vector<double> numbers;
    for (std::uint64_t left = in_.word(field); left > 0; --left) {
      numbers.push_back(std::bit_cast<double>(in_.word(field)));
    }
    values = Eigen::Map<const Eigen::VectorXd>(numbers.data(), static_cast<Eigen::Index>(numbers.size()));
  }
  /// The word that must come next.
  void expect(const char* text) { in_.expect(text); }
  [[noreturn]] static void fail(const std::string& field, const std::string& what) {
    throw Error(std::string(where) + ": field '" + field + "': " + what);
  }

private:
  static constexpr const char* where = "CmaEs: load";

  void begin(const char* field, std::uint64_t count) {
    expect(field);
    const std::uint64_t found = in_.word(field);
    if (found != count) fail(field, "expected " + std::to_string(count) + " numbers, got " + std::to_string(found));
  }

  core::HexWordReader in_;
};

}  // namespace detail

/// CMA-ES, the evolution strategy with covariance matrix adaptation, for costs R^n -> R without derivatives: Hansen,
/// "The CMA Evolution Strategy: A Tutorial", arXiv:1604.00772 (2016), figure 6 and eqs. 38 to 47, with the active
/// update. Only the order of the costs matters.
///
/// In each generation, candidates x_k = m + sigma y_k, y_k ~ N(0, C), are asked for, judged by the user, and told:
///
///     while (!cma.finished()) {
///       const Eigen::MatrixXd& x = cma.ask();
///       for (Eigen::Index k = 0; k < x.cols(); ++k) costs(k) = cost(x.col(k));
///       cma.tell(costs);
///     }
///
/// The normal numbers behind candidate k of generation g are those of RandomStream(seed, k, g), so a run depends on
/// nothing but its parameters and costs. The search itself takes place in coordinates divided by `scale`; with bounds,
/// `detail::to_box` maps its points into the box, with margins of one initial standard deviation, at most a quarter of
/// the box.
///
/// Once constructed, `ask` and `tell` allocate no memory, except in the generation before a restart.
class CmaEs {
public:
  /// Throws Error that names the parameter.
  CmaEs(const Eigen::Ref<const Eigen::VectorXd>& initial_mean, const CmaEsParameters& parameters)
      : parameters_(parameters), initial_mean_(initial_mean) {
    check_parameters();
    const Eigen::Index n = dimension();
    if (parameters_.population == 0) {
      parameters_.population = 4 + static_cast<int>(3.0 * std::log(static_cast<double>(n)));
    }
    if (parameters_.scale.size() == 0) parameters_.scale.setOnes(n);
    const double infinity = std::numeric_limits<double>::infinity();
    if (parameters_.lower.size() == 0) parameters_.lower.setConstant(n, -infinity);
    if (parameters_.upper.size() == 0) parameters_.upper.setConstant(n, infinity);
    margin_ = (parameters_.sigma * parameters_.scale).cwiseMin(0.25 * (parameters_.upper - parameters_.lower));
    start_.resize(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      start_(i) = detail::from_box(initial_mean_(i), parameters_.lower(i), parameters_.upper(i), margin_(i)) /
                  parameters_.scale(i);
    }

    const bool full = parameters_.covariance == Covariance::full;
    covariance_.resize(n, full ? n : 1);
    basis_.resize(full ? n : 0, full ? n : 0);
    if (full) {
      decomposed_.resize(n, n);
      eigenvectors_.resize(n, n);
      eigenvalues_.resize(n);
      work_.resize(detail::symmetric_eigen_work(n));
    }
    lengths_.resize(n);
    path_sigma_.resize(n);
    path_.resize(n);
    best_ = initial_mean_;
    vector_.resize(n);
    whitened_.resize(n);
    mean_step_.resize(n);
    mean_.resize(n);
    shown_mean_.resize(n);
    resize_population();
    begin_run();
  }

  /// The candidates of this generation, n by population, one per column. The same ones until `tell`. Throws Error if
  /// the search has stopped.
  const Eigen::MatrixXd& ask() {
    if (finished()) throw Error(std::string("CmaEs: ask after the search stopped: ") + name(stop_reason_));
    if (asked_) return candidates_;
    for (Eigen::Index k = 0; k < candidates_.cols(); ++k) {
      core::RandomStream random(parameters_.seed, static_cast<std::uint64_t>(k),
                                static_cast<std::uint64_t>(generation_));
      auto z = normals_.col(k);
      for (Eigen::Index i = 0; i < z.size(); ++i) z(i) = random.normal();
      candidates_.col(k) = lengths_.cwiseProduct(z);
    }
    if (parameters_.covariance == Covariance::full) {
      turn(candidates_, steps_);
    } else {
      steps_ = candidates_;
    }
    for (Eigen::Index k = 0; k < candidates_.cols(); ++k) {
      vector_ = mean_ + sigma_ * steps_.col(k);
      show(vector_, candidates_.col(k));
    }
    asked_ = true;
    return candidates_;
  }

  /// Takes the costs of the candidates last asked for, in their order. Costs that are not finite, of whatever sign,
  /// rank below all others; among equals the earlier candidate ranks higher. A generation without any finite cost says
  /// nothing: it counts as a generation, but the distribution stays. Throws Error without a preceding `ask`, or if the
  /// number of costs is not that of the candidates.
  void tell(const Eigen::Ref<const Eigen::VectorXd>& costs) {
    if (!asked_) throw Error("CmaEs: tell without a preceding ask");
    if (costs.size() != population()) {
      throw Error("CmaEs: tell: expected " + std::to_string(population()) + " costs, got " +
                  std::to_string(costs.size()));
    }
    asked_ = false;
    ++generation_;
    evaluations_ += costs.size();
    for (Eigen::Index k = 0; k < costs.size(); ++k) {
      ranked_[static_cast<std::size_t>(k)] = {
          std::isfinite(costs(k)) ? costs(k) : std::numeric_limits<double>::infinity(), k};
    }
    std::sort(ranked_.begin(), ranked_.end(), [](const Ranked& a, const Ranked& b) {
      return a.cost != b.cost ? a.cost < b.cost : a.candidate < b.candidate;
    });
    if (!std::isfinite(ranked_.front().cost)) {
      ++failures_;
    } else {
      failures_ = 0;
      if (ranked_.front().cost < best_cost_) {
        best_cost_ = ranked_.front().cost;
        best_ = candidates_.col(ranked_.front().candidate);
      }
      update();
    }
    stop_reason_ = judge();
    if (stop_reason_ > StopReason::not_judged && restart_ < parameters_.restarts) {
      ++restart_;
      stop_reason_ = StopReason::none;
      resize_population();
      begin_run();
      stop_reason_ = budget();
    }
  }

  bool finished() const noexcept { return stop_reason_ != StopReason::none; }
  StopReason stop_reason() const noexcept { return stop_reason_; }

  /// The centre of the search (n), within the bounds. With noisy costs a better answer than `best`: judge it anew.
  const Eigen::VectorXd& mean() const noexcept { return shown_mean_; }
  /// The candidate with the lowest cost so far (n) and that cost; the initial mean and infinity before any finite cost.
  const Eigen::VectorXd& best() const noexcept { return best_; }
  double best_cost() const noexcept { return best_cost_; }
  /// Overall step size.
  double sigma() const noexcept { return sigma_; }
  /// Standard deviation of each coordinate (n), before bounds.
  Eigen::VectorXd deviations() const {
    Eigen::VectorXd result(dimension());
    for (Eigen::Index i = 0; i < dimension(); ++i) result(i) = sigma_ * parameters_.scale(i) * std::sqrt(variance(i));
    return result;
  }
  /// Ratio of the largest to the smallest eigenvalue of C.
  double condition() const noexcept {
    const double ratio = lengths_.maxCoeff() / lengths_.minCoeff();
    return ratio * ratio;
  }
  /// Generations told, candidates told and restarts made so far.
  std::int64_t generation() const noexcept { return generation_; }
  std::int64_t evaluations() const noexcept { return evaluations_; }
  int restart() const noexcept { return restart_; }

  Eigen::Index dimension() const noexcept { return initial_mean_.size(); }
  /// Candidates in this generation; grows with restarts.
  int population() const noexcept { return static_cast<int>(candidates_.cols()); }
  /// As given to the constructor, with the defaults that depend on n filled in.
  const CmaEsParameters& parameters() const noexcept { return parameters_; }
  const CmaEsConstants& constants() const noexcept { return constants_; }

  /// Writes the whole state as text, to the bit. Throws Error if the stream fails.
  void save(std::ostream& out) const {
    out << format << '\n';
    detail::StateWriter writer(out);
    writer.vector("initial_mean", initial_mean_);
    visit_parameters(writer, parameters_);
    writer.scalar("restart", restart_);
    visit_state(writer, *this);
    out << "end\n";
    if (!out.flush()) throw Error("CmaEs: save: the stream failed");
  }

  /// Continues what `save` wrote, to the same bits. Throws Error that names the field that is missing, misshapen or out
  /// of range.
  static CmaEs load(std::istream& in) {
    detail::StateReader reader(in);
    reader.expect(format);
    Eigen::VectorXd initial_mean;
    reader.vector("initial_mean", initial_mean);
    CmaEsParameters parameters;
    visit_parameters(reader, parameters);
    CmaEs cma(initial_mean, parameters);
    reader.scalar("restart", cma.restart_);
    if (cma.restart_ < 0 || cma.restart_ > parameters.restarts) reader.fail("restart", "more restarts than allowed");
    cma.resize_population();
    visit_state(reader, cma);
    reader.expect("end");
    cma.check_state();
    cma.show(cma.mean_, cma.shown_mean_);
    if (cma.asked_) {
      cma.asked_ = false;
      cma.ask();
    }
    return cma;
  }

private:
  static constexpr const char* format = "traceur.cma_es.1";
  static constexpr double population_limit = 1e6;

  struct Ranked {
    double cost;
    Eigen::Index candidate;
  };

  template <class Archive, class Parameters>
  static void visit_parameters(Archive& archive, Parameters& p) {
    archive.scalar("population", p.population);
    archive.scalar("initial_sigma", p.sigma);
    archive.vector("scale", p.scale);
    archive.choice("covariance", p.covariance, 2);
    archive.choice("active", p.active, 2);
    archive.vector("lower", p.lower);
    archive.vector("upper", p.upper);
    archive.scalar("seed", p.seed);
    archive.scalar("max_generations", p.max_generations);
    archive.scalar("max_evaluations", p.max_evaluations);
    archive.scalar("target_cost", p.target_cost);
    archive.scalar("tolerance_cost", p.tolerance_cost);
    archive.scalar("tolerance_x", p.tolerance_x);
    archive.scalar("max_condition", p.max_condition);
    archive.scalar("max_growth", p.max_growth);
    archive.scalar("max_failures", p.max_failures);
    archive.scalar("restarts", p.restarts);
    archive.scalar("population_growth", p.population_growth);
  }

  template <class Archive, class Self>
  static void visit_state(Archive& archive, Self& s) {
    archive.scalar("generation", s.generation_);
    archive.scalar("run_generation", s.run_generation_);
    archive.scalar("decomposed_at", s.decomposed_at_);
    archive.scalar("evaluations", s.evaluations_);
    archive.scalar("failures", s.failures_);
    archive.choice("asked", s.asked_, 2);
    archive.choice("stop_reason", s.stop_reason_, static_cast<int>(StopReason::no_effect) + 1);
    archive.scalar("sigma", s.sigma_);
    archive.array("mean", s.mean_);
    archive.array("path_sigma", s.path_sigma_);
    archive.array("path", s.path_);
    archive.array("covariance", s.covariance_);
    archive.array("basis", s.basis_);
    archive.array("lengths", s.lengths_);
    archive.array("best", s.best_);
    archive.scalar("best_cost", s.best_cost_);
    archive.scalar("recorded", s.recorded_);
    archive.array("history", s.history_);
  }

  void check_parameters() const {
    const CmaEsParameters& p = parameters_;
    const Eigen::Index n = dimension();
    const auto require = [](bool holds, const char* field, const std::string& expected) {
      if (!holds) throw Error(std::string("CmaEs: ") + field + ": expected " + expected);
    };
    const auto length = [&](const char* field, const Eigen::VectorXd& values) {
      require(values.size() == 0 || values.size() == n, field,
              "none or " + std::to_string(n) + " numbers, got " + std::to_string(values.size()));
    };
    const auto number = [](double value) { return "got " + std::to_string(value); };
    const auto integer = [](auto value) { return "got " + std::to_string(value); };
    require(n > 0 && initial_mean_.allFinite(), "initial_mean", "one or more finite numbers");
    require(p.population == 0 || (p.population >= 2 && p.population <= population_limit), "population",
            "0 (default) or 2 to 1000000, " + integer(p.population));
    require(std::isfinite(p.sigma) && p.sigma > 0.0, "sigma", "a finite number above 0, " + number(p.sigma));
    length("scale", p.scale);
    require(p.scale.size() == 0 || (p.scale.allFinite() && p.scale.minCoeff() > 0.0), "scale",
            "finite numbers above 0");
    length("lower", p.lower);
    length("upper", p.upper);
    for (Eigen::Index i = 0; i < n; ++i) {
      const double lower = p.lower.size() > 0 ? p.lower(i) : -std::numeric_limits<double>::infinity();
      const double upper = p.upper.size() > 0 ? p.upper(i) : std::numeric_limits<double>::infinity();
      const std::string where =
          " in coordinate " + std::to_string(i) + ", got " + std::to_string(lower) + " and " + std::to_string(upper);
      require(lower < upper && lower < std::numeric_limits<double>::infinity() &&
                  upper > -std::numeric_limits<double>::infinity(),
              "lower", "less than upper" + where);
      require(lower <= initial_mean_(i) && initial_mean_(i) <= upper, "initial_mean",
              "between the bounds" + where + " around " + std::to_string(initial_mean_(i)));
    }
    require(p.max_generations >= 0, "max_generations", "0 (no limit) or more, " + integer(p.max_generations));
    require(p.max_evaluations >= 0, "max_evaluations", "0 (no limit) or more, " + integer(p.max_evaluations));
    require(!std::isnan(p.target_cost), "target_cost", "a number");
    require(p.tolerance_cost >= 0.0, "tolerance_cost", "0 (never) or more, " + number(p.tolerance_cost));
    require(p.tolerance_x >= 0.0, "tolerance_x", "0 (never) or more, " + number(p.tolerance_x));
    require(p.max_condition > 1.0 && p.max_condition <= 1e15, "max_condition",
            "above 1 and at most 1e15, " + number(p.max_condition));
    require(p.max_growth > 1.0, "max_growth", "above 1, " + number(p.max_growth));
    require(p.max_failures >= 1, "max_failures", "1 or more, " + integer(p.max_failures));
    require(p.restarts >= 0, "restarts", "0 or more, " + integer(p.restarts));
    require(p.population_growth >= 1, "population_growth", "1 or more, " + integer(p.population_growth));
    const double largest = std::max(p.population, 4) * std::pow(p.population_growth, p.restarts);
    require(largest <= population_limit, "restarts", "a last population of at most 1000000, " + integer(p.restarts));
  }

  void check_state() const {
    const auto require = [](bool holds, const char* field, const char* expected) {
      if (!holds) detail::StateReader::fail(field, std::string("expected ") + expected);
    };
    require(run_generation_ >= 0 && run_generation_ <= generation_, "run_generation", "0 to generation");
    require(decomposed_at_ >= 0 && decomposed_at_ <= run_generation_, "decomposed_at", "0 to run_generation");
    require(evaluations_ >= generation_, "evaluations", "at least one per generation");
    require(failures_ >= 0, "failures", "0 or more");
    require(!(asked_ && finished()), "asked", "0 after a stop");
    require(std::isfinite(sigma_) && sigma_ > 0.0, "sigma", "a finite number above 0");
    require(mean_.allFinite(), "mean", "finite numbers");
    require(path_sigma_.allFinite(), "path_sigma", "finite numbers");
    require(path_.allFinite(), "path", "finite numbers");
    require(covariance_.allFinite(), "covariance", "finite numbers");
    for (Eigen::Index i = 0; i < dimension(); ++i) require(variance(i) > 0.0, "covariance", "variances above 0");
    require(lengths_.allFinite() && lengths_.minCoeff() > 0.0, "lengths", "finite numbers above 0");
    require(basis_.allFinite(), "basis", "finite numbers");
    for (Eigen::Index j = 0; j < basis_.cols(); ++j) {
      for (Eigen::Index i = 0; i <= j; ++i) {
        const double product = basis_.col(i).dot(basis_.col(j));
        require(std::abs(product - (i == j ? 1.0 : 0.0)) < 1e-8, "basis", "orthonormal columns");
      }
    }
    require(best_.allFinite(), "best", "finite numbers");
    require(!std::isnan(best_cost_) && best_cost_ > -std::numeric_limits<double>::infinity(), "best_cost", "a cost");
    require(recorded_ >= 0 && recorded_ <= run_generation_, "recorded", "0 to run_generation");
    require(history_.allFinite(), "history", "finite numbers");
  }

  void resize_population() {
    double size = parameters_.population;
    for (int i = 0; i < restart_; ++i) size *= parameters_.population_growth;
    const int population = static_cast<int>(size);
    const Eigen::Index n = dimension();
    constants_ = cma_es_constants(static_cast<int>(n), population, parameters_.covariance, parameters_.active);
    normals_.resize(n, population);
    steps_.resize(n, population);
    candidates_.resize(n, population);
    coefficients_.resize(population);
    scaled_.resize(population);
    ranked_.resize(static_cast<std::size_t>(population));
    history_.setZero(10 + (30 * n + population - 1) / population);
  }

  void begin_run() {
    mean_ = start_;
    show(mean_, shown_mean_);
    sigma_ = parameters_.sigma;
    path_sigma_.setZero();
    path_.setZero();
    if (parameters_.covariance == Covariance::full) {
      covariance_.setIdentity();
      basis_.setIdentity();
    } else {
      covariance_.setOnes();
    }
    lengths_.setOnes();
    run_generation_ = 0;
    decomposed_at_ = 0;
    decomposition_failed_ = false;
    recorded_ = 0;
    history_.setZero();
  }

  double variance(Eigen::Index i) const noexcept {
    return covariance_(i, parameters_.covariance == Covariance::full ? i : 0);
  }

  // to = B from, without the memory that Eigen's product of two matrices would take.
  void turn(const Eigen::MatrixXd& from, Eigen::MatrixXd& to) const noexcept {
    const Eigen::Index n = dimension();
    if (n < core::detail::lanes<double>) {
      for (Eigen::Index k = 0; k < from.cols(); ++k) to.col(k).noalias() = basis_ * from.col(k);
    } else {
      core::detail::multiply_panels<double>(n, from.cols(), n, basis_.data(), n, {from.data(), 1, n}, {nullptr, 0},
                                            to.data(), n);
    }
  }

  // From the coordinates of the search to those of the user.
  void show(const Eigen::VectorXd& u, Eigen::Ref<Eigen::VectorXd> x) const noexcept {
    for (Eigen::Index i = 0; i < u.size(); ++i) {
      x(i) = detail::to_box(u(i) * parameters_.scale(i), parameters_.lower(i), parameters_.upper(i), margin_(i));
    }
  }

  void update() {
    const CmaEsConstants& k = constants_;
    const bool full = parameters_.covariance == Covariance::full;
    const Eigen::Index n = dimension();
    ++run_generation_;

    mean_step_.setZero();
    vector_.setZero();
    for (Eigen::Index i = 0; i < k.parents; ++i) {
      const Eigen::Index candidate = ranked_[static_cast<std::size_t>(i)].candidate;
      mean_step_ += k.weights(i) * steps_.col(candidate);
      vector_ += k.weights(i) * normals_.col(candidate);
    }
    mean_ += sigma_ * mean_step_;
    show(mean_, shown_mean_);

    // C^(-1/2) y = B z, since y = B D z.
    if (full) {
      whitened_.noalias() = basis_ * vector_;
    } else {
      whitened_ = vector_;
    }
    path_sigma_ = (1.0 - k.c_sigma) * path_sigma_ + std::sqrt(k.c_sigma * (2.0 - k.c_sigma) * k.mu_eff) * whitened_;
    const double path_length = path_sigma_.norm();
    const double settled = 1.0 - std::pow(1.0 - k.c_sigma, 2.0 * static_cast<double>(run_generation_));
    const bool steady = path_length / std::sqrt(settled) < (1.4 + 2.0 / (static_cast<double>(n) + 1.0)) * k.norm;
    path_ *= 1.0 - k.c_c;
    if (steady) path_ += std::sqrt(k.c_c * (2.0 - k.c_c) * k.mu_eff) * mean_step_;

    for (Eigen::Index i = 0; i < k.weights.size(); ++i) {
      const Eigen::Index candidate = ranked_[static_cast<std::size_t>(i)].candidate;
      double weight = k.c_mu * k.weights(i);
      if (weight < 0.0) {
        const double squared = std::max(normals_.col(candidate).squaredNorm(), std::numeric_limits<double>::min());
        weight *= static_cast<double>(n) / squared;
      }
      coefficients_(candidate) = weight;
    }
    const double lost = steady ? 0.0 : k.c_1 * k.c_c * (2.0 - k.c_c);
    const double kept = 1.0 + lost - k.c_1 - k.c_mu * k.weights.sum();
    if (full) {
      for (Eigen::Index j = 0; j < n; ++j) {
        auto column = covariance_.col(j).tail(n - j);
        scaled_ = steps_.row(j).transpose().cwiseProduct(coefficients_);
        column = kept * column + (k.c_1 * path_(j)) * path_.tail(n - j);
        column.noalias() += steps_.bottomRows(n - j) * scaled_;
      }
    } else {
      auto column = covariance_.col(0);
      column = kept * column + k.c_1 * path_.cwiseAbs2();
      for (Eigen::Index candidate = 0; candidate < steps_.cols(); ++candidate) {
        column += coefficients_(candidate) * steps_.col(candidate).cwiseAbs2();
      }
    }
    // Growth by more than e in one generation would be an accident of the first few.
    sigma_ *= std::exp(std::min(1.0, (k.c_sigma / k.d_sigma) * (path_length / k.norm - 1.0)));

    if (!full) {
      lengths_ = covariance_.col(0).cwiseSqrt();
    } else if (run_generation_ - decomposed_at_ >= k.renewal) {
      decomposed_at_ = run_generation_;
      renew_basis();
    }
    history_(recorded_++ % history_.size()) = ranked_.front().cost;
  }

  // Keeps the last good basis if there is no new one; `judge` stops the run then.
  void renew_basis() {
    decomposed_ = covariance_;
    decomposition_failed_ =
        !detail::symmetric_eigen(decomposed_, eigenvectors_, eigenvalues_, work_) || !(eigenvalues_.minCoeff() > 0.0);
    if (decomposition_failed_) return;
    basis_.swap(eigenvectors_);
    lengths_ = eigenvalues_.cwiseSqrt();
  }

  StopReason budget() const noexcept {
    if (best_cost_ <= parameters_.target_cost) return StopReason::target_cost;
    if (parameters_.max_generations > 0 && generation_ >= parameters_.max_generations) {
      return StopReason::max_generations;
    }
    if (parameters_.max_evaluations > 0 && evaluations_ + population() > parameters_.max_evaluations) {
      return StopReason::max_evaluations;
    }
    return StopReason::none;
  }

  // Hansen, "Benchmarking a BI-Population CMA-ES on the BBOB-2009 Function Testbed" (2009), section 2, without the
  // stagnation test.
  StopReason judge() noexcept {
    const CmaEsParameters& p = parameters_;
    const StopReason spent = budget();
    if (spent != StopReason::none) return spent;
    if (failures_ >= p.max_failures) return StopReason::not_judged;
    if (failures_ > 0) return StopReason::none;

    const double low = std::min(history_.minCoeff(), ranked_.front().cost);
    const double high = std::max(history_.maxCoeff(), ranked_.back().cost);
    if (recorded_ >= history_.size() && high - low < p.tolerance_cost) return StopReason::tolerance_cost;

    double widest = 0.0;
    bool short_step = false;
    for (Eigen::Index i = 0; i < dimension(); ++i) {
      const double deviation = std::sqrt(variance(i));
      widest = std::max({widest, deviation, std::abs(path_(i))});
      short_step = short_step || mean_(i) == mean_(i) + 0.2 * sigma_ * deviation;
    }
    if (sigma_ * widest < p.tolerance_x * p.sigma) return StopReason::tolerance_x;
    if (decomposition_failed_ || !(condition() <= p.max_condition)) return StopReason::condition;
    if (!(sigma_ * lengths_.maxCoeff() <= p.max_growth * p.sigma)) return StopReason::divergence;
    if (short_step) return StopReason::no_effect;
    if (p.covariance == Covariance::full) {
      const Eigen::Index axis = static_cast<Eigen::Index>(run_generation_ % dimension());
      const auto step = (0.1 * sigma_ * lengths_(axis)) * basis_.col(axis);
      if (((mean_ + step).array() == mean_.array()).all()) return StopReason::no_effect;
    }
    return StopReason::none;
  }

  CmaEsParameters parameters_;
  CmaEsConstants constants_;
  Eigen::VectorXd initial_mean_;
  Eigen::VectorXd start_;
  Eigen::VectorXd margin_;

  // The search distribution, C = B diag(lengths)^2 B^T as of the last decomposition. Of a full covariance only the
  // lower triangle is kept up; a diagonal one is a column.
  Eigen::VectorXd mean_;
  double sigma_ = 0.0;
  Eigen::MatrixXd covariance_;
  Eigen::MatrixXd basis_;
  Eigen::VectorXd lengths_;
  Eigen::VectorXd path_sigma_;
  Eigen::VectorXd path_;

  std::int64_t generation_ = 0;
  std::int64_t run_generation_ = 0;
  std::int64_t decomposed_at_ = 0;
  std::int64_t evaluations_ = 0;
  std::int64_t recorded_ = 0;
  int restart_ = 0;
  int failures_ = 0;
  bool asked_ = false;
  bool decomposition_failed_ = false;
  StopReason stop_reason_ = StopReason::none;
  Eigen::VectorXd best_;
  double best_cost_ = std::numeric_limits<double>::infinity();
  Eigen::VectorXd history_;

  // Scratch of one generation.
  Eigen::MatrixXd normals_;
  Eigen::MatrixXd steps_;
  Eigen::MatrixXd candidates_;
  Eigen::MatrixXd decomposed_;
  Eigen::MatrixXd eigenvectors_;
  Eigen::VectorXd eigenvalues_;
  Eigen::VectorXd work_;
  Eigen::VectorXd vector_;
  Eigen::VectorXd whitened_;
  Eigen::VectorXd mean_step_;
  Eigen::VectorXd shown_mean_;
  Eigen::VectorXd coefficients_;
  Eigen::VectorXd scaled_;
  std::vector<Ranked> ranked_;
};

}  // namespace traceur::optimize
