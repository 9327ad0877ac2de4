// SPDX-License-Identifier: MIT
#include <traceur/nn/schedule.hpp>

#include <doctest/doctest.h>

using namespace traceur::nn;

static_assert(Schedule<ConstantRate> && Schedule<LinearRate> && Schedule<CosineRate> && Schedule<WarmUp<CosineRate>>);
struct Throwing {
  double operator()(std::int64_t) const { return 1.0; }
};
static_assert(!Schedule<Throwing>);

TEST_CASE("ends, middles and beyond") {
  CHECK(ConstantRate{0.3}(0) == 0.3);
  CHECK(ConstantRate{0.3}(1'000'000'000'000) == 0.3);

  const LinearRate line{1.0, 0.2, 8};
  CHECK(line(0) == 1.0);
  CHECK(line(4) == doctest::Approx(0.6));
  CHECK(line(8) == doctest::Approx(0.2));
  CHECK(line(9) == line(8));
  CHECK(line(-1) == line(0));

  const CosineRate cosine{1.0, 0.2, 8};
  CHECK(cosine(0) == doctest::Approx(1.0));
  CHECK(cosine(4) == doctest::Approx(0.6));
  CHECK(cosine(8) == doctest::Approx(0.2));
  CHECK(cosine(100) == cosine(8));
  CHECK(cosine(2) + cosine(6) == doctest::Approx(1.2));
  CHECK(cosine(1) > line(1));
  CHECK(cosine(7) < line(7));
}

TEST_CASE("a warm-up leads up to the schedule behind it") {
  const WarmUp warm{3, LinearRate{0.8, 0.0, 4}};
  CHECK(warm(0) == doctest::Approx(0.2));
  CHECK(warm(1) == doctest::Approx(0.4));
  CHECK(warm(2) == doctest::Approx(0.6));
  CHECK(warm(3) == doctest::Approx(0.8));
  CHECK(warm(5) == doctest::Approx(0.4));
  CHECK(warm(50) == doctest::Approx(0.0));
  CHECK(WarmUp{0, ConstantRate{2.0}}(0) == 2.0);
}
