// SPDX-License-Identifier: MIT
#include <traceur/nn/transformer.hpp>

#include <cmath>
#include <string>
#include <string_view>
#include <vector>

#include <doctest/doctest.h>

#include "module_laws.hpp"

using namespace traceur::nn;
using laws::Index;
using Matrixd = Eigen::MatrixXd;
using Mask = Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic>;

namespace {

constexpr Index width = 6, tokens = 4, samples = 2, hidden = 7;

TransformerLayerParameters shape(NormOrder norm) { return {{width, 2, tokens, false, {}}, hidden, norm}; }

TransformerParameters stack(NormOrder norm, Index layers, bool final_norm) { return {layers, shape(norm), final_norm}; }

Matrixd some(Index rows, Index cols, unsigned seed) { return laws::random_table(rows, cols, seed); }

// A layer put together from the published formula, with attention and layer norm as they are tested elsewhere.
Matrixd definition(const Matrixd& theta, const Matrixd& x, NormOrder norm) {
  const Attention attention({width, 2, tokens, false, {}});
  const double* at = theta.data() + attention.parameters();
  const Eigen::Map<const Matrixd> w1(at, hidden, width), b1(at += hidden * width, hidden, 1);
  const Eigen::Map<const Matrixd> w2(at += hidden, width, hidden), b2(at += width * hidden, width, 1);
  const Matrixd norm1 = Eigen::Map<const Matrixd>(at += width, 2 * width, 1);
  const Matrixd norm2 = Eigen::Map<const Matrixd>(at += 2 * width, 2 * width, 1);
  const auto attend = [&](const Matrixd& in) { return laws::output(attention, theta, in); };
  const auto normed = [&](const Matrixd& weights, const Matrixd& in) { return laws::output(LayerNorm(width), weights, in); };
  const auto feed = [&](const Matrixd& in) {
    Matrixd h = w1.lazyProduct(in);
    for (Index j = 0; j < h.cols(); ++j) {
      for (Index i = 0; i < hidden; ++i) {
        const double z = h(i, j) + b1(i);
        h(i, j) = z / 2 * (1 + std::erf(z / std::sqrt(2.0)));
      }
    }
    Matrixd out = w2.lazyProduct(h);
    for (Index j = 0; j < h.cols(); ++j) out.col(j) += b2;
    return out;
  };
  if (norm == NormOrder::before) {
    const Matrixd a = x + attend(normed(norm1, x));
    return a + feed(normed(norm2, a));
  }
  const Matrixd a = normed(norm1, x + attend(x));
  return normed(norm2, a + feed(a));
}

}  // namespace

TEST_CASE("a layer is the published formula, norms before and after") {
  for (const NormOrder norm : {NormOrder::before, NormOrder::after}) {
    const TransformerLayer<> layer(shape(norm));
    const Matrixd theta = laws::random_parameters(layer, 1), x = some(width, tokens * samples, 2);
    CHECK(laws::relative_error(laws::output(layer, theta, x), definition(theta, x, norm)) < 1e-12);
  }
}

TEST_CASE("transformers obey the laws of modules") {
  laws::check_module<float>(Transformer<>(stack(NormOrder::before, 3, true)), tokens);
  laws::check_module<double>(Transformer<>(stack(NormOrder::after, 2, false)), tokens);
  laws::check_module<double>(Transformer<>(stack(NormOrder::before, 1, false)), tokens);
  laws::check_module<double>(Transformer<>(stack(NormOrder::before, 2, true)), tokens);
  laws::check_module<double>(TransformerLayer<>(shape(NormOrder::after)), tokens);
  laws::check_module<double>(Transformer<Relu>(stack(NormOrder::after, 2, true)), tokens);
}

TEST_CASE("gradients of transformers") {
  laws::check_gradient(Transformer<>(stack(NormOrder::before, 2, true)), tokens * samples);
  laws::check_gradient(Transformer<>(stack(NormOrder::after, 2, false)), tokens * samples);
  laws::check_gradient(Transformer<Relu>(stack(NormOrder::before, 1, false)), tokens * samples);
}

TEST_CASE("gradients of a masked transformer") {
  Mask keys = Mask::Constant(tokens, samples, true);
  keys(1, 0) = keys(0, 1) = keys(3, 1) = false;
  TransformerParameters p = stack(NormOrder::before, 2, true);
  p.layer.attention.causal = true;
  const Transformer<> m(p);
  laws::check_gradient(m, tokens * samples, [&](const double* theta, const auto& x, auto& w, const auto& y) {
    m.forward(theta, x, keys, w, y);
  });
}

TEST_CASE("a stack is its layers one after the other") {
  const Transformer<> m(stack(NormOrder::before, 3, true));
  const TransformerLayer<> layer(shape(NormOrder::before));
  const Matrixd theta = laws::random_parameters(m, 3), x = some(width, tokens * samples, 4);
  Matrixd y = x;
  for (Index l = 0; l < 3; ++l) y = laws::output(layer, theta.middleRows(l * layer.parameters(), layer.parameters()), y);
  y = laws::output(LayerNorm(width), theta.bottomRows(2 * width), y);
  CHECK(laws::equal(laws::output(m, theta, x), y));
}

TEST_CASE("a transformer does not see the order of the tokens, nor tokens that are masked") {
  const Transformer<> m(stack(NormOrder::before, 2, true));
  const Matrixd theta = laws::random_parameters(m, 5), x = some(width, tokens, 6);
  Eigen::PermutationMatrix<Eigen::Dynamic> order(tokens);
  order.indices() << 2, 0, 3, 1;
  CHECK(laws::relative_error(laws::output(m, theta, x * order), laws::output(m, theta, x) * order) < 1e-12);

  Mask keys = Mask::Constant(tokens, 1, true);
  keys(3, 0) = false;
  Matrixd other = x, y(width, tokens), y_other(width, tokens);
  other.col(3) *= -5;
  auto w = m.workspace<double>(tokens);
  m.forward(theta.data(), x, keys, w, y);
  m.infer(theta.data(), other, keys, w, y_other);
  CHECK(laws::equal(y.leftCols(3), y_other.leftCols(3)));
  CHECK(!laws::equal(y.leftCols(3), laws::output(m, theta, x).leftCols(3)));
}

TEST_CASE("tensors have PyTorch's names and shapes") {
  const Transformer<> m(stack(NormOrder::before, 2, true));
  std::vector<std::string> names;
  m.for_each_parameter([&](std::string_view name, Index, Index rows, Index cols) {
    names.push_back(std::string(name) + " " + std::to_string(rows) + "x" + std::to_string(cols));
  });
  REQUIRE(names.size() == 26);
  CHECK(names[0] == "layers.0.self_attn.in_proj_weight 18x6");
  CHECK(names[3] == "layers.0.self_attn.out_proj.bias 6x1");
  CHECK(names[4] == "layers.0.linear1.weight 7x6");
  CHECK(names[6] == "layers.0.linear2.weight 6x7");
  CHECK(names[23] == "layers.1.norm2.bias 6x1");
  CHECK(names[24] == "norm.weight 6x1");
}

TEST_CASE("a transformer refuses what its parts refuse, and no layers") {
  CHECK_THROWS_WITH_AS(Transformer<>(stack(NormOrder::before, 0, true)), "transformer: expected at least one layer, got 0",
                       traceur::Error);
  TransformerParameters p = stack(NormOrder::before, 1, true);
  p.layer.feed_forward = 0;
  CHECK_THROWS_AS(Transformer<>{p}, traceur::Error);
  p = stack(NormOrder::before, 1, true);
  p.layer.attention.heads = 4;
  CHECK_THROWS_AS(Transformer<>{p}, traceur::Error);
}

TEST_CASE("projected beforehand, the last tokens are those of the whole") {
  for (const NormOrder norm : {NormOrder::before, NormOrder::after}) {
    for (const Index layers : {1, 2, 3}) {
      for (const bool final_norm : {false, true}) {
        const Transformer<> m(stack(norm, layers, final_norm));
        const Matrixd theta = laws::random_parameters(m, 31), x = some(width, samples * tokens, 32);
        Mask keys = Mask::Constant(tokens, samples, true);
        keys(1, 1) = false;
        auto w = m.workspace<double>(x.cols());
        auto lean = m.inference_workspace<double>(x.cols());
        auto packed = m.packed<double>();
        m.pack(theta.data(), packed);
        Matrixd y(width, x.cols()), qkv(3 * width, x.cols());
        m.infer(theta.data(), x, keys, w, y);
        // In two pieces: what is projected of a token depends on that token alone.
        m.project(theta.data(), packed, x.leftCols(3), lean, qkv.leftCols(3));
        m.project(theta.data(), packed, x.rightCols(x.cols() - 3), lean, qkv.rightCols(x.cols() - 3));
        for (const Index from : {Index{0}, Index{1}, tokens - 1}) {
          Matrixd last(width, samples * (tokens - from));
          m.infer_projected(theta.data(), packed, x, qkv, keys, from, lean, last);
          for (Index sample = 0; sample < samples; ++sample) {
            CHECK(laws::equal(last.middleCols(sample * (tokens - from), tokens - from),
                              y.middleCols(sample * tokens + from, tokens - from)));
          }
        }
      }
    }
  }
}
