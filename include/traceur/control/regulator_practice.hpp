// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <array>
#include <memory>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include "traceur/control/running.hpp"
#include "traceur/control/tracking_regulator.hpp"
#include "traceur/core/executor.hpp"
#include "traceur/core/random.hpp"
#include "traceur/optimize/cma_es.hpp"

namespace traceur::control {

/// x' = A x + B u + c fitted by least squares to what was seen of one tick, and to what is believed of it before.
class TickRegression {
public:
  /// `ridge`: how firmly it is believed, for each number of (x, u): as if it had been seen with squares of so much in all.
  TickRegression(LinearizedTick prior, const Eigen::VectorXd& ridge) : prior_(std::move(prior)), ridge_(ridge) {
    const Eigen::Index n = prior_.a.rows(), m = prior_.a.cols() + prior_.b.cols();
    if (prior_.a.cols() != n || prior_.b.rows() != n || ridge_.size() != m || !(ridge_.array() > 0).all())
      throw Error("regression: expected a ridge above zero for each state and action of the prior");
    squares_ = Eigen::MatrixXd::Zero(m + 1, m + 1);
    products_ = Eigen::MatrixXd::Zero(m + 1, n);
  }

  /// All that was seen so far counts for only this share of what it does.
  void forget(double share) {
    squares_ *= share;
    products_ *= share;
  }
  /// One column for each time it was seen.
  void add(const Eigen::Ref<const Eigen::MatrixXd>& x, const Eigen::Ref<const Eigen::MatrixXd>& u, const Eigen::Ref<const Eigen::MatrixXd>& next) {
    const Eigen::Index n = x.rows(), m = n + u.rows();
    if (n != prior_.a.rows() || u.rows() != prior_.b.cols() || next.rows() != n || u.cols() != x.cols() || next.cols() != x.cols())
      throw Error("regression: expected as many states, actions and next states, of the prior's size");
    Eigen::MatrixXd z(m + 1, x.cols());
    z << x, u, Eigen::RowVectorXd::Ones(x.cols());
    squares_.noalias() += z * z.transpose();
    products_.noalias() += z * (next - prior_.a * x - prior_.b * u).transpose();
  }
  /// A and B. What is off on average (c) is left to whoever made the motion.
  LinearizedTick solve() const {
    const Eigen::Index n = prior_.a.rows(), m = ridge_.size();
    Eigen::MatrixXd h = squares_;
    h.diagonal().head(m) += ridge_;
    h(m, m) += 1e-6;
    const Eigen::MatrixXd off = h.ldlt().solve(products_);
    return {prior_.a + off.topRows(n).transpose(), prior_.b + off.middleRows(n, m - n).transpose()};
  }

private:
  LinearizedTick prior_;
  Eigen::VectorXd ridge_;
  Eigen::MatrixXd squares_, products_;
};

/// How a regulator practises.
struct PracticeSettings {
  int rounds = 6;
  int rollouts = 1024;      ///< of each round
  double noise = 0.05;      ///< standard deviation of what is added to targets in every tick, rad
  double prior = 100;       ///< how often seen what linearize finds counts for, by steps as large as its own
  double memory = 0.8;      ///< how much of what a round saw counts in the next
  int trials = 256;         ///< starts that judge each round
  double enough = 0.995;    ///< share of them with which it ends early
  int rank = 8;             ///< of gains; 0: whole
  double most_tilt = 1.15;  ///< lost when turned away from the motion by more than this, rad,
  double most_sunk = 0.35;  ///< or lower than it by more than this, m;
  double last_tilt = 0.3;   ///< at the end by more than this, rad,
  double last_sunk = 0.1;   ///< this, m,
  double last_speed = 0.5;  ///< or with a root velocity off by more than this, m/s
  std::uint64_t seed = 1;
};

/// A start of a rollout, and how much farther along x than it was simulated the motion shall be done.
struct PracticeStart : RunningStart {
  double along = 0;  ///< m
};

/// What practice came to.
struct PractisedRegulator {
  std::vector<Gain> gains;  ///< of each tick
  double share = 0;         ///< of trials that it keeps up to the last of them
  int round = 0;            ///< that made it; 0: the first, from linearize alone
};

/// How targets are refined for a regulator.
struct RefinementSettings {
  int generations = 60;     ///< 0: not at all
  int population = 48;
  int starts = 32;          ///< of each candidate
  int knots = 6;            ///< of each joint's offsets, which are linear between them
  double sigma = 0.02;      ///< first standard deviation of offsets, rad
  double enough = 0.99;     ///< share of the practice's trials with which it ends
};

/// What refinement came to.
struct RefinedTargets {
  Eigen::MatrixXd targets;  ///< nq x ticks
  double share = 0;         ///< of the practice's trials that are kept up to the last tick
  int generation = 0;       ///< after which; 0: as they were
};

/// Makes a regulator for a simulated motion and improves it by practice: rollouts under the regulator, with noise on targets,
/// show how the next state depends on state and targets where it is really used (contacts that come and go with what one
/// corrects are not what differences about the motion say); A and B of every tick are fitted to that, gains made anew, and so
/// on. The best round's are kept, as trials have it. `Aid` does what is done after every tick.
template <class S, class Aid>
class RegulatorPractice {
public:
  using T = core::Element<S>;
  static constexpr int width = core::lane_count<S>;

  /// Gains are made for the first `ticks` of the motion. All must outlive it.
  RegulatorPractice(const sim::Model& model, const Roles& roles, const sim::Parameters& simulation, const sim::Ground<T>& ground, const sim::Extras& extras,
                    const SimulatedMotion& motion, int ticks, int steps_per_tick, const RegulatorSettings& regulator, const PracticeSettings& practice, Aid aid)
      : model_(&model), roles_(roles), simulation_(simulation), ground_(&ground), extras_(extras), motion_(&motion), ticks_(ticks), steps_(steps_per_tick),
        regulator_(regulator), practice_(practice), aid_(std::move(aid)) {
    if (ticks < 1 || ticks > motion.ticks()) throw Error("practice: expected 1 to " + std::to_string(motion.ticks()) + " ticks");
    if (practice.rollouts < 1 || practice.trials < 1 || !(practice.noise > 0) || !(practice.prior > 0))
      throw Error("practice: expected rollouts, trials, noise and a prior above zero");
  }

  /// `begin(random)`: a PracticeStart drawn by a core::RandomStream.
  template <class Begin, class Executor>
  PractisedRegulator run(Begin&& begin, Executor& executor) const {
    const int n = 2 * model_->nv, na = model_->nv - 6;
    std::unique_ptr<Workers> workers = std::make_unique<Workers>(executor.concurrency());
    std::vector<LinearizedTick> ticks = linearize(workers->of(*this, 0), *model_, *motion_, steps_, regulator_, aid_);
    Eigen::VectorXd ridge(n + na);
    ridge << Eigen::VectorXd::Constant(model_->nv, square(regulator_.pose_step)), Eigen::VectorXd::Constant(model_->nv, square(regulator_.velocity_step)),
        Eigen::VectorXd::Constant(na, square(regulator_.target_step));
    ridge *= practice_.prior;
    std::vector<TickRegression> regressions;
    for (int t = 0; t < ticks_; ++t) regressions.emplace_back(ticks[static_cast<std::size_t>(t)], ridge);
    PractisedRegulator best;
    double best_score = -1;
    for (int round = 0;; ++round) {
      // What is fitted to few rollouts may be no more than nearly what it should be.
      std::vector<Gain> gains;
      try {
        gains = gains_of(ticks);
      } catch (const Error&) {
        if (round == 0) throw;
        break;
      }
      const auto [share, time] = judge(*workers, gains, motion_->targets, begin, executor);
      if (share + 0.01 * time > best_score) {
        best_score = share + 0.01 * time;
        best = {gains, share, round};
      }
      if (round == practice_.rounds || share >= practice_.enough) break;
      for (TickRegression& r : regressions) r.forget(practice_.memory);
      see(*workers, gains, begin, static_cast<std::uint64_t>(round), regressions, executor);
      executor.run(ticks_, [&](int t, int) { ticks[static_cast<std::size_t>(t)] = regressions[static_cast<std::size_t>(t)].solve(); });
    }
    return best;
  }

  /// Targets with which a regulator keeps more starts to the motion than with the motion's own: offsets of all joints, by CMA-ES
  /// over how long and how near it is kept from starts that are new in each generation.
  template <class Begin, class Executor>
  RefinedTargets refine(const std::vector<Gain>& gains, const RefinementSettings& settings, Begin&& begin, Executor& executor) const {
    if (settings.knots < 2 || settings.population < 2 || settings.starts < 1 || !(settings.sigma > 0))
      throw Error("refinement: expected at least 2 knots, a population of 2, a start and a standard deviation above zero");
    std::unique_ptr<Workers> workers = std::make_unique<Workers>(executor.concurrency());
    RefinedTargets best{motion_->targets, judge(*workers, gains, motion_->targets, begin, executor).share, 0};
    const int na = model_->nv - 6, groups = (settings.starts + width - 1) / width;
    const TrackingRegulator regulator = regulator_of(gains);
    optimize::CmaEsParameters p;
    p.population = settings.population;
    p.sigma = settings.sigma;
    p.covariance = optimize::Covariance::diagonal;
    p.tolerance_cost = p.tolerance_x = 0;
    p.seed = practice_.seed;
    const Eigen::VectorXd none = Eigen::VectorXd::Zero(na * settings.knots);
    optimize::CmaEs cma(none, p);
    Eigen::VectorXd costs(settings.population);
    std::vector<double> parts(static_cast<std::size_t>(settings.population * groups));
    for (int g = 0; g < settings.generations && best.share < settings.enough; ++g) {
      const Eigen::MatrixXd& x = cma.ask();
      std::vector<Eigen::MatrixXd> targets;
      for (int c = 0; c < settings.population; ++c) targets.push_back(with_offsets(x.col(c), settings.knots));
      executor.run(settings.population * groups, [&](int job, int worker) {
        const int c = job / groups;
        auto random = streams(refinement_stream + static_cast<std::uint64_t>(g), job % groups);
        Eigen::MatrixXd off(2 * model_->nv, width);
        const auto kept = roll_out(
            workers->of(*this, worker), regulator, targets[static_cast<std::size_t>(c)], random, begin, off, [](auto&&...) {}, [](auto&&...) {});
        double cost = 0;
        for (int l = 0; l < width; ++l) cost += cost_of(kept[static_cast<std::size_t>(l)], off.col(l));
        parts[static_cast<std::size_t>(job)] = cost / (groups * width);
      });
      for (int c = 0; c < settings.population; ++c) {
        // Large offsets that do as well as small ones are not worth having.
        costs[c] = 0.1 * x.col(c).squaredNorm() / settings.knots;
        for (int i = 0; i < groups; ++i) costs[c] += parts[static_cast<std::size_t>(c * groups + i)];
      }
      cma.tell(costs);
      if (g % 5 == 4 || g + 1 == settings.generations) {
        const Eigen::MatrixXd mean = with_offsets(cma.mean(), settings.knots);
        const double share = judge(*workers, gains, mean, begin, executor).share;
        if (share > best.share) best = {mean, share, g + 1};
      }
    }
    return best;
  }

private:
  /// Lanes of each worker, made when first needed.
  struct Workers {
    std::vector<std::unique_ptr<sim::Lanes<S>>> lanes;
    explicit Workers(int count) : lanes(static_cast<std::size_t>(count)) {}
    sim::Lanes<S>& of(const RegulatorPractice& p, int worker) {
      auto& l = lanes[static_cast<std::size_t>(worker)];
      if (!l) l = std::make_unique<sim::Lanes<S>>(*p.model_, p.simulation_, *p.ground_, p.extras_);
      return *l;
    }
  };
  struct Judgement {
    double share = 0, time = 0;
  };
  static constexpr std::uint64_t trial_stream = 9100, rollout_stream = 9200, refinement_stream = 9300;
  static constexpr int block = 256;  // rollouts whose states are held at once

  static double square(double x) { return x * x; }

  /// The motion's targets with offsets of all joints at knots.
  Eigen::MatrixXd with_offsets(const Eigen::VectorXd& x, int knots) const {
    const int na = model_->nv - 6;
    Eigen::MatrixXd out = motion_->targets;
    Eigen::VectorXd d = Eigen::VectorXd::Zero(model_->nv);
    for (int t = 0; t < ticks_; ++t) {
      const double at = static_cast<double>(t) * (knots - 1) / std::max(ticks_ - 1, 1);
      const int k = std::min(static_cast<int>(at), knots - 2);
      const double w = at - k;
      d.tail(na) = (1 - w) * x.segment(k * na, na) + w * x.segment((k + 1) * na, na);
      body::displace(model_->character.skeleton, motion_->targets.col(t).data(), d.data(), out.col(t).data());
    }
    return out;
  }

  /// Of one rollout: 2 or less where it is lost, the later the less; 1 or less where it is kept, the nearer the less.
  template <class Off>
  double cost_of(int kept, const Off& x) const {
    if (kept < ticks_ - 1) return 2 - static_cast<double>(kept) / ticks_;
    const double far = square(x[2] / practice_.last_sunk) + square(x.segment(3, 3).norm() / practice_.last_tilt) +
                       square(x.segment(model_->nv, 3).norm() / practice_.last_speed);
    return kept < ticks_ ? 1.0 : 0.3 * std::min(far, 3.0) / 3;
  }

  std::vector<Gain> gains_of(const std::vector<LinearizedTick>& ticks) const {
    const auto whole = regulator_gains(ticks, regulator_costs(*model_, regulator_, motion_->ticks()), regulator_.effort);
    std::vector<Gain> out;
    for (int t = 0; t < ticks_; ++t) out.push_back(reduced_gain(whole[static_cast<std::size_t>(t)], practice_.rank));
    return out;
  }

  /// One rollout with some targets in each lane; the tick up to which each was kept. `between(lanes, tick, kept)` may change targets;
  /// `after(tick, kept)` sees the states, columns of `off`.
  template <class Begin, class Between, class After>
  std::array<int, static_cast<std::size_t>(width)> roll_out(sim::Lanes<S>& lanes, const TrackingRegulator& regulator, const Eigen::MatrixXd& targets, std::array<core::RandomStream, static_cast<std::size_t>(width)>& random,
                                                            Begin&& begin, Eigen::MatrixXd& off, Between&& between, After&& after) const {
    std::array<int, static_cast<std::size_t>(width)> kept;
    std::array<double, static_cast<std::size_t>(width)> along{};
    kept.fill(0);
    std::array<bool, static_cast<std::size_t>(width)> alive;
    alive.fill(true);
    for (int l = 0; l < width; ++l) {
      const auto k = static_cast<std::size_t>(l);
      const PracticeStart s = begin(random[k]);
      along[k] = s.along;
      RunningTrials<S>::put(lanes, *model_, l, s);
    }
    lanes.refresh();
    auto scratch = TrackingRegulator::scratch(*model_);
    const auto sense = [&](int t) {
      for (int l = 0; l < width; ++l) alive[static_cast<std::size_t>(l)] = alive[static_cast<std::size_t>(l)] && state(lanes, l, t, along[static_cast<std::size_t>(l)], scratch, off.col(l));
    };
    sense(0);
    for (int t = 0; t < ticks_; ++t) {
      for (int l = 0; l < width; ++l) {
        for (int i = 7; i < model_->nq; ++i) core::set_lane(lanes.target()[i], l, static_cast<T>(targets(i, t)));
        regulator.apply(lanes, l, 1, t, {0, along[static_cast<std::size_t>(l)], 0, 0}, false, scratch);
      }
      between(lanes, t, alive, off);
      lanes.step(steps_);
      aid_(lanes, t);
      sense(t + 1);
      for (int l = 0; l < width; ++l)
        if (alive[static_cast<std::size_t>(l)]) kept[static_cast<std::size_t>(l)] = t + 1;
      after(t, alive, off);
    }
    for (int l = 0; l < width; ++l)
      if (alive[static_cast<std::size_t>(l)] && !ends_well(off.col(l))) kept[static_cast<std::size_t>(l)] = ticks_ - 1;
    return kept;
  }

  /// Where a lane is off the motion: false if it is lost.
  template <class Out>
  bool state(const sim::Lanes<S>& lanes, int lane, int t, double along, TrackingRegulator::Scratch& w, Out&& out) const {
    for (int i = 0; i < model_->nq; ++i) w.pose[i] = core::lane_of(lanes.q()[i], lane);
    for (int i = 0; i < model_->nv; ++i) w.velocity[i] = core::lane_of(lanes.v()[i], lane);
    if (lanes.failed(lane) || !w.pose.allFinite() || !w.velocity.allFinite()) return false;
    w.pose[0] -= along;
    body::normalize(model_->character.skeleton, w.pose.data());
    body::difference(model_->character.skeleton, motion_->poses.col(t).data(), w.pose.data(), w.tangent.data());
    out.head(model_->nv) = w.tangent;
    out.tail(model_->nv) = w.velocity - motion_->velocities.col(t);
    return w.tangent[2] > -practice_.most_sunk && w.tangent.segment(3, 3).norm() < practice_.most_tilt;
  }

  /// Whoever is still there, but far off, does not go on from there.
  template <class Off>
  bool ends_well(const Off& x) const {
    return x[2] > -practice_.last_sunk && x.segment(3, 3).norm() < practice_.last_tilt && x.segment(model_->nv, 3).norm() < practice_.last_speed;
  }

  TrackingRegulator regulator_of(const std::vector<Gain>& gains) const { return {*model_, roles_, {1}, {*motion_}, std::vector<std::vector<Gain>>{gains}}; }

  template <class Begin, class Executor>
  Judgement judge(Workers& workers, const std::vector<Gain>& gains, const Eigen::MatrixXd& targets, Begin&& begin, Executor& executor) const {
    const TrackingRegulator regulator = regulator_of(gains);
    const int groups = (practice_.trials + width - 1) / width;
    std::vector<std::array<int, static_cast<std::size_t>(width)>> kept(static_cast<std::size_t>(groups));
    executor.run(groups, [&](int g, int worker) {
      auto random = streams(trial_stream, g);
      Eigen::MatrixXd off(2 * model_->nv, width);
      kept[static_cast<std::size_t>(g)] = roll_out(
          workers.of(*this, worker), regulator, targets, random, begin, off, [](auto&&...) {}, [](auto&&...) {});
    });
    Judgement j;
    for (int i = 0; i < practice_.trials; ++i) {
      const int of = kept[static_cast<std::size_t>(i / width)][static_cast<std::size_t>(i % width)];
      j.share += static_cast<double>(of == ticks_) / practice_.trials;
      j.time += static_cast<double>(of) / ticks_ / practice_.trials;
    }
    return j;
  }

  std::array<core::RandomStream, static_cast<std::size_t>(width)> streams(std::uint64_t stream, int group) const {
    return [&]<std::size_t... L>(std::index_sequence<L...>) {
      return std::array<core::RandomStream, static_cast<std::size_t>(width)>{
          core::RandomStream(practice_.seed, stream, static_cast<std::uint64_t>(group * width) + L)...};
    }(std::make_index_sequence<static_cast<std::size_t>(width)>{});
  }

  /// Rollouts with noise, each tick of which goes into its regression.
  template <class Begin, class Executor>
  void see(Workers& workers, const std::vector<Gain>& gains, Begin&& begin, std::uint64_t round, std::vector<TickRegression>& regressions, Executor& executor) const {
    const TrackingRegulator regulator = regulator_of(gains);
    const int n = 2 * model_->nv, na = model_->nv - 6, rows = 2 * n + na;
    constexpr int groups = (block + width - 1) / width;
    // Of each group and tick, a column (x, u, x') for each lane; counted where it was kept.
    std::vector<Eigen::MatrixXf> seen(static_cast<std::size_t>(groups * ticks_), Eigen::MatrixXf(rows, width));
    std::vector<int> count(seen.size());
    for (int first = 0; first < practice_.rollouts; first += groups * width) {
      const int used = std::min(groups, (practice_.rollouts - first + width - 1) / width);
      executor.run(used, [&](int g, int worker) {
        auto random = streams(rollout_stream + round, first / width + g);
        Eigen::MatrixXd off(n, width), before(n, width), added(na, width);
        std::array<bool, static_cast<std::size_t>(width)> was{};
        Eigen::VectorXd target(model_->nq), base(model_->nq), d(model_->nv);
        const body::Skeleton& sk = model_->character.skeleton;
        const auto disturb = [&](sim::Lanes<S>& lanes, int t, const auto& alive, const Eigen::MatrixXd& now) {
          was = alive;
          before = now;
          for (int l = 0; l < width; ++l) {
            for (int i = 7; i < model_->nq; ++i) target[i] = core::lane_of(lanes.target()[i], l);
            target.head(7) = motion_->targets.col(t).head(7);
            body::normalize(sk, target.data());
            d.head(6).setZero();
            for (int i = 6; i < model_->nv; ++i) d[i] = practice_.noise * random[static_cast<std::size_t>(l)].normal();
            body::displace(sk, target.data(), d.data(), target.data());
            for (int i = 7; i < model_->nq; ++i) core::set_lane(lanes.target()[i], l, static_cast<T>(target[i]));
            base = motion_->targets.col(t);
            body::difference(sk, base.data(), target.data(), d.data());
            added.col(l) = d.tail(na);
          }
        };
        const auto note = [&](int t, const auto& alive, const Eigen::MatrixXd& now) {
          const auto at = static_cast<std::size_t>(t * groups + g);
          int used_columns = 0;
          for (int l = 0; l < width; ++l) {
            const auto k = static_cast<std::size_t>(l);
            if (was[k] && alive[k]) seen[at].col(used_columns++) << before.col(l).template cast<float>(), added.col(l).template cast<float>(), now.col(l).template cast<float>();
          }
          count[at] = used_columns;
        };
        roll_out(workers.of(*this, worker), regulator, motion_->targets, random, begin, off, disturb, note);
      });
      executor.run(ticks_, [&](int t, int) {
        int columns = 0;
        for (int g = 0; g < used; ++g) columns += count[static_cast<std::size_t>(t * groups + g)];
        Eigen::MatrixXd all(rows, columns);
        int at = 0;
        for (int g = 0; g < used; ++g) {
          const auto k = static_cast<std::size_t>(t * groups + g);
          all.middleCols(at, count[k]) = seen[k].leftCols(count[k]).template cast<double>();
          at += count[k];
        }
        regressions[static_cast<std::size_t>(t)].add(all.topRows(n), all.middleRows(n, na), all.bottomRows(n));
      });
    }
  }

  const sim::Model* model_;
  Roles roles_;
  sim::Parameters simulation_;
  const sim::Ground<T>* ground_;
  sim::Extras extras_;
  const SimulatedMotion* motion_;
  int ticks_, steps_;
  RegulatorSettings regulator_;
  PracticeSettings practice_;
  Aid aid_;
};

}  // namespace traceur::control
