// SPDX-License-Identifier: MIT
#include <traceur/diffusion/ddim.hpp>

#include <cmath>
#include <vector>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace traceur::diffusion;
using Vec = Eigen::VectorXd;

TEST_CASE_TEMPLATE("with an exact estimate a step of any stride lands on the same sample and noise", S, float, double) {
  const double tolerance = sizeof(S) == 4 ? 2e-5 : 1e-12;
  for (const Schedule& s : {Schedule::cosine(21), Schedule::linear(60, 1e-3, 0.1)}) {
    const Table<S> clean = random_table<S>(5, 3, 1), eps = random_table<S>(5, 3, 2);
    Table<S> from(5, 3), to(5, 3);
    for (int k = 1; k <= s.steps(); ++k) {
      for (int stride = 1; stride <= k; ++stride) {
        const DdimStep step(s, k, k - stride);
        s.diffuse<S>(k, clean, eps, from);
        s.diffuse<S>(k - stride, clean, eps, to);
        const Table<S> got = static_cast<S>(step.clean) * clean + static_cast<S>(step.noisy) * from;
        CHECK(static_cast<double>((got - to).cwiseAbs().maxCoeff()) < tolerance);
      }
      // The last step is the estimate itself.
      CHECK(DdimStep(s, k, 0).clean == 1.0);
      CHECK(DdimStep(s, k, 0).noisy == 0.0);
    }
  }
}

TEST_CASE("the coefficient as printed in the paper would not land there") {
  const Schedule s = Schedule::cosine(21);
  const DdimStep step(s, 16, 11);
  const double as_printed = s.signal(16) - s.signal(16) * s.noise(11) / s.noise(16);
  CHECK(std::abs(as_printed - step.clean) > 0.1);
}

TEST_CASE("the steps visited") {
  const Schedule s = Schedule::cosine(21);
  CHECK(Ddim<float>(s, 5, 2, 1).steps() == std::vector<int>{21, 16, 11, 6, 1});
  CHECK(Ddim<float>(s, 10, 2, 1).steps() == std::vector<int>{21, 11, 1});
  CHECK(Ddim<float>(s, 21, 2, 1).steps() == std::vector<int>{21});
  CHECK(Ddim<float>(s, 100, 2, 1).steps() == std::vector<int>{21});
  CHECK(Ddim<float>(s, 1, 2, 1).steps().size() == 21);
}

TEST_CASE_TEMPLATE("the exact denoiser of one sample gives that sample, at every stride", S, float, double) {
  const Table<S> goal = random_table<S>(4, 3, 3);
  auto denoiser = denoiser_of<S>(4, 4, [](int, const auto&, const auto& condition, Parts, Eigen::Index) { return condition; });
  static_assert(Denoiser<decltype(denoiser), S>);
  for (int stride = 1; stride <= 22; ++stride) {
    Ddim<S> ddim(Schedule::cosine(21), stride, 4, 3);
    Table<S> x = random_table<S>(4, 3, 4);
    denoiser.calls = 0;
    ddim.sample(denoiser, {goal}, x);
    CHECK(same_bits<S>(x, goal));
    CHECK(denoiser.calls == static_cast<int>(ddim.steps().size()));
  }
}

TEST_CASE("the exact denoiser of a normal distribution gives that distribution") {
  // Of x0 ~ N(m, v), E[x0 | x_k] is linear in x_k, and DDIM maps noise to m + a eps: a tends to sqrt(v) with small steps.
  const double m = 0.7, v = 0.25;
  const Schedule s = Schedule::cosine(2000, 0.008, 1e-8, 0.99999999);
  auto denoiser = denoiser_of<double>(1, 0, [&](int k, const Vec& x, const Vec&, Parts, Eigen::Index) {
    const double gain = s.signal(k) * v / (s.kept(k) * v + 1 - s.kept(k));
    return Vec::Constant(1, m + gain * (x[0] - s.signal(k) * m)).eval();
  });
  double before = 1;
  for (const int stride : {200, 20, 1}) {
    Ddim<double> ddim(s, stride, 1, 2);
    Table<double> x(1, 2);
    x << 0, 1;
    ddim.sample(denoiser, no_condition<double>(2), x);
    CHECK(x(0) == doctest::Approx(m).epsilon(1e-4));
    const double error = std::abs(x(1) - x(0) - std::sqrt(v));
    CHECK(error < before);
    before = error;
  }
  CHECK(before < 2e-3);
}

TEST_CASE("every estimate is projected") {
  auto denoiser = denoiser_of<double>(2, 0, [](int, const Vec& x, const Vec&, Parts, Eigen::Index) { return x; });
  Ddim<double> ddim(Schedule::cosine(10), 3, 2, 1);
  Table<double> x = random_table<double>(2, 1, 5);
  int calls = 0;
  ddim.sample(denoiser, no_condition<double>(1), x, [&](auto&& clean) {
    ++calls;
    clean.setConstant(3);
  });
  CHECK(calls == 4);
  CHECK(x == Table<double>::Constant(2, 1, 3));
}

TEST_CASE("noise of a sample does not depend on the batch") {
  Table<float> all(6, 5), part(6, 2);
  draw_noise<float>(all, 9, 4);
  draw_noise<float>(part, 9, 4, 3);
  CHECK(same_bits<float>(part, all.rightCols(2)));
}

TEST_CASE("ddim refuses numbers out of range") {
  const Schedule s = Schedule::cosine(10);
  CHECK_THROWS_WITH_AS(Ddim<float>(s, 0, 1, 1), "ddim: expected a stride of at least 1, got 0", traceur::Error);
  CHECK_THROWS_AS(Ddim<float>(s, 1, 0, 1), traceur::Error);
  CHECK_THROWS_AS(Ddim<float>(s, 1, 1, 0), traceur::Error);
}
