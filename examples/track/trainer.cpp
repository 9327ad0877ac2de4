// SPDX-License-Identifier: MIT
#include "trainer.hpp"

#include <cstdio>
#include <fstream>
#include <sstream>

#include "../common/files.hpp"
#include "../common/retargeting.hpp"
#include "budget.hpp"
#include "timing.hpp"
#include "traceur/io/policy_file.hpp"
#include "traceur/io/ppo_file.hpp"
#include "traceur/learn/shared_environments.hpp"

namespace track {

using namespace traceur;
using learn::TrackingStart;
using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

namespace {

constexpr int environments = 256, updates_in_block = 50, tests = 48;
constexpr std::uint64_t test_seed = 7;

learn::TrackingRewardParameters reward_for(const std::string& name) {
  if (name == "parc") return learn::ParcRewardParameters{};
  if (name == "hil") return learn::HilReward{};
  return learn::DeepMimicRewardParameters{};
}

learn::TrackingSettings settings_for(TrackingStart start, const Options& options) {
  learn::TrackingSettings s;
  s.start = start;
  s.reward = reward_for(options.reward);
  s.priority_floor = options.priority_floor;
  s.spread_ages = start == TrackingStart::anywhere;
  return s;
}

learn::Ppo<float> make_ppo(const learn::SharedEnvironments<Environments>& e, std::uint64_t seed) {
  learn::PpoParameters p;
  p.seed = seed;
  p.reward_scale = 1 - p.gamma;
  p.divergence_target = 0.03;
  return {nn::Mlp<>({e.observations(), 256, 128, e.actions()}), nn::Mlp<>({e.observations(), 256, 128, 1}),
          nn::GaussianHead(e.actions(), 1.0), e.environments(), p};
}

double mean_return(const std::vector<Evaluation>& by_motion) {
  double sum = 0;
  for (const Evaluation& e : by_motion) sum += e.normalized_return;
  return sum / static_cast<double>(by_motion.size());
}

/// The run between two blocks, as a file.
struct Checkpoint {
  learn::PpoState<float> ppo;
  learn::Policy<float> best;
  Training training;
  std::vector<double> priorities;
};

constexpr std::size_t numbers = 7;  // of a milestone

void save(const Options& o, const Checkpoint& c) {
  const fs::path path = o.out / "checkpoint.safetensors";
  io::Safetensors file(path.string());
  io::add_ppo_state(file, c.ppo);
  io::add_policy(file, c.best, "best.");
  file.add<double>("priorities", {c.priorities.size()}, c.priorities);
  std::vector<double> milestones{c.training.best_score};
  for (const Milestone& m : c.training.milestones)
    milestones.insert(milestones.end(),
                      {m.samples, m.normalized_return, m.from_begin, m.episode_s, m.divergence, m.explained_variance, m.policy_rate});
  file.add<double>("milestones", {milestones.size()}, milestones);
  Json warnings = c.training.warnings;
  file.metadata = {{"arguments", job_arguments(o).dump()}, {"warnings", warnings.dump()}};
  example::write_tensors(path, file);
  write_policy(o, c.best);
}

Checkpoint load(const Options& o) {
  const io::Safetensors file = example::read_tensors(o.out / "checkpoint.safetensors");
  Checkpoint c{io::get_ppo_state(file), io::get_policy(file, "best."), {}, file.values<double>("priorities")};
  const std::vector<double> m = file.values<double>("milestones");
  if (m.size() % numbers != 1)
    throw Error(file.where() + ": tensor 'milestones': expected 1 + " + std::to_string(numbers) + " n numbers");
  c.training.best_score = m[0];
  for (std::size_t i = 1; i < m.size(); i += numbers)
    c.training.milestones.push_back({m[i], m[i + 1], m[i + 2], m[i + 3], m[i + 4], m[i + 5], m[i + 6]});
  c.training.warnings = saved_warnings(file);
  return c;
}

/// Lanes for so many episodes of each motion, or a few more: a whole number of packs and of motions.
int lanes_for(const Scene& scene, int count) {
  const int motions = static_cast<int>(scene.motions.size()), unit = core::lane_count<Lane> * motions;
  return (count * motions + unit - 1) / unit * unit;
}

/// Says what looks wrong, once each.
void look_for_trouble(Training& t, double share, double target) {
  const auto warn = [&](const char* text) { warn_once(t.warnings, text); };
  const Milestone& m = t.milestones.back();
  if (m.divergence > 10 * target)
    warn("the policy changes ten times faster than it should (divergence): look for a reward or an observation that explodes");
  if (share > 0.1 && share < 0.7 && m.divergence < 0.1 * target)
    warn("the policy hardly changes (divergence): the gradient is empty, or the learning rate at its bound");
  // Of returns that are all alike there is nothing to foresee.
  if (share > 0.3 && m.explained_variance < 0.1 && m.normalized_return < 0.5)
    warn("the value function does not foresee returns (explained variance): look at the normaliser and the reward's scale");
  if (share > 0.5 && m.normalized_return < 0.2)
    warn("episodes still end early: the clip may be beyond this body, or begin in the ground");
}

}  // namespace

sim::Extras extras_of(const sim::Model& model) {
  sim::Extras out;
  out.self_collisions = sim::self_collision_pairs(model);
  return out;
}

learn::Policy<float> policy_of(const learn::Ppo<float>& ppo) {
  return {ppo.policy(), ppo.policy_parameters().head(ppo.policy().parameters()), ppo.normalizer()};
}

void write_policy(const Options& o, const learn::Policy<float>& policy) {
  const fs::path path = o.out / "policy.safetensors";
  io::Safetensors file(path.string());
  io::add_policy(file, policy);
  file.metadata = {{"arguments", job_arguments(o).dump()}};
  example::write_tensors(path, file);
}

void warn_once(std::vector<std::string>& warnings, const char* text) {
  for (const std::string& w : warnings)
    if (w == text) return;
  warnings.emplace_back(text);
  std::printf("warning: %s\n", text);
}

std::vector<std::string> saved_warnings(const io::Safetensors& file) {
  std::vector<std::string> out;
  const auto found = file.metadata.find("warnings");
  const Json json = found == file.metadata.end() ? Json() : Json::parse(found->second, nullptr, false);
  if (json.is_array())
    for (const Json& w : json)
      if (w.is_string()) out.push_back(w.get<std::string>());
  return out;
}

Scene load_scene(const Options& options) {
  Scene s;
  s.model = example::read_model(options.character);
  std::ostringstream text;
  text << std::ifstream(options.character, std::ios::binary).rdbuf();
  s.character_text = text.str();
  s.roles = control::find_roles(s.model);
  for (const fs::path& path : options.clips) {
    const io::LoadedClip loaded = example::load_clip(path);
    std::printf("%s", loaded.report.text().c_str());
    const motion::Retargeted on_character = example::retarget(loaded.clip, s.model.character);
    std::printf("on '%s': %s", s.model.character.name.c_str(), on_character.report.text().c_str());
    s.motions.push_back(learn::make_reference_motion(s.model, s.roles, on_character.clip, learn::TrackingSettings{}.control_hz));
    const learn::ReferenceMotion& m = s.motions.back();
    std::printf("motion '%s': %.2f s, %s\n", m.name.c_str(), m.ticks * m.tick, m.cyclic ? "repeated" : "done once");
  }
  return s;
}

int share_of(int all, const learn::ProcessGroup& processes) {
  const int unit = core::lane_count<Lane>;
  if (all % (processes.size() * unit) != 0)
    throw Error(std::to_string(all) + " environments in packs of " + std::to_string(unit) + " cannot be shared out evenly over " +
                std::to_string(processes.size()) + " processes");
  return all / processes.size();
}

Training train(const Scene& scene, const Options& options, learn::ProcessGroup& processes) {
  core::ThreadExecutor threads(options.threads);
  Executor executor(processes, threads);
  const sim::Ground<float> ground;
  const sim::Extras extras = extras_of(scene.model);
  learn::TrackingSettings settings = settings_for(TrackingStart::anywhere, options);
  const int share = take_share(settings, environments, processes);
  Environments envs(scene.model, scene.roles, scene.motions, share, settings, ground, extras, threads);
  Environments judge(scene.model, scene.roles, scene.motions, tests, settings_for(TrackingStart::spread, options), ground, extras, threads);
  Environments begin_judge(scene.model, scene.roles, scene.motions, lanes_for(scene, 1), settings_for(TrackingStart::begin, options), ground, extras, threads);
  for (Environments* e : {&envs, &judge, &begin_judge}) use_simulator(*e, scene, options);
  learn::SharedEnvironments<Environments> shared(envs, processes);
  learn::Ppo<float> ppo = make_ppo(shared, options.seed);
  const auto failure_rates = envs.priorities().state();
  Checkpoint c{ppo.state(), policy_of(ppo), {}, {failure_rates.begin(), failure_rates.end()}};
  if (options.resume) {
    c = load(options);
    if (c.priorities.size() != failure_rates.size()) throw Error((options.out / "checkpoint.safetensors").string() + ": is of other clips");
    std::copy(c.priorities.begin(), c.priorities.end(), failure_rates.begin());
    std::printf("goes on after %.2f million samples\n", static_cast<double>(c.ppo.ticks) * environments / 1e6);
  }
  Training& t = c.training;
  Timing timing(options.out, options.resume);
  ppo.restore(c.ppo);
  const bool first = processes.rank() == 0;
  if (!options.resume && first) save(options, c);
  Budget budget(options, ppo, timing, processes);
  while (budget.goes_on()) {
    ppo.restore(c.ppo);
    Milestone m;
    double steps = 0;
    int ended = 0;
    for (int k = 0; k < updates_in_block && budget.samples_left(); ++k) {
      const learn::PpoReport r = ppo.iterate(shared, executor);
      m.divergence = r.divergence;
      m.explained_variance = r.explained_variance;
      m.policy_rate = r.policy_rate;
      steps += r.episode_steps * (r.terminated + r.timed_out);
      ended += r.terminated + r.timed_out;
      char text[96];
      std::snprintf(text, sizeof text, "reward %.3f a step, best score %.3f", r.reward, t.best_score);
      budget.updated(text);
    }
    learn::Policy<float> policy = policy_of(ppo);
    const auto act = [&](learn::ConstColumns<float> x, learn::Columns<float> y) { policy.act(x, y); };
    m.normalized_return = mean_return(learn::evaluate_tracking(judge, test_seed, act));
    m.from_begin = mean_return(learn::evaluate_tracking(begin_judge, test_seed, act));
    m.samples = budget.samples();
    m.episode_s = ended > 0 ? steps / ended / envs.settings().control_hz : 0;
    t.samples = m.samples;
    t.milestones.push_back(m);
    if (m.score() >= t.best_score || t.milestones.size() == 1) {
      t.best_score = m.score();
      c.best = policy;
    }
    look_for_trouble(t, budget.share(), ppo.parameters().divergence_target);
    c.ppo = ppo.state();
    c.priorities.assign(failure_rates.begin(), failure_rates.end());
    if (!first) continue;
    save(options, c);
    timing.note(m.samples);
  }
  t.samples = budget.samples();
  t.wall_s = timing.seconds();
  return t;
}

std::vector<Evaluation> test(const Scene& scene, const Options& options, learn::Policy<float>& policy, TrackingStart start, int count,
                             double cyclic_s) {
  core::ThreadExecutor executor(options.threads);
  const int lanes = lanes_for(scene, count);
  learn::TrackingSettings settings = settings_for(start, options);
  settings.episode_s = cyclic_s;
  Environments envs(scene.model, scene.roles, scene.motions, lanes, settings, sim::Ground<float>(), extras_of(scene.model), executor);
  use_simulator(envs, scene, options);
  return learn::evaluate_tracking(envs, test_seed + 1, [&](learn::ConstColumns<float> x, learn::Columns<float> y) { policy.act(x, y); });
}

Recorder::Recorder(const Scene& scene, double tick) : scene_(&scene) { out_.tick = tick; }

void Recorder::add(const sim::Lanes<Lane>& lanes) {
  const sim::Model& model = scene_->model;
  Eigen::VectorXd q(model.nq);
  for (int i = 0; i < model.nq; ++i) q[i] = core::lane_of(lanes.q()[i], 0);
  body::normalize(model.character.skeleton, q.data());
  poses_.push_back(q);
  body::Frames<double> frames(model.character.skeleton);
  body::forward_kinematics(model.character.skeleton, q.data(), frames);
  std::vector<Recording::Contact> contacts;
  for (std::size_t b = 0; b < model.bodies.size(); ++b) {
    const auto& f = lanes.body_force()[b];
    const core::Vector3<double> force{core::lane_of(f.x, 0), core::lane_of(f.y, 0), core::lane_of(f.z, 0)};
    if (norm(force) < 1 || model.bodies[b].contacts == 0) continue;
    // The force acts on the body as a whole; it is shown at its lowest point.
    core::Vector3<double> lowest{0, 0, 1e9};
    for (int i = 0; i < model.bodies[b].contacts; ++i) {
      const sim::ContactSphere& s = model.contacts[static_cast<std::size_t>(model.bodies[b].first_contact + i)];
      const core::Vector3<double> at = frames.point(model.bodies[b].joint, s.center) - core::Vector3<double>{0, 0, s.radius};
      if (at.z < lowest.z) lowest = at;
    }
    contacts.push_back({lowest, force});
  }
  out_.contacts.push_back(contacts);
}

void Recorder::add_reference(const learn::ReferenceMotion& motion, int tick, std::array<float, 2> shift) {
  Eigen::VectorXd r = motion.poses.col(tick).cast<double>();
  r[0] += shift[0];
  r[1] += shift[1];
  body::normalize(scene_->model.character.skeleton, r.data());
  references_.push_back(r);
}

Recording Recorder::finish() {
  const auto columns = [&](const std::vector<Eigen::VectorXd>& from) {
    Eigen::MatrixXd out(scene_->model.nq, static_cast<Eigen::Index>(from.size()));
    for (std::size_t k = 0; k < from.size(); ++k) out.col(static_cast<Eigen::Index>(k)) = from[k];
    return out;
  };
  out_.poses = columns(poses_);
  out_.references = columns(references_);
  return out_;
}

Recording record(const Scene& scene, const Options& options, learn::Policy<float>& policy, int motion) {
  constexpr double shown_s = 12;
  core::ThreadExecutor executor(1);
  Environments envs(scene.model, scene.roles, {scene.motions[static_cast<std::size_t>(motion)]}, core::lane_count<Lane>,
                    settings_for(TrackingStart::begin, options), sim::Ground<float>(), extras_of(scene.model), executor);
  use_simulator(envs, scene, options);
  const learn::ReferenceMotion& m = envs.motions()[0];
  Recorder recorder(scene, m.tick);
  Eigen::MatrixXf observation(envs.observations(), envs.environments()), action(envs.actions(), envs.environments());
  learn::StepResult<float> result(envs.environments());
  envs.reset(test_seed);
  const auto look = [&] {
    recorder.add(envs.lanes(0));
    recorder.add_reference(m, envs.tick(0), envs.shift(0));
  };
  look();
  for (int k = 0; k * m.tick < shown_s; ++k) {
    envs.observe(observation);
    policy.act(observation, action);
    result.clear();
    envs.step(action, result);
    look();
    if (envs.ending(0) != learn::TrackingEnd::running) break;
  }
  return recorder.finish();
}

}  // namespace track
