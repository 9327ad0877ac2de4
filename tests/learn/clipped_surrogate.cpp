// SPDX-License-Identifier: MIT
#include <traceur/learn/clipped_surrogate.hpp>

#include <algorithm>
#include <limits>

#include <doctest/doctest.h>

using traceur::learn::ClippedSurrogate;
using doctest::Approx;

TEST_CASE("the loss is the smaller of two products and the slope its derivative") {
  for (const double advantage : {-2.0, -0.3, 0.0, 1.5}) {
    for (double x = -0.6; x < 0.6; x += 0.013) {
      const ClippedSurrogate<double> s(x, advantage, 0.2);
      const double ratio = std::exp(x);
      CHECK(s.loss == Approx(-std::min(ratio * advantage, std::clamp(ratio, 0.8, 1.2) * advantage)).epsilon(1e-14));
      CHECK(s.clipped == (std::abs(ratio - 1) > 0.2));
      const double h = 1e-6;
      if (std::abs(std::abs(ratio - 1) - 0.2) < 1e-4) continue;
      const double slope =
          (ClippedSurrogate<double>(x + h, advantage, 0.2).loss - ClippedSurrogate<double>(x - h, advantage, 0.2).loss) / (2 * h);
      CHECK(s.slope == Approx(slope).epsilon(1e-6).scale(1));
    }
  }
}

TEST_CASE("clipping only ever takes away what would be gained") {
  // Better than thought and already likelier, worse and already rarer: nothing more to gain.
  CHECK(ClippedSurrogate<double>(0.5, 1.0, 0.2).slope == 0);
  CHECK(ClippedSurrogate<double>(-0.5, -1.0, 0.2).slope == 0);
  // Gone the wrong way: the full slope back.
  CHECK(ClippedSurrogate<double>(-0.5, 1.0, 0.2).slope == Approx(-std::exp(-0.5)));
  CHECK(ClippedSurrogate<double>(0.5, -1.0, 0.2).slope == Approx(std::exp(0.5)));
}

TEST_CASE("the divergence is zero for the same policy, positive for others, and to second order half the square") {
  CHECK(ClippedSurrogate<double>(0, 1, 0.2).divergence == 0);
  for (const double x : {-0.01, 0.01}) CHECK(ClippedSurrogate<double>(x, 1, 0.2).divergence == Approx(x * x / 2).epsilon(0.01));
}

TEST_CASE("what is not a number stays so") {
  const double not_a_number = std::numeric_limits<double>::quiet_NaN();
  CHECK(std::isnan(ClippedSurrogate<double>(not_a_number, 1, 0.2).slope));
  CHECK(std::isnan(ClippedSurrogate<double>(0.1, not_a_number, 0.2).slope));
}
