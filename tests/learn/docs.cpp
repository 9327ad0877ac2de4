// SPDX-License-Identifier: MIT
// The code of docs/learn.md.
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/learn/adversarial_imitation.hpp>
#include <traceur/learn/episodes.hpp>
#include <traceur/learn/initial_state.hpp>
#include <traceur/learn/parc_reward.hpp>
#include <traceur/learn/ppo.hpp>
#include <traceur/learn/prioritized_clips.hpp>
#include <traceur/learn/termination.hpp>

using namespace traceur;

namespace {

struct Thermostat {  // keeps 20 degrees in rooms that leak heat
  Eigen::VectorXf temperature;
  std::uint64_t seed = 0;

  explicit Thermostat(Eigen::Index rooms) : temperature(rooms) { reset(0); }
  Eigen::Index environments() const { return temperature.size(); }
  Eigen::Index observations() const { return 1; }
  Eigen::Index actions() const { return 1; }
  void reset(std::uint64_t s) {
    seed = s;
    for (Eigen::Index e = 0; e < environments(); ++e) restart(e);
  }
  void restart(Eigen::Index e) noexcept {
    core::RandomStream random(seed, static_cast<std::uint64_t>(e));
    temperature[e] = random.uniform<float>(10, 30);
  }
  void observe(learn::Columns<float> out) const noexcept { out = temperature.transpose(); }
  void step(learn::ConstColumns<float> actions, learn::StepResult<float>& result) noexcept {
    for (Eigen::Index e = 0; e < environments(); ++e) {
      const float heating = std::clamp(actions(0, e), -1.0f, 1.0f);
      temperature[e] += heating - 0.05f * (temperature[e] - 15);
      result.reward[e] = -std::abs(temperature[e] - 20);
    }
  }
};
static_assert(learn::Environments<Thermostat, float>);

struct Pacer {  // moves along a line; its style is its last two speeds
  Eigen::VectorXf place;
  Eigen::MatrixXf speeds;

  explicit Pacer(Eigen::Index n) : place(n), speeds(2, n) { reset(0); }
  Eigen::Index environments() const { return place.size(); }
  Eigen::Index observations() const { return 1; }
  Eigen::Index actions() const { return 1; }
  Eigen::Index style_features() const { return 2; }
  void reset(std::uint64_t) {
    place.setZero();
    speeds.setZero();
  }
  void restart(Eigen::Index e) noexcept { place[e] = 0; }
  void observe(learn::Columns<float> out) const { out = 0.01f * place.transpose(); }
  void observe_style(learn::Columns<float> out) const { out = speeds; }
  void step(learn::ConstColumns<float> actions, learn::StepResult<float>&) {
    speeds.row(0) = speeds.row(1);
    speeds.row(1) = actions;
    place += 0.1f * actions.row(0).transpose();
  }
};
struct Strollers {  // the data: people at about half a metre a second
  std::array<float, 2> sample(core::RandomStream& random) const {
    return {random.normal<float>(0.5f, 0.2f), random.normal<float>(0.5f, 0.2f)};
  }
};

}  // namespace

TEST_CASE("docs/learn.md: advantages") {
  const Eigen::MatrixXd value = Eigen::MatrixXd::Zero(3, 1), nothing = value;
  Eigen::MatrixXd rate = Eigen::MatrixXd::Ones(3, 1), duration(3, 1), advantage(3, 1);
  duration << 1, 2, 3;  // 6 in all, however it is cut
  Eigen::Matrix<learn::End, Eigen::Dynamic, Eigen::Dynamic> end(3, 1);
  end << learn::End::running, learn::End::running, learn::End::terminated;
  learn::generalized_advantage<double>({0.8, 1.0}, {nothing, rate, duration, value, nothing, nothing.topRows(1), end},
                                       advantage);
  // advantage(0) is (1 - 0.8^6) / -ln 0.8
  CHECK(advantage(0) == doctest::Approx((1 - std::pow(0.8, 6)) / -std::log(0.8)).epsilon(1e-12));
}

TEST_CASE("docs/learn.md: proximal policy optimisation") {
  learn::PpoParameters p;
  p.seed = 1;
  p.steps = 32;       // of every environment between updates
  p.minibatch = 256;
  p.gamma = 0.9;
  p.policy_rate = p.value_rate = 2e-3;
  const Eigen::Index rooms = 32;
  learn::Ppo<> ppo(nn::Mlp<>({1, 32, 1}), nn::Mlp<>({1, 32, 1}),
                   nn::GaussianHead(1, 0.5, nn::GaussianHead::Deviation::learned), rooms, p);
  Thermostat training(rooms);
  core::ThreadExecutor threads(2);
  for (int i = 0; i < 60; ++i) {
    const learn::PpoReport report = ppo.iterate(training, threads);
    if (report.failed > 0) throw Error("a temperature is not finite");
  }

  Thermostat fresh(100);
  fresh.reset(7);
  const learn::EpisodeReport judged = learn::play_episodes<float>(
      fresh, [&](learn::ConstColumns<float> seen, learn::Columns<float> action) { ppo.mean_action(seen, action); }, 100);
  const learn::PpoState<float> saved = ppo.state();  // flat arrays, to be written as safetensors
  CHECK(judged.mean() > -100);
  CHECK(saved.updates == 60);
}

TEST_CASE("docs/learn.md: starts, endings, rewards") {
  body::Character character;
  for (const char* name : {"root", "left", "right"}) {
    body::Joint j;
    j.name = j.body = name;
    j.parent = character.skeleton.size() == 0 ? -1 : 0;
    j.type = j.parent < 0 ? body::JointType::free : body::JointType::ball;
    character.skeleton.add(j);
    character.inertias.push_back({1.0, {0, 0, 0}, core::Symmetric3<double>::scalar(0.1)});
    character.actuators.emplace_back();
  }
  motion::Clip clip;
  clip.skeleton = character.skeleton;
  clip.times = Eigen::Vector2d(0, 1);
  clip.poses = character.skeleton.neutral_pose().replicate(1, 2);

  learn::TrackingState<double> state(character), reference(character);
  reference.q[0] = 0.1;  // the reference is 10 cm ahead
  reference.measure(character);
  const std::vector<double> weights(3, 1.0);
  const learn::ParcReward reward(character.skeleton, weights, {1, 2});
  const double earned = reward(state, reference);
  const bool over = learn::strayed<double>(state, reference, learn::hil_limits(character.skeleton));  // not yet

  learn::PrioritizedClips clips(5);
  clips.record(3, false);  // clip 3 was tracked to its end
  core::RandomStream random(1, 0, 0);
  const int next = clips.sample(random);
  Eigen::VectorXd q = clip.sample(learn::reference_time(clip, random)), v = Eigen::VectorXd::Zero(clip.skeleton.nv());
  Eigen::VectorXd scratch(clip.skeleton.nv());
  learn::perturb(clip.skeleton, learn::Perturbation{}, random, q, v, scratch);

  CHECK(earned == doctest::Approx(0.7 + 0.15 * std::exp(-0.05) + 0.15 * std::exp(-0.2)));
  CHECK_FALSE(over);
  CHECK(next >= 0);
  CHECK(q.norm() > 0);
}

TEST_CASE("docs/learn.md: adversarial imitation") {
  learn::PpoParameters p;
  p.gamma = 0.5;
  p.minibatch = 128;
  p.policy_rate = 3e-3;
  Pacer pacers(32);
  learn::Ppo<> ppo(nn::Mlp<>({1, 16, 1}), nn::Mlp<>({1, 16, 1}), nn::GaussianHead(1, 0.2), 32, p);
  learn::AdversarialParameters a;
  a.minibatch = 64;
  a.rate = 3e-3;
  learn::AdversarialImitation<> imitation(learn::Discriminator<>(nn::Mlp<>({2, 16, 1})), 32 * p.steps, a);
  core::SerialExecutor serial;
  learn::AdversarialReport report;
  for (int k = 0; k < 60; ++k) report = imitation.iterate(ppo, pacers, Strollers{}, serial);
  // report.real_accuracy and report.fake_accuracy: how well the two are still told apart
  Eigen::MatrixXf seen = Eigen::MatrixXf::Zero(1, 1), action(1, 1);
  ppo.mean_action(seen, action);
  CHECK(action(0, 0) == doctest::Approx(0.5).epsilon(0.4));
  CHECK(report.real_accuracy + report.fake_accuracy < 1.7);
}
