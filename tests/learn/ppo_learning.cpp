// SPDX-License-Identifier: MIT
// Two classic tasks are learnt from scratch.
#include <traceur/learn/ppo.hpp>

#include <algorithm>
#include <array>

#include <doctest/doctest.h>

#include <traceur/learn/cart_pole.hpp>
#include <traceur/learn/episodes.hpp>
#include <traceur/learn/pendulum.hpp>

using namespace traceur;
using namespace traceur::learn;

namespace {

Ppo<> three_layers(Eigen::Index seen, int environments, const PpoParameters& p) {
  return Ppo<>(nn::Mlp<>({seen, 64, 64, 1}), nn::Mlp<>({seen, 64, 64, 1}),
               nn::GaussianHead(1, 1.0, nn::GaussianHead::Deviation::learned), environments, p);
}

template <class E>
EpisodeReport judge(Ppo<>& ppo, E&& fresh, int steps) {
  fresh.reset(12345);
  return play_episodes<float>(fresh, [&](ConstColumns<float> seen, Columns<float> action) { ppo.mean_action(seen, action); },
                              steps);
}

}  // namespace

TEST_CASE("a pendulum is swung up after 307200 samples") {
  // One run in twenty or so takes a detour, and which one depends on rounding.
  std::array<double, 3> reached{}, explained{};
  for (std::size_t k = 0; k < reached.size(); ++k) {
    PpoParameters p;
    p.seed = k + 1;
    p.steps = 1024;
    p.minibatch = 256;
    p.policy_rate = p.value_rate = 1e-3;
    Ppo<> ppo = three_layers(3, 4, p);
    Pendulum<float> environments(4);
    CHECK(judge(ppo, Pendulum<float>(200), 200).mean() < -1000);
    PpoReport report;
    while (ppo.samples() < 307200) report = ppo.iterate(environments);
    CHECK(ppo.samples() == 307200);
    reached[k] = judge(ppo, Pendulum<float>(200), 200).mean();
    explained[k] = report.explained_variance;
  }
  std::sort(reached.begin(), reached.end());
  std::sort(explained.begin(), explained.end());
  CHECK(reached[1] >= -200);
  CHECK(explained[1] > 0.9);
}

TEST_CASE("a pole is balanced for 500 steps from every start") {
  PpoParameters p;
  p.steps = 64;
  p.minibatch = 256;
  p.epochs = 4;
  p.gamma = 0.99;
  p.reward_scale = 0.05;
  p.policy_rate = p.value_rate = 2e-3;
  Ppo<> ppo = three_layers(4, 16, p);
  CartPole<float> environments(16);
  for (int i = 0; i < 80; ++i) ppo.iterate(environments);
  const EpisodeReport report = judge(ppo, CartPole<float>(100), 500);
  CHECK(report.steps.minCoeff() == 500);
}
