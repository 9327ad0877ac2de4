// SPDX-License-Identifier: MIT
#include <traceur/nn/product.hpp>

#include <cmath>
#include <limits>

#include <doctest/doctest.h>

#include <traceur/core/random.hpp>

using Eigen::Index;
using traceur::nn::Into;

namespace {

template <class S>
using Table = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;

template <class S>
Table<S> random_table(Index rows, Index cols, unsigned seed) {
  traceur::core::RandomStream random(seed, static_cast<std::uint64_t>(rows), static_cast<std::uint64_t>(cols));
  Table<S> out(rows, cols);
  for (Index i = 0; i < out.size(); ++i) out.data()[i] = random.normal<S>();
  return out;
}

/// Scratch memory that knows when a product wrote beyond its end.
template <class S>
struct Scratch {
  explicit Scratch(Index rows, Index cols) : size(traceur::nn::product_scratch<S>(rows, cols)), numbers(size + 64) {
    numbers.setConstant(std::numeric_limits<S>::quiet_NaN());
    numbers.tail(64).setConstant(S(7));
  }
  S* data() { return numbers.data(); }
  bool whole() const {
    for (Index i = size; i < size + 64; ++i) {
      if (numbers[i] != S(7)) return false;
    }
    return true;
  }
  Index size;
  Eigen::Matrix<S, Eigen::Dynamic, 1> numbers;
};

/// |found - expected| is at most a few roundings of the sum of |terms|.
template <class S>
bool near(const Table<S>& found, const Table<S>& a, const Table<S>& b, const Table<S>& start) {
  for (Index j = 0; j < b.cols(); ++j) {
    for (Index i = 0; i < a.rows(); ++i) {
      long double sum = start(i, j), size = std::abs(start(i, j));
      for (Index k = 0; k < a.cols(); ++k) {
        const long double term = static_cast<long double>(a(i, k)) * static_cast<long double>(b(k, j));
        sum += term;
        size += std::abs(term);
      }
      const long double bound =
          static_cast<long double>(a.cols() + 2) * static_cast<long double>(std::numeric_limits<S>::epsilon()) * size;
      if (!(std::abs(static_cast<long double>(found(i, j)) - sum) <= bound)) return false;
    }
  }
  return true;
}

template <class S>
bool same(const Table<S>& a, const Table<S>& b) {
  return a.rows() == b.rows() && a.cols() == b.cols() && (a.array() == b.array()).all();
}

/// Inside a larger matrix full of sevens.
template <class S>
struct Framed {
  explicit Framed(const Table<S>& inner)
      : whole(Table<S>::Constant(inner.rows() + 3, inner.cols() + 2, S(7))), rows(inner.rows()) {
    view() = inner;
  }
  auto view() { return whole.block(1, 1, rows, whole.cols() - 2); }
  bool unharmed() {
    const Table<S> inner = view();
    view().setConstant(S(7));
    const bool all = (whole.array() == S(7)).all();
    view() = inner;
    return all;
  }
  Table<S> whole;
  Index rows;
};

template <class S>
void check_shape(Index rows, Index depth, Index columns) {
  CAPTURE(rows);
  CAPTURE(depth);
  CAPTURE(columns);
  const Table<S> w = random_table<S>(rows, depth, 1), x = random_table<S>(depth, columns, 2);
  const Table<S> y = random_table<S>(rows, columns, 3), bias = random_table<S>(rows, 1, 4);
  Scratch<S> scratch(rows, depth);
  Framed<S> framed_w(w), framed_x(x), out(y);

  traceur::nn::product<S>(framed_w.view(), framed_x.view(), out.view(), scratch.data());
  CHECK(near<S>(out.view(), w, x, Table<S>::Zero(rows, columns)));
  traceur::nn::product<S>(w, x, out.view(), scratch.data(), Into::set, bias.data());
  CHECK(near<S>(out.view(), w, x, bias.replicate(1, columns)));
  const Table<S> with_bias = out.view();
  for (Index j = 0; j < columns; j += 1 + columns / 7) {
    Table<S> alone(rows, 1);
    traceur::nn::product<S>(w, x.col(j), alone, scratch.data(), Into::set, bias.data());
    CHECK(same<S>(alone, with_bias.col(j)));
  }
  out.view() = y;
  traceur::nn::product<S>(w, x, out.view(), scratch.data(), Into::add);
  CHECK(near<S>(out.view(), w, x, y));
  CHECK(out.unharmed());

  Framed<S> back(x);
  const Table<S> wt = w.transpose();
  traceur::nn::transposed_product<S>(framed_w.view(), y, back.view(), scratch.data());
  CHECK(near<S>(back.view(), wt, y, Table<S>::Zero(depth, columns)));
  const Table<S> whole = back.view();
  Table<S> alone(depth, 1);
  traceur::nn::transposed_product<S>(w, y.rightCols(1), alone, scratch.data());
  CHECK(same<S>(alone, whole.rightCols(1)));
  back.view() = x;
  traceur::nn::transposed_product<S>(w, y, back.view(), scratch.data(), Into::add);
  CHECK(near<S>(back.view(), wt, y, x));
  CHECK(back.unharmed());

  const Table<S> xt = x.transpose();
  traceur::nn::outer_product<S>(y, framed_x.view(), framed_w.view(), scratch.data());
  CHECK(near<S>(framed_w.view(), y, xt, w));
  CHECK(framed_w.unharmed());
  CHECK(scratch.whole());
}

}  // namespace

TEST_CASE_TEMPLATE("products are the sums they stand for, in every shape", S, float, double) {
  for (const Index rows : {1, 2, 3, 5, 9, 17, 31, 48, 64, 81}) {
    for (const Index depth : {1, 3, 8, 33}) {
      for (const Index columns : {1, 2, 5, 13, 50}) check_shape<S>(rows, depth, columns);
    }
  }
  check_shape<S>(70, 45, 600);
  check_shape<S>(2, 150, 300);
  check_shape<S>(300, 500, 7);
  check_shape<S>(40, 350, 40);
}

TEST_CASE("a product that sums nothing is its start") {
  Eigen::MatrixXd w = Eigen::MatrixXd::Ones(4, 3), none(3, 0), also_none(4, 0);
  Scratch<double> scratch(4, 3);
  traceur::nn::outer_product<double>(also_none, none, w, scratch.data());
  traceur::nn::product<double>(w, none, also_none, scratch.data());
  traceur::nn::transposed_product<double>(w, also_none, none, scratch.data());
  CHECK(same<double>(w, Eigen::MatrixXd::Ones(4, 3)));
  CHECK(scratch.whole());
}

TEST_CASE("what is not a number reaches only its own row and column") {
  Eigen::MatrixXf w = random_table<float>(40, 20, 1), x = random_table<float>(20, 30, 2), y(40, 30);
  x(19, 7) = std::numeric_limits<float>::quiet_NaN();
  Scratch<float> scratch(40, 20);
  traceur::nn::product<float>(w, x, y, scratch.data());
  for (Index j = 0; j < 30; ++j) CHECK(std::isnan(y.col(j).sum()) == (j == 7));
  const Eigen::MatrixXf row = w.topRows(1);
  Eigen::MatrixXf values(1, 30);
  traceur::nn::product<float>(row, x, values, scratch.data());
  for (Index j = 0; j < 30; ++j) CHECK(std::isnan(values(0, j)) == (j == 7));
}

TEST_CASE_TEMPLATE("columns that meet a zero are left out without a trace", S, float, double) {
  for (const Index rows : {37, 512}) {
    const Index cols = 1000;
    const Table<S> w = random_table<S>(rows, cols, 8), bias = random_table<S>(rows, 1, 9);
    Table<S> x = random_table<S>(cols, 3, 10);
    x = (x.array() < S(0)).select(S(0), x);
    x.col(2).setZero();
    Scratch<S> scratch(rows, cols);
    Table<S> all(rows, 3), one(rows, 1);
    traceur::nn::product<S>(w, x, all, scratch.data(), Into::set, bias.data());
    for (Index j = 0; j < 3; ++j) {
      traceur::nn::product<S>(w, x.col(j), one, scratch.data(), Into::set, bias.data());
      CHECK(one == all.col(j));
    }
    CHECK(one == bias);
    CHECK(scratch.whole());
  }
}
