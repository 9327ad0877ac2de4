// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "traceur/core/executor.hpp"
#include "traceur/core/random.hpp"
#include "traceur/learn/discriminator.hpp"
#include "traceur/learn/ppo_report.hpp"
#include "traceur/learn/replay_buffer.hpp"
#include "traceur/learn/rollout.hpp"
#include "traceur/nn/data_parallel.hpp"
#include "traceur/nn/normalizer.hpp"
#include "traceur/nn/optimizer.hpp"
#include "traceur/nn/parameter_check.hpp"

namespace traceur::learn {

/// Environments that also show the history a discriminator reads: `observe_style` writes one column an environment, up to
/// the state that `observe` shows, also after a step that ended an episode.
template <class E, class S = float>
concept StyledEnvironments = Environments<E, S> && requires(const E& constant, Columns<S> out) {
  { constant.style_features() } -> std::same_as<Eigen::Index>;
  { constant.observe_style(out) } -> std::same_as<void>;
};

/// Gives one history of a data set after the other: `sample(random)` has as many numbers as the environments show.
template <class R, class S = float>
concept StyleReference = requires(const R& reference, core::RandomStream& random) {
  { reference.sample(random).data() } -> std::convertible_to<const S*>;
};

struct AdversarialParameters {
  std::uint64_t seed = 1;
  double task_weight = 0.5;   ///< w_task of HIL, Eq. 4, times what environments give
  double style_weight = 0.5;  ///< w_style
  StyleReward style;
  double rate = 1e-4;         ///< learning rate
  double gradient_clip = 0;   ///< greatest Euclidean length; 0 for none
  int minibatches = 2;        ///< gradient steps between policy updates
  Eigen::Index minibatch = 512;        ///< real samples in a step, and as many fake ones
  double replay_share = 0.5;           ///< of the fake samples, as soon as there are any to replay
  Eigen::Index replay_capacity = 10000;
  Eigen::Index replay_kept = 100;      ///< samples of a rollout that go into the buffer
  double feature_clamp = 5;   ///< in deviations
  int chunks = 4;             ///< parts of a batch that threads may share; their number, not the threads', decides the bits
};

/// How a rollout was judged and how the discriminator learnt from it. At its best a discriminator is right in well over half
/// of the cases and not in all: near 1 for both kinds the policy learns nothing from it, near 1/2 it is blind.
struct AdversarialReport {
  PpoReport ppo;
  double task_reward = 0;    ///< mean of a step, as the environments gave it
  double style_reward = 0;   ///< mean of a step, unweighted
  double real_accuracy = 0;  ///< share of real samples taken for real, mean over the steps
  double fake_accuracy = 0;  ///< share of fake ones taken for fake
  double real_logit = 0, fake_logit = 0;
  double loss = 0;           ///< cross-entropy of both kinds together
  double penalty = 0;        ///< squared length of the logit's gradient at real samples
  double gradient = 0;       ///< mean length of the parameters' gradient before clipping
};

/// A run to be saved beside that of the policy.
template <class S>
struct AdversarialState {
  Eigen::Matrix<S, Eigen::Dynamic, 1> discriminator, optimizer;
  std::int64_t steps = 0;  ///< taken by the optimizer
  std::int64_t updates = 0;
  Eigen::VectorXd normalizer;
  Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> replay;
  std::int64_t replayed = 0;  ///< samples ever added
};

/// Adversarial imitation beside a policy's updates (Ho and Ermon 2016; Peng et al. 2021, "AMP"; HIL, section 5.2): a
/// discriminator tells histories of a data set from those of the policy, and what it takes for real earns a style reward,
///
///     r = w_task r_task + w_style r_style,    r_style = -log(1 - D)
///
/// `iterate` takes the place of `Ppo::iterate`. A step that ends an episode for good earns no style. Histories are
/// normalised by the statistics of the first rollout and as many real samples, which then stand still, so that penalty and
/// replay keep their meaning. All memory is taken by the constructor; the same seed gives the same bits with every executor.
template <class S = float, TwiceDifferentiable Hidden = nn::Relu, nn::Optimizer<S> DiscriminatorOptimizer = nn::Adam<S>>
class AdversarialImitation {
 public:
  using Matrix = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;
  using Vector = Eigen::Matrix<S, Eigen::Dynamic, 1>;

  /// For rollouts of so many samples. Throws Error for a parameter out of its range.
  AdversarialImitation(Discriminator<Hidden> discriminator, Eigen::Index samples, const AdversarialParameters& parameters = {})
      : parameters_(checked(parameters, samples)),
        discriminator_(std::move(discriminator)),
        optimizer_(discriminator_.parameters()),
        normalizer_(discriminator_.inputs(), {parameters.feature_clamp, 1e-4, 0}),
        replay_(discriminator_.inputs(), parameters.replay_capacity),
        parallel_(discriminator_.parameters(), parameters.chunks),
        histories_(Matrix::Zero(discriminator_.inputs(), samples)),
        real_(Matrix::Zero(discriminator_.inputs(), parameters.minibatch)),
        fake_(real_),
        logits_(Matrix::Zero(1, samples)) {
    core::RandomStream random(parameters.seed, initialization);
    theta_.setZero(discriminator_.parameters());
    gradient_.setZero(theta_.size());
    discriminator_.network().initialize(theta_.data(), random);
    block_ = std::min<Eigen::Index>(256, std::max(parallel_.largest(samples), parallel_.largest(parameters.minibatch)));
    block_ = std::max(block_, parallel_.largest(parameters.minibatch));
    for (int i = 0; i < parameters.chunks; ++i) chunks_.push_back({discriminator_.template workspace<S>(block_), {}});
  }

  const AdversarialParameters& parameters() const noexcept { return parameters_; }
  const Discriminator<Hidden>& discriminator() const noexcept { return discriminator_; }
  const Vector& theta() const noexcept { return theta_; }
  const nn::Normalizer& normalizer() const noexcept { return normalizer_; }
  const ReplayBuffer<S>& replay() const noexcept { return replay_; }
  std::int64_t updates() const noexcept { return updates_; }

  /// One rollout, judged, one lesson for the discriminator, one update of the policy. The first time a rollout goes before it
  /// that only the normalisers learn from. Throws as `Ppo::iterate` does, and Error when a gradient of the discriminator is
  /// not finite, named, with all parameters as they were.
  template <class P, class E, class R, core::Executor X>
    requires StyledEnvironments<E, S> && StyleReference<R, S>
  AdversarialReport iterate(P& ppo, E& environments, const R& reference, X& executor) {
    if (ppo.rollout().samples() != histories_.cols() || environments.style_features() != histories_.rows())
      throw Error("adversarial imitation: expected histories of " + std::to_string(histories_.rows()) + " numbers and rollouts of " +
                  std::to_string(histories_.cols()) + " samples, got " + std::to_string(environments.style_features()) + " and " +
                  std::to_string(ppo.rollout().samples()));
    if (normalizer_.samples() == 0) {
      record(ppo, environments, executor);
      learn_scale(reference);
    }
    record(ppo, environments, executor);
    AdversarialReport report = judge(ppo.rollout(), executor);
    learn(ppo.rollout(), reference, executor, report);
    keep(ppo.rollout());
    ++updates_;
    report.ppo = ppo.learn(executor);
    return report;
  }

  AdversarialState<S> state() const {
    return {theta_, optimizer_.state(), optimizer_.steps(), updates_, normalizer_.state(), replay_.state(), replay_.added()};
  }

  /// Goes on where another run was saved. Throws Error for a state that does not fit or is not finite, and leaves this as it
  /// was.
  void restore(const AdversarialState<S>& state) {
    if (state.discriminator.size() != theta_.size())
      throw Error("adversarial state: expected " + std::to_string(theta_.size()) + " parameters, got " +
                  std::to_string(state.discriminator.size()));
    if (state.updates < 0) throw Error("adversarial state: expected 0 updates or more");
    nn::check_finite("adversarial state: discriminator", discriminator_.network(), state.discriminator.data());
    DiscriminatorOptimizer optimizer = optimizer_;
    nn::Normalizer normalizer = normalizer_;
    optimizer.restore(state.optimizer, state.steps);
    normalizer.restore(state.normalizer);
    replay_.restore(state.replay, state.replayed);
    theta_ = state.discriminator;
    optimizer_ = std::move(optimizer);
    normalizer_ = std::move(normalizer);
    updates_ = state.updates;
  }

 private:
  // Streams of the seed: far from those of a policy that is given the same.
  static constexpr std::uint64_t initialization = std::uint64_t{1} << 40, scales = initialization + 1, lessons = initialization + 2,
                                 memories = initialization + 3;

  struct Chunk {
    typename Discriminator<Hidden>::template Workspace<S> work;
    struct {
      DiscriminatorTally real, fake;
    } tally;
  };

  /// Environments whose histories are written down while a policy acts in them.
  template <class E>
  struct Recorder {
    E& environments_;
    Rollout<S>& rollout_;
    Matrix& histories_;
    Eigen::Index step_ = 0;

    Eigen::Index environments() const { return environments_.environments(); }
    Eigen::Index observations() const { return environments_.observations(); }
    Eigen::Index actions() const { return environments_.actions(); }
    void reset(std::uint64_t seed) { environments_.reset(seed); }
    void observe(Columns<S> out) const { environments_.observe(out); }
    void restart(Eigen::Index e) noexcept { environments_.restart(e); }
    void step(ConstColumns<S> actions, StepResult<S>& result) {
      environments_.step(actions, result);
      environments_.observe_style(rollout_.at_step(histories_, step_++));
    }
  };

  static const AdversarialParameters& checked(const AdversarialParameters& p, Eigen::Index samples) {
    const auto at_least_zero = [](const char* what, double x) { detail::check_zero_or_more("adversarial imitation", what, x); };
    detail::check_at_least_one("adversarial imitation", "sample", samples);
    detail::check_at_least_one("adversarial imitation", "gradient step", p.minibatches);
    detail::check_at_least_one("adversarial imitation", "sample in a minibatch", p.minibatch);
    detail::check_at_least_one("adversarial imitation", "chunk", p.chunks);
    at_least_zero("task_weight", p.task_weight);
    at_least_zero("style_weight", p.style_weight);
    at_least_zero("rate", p.rate);
    at_least_zero("gradient_clip", p.gradient_clip);
    if (!(p.replay_share >= 0 && p.replay_share <= 1)) throw Error("adversarial imitation: replay_share must be in [0, 1]");
    if (!(p.style.least_doubt > 0 && p.style.least_doubt < 1)) throw Error("adversarial imitation: least_doubt must be between 0 and 1");
    at_least_zero("replay_kept", static_cast<double>(p.replay_kept));
    return p;
  }

  template <class P, class E, class X>
  void record(P& ppo, E& environments, X& executor) {
    Recorder<E> recorder{environments, ppo.rollout(), histories_};
    ppo.collect(recorder, executor);
  }

  /// The scale of the features, from the histories just recorded and as many real ones.
  template <class R>
  void learn_scale(const R& reference) {
    normalizer_.template observe<S>(histories_);
    core::RandomStream random(parameters_.seed, scales);
    for (Eigen::Index done = 0; done < histories_.cols(); done += real_.cols()) {
      const Eigen::Index count = std::min(real_.cols(), histories_.cols() - done);
      for (Eigen::Index j = 0; j < count; ++j) std::copy_n(reference.sample(random).data(), real_.rows(), real_.col(j).data());
      normalizer_.template observe<S>(real_.leftCols(count));
    }
    if (normalizer_.samples() == 0) throw Error("adversarial imitation: expected a history that is finite");
  }

  /// Normalises the recorded histories and adds what they earn to the rewards.
  template <class X>
  AdversarialReport judge(Rollout<S>& rollout, X& executor) {
    parallel_.run(executor, histories_.cols(), [&](int c, Eigen::Index first, Eigen::Index number) {
      Chunk& chunk = chunks_[static_cast<std::size_t>(c)];
      for (Eigen::Index from = first; from < first + number; from += block_) {
        const Eigen::Index count = std::min(block_, first + number - from);
        auto seen = histories_.middleCols(from, count);
        normalizer_.template apply<S>(seen, seen);
        discriminator_.template infer<S>(theta_.data(), seen, chunk.work, logits_.middleCols(from, count));
      }
    });
    AdversarialReport report;
    double judged = 0;
    const S task = static_cast<S>(parameters_.task_weight), weight = static_cast<S>(parameters_.style_weight);
    for (Eigen::Index i = 0; i < rollout.samples(); ++i) {
      const End end = rollout.end.data()[i];
      if (end == End::failed) continue;
      S& reward = rollout.reward.data()[i];
      S& rate = rollout.reward_rate.data()[i];
      report.task_reward += static_cast<double>(reward) + static_cast<double>(rate) * static_cast<double>(rollout.duration.data()[i]);
      const S style = end == End::terminated || !std::isfinite(logits_(0, i)) ? S(0) : parameters_.style(logits_(0, i));
      report.style_reward += static_cast<double>(style);
      reward = task * reward + weight * style;
      rate *= task;
      ++judged;
    }
    report.task_reward /= std::max(1.0, judged);
    report.style_reward /= std::max(1.0, judged);
    return report;
  }

  /// Whether sample i of the rollout may be learnt from.
  bool sound(const Rollout<S>& rollout, Eigen::Index i) const noexcept {
    return rollout.end.data()[i] != End::failed && histories_.col(i).allFinite();
  }
  /// A sound sample of the rollout, or -1 if there seems to be none.
  Eigen::Index draw(const Rollout<S>& rollout, core::RandomStream& random) const noexcept {
    for (int tries = 0; tries < 64; ++tries) {
      const auto i = static_cast<Eigen::Index>(random.below(static_cast<std::uint32_t>(rollout.samples())));
      if (sound(rollout, i)) return i;
    }
    return -1;
  }

  template <class R, class X>
  void learn(const Rollout<S>& rollout, const R& reference, X& executor, AdversarialReport& report) {
    DiscriminatorTally real, fake;
    double length = 0;
    for (int k = 0; k < parameters_.minibatches; ++k) {
      core::RandomStream random(parameters_.seed, lessons, static_cast<std::uint64_t>(updates_ * parameters_.minibatches + k));
      const Eigen::Index n = parameters_.minibatch;
      for (Eigen::Index j = 0; j < n; ++j) {
        std::copy_n(reference.sample(random).data(), real_.rows(), real_.col(j).data());
        const bool replayed = replay_.size() > 0 && static_cast<double>(j) < parameters_.replay_share * static_cast<double>(n);
        const Eigen::Index i = replayed ? -1 : draw(rollout, random);
        const S* from = i >= 0 ? histories_.col(i).data() : replay_.size() > 0 ? replay_.sample(random) : nullptr;
        // A rollout without a sound step teaches nothing.
        if (from == nullptr) return;
        std::copy_n(from, fake_.rows(), fake_.col(j).data());
      }
      normalizer_.template apply<S>(real_, real_);
      for (Chunk& chunk : chunks_) chunk.tally = {};
      gradient_.setZero();
      const S share = S(1) / static_cast<S>(n);
      parallel_.run(executor, n, gradient_, [&](int c, Eigen::Index first, Eigen::Index count, S* to) {
        Chunk& chunk = chunks_[static_cast<std::size_t>(c)];
        chunk.tally.real = discriminator_.template accumulate_real<S>(theta_.data(), real_.middleCols(first, count), share, chunk.work, to);
        chunk.tally.fake = discriminator_.template accumulate_fake<S>(theta_.data(), fake_.middleCols(first, count), share, chunk.work, to);
      });
      if constexpr (nn::SharingExecutor<X>)
        executor.share(parameters_.chunks, [](int) {}, [&](int c) {
          return std::as_writable_bytes(std::span(&chunks_[static_cast<std::size_t>(c)].tally, 1));
        });
      discriminator_.template regularize<S>(theta_.data(), gradient_.data());
      const double size = parameters_.gradient_clip > 0
                              ? nn::clip_global_norm(gradient_.data(), gradient_.size(), parameters_.gradient_clip)
                              : nn::global_norm(gradient_.data(), gradient_.size());
      if (!std::isfinite(size)) {
        const std::string where = "adversarial imitation, update " + std::to_string(updates_ + 1) + ": ";
        nn::check_finite((where + "discriminator gradient").c_str(), discriminator_.network(), gradient_.data());
        throw Error(where + "a gradient is too long to measure");
      }
      optimizer_.step(theta_, gradient_, parameters_.rate);
      length += size;
      for (const Chunk& chunk : chunks_) {
        real += chunk.tally.real;
        fake += chunk.tally.fake;
      }
    }
    report.gradient = length / parameters_.minibatches;
    report.real_accuracy = real.right / real.samples;
    report.fake_accuracy = fake.right / fake.samples;
    report.real_logit = real.logit / real.samples;
    report.fake_logit = fake.logit / fake.samples;
    report.loss = (real.loss + fake.loss) / (real.samples + fake.samples);
    report.penalty = real.penalty / real.samples;
  }

  /// Puts some of the rollout's histories by.
  void keep(const Rollout<S>& rollout) noexcept {
    core::RandomStream random(parameters_.seed, memories, static_cast<std::uint64_t>(updates_));
    for (Eigen::Index k = 0; k < parameters_.replay_kept; ++k)
      if (const Eigen::Index i = draw(rollout, random); i >= 0) replay_.add(histories_.col(i).data());
  }

  AdversarialParameters parameters_;
  Discriminator<Hidden> discriminator_;
  DiscriminatorOptimizer optimizer_;
  nn::Normalizer normalizer_;
  ReplayBuffer<S> replay_;
  nn::DataParallel<S> parallel_;
  Matrix histories_, real_, fake_, logits_;
  Vector theta_, gradient_;
  std::vector<Chunk> chunks_;
  Eigen::Index block_ = 0;
  std::int64_t updates_ = 0;
};

}  // namespace traceur::learn
