// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <traceur/core/error.hpp>
#include <traceur/core/random.hpp>
#include <traceur/parameterize/density.hpp>
#include <traceur/parameterize/elite_set.hpp>
#include <traceur/parameterize/kd_tree.hpp>
#include <traceur/parameterize/metropolis.hpp>

namespace traceur::parameterize {

/// Lee et al. 2021, Eq. 10: how good an episode is, from its deviations of each kind (pose, velocity, contact, drag),
///
///     F = product of exp(-deviation_i / sigma_i^2) + w_constraint r_constraint
///
/// Each deviation is the paper's mean over time of a sum of squares. Both spans have the same length.
inline double fitness(std::span<const double> deviations, std::span<const double> sigmas, double constraint = 0.0,
                      double constraint_weight = 0.1) noexcept {
  double exponent = 0.0;
  for (std::size_t i = 0; i < deviations.size(); ++i) exponent -= deviations[i] / (sigmas[i] * sigmas[i]);
  return std::exp(exponent) + constraint_weight * constraint;
}

/// The paper's sigmas for pose, velocity, contact and drag.
inline constexpr double fitness_sigmas[] = {2.67, 75.5, 1.3, 0.7};

/// An estimate of the marginal value function, Lee et al. 2021, Eq. 16: the value of pursuing task parameters a,
/// whatever the rest of the state. `add(a, value)` takes an observation, `value(a)` gives the estimate.
template <class V>
concept MarginalValue = requires(V& v, const V& constant, const Eigen::VectorXd& a, double value) {
  v.add(a, value);
  { constant.value(a) } -> std::convertible_to<double>;
};

/// A marginal value by local means: the latest observations around a, weighted by a Gaussian of their distance and
/// drawn towards the mean of all where there are few. It forgets as the policy changes: only the latest `memory` count.
/// For a handful of task parameters it stands in for the paper's network.
class LocalValue {
public:
  /// `unit` (n) and `bandwidth` as of a `KernelDensity`; `prior` is the weight of the mean, in observations. Throws
  /// Error.
  explicit LocalValue(const Eigen::VectorXd& unit, double bandwidth = 0.1, int memory = 1000, double prior = 0.1)
      : tree_(unit.size(), unit), bandwidth_(bandwidth), memory_(memory), prior_(prior) {
    if (!(std::isfinite(bandwidth) && bandwidth > 0.0))
      throw Error("LocalValue: bandwidth: expected a finite number above 0");
    if (memory < 1) throw Error("LocalValue: memory: expected 1 or more");
    if (!(prior > 0.0)) throw Error("LocalValue: prior: expected a number above 0");
  }

  /// A value that is not finite is left out.
  void add(const Eigen::VectorXd& a, double value) {
    if (!std::isfinite(value)) return;
    if (tree_.size() == memory_) {
      // The tree gives the last point the number of the one removed: so does the list.
      const int oldest = age_[next_];
      sum_ -= values_[static_cast<std::size_t>(oldest)];
      tree_.remove(oldest);
      const int last = tree_.size();
      const std::size_t moved = place_[static_cast<std::size_t>(last)];
      values_[static_cast<std::size_t>(oldest)] = values_[static_cast<std::size_t>(last)];
      place_[static_cast<std::size_t>(oldest)] = moved;
      age_[moved] = oldest;
      values_.pop_back();
      place_.pop_back();
    } else {
      age_.push_back(0);
    }
    tree_.insert(a);
    values_.push_back(value);
    place_.push_back(next_);
    age_[next_] = tree_.size() - 1;
    sum_ += value;
    next_ = (next_ + 1) % static_cast<std::size_t>(memory_);
  }

  double value(const Eigen::VectorXd& a) const {
    if (tree_.size() == 0) return 0.0;
    double weights = prior_, sum = prior_ * sum_ / tree_.size();
    tree_.for_each_within(a, 2.0 * bandwidth_, [&](int i, double squared) {
      const double weight = std::exp(-squared / (bandwidth_ * bandwidth_));
      weights += weight;
      sum += weight * values_[static_cast<std::size_t>(i)];
      return true;
    });
    return sum / weights;
  }

private:
  KdTree tree_;
  double bandwidth_;
  int memory_;
  double prior_;
  std::vector<double> values_;      // of the tree's points
  std::vector<std::size_t> place_;  // of the tree's points in `age_`
  std::vector<int> age_;            // a ring of the tree's points, `next_` the oldest once it is full
  std::size_t next_ = 0;
  double sum_ = 0.0;
};

/// How a curriculum goes about its task space: the paper's method and the baselines of Lee et al. 2021, s7.3.
enum class Schedule {
  adaptive,       ///< explores or refines, whichever finds more (s6.3)
  uniform,        ///< draws from the whole task space
  explore_first,  ///< explores until all is explored, then refines
  mastering,      ///< refines until the mean marginal value reaches a threshold, explores until it has fallen below
  alternating     ///< explores and refines for a fixed number of batches each
};

enum class Phase { explore, refine };

struct CurriculumParameters {
  /// The box of task parameters (n each), and the one that the reference motion has.
  Eigen::VectorXd lower, upper, start;
  /// Radius, threshold, margin, and the unit of each task parameter.
  EliteSetParameters elites;
  /// Of the density by which visited regions are told from others, Eq. 15.
  KernelDensity::Parameters density;
  /// D and D': denser than D is heavily visited; exploration draws from between the two.
  double heavy = 0.8, light = 0.2;
  /// Task parameters per batch.
  int batch = 20;
  Schedule schedule = Schedule::adaptive;

  /// Points of the box tried for a batch of the rim. If none is on it, all is explored.
  int trials = 10000;
  /// k of Eq. 17.
  double preference = 10.0;
  /// Markov chains of a refinement, draws of each, and after how many batches they are drawn anew.
  int chains = 10, draws = 100, renewal = 5;
  /// Batches of a refinement phase that are drawn evenly among elites before the marginal value is trusted.
  int even_batches = 4;

  /// adaptive: exploration rates are compared as means over so many batches of each kind, not before a phase has lasted
  /// `least` batches; every `probe_every` batches, `probes` of the other kind are put in.
  int window = 5, least = 10, probe_every = 10, probes = 2;
  /// alternating: batches of a phase.
  int alternation = 20;
  /// mastering: the mean marginal value that counts as mastery, and the batches after which a phase ends regardless.
  double mastery = 0.0;
  int timeout = 100;

  std::uint64_t seed = 0;
};

/// What the authors' published program uses where it differs from the paper: parameters by the box's sides, a finer
/// elite set, and a wider kernel of which it takes several elites to reach the thresholds.
inline CurriculumParameters published_code(const Eigen::VectorXd& lower, const Eigen::VectorXd& upper,
                                           const Eigen::VectorXd& start) {
  CurriculumParameters p;
  p.lower = lower;
  p.upper = upper;
  p.start = start;
  p.elites.unit = upper - lower;
  p.elites.radius = 0.015;
  p.density.bandwidth = std::sqrt(1.0 / 500.0);
  p.density.peak = 0.1;
  p.density.reach = 0.2 / p.density.bandwidth;
  p.heavy = 0.7;
  p.light = 0.3;
  p.preference = 5.0;
  return p;
}

/// One simulated episode: which task parameters of the batch it pursued, which it achieved, how good it was, and the
/// reward it collected. The achieved ones count for the elites, whatever was pursued (hindsight, s5.1); the value
/// counts for the pursued ones. An episode that failed has a fitness below the threshold, or not a number.
template <class Payload = Eigen::VectorXd>
struct Attempt {
  int task = 0;
  Eigen::VectorXd achieved;
  double fitness = 0.0;
  double value = 0.0;
  Payload payload{};
};

/// Decides what to practise: Lee et al. 2021, s6. The user draws a batch of task parameters, practises them, and tells
/// how the episodes went:
///
///     const Eigen::MatrixXd& tasks = curriculum.ask();       // a column each
///     ... 30 episodes of each column, a policy update ...
///     curriculum.tell(attempts);
///
/// Exploration draws evenly from the rim of what is known, D' < density < D. Refinement draws by Markov chains within
/// the heavily visited region, density > D, with a preference for low marginal value (Eq. 17). Under `adaptive`, a
/// phase ends when the other kind of batch makes more discoveries: exploration when its rate has fallen to that of
/// refinement or below, refinement when exploration's rate is above its own. Both rates are kept up to date by probes.
///
/// Batch b draws from RandomStream(seed, 0, b): nothing else is random.
template <class Payload = Eigen::VectorXd, MarginalValue Value = LocalValue>
class Curriculum {
public:
  /// Throws Error that names the parameter.
  explicit Curriculum(const CurriculumParameters& parameters) requires std::same_as<Value, LocalValue>
      : Curriculum(parameters, LocalValue(unit_of(checked(parameters)), 2.0 * parameters.elites.radius)) {}
  Curriculum(const CurriculumParameters& parameters, Value value)
      : parameters_(checked(parameters)),
        elites_(parameters.lower.size(), parameters.elites),
        density_(parameters.density),
        value_(std::move(value)) {
    if (parameters_.schedule == Schedule::mastering) phase_ = Phase::refine;
  }

  const CurriculumParameters& parameters() const noexcept { return parameters_; }
  const EliteSet<Payload>& elites() const noexcept { return elites_; }
  const Value& marginal_value() const noexcept { return value_; }
  /// The phase the schedule is in, and the kind of the batch to be told, which differs from it during a probe.
  Phase phase() const noexcept { return phase_; }
  Phase batch_phase() const noexcept { return probing_ > 0 ? other(phase_) : phase_; }
  /// Batches told, and how many of them since the phase began.
  int batches() const noexcept { return batches_; }
  int phase_batches() const noexcept { return phase_batches_; }
  /// The mean number of discoveries in the last batches of a kind; 0 before the first.
  double exploration_rate(Phase kind) const noexcept {
    const Rates& rates = rates_[static_cast<std::size_t>(kind)];
    double sum = 0.0;
    for (const double rate : rates.last) sum += rate;
    return rates.last.empty() ? 0.0 : sum / static_cast<double>(rates.last.size());
  }

  double density(const Eigen::VectorXd& a) const { return density_(elites_, a); }

  /// The share of the task space that is heavily visited, ER, over `samples` points that do not change from call to
  /// call.
  double explored(int samples = 1000) const {
    core::RandomStream random(parameters_.seed, 1);
    int heavy = 0;
    for (int i = 0; i < samples; ++i) heavy += density(anywhere(random)) > parameters_.heavy;
    return static_cast<double>(heavy) / samples;
  }

  /// The mean marginal value over the heavily visited region, taken at the elites; 0 without any.
  double mean_value() const {
    double sum = 0.0;
    int count = 0;
    // A hundred will do for a mean.
    const int step = std::max(1, elites_.size() / 128);
    for (int i = 0; i < elites_.size(); i += step, ++count) sum += value_.value(elites_.parameter(i));
    return count == 0 ? 0.0 : sum / count;
  }

  /// The task parameters to practise, n by batch; the same until `tell`.
  const Eigen::MatrixXd& ask() {
    if (asked_) return tasks_;
    core::RandomStream random(parameters_.seed, 0, static_cast<std::uint64_t>(batches_));
    tasks_.resize(parameters_.lower.size(), parameters_.batch);
    exhausted_ = false;
    if (parameters_.schedule == Schedule::uniform) {
      for (Eigen::Index i = 0; i < tasks_.cols(); ++i) tasks_.col(i) = anywhere(random);
    } else if (elites_.size() == 0) {
      for (Eigen::Index i = 0; i < tasks_.cols(); ++i) tasks_.col(i) = parameters_.start;
    } else if (batch_phase() == Phase::refine || !draw_rim(random)) {
      draw_known(random);
    }
    asked_ = true;
    return tasks_;
  }

  /// Takes the episodes of the batch, any number of each task. Achieved parameters outside the box are left out. Throws
  /// Error if no batch was asked for, or a task or a size is wrong; nothing is changed then.
  void tell(std::span<Attempt<Payload>> attempts) {
    if (!asked_) throw Error("Curriculum: tell: expected ask before it");
    for (std::size_t i = 0; i < attempts.size(); ++i) {
      if (attempts[i].task < 0 || attempts[i].task >= tasks_.cols() || attempts[i].achieved.size() != tasks_.rows()) {
        throw Error("Curriculum: tell: expected a task of the batch and " + std::to_string(tasks_.rows()) +
                    " achieved parameters in attempt " + std::to_string(i));
      }
    }
    asked_ = false;
    int discoveries = 0;
    for (Attempt<Payload>& attempt : attempts) {
      value_.add(tasks_.col(attempt.task), attempt.value);
      if (!inside(attempt.achieved)) continue;
      discoveries += elites_.insert(attempt.achieved, attempt.fitness, std::move(attempt.payload)).discovery;
    }
    ++batches_;
    proceed(discoveries);
  }
  void tell(std::vector<Attempt<Payload>>&& attempts) { tell(std::span<Attempt<Payload>>(attempts)); }

private:
  struct Rates {
    std::vector<double> last;
  };

  static Phase other(Phase phase) noexcept { return phase == Phase::explore ? Phase::refine : Phase::explore; }

  static Eigen::VectorXd unit_of(const CurriculumParameters& p) {
    return p.elites.unit.size() > 0 ? p.elites.unit : Eigen::VectorXd(Eigen::VectorXd::Ones(p.lower.size()));
  }

  static const CurriculumParameters& checked(const CurriculumParameters& p) {
    const auto require = [](bool holds, const char* what) {
      if (!holds) throw Error(std::string("Curriculum: ") + what);
    };
    const Eigen::Index n = p.lower.size();
    require(n >= 1 && p.upper.size() == n && p.start.size() == n, "lower, upper, start: expected as many numbers each");
    for (Eigen::Index d = 0; d < n; ++d) {
      require(std::isfinite(p.lower(d)) && std::isfinite(p.upper(d)) && p.lower(d) < p.upper(d),
              "lower: expected finite numbers below those of upper");
      require(p.lower(d) <= p.start(d) && p.start(d) <= p.upper(d), "start: expected a point between lower and upper");
    }
    require(p.elites.radius > 0.0, "elites.radius: expected a number above 0");
    require(0.0 <= p.light && p.light < p.heavy, "light: expected 0 or more and less than heavy");
    require(p.batch >= 1 && p.trials >= 1, "batch, trials: expected 1 or more");
    require(p.chains >= 1 && p.draws >= 1 && p.renewal >= 1, "chains, draws, renewal: expected 1 or more");
    require(p.window >= 1 && p.least >= 1 && p.probe_every >= 1 && p.probes >= 0,
            "window, least, probe_every: expected 1 or more, and 0 or more probes");
    require(p.alternation >= 1, "alternation: expected 1 or more");
    require(p.timeout >= 1, "timeout: expected 1 or more");
    return p;
  }

  bool inside(const Eigen::VectorXd& a) const noexcept {
    for (Eigen::Index d = 0; d < a.size(); ++d) {
      if (!(parameters_.lower(d) <= a(d) && a(d) <= parameters_.upper(d))) return false;
    }
    return true;
  }

  Eigen::VectorXd anywhere(core::RandomStream& random) const {
    Eigen::VectorXd a(parameters_.lower.size());
    for (Eigen::Index d = 0; d < a.size(); ++d) a(d) = random.uniform(parameters_.lower(d), parameters_.upper(d));
    return a;
  }

  int any_elite(core::RandomStream& random) const noexcept {
    return static_cast<int>(random.below(static_cast<std::uint32_t>(elites_.size())));
  }

  // Fills the batch from the rim, evenly, by rejection. False if there is no rim to be found.
  bool draw_rim(core::RandomStream& random) {
    // With a kernel that takes several elites to reach D', there may be no rim yet: then all that is next to an elite
    // will do, unless it is heavily visited.
    Eigen::MatrixXd spare(tasks_.rows(), tasks_.cols());
    Eigen::Index drawn = 0, spared = 0;
    for (int trial = 0; trial < parameters_.trials && drawn < tasks_.cols(); ++trial) {
      const Eigen::VectorXd a = anywhere(random);
      const double density = this->density(a);
      if (!(0.0 < density && density < parameters_.heavy)) continue;
      if (density > parameters_.light) {
        tasks_.col(drawn++) = a;
      } else if (spared < spare.cols()) {
        spare.col(spared++) = a;
      }
    }
    if (drawn == 0) {
      drawn = spared;
      tasks_.leftCols(drawn) = spare.leftCols(drawn);
    }
    exhausted_ = drawn == 0;
    // A rim too thin to fill a batch is practised all the more.
    for (Eigen::Index i = drawn; drawn > 0 && i < tasks_.cols(); ++i) tasks_.col(i) = tasks_.col(i - drawn);
    return drawn > 0;
  }

  // Fills the batch from the heavily visited region, by Eq. 17.
  void draw_known(core::RandomStream& random) {
    const bool trusted = refined_ >= parameters_.even_batches;
    if (trusted && (pool_.cols() == 0 || refined_ % parameters_.renewal == 0)) renew_pool(random);
    ++refined_;
    for (Eigen::Index i = 0; i < tasks_.cols(); ++i) {
      if (trusted && pool_.cols() > 0) {
        tasks_.col(i) = pool_.col(static_cast<Eigen::Index>(random.below(static_cast<std::uint32_t>(pool_.cols()))));
      } else {
        tasks_.col(i) = elites_.parameter(any_elite(random));
      }
    }
  }

  void renew_pool(core::RandomStream& random) {
    pool_.resize(tasks_.rows(), 0);
    const double mean = mean_value();
    const auto log_density = [&](const Eigen::VectorXd& a) {
      if (!inside(a) || !(density(a) > parameters_.heavy)) return -std::numeric_limits<double>::infinity();
      return refinement_log_density(value_.value(a), mean, parameters_.preference);
    };
    Eigen::MatrixXd starts(tasks_.rows(), parameters_.chains);
    Eigen::Index found = 0;
    for (int trial = 0; trial < 20 * parameters_.chains && found < starts.cols(); ++trial) {
      const Eigen::VectorXd& a = elites_.parameter(any_elite(random));
      if (std::isfinite(log_density(a))) starts.col(found++) = a;
    }
    if (found == 0) return;
    MetropolisParameters p;
    p.draws = parameters_.draws;
    p.step = elites_.unit() * parameters_.density.bandwidth;
    p.seed = random.next_u64();
    pool_ = metropolis(log_density, starts.leftCols(found), p);
  }

  void enter(Phase phase) {
    phase_ = phase;
    phase_batches_ = 0;
    probing_ = 0;
    if (phase == Phase::refine) {
      refined_ = 0;
      pool_.resize(tasks_.rows(), 0);
    }
  }

  void proceed(int discoveries) {
    const Phase kind = batch_phase();
    const CurriculumParameters& p = parameters_;
    // A batch that was to explore and could not says nothing of the rim, except that there is nothing to be found.
    std::vector<double>& rates = rates_[static_cast<std::size_t>(kind)].last;
    rates.push_back(exhausted_ ? 0.0 : discoveries);
    if (static_cast<int>(rates.size()) > p.window) rates.erase(rates.begin());
    if (probing_ > 0) {
      --probing_;
    } else {
      ++phase_batches_;
    }
    switch (p.schedule) {
      case Schedule::uniform:
        return;
      case Schedule::explore_first:
        if (phase_ == Phase::explore && exhausted_) enter(Phase::refine);
        return;
      case Schedule::alternating:
        if (phase_batches_ >= p.alternation) enter(other(phase_));
        return;
      case Schedule::mastering: {
        const bool mastered = mean_value() >= p.mastery;
        const bool done = phase_ == Phase::refine ? mastered : !mastered && phase_batches_ >= p.least;
        if (done || phase_batches_ >= p.timeout) enter(other(phase_));
        return;
      }
      case Schedule::adaptive:
        break;
    }
    if (probing_ > 0) return;
    if (kind == phase_ && phase_batches_ % p.probe_every == 0) {
      probing_ = p.probes;
      return;
    }
    if (phase_batches_ < p.least) return;
    const double rim = exploration_rate(Phase::explore), known = exploration_rate(Phase::refine);
    // A tie, as when neither finds anything, is for refinement: practice may change it, while the rim of a stagnant
    // region will not.
    if (phase_ == Phase::explore ? rim <= known : rim > known) enter(other(phase_));
  }

  CurriculumParameters parameters_;
  EliteSet<Payload> elites_;
  KernelDensity density_;
  Value value_;
  Phase phase_ = Phase::explore;
  int batches_ = 0;
  int phase_batches_ = 0;
  int probing_ = 0;
  int refined_ = 0;  // refinement batches of this phase
  bool asked_ = false;
  bool exhausted_ = false;  // this batch was to explore, but there is no rim
  Rates rates_[2];
  Eigen::MatrixXd tasks_;
  Eigen::MatrixXd pool_;
};

}  // namespace traceur::parameterize
