// SPDX-License-Identifier: MIT
// The layers and optimizers beside libtorch's, in float: outputs, gradients and steps within 1e-5 of the largest number
// compared. Built on request only (see tests/CMakeLists.txt): libtorch's headers alone take a minute.
#include <traceur/nn/attention.hpp>

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <torch/torch.h>
// Both libraries have macros of these names.
#undef CHECK
#undef CHECK_EQ
#undef CHECK_NE
#undef CHECK_LT
#undef CHECK_LE
#undef CHECK_GT
#undef CHECK_GE
#include <doctest/doctest.h>

#include <traceur/nn/convolution.hpp>
#include <traceur/nn/layer_norm.hpp>
#include <traceur/nn/mlp.hpp>
#include <traceur/nn/optimizer.hpp>
#include <traceur/nn/transformer.hpp>

namespace nn = traceur::nn;
using Matrix = Eigen::MatrixXf;
using Vector = Eigen::VectorXf;
using torch::Tensor;
using traceur::core::RandomStream;

namespace {

/// Columns of ours are rows of theirs, and share the memory.
Tensor rows(const Matrix& m) { return torch::from_blob(const_cast<float*>(m.data()), {m.cols(), m.rows()}).clone(); }

/// A tensor of ours, stored by columns.
Tensor weight(const float* from, Eigen::Index height, Eigen::Index width) {
  return torch::from_blob(const_cast<float*>(from), {width, height}).t().contiguous();
}

Matrix normal(RandomStream& random, Eigen::Index height, Eigen::Index width) {
  Matrix m(height, width);
  for (Eigen::Index i = 0; i < m.size(); ++i) m.data()[i] = random.normal<float>();
  return m;
}

/// The largest difference, over the largest of theirs or 1.
double difference(const Tensor& ours, const Tensor& theirs) {
  const Tensor plain = theirs.detach().reshape(ours.sizes());
  return ((ours - plain).abs().max() / plain.abs().max().clamp_min(1.0)).item<double>();
}

/// Puts our parameters into their module by name, runs both forward and backward on the same numbers, and compares
/// output, gradient by the input and gradient by every parameter.
template <class M, class F>
void compare(const M& ours, torch::nn::Module& theirs, Eigen::Index columns, F&& run) {
  RandomStream random(3);
  Vector theta(ours.parameters()), gradient = Vector::Zero(ours.parameters());
  ours.initialize(theta.data(), random);
  // Biases and norms that are not zero and one.
  for (Eigen::Index i = 0; i < theta.size(); ++i) theta[i] += 0.05f * random.normal<float>();
  const Matrix x = normal(random, ours.inputs(), columns), dy = normal(random, ours.outputs(), columns);
  Matrix y(ours.outputs(), columns), dx(ours.inputs(), columns);
  auto w = ours.template workspace<float>(columns);
  ours.template forward<float>(theta.data(), x, w, y);
  ours.template backward<float>(theta.data(), x, dy, w, gradient.data(), dx);

  auto parameters = theirs.named_parameters();
  int found = 0;
  {
    torch::NoGradGuard guard;
    ours.for_each_parameter([&](std::string_view name, Eigen::Index offset, Eigen::Index height, Eigen::Index width) {
      Tensor* parameter = parameters.find(std::string(name));
      REQUIRE_MESSAGE(parameter != nullptr, name);
      parameter->copy_(weight(theta.data() + offset, height, width).reshape(parameter->sizes()));
      ++found;
    });
  }
  CHECK(found == static_cast<int>(parameters.size()));
  Tensor in = rows(x).requires_grad_(true);
  const Tensor out = run(in);
  CHECK(difference(rows(y), out) < 1e-5);
  (out.reshape({columns, ours.outputs()}) * rows(dy)).sum().backward();
  CHECK(difference(rows(dx), in.grad()) < 1e-5);
  ours.for_each_parameter([&](std::string_view name, Eigen::Index offset, Eigen::Index height, Eigen::Index width) {
    CAPTURE(name);
    CHECK(difference(weight(gradient.data() + offset, height, width), parameters.find(std::string(name))->grad()) <
          1e-5);
  });
}

struct Layers : torch::nn::Module {
  torch::nn::ModuleList layers;
  Layers() { register_module("layers", layers); }
};

template <class Activation>
void compare_mlp(Tensor (*activation)(const Tensor&)) {
  const std::vector<Eigen::Index> widths{19, 64, 33, 7};
  Layers theirs;
  for (std::size_t i = 0; i + 1 < widths.size(); ++i)
    theirs.layers->push_back(torch::nn::Linear(widths[i], widths[i + 1]));
  compare(nn::Mlp<Activation>(widths), theirs, 50, [&](const Tensor& x) {
    Tensor h = x;
    for (std::size_t i = 0; i < 3; ++i) {
      h = theirs.layers[i]->as<torch::nn::Linear>()->forward(h);
      if (i < 2) h = activation(h);
    }
    return h;
  });
}

/// Ours: samples, tokens, features; theirs: tokens, samples, features.
Tensor by_tokens(const Tensor& x, std::int64_t tokens) {
  return x.reshape({x.size(0) / tokens, tokens, x.size(1)}).transpose(0, 1);
}

template <class Ours, class Theirs>
void compare_steps(Ours& ours, Theirs& theirs, Tensor& theta, double rate) {
  RandomStream random(5);
  Vector mine = Eigen::Map<const Vector>(theta.data_ptr<float>(), theta.numel());
  for (int step = 0; step < 50; ++step) {
    const Matrix g = normal(random, mine.size(), 1);
    ours.step(mine, g, rate);
    theta.mutable_grad() = rows(g).reshape(theta.sizes());
    theirs.step();
  }
  CHECK(difference(rows(mine), theta) < 1e-5);
}

}  // namespace

TEST_CASE("libtorch: perceptrons") {
  compare_mlp<nn::Relu>([](const Tensor& z) { return torch::relu(z); });
  compare_mlp<nn::Tanh>([](const Tensor& z) { return torch::tanh(z); });
  compare_mlp<nn::Silu>([](const Tensor& z) { return torch::silu(z); });
  compare_mlp<nn::Gelu>([](const Tensor& z) { return torch::gelu(z); });
  compare_mlp<nn::LeakyRelu<>>([](const Tensor& z) { return torch::leaky_relu(z); });
}

TEST_CASE("libtorch: layer norm") {
  torch::nn::LayerNorm theirs(torch::nn::LayerNormOptions({70}));
  compare(nn::LayerNorm(70), *theirs, 33, [&](const Tensor& x) { return theirs->forward(x); });
}

TEST_CASE("libtorch: convolution") {
  for (const int stride : {1, 2}) {
    const nn::Convolution ours({3, 12, 9, 17, 3, stride, 1});
    torch::nn::Conv2d theirs(torch::nn::Conv2dOptions(3, 17, 3).stride(stride).padding(1));
    compare(ours, *theirs, 5, [&](const Tensor& x) { return theirs->forward(x.reshape({5, 3, 12, 9})); });
  }
}

TEST_CASE("libtorch: attention, with and without the future") {
  for (const bool causal : {false, true}) {
    constexpr int tokens = 13, width = 48;
    nn::Attention::Parameters p;
    p.width = width;
    p.heads = 4;
    p.tokens = tokens;
    p.causal = causal;
    torch::nn::MultiheadAttention theirs(torch::nn::MultiheadAttentionOptions(width, 4));
    const Tensor mask = torch::triu(torch::full({tokens, tokens}, -INFINITY), 1);
    compare(nn::Attention(p), *theirs, 3 * tokens, [&](const Tensor& x) {
      const Tensor t = by_tokens(x, tokens);
      return std::get<0>(theirs->forward(t, t, t, {}, true, causal ? mask : Tensor())).transpose(0, 1).contiguous();
    });
  }
}

TEST_CASE("libtorch: a transformer layer with its norms after") {
  constexpr int tokens = 11, width = 32;
  nn::TransformerLayerParameters p;
  p.attention.width = width;
  p.attention.heads = 4;
  p.attention.tokens = tokens;
  p.feed_forward = 64;
  p.norm = nn::NormOrder::after;
  torch::nn::TransformerEncoderLayer theirs(
      torch::nn::TransformerEncoderLayerOptions(width, 4).dim_feedforward(64).dropout(0).activation(torch::kGELU));
  compare(nn::TransformerLayer<nn::Gelu>(p), *theirs, 4 * tokens,
          [&](const Tensor& x) { return theirs->forward(by_tokens(x, tokens)).transpose(0, 1).contiguous(); });
}

TEST_CASE("libtorch: Adam, AdamW and momentum") {
  const auto start = [] {
    RandomStream random(4);
    return rows(normal(random, 300, 1)).reshape({300}).requires_grad_(true);
  };
  {
    Tensor theta = start();
    nn::Adam<float> ours(300);
    torch::optim::Adam theirs({theta}, torch::optim::AdamOptions(1e-2));
    compare_steps(ours, theirs, theta, 1e-2);
  }
  {
    Tensor theta = start();
    nn::Adam<float> ours(300, {0.9, 0.99, 1e-6, 0.1});
    torch::optim::AdamW theirs({theta},
                               torch::optim::AdamWOptions(1e-2).betas({0.9, 0.99}).eps(1e-6).weight_decay(0.1));
    compare_steps(ours, theirs, theta, 1e-2);
  }
  {
    Tensor theta = start();
    nn::Sgd<float> ours(300, {0.9, 0.01});
    torch::optim::SGD theirs({theta}, torch::optim::SGDOptions(1e-2).momentum(0.9).weight_decay(0.01));
    compare_steps(ours, theirs, theta, 1e-2);
  }
}
