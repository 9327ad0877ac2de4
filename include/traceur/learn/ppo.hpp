// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "traceur/core/executor.hpp"
#include "traceur/core/random.hpp"
#include "traceur/learn/clipped_surrogate.hpp"
#include "traceur/learn/minibatches.hpp"
#include "traceur/learn/ppo_report.hpp"
#include "traceur/nn/data_parallel.hpp"
#include "traceur/nn/gaussian_head.hpp"
#include "traceur/nn/mlp.hpp"
#include "traceur/nn/normalizer.hpp"
#include "traceur/nn/optimizer.hpp"
#include "traceur/nn/parameter_check.hpp"

namespace traceur::learn {

struct PpoParameters {
  std::uint64_t seed = 1;
  int steps = 16;                ///< of every environment between updates
  int epochs = 2;                ///< times an update goes through its samples
  Eigen::Index minibatch = 1024; ///< most samples in a gradient
  double gamma = 0.95;           ///< discount per unit of the steps' duration
  double lambda = 0.95;          ///< of the advantages
  double value_lambda = 0.95;    ///< of the returns that the value function is fitted to
  double reward_scale = 1;       ///< rewards times this; 1 - gamma keeps the values of rewards in [0, 1] there too

  double clip = 0.2;                 ///< of the ratio of probabilities
  double policy_rate = 3e-4;         ///< learning rate at the start
  double value_rate = 1e-3;          ///< learning rate
  double policy_gradient_clip = 1;   ///< greatest Euclidean length; 0 for none
  double value_gradient_clip = 0;    ///< greatest Euclidean length; 0 for none
  double entropy_weight = 0;         ///< entropy counted as loss saved; idle while the deviations are fixed
  double bound_penalty = 0;          ///< times the squared excess of mean actions over +-`action_bound`
  double action_bound = 1;
  bool normalize_advantages = true;  ///< to mean 0 and deviation 1 over the update
  double advantage_clamp = 4;        ///< in deviations, after normalising; 0 for none

  double divergence_stop = 0;        ///< no further epoch after one of more mean divergence; 0 for never
  double divergence_target = 0;      ///< what the policy's rate is steered to, once an update; 0 for a constant rate
  double most_policy_rate = 6e-4;    ///< steered rates stay within these
  double least_policy_rate = 1e-6;

  double output_scale = 0.01;        ///< times the policy's last weights at the start, so that mean actions begin near zero
  bool normalize_observations = true;
  double observation_clamp = 5;      ///< in deviations
  std::int64_t normalizer_samples = 0;  ///< observations after which the normaliser learns no more; 0 for never
  int chunks = 4;  ///< parts of a minibatch that threads may share; their number, not the threads', decides the bits
};

/// Proximal policy optimisation, Schulman et al. 2017 (arXiv:1707.06347), for normally distributed actions, with the
/// variable-step advantages of `gae.hpp`.
///
///     policy loss = mean over samples of -min(r A, clip(r, 1 - c, 1 + c) A) - entropy_weight H + bound_penalty |excess|^2
///     value loss  = mean over samples of (V - G)^2 / 2
///
/// A is fixed by the values before the update, G is the lambda-return. Policy and value have networks and optimizers of
/// their own. `collect` gathers a rollout, `learn` updates from it; between the two, rewards in `rollout()` may be changed
/// or added to. All memory is taken by the constructor. The same seed gives the same bits with every executor.
///
/// A value network with more inputs than the policy sees privileged observations: the policy sees the first rows only.
template <class S = float, nn::Module<S> Policy = nn::Mlp<>, nn::Module<S> Value = nn::Mlp<>,
          nn::Optimizer<S> PolicyOptimizer = nn::Adam<S>, nn::Optimizer<S> ValueOptimizer = nn::Adam<S>>
class Ppo {
 public:
  using Matrix = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;
  using Vector = Eigen::Matrix<S, Eigen::Dynamic, 1>;

  /// For so many environments, each with `value.inputs()` observations and `policy.outputs()` actions. Throws Error for
  /// networks that do not fit together or a parameter out of its range.
  Ppo(Policy policy, Value value, nn::GaussianHead head, Eigen::Index environments, const PpoParameters& parameters = {})
      : parameters_(checked(parameters, policy, value, head, environments)),
        policy_(std::move(policy)),
        value_(std::move(value)),
        head_(std::move(head)),
        rollout_(value_.inputs(), policy_.outputs(), environments, parameters.steps),
        batches_(rollout_.samples(), parameters.minibatch),
        policy_optimizer_(policy_.parameters() + head_.parameters()),
        value_optimizer_(value_.parameters()),
        normalizer_(value_.inputs(), {parameters.observation_clamp, 1e-4, parameters.normalizer_samples}),
        next_normalizer_(normalizer_),
        policy_parallel_(policy_.parameters() + head_.parameters(), parameters.chunks),
        value_parallel_(value_.parameters(), parameters.chunks),
        few_(1, static_cast<int>(std::clamp<Eigen::Index>(environments / least_columns, 1, parameters.chunks))),
        result_(environments),
        head_workspace_(head_.template workspace<S>()),
        policy_rate_(parameters.policy_rate) {
    const Eigen::Index most = std::min(parameters.minibatch, rollout_.samples());
    block_ = std::max(policy_parallel_.largest(most), std::min<Eigen::Index>(few_.largest(environments), 256));
    for (int i = 0; i < parameters.chunks; ++i) chunks_.emplace_back(policy_, value_, block_);
    policy_theta_.setZero(policy_.parameters() + head_.parameters());
    policy_gradient_.setZero(policy_theta_.size());
    value_theta_.setZero(value_.parameters());
    value_gradient_.setZero(value_theta_.size());
    scratch_.setZero(value_.inputs(), environments);
    timed_out_.resize(static_cast<std::size_t>(environments));
    bootstrap_.setZero(environments);
    episode_earned_.setZero(environments);
    episode_steps_.setZero(environments);

    core::RandomStream random(parameters.seed, initialization);
    policy_.initialize(policy_theta_.data(), random);
    value_.initialize(value_theta_.data(), random);
    head_.initialize(policy_theta_.data() + policy_.parameters());
    std::pair<Eigen::Index, Eigen::Index> last{0, 0};
    policy_.for_each_parameter([&](std::string_view name, Eigen::Index offset, Eigen::Index rows, Eigen::Index cols) {
      if (name.ends_with("weight")) last = {offset, rows * cols};
    });
    policy_theta_.segment(last.first, last.second) *= static_cast<S>(parameters.output_scale);
  }

  const PpoParameters& parameters() const noexcept { return parameters_; }
  const Policy& policy() const noexcept { return policy_; }
  const Value& value() const noexcept { return value_; }
  const nn::GaussianHead& head() const noexcept { return head_; }
  const nn::Normalizer& normalizer() const noexcept { return normalizer_; }
  Rollout<S>& rollout() noexcept { return rollout_; }
  const Rollout<S>& rollout() const noexcept { return rollout_; }
  /// The policy's parameters, then the head's.
  Vector& policy_parameters() noexcept { return policy_theta_; }
  const Vector& policy_parameters() const noexcept { return policy_theta_; }
  Vector& value_parameters() noexcept { return value_theta_; }
  const Vector& value_parameters() const noexcept { return value_theta_; }
  double policy_rate() const noexcept { return policy_rate_; }
  void set_policy_rate(double rate) noexcept { policy_rate_ = rate; }
  std::int64_t updates() const noexcept { return updates_; }
  /// Steps taken in all environments together, those that only the normaliser saw included.
  std::int64_t samples() const noexcept { return ticks_ * rollout_.environments(); }

  /// One rollout and one update. The first time a rollout goes before it that only the normaliser learns from. Throws as
  /// `collect` and `learn` do.
  template <class E, core::Executor X>
    requires Environments<E, S>
  PpoReport iterate(E& environments, X& executor) {
    if (parameters_.normalize_observations && next_normalizer_.samples() == 0) collect(environments, executor);
    collect(environments, executor);
    return learn(executor);
  }
  template <class E>
    requires Environments<E, S>
  PpoReport iterate(E& environments) {
    core::SerialExecutor serial;
    return iterate(environments, serial);
  }

  /// Steps the environments and fills `rollout()`, estimated values included. Episodes go on from one rollout to the next;
  /// the first begins with a `reset`. An environment that gives a number that is not finite has its episode ended and the
  /// step counted as failed. Throws Error if one is not finite at the very start of an episode, or if sizes do not fit.
  template <class E, core::Executor X>
    requires Environments<E, S>
  void collect(E& environments, X& executor) {
    check_sizes(environments);
    const Eigen::Index n = rollout_.environments();
    normalizer_ = next_normalizer_;
    head_.prepare(policy_theta_.data() + policy_.parameters(), head_workspace_);
    finished_ = {};
    if (!started_) {
      environments.reset(core::RandomStream(parameters_.seed, beginnings, static_cast<std::uint64_t>(ticks_)).next_u64());
      episode_earned_.setZero();
      episode_steps_.setZero();
      started_ = true;
    }
    for (Eigen::Index t = 0; t < rollout_.steps(); ++t) {
      observe(environments, rollout_.at_step(rollout_.observation, t), t);
      Columns<S> action = rollout_.at_step(rollout_.action, t);
      act(executor, t, action);
      result_.clear();
      environments.step(action, result_);
      rollout_.record(t, result_);
      end_episodes(environments, executor, t);
      ++ticks_;
    }
    observe(environments, scratch_, rollout_.steps());
    if (parameters_.normalize_observations) {
      next_normalizer_.template observe<S>(rollout_.observation);
      normalizer_.template apply<S>(scratch_, scratch_);
    }
    estimate(executor, scratch_, rollout_.last_value.data(), n);
    estimate_all(executor);
  }

  /// Updates policy and value from the rollout, whose rewards are scaled and whose observations are normalised by then.
  /// Throws Error that names the tensor if a gradient is not finite; all parameters are then as after the last step that
  /// was sound.
  template <core::Executor X>
  PpoReport learn(X& executor) {
    PpoReport report = begin_report();
    prepare();
    report.samples = batches_.samples();
    report.explained_variance = explained_variance();

    for (int epoch = 0; epoch < parameters_.epochs && batches_.samples() > 0; ++epoch) {
      core::RandomStream random(parameters_.seed, shuffles,
                                static_cast<std::uint64_t>(updates_ * parameters_.epochs + epoch));
      batches_.shuffle(random);
      Tally tally;
      double policy_length = 0, value_length = 0;
      for (Eigen::Index k = 0; k < batches_.count(); ++k) {
        const auto [policy, value] = step(executor, batches_[k], tally);
        policy_length += policy;
        value_length += value;
      }
      const double samples = static_cast<double>(batches_.samples()), count = static_cast<double>(batches_.count());
      report.surrogate = tally.surrogate / samples;
      report.value_loss = tally.value_loss / samples;
      report.divergence = tally.divergence / samples;
      report.clip_fraction = tally.clipped / samples;
      report.policy_gradient = policy_length / count;
      report.value_gradient = value_length / count;
      report.epochs = epoch + 1;
      if (parameters_.divergence_stop > 0 && report.divergence > parameters_.divergence_stop) break;
    }
    report.policy_rate = policy_rate_;
    if (parameters_.divergence_target > 0 && report.epochs > 0) {
      policy_rate_ *= report.divergence < parameters_.divergence_target ? 1.1 : 1 / 1.2;
      policy_rate_ = std::clamp(policy_rate_, parameters_.least_policy_rate, parameters_.most_policy_rate);
    }
    head_.prepare(policy_theta_.data() + policy_.parameters(), head_workspace_);
    report.entropy = static_cast<double>(head_.entropy(head_workspace_));
    normalizer_ = next_normalizer_;
    ++updates_;
    return report;
  }

  /// Advantages and returns of the rollout, rewards scaled: what `learn` begins with.
  void prepare() noexcept {
    if (parameters_.reward_scale != 1) {
      rollout_.reward *= static_cast<S>(parameters_.reward_scale);
      rollout_.reward_rate *= static_cast<S>(parameters_.reward_scale);
    }
    generalized_advantage<S>({parameters_.gamma, parameters_.lambda}, rollout_.trajectories(), rollout_.advantage);
    lambda_return<S>({parameters_.gamma, parameters_.value_lambda}, rollout_.trajectories(), rollout_.target);
    batches_.select(rollout_);
    normalize_advantages();
  }

  /// The policy's mean actions at raw observations of any number of environments: what to judge and to ship.
  void mean_action(ConstColumns<S> observation, Columns<S> action) noexcept {
    Chunk& chunk = chunks_.front();
    for (Eigen::Index from = 0; from < observation.cols(); from += block_) {
      const Eigen::Index count = std::min(block_, observation.cols() - from);
      auto seen = chunk.observation.leftCols(count);
      seen = observation.middleCols(from, count);
      if (parameters_.normalize_observations) normalizer_.template apply<S>(seen, seen);
      policy_.template infer<S>(policy_theta_.data(), seen.topRows(policy_.inputs()), chunk.policy,
                                action.middleCols(from, count));
    }
  }

  /// The loss of the policy on at most `minibatch` samples of the rollout after `learn` or `prepare`, with its gradient added
  /// to `gradient`, which has the length of `policy_parameters()`.
  template <core::Executor X>
  double policy_loss(X& executor, std::span<const std::int32_t> which, nn::Flat<S> gradient) {
    Tally tally;
    policy_gradient(executor, which, gradient, tally);
    head_.prepare(policy_theta_.data() + policy_.parameters(), head_workspace_);
    return (tally.surrogate + tally.penalty) / static_cast<double>(which.size()) -
           parameters_.entropy_weight * static_cast<double>(head_.entropy(head_workspace_));
  }

  /// All there is to save. Episodes are not: after `restore` they begin anew.
  PpoState<S> state() const {
    return {policy_theta_,
            value_theta_,
            policy_optimizer_.state(),
            value_optimizer_.state(),
            next_normalizer_.state(),
            policy_optimizer_.steps(),
            value_optimizer_.steps(),
            updates_,
            ticks_,
            policy_rate_};
  }

  /// Goes on where another run of the same networks and parameters was saved. Throws Error for a state that does not fit or
  /// is not finite, and leaves this as it was.
  void restore(const PpoState<S>& state) {
    if (state.policy.size() != policy_theta_.size() || state.value.size() != value_theta_.size())
      throw Error("ppo state: expected " + std::to_string(policy_theta_.size()) + " and " +
                  std::to_string(value_theta_.size()) + " parameters, got " + std::to_string(state.policy.size()) + " and " +
                  std::to_string(state.value.size()));
    nn::check_finite("ppo state: policy", policy_, state.policy.data());
    nn::check_finite("ppo state: policy", head_, state.policy.data() + policy_.parameters());
    nn::check_finite("ppo state: value", value_, state.value.data());
    if (!(state.policy_rate >= 0) || !std::isfinite(state.policy_rate) || state.updates < 0 || state.ticks < 0)
      throw Error("ppo state: expected a rate and counts of zero or more");
    PolicyOptimizer policy_optimizer = policy_optimizer_;
    ValueOptimizer value_optimizer = value_optimizer_;
    nn::Normalizer normalizer = normalizer_;
    policy_optimizer.restore(state.policy_optimizer, state.policy_steps);
    value_optimizer.restore(state.value_optimizer, state.value_steps);
    normalizer.restore(state.normalizer);
    policy_theta_ = state.policy;
    value_theta_ = state.value;
    policy_optimizer_ = std::move(policy_optimizer);
    value_optimizer_ = std::move(value_optimizer);
    normalizer_ = next_normalizer_ = std::move(normalizer);
    updates_ = state.updates;
    ticks_ = state.ticks;
    policy_rate_ = state.policy_rate;
    started_ = false;
  }

 private:
  // Streams of the seed, one a purpose; environments follow.
  static constexpr std::uint64_t initialization = 0, shuffles = 1, beginnings = 2, actors = 16;
  // Fewer columns than this are not worth a thread's waking.
  static constexpr Eigen::Index least_columns = 64;
  // Keeps the ratio of probabilities finite where a policy has run away.
  static constexpr S most_log_ratio = S(20);

  struct Tally {
    double surrogate = 0, penalty = 0, divergence = 0, clipped = 0, value_loss = 0;
  };

  /// What one part of a batch needs.
  struct Chunk {
    nn::WorkspaceOf<Policy, S> policy;
    nn::WorkspaceOf<Value, S> value;
    Matrix seen, observation, action, mean, dmean, estimate;
    Vector log_probability, slope;
    Tally tally;

    Chunk(const Policy& p, const Value& v, Eigen::Index columns)
        : policy(p.template workspace<S>(columns)), value(v.template workspace<S>(columns)) {
      seen.setZero(p.inputs(), columns);
      observation.setZero(v.inputs(), columns);
      action.setZero(p.outputs(), columns);
      mean = dmean = action;
      estimate.setZero(1, columns);
      log_probability.setZero(columns);
      slope = log_probability;
    }
  };

  static const PpoParameters& checked(const PpoParameters& p, const Policy& policy, const Value& value,
                                      const nn::GaussianHead& head, Eigen::Index environments) {
    const auto positive = [](const char* what, double number) {
      if (!(number > 0) || !std::isfinite(number)) throw Error(std::string("ppo: ") + what + " must be positive");
    };
    const auto share = [](const char* what, double number) {
      if (!(number >= 0 && number <= 1)) throw Error(std::string("ppo: ") + what + " must be in [0, 1]");
    };
    const auto limit = [](const char* what, double number) { detail::check_zero_or_more("ppo", what, number); };
    detail::check_at_least_one("ppo", "environment", environments);
    detail::check_at_least_one("ppo", "step", p.steps);
    detail::check_at_least_one("ppo", "epoch", p.epochs);
    detail::check_at_least_one("ppo", "sample in a minibatch", p.minibatch);
    detail::check_at_least_one("ppo", "chunk", p.chunks);
    positive("gamma", p.gamma);
    share("gamma", p.gamma);
    share("lambda", p.lambda);
    share("value_lambda", p.value_lambda);
    positive("reward_scale", p.reward_scale);
    positive("clip", p.clip);
    limit("policy_rate", p.policy_rate);
    limit("value_rate", p.value_rate);
    limit("policy_gradient_clip", p.policy_gradient_clip);
    limit("value_gradient_clip", p.value_gradient_clip);
    limit("entropy_weight", p.entropy_weight);
    limit("bound_penalty", p.bound_penalty);
    limit("action_bound", p.action_bound);
    limit("advantage_clamp", p.advantage_clamp);
    limit("divergence_stop", p.divergence_stop);
    limit("divergence_target", p.divergence_target);
    limit("output_scale", p.output_scale);
    if (!(p.least_policy_rate >= 0 && p.least_policy_rate <= p.most_policy_rate))
      throw Error("ppo: least_policy_rate must be zero or more and most_policy_rate no less");
    if (policy.outputs() != head.dimension())
      throw Error("ppo: expected a head of " + std::to_string(policy.outputs()) + " actions, got " +
                  std::to_string(head.dimension()));
    if (value.outputs() != 1) throw Error("ppo: expected one output of the value network, got " + std::to_string(value.outputs()));
    if (value.inputs() < policy.inputs())
      throw Error("ppo: expected at least " + std::to_string(policy.inputs()) + " inputs of the value network, got " +
                  std::to_string(value.inputs()));
    return p;
  }

  template <class E>
  void check_sizes(const E& environments) const {
    const auto same = [](const char* what, Eigen::Index expected, Eigen::Index got) {
      if (got != expected)
        throw Error(std::string("ppo: expected ") + std::to_string(expected) + " " + what + ", got " + std::to_string(got));
    };
    same("environments", rollout_.environments(), environments.environments());
    same("observations", value_.inputs(), environments.observations());
    same("actions", policy_.outputs(), environments.actions());
  }

  /// Observations before step t into `out`; an environment whose state is not finite fails its step before and begins anew.
  template <class E>
  void observe(E& environments, Columns<S> out, Eigen::Index t) {
    environments.observe(out);
    if (out.allFinite()) return;
    for (Eigen::Index e = 0; e < out.cols(); ++e) {
      if (out.col(e).allFinite()) continue;
      if (t > 0 && rollout_.end(t - 1, e) == End::running) {
        rollout_.fail(t - 1, e);
        close_episode(e, End::failed);
      }
      environments.restart(e);
    }
    environments.observe(out);
    for (Eigen::Index e = 0; e < out.cols(); ++e)
      if (!out.col(e).allFinite())
        throw Error("ppo: environment " + std::to_string(e) + " is not finite at the start of an episode");
  }

  /// Draws the actions of step t and keeps their probabilities.
  template <class X>
  void act(X& executor, Eigen::Index t, Columns<S> action) {
    const Columns<S> raw = rollout_.at_step(rollout_.observation, t);
    few_.run(executor, rollout_.environments(), [&](int c, Eigen::Index first, Eigen::Index number) {
      Chunk& chunk = chunks_[static_cast<std::size_t>(c)];
      for (Eigen::Index from = first; from < first + number; from += block_) {
        const Eigen::Index count = std::min(block_, first + number - from);
        auto seen = chunk.observation.leftCols(count);
        auto mean = chunk.mean.leftCols(count);
        if (parameters_.normalize_observations) {
          normalizer_.template apply<S>(raw.middleCols(from, count), seen);
        } else {
          seen = raw.middleCols(from, count);
        }
        policy_.template infer<S>(policy_theta_.data(), seen.topRows(policy_.inputs()), chunk.policy, mean);
        for (Eigen::Index j = 0; j < count; ++j) {
          core::RandomStream random(parameters_.seed, actors + static_cast<std::uint64_t>(from + j),
                                    static_cast<std::uint64_t>(ticks_));
          head_.template sample<S>(head_workspace_, mean.col(j), random, action.col(from + j));
        }
        head_.template log_probability<S>(head_workspace_, mean, action.middleCols(from, count),
                                          chunk.log_probability.head(count));
        rollout_.log_probability.row(t).segment(from, count) = chunk.log_probability.head(count).transpose();
      }
    });
  }

  /// Estimates the values of states that timed out, and begins the next episode wherever one ended.
  template <class E, class X>
  void end_episodes(E& environments, X& executor, Eigen::Index t) {
    bool any_ended = false;
    std::size_t waiting = 0;
    for (Eigen::Index e = 0; e < rollout_.environments(); ++e) {
      const End end = rollout_.end(t, e);
      if (end != End::failed) {
        episode_earned_[e] += static_cast<double>(rollout_.reward(t, e)) +
                              static_cast<double>(rollout_.reward_rate(t, e)) * static_cast<double>(rollout_.duration(t, e));
      }
      ++episode_steps_[e];
      if (end == End::running) continue;
      any_ended = true;
      if (end == End::timed_out) timed_out_[waiting++] = e;
    }
    if (!any_ended) return;
    if (waiting > 0) {
      environments.observe(scratch_);
      Eigen::Index kept = 0;
      for (std::size_t i = 0; i < waiting; ++i) {
        const Eigen::Index e = timed_out_[i];
        if (!scratch_.col(e).allFinite()) {
          rollout_.fail(t, e);
          continue;
        }
        // Kept columns move to the left, never over one that is still to come.
        if (kept != e) scratch_.col(kept) = scratch_.col(e);
        timed_out_[static_cast<std::size_t>(kept++)] = e;
      }
      if (parameters_.normalize_observations)
        normalizer_.template apply<S>(scratch_.leftCols(kept), scratch_.leftCols(kept));
      estimate(executor, scratch_.leftCols(kept), bootstrap_.data(), kept);
      for (Eigen::Index i = 0; i < kept; ++i)
        rollout_.timed_out_value(t, timed_out_[static_cast<std::size_t>(i)]) = bootstrap_[i];
    }
    for (Eigen::Index e = 0; e < rollout_.environments(); ++e) {
      if (rollout_.end(t, e) == End::running) continue;
      close_episode(e, rollout_.end(t, e));
      environments.restart(e);
    }
  }

  void close_episode(Eigen::Index e, End end) noexcept {
    switch (end) {
      case End::terminated:
        ++finished_.terminated;
        break;
      case End::timed_out:
        ++finished_.timed_out;
        break;
      case End::failed:
        ++finished_.failed;
        break;
      case End::running:
        break;
    }
    if (end != End::failed) {
      finished_.earned += episode_earned_[e];
      finished_.steps += static_cast<double>(episode_steps_[e]);
    }
    episode_earned_[e] = 0;
    episode_steps_[e] = 0;
  }

  /// Values of normalised observations.
  template <class X>
  void estimate(X& executor, ConstColumns<S> observation, S* to, Eigen::Index columns) {
    few_.run(executor, columns, [&](int c, Eigen::Index first, Eigen::Index number) {
      Chunk& chunk = chunks_[static_cast<std::size_t>(c)];
      for (Eigen::Index from = first; from < first + number; from += block_) {
        const Eigen::Index count = std::min(block_, first + number - from);
        value_.template infer<S>(value_theta_.data(), observation.middleCols(from, count), chunk.value,
                                 Eigen::Map<Matrix>(to + from, 1, count));
      }
    });
  }

  /// Normalises all observations of the rollout where they lie and estimates their values.
  template <class X>
  void estimate_all(X& executor) {
    value_parallel_.run(executor, rollout_.samples(), [&](int c, Eigen::Index first, Eigen::Index number) {
      Chunk& chunk = chunks_[static_cast<std::size_t>(c)];
      for (Eigen::Index from = first; from < first + number; from += block_) {
        const Eigen::Index count = std::min(block_, first + number - from);
        auto seen = rollout_.observation.middleCols(from, count);
        if (parameters_.normalize_observations) normalizer_.template apply<S>(seen, seen);
        value_.template infer<S>(value_theta_.data(), seen, chunk.value,
                                 Eigen::Map<Matrix>(rollout_.value.data() + from, 1, count));
      }
    });
  }

  PpoReport begin_report() const noexcept {
    PpoReport report;
    report.terminated = finished_.terminated;
    report.timed_out = finished_.timed_out;
    report.failed = finished_.failed;
    const double whole = static_cast<double>(finished_.terminated + finished_.timed_out);
    if (whole > 0) {
      report.episode_return = finished_.earned / whole;
      report.episode_steps = finished_.steps / whole;
    }
    report.reward = static_cast<double>((rollout_.reward.array() + rollout_.reward_rate.array() * rollout_.duration.array()).mean());
    return report;
  }

  /// 1 - Var(G - V) / Var(G): 1 for a value function that foresees every return, 0 for one that knows their mean.
  double explained_variance() const noexcept {
    double target = 0, rest = 0, target_square = 0, rest_square = 0;
    for (const std::int32_t i : batches_.all()) {
      const double g = static_cast<double>(rollout_.target.data()[i]), left = g - static_cast<double>(rollout_.value.data()[i]);
      target += g;
      rest += left;
      target_square += g * g;
      rest_square += left * left;
    }
    const double n = std::max(1.0, static_cast<double>(batches_.samples()));
    const double spread = target_square / n - target * target / (n * n), left = rest_square / n - rest * rest / (n * n);
    return spread > 0 ? 1 - left / spread : 0;
  }

  void normalize_advantages() noexcept {
    double sum = 0, square = 0;
    for (const std::int32_t i : batches_.all()) sum += static_cast<double>(rollout_.advantage.data()[i]);
    const double n = std::max(1.0, static_cast<double>(batches_.samples())), mean = sum / n;
    for (const std::int32_t i : batches_.all()) {
      const double off = static_cast<double>(rollout_.advantage.data()[i]) - mean;
      square += off * off;
    }
    const double deviation = std::sqrt(square / n);
    const S limit = static_cast<S>(parameters_.advantage_clamp);
    for (const std::int32_t i : batches_.all()) {
      S& a = rollout_.advantage.data()[i];
      if (parameters_.normalize_advantages) a = static_cast<S>((static_cast<double>(a) - mean) / (deviation + 1e-8));
      if (limit > S(0)) a = a < -limit ? -limit : a > limit ? limit : a;
    }
  }

  /// One step of both optimizers on one minibatch; gives the lengths of both gradients before clipping.
  template <class X>
  std::pair<double, double> step(X& executor, std::span<const std::int32_t> which, Tally& tally) {
    policy_gradient_.setZero();
    value_gradient_.setZero();
    policy_gradient(executor, which, policy_gradient_, tally);
    value_gradient(executor, which, tally);
    const auto length = [](Vector& gradient, double most) {
      return most > 0 ? nn::clip_global_norm(gradient.data(), gradient.size(), most)
                      : nn::global_norm(gradient.data(), gradient.size());
    };
    const double policy = length(policy_gradient_, parameters_.policy_gradient_clip);
    const double value = length(value_gradient_, parameters_.value_gradient_clip);
    if (!std::isfinite(policy) || !std::isfinite(value)) {
      const std::string where = "ppo, update " + std::to_string(updates_ + 1) + ": ";
      nn::check_finite((where + "policy gradient").c_str(), policy_, policy_gradient_.data());
      nn::check_finite((where + "policy gradient").c_str(), head_, policy_gradient_.data() + policy_.parameters());
      nn::check_finite((where + "value gradient").c_str(), value_, value_gradient_.data());
      throw Error(where + "a gradient is too long to measure");
    }
    policy_optimizer_.step(policy_theta_, policy_gradient_, policy_rate_);
    value_optimizer_.step(value_theta_, value_gradient_, parameters_.value_rate);
    return {policy, value};
  }

  template <class X>
  void policy_gradient(X& executor, std::span<const std::int32_t> which, nn::Flat<S> gradient, Tally& tally) {
    head_.prepare(policy_theta_.data() + policy_.parameters(), head_workspace_);
    const Eigen::Index n = static_cast<Eigen::Index>(which.size());
    const S share = S(1) / static_cast<S>(n), clip = static_cast<S>(parameters_.clip);
    for (Chunk& chunk : chunks_) chunk.tally = {};
    policy_parallel_.run(executor, n, gradient, [&](int c, Eigen::Index first, Eigen::Index count, S* to) {
      Chunk& chunk = chunks_[static_cast<std::size_t>(c)];
      const auto part = which.subspan(static_cast<std::size_t>(first), static_cast<std::size_t>(count));
      gather(rollout_.observation, part, chunk.seen);
      gather(rollout_.action, part, chunk.action);
      const auto seen = chunk.seen.leftCols(count), action = chunk.action.leftCols(count);
      auto mean = chunk.mean.leftCols(count), dmean = chunk.dmean.leftCols(count);
      auto log_probability = chunk.log_probability.head(count), slope = chunk.slope.head(count);
      policy_.template forward<S>(policy_theta_.data(), seen, chunk.policy, mean);
      head_.template log_probability<S>(head_workspace_, mean, action, log_probability);
      for (Eigen::Index j = 0; j < count; ++j) {
        const std::int32_t i = part[static_cast<std::size_t>(j)];
        S log_ratio = log_probability[j] - rollout_.log_probability.data()[i];
        if (log_ratio > most_log_ratio) log_ratio = most_log_ratio;
        const ClippedSurrogate<S> s(log_ratio, rollout_.advantage.data()[i], clip);
        slope[j] = share * s.slope;
        chunk.tally.surrogate += static_cast<double>(s.loss);
        chunk.tally.divergence += static_cast<double>(s.divergence);
        chunk.tally.clipped += s.clipped ? 1 : 0;
      }
      S* const head = to + policy_.parameters();
      head_.template log_probability_backward<S>(head_workspace_, mean, action, slope, dmean, head);
      head_.entropy_backward(static_cast<S>(-parameters_.entropy_weight) * share * static_cast<S>(count), head);
      if (parameters_.bound_penalty > 0) chunk.tally.penalty += penalize(mean, dmean, share);
      policy_.template backward<S>(policy_theta_.data(), seen, dmean, chunk.policy, to, nn::no_gradient<S>());
    });
    share_tallies(executor);
    for (const Chunk& chunk : chunks_) {
      tally.surrogate += chunk.tally.surrogate;
      tally.penalty += chunk.tally.penalty;
      tally.divergence += chunk.tally.divergence;
      tally.clipped += chunk.tally.clipped;
    }
  }

  /// Adds the gradient of the penalty on mean actions beyond their bounds, and gives the penalty.
  double penalize(nn::ConstMatrix<S> mean, nn::Matrix<S> dmean, S share) const noexcept {
    const S bound = static_cast<S>(parameters_.action_bound), weight = static_cast<S>(parameters_.bound_penalty);
    double sum = 0;
    for (Eigen::Index j = 0; j < mean.cols(); ++j)
      for (Eigen::Index i = 0; i < mean.rows(); ++i) {
        const S a = mean(i, j), excess = a > bound ? a - bound : a < -bound ? a + bound : S(0);
        dmean(i, j) += share * weight * S(2) * excess;
        sum += static_cast<double>(weight * excess * excess);
      }
    return sum;
  }

  template <class X>
  void value_gradient(X& executor, std::span<const std::int32_t> which, Tally& tally) {
    const Eigen::Index n = static_cast<Eigen::Index>(which.size());
    const S share = S(1) / static_cast<S>(n);
    for (Chunk& chunk : chunks_) chunk.tally = {};
    value_parallel_.run(executor, n, value_gradient_, [&](int c, Eigen::Index first, Eigen::Index count, S* to) {
      Chunk& chunk = chunks_[static_cast<std::size_t>(c)];
      const auto part = which.subspan(static_cast<std::size_t>(first), static_cast<std::size_t>(count));
      gather(rollout_.observation, part, chunk.observation);
      const auto seen = chunk.observation.leftCols(count);
      auto estimate = chunk.estimate.leftCols(count);
      value_.template forward<S>(value_theta_.data(), seen, chunk.value, estimate);
      for (Eigen::Index j = 0; j < count; ++j) {
        const S off = estimate(0, j) - rollout_.target.data()[part[static_cast<std::size_t>(j)]];
        chunk.tally.value_loss += 0.5 * static_cast<double>(off) * static_cast<double>(off);
        estimate(0, j) = share * off;
      }
      value_.template backward<S>(value_theta_.data(), seen, estimate, chunk.value, to, nn::no_gradient<S>());
    });
    share_tallies(executor);
    for (const Chunk& chunk : chunks_) tally.value_loss += chunk.tally.value_loss;
  }

  /// What processes counted of their chunks, told to all of them.
  template <class X>
  void share_tallies(X& executor) {
    if constexpr (nn::SharingExecutor<X>)
      executor.share(static_cast<int>(chunks_.size()), [](int) {},
                     [&](int c) { return std::as_writable_bytes(std::span(&chunks_[static_cast<std::size_t>(c)].tally, 1)); });
  }

  struct Finished {
    int terminated = 0, timed_out = 0, failed = 0;
    double earned = 0, steps = 0;
  };

  PpoParameters parameters_;
  Policy policy_;
  Value value_;
  nn::GaussianHead head_;
  Rollout<S> rollout_;
  Minibatches batches_;
  PolicyOptimizer policy_optimizer_;
  ValueOptimizer value_optimizer_;
  nn::Normalizer normalizer_, next_normalizer_;
  nn::DataParallel<S> policy_parallel_, value_parallel_, few_;
  StepResult<S> result_;
  nn::GaussianHead::Workspace<S> head_workspace_;
  Eigen::Index block_ = 0;
  std::vector<Chunk> chunks_;
  Vector policy_theta_, policy_gradient_, value_theta_, value_gradient_, bootstrap_;
  Matrix scratch_;
  std::vector<Eigen::Index> timed_out_;
  Eigen::VectorXd episode_earned_;
  Eigen::VectorXi episode_steps_;
  Finished finished_;
  std::int64_t updates_ = 0, ticks_ = 0;
  double policy_rate_;
  bool started_ = false;
};

}  // namespace traceur::learn
