// SPDX-License-Identifier: MIT
#include "speed.hpp"

#include <cstdio>

#include "../common/files.hpp"
#include "budget.hpp"
#include "timing.hpp"
#include "traceur/io/adversarial_file.hpp"
#include "traceur/io/policy_file.hpp"
#include "traceur/io/ppo_file.hpp"
#include "traceur/learn/adversarial_imitation.hpp"
#include "traceur/learn/shared_environments.hpp"

namespace track {

using namespace traceur;
using learn::LocomotionStart;
using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

namespace {

using SharedMovers = learn::SharedEnvironments<Movers>;

constexpr int environments = 256, steps = 16, updates_in_block = 100, tests = 48;
constexpr std::uint64_t test_seed = 7;

learn::LocomotionSettings settings_for(LocomotionStart start, const Options& o) {
  learn::LocomotionSettings s;
  s.start = start;
  s.spread_ages = start == LocomotionStart::anywhere;
  s.task.slowest = o.slowest;
  s.task.fastest = o.fastest;
  // Sharper than HIL's heading task, which has one speed and no bound on its error.
  s.task.decay = 1;
  s.task.sideways = 1;
  // Whoever kneels has fallen.
  s.head_height = 0.8;
  return s;
}

learn::Ppo<float> make_ppo(const SharedMovers& e, std::uint64_t seed) {
  learn::PpoParameters p;
  p.seed = seed;
  p.steps = steps;
  p.gamma = 0.97;
  p.reward_scale = 1 - p.gamma;
  p.divergence_target = 0.02;
  return {nn::Mlp<>({e.observations(), 256, 128, e.actions()}), nn::Mlp<>({e.observations(), 256, 128, 1}),
          nn::GaussianHead(e.actions(), 1.0), e.environments(), p};
}

learn::AdversarialImitation<float> make_imitation(const SharedMovers& e, std::uint64_t seed) {
  learn::AdversarialParameters p;
  p.seed = seed;
  p.style.scale = 2;
  learn::DiscriminatorParameters d;
  // Ten steps lie farther apart than the two that AMP's 5 is meant for: by about the root of five, and slopes count squared.
  d.gradient_penalty = 20;
  return {learn::Discriminator<>(nn::Mlp<>({e.style_features(), 256, 128, 1}), d), e.environments() * steps, p};
}

struct Checkpoint {
  learn::PpoState<float> ppo;
  learn::AdversarialState<float> style;
  learn::Policy<float> best;
  SpeedTraining training;
};

constexpr std::size_t numbers = 12;

void save(const Options& o, const Checkpoint& c) {
  const fs::path path = o.out / "checkpoint.safetensors";
  io::Safetensors file(path.string());
  io::add_ppo_state(file, c.ppo);
  io::add_adversarial_state(file, c.style);
  io::add_policy(file, c.best, "best.");
  std::vector<double> milestones{c.training.best_score};
  for (const SpeedMilestone& m : c.training.milestones)
    milestones.insert(milestones.end(), {m.samples, m.score, m.speed_error, m.completed, m.episode_s, m.real_accuracy, m.fake_accuracy,
                                         m.style_reward, m.task_reward, m.divergence, m.explained_variance, m.policy_rate});
  file.add<double>("milestones", {milestones.size()}, milestones);
  file.metadata = {{"arguments", job_arguments(o).dump()}, {"warnings", Json(c.training.warnings).dump()}};
  example::write_tensors(path, file);
  write_policy(o, c.best);
}

Checkpoint load(const Options& o) {
  const io::Safetensors file = example::read_tensors(o.out / "checkpoint.safetensors");
  Checkpoint c{io::get_ppo_state(file), io::get_adversarial_state(file), io::get_policy(file, "best."), {}};
  const std::vector<double> m = file.values<double>("milestones");
  if (m.size() % numbers != 1) throw Error(file.where() + ": tensor 'milestones': expected 1 + 12 n numbers");
  c.training.best_score = m[0];
  for (std::size_t i = 1; i < m.size(); i += numbers)
    c.training.milestones.push_back({m[i], m[i + 1], m[i + 2], m[i + 3], m[i + 4], m[i + 5], m[i + 6], m[i + 7], m[i + 8], m[i + 9],
                                     m[i + 10], m[i + 11]});
  c.training.warnings = saved_warnings(file);
  return c;
}

void look_for_trouble(SpeedTraining& t, double share, double target) {
  const SpeedMilestone& m = t.milestones.back();
  if (m.divergence > 10 * target)
    warn_once(t.warnings, "the policy changes ten times faster than it should (divergence): look for a reward or an observation that explodes");
  if (share > 0.2 && m.real_accuracy > 0.99 && m.fake_accuracy > 0.99)
    warn_once(t.warnings, "the discriminator tells nearly all motion apart (accuracy): the clips may be beyond this body, or its penalty too small");
  if (share > 0.2 && m.real_accuracy + m.fake_accuracy < 1.02)
    warn_once(t.warnings, "the discriminator is blind (accuracy): style means nothing; look at its learning rate and penalty");
  if (share > 0.5 && m.completed < 0.5)
    warn_once(t.warnings, "characters still fall in half of the tests: the range of speeds may be beyond the clips or the body");
}

}  // namespace

SpeedTraining train_speed(const Scene& scene, const Options& options, learn::ProcessGroup& processes) {
  core::ThreadExecutor threads(options.threads);
  Executor executor(processes, threads);
  const sim::Ground<float> ground;
  const sim::Extras extras = extras_of(scene.model);
  learn::LocomotionSettings settings = settings_for(LocomotionStart::anywhere, options);
  const int share = take_share(settings, environments, processes);
  Movers envs(scene.model, scene.roles, scene.motions, share, settings, ground, extras, threads);
  Movers judge(scene.model, scene.roles, scene.motions, tests, settings_for(LocomotionStart::spread, options), ground, extras, threads);
  for (Movers* e : {&envs, &judge}) use_simulator(*e, scene, options);
  SharedMovers shared(envs, processes);
  learn::Ppo<float> ppo = make_ppo(shared, options.seed);
  learn::AdversarialImitation<float> imitation = make_imitation(shared, options.seed);
  Checkpoint c{ppo.state(), imitation.state(), policy_of(ppo), {}};
  if (options.resume) {
    c = load(options);
    imitation.restore(c.style);
    std::printf("goes on after %.2f million samples\n", static_cast<double>(c.ppo.ticks) * environments / 1e6);
  }
  SpeedTraining& t = c.training;
  Timing timing(options.out, options.resume);
  ppo.restore(c.ppo);
  const bool first = processes.rank() == 0;
  if (!options.resume && first) save(options, c);
  Budget budget(options, ppo, timing, processes);
  while (budget.goes_on()) {
    ppo.restore(c.ppo);
    SpeedMilestone m;
    double lived = 0;
    int ended = 0, updates = 0;
    for (int k = 0; k < updates_in_block && budget.samples_left(); ++k, ++updates) {
      const learn::AdversarialReport r = imitation.iterate(ppo, shared, envs.reference(), executor);
      m.divergence = r.ppo.divergence;
      m.explained_variance = r.ppo.explained_variance;
      m.policy_rate = r.ppo.policy_rate;
      m.real_accuracy += r.real_accuracy;
      m.fake_accuracy += r.fake_accuracy;
      m.style_reward += r.style_reward;
      m.task_reward += r.task_reward;
      lived += r.ppo.episode_steps * (r.ppo.terminated + r.ppo.timed_out);
      ended += r.ppo.terminated + r.ppo.timed_out;
      char text[160];
      std::snprintf(text, sizeof text, "task %.3f, style %.3f a step, told apart %.2f of real, %.2f of own, best score %.3f", r.task_reward,
                    r.style_reward, r.real_accuracy, r.fake_accuracy, t.best_score);
      budget.updated(text);
    }
    for (double* x : {&m.real_accuracy, &m.fake_accuracy, &m.style_reward, &m.task_reward}) *x /= std::max(1, updates);
    learn::Policy<float> policy = policy_of(ppo);
    const auto act = [&](learn::ConstColumns<float> x, learn::Columns<float> y) { policy.act(x, y); };
    const learn::LocomotionEvaluation judged = learn::evaluate_locomotion(judge, test_seed, act)[0].result;
    m.samples = budget.samples();
    m.score = judged.normalized_return;
    m.speed_error = judged.speed_error_m_s;
    m.completed = judged.episodes > 0 ? static_cast<double>(judged.completed) / judged.episodes : 0;
    m.episode_s = ended > 0 ? lived / ended / envs.settings().control_hz : 0;
    std::printf("after %.1f million samples: score %.3f, speed off by %.3f m/s, %.0f %% of tests completed, episodes %.1f s, told apart %.2f "
                "and %.2f\n",
                m.samples / 1e6, m.score, m.speed_error, 100 * m.completed, m.episode_s, m.real_accuracy, m.fake_accuracy);
    t.samples = m.samples;
    t.milestones.push_back(m);
    if (m.score >= t.best_score) {
      t.best_score = m.score;
      c.best = policy;
    }
    look_for_trouble(t, budget.share(), ppo.parameters().divergence_target);
    c.ppo = ppo.state();
    c.style = imitation.state();
    if (!first) continue;
    save(options, c);
    timing.note(m.samples);
  }
  t.samples = budget.samples();
  t.wall_s = timing.seconds();
  return t;
}

std::vector<learn::SpeedBand> test_speed(const Scene& scene, const Options& options, learn::Policy<float>& policy, int count) {
  core::ThreadExecutor executor(options.threads);
  constexpr int unit = core::lane_count<Lane>;
  Movers envs(scene.model, scene.roles, scene.motions, (count + unit - 1) / unit * unit, settings_for(LocomotionStart::spread, options),
              sim::Ground<float>(), extras_of(scene.model), executor);
  use_simulator(envs, scene, options);
  return learn::evaluate_locomotion(envs, test_seed + 1, [&](learn::ConstColumns<float> x, learn::Columns<float> y) { policy.act(x, y); });
}

Recording record_speed(const Scene& scene, const Options& options, learn::Policy<float>& policy) {
  constexpr double shown_s = 20;
  constexpr int speeds = 4;
  core::ThreadExecutor executor(1);
  Movers envs(scene.model, scene.roles, scene.motions, core::lane_count<Lane>, settings_for(LocomotionStart::spread, options),
              sim::Ground<float>(), extras_of(scene.model), executor);
  use_simulator(envs, scene, options);
  Recorder recorder(scene, 1 / envs.settings().control_hz);
  Eigen::MatrixXf observation(envs.observations(), envs.environments()), action(envs.actions(), envs.environments());
  learn::StepResult<float> result(envs.environments());
  envs.reset(test_seed);
  recorder.add(envs.lanes(0));
  const int frames = static_cast<int>(shown_s * envs.settings().control_hz);
  for (int k = 0; k < frames; ++k) {
    learn::MovingGoal goal = envs.goal(0);
    goal.speed = static_cast<float>(options.slowest + (options.fastest - options.slowest) * (k * speeds / frames) / (speeds - 1));
    envs.ask(0, goal);
    envs.observe(observation);
    policy.act(observation, action);
    result.clear();
    envs.step(action, result);
    recorder.add(envs.lanes(0));
    if (result.end[0] != learn::End::running) break;
  }
  return recorder.finish();
}

}  // namespace track
