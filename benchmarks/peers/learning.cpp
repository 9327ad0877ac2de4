// SPDX-License-Identifier: MIT
// Learning from scratch. On one core: a pendulum is swung up after 307200 samples (4 environments x 1024 steps, batches of
// 256, 2 epochs, policy and value of 3 layers x 64 units), judged by the mean return of 200 fresh episodes of the mean
// action; a pole is balanced for 500 steps. Time is CPU seconds of one thread, rollouts and updates together, judging left
// out.
//
// No other library is run: the ratio is to a fixed bar of 600000 samples a second. The program fails if a pendulum earns
// less than -200 or a pole falls.
#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <exception>

#include <traceur/learn/cart_pole.hpp>
#include <traceur/learn/episodes.hpp>
#include <traceur/learn/pendulum.hpp>
#include <traceur/learn/ppo.hpp>

#include "../cpu_seconds.hpp"
#include "humanoid_throughput.hpp"

namespace {

using namespace traceur;
using namespace traceur::learn;

constexpr double pendulum_bar = 600000;  // samples a second
constexpr int seeds = 5;

struct Run {
  double seconds, mean_return, shortest;
};

template <class E>
Run run(const PpoParameters& p, Eigen::Index environments, std::int64_t samples, int judged, int steps) {
  E training(environments), fresh(judged);
  const Eigen::Index seen = training.observations(), actions = training.actions();
  Ppo<> ppo(nn::Mlp<>({seen, 64, 64, actions}), nn::Mlp<>({seen, 64, 64, 1}),
            nn::GaussianHead(actions, 1.0, nn::GaussianHead::Deviation::learned), environments, p);
  const double start = cpu_seconds();
  while (ppo.samples() < samples) ppo.iterate(training);
  const double seconds = cpu_seconds() - start;
  fresh.reset(p.seed + 1000);
  const EpisodeReport report = play_episodes<float>(
      fresh, [&](ConstColumns<float> x, Columns<float> a) { ppo.mean_action(x, a); }, steps);
  return {seconds, report.mean(), static_cast<double>(report.steps.minCoeff())};
}

PpoParameters pendulum(std::uint64_t seed) {
  PpoParameters p;
  p.seed = seed;
  p.steps = 1024;
  p.minibatch = 256;
  p.policy_rate = p.value_rate = 1e-3;
  p.chunks = 1;
  return p;
}

PpoParameters cart_pole(std::uint64_t seed) {
  PpoParameters p;
  p.seed = seed;
  p.steps = 64;
  p.minibatch = 256;
  p.epochs = 4;
  p.gamma = 0.99;
  p.reward_scale = 0.05;
  p.policy_rate = p.value_rate = 2e-3;
  p.chunks = 1;
  return p;
}

/// A humanoid's throughput, beside the least that is wanted.
struct Throughput {
  const char* name;
  humanoid_throughput::Setting setting;
  int updates;
  double bar;  // samples a second
};
constexpr Throughput throughputs[] = {{"samples_per_s_256_e2", {256, 128, 2}, 40, 65000},
                                      {"samples_per_s_256_e5", {256, 128, 5}, 25, 35000},
                                      {"samples_per_s_1024", {1024, 512, 5}, 4, 5000}};

void time_humanoids() {
  const humanoid_throughput::Scene scene;
  for (const Throughput& t : throughputs) {
    const humanoid_throughput::Shares s = scene.shares(t.setting, (t.updates + 1) / 2);
    const double rate = scene.samples_per_s(t.setting, t.updates, 2);
    std::printf("%s %.0f simulate %.3f observe_and_reward %.3f act_and_value %.3f update %.3f\n", t.name, rate, s.simulate,
                s.observe_and_reward, s.act_and_value, s.update);
    std::printf("ratio %s %.2f\n", t.name, rate / t.bar);
  }
}

}  // namespace

int main() try {
  std::array<double, seeds> rate{};
  bool learnt = true;
  for (int i = 0; i < seeds; ++i) {
    const auto seed = static_cast<std::uint64_t>(i + 1);
    const Run swing = run<Pendulum<float>>(pendulum(seed), 4, 307200, 200, 200);
    const Run balance = run<CartPole<float>>(cart_pole(seed), 16, 81920, 100, 500);
    rate[static_cast<std::size_t>(i)] = 307200 / swing.seconds;
    std::printf("seed %d pendulum_return %.1f pendulum_samples_per_s %.0f cart_pole_least_steps %.0f cart_pole_seconds %.2f\n",
                i + 1, swing.mean_return, 307200 / swing.seconds, balance.shortest, balance.seconds);
    learnt = learnt && swing.mean_return >= -200 && balance.shortest >= 500;
  }
  time_humanoids();
  std::nth_element(rate.begin(), rate.begin() + seeds / 2, rate.end());
  std::printf("pendulum_samples_per_s %.0f\n", rate[seeds / 2]);
  if (!learnt) {
    std::fprintf(stderr, "learning: a pendulum earned less than -200 or a pole fell\n");
    return 1;
  }
  std::printf("ratio pendulum_samples_per_s %.2f\n", rate[seeds / 2] / pendulum_bar);
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "learning: %s\n", error.what());
  return 1;
}
