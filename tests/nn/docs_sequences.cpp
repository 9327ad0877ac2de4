// SPDX-License-Identifier: MIT
// The snippets of docs/nn.md about sequences, images and points, compiled and run. Keep the two alike.
#include <traceur/nn/transformer.hpp>

#include <doctest/doctest.h>

#include <traceur/nn/activation.hpp>
#include <traceur/nn/convolution.hpp>
#include <traceur/nn/dense.hpp>
#include <traceur/nn/folded.hpp>
#include <traceur/nn/mlp.hpp>
#include <traceur/nn/patches.hpp>
#include <traceur/nn/point_net.hpp>
#include <traceur/nn/positions.hpp>
#include <traceur/nn/sequential.hpp>

TEST_CASE("a transformer over tokens, some of them left out") {
  using namespace traceur::nn;

  TransformerParameters shape;
  shape.layers = 2;
  shape.layer = {{.width = 16, .heads = 2, .tokens = 10, .causal = false, .pattern = {}}, 32, NormOrder::before};
  const Transformer<Gelu> transformer(shape);

  traceur::core::RandomStream random(7);
  Eigen::VectorXf theta(transformer.parameters()), gradient = Eigen::VectorXf::Zero(transformer.parameters());
  transformer.initialize(theta.data(), random);

  const Eigen::Index samples = 3;
  Eigen::MatrixXf x = Eigen::MatrixXf::Random(16, samples * 10), y(16, samples * 10), dx(16, samples * 10);
  Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic> keys(10, samples);  // a column a sample
  keys.setConstant(true);
  keys.col(1).tail(4).setConstant(false);  // the second sample has six tokens

  auto workspace = transformer.workspace<float>(x.cols());
  transformer.forward(theta.data(), x, keys, workspace, y);
  transformer.backward(theta.data(), x, y, workspace, gradient.data(), dx);  // of the loss |y|^2 / 2

  CHECK(y.allFinite());
  CHECK(gradient.allFinite());
  CHECK(dx.allFinite());
}

TEST_CASE("a height map as tokens") {
  using namespace traceur::nn;

  using Rectifier = Folded<Mlp<LeakyRelu<>>>;
  const Patches patches(8, 12, 12, 4);
  const Sequential terrain(Convolution({.channels = 1, .height = 16, .width = 16, .filters = 8, .kernel = 5}), patches,
                           Rectifier(Mlp<LeakyRelu<>>({patches.features(), 32, 16}), patches.tokens()));

  CHECK(terrain.inputs() == 16 * 16);
  CHECK(terrain.outputs() == 9 * 16);  // nine tokens of width 16 below each other
}

TEST_CASE("points as a set") {
  using namespace traceur::nn;

  const PointNet<Mlp<>> cloud(Mlp<>({3, 32, 16}), 50);  // 50 points of 3 numbers to 16 features

  CHECK(cloud.inputs() == 150);
  CHECK(cloud.outputs() == 16);
}

TEST_CASE("positions and the step of a diffusion") {
  using namespace traceur::nn;

  const Sequential step(StepEmbedding(16), Mlp<Silu>({16, 32, 16}));
  const SinusoidalPositions positions(16, 10);

  CHECK(step.inputs() == 1);
  CHECK(step.outputs() == 16);
  CHECK(positions.tokens() == 10);
  CHECK(sinusoid(0.0, 1, 16) == 1.0);
}
