// SPDX-License-Identifier: MIT
#include <traceur/nn/compact_mlp.hpp>

#include <cmath>
#include <limits>
#include <vector>

#include <doctest/doctest.h>

#include "allocations.hpp"

using namespace traceur::nn;
using traceur::core::RandomStream;

namespace {

// To eight significant bits, ties to even, by arithmetic.
double rounded(double x) {
  if (x == 0) return x;
  int exponent = 0;
  const double mantissa = std::frexp(x, &exponent);
  return std::ldexp(std::nearbyint(std::ldexp(mantissa, 8)), exponent - 8);
}

float value(std::uint16_t bits) { return std::bit_cast<float>(static_cast<std::uint32_t>(bits) << 16); }

struct Outputs {
  std::vector<double> rounded, exact, bound;
};

// A perceptron of ReLUs by its definition, with weights rounded and exact, and how far the two may be apart.
Outputs definition(const std::vector<Eigen::Index>& widths, const std::vector<float>& theta, const std::vector<float>& x) {
  Outputs at{{x.begin(), x.end()}, {x.begin(), x.end()}, std::vector<double>(x.size(), 0.0)};
  std::size_t offset = 0;
  for (std::size_t l = 0; l + 1 < widths.size(); ++l) {
    const auto depth = static_cast<std::size_t>(widths[l]), rows = static_cast<std::size_t>(widths[l + 1]);
    Outputs next;
    for (std::size_t i = 0; i < rows; ++i) {
      const double bias = static_cast<double>(theta[offset + rows * depth + i]);
      double y = bias, z = bias, e = 0;
      for (std::size_t k = 0; k < depth; ++k) {
        const double w = static_cast<double>(theta[offset + k * rows + i]);
        y += rounded(w) * at.rounded[k];
        z += w * at.exact[k];
        e += std::abs(w) * ((1 + 0x1p-9) * at.bound[k] + 0x1p-9 * std::abs(at.exact[k]));
      }
      const bool last = l + 2 == widths.size();
      next.rounded.push_back(last ? y : std::max(0.0, y));
      next.exact.push_back(last ? z : std::max(0.0, z));
      next.bound.push_back(e);
    }
    at = next;
    offset += rows * (depth + 1);
  }
  return at;
}

}  // namespace

TEST_CASE("bfloat16 is the nearest number of eight bits") {
  RandomStream random(1);
  for (int i = 0; i < 2000; ++i) {
    const float x = random.normal<float>() * std::ldexp(1.0f, i % 40 - 20);
    CHECK(static_cast<double>(value(to_bfloat16(x))) == rounded(static_cast<double>(x)));
  }
  for (const float tie : {1.00390625f, 1.01171875f, -1.00390625f}) {
    CHECK(static_cast<double>(value(to_bfloat16(tie))) == rounded(static_cast<double>(tie)));
  }
  constexpr float infinity = std::numeric_limits<float>::infinity();
  CHECK(value(to_bfloat16(0.0f)) == 0.0f);
  CHECK(value(to_bfloat16(-infinity)) == -infinity);
  CHECK(std::isnan(value(to_bfloat16(std::bit_cast<float>(0x7f800001u)))));
}

TEST_CASE("a compact perceptron is one whose weights are rounded") {
  const std::vector<std::vector<Eigen::Index>> shapes = {{3, 64, 64, 1}, {20, 300, 77, 28}, {5, 1}, {1, 33, 2}};
  for (const auto& widths : shapes) {
    const Mlp<> mlp(widths);
    std::vector<float> theta(static_cast<std::size_t>(mlp.parameters()));
    RandomStream random(2);
    mlp.initialize(theta.data(), random);
    CompactMlp<> compact(mlp, theta.data());
    CHECK(compact.inputs() == widths.front());
    CHECK(compact.outputs() == widths.back());
    auto w = compact.workspace();
    std::vector<float> x(static_cast<std::size_t>(widths.front())), y(static_cast<std::size_t>(widths.back())), again = y;
    for (int sample = 0; sample < 3; ++sample) {
      for (float& number : x) number = random.normal<float>();
      if (sample == 1) x[0] = 0.0f;
      compact.infer(x.data(), w, y.data());
      const Outputs expected = definition(widths, theta, x);
      for (std::size_t i = 0; i < y.size(); ++i) {
        CHECK(std::abs(static_cast<double>(y[i]) - expected.rounded[i]) < 2e-5);
        CHECK(std::abs(static_cast<double>(y[i]) - expected.exact[i]) < expected.bound[i] + 2e-5);
      }
      const long before = allocations();
      compact.infer(x.data(), w, again.data());
      CHECK(allocations() == before);
      CHECK(again == y);
    }
  }
}

TEST_CASE("other activations, and new weights") {
  const Mlp<Silu, Tanh> mlp({7, 40, 3});
  std::vector<float> theta(static_cast<std::size_t>(mlp.parameters()));
  RandomStream random(3);
  mlp.initialize(theta.data(), random);
  CompactMlp<Silu, Tanh> compact(mlp, theta.data());
  for (float& t : theta) t = value(to_bfloat16(0.5f * t));
  compact.load(theta.data());
  auto w = compact.workspace();
  auto full = mlp.workspace<float>(1);
  Eigen::MatrixXf x = Eigen::MatrixXf::Constant(7, 1, 0.3f), y(3, 1), z(3, 1);
  compact.infer(x.data(), w, y.data());
  mlp.infer(theta.data(), x, full, z);
  CHECK((y - z).cwiseAbs().maxCoeff() < 1e-6f);
}

TEST_CASE("what is not a number is seen") {
  const Mlp<> mlp({4, 40, 3});
  std::vector<float> theta(static_cast<std::size_t>(mlp.parameters()));
  RandomStream random(4);
  mlp.initialize(theta.data(), random);
  const CompactMlp<> compact(mlp, theta.data());
  auto w = compact.workspace();
  const float x[] = {0.0f, 1.0f, std::numeric_limits<float>::quiet_NaN(), 1.0f};
  float y[3];
  compact.infer(x, w, y);
  for (const float number : y) CHECK(std::isnan(number));
}
