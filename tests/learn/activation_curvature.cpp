// SPDX-License-Identifier: MIT
#include <traceur/learn/activation_curvature.hpp>

#include <doctest/doctest.h>

using namespace traceur;
using namespace traceur::learn;

namespace {

struct Unknown : nn::Relu {};

static_assert(TwiceDifferentiable<nn::Relu> && TwiceDifferentiable<nn::Gelu, double>);
static_assert(!TwiceDifferentiable<Unknown>);
static_assert(!TwiceDifferentiable<nn::GeluTanh>);

}  // namespace

TEST_CASE_TEMPLATE("the second derivative is the slope of the first", A, nn::Identity, nn::Relu, nn::LeakyRelu<>, nn::Tanh, nn::Sigmoid,
                   nn::Silu, nn::Gelu) {
  using P = core::Pack<double>;
  const auto derivative = [](double z) { return A::derivative(A::reads_output ? A::value(P(z)) : P(z))[0]; };
  for (const double z : {-4.1, -1.3, -0.2, 0.3, 0.9, 2.2, 5.7}) {
    const double h = 1e-5, expected = (derivative(z + h) - derivative(z - h)) / (2 * h);
    const double got = ActivationCurvature<A>::second(A::reads_output ? A::value(P(z)) : P(z))[0];
    CHECK(got == doctest::Approx(expected).epsilon(1e-7));
    if (!ActivationCurvature<A>::curved) CHECK(got == 0);
  }
}
