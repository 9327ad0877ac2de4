// SPDX-License-Identifier: MIT
#include <traceur/nn/parameter_check.hpp>

#include <limits>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/nn/mlp.hpp>

using traceur::nn::check_finite;
using traceur::nn::first_not_finite;

TEST_CASE("the first number that is not finite is named") {
  const traceur::nn::Mlp<> mlp({3, 5, 2});
  std::vector<double> values(static_cast<std::size_t>(mlp.parameters()), 1.0);
  CHECK(first_not_finite(mlp, values.data()).empty());
  CHECK_NOTHROW(check_finite("gradient", mlp, values.data()));
  values[31] = -std::numeric_limits<double>::infinity();
  CHECK(first_not_finite(mlp, values.data()) == "layers.1.bias(1, 0) is -inf");
  values[20 + 3] = std::numeric_limits<double>::quiet_NaN();
  CHECK(first_not_finite(mlp, values.data()) == "layers.1.weight(1, 1) is nan");
  values[17] = std::numeric_limits<double>::infinity();
  CHECK_THROWS_WITH_AS(check_finite("policy gradient", mlp, values.data()),
                       "policy gradient: layers.0.bias(2, 0) is inf", traceur::Error);
}
