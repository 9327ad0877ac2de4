// SPDX-License-Identifier: MIT
#include <traceur/nn/initializers.hpp>

#include <cmath>

#include <Eigen/Core>
#include <doctest/doctest.h>

using namespace traceur::nn;
using traceur::core::RandomStream;

static_assert(Initializer<Orthogonal> && Initializer<Glorot, double> && Initializer<He> && Initializer<Zeros>);
static_assert(Initializer<LeCun> && Initializer<Normal> && Initializer<UniformFanIn>);

namespace {

struct WrongWayRound {
  void operator()(RandomStream&, float*, Eigen::Index, Eigen::Index) const {}
};
static_assert(!Initializer<WrongWayRound>);

template <class I>
Eigen::MatrixXd filled(const I& initializer, Eigen::Index rows, Eigen::Index cols, unsigned seed = 1) {
  RandomStream random(seed);
  Eigen::MatrixXd w(rows, cols);
  initializer(w.data(), rows, cols, random);
  return w;
}

/// Mean 0 and the given variance, to four standard errors of 20000 numbers; nothing beyond `bound`.
template <class I>
void check_moments(const I& initializer, double variance, double bound, double kurtosis) {
  const Eigen::MatrixXd w = filled(initializer, 100, 200);
  const double n = static_cast<double>(w.size()), squares = w.squaredNorm() / n;
  CHECK(std::abs(w.sum() / n) < 4.0 * std::sqrt(variance / n));
  CHECK(std::abs(squares / variance - 1.0) < 4.0 * std::sqrt((kurtosis - 1.0) / n));
  CHECK(w.cwiseAbs().maxCoeff() <= bound);
}

void check_orthogonal(Eigen::Index rows, Eigen::Index cols) {
  const Eigen::MatrixXd w = filled(Orthogonal{2.0}, rows, cols);
  const Eigen::MatrixXd gram = rows < cols ? Eigen::MatrixXd(w * w.transpose()) : Eigen::MatrixXd(w.transpose() * w);
  CHECK((gram / 4.0 - Eigen::MatrixXd::Identity(gram.rows(), gram.cols())).cwiseAbs().maxCoeff() < 1e-13);
}

}  // namespace

TEST_CASE("variances and bounds are those of the papers") {
  const double unbounded = 1e9, uniform = 9.0 / 5.0, normal = 3.0;
  check_moments(UniformFanIn{}, 1.0 / 600.0, 1.0 / std::sqrt(200.0), uniform);
  check_moments(Glorot{}, 2.0 / 300.0, std::sqrt(6.0 / 300.0), uniform);
  check_moments(Glorot{2.0}, 8.0 / 300.0, 2.0 * std::sqrt(6.0 / 300.0), uniform);
  check_moments(LeCun{}, 1.0 / 200.0, unbounded, normal);
  check_moments(He{}, 2.0 / 200.0, unbounded, normal);
  check_moments(He{1.0}, 1.0 / 200.0, unbounded, normal);
  check_moments(Normal{0.1}, 0.01, unbounded, normal);
  CHECK(filled(Zeros{}, 3, 4).isZero(0));
}

TEST_CASE("orthogonal matrices are orthogonal, whichever side is longer") {
  for (const Eigen::Index n : {1, 2, 7, 30}) {
    check_orthogonal(n, n);
    check_orthogonal(n, 31);
    check_orthogonal(40, n);
  }
}

TEST_CASE("orthogonal matrices have no preferred direction") {
  // The corner element of a uniformly random rotation in the plane is the cosine of a uniform angle: its square is 1/2
  // on average, and its sign either.
  double sum = 0.0, squares = 0.0;
  for (unsigned seed = 0; seed < 2000; ++seed) {
    const Eigen::MatrixXd w = filled(Orthogonal{}, 2, 2, seed);
    sum += w(0, 0);
    squares += w(0, 0) * w(0, 0);
  }
  CHECK(std::abs(sum / 2000) < 4 * std::sqrt(0.5 / 2000));
  CHECK(std::abs(squares / 2000 - 0.5) < 4 * std::sqrt(0.125 / 2000));
}

TEST_CASE("the same stream gives the same weights") {
  CHECK(filled(Orthogonal{}, 5, 9, 3) == filled(Orthogonal{}, 5, 9, 3));
  CHECK(filled(He{}, 5, 9, 3) != filled(He{}, 5, 9, 4));
}
