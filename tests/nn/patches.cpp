// SPDX-License-Identifier: MIT
#include <traceur/nn/patches.hpp>

#include <doctest/doctest.h>

#include "module_laws.hpp"

using namespace traceur::nn;
using laws::Index;
using Matrixd = Eigen::MatrixXd;

TEST_CASE("patches are squares of the image, left to right and top to bottom") {
  const Patches m(2, 4, 6, 2);
  CHECK(m.tokens() == 6);
  CHECK(m.features() == 8);
  const Matrixd x = Matrixd::NullaryExpr(48, 1, [](Index i, Index) { return static_cast<double>(i); });
  const Matrixd y = laws::output(m, Matrixd(0, 1), x);
  for (Index token = 0; token < 6; ++token) {
    for (Index c = 0; c < 2; ++c) {
      for (Index i = 0; i < 2; ++i) {
        for (Index j = 0; j < 2; ++j) {
          const Index row = token / 3 * 2 + i, column = token % 3 * 2 + j;
          CHECK(y(token * 8 + (c * 2 + i) * 2 + j) == static_cast<double>((c * 4 + row) * 6 + column));
        }
      }
    }
  }
}

TEST_CASE("patches obey the laws of modules") {
  laws::check_module<float>(Patches(2, 4, 6, 2));
  laws::check_module<double>(Patches(1, 3, 3, 1));
  laws::check_gradient(Patches(3, 4, 2, 2), 2);
}

TEST_CASE("patches must cover the image") {
  CHECK_THROWS_WITH_AS(Patches(1, 4, 5, 2), "patches: expected a size that divides 4 and 5, got 2", traceur::Error);
  CHECK_THROWS_AS(Patches(0, 4, 4, 2), traceur::Error);
  CHECK_THROWS_AS(Patches(1, 0, 4, 2), traceur::Error);
  CHECK_THROWS_AS(Patches(1, 4, 0, 2), traceur::Error);
  CHECK_THROWS_AS(Patches(1, 4, 4, 0), traceur::Error);
}
