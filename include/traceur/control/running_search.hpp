// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <vector>

#include "traceur/control/running.hpp"
#include "traceur/optimize/cma_es.hpp"

namespace traceur::control {

/// Settings of the search for a running control (Terrain Runner, s4.1.3).
struct RunningSearch {
  int population = 24;
  int starts = 2;           ///< runs of each candidate, new ones each generation, shared by the population
  int generations = 40;     ///< at most
  int check_every = 10;     ///< generations after which the mean is tried on starts of its own
  double sigma = 0.7;       ///< first standard deviation, in units of the scales below
  double law_scale = 0.05, offset_scale = 0.05;      ///< of M, and of a_hat, rad
  double alpha_scale = 0.05, beta_scale = 0.03;
  int trials = 16;          ///< runs by which a control is judged
  double least_share = 0.85;  ///< of them that must do what is asked for
  double good_cost = 1.0;   ///< mean cost of the trials below which the search need not go on
  double speed_tolerance = 0.25, turn_tolerance = 0.0175;
  RunningSettings run;
};

/// How good a running control is.
struct RunningJudgement {
  double share = 0;      ///< of runs that did what was asked for
  double survived = 0;   ///< share
  double cost = std::numeric_limits<double>::infinity();  ///< mean of Eq. 8
  double turn = 0, speed = 0, step_length = 0;            ///< means of those that survived
  std::int64_t runs = 0;
};

/// Runs a control from numbered starts of a stream.
template <class S>
RunningJudgement judge_running(RunningTrials<S>& trials, const RunningTask& task, const Eigen::VectorXd& control,
                               const RunningSearch& p, int count, std::uint64_t stream) {
  constexpr int width = core::lane_count<S>;
  RunningSettings e = p.run;
  e.stream = stream;
  RunningJudgement j;
  j.cost = 0;
  int survived = 0;
  for (int first = 0; first < count; first += width) {
    const int used = std::min(width, count - first);
    const auto outcomes = trials.run(
        e, used, [&](int) { return control.data(); }, [&](int) { return task; }, [&](int l) { return first + l; });
    for (int l = 0; l < used; ++l) {
      const RunningOutcome& o = outcomes[static_cast<std::size_t>(l)];
      j.cost += o.cost / count;
      j.share += o.solves(task, p.speed_tolerance, p.turn_tolerance) ? 1.0 / count : 0.0;
      if (!o.survived) continue;
      ++survived;
      j.turn += o.turn;
      j.speed += o.speed;
      j.step_length += o.step_length;
    }
  }
  j.runs = count;
  j.survived = static_cast<double>(survived) / count;
  if (survived > 0) {
    j.turn /= survived;
    j.speed /= survived;
    j.step_length /= survived;
  }
  return j;
}

/// What a search found.
struct RunningFound {
  Eigen::VectorXd control;
  RunningJudgement judgement;
  bool works = false;
  int generations = 0;
  std::int64_t runs = 0;
};

/// Improves a running control for one task by CMA-ES on Eq. 8, and judges the mean of the search, not its luckiest
/// candidate. Controls for running straight ahead are kept symmetric. Deterministic for a seed.
template <class S>
RunningFound search_running(RunningTrials<S>& trials, const AffineShape& shape, const RunningTask& task,
                            const Eigen::VectorXd& from, const RunningSearch& p) {
  constexpr int width = core::lane_count<S>;
  constexpr std::uint64_t judging = 1, searching = 1000;
  const bool straight = std::abs(task.turn) < 1e-9;
  const auto allowed = [&](Eigen::VectorXd control) {
    if (straight) control = shape.symmetric(control);
    control[shape.alpha()] = std::clamp(control[shape.alpha()], 0.3, 2.0);
    control[shape.beta()] = std::clamp(control[shape.beta()], 0.6, 1.6);
    return control;
  };
  optimize::CmaEsParameters cp;
  cp.population = p.population;
  cp.sigma = p.sigma;
  cp.seed = p.run.seed;
  cp.tolerance_cost = 0;
  cp.tolerance_x = 0;
  cp.scale = Eigen::VectorXd::Constant(shape.size(), p.offset_scale);
  cp.scale.head(shape.law.size()).setConstant(p.law_scale);
  cp.scale[shape.alpha()] = p.alpha_scale;
  cp.scale[shape.beta()] = p.beta_scale;
  optimize::CmaEs cma(from, cp);
  RunningFound best;
  const auto consider = [&](const Eigen::VectorXd& control) {
    const RunningJudgement j = judge_running(trials, task, control, p, p.trials, judging);
    best.runs += j.runs;
    if (j.cost < best.judgement.cost) {
      best.control = control;
      best.judgement = j;
    }
  };
  consider(allowed(from));
  const int jobs = p.population * p.starts;
  std::vector<Eigen::VectorXd> controls(static_cast<std::size_t>(p.population));
  Eigen::VectorXd costs(p.population);
  RunningSettings e = p.run;
  while (best.generations < p.generations && !cma.finished()) {
    if (best.judgement.share >= p.least_share && best.judgement.cost < p.good_cost) break;
    const Eigen::MatrixXd& candidates = cma.ask();
    for (int k = 0; k < p.population; ++k) controls[static_cast<std::size_t>(k)] = allowed(candidates.col(k));
    costs.setZero();
    e.stream = searching + static_cast<std::uint64_t>(best.generations);
    for (int first = 0; first < jobs; first += width) {
      const int used = std::min(width, jobs - first);
      const auto outcomes = trials.run(
          e, used, [&](int l) { return controls[static_cast<std::size_t>((first + l) / p.starts)].data(); },
          [&](int) { return task; }, [&](int l) { return (first + l) % p.starts; });
      for (int l = 0; l < used; ++l) costs[(first + l) / p.starts] += outcomes[static_cast<std::size_t>(l)].cost / p.starts;
    }
    best.runs += jobs;
    cma.tell(costs);
    ++best.generations;
    if (best.generations % p.check_every == 0 || best.generations == p.generations) consider(allowed(cma.mean()));
  }
  best.works = best.judgement.share >= p.least_share;
  return best;
}

}  // namespace traceur::control
