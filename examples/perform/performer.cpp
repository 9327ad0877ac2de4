// SPDX-License-Identifier: MIT
#include "performer.hpp"

#include "../common/progress.hpp"
#include "sole_slide.hpp"
#include "traceur/control/make_controller.hpp"

namespace perform {

using namespace traceur;
using namespace example;
using core::Quaternion;
using core::Vector3;

namespace {

constexpr int ticks_per_second = 60;
constexpr double push_s = 0.1;

// Streams of random starts. Learning uses those from 980 on.
constexpr std::uint64_t trial_stream = 900, push_stream = 901, record_stream = 902, tuning_stream = 903,
                        look_stream = 904;

Runners make_runners(const core::ThreadExecutor& executor, const sim::Model& model, const sim::Parameters& simulation,
                     const sim::Ground<float>& ground, const control::TrackingCost& cost) {
  Runners out;
  out.reserve(static_cast<std::size_t>(executor.concurrency()));
  for (int i = 0; i < executor.concurrency(); ++i) out.emplace_back(model, simulation, ground, cost);
  return out;
}

struct TimeIsUp {};

/// Engines are slow: in the middle of an episode, one minds interruptions and the end of its time.
class WatchedEngine final : public Engine {
public:
  WatchedEngine(std::shared_ptr<Engine> engine, double most_s) : engine_(std::move(engine)), most_s_(most_s) {}
  bool fits(const sim::Model& model) const override { return engine_->fits(model); }
  void begin(const sim::Lanes<Lane>& lanes, int used) override { engine_->begin(lanes, used); }
  void push(int lane, int body, const Vector3<double>& force, const Vector3<double>& point) override {
    engine_->push(lane, body, force, point);
  }
  void step(sim::Lanes<Lane>& lanes, double seconds, std::span<const bool> wanted) override {
    if (interruption_asked()) throw Interrupted{};
    if (clock_.seconds() > most_s_) throw TimeIsUp{};
    engine_->step(lanes, seconds, wanted);
  }

private:
  std::shared_ptr<Engine> engine_;
  double most_s_;
  Clock clock_;
};

Vector3<double> lane_vector(const Vector3<Lane>& v, int lane) {
  return {core::lane_of(v.x, lane), core::lane_of(v.y, lane), core::lane_of(v.z, lane)};
}

/// The bundled dynamics of one lane, with a look at it after every time step.
class WatchedSteps final : public Engine {
public:
  using Look = std::function<void(const sim::Lanes<Lane>&)>;
  WatchedSteps(double dt, Look look) : dt_(dt), look_(std::move(look)) {}
  bool fits(const sim::Model&) const override { return true; }
  void begin(const sim::Lanes<Lane>&, int) override {}
  void push(int, int body, const Vector3<double>& force, const Vector3<double>& point) override {
    push_ = {body, force.cast<float>(), point.cast<float>()};
  }
  void step(sim::Lanes<Lane>& lanes, double seconds, std::span<const bool>) override {
    const int steps = static_cast<int>(std::lround(seconds / dt_));
    std::vector<Vector3<float>> forces(lanes.body_force().size(), Vector3<float>::zero());
    for (int s = 0; s < steps; ++s) {
      if (push_.body >= 0) lanes.push(0, push_.body, push_.force, push_.point);
      lanes.step(1);
      look_(lanes);
      for (std::size_t b = 0; b < forces.size(); ++b)
        forces[b] += (1.0F / static_cast<float>(steps)) * lane_vector(lanes.body_force()[b], 0).cast<float>();
    }
    for (std::size_t b = 0; b < forces.size(); ++b) lanes.set_body_force(0, static_cast<int>(b), forces[b]);
    push_.body = -1;
  }

private:
  struct Force {
    int body = -1;
    Vector3<float> force{0, 0, 0}, point{0, 0, 0};
  };
  double dt_;
  Look look_;
  Force push_;
};

/// A cyclic reference goes on from cycle to cycle; one of a motion done once stays in its last pose.
Eigen::VectorXd reference_pose(const control::Controller& c, int tick) {
  const int n = c.ticks();
  if (!c.cyclic) return c.reference.poses.col(std::min(tick, n));
  const control::CycleCarry carry = control::CycleCarry::after(c.reference, tick / n);
  Eigen::VectorXd q = c.reference.poses.col(tick % n);
  carry.apply(Vector3<double>::from(q.data())).store(q.data());
  (core::about_axis(Vector3<double>{0, 0, 1}, carry.turn) * Quaternion<double>::from(q.data() + 3)).store(q.data() + 3);
  return q;
}

}  // namespace

Performer::Performer(const Scene& scene, const Options& options, const Effort& effort)
    : scene_(scene),
      options_(options),
      effort_(effort),
      folder_(options.out),
      ground_(scene.ground()),
      cost_(scene.model, scene.roles, control::tracked_points(scene.model, scene.roles)),
      executor_(options.threads) {
  simulation_.dt = 1.0 / options.dt_hz;
}

int Performer::windows_of(const Motion& motion) const {
  return (motion.reference.ticks + effort_.sampling.window_ticks - 1) / effort_.sampling.window_ticks;
}

control::SamplingParameters Performer::sampling(const Motion& motion) const {
  control::SamplingParameters p = effort_.search(windows_of(motion), motion.cyclic);
  p.seed = options_.seed;
  p.steps_per_tick = options_.dt_hz / ticks_per_second;
  p.period_starts = motion.window_starts;
  p.period_ticks = motion.period_ticks;
  p.mirrored = motion.mirrored;
  if (motion.flies) p.slide = effort_.run_slide;
  return p;
}

SavedSearch Performer::search(const Motion& motion) {
  if (auto saved = folder_.load_search(motion.name)) {
    if (saved->result.targets.cols() != motion.reference.ticks || saved->result.targets.rows() != scene_.model.nq)
      throw Error((options_.out / "state" / (motion.name + ".json")).string() + ": belongs to another motion");
    std::printf("%s: taken from the job's state\n", motion.name.c_str());
    return *saved;
  }
  const Clock clock;
  const control::SamplingParameters p = sampling(motion);
  ProgressLine line(motion.cyclic ? "search for a cycle's targets, round" : "search for targets, round", 0,
                    p.passes(windows_of(motion)));
  SavedSearch out;
  out.result = control::sample_control<Lane>(scene_.model, simulation_, ground_, cost_, motion.reference, p, executor_,
                                             [&](int round, double cost) {
                                               char text[64];
                                               std::snprintf(text, sizeof text, "cost %.4g", cost);
                                               line.tell(round + 1, text);
                                               return !interruption_asked();
                                             });
  // An interrupted search has no state of its own: it is soon repeated, and its result would differ.
  if (interruption_asked()) throw Interrupted{};
  out.wall_s = clock.seconds();
  folder_.save(motion.name, out);
  return out;
}

OpenLoopResult Performer::judge(const Motion& motion, const SavedSearch& search) const {
  OpenLoopResult out;
  out.wall_s = search.wall_s;
  out.simulated_s = search.result.simulated_seconds;
  control::TrackingReference simulated;
  simulated.poses = search.result.poses;
  simulated.velocities = search.result.velocities;
  control::measure_reference(scene_.model, scene_.roles, cost_.points(), simulated);
  const control::FallLimits limits;
  const Eigen::Index points = simulated.points.rows() / 3;
  for (int t = 1; t <= simulated.ticks; ++t) {
    const auto up = [&](const Eigen::MatrixXd& poses) {
      return Quaternion<double>::from(poses.col(t).data() + 3).rotate(Vector3<double>{0, 0, 1});
    };
    const Eigen::Vector3d shift = simulated.poses.col(t).head(3) - motion.measured.poses.col(t).head(3);
    double here = 0;
    for (Eigen::Index i = 0; i < points; ++i) {
      const Eigen::Vector3d d =
          simulated.points.col(t).segment(3 * i, 3) - motion.measured.points.col(t).segment(3 * i, 3);
      here += d.norm() / static_cast<double>(points);
      out.mean_local_error_m += (d - shift).norm() / static_cast<double>(points * simulated.ticks);
    }
    out.mean_joint_error_m += here / simulated.ticks;
    out.worst_tick_error_m = std::max(out.worst_tick_error_m, here);
    out.fell = out.fell || shift.z() < -limits.drop ||
               dot(up(simulated.poses), up(motion.measured.poses)) < std::cos(limits.tilt);
  }
  return out;
}

control::Perturbation Performer::perturbation(const control::Controller& c) const {
  control::Perturbation p;
  if (c.cyclic) return p;
  // A clip that begins standing has little momentum to make up for a push at its start.
  double root = 0, joints = 0;
  for (int t = 0; t <= std::min(6, c.ticks()); ++t) {
    root = std::max(root, c.reference.velocities.col(t).head(3).norm());
    joints = std::max(
        joints, c.reference.velocities.col(t).tail(scene_.model.nv - 6).norm() / std::sqrt(scene_.model.nv - 6.0));
  }
  if (root < 0.3 && joints < 1.0) p.root_velocity = 0.1;
  return p;
}

control::FeedbackLearning Performer::for_job(control::FeedbackLearning p, const control::Controller& c) const {
  p.seed = options_.seed;
  p.starts_moved = perturbation(c);
  return p;
}

Learned Performer::learn(const Motion& motion, const SavedSearch& search) {
  const Clock clock;
  Learned out;
  const control::SamplingParameters p = sampling(motion);
  control::FeedbackShape shape;
  shape.phases = motion.cyclic ? 1 : 3;
  if (options_.feedback == "large") shape.sets = {true, true, true};
  Runners runners = make_runners(executor_, scene_.model, simulation_, ground_, cost_);
  sim::Lanes<Lane>& lanes = runners[0].lanes();
  control::Controller& c = out.controller;
  c = motion.cyclic ? control::make_cyclic(lanes, scene_.model, simulation_, scene_.roles, motion.reference,
                                           search.result, p, shape)
                    : control::make_one_shot(lanes, scene_.model, simulation_, scene_.roles, motion.reference,
                                             search.result, p, shape);
  c.clip = motion.clip.name;

  control::FeedbackLearning settings = for_job(effort_.learning, c);
  double most_s = std::numeric_limits<double>::infinity();
  if (c.cyclic) {
    settings.generations = effort_.gait_generations;
    if (motion.flies) settings.slide = effort_.run_law_slide;
  } else {
    settings.starts = effort_.one_shot_starts;
    settings.patience = effort_.one_shot_patience;
    most_s = effort_.one_shot_most_s;
  }
  std::optional<SavedLearning> last = folder_.load_learning();
  if (last && (last->progress.best_law.size() != c.shape.size() || last->optimizer.dimension() != c.shape.size()))
    throw Error((options_.out / "state" / "learning.json").string() + ": belongs to another controller");
  const double wall_before = last ? last->wall_s : 0;
  if (last) std::printf("feedback: goes on after generation %d\n", last->progress.generation);
  std::optional<ProgressLine> line;
  line.emplace("feedback, generation", last ? last->progress.generation : 0, settings.generations);
  int look_at = last ? last->look_at : 0;
  const auto persist = [&] {
    Effort::persist(settings);
    settings.generations = look_at;
    const control::FeedbackProgress& s = last->progress;
    const double whole_s = c.ticks() * c.tick + control::EpisodeSettings{}.hold;
    const double affordable = (most_s - s.simulated_seconds) / ((settings.population + 1) * settings.starts * whole_s);
    line.emplace("feedback goes on, generation", s.generation, s.generation + static_cast<int>(affordable));
  };
  double saved_at = 0;
  const auto progress = [&](const control::FeedbackProgress& s, const optimize::CmaEs& optimizer) {
    last = SavedLearning{s, optimizer, wall_before + clock.seconds(), look_at};
    if (clock.seconds() - saved_at > 20) {
      folder_.save(*last);
      saved_at = clock.seconds();
    }
    char text[160];
    std::snprintf(text, sizeof text, "%s%.0f %% of the starts' full perturbation, cost %.3g, %.0f %% succeed",
                  c.cyclic ? (std::to_string(static_cast<int>(s.seconds)) + " s at ").c_str() : "",
                  100 * s.perturbation, s.mean_cost, 100 * s.mean_success);
    line->tell(s.generation, text);
    return !interruption_asked() && s.simulated_seconds < most_s;
  };
  const auto over = [&] {
    return last && (last->optimizer.finished() || last->progress.simulated_seconds >= most_s ||
                    (look_at > 0 && last->progress.since_best >= settings.patience));
  };
  for (;;) {
    if (look_at > 0) persist();
    const std::optional<SavedLearning> before = last;
    if (!over())
      control::learn_feedback(runners, c, settings, executor_, progress, before ? &before->optimizer : nullptr,
                              before ? &before->progress : nullptr);
    if (!last) throw Error("learning feedback ended without a generation");
    folder_.save(*last);
    if (interruption_asked()) throw Interrupted{};
    if (c.cyclic || over() || does_well(runners, c, last->progress.best_law)) break;
    if (look_at == 0) {
      last->progress.perturbation = std::min(last->progress.perturbation, Effort::persisting_from);
      last->progress.since_best = 0;
    }
    look_at = last->progress.generation + effort_.look_every;
  }
  c.law = last->progress.best_law;
  out.generations = last->progress.generation;
  out.persisted = look_at > 0;
  out.wall_s = last->wall_s;
  out.simulated_s = last->progress.simulated_seconds;
  return out;
}

bool Performer::does_well(Runners& runners, control::Controller c, const Eigen::VectorXd& law) {
  c.law = law;
  int reached = 0, held = 0;
  for (const control::EpisodeResult& r :
       control::run_episodes(runners, c, settings(c, look_stream), effort_.looks, executor_)) {
    reached += r.reached_end;
    held += r.held;
  }
  return reached >= effort_.reached_wanted * effort_.looks && held >= effort_.held_wanted * effort_.looks;
}

Runners Performer::chosen_runners(const control::Controller& c, double most_s) {
  const Clock clock;
  Runners out = make_runners(executor_, scene_.model, c.simulation, ground_, cost_);
  if (options_.simulator == "bundled") return out;
  if (engines_.empty()) engines_ = make_engines(options_.simulator, scene_, c.simulation, executor_.concurrency());
  for (std::size_t i = 0; i < out.size(); ++i) out[i].use(std::make_shared<WatchedEngine>(engines_[i], most_s - clock.seconds()));
  return out;
}

Learned Performer::harden(const control::Controller& c) {
  const Clock clock;
  Learned out;
  out.controller = c;
  Runners runners = make_runners(executor_, scene_.model, c.simulation, ground_, cost_);
  control::FeedbackLearning settings = for_job(Effort::hardening(), c);
  settings.generations = effort_.hardening_generations;
  ProgressLine line("hardening, generation", 0, settings.generations);
  const auto progress = [&](const control::FeedbackProgress& s, const optimize::CmaEs&) {
    char text[120];
    std::snprintf(text, sizeof text, "cost %.3g, %.0f %% succeed", s.mean_cost, 100 * s.mean_success);
    line.tell(s.generation, text);
    return !interruption_asked();
  };
  const control::FeedbackProgress last = control::learn_feedback(runners, c, settings, executor_, progress);
  // Like a search, it is repeated when a job goes on.
  if (interruption_asked()) throw Interrupted{};
  out.controller.law = last.best_law;
  out.generations = last.generation;
  out.wall_s = clock.seconds();
  out.simulated_s = last.simulated_seconds;
  return out;
}

Learned Performer::tune_for_engine(const control::Controller& c, double seconds) {
  // Few trials tell little of the share that holds: laws which hold in harder ones have something left over.
  constexpr int trials = 16;
  constexpr double margins[] = {1.0, 1.5};
  const auto moved = [](control::Perturbation p, double margin) {
    p.root_velocity *= margin;
    p.joint_angle *= margin;
    return p;
  };
  const Clock clock;
  Learned out;
  out.controller = c;
  Runners here = make_runners(executor_, scene_.model, c.simulation, ground_, cost_), there = chosen_runners(c, seconds);
  struct Score {
    int survived = -1;
    double seconds = 0;
    bool operator>(const Score& other) const {
      return survived != other.survived ? survived > other.survived : seconds > other.seconds;
    }
  } best;
  double looked_at = 0, look_s = 0;
  ProgressLine line("fine-tuning, second", 0, static_cast<int>(std::ceil(seconds)));
  const auto tell = [&](const char* what, int generation) {
    char text[120];
    std::snprintf(text, sizeof text, "%s, generation %d, %d of %d trials survived", what, generation, std::max(0, best.survived),
                  2 * trials);
    line.tell(std::min(static_cast<int>(clock.seconds()), static_cast<int>(seconds)), text);
    return !interruption_asked();
  };
  /// Takes a law that does better there. Returns whether there is nothing more to learn.
  const auto consider = [&](const Eigen::VectorXd& law) {
    const double begun = clock.seconds();
    control::Controller trial = c;
    trial.law = law;
    Score score{0, 0};
    for (const double margin : margins) {
      control::EpisodeSettings e = settings(c, tuning_stream);
      e.starts = moved(e.starts, margin);
      for (const control::EpisodeResult& r : control::run_episodes(there, trial, e, trials, executor_)) {
        score.survived += c.cyclic ? r.survived : r.reached_end;
        score.seconds += r.seconds;
        out.simulated_s += r.seconds;
      }
    }
    if (score > best) {
      best = score;
      out.controller.law = law;
    }
    looked_at = clock.seconds();
    look_s = looked_at - begun;
    return best.survived == 2 * trials;
  };
  const auto goes_on = [&](double until) { return clock.seconds() < until && !interruption_asked(); };
  try {
    bool holds = consider(c.law);
    if (!holds) {
      // The bundled simulator learns some hundred times as fast.
      control::FeedbackLearning other_worlds = for_job(Effort::hardening(), c);
      other_worlds.starts_moved = moved(other_worlds.starts_moved, margins[1]);
      const double until = clock.seconds() + 0.7 * (seconds - clock.seconds());
      double simulated = 0;
      control::learn_feedback(here, c, other_worlds, executor_, [&](const control::FeedbackProgress& s, const optimize::CmaEs&) {
        ++out.generations;
        out.simulated_s += s.simulated_seconds - simulated;
        simulated = s.simulated_seconds;
        const bool last = !goes_on(until);
        if ((last && !interruption_asked()) || clock.seconds() - looked_at > 2 * look_s) holds = consider(s.best_law);
        return tell("other worlds", s.generation) && !holds && !last;
      });
    }
    if (!holds && !interruption_asked()) {
      const control::FeedbackLearning its_own = for_job(Effort::fine_tuning(), c);
      double simulated = 0;
      const control::FeedbackProgress last =
          control::learn_feedback(there, out.controller, its_own, executor_, [&](const control::FeedbackProgress& s, const optimize::CmaEs&) {
            ++out.generations;
            out.simulated_s += s.simulated_seconds - simulated;
            simulated = s.simulated_seconds;
            return tell("on the engine", s.generation) && goes_on(seconds - 1.5 * look_s);
          });
      if (!interruption_asked()) consider(last.best_law);
    }
  } catch (const TimeIsUp&) {
    // What is left of an unfinished generation or trial is of no use.
  }
  if (interruption_asked()) throw Interrupted{};
  out.wall_s = clock.seconds();
  return out;
}

Learned Performer::fine_tune(const control::Controller& c, double seconds) {
  if (options_.simulator != "bundled") return tune_for_engine(c, seconds);
  const Clock clock;
  Learned out;
  out.controller = c;
  Runners runners = make_runners(executor_, scene_.model, c.simulation, ground_, cost_);
  const control::FeedbackLearning settings = for_job(Effort::fine_tuning(), c);
  ProgressLine line("fine-tuning, second", 0, static_cast<int>(std::ceil(seconds)));
  const auto progress = [&](const control::FeedbackProgress& s, const optimize::CmaEs&) {
    out.controller.law = s.best_law;
    out.generations = s.generation;
    out.simulated_s = s.simulated_seconds;
    char text[120];
    std::snprintf(text, sizeof text, "generation %d, cost %.3g, best %.3g", s.generation, s.mean_cost,
                  s.best_validation);
    line.tell(std::min(static_cast<int>(clock.seconds()), static_cast<int>(seconds)), text);
    return clock.seconds() < seconds && !interruption_asked();
  };
  control::learn_feedback(runners, c, settings, executor_, progress);
  if (interruption_asked()) throw Interrupted{};
  out.wall_s = clock.seconds();
  return out;
}

control::EpisodeSettings Performer::settings(const control::Controller& c, std::uint64_t stream) const {
  control::EpisodeSettings e;
  e.seconds = effort_.trial_s;
  e.starts = perturbation(c);
  e.seed = options_.seed;
  e.stream = stream;
  return e;
}

TrialResult Performer::test(const control::Controller& c, const control::TrackingReference& measured) {
  constexpr int width = core::lane_count<Lane>;
  Runners runners = chosen_runners(c);
  const control::EpisodeSettings e = settings(c, trial_stream);
  const int n = effort_.trials, groups = (n + width - 1) / width;
  std::vector<control::EpisodeResult> results(static_cast<std::size_t>(n));
  std::vector<double> error(static_cast<std::size_t>(n));
  const auto points = cost_.points().size();
  executor_.run(groups, [&](int g, int worker) {
    if (interruption_asked()) return;
    const int used = std::min(width, n - g * width);
    Lane sum(0.0f);
    int ticks = 0;
    control::CycleCarry carry;
    const auto observe = [&](int tick, const sim::Lanes<Lane>& lanes) {
      const int period = c.ticks();
      if (c.cyclic && tick % period == 0) carry = control::CycleCarry::after(c.reference, tick / period);
      const int t = c.cyclic ? tick % period + 1 : std::min(tick + 1, period);
      const Vector3<Lane> root = Vector3<Lane>::from(lanes.q());
      const Vector3<double> root_reference = Vector3<double>::from(measured.poses.col(t).data());
      for (std::size_t i = 0; i < points; ++i) {
        const Vector3<double> reference =
            carry.rotate(Vector3<double>::from(measured.points.col(t).data() + 3 * i) - root_reference);
        sum += norm(cost_.place(lanes, i) - root - reference.cast<float>().cast<Lane>());
      }
      ++ticks;
    };
    const auto r = runners[static_cast<std::size_t>(worker)].run(
        c, e, used, [&](int) { return c.law.data(); }, [&](int lane) { return g * width + lane; },
        [](int) { return control::Push{}; }, observe);
    for (int l = 0; l < used; ++l) {
      const auto k = static_cast<std::size_t>(g * width + l);
      results[k] = r[static_cast<std::size_t>(l)];
      error[k] = core::lane_of(sum, l) / (static_cast<double>(ticks) * static_cast<double>(points));
    }
  });
  if (interruption_asked()) throw Interrupted{};
  TrialResult out;
  out.trials = n;
  out.root_velocity_m_s = e.starts.root_velocity;
  out.joint_angle_rad = e.starts.joint_angle;
  for (std::size_t k = 0; k < results.size(); ++k) {
    const control::EpisodeResult& r = results[k];
    out.survived += r.survived;
    out.reached_end += r.reached_end;
    out.held += r.held;
    out.simulated_s += r.seconds;
    if (!r.survived) continue;
    out.mean_joint_error_m += error[k];
    out.mean_speed_m_s += r.mean_speed;
  }
  if (out.survived > 0) {
    out.mean_joint_error_m /= out.survived;
    out.mean_speed_m_s /= out.survived;
  }
  const control::TrackingReference& r = c.reference;
  out.clip_speed_m_s = (r.poses.col(c.ticks()).head(2) - r.poses.col(0).head(2)).norm() / (c.ticks() * c.tick);
  return out;
}

Vector3<double> Performer::push_force(const control::Controller& c, int tick, double angle, double impulse) const {
  const int n = c.ticks();
  // In a flip the heading means little: motions done once are pushed relative to where they began.
  const double heading = c.cyclic
                             ? c.reference.heading[tick % n] + control::CycleCarry::after(c.reference, tick / n).turn
                             : c.reference.heading[0];
  return impulse / push_s * Vector3<double>{std::cos(heading + angle), std::sin(heading + angle), 0};
}

PushResult Performer::push(const control::Controller& c) {
  constexpr double settle_s = 2, after_s = 5;
  Runners runners = chosen_runners(c);
  control::EpisodeSettings e = settings(c, push_stream);
  e.perturbation = 0;
  const int n = effort_.push_trials, directions = static_cast<int>(push_directions.size());
  const int ticks = std::max(1, static_cast<int>(std::lround(push_s / c.tick)));
  const double period_s = c.ticks() * c.tick;
  e.seconds = settle_s + period_s + push_s + after_s;
  // Gaits are pushed at moments spread over a cycle, others over the first half of the motion.
  const auto moment = [&](int i) {
    const double share = static_cast<double>(i) / n;
    return static_cast<int>(std::lround((c.cyclic ? settle_s + share * period_s : 0.5 * share * period_s) / c.tick));
  };
  PushResult out;
  std::array<double, push_directions.size()> low{}, high{};
  high.fill(effort_.push_most_Ns);
  ProgressLine line("pushes, halving", 0, effort_.push_halvings);
  for (int halving = 0; halving < effort_.push_halvings; ++halving) {
    const auto results = control::run_episodes(runners, c, e, directions * n, executor_, [&](int episode) {
      const auto d = static_cast<std::size_t>(episode / n);
      const int at = moment(episode % n);
      const double angle = 2 * std::numbers::pi * static_cast<double>(d) / directions;
      return control::Push{push_force(c, at, angle, 0.5 * (low[d] + high[d])), at, ticks};
    });
    if (interruption_asked()) throw Interrupted{};
    for (std::size_t d = 0; d < push_directions.size(); ++d) {
      int survived = 0;
      for (int i = 0; i < n; ++i) {
        const control::EpisodeResult& r = results[d * static_cast<std::size_t>(n) + static_cast<std::size_t>(i)];
        survived += r.survived;
        out.simulated_s += r.seconds;
      }
      (2 * survived >= n ? low : high)[d] = 0.5 * (low[d] + high[d]);
    }
    line.tell(halving + 1, "eight directions");
  }
  out.tolerance_Ns = low;
  return out;
}

Recording Performer::record(const control::Controller& c, double push_Ns) {
  constexpr double shown_s = 12;
  Runners runners = chosen_runners(c);
  control::EpisodeSettings e = settings(c, record_stream);
  e.seconds = shown_s;
  e.hold = 1;
  e.perturbation = options_.perturb ? 1 : 0;
  control::Push push;
  if (options_.perturb) {
    push.first_tick = c.cyclic ? static_cast<int>(std::lround(shown_s / 3 / c.tick)) : c.ticks() / 4;
    push.ticks = std::max(1, static_cast<int>(std::lround(push_s / c.tick)));
    push.force = push_force(c, push.first_tick, 0.5 * std::numbers::pi, push_Ns);
  }
  Recording out;
  const sim::Model& model = scene_.model;
  std::vector<Eigen::VectorXd> poses, references;
  SoleSlide slide(model, scene_.roles, ground_, c.simulation);
  const bool bundled = options_.simulator == "bundled";
  const auto pose_of = [&](const sim::Lanes<Lane>& lanes, Eigen::VectorXd& q, body::Frames<double>& frames) {
    for (int i = 0; i < model.nq; ++i) q[i] = core::lane_of(lanes.q()[i], 0);
    body::normalize(model.character.skeleton, q.data());
    body::forward_kinematics(model.character.skeleton, q.data(), frames);
  };
  Eigen::VectorXd q(model.nq);
  body::Frames<double> frames(model.character.skeleton);
  if (bundled)
    runners[0].use(std::make_shared<WatchedSteps>(c.simulation.dt, [&](const sim::Lanes<Lane>& lanes) {
      pose_of(lanes, q, frames);
      slide.add_step(frames, [&](std::size_t contact) {
        const sim::ContactMemory<Lane> m = lanes.contact_memory(contact);
        return sim::ContactMemory<double>{lane_vector(m.bristle, 0), core::lane_of(m.normal_force, 0), core::lane_of(m.sliding_speed, 0)};
      });
    }));
  const auto observe = [&](int tick, const sim::Lanes<Lane>& lanes) {
    pose_of(lanes, q, frames);
    poses.push_back(q);
    references.push_back(reference_pose(c, tick + 1));
    if (!bundled)
      slide.add(frames, c.tick, [&](int b) { return norm(lane_vector(lanes.body_force()[static_cast<std::size_t>(b)], 0)); });
    std::vector<Recording::Contact> contacts;
    for (std::size_t b = 0; b < model.bodies.size(); ++b) {
      const sim::MovingBody& m = model.bodies[b];
      const Vector3<double> force = lane_vector(lanes.body_force()[b], 0);
      if (m.contacts == 0 || norm(force) < 1) continue;
      // The force acts on the body as a whole; it is shown at the middle of its lowest points.
      std::vector<Vector3<double>> touching;
      double lowest = std::numeric_limits<double>::infinity();
      for (int i = 0; i < m.contacts; ++i) {
        const sim::ContactSphere& s = model.contacts[static_cast<std::size_t>(m.first_contact + i)];
        const Vector3<double> at = frames.point(m.joint, s.center);
        const Vector3<float> center = at.cast<float>();
        const sim::GroundSample<float> ground = ground_.sample(center);
        touching.push_back(at - s.radius * ground.normal.cast<double>());
        lowest = std::min(lowest, ground.distance - s.radius);
      }
      Vector3<double> sum{0, 0, 0};
      int count = 0;
      for (int i = 0; i < m.contacts; ++i) {
        const sim::ContactSphere& s = model.contacts[static_cast<std::size_t>(m.first_contact + i)];
        const Vector3<float> center = frames.point(m.joint, s.center).cast<float>();
        if (ground_.sample(center).distance - s.radius > lowest + 0.004) continue;
        sum += touching[static_cast<std::size_t>(i)];
        ++count;
      }
      contacts.push_back({(1.0 / count) * sum, force});
    }
    out.contacts.push_back(std::move(contacts));
    const bool pushed = push.ticks > 0 && tick >= push.first_tick && tick < push.first_tick + push.ticks;
    const int waist = model.bodies[static_cast<std::size_t>(scene_.roles.waist)].joint;
    out.push_points.push_back(frames.point(waist, {0, 0, 0.15}));
    out.push_impulses.push_back(pushed ? c.tick * push.force : Vector3<double>{0, 0, 0});
  };
  runners[0].run(
      c, e, 1, [&](int) { return c.law.data(); }, [](int) { return 0; }, [&](int) { return push; }, observe);
  out.sole_slide = slide.mean();
  const auto keys = static_cast<Eigen::Index>(poses.size());
  out.clip.name = c.clip + ", simulated";
  out.clip.skeleton = model.character.skeleton;
  out.clip.times = Eigen::VectorXd::LinSpaced(keys, 0, static_cast<double>(keys - 1) * c.tick);
  out.clip.poses.resize(model.nq, keys);
  out.reference.resize(model.nq, keys);
  for (Eigen::Index k = 0; k < keys; ++k) {
    out.clip.poses.col(k) = poses[static_cast<std::size_t>(k)];
    out.reference.col(k) = references[static_cast<std::size_t>(k)];
  }
  return out;
}

}  // namespace perform
