// SPDX-License-Identifier: MIT
#include "trainer.hpp"

#include <numbers>

#include "../common/progress.hpp"
#include "traceur/control/resimulate.hpp"
#include "traceur/core/error.hpp"

namespace terrain_runner {

using namespace traceur;
using example::interruption_asked;
using example::Interrupted;
using parameterize::Continuation;
using parameterize::ContinuationResult;
using parameterize::ContinuationTask;

namespace {

constexpr double degree = std::numbers::pi / 180;
// Streams of starts that learning never draws from.
constexpr std::uint64_t test_stream = 77, state_stream = 78;

std::vector<double> spaced(double first, double last, int count) {
  std::vector<double> out;
  for (int i = 0; i < count; ++i) out.push_back(first + (last - first) * i / (count - 1));
  return out;
}

Eigen::VectorXd to_vector(const std::vector<double>& x) { return Eigen::Map<const Eigen::VectorXd>(x.data(), static_cast<Eigen::Index>(x.size())); }

std::string text(const char* format, auto... values) {
  char line[200];
  std::snprintf(line, sizeof line, format, values...);
  return line;
}

/// One runner of trials for each worker, made when first needed.
template <class Trials, class Make>
class PerWorker {
public:
  PerWorker(int workers, Make make) : trials_(static_cast<std::size_t>(workers)), make_(std::move(make)) {}
  Trials& operator[](int worker) {
    auto& t = trials_[static_cast<std::size_t>(worker)];
    if (!t) t = make_();
    return *t;
  }

private:
  std::vector<std::unique_ptr<Trials>> trials_;
  Make make_;
};
template <class Trials, class Make>
PerWorker<Trials, Make> per_worker(int workers, Make make) {
  return {workers, std::move(make)};
}

/// Tries one manoeuvre from starts 0 to `count`, and calls `take` with what became of each.
template <class Straight, class Take>
void each_trial(control::ClearingTrials<Lane>& trials, const control::Manoeuvre& m, const control::ClearingSettings& e, int count,
                const std::vector<control::RunningState>& starts, Straight&& straight, Take&& take) {
  constexpr int width = core::lane_count<Lane>;
  for (int first = 0; first < count; first += width) {
    const int used = std::min(width, count - first);
    const auto out = trials.run(
        e, used, [&](int) -> const control::Manoeuvre& { return m; }, [&](int l) { return first + l; }, starts, straight);
    for (int l = 0; l < used; ++l) take(out[static_cast<std::size_t>(l)]);
  }
}

/// Eq. 8's frequencies are the clip's own.
control::RunningSearch for_gait(control::RunningSearch p, const Body& body) {
  p.run.frequency = {2 / body.narrow.table.duration(), body.narrow.table.speed()};
  return p;
}

}  // namespace

sim::Ground<float> step_ground(double height) {
  constexpr int cells = 60;
  constexpr double cell = 0.5;
  Eigen::MatrixXd h(cells, 1);
  for (int i = 0; i < cells; ++i) h(i, 0) = i < cells / 2 ? 0 : height;
  return terrain::HeightGrid(h, cell, -cell * cells / 2, 0);
}

Effort Effort::of(bool quick, std::uint64_t seed) {
  Effort e;
  e.gait.run.seed = e.running.run.seed = seed;
  // Who runs a course turns in the middle of a run, whichever foot is next.
  e.gait.run.either_foot = e.running.run.either_foot = true;
  // And every step is at another speed, from wherever the one before led.
  e.gait.run.push = e.running.run.push = 0.1;
  e.gait.run.wander = e.running.run.wander = {1 * degree, 0.15};
  e.gait.good_cost = 1.0;
  e.gait.generations = 120;
  e.gait.starts = 4;
  e.running.good_cost = 1.5;
  e.running.generations = 60;
  // The reference's clock and size stay while the gait itself is learned.
  e.gait.alpha_scale = e.gait.beta_scale = 1e-7;
  e.turns = spaced(0, 6, 4);
  e.speeds = spaced(2, 5, 7);
  e.running.starts = 4;
  e.heights = spaced(0.1, 0.4, 7);
  // Planning leaves the leap's beginning this far off, and what is not steady after so many steps falls later.
  e.clearing.seed = seed;
  e.clearing.place = 0.3;
  e.clearing.velocity = 0.15;
  e.clearing.steps_after = 10;
  if (quick) {
    e.turns = {0, 1, 2};
    e.speeds = {3.25, 3.5, 3.75};
    e.heights = {0.15, 0.2};
    e.first_jump_generations = 40;
    e.gait.generations = e.running.generations = 20;
    e.jump_generations = 20;
    e.max_attempts = 1;
  }
  return e;
}

Trainer::Trainer(const sim::Model& model, const control::Roles& roles, const Effort& effort, std::filesystem::path folder, int threads,
                 Progress progress)
    : model_(model), roles_(roles), effort_(effort), folder_(std::move(folder)), executor_(threads), progress_(std::move(progress)) {}

control::Controller Trainer::make_gait(const control::Controller& from) {
  const Body body(model_, roles_, from);
  control::RunningTrials<Lane> trials(model_, roles_, from.simulation, flat_, from, body.narrow);
  const double speed = std::round(4 * body.narrow.table.speed()) / 4;
  const control::RunningSearch p = for_gait(effort_.gait, body);
  const control::RunningFound found =
      control::search_running(trials, body.narrow.shape, {0, speed}, body.narrow.shape.neutral(from.law), p);
  if (!found.works) throw Error("gait: it cannot be run at " + std::to_string(speed) + " m/s");
  progress_("gait", text("runs at %.2f m/s, cost %.3g after %d generations", speed, found.judgement.cost, found.generations));
  control::RunningSettings e = p.run;
  e.perturbation = 0.3;
  e.push = 0;
  e.wander = {};
  control::Controller gait = control::resimulated(trials, model_, roles_, from, body.narrow, found.control, speed, e);
  write_gait(folder_, gait);
  return gait;
}

Continuation Trainer::learn_running(const control::Controller& gait, std::optional<Continuation> from) {
  const Body body(model_, roles_, gait);
  const control::AffineShape& shape = body.narrow.shape;
  const control::RunningSearch p = for_gait(effort_.running, body);
  auto trials = per_worker<control::RunningTrials<Lane>>(executor_.concurrency(), [&] {
    return std::make_unique<control::RunningTrials<Lane>>(model_, roles_, gait.simulation, flat_, gait, body.narrow);
  });
  if (!from) {
    const control::RunningTask seed{0, body.narrow.table.speed()};
    const control::RunningFound found = control::search_running(trials[0], shape, seed, shape.neutral(gait.law), p);
    if (!found.works) throw Error("running: the gait does not hold at its own speed");
    parameterize::ContinuationParameters grid;
    grid.axes = {to_vector(effort_.turns), to_vector(effort_.speeds)};
    grid.unit = to_vector({6, 1.5});
    grid.max_attempts = effort_.max_attempts;
    const double near = std::round(2 * seed.speed) / 2;
    from.emplace(grid, Eigen::Vector2d(0, near), found.control);
  }
  Continuation c = std::move(*from);
  const auto solve = [&](const ContinuationTask& t, int worker) {
    if (interruption_asked()) return ContinuationResult{};
    const control::RunningTask task{t.parameter[0] * degree, t.parameter[1]};
    ContinuationResult r;
    if (t.kind == ContinuationTask::Kind::test) {
      const Eigen::VectorXd x = task.turn == 0 ? shape.symmetric(t.control) : t.control;
      const control::RunningJudgement j = control::judge_running(trials[worker], task, x, p, p.trials, 1);
      r.works = j.share >= p.least_share;
      r.cost = j.cost;
      r.evaluations = j.runs;
    } else {
      const control::RunningFound found = control::search_running(trials[worker], shape, task, t.control, p);
      r.works = found.works;
      r.control = found.control;
      r.cost = found.judgement.cost;
      r.evaluations = found.runs;
    }
    return r;
  };
  std::vector<ContinuationResult> results;
  while (!c.finished()) {
    const auto& tasks = c.ask();
    results.assign(tasks.size(), {});
    executor_.run(static_cast<int>(tasks.size()), [&](int i, int worker) {
      results[static_cast<std::size_t>(i)] = solve(tasks[static_cast<std::size_t>(i)], worker);
    });
    // What was cut short must not count.
    if (interruption_asked()) throw Interrupted{};
    c.tell(results);
    write_stage(folder_, "running", c);
    progress_("running", text("%.0f %% of the range, %ld runs", 100 * c.coverage(), static_cast<long>(c.evaluations())));
  }
  return c;
}

GaitEvents Trainer::watch(const Body& body, const Eigen::VectorXd& x, double speed) {
  control::RunningTrials<Lane> trials(model_, roles_, body.gait.simulation, flat_, body.gait, body.wide);
  const int n = body.gait.ticks();
  std::vector<std::array<int, 2>> down(static_cast<std::size_t>(n), {0, 0});
  control::RunningSettings e;
  e.cycles = 10;
  const auto observe = [&](int tick, const sim::Lanes<Lane>& lanes, const auto& players) {
    if (tick < n * e.cycles / 2) return;
    for (int l = 0; l < core::lane_count<Lane>; ++l) {
      const auto t = static_cast<std::size_t>(body.wide.table.tick_of(players[static_cast<std::size_t>(l)].phase() - 0.5));
      for (std::size_t side = 0; side < 2; ++side) {
        const int foot = roles_.legs[side].foot;
        down[t][side] += core::lane_of(lanes.body_force()[static_cast<std::size_t>(foot)].z, l) > 20.0F;
      }
    }
  };
  trials.run(
      e, core::lane_count<Lane>, [&](int) { return x.data(); }, [&](int) { return control::RunningTask{0, speed}; }, [](int l) { return l; },
      observe);
  const auto half = [&](std::size_t side) {
    int most = 0;
    for (const auto& d : down) most = std::max(most, d[side]);
    return most / 2;
  };
  const std::array<int, 2> enough{half(0), half(1)};
  GaitEvents events;
  for (int t = 0; t < n; ++t) {
    const auto before = static_cast<std::size_t>((t + n - 1) % n), now = static_cast<std::size_t>(t);
    if (down[before][0] > enough[0] && down[now][0] <= enough[0]) events.right_take_off = t;
    if (down[before][1] <= enough[1] && down[now][1] > enough[1]) events.left_landing = t;
  }
  return events;
}

std::vector<control::RunningState> Trainer::states(const Body& body, const Eigen::VectorXd& x, double speed, std::uint64_t stream) {
  control::RunningTrials<Lane> trials(model_, roles_, body.gait.simulation, flat_, body.gait, body.wide);
  control::RunningSettings e;
  e.cycles = 10;
  e.seed = effort_.running.run.seed;
  e.stream = stream;
  // As courses have them: after steps at other speeds, and not quite straight.
  e.push = 0.5 * effort_.running.run.push;
  e.wander = effort_.running.run.wander;
  return control::running_states(trials, model_, body.wide, {0, speed}, x, e, 32);
}

Continuation Trainer::learn_jump(const control::Controller& gait, const RunningModel& running, Body& body, std::optional<Continuation> from) {
  const double speed = body.leap_speed;
  const Eigen::VectorXd run = running({0, speed});
  const auto straight = [&](double v) { return running({0, v}); };
  const std::vector<control::RunningState> starts = states(body, run, speed, state_stream);
  const LeapNumbers& n = body.numbers;
  const control::ClearingSettings& settings = effort_.clearing;

  struct Judged {
    double cost = 0;
    int good = 0;
  };
  using Trials = control::ClearingTrials<Lane>;
  constexpr int width = core::lane_count<Lane>;
  const auto judge = [&](Trials& trials, const Eigen::VectorXd& x, double h, int count, std::uint64_t stream) {
    const control::Manoeuvre m = body.manoeuvre(x, h);
    control::ClearingSettings e = settings;
    e.stream = stream;
    Judged j;
    each_trial(trials, m, e, count, starts, straight, [&](const control::ClearingOutcome& o) {
      j.cost += o.cost / count;
      j.good += o.survived && o.cleared;
    });
    return j;
  };
  const auto search = [&](Trials& trials, const Eigen::VectorXd& begin, double h, int generations, double difficulty, double sigma) {
    ContinuationResult r;
    const int population = effort_.jump_population, per = effort_.jump_starts;
    optimize::CmaEsParameters cp;
    cp.population = population;
    cp.sigma = sigma;
    cp.seed = settings.seed;
    cp.tolerance_cost = 0;
    cp.tolerance_x = 0;
    cp.scale = Eigen::VectorXd::Constant(n.size(), 0.08);
    cp.scale.head(n.laws()).setConstant(0.03);
    cp.scale[n.beta()] = 0.03;
    cp.scale[n.distance()] = 0.1;
    optimize::CmaEs cma(begin, cp);
    double best = std::numeric_limits<double>::infinity();
    bool done = false;
    const auto consider = [&](const Eigen::VectorXd& x) {
      const Judged j = judge(trials, x, h, effort_.jump_trials, 1);
      r.evaluations += effort_.jump_trials;
      if (j.cost >= best) return;
      best = r.cost = j.cost;
      r.control = x;
      r.works = j.good >= effort_.jump_share * effort_.jump_trials;
      done = j.good == effort_.jump_trials && j.cost < effort_.jump_good_cost;
    };
    consider(begin);
    Eigen::VectorXd costs(population);
    std::vector<control::Manoeuvre> candidates(static_cast<std::size_t>(population));
    for (int g = 0; g < generations && !done && !interruption_asked(); ++g) {
      const Eigen::MatrixXd& x = cma.ask();
      for (int k = 0; k < population; ++k)
        candidates[static_cast<std::size_t>(k)] = body.manoeuvre(x.col(k), h);
      costs.setZero();
      control::ClearingSettings e = settings;
      e.stream = 1000 + static_cast<std::uint64_t>(g);
      e.place *= difficulty;
      e.velocity *= difficulty;
      int survived = 0;
      for (int first = 0; first < population * per; first += width) {
        const int used = std::min(width, population * per - first);
        const auto out = trials.run(
            e, used, [&](int l) -> const control::Manoeuvre& { return candidates[static_cast<std::size_t>((first + l) / per)]; },
            [&](int l) { return (first + l) % per; }, starts, straight);
        for (int l = 0; l < used; ++l) {
          costs[(first + l) / per] += out[static_cast<std::size_t>(l)].cost / per;
          survived += out[static_cast<std::size_t>(l)].survived;
        }
      }
      if (3 * survived > population * per) difficulty = std::min(1.0, difficulty + 0.1);
      r.evaluations += population * per;
      cma.tell(costs);
      if (g % 10 == 9) consider(cma.mean());
    }
    return r;
  };

  const auto trials_at = [&](double h, const sim::Ground<float>& ground) {
    return Trials(model_, roles_, gait.simulation, ground, h, gait.tick, gait.steps_per_tick, body.wide);
  };
  // What was learned for other heights is improved for these.
  const bool known = from && from->parameters().axes[0] != to_vector(effort_.heights);
  if (!from || known) {
    const double h = effort_.first_height;
    const sim::Ground<float> ground = step_ground(h);
    Trials trials = trials_at(h, ground);
    ContinuationResult first;
    if (known) {
      first = search(trials, from->model()(Eigen::VectorXd::Constant(1, h)), h, effort_.jump_generations, 0.6, effort_.jump_sigma);
    } else {
      // Running's own numbers take off too weakly by far: the first search takes large steps, others from what it found.
      first = search(trials, n.first(body.wide.shape, run), h, effort_.first_jump_generations / 4, 0.2, 2.5 * effort_.jump_sigma);
      progress_("jump", text("a step of %.2f m, first: cost %.3g", h, first.cost));
    }
    for (int again = 0; again < 3 && !first.works && !interruption_asked(); ++again)
      first = search(trials, Eigen::VectorXd(first.control), h, effort_.first_jump_generations, 0.4, effort_.jump_sigma);
    if (interruption_asked()) throw Interrupted{};
    progress_("jump", text("a step of %.2f m: cost %.3g", h, first.cost));
    if (!first.works) throw Error("jump: the first step cannot be done");
    parameterize::ContinuationParameters grid;
    grid.axes = {to_vector(effort_.heights)};
    grid.max_attempts = effort_.max_attempts + 1;
    from.emplace(grid, Eigen::VectorXd::Constant(1, h), first.control);
  }
  Continuation c = std::move(*from);
  std::vector<ContinuationResult> results;
  while (!c.finished()) {
    const auto& tasks = c.ask();
    results.assign(tasks.size(), {});
    executor_.run(static_cast<int>(tasks.size()), [&](int i, int) {
      const ContinuationTask& t = tasks[static_cast<std::size_t>(i)];
      const sim::Ground<float> ground = step_ground(t.parameter[0]);
      Trials trials = trials_at(t.parameter[0], ground);
      ContinuationResult& r = results[static_cast<std::size_t>(i)];
      if (t.kind == ContinuationTask::Kind::optimize) {
        r = search(trials, t.control, t.parameter[0], effort_.jump_generations, 0.6, effort_.jump_sigma);
      } else {
        const Judged j = judge(trials, t.control, t.parameter[0], effort_.jump_trials, 1);
        r.works = j.good >= effort_.jump_share * effort_.jump_trials;
        r.cost = j.cost;
        r.evaluations = effort_.jump_trials;
      }
    });
    if (interruption_asked()) throw Interrupted{};
    c.tell(results);
    write_stage(folder_, "jump", c);
    progress_("jump", text("%.0f %% of the range, %ld trials", 100 * c.coverage(), static_cast<long>(c.evaluations())));
  }
  return c;
}

std::vector<NodeResult> Trainer::test_running(const control::Controller& gait, const Continuation& c, int count, double most_turn, bool disturbed) {
  const Body body(model_, roles_, gait);
  control::RunningSearch p = for_gait(effort_.running, body);
  if (!disturbed) {
    p.run.push = 0;
    p.run.wander = {};
  }
  auto trials = per_worker<control::RunningTrials<Lane>>(executor_.concurrency(), [&] {
    return std::make_unique<control::RunningTrials<Lane>>(model_, roles_, gait.simulation, flat_, gait, body.wide);
  });
  const RunningModel running(c, body.narrow.shape, body.wide.shape);
  std::vector<NodeResult> out;
  for (int node = 0; node < c.node_count(); ++node) {
    const Eigen::VectorXd theta = c.parameter(node);
    if (theta[0] > most_turn) continue;
    for (const double sign : {1.0, -1.0})
      if (sign > 0 || theta[0] > 0) out.push_back({{sign * theta[0] * degree, theta[1]}, c.status(node), {}});
  }
  executor_.run(static_cast<int>(out.size()), [&](int i, int worker) {
    NodeResult& r = out[static_cast<std::size_t>(i)];
    r.judgement = control::judge_running(trials[worker], r.task, running(r.task), p, count, test_stream);
  });
  return out;
}

std::vector<JumpResult> Trainer::test_jump(const RunningModel& running, const Body& body, const Continuation& c,
                                           const std::vector<double>& heights, int count, const control::Composer::Settings& composition) {
  const double speed = body.leap_speed;
  const auto straight = [&](double v) { return running({0, v}); };
  const std::vector<control::RunningState> starts = states(body, straight(speed), speed, state_stream + 1);
  const parameterize::Rbf rbf = c.model();
  std::vector<JumpResult> out(heights.size());
  executor_.run(static_cast<int>(heights.size()), [&](int i, int) {
    JumpResult& r = out[static_cast<std::size_t>(i)];
    r.height = heights[static_cast<std::size_t>(i)];
    r.trials = count;
    const sim::Ground<float> ground = step_ground(r.height);
    control::ClearingTrials<Lane> trials(model_, roles_, body.gait.simulation, ground, r.height, body.gait.tick, body.gait.steps_per_tick,
                                         body.wide, composition);
    const control::Manoeuvre m =
        body.manoeuvre(rbf(Eigen::VectorXd::Constant(1, r.height)), r.height);
    control::ClearingSettings e = effort_.clearing;
    e.stream = test_stream;
    each_trial(trials, m, e, count, starts, straight, [&](const control::ClearingOutcome& o) {
      r.survived += o.survived;
      r.cleared += o.survived && o.cleared;
      r.exit_speed += o.survived ? o.exit_speed : 0;
    });
    if (r.survived > 0) r.exit_speed /= r.survived;
  });
  return out;
}

plan::StepLength<double> Trainer::step_length(const std::vector<NodeResult>& nodes) const {
  std::vector<double> speeds, lengths;
  for (const NodeResult& n : nodes)
    if (n.judgement.share > 0.5) {
      speeds.push_back(n.judgement.speed);
      lengths.push_back(n.judgement.step_length);
    }
  return plan::StepLength<double>::fit(speeds, lengths);
}

}  // namespace terrain_runner
