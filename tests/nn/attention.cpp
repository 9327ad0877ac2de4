// SPDX-License-Identifier: MIT
#include <traceur/nn/attention.hpp>

#include <cmath>
#include <limits>
#include <vector>

#include <doctest/doctest.h>

#include "module_laws.hpp"

using namespace traceur::nn;
using laws::Index;
using Matrixd = Eigen::MatrixXd;
using Mask = Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic>;

namespace {

Attention make(Index width, Index heads, Index tokens, bool causal = false, Mask pattern = {}) {
  return Attention({width, heads, tokens, causal, std::move(pattern)});
}

// Equation 1 of the paper, number by number.
Matrixd definition(const Matrixd& theta, const Matrixd& x, Index heads, Index tokens, const Mask& allowed, const Mask& keys) {
  const Index width = x.rows(), depth = width / heads;
  const double* at = theta.data();
  const Eigen::Map<const Matrixd> w_in(at, 3 * width, width), b_in(at += 3 * width * width, 3 * width, 1);
  const Eigen::Map<const Matrixd> w_out(at += 3 * width, width, width), b_out(at += width * width, width, 1);
  Matrixd y(width, x.cols());
  const auto qkv = [&](Index row, Index column) {
    double sum = b_in(row);
    for (Index i = 0; i < width; ++i) sum += w_in(row, i) * x(i, column);
    return sum;
  };
  for (Index sample = 0; sample < x.cols() / tokens; ++sample) {
    for (Index j = 0; j < tokens; ++j) {
      std::vector<double> mixed(static_cast<std::size_t>(width), 0.0);
      for (Index h = 0; h < heads; ++h) {
        std::vector<double> weight(static_cast<std::size_t>(tokens), 0.0);
        double total = 0;
        for (Index i = 0; i < tokens; ++i) {
          if ((allowed.size() > 0 && !allowed(i, j)) || (keys.size() > 0 && !keys(i, sample))) continue;
          double score = 0;
          for (Index d = 0; d < depth; ++d) {
            score += qkv(h * depth + d, sample * tokens + j) * qkv(width + h * depth + d, sample * tokens + i);
          }
          total += weight[static_cast<std::size_t>(i)] = std::exp(score / std::sqrt(static_cast<double>(depth)));
        }
        for (Index d = 0; d < depth && total > 0; ++d) {
          double& o = mixed[static_cast<std::size_t>(h * depth + d)];
          for (Index i = 0; i < tokens; ++i) {
            o += weight[static_cast<std::size_t>(i)] / total * qkv(2 * width + h * depth + d, sample * tokens + i);
          }
        }
      }
      for (Index r = 0; r < width; ++r) {
        double sum = b_out(r);
        for (Index c = 0; c < width; ++c) sum += w_out(r, c) * mixed[static_cast<std::size_t>(c)];
        y(r, sample * tokens + j) = sum;
      }
    }
  }
  return y;
}

Matrixd masked_output(const Attention& m, const Matrixd& theta, const Matrixd& x, const Mask& keys) {
  auto w = m.workspace<double>(x.cols());
  Matrixd y(x.rows(), x.cols()), inferred(x.rows(), x.cols());
  m.forward(theta.data(), x, keys, w, y);
  m.infer(theta.data(), x, keys, w, inferred);
  CHECK(laws::equal(y, inferred));
  return y;
}

Mask some_keys(Index tokens, Index samples) {
  Mask keys(tokens, samples);
  for (Index b = 0; b < samples; ++b) {
    for (Index t = 0; t < tokens; ++t) keys(t, b) = (3 * t + b) % 4 != 0;
  }
  return keys;
}

}  // namespace

TEST_CASE("attention obeys the laws of modules") {
  laws::check_module<float>(make(12, 3, 5), 5);
  laws::check_module<double>(make(12, 3, 5), 5);
  laws::check_module<double>(make(4, 1, 1), 1);
  laws::check_module<float>(make(16, 2, 17, true), 17);
}

TEST_CASE("attention is equation 1, with every mask") {
  constexpr Index width = 6, heads = 2, tokens = 5, samples = 3;
  Mask pattern = Mask::Constant(tokens, tokens, true), causal = pattern;
  pattern(0, 3) = pattern(2, 2) = pattern(4, 0) = false;
  for (Index j = 0; j < tokens; ++j) {
    for (Index i = j + 1; i < tokens; ++i) causal(i, j) = false;
  }
  const Mask keys = some_keys(tokens, samples), all;
  const Attention plain = make(width, heads, tokens);
  const Matrixd theta = laws::random_parameters(plain, 1), x = 2 * laws::random_table(width, samples * tokens, 2);
  const auto expect = [&](const Attention& m, const Mask& k, const Mask& allowed) {
    CHECK(laws::relative_error(masked_output(m, theta, x, k), definition(theta, x, heads, tokens, allowed, k)) < 1e-12);
  };
  expect(plain, all, all);
  expect(plain, keys, all);
  expect(make(width, heads, tokens, true), all, causal);
  expect(make(width, heads, tokens, true), keys, causal);
  expect(make(width, heads, tokens, false, pattern), all, pattern);
  expect(make(width, heads, tokens, true, pattern), keys, causal && pattern);
}

TEST_CASE("gradients of attention, with every mask") {
  constexpr Index tokens = 4, samples = 2;
  laws::check_gradient(make(6, 2, tokens), samples * tokens);
  laws::check_gradient(make(4, 4, tokens, true), samples * tokens);
  const Mask keys = some_keys(tokens, samples);
  laws::check_gradient(make(6, 3, tokens, true), samples * tokens,
                       [&](const double* theta, const auto& x, auto& w, const auto& y) {
                         make(6, 3, tokens, true).forward(theta, x, keys, w, y);
                       });
}

TEST_CASE("attention does not see the order of the tokens") {
  const Attention m = make(8, 2, 6);
  const Matrixd theta = laws::random_parameters(m, 3), x = laws::random_table(8, 6, 4);
  Eigen::PermutationMatrix<Eigen::Dynamic> order(6);
  order.indices() << 3, 1, 5, 0, 2, 4;
  CHECK(laws::relative_error(laws::output(m, theta, x * order), laws::output(m, theta, x) * order) < 1e-12);
}

TEST_CASE("what is left out changes nothing") {
  constexpr Index tokens = 5;
  const Attention causal = make(8, 2, tokens, true), plain = make(8, 2, tokens);
  const Matrixd theta = laws::random_parameters(causal, 5), x = laws::random_table(8, tokens, 6);
  Matrixd later = x;
  later.rightCols(2).array() += 100;
  CHECK(laws::equal(laws::output(causal, theta, x).leftCols(3), laws::output(causal, theta, later).leftCols(3)));
  Mask keys = Mask::Constant(tokens, 1, true);
  keys.bottomRows(2).setConstant(false);
  CHECK(laws::equal(masked_output(plain, theta, x, keys).leftCols(3), masked_output(plain, theta, later, keys).leftCols(3)));
  // A sample without its last tokens is a shorter sample.
  CHECK(laws::relative_error(masked_output(plain, theta, x, keys).leftCols(3),
                             laws::output(make(8, 2, 3), theta, x.leftCols(3))) < 1e-12);
}

TEST_CASE("a token that may look at nothing gets the output bias") {
  const Attention m = make(4, 2, 3);
  const Matrixd theta = laws::random_parameters(m, 7), x = laws::random_table(4, 6, 8);
  Mask keys = Mask::Constant(3, 2, true);
  keys.col(1).setConstant(false);
  const Matrixd y = masked_output(m, theta, x, keys);
  CHECK(laws::equal(y.leftCols(3), laws::output(m, theta, x.leftCols(3))));
  for (Index j = 3; j < 6; ++j) CHECK(laws::equal(y.col(j), theta.bottomRows(4)));
}

TEST_CASE("scores of any size give weights that sum to one") {
  // With equal values in all tokens every weighted mean is that value, however sharp the weights are.
  const Attention m = make(4, 1, 7);
  Matrixd theta = laws::random_parameters(m, 9);
  Eigen::Map<Matrixd> w_in(theta.data(), 12, 4);
  w_in.topRows(8) *= 200;
  w_in.bottomRows(4).setZero();
  const Matrixd x = 10 * laws::random_table(4, 7, 10), y = laws::output(m, theta, x);
  CHECK(y.allFinite());
  for (Index j = 1; j < 7; ++j) CHECK(laws::relative_error(y.col(j), y.col(0)) < 1e-12);
}

TEST_CASE("attention refuses shapes that do not fit") {
  CHECK_THROWS_WITH_AS(make(10, 3, 5), "attention: expected heads that divide the width 10, got 3", traceur::Error);
  CHECK_THROWS_WITH_AS(make(4, 2, 3, false, Mask::Constant(2, 3, true)),
                       "attention: expected a pattern of 3 x 3, got 2 x 3", traceur::Error);
  CHECK_THROWS_AS(make(0, 1, 5), traceur::Error);
  CHECK_THROWS_AS(make(4, 0, 5), traceur::Error);
  CHECK_THROWS_AS(make(4, 1, 0), traceur::Error);
}
