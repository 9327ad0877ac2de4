// SPDX-License-Identifier: MIT
// Networks beside libtorch's, in float on one thread, turn about in one process: a perceptron 200-1024-512-28 forward
// and backward on 4096 samples, forward on one, there also with weights in bfloat16; a transformer encoder (width 256, 4 layers, 4 heads, feed-forward 1024, 80
// tokens, 32 samples) forward by libtorch's fused layers. Times are CPU seconds of the thread, the least of all turns.
// libtorch multiplies with the system's BLAS: with the reference one it is several times slower than with OpenBLAS.
//
// Built on request only: cmake -DTRACEUR_LIBTORCH=ON.
#include <algorithm>
#include <cstdio>
#include <exception>
#include <vector>

#include <torch/torch.h>

#include <traceur/core/random.hpp>
#include <traceur/nn/compact_mlp.hpp>
#include <traceur/nn/mlp.hpp>
#include <traceur/nn/transformer.hpp>

#include "../cpu_seconds.hpp"

namespace {

using namespace traceur;
using torch::Tensor;

/// Seconds of one call of each, the least of `turns`, each turn `calls` calls.
struct Times {
  double ours = 1e9, theirs = 1e9;
};
template <class A, class B>
Times measure(int turns, int calls, A&& ours, B&& theirs) {
  Times t;
  const auto time = [&](auto& f) {
    const double start = cpu_seconds();
    for (int k = 0; k < calls; ++k) f();
    return (cpu_seconds() - start) / calls;
  };
  for (int k = 0; k < turns; ++k) {
    t.ours = std::min(t.ours, time(ours));
    t.theirs = std::min(t.theirs, time(theirs));
  }
  return t;
}

void report(const char* name, const Times& t, double scale, const char* unit) {
  std::printf("%s ours_%s %.3f libtorch_%s %.3f\n", name, unit, scale * t.ours, unit, scale * t.theirs);
}

Eigen::MatrixXf normal(Eigen::Index rows, Eigen::Index columns) {
  core::RandomStream random(1);
  Eigen::MatrixXf m(rows, columns);
  for (Eigen::Index i = 0; i < m.size(); ++i) m.data()[i] = random.normal<float>();
  return m;
}

/// Columns of ours are rows of theirs.
Tensor rows(Eigen::MatrixXf& m) { return torch::from_blob(m.data(), {m.cols(), m.rows()}); }

}  // namespace

int main() try {
  torch::set_num_threads(1);
  const std::vector<Eigen::Index> widths{200, 1024, 512, 28};
  const nn::Mlp<> mlp(widths);
  core::RandomStream random(2);
  Eigen::VectorXf theta(mlp.parameters()), gradient = Eigen::VectorXf::Zero(mlp.parameters());
  mlp.initialize(theta.data(), random);
  torch::nn::Sequential peer(torch::nn::Linear(200, 1024), torch::nn::ReLU(), torch::nn::Linear(1024, 512),
                             torch::nn::ReLU(), torch::nn::Linear(512, 28));

  Eigen::MatrixXf x = normal(200, 4096), dy = normal(28, 4096), y(28, 4096);
  auto w = mlp.workspace<float>(4096);
  Tensor x_peer = rows(x), dy_peer = rows(dy);
  const Times train = measure(
      5, 1,
      [&] {
        mlp.forward<float>(theta.data(), x, w, y);
        mlp.backward<float>(theta.data(), x, dy, w, gradient.data(), nn::no_gradient<float>());
      },
      [&] { peer->forward(x_peer).backward(dy_peer); });
  report("mlp_train", train, 1e3, "ms");

  Eigen::MatrixXf one = normal(200, 1), out(28, 1);
  auto small = mlp.workspace<float>(1);
  Tensor one_peer = rows(one);
  torch::NoGradGuard guard;
  const Times infer = measure(
      20, 200, [&] { mlp.infer<float>(theta.data(), one, small, out); }, [&] { peer->forward(one_peer); });
  report("mlp_infer", infer, 1e6, "us");
  const nn::CompactMlp<> compact(mlp, theta.data());
  auto compact_memory = compact.workspace();
  const Times compact_infer = measure(
      20, 200, [&] { compact.infer(one.data(), compact_memory, out.data()); }, [&] { peer->forward(one_peer); });
  report("mlp_infer_compact", compact_infer, 1e6, "us");

  nn::TransformerParameters p;
  p.layers = 4;
  p.layer.attention.width = 256;
  p.layer.attention.heads = 4;
  p.layer.attention.tokens = 80;
  p.layer.feed_forward = 1024;
  p.layer.norm = nn::NormOrder::after;
  p.final_norm = false;
  const nn::Transformer<nn::Relu> transformer(p);
  Eigen::VectorXf weights(transformer.parameters());
  transformer.initialize(weights.data(), random);
  Eigen::MatrixXf tokens = normal(256, 80 * 32), mixed(256, 80 * 32);
  auto memory = transformer.inference_workspace<float>(tokens.cols());
  const Tensor tokens_peer = rows(tokens).reshape({32, 80, 256});
  // The layers are alike, so one set of weights is as good as four.
  const Tensor in = 0.05 * torch::randn({768, 256}), in_bias = torch::zeros({768}),
               proj = 0.05 * torch::randn({256, 256}), bias = torch::zeros({256}), one_each = torch::ones({256}),
               up = 0.05 * torch::randn({1024, 256}), up_bias = torch::zeros({1024}),
               down = 0.05 * torch::randn({256, 1024});
  const Times encode = measure(
      5, 1, [&] { transformer.infer<float>(weights.data(), tokens, memory, mixed); },
      [&] {
        Tensor h = tokens_peer;
        for (int layer = 0; layer < 4; ++layer)
          h = at::_transformer_encoder_layer_fwd(h, 256, 4, in, in_bias, proj, bias, false, false, 1e-5, one_each, bias,
                                                 one_each, bias, up, up_bias, down, bias);
      });
  report("transformer", encode, 1e3, "ms");

  std::printf("ratio mlp_train_libtorch %.2f\n", train.theirs / train.ours);
  std::printf("ratio mlp_infer_libtorch %.2f\n", infer.theirs / infer.ours);
  std::printf("ratio mlp_infer_compact_libtorch %.2f\n", compact_infer.theirs / compact_infer.ours);
  std::printf("ratio transformer_libtorch %.2f\n", encode.theirs / encode.ours);
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "networks: %s\n", error.what());
  return 1;
}
