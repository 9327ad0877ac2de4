// SPDX-License-Identifier: MIT
#include <traceur/learn/ppo.hpp>

#include <cmath>
#include <limits>
#include <numeric>
#include <string>

#include <doctest/doctest.h>

#include "../nn/allocations.hpp"

using namespace traceur;
using namespace traceur::learn;
using doctest::Approx;
using Deviation = nn::GaussianHead::Deviation;

namespace {

constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();

/// An action is worth most when it equals a number seen; the second number seen is of no use. Episodes end in turn.
struct Guess {
  Eigen::Index count;
  int length = 6;
  End ends = End::timed_out;
  double worth = 0;                   ///< earned in any case
  double cost = 1;                    ///< of the squared error
  Eigen::Index poisoned = -1;         ///< an environment whose state is lost in step 3 of its second episode
  bool poisoned_reward = false;       ///< or only its reward
  bool poisoned_start = false;
  std::uint64_t seed = 0;
  Eigen::VectorXi age, episode;
  Eigen::MatrixXd x;

  explicit Guess(Eigen::Index n) : count(n), age(n), episode(n), x(2, n) { reset(0); }
  Eigen::Index environments() const { return count; }
  Eigen::Index observations() const { return 2; }
  Eigen::Index actions() const { return 1; }
  void reset(std::uint64_t s) {
    seed = s;
    episode.setConstant(-1);
    for (Eigen::Index e = 0; e < count; ++e) restart(e);
  }
  void restart(Eigen::Index e) noexcept {
    ++episode[e];
    // Staggered, so that ends do not come together.
    age[e] = episode[e] == 0 ? static_cast<int>(e) % length : 0;
    draw(e);
    if (poisoned_start && e == poisoned) x(0, e) = not_a_number;
  }
  void draw(Eigen::Index e) noexcept {
    core::RandomStream random(seed, static_cast<std::uint64_t>(e), static_cast<std::uint64_t>(episode[e] * 1000 + age[e]));
    x(0, e) = random.normal(3.0, 2.0);
    x(1, e) = random.normal();
  }
  void observe(Columns<double> out) const noexcept { out = x; }
  void step(ConstColumns<double> actions, StepResult<double>& result) noexcept {
    for (Eigen::Index e = 0; e < count; ++e) {
      const double off = actions(0, e) - (x(0, e) - 3) * 0.2;
      result.reward[e] = worth - cost * off * off;
      ++age[e];
      draw(e);
      if (age[e] >= length) result.end[e] = ends;
      if (e == poisoned && episode[e] == 1 && age[e] == 3) {
        if (poisoned_reward) {
          result.reward[e] = not_a_number;
        } else {
          x(1, e) = not_a_number;
        }
      }
    }
  }
};

using Net = nn::Mlp<nn::Tanh>;
using Learner = Ppo<double, Net, Net>;

Learner make(Eigen::Index environments, const PpoParameters& p, Eigen::Index policy_sees = 2) {
  return Learner(Net({policy_sees, 8, 8, 1}), Net({2, 8, 1}), nn::GaussianHead(1, 0.4, Deviation::learned), environments, p);
}

PpoParameters small() {
  PpoParameters p;
  p.steps = 20;
  p.minibatch = 32;
  p.epochs = 3;
  p.policy_rate = p.value_rate = 3e-3;
  p.output_scale = 1;
  return p;
}

bool same(const PpoState<double>& a, const PpoState<double>& b) {
  return a.policy == b.policy && a.value == b.value && a.policy_optimizer == b.policy_optimizer &&
         a.value_optimizer == b.value_optimizer && a.normalizer == b.normalizer && a.updates == b.updates && a.ticks == b.ticks;
}

}  // namespace

TEST_CASE("the policy's gradient is that of its loss") {
  PpoParameters p = small();
  p.minibatch = 100;
  p.entropy_weight = 0.03;
  p.bound_penalty = 0.7;
  p.action_bound = 0.1;
  auto ppo = make(5, p);
  Guess environments(5);
  core::SerialExecutor serial;
  ppo.collect(environments, serial);
  ppo.prepare();
  // Away from the policy that acted, so that some ratios are clipped.
  core::RandomStream random(3);
  for (double& x : ppo.policy_parameters()) x += 0.05 * random.normal();
  std::vector<std::int32_t> which(100);
  std::iota(which.begin(), which.end(), 0);
  Eigen::VectorXd gradient = Eigen::VectorXd::Zero(ppo.policy_parameters().size()), scratch = gradient;
  ppo.policy_loss(serial, which, gradient);
  const double h = 1e-6;
  for (Eigen::Index i = 0; i < gradient.size(); ++i) {
    double& x = ppo.policy_parameters()[i];
    const double at = x;
    x = at + h;
    const double above = ppo.policy_loss(serial, which, scratch);
    x = at - h;
    const double below = ppo.policy_loss(serial, which, scratch);
    x = at;
    CHECK(gradient[i] == Approx((above - below) / (2 * h)).epsilon(1e-5).scale(0.01));
  }
}

TEST_CASE("policy and value improve on a task with a known best answer") {
  PpoParameters p = small();
  p.policy_rate = p.value_rate = 1e-2;
  auto ppo = make(32, p);
  Guess environments(32);
  const double before = ppo.iterate(environments).reward;
  PpoReport report;
  for (int i = 0; i < 40; ++i) report = ppo.iterate(environments);
  CHECK(before < -0.2);
  CHECK(report.reward > -0.05);
  CHECK(report.entropy < std::log(0.4) + 1.4);
  // The best action is the first number seen, normalised.
  Eigen::MatrixXd seen(2, 3), action(1, 3);
  seen << 1, 3, 5, 1, -1, 0;
  ppo.mean_action(seen, action);
  CHECK(std::abs(action(0) + 0.4) < 0.15);
  CHECK(std::abs(action(1)) < 0.15);
  CHECK(std::abs(action(2) - 0.4) < 0.15);
}

TEST_CASE("a time-out keeps the value of what would follow, a termination does not") {
  // A step is worth 1 whatever is done and gamma is 1/2: endless, 2; with an end after two steps, 1.5 and 1.
  const auto value_of = [](End ends) {
    PpoParameters p = small();
    p.gamma = 0.5;
    p.value_rate = 1e-2;
    p.normalize_observations = false;
    p.policy_rate = 0;
    auto ppo = make(16, p);
    Guess environments(16);
    environments.length = 2;
    environments.ends = ends;
    environments.worth = 1;
    environments.cost = 0;
    double sum = 0;
    for (int i = 0; i < 120; ++i) {
      ppo.iterate(environments);
      if (i >= 80) sum += ppo.rollout().value.mean() / 40;
    }
    return sum;
  };
  CHECK(value_of(End::timed_out) == Approx(2).epsilon(0.02));
  CHECK(value_of(End::terminated) == Approx(1.25).epsilon(0.03));
}

TEST_CASE("the same bits on one and on two threads, in whatever order") {
  const auto run = [](auto& executor) {
    auto ppo = make(300, small());
    Guess environments(300);
    for (int i = 0; i < 3; ++i) ppo.iterate(environments, executor);
    return ppo.state();
  };
  core::SerialExecutor serial;
  core::ThreadExecutor two(2), three(3);
  const auto expected = run(serial);
  CHECK(same(expected, run(two)));
  CHECK(same(expected, run(three)));
  CHECK(expected.policy.allFinite());
}

TEST_CASE("another seed learns another way") {
  const auto run = [](std::uint64_t seed) {
    PpoParameters p = small();
    p.seed = seed;
    auto ppo = make(8, p);
    Guess environments(8);
    ppo.iterate(environments);
    return ppo.state().policy;
  };
  CHECK(run(1) == run(1));
  CHECK(run(1) != run(2));
}

TEST_CASE("a run restored from its state goes on as the one that was saved") {
  Guess environments(8), others(8);
  auto ppo = make(8, small());
  for (int i = 0; i < 3; ++i) ppo.iterate(environments);
  const PpoState<double> saved = ppo.state();
  PpoParameters p = small();
  auto other = make(8, p);
  other.restore(saved);
  ppo.restore(saved);
  CHECK(same(other.state(), saved));
  for (int i = 0; i < 2; ++i) {
    ppo.iterate(environments);
    other.iterate(others);
  }
  CHECK(same(ppo.state(), other.state()));
  CHECK_FALSE(same(ppo.state(), saved));

  PpoState<double> broken = saved;
  broken.value[3] = std::numeric_limits<double>::infinity();
  const PpoState<double> before = other.state();
  CHECK_THROWS_AS(other.restore(broken), Error);
  broken = saved;
  broken.normalizer.resize(1);
  CHECK_THROWS_AS(other.restore(broken), Error);
  CHECK(same(other.state(), before));
}

TEST_CASE("an environment that is not finite ends its episode, is counted, and teaches nothing") {
  for (const bool reward : {false, true}) {
    auto ppo = make(6, small());
    Guess environments(6);
    environments.poisoned = 4;
    environments.poisoned_reward = reward;
    core::SerialExecutor serial;
    ppo.collect(environments, serial);
    // Environment 4 starts at age 4 of 6: its second episode begins with step 2 and is lost in step 4.
    CHECK(ppo.rollout().end(4, 4) == End::failed);
    CHECK(ppo.rollout().reward(4, 4) == 0);
    CHECK(ppo.rollout().observation.allFinite());
    const PpoReport report = ppo.learn(serial);
    CHECK(report.failed == 1);
    CHECK(report.samples == 119);
    CHECK(ppo.policy_parameters().allFinite());
    CHECK(ppo.value_parameters().allFinite());
    // The episode after it is whole.
    CHECK(ppo.rollout().end(10, 4) == End::timed_out);
  }
}

TEST_CASE("an environment that cannot begin stops the run and is named") {
  auto ppo = make(3, small());
  Guess environments(3);
  environments.poisoned = 1;
  environments.poisoned_start = true;
  CHECK_THROWS_WITH_AS(ppo.iterate(environments), "ppo: environment 1 is not finite at the start of an episode", Error);
}

TEST_CASE("a gradient that is not finite stops learning with the tensor's name, parameters as they were") {
  auto ppo = make(6, small());
  Guess environments(6);
  core::SerialExecutor serial;
  ppo.iterate(environments);
  const PpoState<double> before = ppo.state();
  ppo.collect(environments, serial);
  ppo.rollout().observation.setZero();
  ppo.rollout().observation(1, 17) = not_a_number;
  std::string message;
  try {
    ppo.learn(serial);
  } catch (const Error& error) {
    message = error.what();
  }
  CHECK(message.find("ppo, update 2: policy gradient: layers.0.weight(") == 0);
  CHECK(ppo.policy_parameters().allFinite());
  CHECK(ppo.value_parameters().allFinite());
  CHECK(ppo.state().policy_optimizer.allFinite());
  // The good steps before it are kept, and it goes on after a new rollout.
  CHECK(ppo.state().updates == before.updates);
  CHECK(ppo.iterate(environments).epochs == 3);
}

TEST_CASE("epochs end once the policy has gone too far") {
  PpoParameters p = small();
  p.policy_rate = 0.1;
  p.epochs = 10;
  p.divergence_stop = 1e-3;
  auto ppo = make(16, p);
  Guess environments(16);
  CHECK(ppo.iterate(environments).epochs == 1);
}

TEST_CASE("the rate is steered to a divergence, within its bounds") {
  PpoParameters p = small();
  p.divergence_target = 1e3;
  p.most_policy_rate = 3.2e-3;
  auto slow = make(8, p);
  Guess environments(8);
  slow.iterate(environments);
  CHECK(slow.policy_rate() == Approx(3.2e-3));
  p.divergence_target = 1e-12;
  p.least_policy_rate = 1e-3;
  auto fast = make(8, p);
  fast.iterate(environments);
  CHECK(fast.policy_rate() == Approx(2.5e-3));
}

TEST_CASE("the first update meets the policy that acted: no divergence, nothing clipped") {
  PpoParameters p = small();
  p.epochs = 1;
  p.minibatch = 1000;
  auto ppo = make(8, p);
  Guess environments(8);
  const PpoReport report = ppo.iterate(environments);
  CHECK(report.divergence == Approx(0).scale(1e-12));
  CHECK(report.clip_fraction == 0);
  CHECK(report.samples == 160);
  // The surrogate is then minus the mean advantage, which is normalised.
  CHECK(std::abs(report.surrogate) < 1e-2);
}

TEST_CASE("ends and episodes are counted") {
  PpoParameters p = small();
  p.steps = 12;
  auto ppo = make(6, p);
  Guess environments(6);
  core::SerialExecutor serial;
  ppo.collect(environments, serial);
  CHECK(ppo.learn(serial).timed_out == 12);
  environments.ends = End::terminated;
  environments.worth = 100;
  ppo.collect(environments, serial);
  ppo.collect(environments, serial);
  const PpoReport report = ppo.learn(serial);
  CHECK(report.terminated == 12);
  CHECK(report.timed_out == 0);
  CHECK(report.episode_steps == 6);
  CHECK(report.reward == Approx(100).epsilon(0.03));
  CHECK(report.episode_return == Approx(600).epsilon(0.03));
  CHECK(ppo.samples() == 216);
}

TEST_CASE("explained variance is 1 for values that foresee every return") {
  PpoParameters p = small();
  p.lambda = p.value_lambda = 1;
  auto ppo = make(8, p);
  Guess environments(8);
  core::SerialExecutor serial;
  ppo.collect(environments, serial);
  ppo.prepare();
  ppo.rollout().value = ppo.rollout().target;
  CHECK(ppo.learn(serial).explained_variance == Approx(1).epsilon(1e-9));
}

TEST_CASE("only the value function sees privileged observations") {
  auto ppo = make(8, small(), 1);
  Guess environments(8);
  for (int i = 0; i < 3; ++i) ppo.iterate(environments);
  Eigen::MatrixXd seen(2, 2), action(1, 2);
  seen << 2, 2, -1, 1;
  ppo.mean_action(seen, action);
  CHECK(action(0) == action(1));
}

TEST_CASE("mean actions do not depend on how many are asked for") {
  auto ppo = make(4, small());
  Guess environments(4);
  ppo.iterate(environments);
  const Eigen::MatrixXd seen = Eigen::MatrixXd::Random(2, 200);
  Eigen::MatrixXd all(1, 200), one(1, 1);
  ppo.mean_action(seen, all);
  for (Eigen::Index j = 0; j < 200; j += 37) {
    ppo.mean_action(seen.middleCols(j, 1), one);
    CHECK(one(0) == all(j));
  }
}

TEST_CASE("observations are normalised by all that was seen before") {
  auto ppo = make(50, small());
  Guess environments(50);
  core::SerialExecutor serial;
  ppo.collect(environments, serial);
  CHECK(ppo.normalizer().samples() == 0);
  ppo.collect(environments, serial);
  CHECK(ppo.normalizer().samples() == 1000);
  CHECK(ppo.normalizer().mean(0) == Approx(3).epsilon(0.1));
  CHECK(std::abs(ppo.rollout().observation.row(0).mean()) < 0.1);
  CHECK(ppo.rollout().observation.row(0).cwiseAbs2().mean() == Approx(1).epsilon(0.15));
}

TEST_CASE("after the first rollout nothing is allocated") {
  auto ppo = make(8, small());
  Guess environments(8);
  core::SerialExecutor serial;
  ppo.iterate(environments, serial);
  const long before = allocations();
  for (int i = 0; i < 3; ++i) ppo.iterate(environments, serial);
  if (counts_allocations()) CHECK(allocations() == before);
}

TEST_CASE("what does not fit is refused") {
  using P = Learner;
  const auto make_with = [](auto change) {
    PpoParameters p;
    change(p);
    P(Net({2, 1}), Net({2, 1}), nn::GaussianHead(1, 0.1), 1, p);
  };
  CHECK_NOTHROW(make_with([](PpoParameters&) {}));
  CHECK_THROWS_WITH_AS(make_with([](PpoParameters& p) { p.gamma = 1.5; }), "ppo: gamma must be in [0, 1]", Error);
  CHECK_THROWS_WITH_AS(make_with([](PpoParameters& p) { p.clip = 0; }), "ppo: clip must be positive", Error);
  CHECK_THROWS_WITH_AS(make_with([](PpoParameters& p) { p.policy_rate = not_a_number; }), "ppo: policy_rate must be zero or more",
                       Error);
  CHECK_THROWS_WITH_AS(make_with([](PpoParameters& p) { p.steps = 0; }), "ppo: expected at least one step, got 0", Error);
  const PpoParameters p;
  CHECK_THROWS_WITH_AS(P(Net({2, 3}), Net({2, 1}), nn::GaussianHead(1, 0.1), 1, p),
                       "ppo: expected a head of 3 actions, got 1", Error);
  CHECK_THROWS_WITH_AS(P(Net({2, 1}), Net({1, 1}), nn::GaussianHead(1, 0.1), 1, p),
                       "ppo: expected at least 2 inputs of the value network, got 1", Error);
  auto ppo = make(3, small());
  Guess environments(4);
  CHECK_THROWS_WITH_AS(ppo.iterate(environments), "ppo: expected 3 environments, got 4", Error);
}
