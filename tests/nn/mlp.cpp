// SPDX-License-Identifier: MIT
#include <traceur/nn/mlp.hpp>

#include <string>
#include <string_view>
#include <vector>

#include <doctest/doctest.h>

#include "allocations.hpp"
#include "module_laws.hpp"

using namespace traceur::nn;
using laws::Table;
using traceur::core::RandomStream;

static_assert(Module<Mlp<>, float> && Module<Mlp<Silu, Tanh>, double>);

TEST_CASE("gradients are those of the loss") {
  laws::check_gradient(Mlp<Tanh>({5, 7, 6, 2}), 3);
  laws::check_gradient(Mlp<Silu, Sigmoid>({4, 18, 3}), 5);
  laws::check_gradient(Mlp<Gelu, Gelu>({3, 5, 1}), 4);
  laws::check_gradient(Mlp<Gelu>({6, 2}), 4);
  laws::check_gradient(Mlp<Relu, Tanh>({6, 1}), 4);
}

TEST_CASE("the laws of modules") {
  laws::check_module<float>(Mlp<>({3, 64, 64, 1}));
  laws::check_module<double>(Mlp<LeakyRelu<>, Tanh>({3, 9, 4}));
  laws::check_module<float>(Mlp<Gelu, Silu>({20, 33, 17, 5}));
  laws::check_module<float>(Mlp<Relu, Identity>({4, 4}));
}

TEST_CASE("the layers are dense layers, one after the other") {
  const Mlp<Gelu, Tanh> mlp({6, 20, 9, 3});
  const Table<double> theta = laws::random_parameters(mlp, 3), x = laws::random_table(6, 11, 4);
  const Dense<Gelu> first(6, 20), second(20, 9);
  const Dense<Tanh> third(9, 3);
  const auto part = [&](Eigen::Index from, Eigen::Index count) { return Table<double>(theta.middleRows(from, count)); };
  const Eigen::Index a = first.parameters(), b = second.parameters();
  const Table<double> hidden = laws::output(second, part(a, b), laws::output(first, part(0, a), x));
  CHECK(laws::equal(laws::output(mlp, theta, x), laws::output(third, part(a + b, third.parameters()), hidden)));
  CHECK(a + b + third.parameters() == mlp.parameters());
}

TEST_CASE("infer between forward and backward changes nothing") {
  const Mlp<Silu> mlp({5, 12, 8, 2});
  const Table<double> theta = laws::random_parameters(mlp, 1), x = laws::random_table(5, 10, 2),
                      dy = laws::random_table(2, 10, 3);
  const Table<double> other = laws::random_table(5, 10, 4);
  Table<double> y(2, 10), once = Table<double>::Zero(mlp.parameters(), 1), twice = once, dx(5, 10);
  auto w = mlp.workspace<double>(10);
  mlp.forward(theta.data(), x, w, y);
  mlp.backward(theta.data(), x, dy, w, once.data(), dx);
  mlp.forward(theta.data(), x, w, y);
  mlp.infer(theta.data(), other, w, y);
  mlp.backward(theta.data(), x, dy, w, twice.data(), no_gradient<double>());
  CHECK(laws::equal(once, twice));
}

TEST_CASE("tensors have names") {
  std::vector<std::string> names;
  Eigen::Index last = 0;
  Mlp<>({3, 5, 2}).for_each_parameter(
      [&](std::string_view name, Eigen::Index offset, Eigen::Index rows, Eigen::Index cols) {
        names.emplace_back(name);
        if (name == "layers.1.weight") {
          CHECK(offset == 20);
          CHECK(rows == 2);
          CHECK(cols == 5);
        }
        last = offset + rows * cols;
      });
  CHECK(names == std::vector<std::string>{"layers.0.weight", "layers.0.bias", "layers.1.weight", "layers.1.bias"});
  CHECK(last == Mlp<>({3, 5, 2}).parameters());
}

TEST_CASE("starts") {
  const Mlp<> mlp({10, 20, 4});
  RandomStream random(2);
  Table<float> theta(mlp.parameters(), 1);
  mlp.initialize(theta.data(), random, He{}, Zeros{});
  CHECK(theta.topRows(200).cwiseAbs().maxCoeff() > 0.5f);
  CHECK(theta.bottomRows(mlp.parameters() - 200).isZero(0));
  auto w = mlp.workspace<float>(1);
  Table<float> x = Table<float>::Ones(10, 1), y(4, 1);
  mlp.infer(theta.data(), x, w, y);
  CHECK(y.isZero(0));
}

TEST_CASE("nothing is taken from the heap after the workspace") {
  const Mlp<Silu, Tanh> mlp({9, 40, 40, 3});
  auto w = mlp.workspace<float>(70);
  RandomStream random(1);
  Table<float> theta(mlp.parameters(), 1), x = Table<float>::Ones(9, 70), y(3, 70), dx(9, 70), dtheta = theta;
  mlp.initialize(theta.data(), random);
  dtheta.setZero();
  const long before = allocations();
  mlp.forward(theta.data(), x, w, y);
  mlp.backward(theta.data(), x, y, w, dtheta.data(), dx);
  mlp.infer(theta.data(), x.col(0), w, y.col(0));
  CHECK(allocations() == before);
}

TEST_CASE("impossible shapes are refused") {
  CHECK_THROWS_WITH_AS(Mlp<>({3}), "mlp: expected at least the widths of input and output, got 1", traceur::Error);
  CHECK_THROWS_WITH_AS(Mlp<>({3, 0, 2}), "mlp: width 1: expected at least 1, got 0", traceur::Error);
  CHECK_THROWS_WITH_AS(Mlp<>({3, 2}).workspace<float>(0), "mlp workspace: expected at least one column, got 0",
                       traceur::Error);
}
