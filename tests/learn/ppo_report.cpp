// SPDX-License-Identifier: MIT
#include <traceur/learn/ppo_report.hpp>

#include <cmath>
#include <limits>
#include <numbers>

#include <doctest/doctest.h>

#include <traceur/learn/ppo.hpp>

using namespace traceur;
using namespace traceur::learn;
using doctest::Approx;

namespace {

constexpr int count = 8, length = 5, steps = 20;

/// Every step earns as much as the last, every episode has the same length; a step may give a number that is not finite.
struct Metronome {
  float pay = 2;
  int lost = -1;  ///< the step of the run in which environment 0 does
  int ticks = 0;
  Eigen::VectorXi age = Eigen::VectorXi::Zero(count);

  Eigen::Index environments() const { return count; }
  Eigen::Index observations() const { return 1; }
  Eigen::Index actions() const { return 1; }
  void reset(std::uint64_t) { age.setZero(); }
  void restart(Eigen::Index e) noexcept { age[e] = 0; }
  void observe(Columns<float> out) const noexcept { out = age.cast<float>().transpose(); }
  void step(ConstColumns<float>, StepResult<float>& result) noexcept {
    for (Eigen::Index e = 0; e < count; ++e) {
      result.reward[e] = pay;
      if (++age[e] == length) result.end[e] = e % 2 == 0 ? End::terminated : End::timed_out;
    }
    if (ticks++ == lost) result.reward[0] = std::numeric_limits<float>::quiet_NaN();
  }
};

Ppo<> make() {
  PpoParameters p;
  p.steps = steps;
  p.minibatch = count * steps;
  p.epochs = 3;
  return {nn::Mlp<>({1, 4, 1}), nn::Mlp<>({1, 6, 1}), nn::GaussianHead(1, 0.5), count, p};
}

}  // namespace

TEST_CASE("a report's numbers are those of the rollout: what was earned, by step and by episode") {
  Metronome environments;
  Ppo<> ppo = make();
  const PpoReport r = ppo.iterate(environments);
  CHECK(r.terminated + r.timed_out == count * steps / length);
  CHECK(r.terminated == r.timed_out);
  CHECK(r.failed == 0);
  CHECK(r.samples == count * steps);
  CHECK(r.epochs == 3);
  CHECK(r.episode_steps == length);
  CHECK(r.reward == Approx(environments.pay));
  CHECK(r.episode_return == Approx(r.episode_steps * r.reward));
  CHECK(r.clip_fraction >= 0);
  CHECK(r.clip_fraction <= 1);
  CHECK(r.value_loss > 0);
  CHECK(r.explained_variance <= 1);
  CHECK(r.policy_rate == ppo.parameters().policy_rate);
  // Of a normal distribution of deviation 1/2.
  CHECK(r.entropy == Approx(0.5 * std::log(2 * std::numbers::pi * std::numbers::e * 0.25)));
}

TEST_CASE("a step that is not finite is counted apart from those learnt from") {
  Metronome environments;
  environments.lost = steps + 7;  // the first rollout is the normaliser's
  Ppo<> ppo = make();
  const PpoReport r = ppo.iterate(environments);
  CHECK(r.failed == 1);
  CHECK(r.samples + r.failed == count * steps);
  CHECK(std::isfinite(r.reward));
  CHECK(r.episode_steps == length);
}

TEST_CASE("a state counts updates, steps of the environments and of the optimizers") {
  Metronome environments;
  Ppo<> ppo = make();
  const int updates = 4;
  for (int k = 0; k < updates; ++k) ppo.iterate(environments);
  const PpoState<float> s = ppo.state();
  CHECK(s.updates == updates);
  CHECK(s.ticks == (updates + 1) * steps);
  CHECK(s.ticks * count == ppo.samples());
  CHECK(s.policy_steps == 3 * updates);  // one minibatch an epoch
  CHECK(s.value_steps == s.policy_steps);
  CHECK(s.policy.size() == ppo.policy().parameters() + ppo.head().parameters());
  CHECK(s.value.size() == ppo.value().parameters());
  CHECK(s.policy_rate == ppo.policy_rate());
}

TEST_CASE("before anything was done everything is nothing") {
  const PpoReport r;
  for (const double x : {r.reward, r.episode_return, r.episode_steps, r.surrogate, r.value_loss, r.divergence, r.clip_fraction,
                         r.explained_variance, r.entropy, r.policy_gradient, r.value_gradient, r.policy_rate})
    CHECK(x == 0);
  CHECK(r.terminated + r.timed_out + r.failed + r.epochs == 0);
  CHECK(r.samples == 0);
  const PpoState<double> s;
  CHECK(s.policy.size() + s.value.size() + s.policy_optimizer.size() + s.value_optimizer.size() + s.normalizer.size() == 0);
  CHECK(s.policy_steps + s.value_steps + s.updates + s.ticks == 0);
  CHECK(s.policy_rate == 0);
}
