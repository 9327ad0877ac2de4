// SPDX-License-Identifier: MIT
#include "module_laws.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include <doctest/doctest.h>

#include "allocations.hpp"

namespace laws {

namespace {

template <class S>
Table<S> random_numbers(Index rows, Index cols, unsigned seed) {
  traceur::core::RandomStream random(seed);
  Table<S> out(rows, cols);
  for (Index i = 0; i < out.size(); ++i) out.data()[i] = random.normal<S>();
  return out;
}

template <class S>
Table<S> parameters_near_start(Subject<S>& m, unsigned seed) {
  traceur::core::RandomStream random(seed, 1);
  Table<S> theta = Table<S>::Zero(m.parameters, 1);
  m.initialize(theta.data(), random);
  for (Index i = 0; i < theta.size(); ++i) theta(i) += S(0.2) * random.normal<S>();
  return theta;
}

template <class S>
double error_of(ConstMatrix<S> found, ConstMatrix<S> expected) {
  double size = 0, error = 0;
  for (Index j = 0; j < found.cols(); ++j) {
    for (Index i = 0; i < found.rows(); ++i) {
      size = std::max(size, static_cast<double>(std::abs(expected(i, j))));
      const double difference = static_cast<double>(std::abs(found(i, j) - expected(i, j)));
      if (!(difference <= error)) error = difference;
    }
  }
  return size > 1e-9 ? error / size : error;
}

template <class S>
bool same(ConstMatrix<S> a, ConstMatrix<S> b) {
  if (a.rows() != b.rows() || a.cols() != b.cols()) return false;
  for (Index j = 0; j < a.cols(); ++j) {
    for (Index i = 0; i < a.rows(); ++i) {
      if (!(a(i, j) == b(i, j))) return false;
    }
  }
  return true;
}

template <class S>
Table<S> filled(Index rows, Index cols, double value) {
  return Table<S>::Constant(rows, cols, static_cast<S>(value));
}

/// The table with rows of sevens above and below it.
template <class S>
Table<S> framed(ConstMatrix<S> inner, Index above, Index below) {
  Table<S> out = filled<S>(above + inner.rows() + below, inner.cols(), 7);
  out.middleRows(above, inner.rows()) = inner;
  return out;
}

template <class S>
void check_laws(Subject<S>& m, Index tokens) {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  constexpr double epsilon = static_cast<double>(std::numeric_limits<S>::epsilon());
  constexpr Index samples = 3;
  const Index columns = samples * tokens;

  std::set<std::string> names;
  Index next = 0;
  for (const Tensor& tensor : m.tensors) {
    CAPTURE(tensor.name);
    CHECK(names.insert(tensor.name).second);
    CHECK(tensor.offset == next);
    CHECK(tensor.rows > 0);
    CHECK(tensor.cols > 0);
    next = tensor.offset + tensor.rows * tensor.cols;
  }
  CHECK(next == m.parameters);

  const Table<S> theta = parameters_near_start(m, 11), x = random_numbers<S>(m.inputs, columns, 12);
  const Table<S> other = S(-2) * x, dy = random_numbers<S>(m.outputs, columns, 13);
  Table<S> y = filled<S>(m.outputs, columns, nan), dx = filled<S>(m.inputs, columns, nan);
  Table<S> dtheta = filled<S>(m.parameters, 1, 0);
  m.forward(theta.data(), x, y);
  m.backward(theta.data(), x, dy, dtheta.data(), dx);
  REQUIRE(y.allFinite());
  REQUIRE(dtheta.allFinite());
  REQUIRE(dx.allFinite());

  // Whatever was in the workspace, and into whatever it goes.
  Table<S> again = filled<S>(m.outputs, columns, nan);
  m.infer(theta.data(), other, again);
  m.infer(theta.data(), x, again);
  CHECK(same<S>(again, y));
  m.forward(theta.data(), other, again);
  m.forward(theta.data(), x, again);
  CHECK(same<S>(again, y));

  // Gradients are added; they are the same without that of the input.
  Table<S> more = filled<S>(m.parameters, 1, 1), dx_again = filled<S>(m.inputs, columns, nan);
  m.backward(theta.data(), x, dy, more.data(), dx_again);
  CHECK(same<S>(dx_again, dx));
  for (Index i = 0; i < more.size(); ++i) more(i) -= S(1);
  CHECK(error_of<S>(more, dtheta) < 100 * epsilon);
  Table<S> without = filled<S>(m.parameters, 1, 0);
  m.forward(theta.data(), x, again);
  m.backward(theta.data(), x, dy, without.data(), traceur::nn::no_gradient<S>());
  CHECK(same<S>(without, dtheta));

  // A sample alone has the bits it has in the batch, a part of a matrix those of a matrix, and nothing else is touched.
  for (Index sample = 0; sample < samples; ++sample) {
    const Index first = sample * tokens;
    const Table<S> in = framed<S>(x.middleCols(first, tokens), 1, 2), dout = framed<S>(dy.middleCols(first, tokens), 0, 1);
    Table<S> out = filled<S>(m.outputs + 5, tokens, 7), din = filled<S>(m.inputs + 2, tokens, 7);
    Table<S> unused = filled<S>(m.parameters, 1, 0);
    m.infer(theta.data(), in.middleRows(1, m.inputs), out.middleRows(2, m.outputs));
    CHECK(same<S>(out, framed<S>(y.middleCols(first, tokens), 2, 3)));
    out.setConstant(S(7));
    m.forward(theta.data(), in.middleRows(1, m.inputs), out.middleRows(2, m.outputs));
    CHECK(same<S>(out, framed<S>(y.middleCols(first, tokens), 2, 3)));
    m.backward(theta.data(), in.middleRows(1, m.inputs), dout.topRows(m.outputs), unused.data(), din.bottomRows(m.inputs));
    CHECK(same<S>(din, framed<S>(dx.middleCols(first, tokens), 2, 0)));
  }

  // Nothing allocates, with matrices and with parts of them.
  Table<S> in = framed<S>(x, 1, 1), out = framed<S>(y, 1, 1), dout = framed<S>(dy, 1, 1), din = framed<S>(dx, 1, 1);
  const long before = allocations();
  m.infer(theta.data(), x, again);
  m.forward(theta.data(), x, again);
  m.backward(theta.data(), x, dy, more.data(), dx_again);
  m.infer(theta.data(), in.middleRows(1, m.inputs), out.middleRows(1, m.outputs));
  m.forward(theta.data(), in.middleRows(1, m.inputs), out.middleRows(1, m.outputs));
  m.backward(theta.data(), in.middleRows(1, m.inputs), dout.middleRows(1, m.outputs), more.data(), din.middleRows(1, m.inputs));
  m.infer(theta.data(), x.leftCols(tokens), again.leftCols(tokens));
  CHECK(allocations() == before);
}

}  // namespace

Table<double> random_table(Index rows, Index cols, unsigned seed) { return random_numbers<double>(rows, cols, seed); }

Table<double> random_parameters_of(Subject<double>& m, unsigned seed) { return parameters_near_start(m, seed); }

double relative_error(ConstMatrix<double> found, ConstMatrix<double> expected) {
  return error_of<double>(found, expected);
}

bool equal(ConstMatrix<double> a, ConstMatrix<double> b) { return same<double>(a, b); }

void check_laws_of(Subject<float>& m, Index tokens) { check_laws(m, tokens); }
void check_laws_of(Subject<double>& m, Index tokens) { check_laws(m, tokens); }

void check_gradient_of(Subject<double>& m, Index columns) {
  constexpr double h = 2e-5;
  Table<double> theta = random_parameters_of(m, 1), x = random_table(m.inputs, columns, 2);
  const Table<double> weights = random_table(m.outputs, columns, 3);
  Table<double> y(m.outputs, columns);
  const auto loss = [&] {
    m.forward(theta.data(), x, y);
    return weights.cwiseProduct(y).sum();
  };
  const auto differences = [&](Table<double>& at) {
    Table<double> slopes(at.rows(), at.cols());
    for (Index i = 0; i < at.size(); ++i) {
      const double before = at.data()[i];
      at.data()[i] = before + h;
      const double up = loss();
      at.data()[i] = before - h;
      slopes.data()[i] = (up - loss()) / (2 * h);
      at.data()[i] = before;
    }
    return slopes;
  };
  const Table<double> by_theta = differences(theta), by_x = differences(x);

  loss();
  Table<double> dtheta = filled<double>(m.parameters, 1, 0);
  Table<double> dx = filled<double>(m.inputs, columns, std::numeric_limits<double>::quiet_NaN());
  m.backward(theta.data(), x, weights, dtheta.data(), dx);
  CHECK(relative_error(dx, by_x) < 1e-6);
  for (const Tensor& tensor : m.tensors) {
    CAPTURE(tensor.name);
    const Index size = tensor.rows * tensor.cols;
    CHECK(relative_error(dtheta.middleRows(tensor.offset, size), by_theta.middleRows(tensor.offset, size)) < 1e-6);
  }
}

}  // namespace laws
