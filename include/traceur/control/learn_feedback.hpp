// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

#include "traceur/control/episodes.hpp"
#include "traceur/optimize/cma_es.hpp"

namespace traceur::control {

/// How far worlds are changed, at full perturbation. Ratios are uniform in their logarithm.
struct WorldRange {
  double harder = 30;     ///< ground at most so many times as hard
  double softer = 1.5;    ///< and at least this part
  double friction = 1.3;  ///< friction at most so many times, at least this part
  int finer = 4;          ///< time steps at most so many in the place of one
};

/// Settings of learning a feedback law by CMA-ES in stages of growing difficulty (Terrain Runner s3; Ding et al. 2012).
struct FeedbackLearning {
  int population = 32;
  int starts = 16;              ///< episodes of each candidate, new each generation, shared by the population
  double sigma = 0.15;          ///< first standard deviation of the law's numbers
  int generations = 120;        ///< in all
  int patience = 100;           ///< generations at full difficulty without a better validation before it ends
  // Cyclic motions: length and perturbation grow whenever the mean's cost is below `advance`.
  double first_seconds = 4;
  double last_seconds = 20;
  double seconds_growth = 1.6;
  double advance = 1.2;
  double perturbation_step = 0.25;
  // One-shot motions: perturbation grows whenever this share of the mean's episodes succeed.
  double first_perturbation = 0.15;
  double one_shot_step = 0.05;
  double success_to_advance = 0.6;
  int validation_episodes = 64;
  int validate_every = 5;       ///< generations
  Perturbation starts_moved;
  /// Worlds that the episodes of a candidate are shared out to: the controller's own and changed ones, drawn anew each
  /// generation and the same for all candidates. Validation has as many, fixed. 1: its own alone.
  int worlds = 1;
  WorldRange changes;
  double slide = 0; ///< cost of soles that slide at 1 m/s, while they carry
  double push = 0;  ///< most N s of a push of a tenth of a second in each episode, at any moment and to any side
  std::uint64_t seed = 1;
};

/// World `index` of so many drawn at `draw`; the first is the controller's own. `scale` from 0 to 1 shrinks the changes.
inline WorldChange draw_world(const WorldRange& range, double scale, std::uint64_t seed, std::uint64_t draw, int index) {
  if (index == 0) return {};
  core::RandomStream random(seed, draw, static_cast<std::uint64_t>(index));
  WorldChange w;
  w.ground = std::exp(scale * random.uniform(-std::log(range.softer), std::log(range.harder)));
  w.friction = std::exp(scale * random.uniform(-1.0, 1.0) * std::log(range.friction));
  w.finer = 1 + static_cast<int>(random.uniform(0.0, 1.0) * (1 + scale * (range.finer - 1)));
  w.finer = std::min(w.finer, range.finer);
  return w;
}

/// A push of at most `most` N s during a tenth of a second, at a moment of the first `seconds`; the same for the same numbers.
inline Push draw_push(double most, double seconds, double tick, std::uint64_t seed, std::uint64_t draw, int start) {
  if (!(most > 0)) return {};
  constexpr double length = 0.1;
  core::RandomStream random(seed, draw, static_cast<std::uint64_t>(start));
  const double size = most / length * random.uniform(0.0, 1.0), angle = 2 * std::numbers::pi * random.uniform(0.0, 1.0);
  Push p;
  p.force = {size * std::cos(angle), size * std::sin(angle), 0};
  p.ticks = std::max(1, static_cast<int>(std::lround(length / tick)));
  p.first_tick = static_cast<int>(random.uniform(0.0, 1.0) * std::max(0.0, seconds - length) / tick);
  return p;
}

/// Where learning stands; enough, with the controller and the settings, to go on from to the same bits.
struct FeedbackProgress {
  int generation = 0;
  double seconds = 0, perturbation = 0;
  double mean_cost = 0;
  double mean_success = 0;       ///< share of the mean's episodes that survived (and ended well)
  double best_validation = 1e300;
  Eigen::VectorXd best_law;
  int since_best = 0;
  double simulated_seconds = 0;
};

/// Cost of one episode: ten times the share of time lost, plus the mean distance from the sensory reference; a one-shot
/// motion also pays for not reaching its end pose and for not holding it, and soles for `slide` times their sliding.
inline double episode_cost(const EpisodeResult& r, double whole_seconds, bool cyclic, double slide = 0) {
  const double lost = std::max(0.0, 1.0 - r.seconds / whole_seconds);
  double cost = 10 * lost + (r.seconds > 0 ? r.deviation : 10.0);
  if (!cyclic && !r.reached_end) cost += 2;
  if (!cyclic && !r.held) cost += 1;
  cost += slide * r.slide_m_s;
  return std::isfinite(cost) ? cost : 100.0;
}

/// Learns the law of a controller by CMA-ES, starting from the law it has, and returns the law that did best in validation.
/// The mean of each generation is evaluated as one more candidate, since the best of a noisy generation is mostly luck.
/// Deterministic for a seed on any executor. `progress(state, cma)` is told after every generation; returning false stops.
/// To resume, pass the state and optimizer it was last given. Throws Error on settings out of range.
template <class S, core::Executor E>
FeedbackProgress learn_feedback(std::vector<EpisodeRunner<S>>& runners, const Controller& controller, const FeedbackLearning& p, E& executor,
                                const std::function<bool(const FeedbackProgress&, const optimize::CmaEs&)>& progress = {},
                                const optimize::CmaEs* resume_optimizer = nullptr, const FeedbackProgress* resume_state = nullptr) {
  constexpr int width = core::lane_count<S>;
  const int n = controller.shape.size();
  if (n < 2) throw Error("feedback learning: expected a law with parameters");
  if (p.population < 4 || p.starts < 1 || p.generations < 1 || p.validation_episodes < 1 || p.validate_every < 1 ||
      p.worlds < 1)
    throw Error("feedback learning: population, starts, generations, validation_episodes, validate_every and worlds must be "
                "positive (population at least 4)");
  if (!(p.changes.harder >= 1 && p.changes.softer >= 1 && p.changes.friction >= 1 && p.changes.finer >= 1))
    throw Error("feedback learning: the ratios of a world's changes must be 1 or more");
  if (!(p.slide >= 0) || !std::isfinite(p.slide)) throw Error("feedback learning: slide: expected zero or more");
  if (!(p.push >= 0) || !std::isfinite(p.push)) throw Error("feedback learning: push: expected zero or more N s");
  optimize::CmaEsParameters cp;
  cp.population = p.population;
  cp.sigma = p.sigma;
  cp.seed = p.seed;
  cp.tolerance_cost = 0;
  cp.tolerance_x = 0;
  optimize::CmaEs cma = resume_optimizer ? *resume_optimizer : optimize::CmaEs(controller.law, cp);
  FeedbackProgress state;
  if (resume_state) {
    state = *resume_state;
  } else {
    state.seconds = p.first_seconds;
    state.perturbation = controller.cyclic ? 0.0 : p.first_perturbation;
    state.best_law = controller.law;
  }
  const double one_shot_seconds = controller.ticks() * controller.tick + EpisodeSettings{}.hold;
  const auto whole_of = [&](const EpisodeSettings& e) { return controller.cyclic ? e.seconds : one_shot_seconds; };
  constexpr std::uint64_t worlds_of_validation = std::uint64_t{1} << 40, pushes = std::uint64_t{1} << 41;
  const auto enter = [&](const WorldChange& w) {
    for (EpisodeRunner<S>& r : runners) r.change_world(w);
  };
  // Mean cost of a law at full difficulty on starts of its own.
  const auto validate = [&](const Eigen::VectorXd& law) {
    Controller trial = controller;
    trial.law = law;
    EpisodeSettings v;
    v.seconds = p.last_seconds;
    v.perturbation = 1;
    v.starts = p.starts_moved;
    v.seed = p.seed;
    v.measure_slide = p.slide > 0;
    const int each = (p.validation_episodes + p.worlds - 1) / p.worlds;
    double sum = 0;
    for (int w = 0; w < p.worlds; ++w) {
      v.stream = 999 - static_cast<std::uint64_t>(w);
      enter(draw_world(p.changes, 1, p.seed, worlds_of_validation, w));
      const auto push = [&](int k) { return draw_push(p.push, whole_of(v), controller.tick, p.seed, pushes + v.stream, k); };
      for (const EpisodeResult& r : run_episodes(runners, trial, v, each, executor, push)) {
        sum += episode_cost(r, whole_of(v), controller.cyclic, p.slide);
        state.simulated_seconds += r.seconds;
      }
    }
    return sum / (each * p.worlds);
  };
  // What is returned is never worse than what was given.
  if (!resume_state) state.best_validation = validate(controller.law);
  Eigen::VectorXd costs(p.population);
  while (state.generation < p.generations && state.since_best < p.patience) {
    const Eigen::MatrixXd& candidates = cma.ask();
    const Eigen::VectorXd mean = cma.mean();
    EpisodeSettings e;
    e.seconds = state.seconds;
    e.perturbation = state.perturbation;
    e.starts = p.starts_moved;
    e.seed = p.seed;
    e.measure_slide = p.slide > 0;
    e.stream = 1000 + static_cast<std::uint64_t>(state.generation);
    const double whole = whole_of(e);
    // Without perturbation all starts are the same one.
    const int starts = state.perturbation > 0 ? std::max(1, p.starts / p.worlds) : 1;
    const int jobs = (p.population + 1) * starts;
    std::vector<EpisodeResult> results(static_cast<std::size_t>(jobs));
    Eigen::VectorXd sums = Eigen::VectorXd::Zero(p.population + 1);
    int successes = 0;
    for (int w = 0; w < p.worlds; ++w) {
      enter(draw_world(p.changes, state.perturbation, p.seed, worlds_of_validation + 1 + static_cast<std::uint64_t>(state.generation), w));
      const auto start = [&](int job) { return w * starts + job % starts; };
      executor.run((jobs + width - 1) / width, [&](int g, int worker) {
        const int used = std::min(width, jobs - g * width);
        const auto candidate = [&](int lane) { return (g * width + lane) / starts; };
        const auto r = runners[static_cast<std::size_t>(worker)].run(
            controller, e, used,
            [&](int lane) { return candidate(lane) < p.population ? candidates.col(candidate(lane)).data() : mean.data(); },
            [&](int lane) { return start(g * width + lane); },
            [&](int lane) {
              return draw_push(state.perturbation * p.push, whole, controller.tick, p.seed, pushes + e.stream, start(g * width + lane));
            });
        for (int l = 0; l < used; ++l) results[static_cast<std::size_t>(g * width + l)] = r[static_cast<std::size_t>(l)];
      });
      for (const EpisodeResult& r : results) state.simulated_seconds += r.seconds;
      for (int k = 0; k <= p.population; ++k)
        for (int s = 0; s < starts; ++s) {
          const EpisodeResult& r = results[static_cast<std::size_t>(k * starts + s)];
          sums[k] += episode_cost(r, whole, controller.cyclic, p.slide);
          if (k == p.population && (controller.cyclic ? r.survived : r.reached_end && r.held)) ++successes;
        }
    }
    const int episodes = p.worlds * starts;
    for (int k = 0; k < p.population; ++k) costs[k] = sums[k] / episodes;
    const double mean_cost = sums[p.population] / episodes;
    cma.tell(costs);
    state.mean_cost = mean_cost;
    state.mean_success = static_cast<double>(successes) / episodes;
    ++state.generation;

    const bool full = controller.cyclic ? state.seconds >= p.last_seconds && state.perturbation >= 1 : state.perturbation >= 1;
    if (controller.cyclic) {
      if (!full && mean_cost < p.advance) {
        state.seconds = std::min(p.last_seconds, state.seconds * p.seconds_growth);
        state.perturbation = std::min(1.0, state.perturbation + p.perturbation_step);
      }
    } else if (!full && state.mean_success >= p.success_to_advance) {
      state.perturbation = std::min(1.0, state.perturbation + p.one_shot_step * (state.mean_success > 0.9 ? 2 : 1));
    }
    if (state.generation % p.validate_every == 0 || state.generation == p.generations) {
      const Eigen::VectorXd law = cma.mean();
      const double validation = validate(law);
      if (validation < state.best_validation) {
        state.best_validation = validation;
        state.best_law = law;
        state.since_best = 0;
      } else if (full) {
        state.since_best += p.validate_every;
      }
    }
    if (progress && !progress(state, cma)) break;
    if (cma.finished()) break;
  }
  enter({});
  return state;
}

}  // namespace traceur::control
