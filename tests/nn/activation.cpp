// SPDX-License-Identifier: MIT
#include <traceur/nn/activation.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <ratio>

#include <doctest/doctest.h>

using namespace traceur::nn;
using traceur::core::Pack;

static_assert(Activation<Identity> && Activation<Relu> && Activation<LeakyRelu<>> && Activation<Tanh>);
static_assert(Activation<Sigmoid> && Activation<Silu> && Activation<Gelu, double> && Activation<GeluTanh, double>);

namespace {

struct NoDerivative {
  static constexpr bool reads_output = true;
  template <class P>
  static P value(const P& z) {
    return z;
  }
};
static_assert(!Activation<NoDerivative>);

template <class A, class S>
S value(S z) {
  S y = S(0);
  activate<A>(1, &z, &y);
  return y;
}

template <class A, class S>
S derivative(S z) {
  const S kept = A::reads_output ? value<A>(z) : z, one = S(1);
  S slope = S(0);
  activate_backward<A>(1, &kept, &one, &slope);
  return slope;
}

/// The largest of error(z) over a fine grid.
template <class S, class F>
double worst(double low, double high, F&& error) {
  double found = 0.0;
  for (int i = 0; i <= 20000; ++i) {
    const S z = static_cast<S>(low + (high - low) * i / 20000.0);
    const double e = static_cast<double>(std::abs(error(z)));
    if (!(e <= found)) found = e;
  }
  return found;
}

template <class S, class F>
S on_pack(S x, F&& f) {
  return f(Pack<S>(x))[0];
}

double exact_silu(double z) { return z / (1.0 + std::exp(-z)); }
double exact_gelu(double z) { return 0.5 * z * std::erfc(-z / std::sqrt(2.0)); }

template <class A, class S, class F>
void check_value(F&& exact, double bound) {
  CHECK(worst<S>(-12, 12, [&](S z) {
          return static_cast<double>(value<A>(z)) - static_cast<double>(exact(static_cast<double>(z)));
        }) < bound);
}

template <class A>
void check_derivative() {
  CHECK(worst<double>(-8, 8.001, [](double z) {
          const double h = 1e-5;
          if (std::abs(z) < h) return 0.0;
          return derivative<A>(z) - (value<A>(z + h) - value<A>(z - h)) / (2 * h);
        }) < 2e-9);
  CHECK(worst<float>(-8, 8, [](float z) {
          return static_cast<double>(derivative<A>(z)) - derivative<A>(static_cast<double>(z));
        }) < 3e-6);
}

template <class A, class S>
void check_tails() {
  constexpr Eigen::Index n = 37;
  S z[n + 1], y[n + 1], g[n + 1], d[n + 1];
  for (Eigen::Index count = 0; count <= n; ++count) {
    for (Eigen::Index i = 0; i <= n; ++i) {
      z[i] = S(0.3) * static_cast<S>(i - 20);
      g[i] = S(1) + static_cast<S>(i);
      y[i] = d[i] = S(77);
    }
    activate<A>(count, z, y);
    const S* kept = A::reads_output ? y : z;
    activate_backward<A>(count, kept, g, d);
    bool right = y[count] == S(77) && d[count] == S(77);
    for (Eigen::Index i = 0; i < count; ++i) {
      right = right && y[i] == value<A>(z[i]) && d[i] == g[i] * derivative<A>(z[i]);
    }
    activate<A>(count, z, z);
    for (Eigen::Index i = 0; i < count; ++i) right = right && z[i] == y[i];
    CHECK(right);
  }
  CHECK(std::isnan(value<A>(std::numeric_limits<S>::quiet_NaN())));
  CHECK(std::isfinite(value<A>(S(1e4))));
  CHECK(std::isfinite(value<A>(S(-1e4))));
  CHECK(std::isfinite(derivative<A>(S(-1e4))));
  CHECK(derivative<A>(S(1e30)) <= S(1));
}

}  // namespace

TEST_CASE("exp, tanh and the logistic function are as accurate as they say") {
  const auto exp_error = [](auto x) {
    const double exact = std::exp(static_cast<double>(x));
    return static_cast<double>(on_pack(x, [](const auto& p) { return bounded_exp(p); })) / exact - 1.0;
  };
  CHECK(worst<float>(-87, 88, exp_error) < 2e-7);
  CHECK(worst<double>(-708, 709, exp_error) < 4e-16);
  CHECK(worst<double>(-1, 1, exp_error) < 4e-16);
  CHECK(on_pack(-1e30f, [](const auto& p) { return bounded_exp(p); }) ==
        on_pack(-87.0f, [](const auto& p) { return bounded_exp(p); }));
  CHECK(on_pack(1e30, [](const auto& p) { return bounded_exp(p); }) ==
        on_pack(709.0, [](const auto& p) { return bounded_exp(p); }));
  CHECK(std::isnan(on_pack(std::nanf(""), [](const auto& p) { return bounded_exp(p); })));

  const auto tanh_error = [](auto x) {
    const double exact = std::tanh(static_cast<double>(x));
    const double found = static_cast<double>(on_pack(x, [](const auto& p) { return traceur::nn::tanh(p); }));
    return exact == 0.0 ? found : found / exact - 1.0;
  };
  CHECK(worst<float>(-20, 20, tanh_error) < 5e-7);
  CHECK(worst<float>(-1e-3, 0.7, tanh_error) < 5e-7);
  CHECK(worst<double>(-25, 25, tanh_error) < 1e-15);
  CHECK(worst<double>(-0.7, 0.7, tanh_error) < 1e-15);
  CHECK(on_pack(-1e9f, [](const auto& p) { return traceur::nn::tanh(p); }) == -1.0f);

  const auto logistic_error = [](auto x) {
    const double exact = 1.0 / (1.0 + std::exp(-static_cast<double>(x)));
    return static_cast<double>(on_pack(x, [](const auto& p) { return logistic(p); })) / exact - 1.0;
  };
  CHECK(worst<float>(-87, 87, logistic_error) < 5e-7);
  CHECK(worst<double>(-700, 40, logistic_error) < 1e-15);
}

TEST_CASE("values are those of the C library") {
  const auto relu = [](double z) { return std::max(0.0, z); };
  check_value<Relu, float>(relu, 1e-30);
  check_value<Relu, double>(relu, 1e-300);
  check_value<LeakyRelu<std::ratio<1, 5>>, double>([](double z) { return z > 0 ? z : 0.2 * z; }, 1e-15);
  check_value<LeakyRelu<>, float>([](double z) { return z > 0 ? z : 0.01 * z; }, 1e-7);
  check_value<Identity, float>([](double z) { return z; }, 1e-30);
  check_value<Tanh, float>([](double z) { return std::tanh(z); }, 2e-7);
  check_value<Tanh, double>([](double z) { return std::tanh(z); }, 5e-16);
  check_value<Sigmoid, float>([](double z) { return 1.0 / (1.0 + std::exp(-z)); }, 2e-7);
  check_value<Silu, float>(exact_silu, 2e-6);
  check_value<Silu, double>(exact_silu, 5e-15);
  check_value<Gelu, float>(exact_gelu, 1e-6);
  check_value<Gelu, double>(exact_gelu, 1e-14);
  check_value<GeluTanh, double>(exact_gelu, 5e-4);
  const auto gelu_tanh = [](double z) {
    return 0.5 * z * (1 + std::tanh(std::sqrt(2 / std::acos(-1.0)) * (z + 0.044715 * z * z * z)));
  };
  check_value<GeluTanh, double>(gelu_tanh, 5e-15);
  check_value<GeluTanh, float>(gelu_tanh, 2e-6);
  CHECK(worst<float>(-6, 6, [](float z) {
          return static_cast<double>(detail::normal_curve(Pack<float>(z)).below[0]) -
                 0.5 * std::erfc(-z / std::sqrt(2.0));
        }) < 2.5e-7);
}

TEST_CASE("derivatives are those of the values") {
  check_derivative<Identity>();
  check_derivative<Relu>();
  check_derivative<LeakyRelu<>>();
  check_derivative<Tanh>();
  check_derivative<Sigmoid>();
  check_derivative<Silu>();
  check_derivative<Gelu>();
  check_derivative<GeluTanh>();
  CHECK(derivative<Relu>(0.0) == 0.0);
}

TEST_CASE_TEMPLATE("any number of numbers, each on its own", S, float, double) {
  check_tails<Relu, S>();
  check_tails<LeakyRelu<>, S>();
  check_tails<Tanh, S>();
  check_tails<Sigmoid, S>();
  check_tails<Silu, S>();
  check_tails<Gelu, S>();
  check_tails<GeluTanh, S>();
}

TEST_CASE("parts of matrices") {
  Eigen::MatrixXd z = Eigen::MatrixXd::Constant(5, 4, -2.0), y = Eigen::MatrixXd::Constant(5, 4, 7.0), d = y;
  activate<Relu, double>(z.middleRows(1, 3), y.middleRows(1, 3));
  activate_backward<Relu, double>(y.middleRows(0, 4), y.middleRows(0, 4), d.middleRows(1, 4));
  for (int j = 0; j < 4; ++j) {
    for (int i = 0; i < 5; ++i) {
      CHECK(y(i, j) == (i == 0 || i == 4 ? 7.0 : 0.0));
      CHECK(d(i, j) == (i < 2 ? 7.0 : 0.0));
    }
  }
}
