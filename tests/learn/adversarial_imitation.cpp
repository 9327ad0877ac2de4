// SPDX-License-Identifier: MIT
#include <traceur/learn/adversarial_imitation.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <doctest/doctest.h>

#include <traceur/learn/ppo.hpp>

using namespace traceur;
using namespace traceur::learn;

namespace {

constexpr int steps = 16;

/// A point on a line whose speed is the action; style is its last two speeds.
struct Glider {
  Eigen::Index count;
  bool poisoned = false;
  std::uint64_t seed = 0;
  Eigen::VectorXf place;
  Eigen::MatrixXf speeds;

  explicit Glider(Eigen::Index n) : count(n), place(n), speeds(2, n) { reset(0); }
  Eigen::Index environments() const { return count; }
  Eigen::Index observations() const { return 1; }
  Eigen::Index actions() const { return 1; }
  Eigen::Index style_features() const { return 2; }
  void reset(std::uint64_t s) {
    seed = s;
    for (Eigen::Index e = 0; e < count; ++e) restart(e);
  }
  void restart(Eigen::Index e) noexcept {
    core::RandomStream random(seed, static_cast<std::uint64_t>(e));
    place[e] = random.uniform<float>(-1, 1);
    speeds.col(e).setZero();
  }
  void observe(Columns<float> out) const { out = place.transpose() * 0.01f; }
  void observe_style(Columns<float> out) const { out = speeds; }
  void step(ConstColumns<float> actions, StepResult<float>& result) {
    for (Eigen::Index e = 0; e < count; ++e) {
      speeds(0, e) = speeds(1, e);
      speeds(1, e) = actions(0, e);
      place[e] += 0.1f * actions(0, e);
      result.reward[e] = 0.25f;
      if (std::abs(place[e]) > 20) result.end[e] = End::terminated;
      if (poisoned && e == 3) speeds(1, e) = std::numeric_limits<float>::quiet_NaN();
    }
  }
};
static_assert(StyledEnvironments<Glider>);

/// Moves at 0.7, give or take what the policy gives or takes too.
struct Even {
  bool broken = false;
  std::array<float, 2> sample(core::RandomStream& random) const {
    if (broken) return {std::numeric_limits<float>::quiet_NaN(), 0};
    return {random.normal<float>(0.7f, 0.2f), random.normal<float>(0.7f, 0.2f)};
  }
};
static_assert(StyleReference<Even>);
static_assert(!StyleReference<Glider>);

struct Run {
  Glider glider{32};
  Ppo<> ppo;
  AdversarialImitation<> imitation;

  static PpoParameters policy() {
    PpoParameters p;
    p.steps = steps;
    p.minibatch = 128;
    p.gamma = 0.5;
    p.policy_rate = 3e-3;
    return p;
  }
  static AdversarialParameters settings() {
    AdversarialParameters p;
    p.task_weight = 0.1;
    p.minibatch = 64;
    p.replay_capacity = 300;
    p.replay_kept = 20;
    p.rate = 3e-3;
    return p;
  }
  Run() : Run(settings()) {}
  explicit Run(const AdversarialParameters& p)
      : ppo(nn::Mlp<>({1, 16, 1}), nn::Mlp<>({1, 16, 1}), nn::GaussianHead(1, 0.2), 32, policy()),
        imitation(Discriminator<>(nn::Mlp<>({2, 16, 1}), {1, 0.01, 1e-4}), 32 * steps, p) {}
};

}  // namespace

TEST_CASE("a policy with no other wish comes to move as the data does") {
  Run run;
  core::SerialExecutor serial;
  AdversarialReport last;
  double told_apart = 0;
  for (int k = 0; k < 150; ++k) {
    last = run.imitation.iterate(run.ppo, run.glider, Even{}, serial);
    told_apart = std::max(told_apart, last.real_accuracy + last.fake_accuracy);
  }
  Eigen::MatrixXf seen = Eigen::MatrixXf::Zero(1, 1), action(1, 1);
  run.ppo.mean_action(seen, action);
  CHECK(action(0, 0) == doctest::Approx(0.7).epsilon(0.2));
  // What cannot be told apart any more is taken for either as often, and earns log 2.
  CHECK(last.style_reward == doctest::Approx(std::log(2.0)).epsilon(0.4));
  CHECK(told_apart > 1.15);
  CHECK(last.real_accuracy + last.fake_accuracy < 1.15);
  CHECK(last.task_reward == doctest::Approx(0.25).epsilon(0.02));
  CHECK(run.imitation.replay().size() == 300);
  CHECK(last.gradient > 0);
}

TEST_CASE("rewards are the weighted sum, and steps that end an episode for good earn no style") {
  AdversarialParameters p = Run::settings();
  p.task_weight = 2;
  p.style_weight = 0;
  p.minibatches = 1;
  Run run(p);
  core::SerialExecutor serial;
  run.imitation.iterate(run.ppo, run.glider, Even{}, serial);
  CHECK(run.ppo.rollout().reward.isApprox(Eigen::MatrixXf::Constant(steps, 32, 0.5f)));
}

TEST_CASE("the same bits on any number of threads, and after going on from a saved state") {
  core::SerialExecutor serial;
  core::ThreadExecutor two(2);
  Run a, b, c;
  for (int k = 0; k < 6; ++k) a.imitation.iterate(a.ppo, a.glider, Even{}, serial);
  for (int k = 0; k < 6; ++k) b.imitation.iterate(b.ppo, b.glider, Even{}, two);
  CHECK(a.imitation.theta() == b.imitation.theta());
  CHECK(a.ppo.policy_parameters() == b.ppo.policy_parameters());
  c.ppo.restore(a.ppo.state());
  c.imitation.restore(a.imitation.state());
  a.ppo.restore(a.ppo.state());  // episodes begin anew
  a.imitation.iterate(a.ppo, a.glider, Even{}, serial);
  c.imitation.iterate(c.ppo, c.glider, Even{}, serial);
  CHECK(a.imitation.theta() == c.imitation.theta());
  CHECK(a.ppo.policy_parameters() == c.ppo.policy_parameters());
  CHECK(a.imitation.state().replay == c.imitation.state().replay);
  AdversarialState<float> bad = a.imitation.state();
  bad.discriminator[3] = std::numeric_limits<float>::quiet_NaN();
  CHECK_THROWS_AS(c.imitation.restore(bad), Error);
  bad = a.imitation.state();
  bad.discriminator.conservativeResize(5);
  CHECK_THROWS_AS(c.imitation.restore(bad), Error);
}

TEST_CASE("histories that are not finite teach nothing and earn nothing; data that is not finite stops with the layer's name") {
  core::SerialExecutor serial;
  Run run;
  run.glider.poisoned = true;
  for (int k = 0; k < 3; ++k) run.imitation.iterate(run.ppo, run.glider, Even{}, serial);
  CHECK(run.imitation.theta().allFinite());
  CHECK(run.imitation.state().replay.allFinite());
  CHECK(run.ppo.policy_parameters().allFinite());
  const Eigen::VectorXf before = run.imitation.theta();
  CHECK_THROWS_WITH_AS(run.imitation.iterate(run.ppo, run.glider, Even{true}, serial),
                       "adversarial imitation, update 4: discriminator gradient: layers.0.weight(0, 0) is nan", Error);
  CHECK(run.imitation.theta() == before);
}

TEST_CASE("sizes and settings that do not fit are refused") {
  Run run;
  core::SerialExecutor serial;
  AdversarialImitation<> other(Discriminator<>(nn::Mlp<>({3, 4, 1})), 32 * steps, Run::settings());
  CHECK_THROWS_WITH_AS(other.iterate(run.ppo, run.glider, Even{}, serial),
                       "adversarial imitation: expected histories of 3 numbers and rollouts of 512 samples, got 2 and 512", Error);
  AdversarialParameters p;
  p.replay_share = 2;
  CHECK_THROWS_AS(Run{p}, Error);
  p = {};
  p.minibatches = 0;
  CHECK_THROWS_AS(Run{p}, Error);
  p = {};
  p.rate = -1;
  CHECK_THROWS_WITH_AS(Run{p}, "adversarial imitation: rate must be zero or more", Error);
}
