// SPDX-License-Identifier: MIT
#include <traceur/nn/sequential.hpp>

#include <string>
#include <string_view>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/nn/dense.hpp>
#include <traceur/nn/folded.hpp>
#include <traceur/nn/layer_norm.hpp>
#include <traceur/nn/patches.hpp>

#include "module_laws.hpp"

using namespace traceur::nn;
using laws::Index;
using Matrixd = Eigen::MatrixXd;

namespace {

auto make() { return Sequential(Dense<Tanh>(3, 8), LayerNorm(8), Patches(2, 2, 2, 2), Folded<Dense<>>(Dense<>(4, 3), 2)); }

}  // namespace

TEST_CASE("a sequence is its modules one after the other") {
  const auto m = make();
  CHECK(m.inputs() == 3);
  CHECK(m.outputs() == 6);
  const Matrixd theta = laws::random_parameters(m, 1), x = laws::random_table(3, 4, 2);
  const Index norm = m.get<0>().parameters(), last = norm + m.get<1>().parameters();
  Matrixd y = laws::output(m.get<0>(), theta.topRows(norm), x);
  y = laws::output(m.get<1>(), theta.middleRows(norm, last - norm), y);
  y = laws::output(m.get<2>(), theta, y);
  y = laws::output(m.get<3>(), theta.bottomRows(m.get<3>().parameters()), y);
  CHECK(laws::equal(laws::output(m, theta, x), y));
}

TEST_CASE("sequences obey the laws of modules") {
  laws::check_module<float>(make());
  laws::check_module<double>(make());
  laws::check_module<double>(Sequential(Dense<>(2, 3)));
  laws::check_gradient(make(), 3);
}

TEST_CASE("tensors are numbered by module") {
  std::vector<std::string> names;
  make().for_each_parameter([&](std::string_view name, Index, Index, Index) { names.emplace_back(name); });
  CHECK(names == std::vector<std::string>{"0.weight", "0.bias", "1.weight", "1.bias", "3.weight", "3.bias"});
}

TEST_CASE("neighbours in a sequence must fit") {
  CHECK_THROWS_WITH_AS(Sequential(Dense<>(2, 3), Dense<>(3, 4), Dense<>(5, 1)),
                       "sequential: module 2 takes 5 rows, module 1 gives 4", traceur::Error);
}
