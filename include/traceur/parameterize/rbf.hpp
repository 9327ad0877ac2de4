// SPDX-License-Identifier: MIT
#pragma once

#if defined(__AVX512F__)
#include <immintrin.h>
#endif

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <traceur/core/detail/tiles.hpp>
#include <traceur/core/error.hpp>
#include <traceur/core/pack.hpp>
#include <traceur/core/scalar.hpp>
#include <traceur/parameterize/detail/definite.hpp>

namespace traceur::parameterize {

/// The basis function of an `Rbf`, of the distance r. All of them grow with r, so they extrapolate better than
/// Gaussians, and none has a width to choose.
enum class Kernel {
  linear,     ///< r, the biharmonic spline of Terrain Runner; in one dimension the piecewise linear interpolant
  cubic,      ///< r^3; in one dimension the cubic spline
  thin_plate  ///< r^2 log r, the surface of least bending in two dimensions
};

struct RbfParameters {
  Kernel kernel = Kernel::linear;
  /// Degree of the polynomial p: 1 linear, 0 constant, -1 none. `cubic` and `thin_plate` need 1: with less, some sets
  /// of distinct centres have no interpolant.
  int degree = 1;
  /// The unit of each task parameter, > 0 (or none for all 1): what makes a turning angle comparable to a speed.
  /// Distances are those of parameters divided by their units.
  Eigen::VectorXd unit;
  /// Whether linear terms in directions in which the centres do not extend are left out, so that a single centre or a
  /// line of them has an interpolant. Otherwise such centres are an error.
  bool reduce = false;
};

namespace detail {

/// -1, 0 or 1: the least degree with which the interpolant exists for any distinct centres that determine the
/// polynomial.
inline int least_degree(Kernel kernel) noexcept { return kernel == Kernel::linear ? -1 : 1; }

// Plain loops where Eigen's expressions would do: each of those costs a quarter of a second of every includer's
// compile.

inline double dot(const double* a, const double* b, Eigen::Index size) noexcept {
  // By Eigen, because a compiler may not reorder a sum to vectorise it.
  return Eigen::Map<const Eigen::VectorXd>(a, size).dot(Eigen::Map<const Eigen::VectorXd>(b, size));
}

/// y += a x.
inline void add(double a, const double* x, double* y, Eigen::Index size) noexcept {
  using P = core::Pack<double>;
  const P factor(a);
  Eigen::Index i = 0;
  for (; i + P::width <= size; i += P::width) (P::load(y + i) + factor * P::load(x + i)).store(y + i);
  for (; i < size; ++i) y[i] += a * x[i];
}

/// greatest <- max(greatest, |x|), number by number; |x| where it is not a number.
inline void raise(const double* x, double* greatest, Eigen::Index size) noexcept {
  using P = core::Pack<double>;
  Eigen::Index i = 0;
  for (; i + P::width <= size; i += P::width) {
    const P value = P::load(x + i), length = select(value < P(0.0), -value, value), before = P::load(greatest + i);
    select(length <= before, before, length).store(greatest + i);
  }
  for (; i < size; ++i) greatest[i] = std::abs(x[i]) <= greatest[i] ? greatest[i] : std::abs(x[i]);
}

/// The root of each number, 0 or more; off by a unit in the last place at most. Where the processor has an estimate to
/// improve on, that takes a third of the time of its roots, which would be half the time of an evaluation.
inline core::Pack<double> root(const core::Pack<double>& x) noexcept {
#if defined(__AVX512F__)
  using P = core::Pack<double>;
  const P estimate(typename P::Vector(_mm512_rsqrt14_pd(reinterpret_cast<__m512d>(x.v))));
  const P half(0.5), inverse = estimate * (P(1.5) - half * x * estimate * estimate), first = x * inverse;
  // Of zero and what is next to it there is no inverse.
  return select(x < P(1e-290), P(0.0), first + half * inverse * (x - first * first));
#else
  return sqrt(x);
#endif
}

/// Orthonormal columns that span the columns of `points` (n by N, about their mean). Greedy: each is the direction of
/// the point farthest from the span of those before.
inline Eigen::MatrixXd affine_directions(Eigen::MatrixXd points) {
  const Eigen::Index n = points.rows();
  Eigen::MatrixXd directions(n, n);
  Eigen::Index found = 0;
  double extent = 0.0;
  for (; found < std::min(n, points.cols() - 1); ++found) {
    const double* farthest = nullptr;
    double squared = -1.0;
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      const double* point = points.data() + i * n;
      const double length = dot(point, point, n);
      if (length > squared) {
        squared = length;
        farthest = point;
      }
    }
    extent = std::max(extent, std::sqrt(squared));
    if (!(std::sqrt(squared) > 1e-8 * extent)) break;
    double* direction = directions.data() + found * n;
    std::copy_n(farthest, n, direction);
    for (Eigen::Index k = 0; k < found; ++k) {
      const double* before = directions.data() + k * n;
      add(-dot(before, direction, n), before, direction, n);
    }
    const double length = std::sqrt(dot(direction, direction, n));
    for (Eigen::Index d = 0; d < n; ++d) direction[d] /= length;
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      double* point = points.data() + i * n;
      add(-dot(direction, point, n), direction, point, n);
    }
  }
  directions.conservativeResize(n, found);
  return directions;
}

}  // namespace detail

/// The smoothest interpolant of scattered vectors, Terrain Runner Eq. 7 (after Carr et al. 2001):
///
///     f(theta) = p(theta) + sum_i lambda_i phi(|theta - theta_i|),   f(theta_i) = value_i,   sum_i lambda_i q(theta_i)
///     = 0
///
/// for every polynomial q of the degree of p. All outputs share the centres, so one factorisation serves them all.
///
/// The conditions make a symmetric, indefinite system [Phi P; P^T 0]. It is solved in the null space of P^T: with P = Q
/// R by Householder reflections, the last N - m rows and columns of Q^T Phi Q are definite (of one sign) for distinct
/// centres, so Cholesky's factorisation applies, at half the cost of an indefinite one and without pivoting.
///
/// Immutable; copies are independent.
class Rbf {
public:
  /// Task spaces have few dimensions; a bound on them keeps evaluation free of allocation.
  static constexpr Eigen::Index max_dimension = 16;

  /// Interpolates `values` (outputs by N) at the columns of `centres` (n by N), in O(N^3 / 3 + N^2 outputs). Throws
  /// Error if the sizes do not fit, a number is not finite, two centres coincide (named), the centres are too few or
  /// lie in too few dimensions for the polynomial, or the system is too ill-conditioned to be solved to 1e-6 of the
  /// largest value.
  Rbf(const Eigen::Ref<const Eigen::MatrixXd>& centres, const Eigen::Ref<const Eigen::MatrixXd>& values,
      const RbfParameters& parameters = {})
      : parameters_(parameters), centres_(centres) {
    check(values);
    const Eigen::Index n = dimension();
    inverse_unit_.resize(n);
    offset_.resize(n);
    points_.resize(size(), n);
    for (Eigen::Index d = 0; d < n; ++d) {
      inverse_unit_(d) = parameters_.unit.size() > 0 ? 1.0 / parameters_.unit(d) : 1.0;
      double sum = 0.0;
      for (Eigen::Index i = 0; i < size(); ++i) sum += centres_(d, i);
      offset_(d) = sum / static_cast<double>(size());
      for (Eigen::Index i = 0; i < size(); ++i) points_(i, d) = (centres_(d, i) - offset_(d)) * inverse_unit_(d);
    }
    weights_.setZero(values.rows(), size());
    polynomial_.setZero(values.rows(), n + 1);
    fit(values);
  }

  Eigen::Index dimension() const noexcept { return centres_.rows(); }
  Eigen::Index outputs() const noexcept { return weights_.rows(); }
  /// The number of centres, N.
  Eigen::Index size() const noexcept { return centres_.cols(); }
  /// n by N, as given.
  const Eigen::MatrixXd& centres() const noexcept { return centres_; }
  /// lambda, outputs by N.
  const Eigen::MatrixXd& weights() const noexcept { return weights_; }
  const RbfParameters& parameters() const noexcept { return parameters_; }
  /// The coefficients of p, outputs by 1 + n: the constant, then that of each task parameter.
  Eigen::MatrixXd polynomial() const {
    Eigen::MatrixXd c = polynomial_;
    for (Eigen::Index o = 0; o < outputs(); ++o) {
      for (Eigen::Index d = 0; d < dimension(); ++d) {
        c(o, d + 1) *= inverse_unit_(d);
        c(o, 0) -= c(o, d + 1) * offset_(d);
      }
    }
    return c;
  }
  /// The largest |f(theta_i) - value_i|, over the largest |value| of its output; measured, not estimated.
  double residual() const noexcept { return residual_; }

  /// f at `theta` (n) into `values` (outputs), for any scalar; allocates nothing, O(N outputs). A dual number's
  /// derivative at a centre, where r has none, is that of the other terms. `S` is named by the caller:
  /// `rbf.evaluate<float>(...)`.
  template <core::Scalar S>
  void evaluate(std::span<const S> theta, std::span<S> values) const noexcept {
    const Eigen::Index n = dimension(), outputs = this->outputs();
    std::array<S, max_dimension> x;
    for (Eigen::Index d = 0; d < n; ++d) {
      x[at(d)] = (theta[at(d)] - S(offset_(d))) * S(inverse_unit_(d));
    }
    for (Eigen::Index o = 0; o < outputs; ++o) {
      S value = S(polynomial_(o, 0));
      for (Eigen::Index d = 0; d < n; ++d) value += S(polynomial_(o, d + 1)) * x[at(d)];
      values[at(o)] = value;
    }
    for (Eigen::Index i = 0; i < size(); ++i) {
      S squared(0.0);
      for (Eigen::Index d = 0; d < n; ++d) {
        const S difference = x[at(d)] - S(points_(i, d));
        squared += difference * difference;
      }
      const S phi = basis(squared);
      const double* weight = weights_.col(i).data();
      for (Eigen::Index o = 0; o < outputs; ++o) values[at(o)] += S(weight[o]) * phi;
    }
  }

  /// f at `theta` (n). Throws Error if the size differs.
  Eigen::VectorXd operator()(const Eigen::Ref<const Eigen::VectorXd>& theta) const {
    require(theta.size() == dimension(),
            std::to_string(dimension()) + " task parameters, got " + std::to_string(theta.size()));
    Eigen::VectorXd values(outputs());
    evaluate<double>({theta.data(), at(theta.size())}, {values.data(), at(values.size())});
    return values;
  }

  /// f at every column of `thetas` (n by batch) into those of `values` (outputs by batch): the fast way for many, by
  /// blocks that stay in the cache. Throws Error if the sizes differ.
  void evaluate(const Eigen::Ref<const Eigen::MatrixXd>& thetas, Eigen::Ref<Eigen::MatrixXd> values) const {
    require(thetas.rows() == dimension() && values.rows() == outputs() && values.cols() == thetas.cols(),
            "columns of " + std::to_string(dimension()) + " task parameters and as many of " +
                std::to_string(outputs()) + " values");
    // A whole number of tiles, and little enough for the cache.
    constexpr Eigen::Index queries = 8 * core::detail::tile_columns, centres = 256;
    const Eigen::Index n = dimension(), outputs = this->outputs();
    Eigen::MatrixXd phi(std::min(centres, size()), std::min(queries, thetas.cols()));
    Eigen::MatrixXd x(n, phi.cols());
    std::vector<double> panels(at(core::detail::padded_rows<double>(outputs) * size()));
    for (Eigen::Index i = 0; i < size(); i += centres) {
      core::detail::pack_panels<double>(outputs, std::min(centres, size() - i), weights_.col(i).data(), outputs,
                                        panels.data() + core::detail::padded_rows<double>(outputs) * i);
    }
    for (Eigen::Index q = 0; q < thetas.cols(); q += queries) {
      const Eigen::Index count = std::min(queries, thetas.cols() - q);
      for (Eigen::Index j = 0; j < count; ++j) {
        double* out = values.data() + (q + j) * values.outerStride();
        std::copy_n(polynomial_.data(), outputs, out);
        for (Eigen::Index d = 0; d < n; ++d) {
          x(d, j) = (thetas(d, q + j) - offset_(d)) * inverse_unit_(d);
          detail::add(x(d, j), polynomial_.data() + (d + 1) * outputs, out, outputs);
        }
      }
      for (Eigen::Index i = 0; i < size(); i += centres) {
        const Eigen::Index rows = std::min(centres, size() - i);
        for (Eigen::Index j = 0; j < count; ++j) {
          double* column = phi.data() + j * phi.rows();
          fill_basis(i, rows, x.data() + j * n, 1, column);
        }
        double* out = values.data() + q * values.outerStride();
        core::detail::multiply_panels<double>(
            outputs, count, rows, panels.data() + core::detail::padded_rows<double>(outputs) * i, 0,
            {phi.data(), 1, phi.rows()}, {out, values.outerStride()}, out, values.outerStride());
      }
    }
  }

private:
  static std::size_t at(Eigen::Index i) noexcept { return static_cast<std::size_t>(i); }

  static void require(bool holds, const std::string& expected) {
    if (!holds) throw Error("Rbf: expected " + expected);
  }

  void check(const Eigen::Ref<const Eigen::MatrixXd>& values) const {
    const RbfParameters& p = parameters_;
    const Eigen::Index n = dimension();
    require(n >= 1 && n <= max_dimension,
            "1 to " + std::to_string(max_dimension) + " task parameters, got " + std::to_string(n));
    require(size() >= 1, "one or more centres");
    require(values.cols() == size() && values.rows() >= 1, "a column of one or more values for each of " +
                                                               std::to_string(size()) + " centres, got " +
                                                               std::to_string(values.cols()));
    for (Eigen::Index i = 0; i < size(); ++i) {
      bool finite = true;
      for (Eigen::Index d = 0; d < n; ++d) finite = finite && std::isfinite(centres_(d, i));
      for (Eigen::Index o = 0; o < values.rows(); ++o) finite = finite && std::isfinite(values(o, i));
      require(finite, "finite numbers and values in centre " + std::to_string(i));
    }
    require(p.unit.size() == 0 || (p.unit.size() == n && p.unit.allFinite() && p.unit.minCoeff() > 0.0),
            "unit: none or " + std::to_string(n) + " finite numbers above 0");
    require(p.degree >= -1 && p.degree <= 1, "degree: -1, 0 or 1, got " + std::to_string(p.degree));
    require(p.degree >= detail::least_degree(p.kernel), "degree: 1 with this kernel, got " + std::to_string(p.degree));
  }

  // phi from the squared distance. The root is taken of a positive number in any case, since that of a dual 0 has no
  // finite derivative.
  template <class S>
  S basis(const S& squared) const noexcept {
    using core::select;
    using std::log;
    using std::sqrt;
    const auto apart = S(0.0) < squared;
    const S safe = select(apart, squared, S(1.0));
    switch (parameters_.kernel) {
      case Kernel::linear:
        return select(apart, sqrt(safe), S(0.0));
      case Kernel::cubic:
        return select(apart, squared * sqrt(safe), S(0.0));
      case Kernel::thin_plate:
        return select(apart, S(0.5) * squared * log(safe), S(0.0));
    }
    return S(0.0);
  }

  // phi of the distances of centres i to i + rows from x (n numbers `stride` apart), in units.
  void fill_basis(Eigen::Index i, Eigen::Index rows, const double* x, Eigen::Index stride, double* phi) const noexcept {
    using P = core::Pack<double>;
    const auto fill = [&](auto&& of_squared) __attribute__((always_inline)) {
      for (Eigen::Index k = 0; k < rows; k += P::width) {
        const Eigen::Index count = std::min<Eigen::Index>(P::width, rows - k);
        P squared(0.0);
        for (Eigen::Index d = 0; d < dimension(); ++d) {
          const double* from = points_.data() + d * size() + i + k;
          const P difference =
              P(count == P::width ? core::detail::load<double>(from) : core::detail::load_part<double>(from, count)) -
              P(x[d * stride]);
          squared += difference * difference;
        }
        const P value = of_squared(squared);
        if (count == P::width) {
          value.store(phi + k);
        } else {
          core::detail::store_part<double>(phi + k, value.v, count);
        }
      }
    };
    switch (parameters_.kernel) {
      case Kernel::linear:
        return fill([](const P& squared) { return detail::root(squared); });
      case Kernel::cubic:
        return fill([](const P& squared) { return squared * detail::root(squared); });
      case Kernel::thin_plate: {
        fill([](const P& squared) { return squared; });
        // Eigen has a logarithm for registers.
        for (Eigen::Index k = 0; k < rows; k += max_dimension) {
          const Eigen::Index count = std::min(max_dimension, rows - k);
          std::array<double, max_dimension> root;
          Eigen::Map<Eigen::Array<double, max_dimension, 1>> logs(root.data());
          for (Eigen::Index l = 0; l < max_dimension; ++l) {
            root[at(l)] = l < count ? phi[k + l] + std::numeric_limits<double>::min() : 1.0;
          }
          logs = logs.log();
          for (Eigen::Index l = 0; l < count; ++l) phi[k + l] *= 0.5 * root[at(l)];
        }
      }
    }
  }

  /// The factorised system. With degree -1 the null space is that of the constants nevertheless, since only there r is
  /// definite; the one number left is then found by elimination.
  struct System {
    Eigen::MatrixXd v;           // N by m, Householder vectors, lower trapezoidal with a unit diagonal
    Eigen::MatrixXd t;           // m by m, upper, so that Q = I - v t v^T
    Eigen::MatrixXd r;           // m by m, upper
    Eigen::MatrixXd phi;         // N by N and some rows: lower triangle of Q^T phi Q, its last columns factorised
    Eigen::VectorXd eliminated;  // N - m, with degree -1
    double pivot = 1.0;          // with degree -1
    double sign = 1.0;           // phi holds sign times the kernel
  };

  // `block` (N by m) = Q [r; 0]; its rank is full.
  static void reflect(Eigen::MatrixXd block, System& s) {
    const Eigen::Index m = block.cols(), size = block.rows();
    s.v.setZero(size, m);
    s.t.setZero(m, m);
    s.r.setZero(m, m);
    for (Eigen::Index k = 0; k < m; ++k) {
      double* column = block.data() + k * size;
      double* v = s.v.data() + k * size;
      const double norm = std::sqrt(detail::dot(column + k, column + k, size - k));
      const double head = column[k];
      const double length = head > 0.0 ? -norm : norm;
      const double beta = (length - head) / length;
      v[k] = 1.0;
      detail::add(1.0 / (head - length), column + k + 1, v + k + 1, size - k - 1);
      for (Eigen::Index j = k + 1; j < m; ++j) {
        double* other = block.data() + j * size;
        detail::add(-beta * detail::dot(v, other, size), v, other, size);
      }
      for (Eigen::Index i = 0; i < k; ++i) {
        s.r(i, k) = column[i];
        for (Eigen::Index j = i; j < k; ++j) {
          s.t(i, k) -= beta * s.t(i, j) * detail::dot(s.v.data() + j * size, v, size);
        }
      }
      s.r(k, k) = length;
      s.t(k, k) = beta;
    }
  }

  // Each row x of `f` (any by N) becomes x Q or x Q^T.
  static void rotate(const System& s, bool transposed, Eigen::MatrixXd& f) {
    const Eigen::Index m = s.v.cols(), size = s.v.rows(), rows = f.rows();
    Eigen::MatrixXd products = Eigen::MatrixXd::Zero(rows, m), sums = products;
    for (Eigen::Index i = 0; i < size; ++i) {
      for (Eigen::Index k = 0; k < m; ++k) {
        detail::add(s.v(i, k), f.data() + i * rows, products.data() + k * rows, rows);
      }
    }
    for (Eigen::Index k = 0; k < m; ++k) {
      for (Eigen::Index i = 0; i < m; ++i) {
        detail::add(transposed ? s.t(k, i) : s.t(i, k), products.data() + i * rows, sums.data() + k * rows, rows);
      }
    }
    for (Eigen::Index i = 0; i < size; ++i) {
      for (Eigen::Index k = 0; k < m; ++k) {
        detail::add(-s.v(i, k), sums.data() + k * rows, f.data() + i * rows, rows);
      }
    }
  }

  void fit(const Eigen::Ref<const Eigen::MatrixXd>& values) {
    const Eigen::Index n = dimension(), total = size();
    const bool bare = parameters_.degree < 0;
    Eigen::MatrixXd directions(n, 0);
    if (parameters_.degree == 1) {
      directions = detail::affine_directions(points_.transpose());
      const std::string in = " in " + std::to_string(n) + " dimensions";
      require(parameters_.reduce || total > n, std::to_string(n + 1) + " or more centres for a linear polynomial" + in +
                                                   ", got " + std::to_string(total));
      require(parameters_.reduce || directions.cols() == n,
              "centres that extend" + in + " for a linear polynomial, got " + std::to_string(total) +
                  " that extend in " + std::to_string(directions.cols()));
    }
    require(!bare || total >= 2, "2 or more centres without a polynomial, got 1");

    Eigen::MatrixXd block = Eigen::MatrixXd::Zero(total, directions.cols() + 1);
    for (Eigen::Index i = 0; i < total; ++i) block(i, 0) = 1.0;
    for (Eigen::Index k = 0; k < directions.cols(); ++k) {
      for (Eigen::Index d = 0; d < n; ++d) {
        detail::add(directions(d, k), points_.data() + d * total, block.data() + (k + 1) * total, total);
      }
    }
    const Eigen::Index m = block.cols(), rest = total - m;
    System s;
    s.sign = parameters_.kernel == Kernel::linear ? -1.0 : 1.0;
    reflect(std::move(block), s);
    assemble(s);
    require(corner_of(s).factorize(), "centres farther apart: their system is singular to rounding");
    if (bare) {
      Eigen::MatrixXd row = Eigen::MatrixXd::Zero(core::detail::padded_rows<double>(1), rest);
      for (Eigen::Index i = 0; i < rest; ++i) row(0, i) = s.phi(m + i, 0);
      corner_of(s).solve(row.data(), row.rows());
      s.eliminated.resize(rest);
      for (Eigen::Index i = 0; i < rest; ++i) s.eliminated(i) = row(0, i);
      s.pivot = s.phi(0, 0) - detail::dot(s.phi.data() + 1, s.eliminated.data(), rest);
    }

    Eigen::MatrixXd error = values;
    Eigen::MatrixXd fitted(values.rows(), total);
    Eigen::VectorXd largest(values.rows()), scale = Eigen::VectorXd::Zero(values.rows());
    for (Eigen::Index i = 0; i < total; ++i) detail::raise(error.data() + i * error.rows(), scale.data(), error.rows());
    for (Eigen::Index o = 0; o < values.rows(); ++o) scale(o) = scale(o) > 0.0 ? scale(o) : 1.0;
    // Steps after the first refine; a well-conditioned system needs none.
    for (int step = 0; step < 3; ++step) {
      solve(s, directions, error);
      evaluate(centres_, fitted);
      std::fill_n(largest.data(), largest.size(), 0.0);
      for (Eigen::Index i = 0; i < total; ++i) {
        double* off = error.data() + i * error.rows();
        std::copy_n(values.data() + i * values.outerStride(), error.rows(), off);
        detail::add(-1.0, fitted.data() + i * error.rows(), off, error.rows());
        detail::raise(off, largest.data(), error.rows());
      }
      residual_ = 0.0;
      for (Eigen::Index o = 0; o < values.rows(); ++o) {
        const double relative = largest(o) == 0.0 ? 0.0 : largest(o) / scale(o);
        residual_ = relative <= residual_ ? residual_ : relative;
      }
      if (residual_ < 1e-10) break;
    }
    require(residual_ < 1e-6, "a system that can be solved, got a residual of " + std::to_string(residual_) +
                                  ": some centres are too close to one another");
  }

  // Throws where centre j is as good as the same as one of those after it, told by phi of their distances.
  void require_apart(Eigen::Index j, const double* phi, Eigen::Index rows, double extent) const {
    // phi is not monotone for thin plates alone, and there only beyond what is asked here.
    const double least = 1e-10 * extent, power = parameters_.kernel == Kernel::linear ? least : least * least * least;
    if (parameters_.kernel != Kernel::thin_plate) {
      using P = core::Pack<double>;
      P smallest(std::numeric_limits<double>::infinity());
      Eigen::Index i = 1;
      for (; i + P::width <= rows; i += P::width) smallest = core::min(smallest, P::load(phi + i));
      bool near = core::any(smallest <= P(power));
      for (; i < rows; ++i) near = near || phi[i] <= power;
      if (!near) return;
    }
    for (Eigen::Index i = 1; i < rows; ++i) {
      if (phi[i] > power && parameters_.kernel != Kernel::thin_plate) continue;
      double squared = 0.0;
      for (Eigen::Index d = 0; d < dimension(); ++d) squared += std::pow(points_(j + i, d) - points_(j, d), 2);
      if (squared > least * least) continue;
      throw Error("Rbf: expected distinct centres, got the same as centre " + std::to_string(j) + " and centre " +
                  std::to_string(j + i));
    }
  }

  // phi <- Q^T phi Q = phi - v w^T - w v^T, w = y t - v (t^T v^T y t) / 2, y = phi v; lower triangle only. Looks for
  // centres that coincide on the way.
  void assemble(System& s) const {
    const Eigen::Index total = size(), m = s.v.cols();
    s.phi.resize(m + core::detail::padded_rows<double>(total - m), total);
    const Eigen::Index stride = s.phi.rows();
    Eigen::MatrixXd y = Eigen::MatrixXd::Zero(total, m), w = y;
    double extent = 0.0;
    for (Eigen::Index d = 0; d < dimension(); ++d) {
      const auto [low, high] = std::minmax_element(points_.data() + d * total, points_.data() + (d + 1) * total);
      extent = std::max(extent, *high - *low);
    }
    for (Eigen::Index j = 0; j < total; ++j) {
      const Eigen::Index rows = total - j;
      double* column = s.phi.data() + j * stride + j;
      fill_basis(j, rows, points_.data() + j, total, column);
      require_apart(j, column, rows, extent);
      if (s.sign < 0.0) {
        for (Eigen::Index i = 0; i < rows; ++i) column[i] = -column[i];
      }
      std::fill(column + rows, s.phi.data() + (j + 1) * stride, 0.0);
      for (Eigen::Index k = 0; k < m; ++k) {
        const double* v = s.v.data() + k * total + j;
        double* product = y.data() + k * total + j;
        detail::add(v[0], column, product, rows);
        product[0] += detail::dot(column + 1, v + 1, rows - 1);
      }
    }

    for (Eigen::Index k = 0; k < m; ++k) {
      for (Eigen::Index i = 0; i <= k; ++i) detail::add(s.t(i, k), y.data() + i * total, w.data() + k * total, total);
    }
    Eigen::MatrixXd inner(m, m);
    for (Eigen::Index k = 0; k < m; ++k) {
      for (Eigen::Index i = 0; i < m; ++i)
        inner(i, k) = detail::dot(s.v.data() + i * total, w.data() + k * total, total);
    }
    for (Eigen::Index k = 0; k < m; ++k) {
      for (Eigen::Index i = 0; i < m; ++i) {
        double sum = 0.0;
        for (Eigen::Index j = 0; j <= i; ++j) sum += s.t(j, i) * inner(j, k);
        detail::add(-0.5 * sum, s.v.data() + i * total, w.data() + k * total, total);
      }
    }
    for (Eigen::Index j = 0; j < total; ++j) {
      const Eigen::Index rows = total - j;
      double* column = s.phi.data() + j * stride + j;
      using P = core::Pack<double>;
      const double* const v = s.v.data() + j;
      const double* const along = w.data() + j;
      Eigen::Index i = 0;
      for (; i + P::width <= rows; i += P::width) {
        P entry = P::load(column + i);
        for (Eigen::Index k = 0; k < m * total; k += total) {
          entry -= P(along[k]) * P::load(v + k + i) + P(v[k]) * P::load(along + k + i);
        }
        entry.store(column + i);
      }
      for (; i < rows; ++i) {
        for (Eigen::Index k = 0; k < m * total; k += total) column[i] -= along[k] * v[k + i] + v[k] * along[k + i];
      }
    }
  }

  // The definite part of the system.
  static detail::Definite corner_of(System& s) {
    const Eigen::Index m = s.v.cols();
    return {s.phi.data() + m + m * s.phi.rows(), s.phi.rows(), s.phi.cols() - m};
  }

  // Adds the solution for `values` (outputs by N) to the weights and the polynomial.
  void solve(System& s, const Eigen::MatrixXd& directions, const Eigen::MatrixXd& values) {
    const Eigen::Index m = s.v.cols(), total = size(), rest = total - m, outputs = values.rows();
    const Eigen::Index rows = core::detail::padded_rows<double>(outputs);
    Eigen::MatrixXd f = Eigen::MatrixXd::Zero(rows, total);
    for (Eigen::Index i = 0; i < total; ++i) std::copy_n(values.data() + i * outputs, outputs, f.data() + i * rows);
    rotate(s, false, f);
    double* const tail = f.data() + m * rows;
    corner_of(s).solve(tail, rows);
    for (Eigen::Index k = 0; k < m; ++k) {
      for (Eigen::Index i = 0; i < rest; ++i) {
        detail::add(-s.phi(m + i, k), tail + i * rows, f.data() + k * rows, rows);
      }
    }
    if (parameters_.degree < 0) {
      for (Eigen::Index o = 0; o < outputs; ++o) f(o, 0) /= s.pivot;
      for (Eigen::Index i = 0; i < rest; ++i) detail::add(-s.eliminated(i), f.data(), tail + i * rows, rows);
    } else {
      for (Eigen::Index o = 0; o < outputs; ++o) {
        for (Eigen::Index k = m; k-- > 0;) {
          f(o, k) /= s.r(k, k);
          for (Eigen::Index i = 0; i < k; ++i) f(o, i) -= s.r(i, k) * f(o, k);
        }
        polynomial_(o, 0) += f(o, 0);
        for (Eigen::Index k = 1; k < m; ++k) {
          for (Eigen::Index d = 0; d < dimension(); ++d) polynomial_(o, d + 1) += f(o, k) * directions(d, k - 1);
        }
      }
      std::fill_n(f.data(), m * rows, 0.0);
    }
    rotate(s, true, f);
    for (Eigen::Index i = 0; i < total; ++i)
      detail::add(s.sign, f.data() + i * rows, weights_.data() + i * outputs, outputs);
  }

  RbfParameters parameters_;
  Eigen::MatrixXd centres_;
  Eigen::VectorXd offset_, inverse_unit_;
  Eigen::MatrixXd points_;      // N by n, in units, about the mean
  Eigen::MatrixXd weights_;     // outputs by N
  Eigen::MatrixXd polynomial_;  // outputs by 1 + n, of points like points_
  double residual_ = 0.0;
};

}  // namespace traceur::parameterize
