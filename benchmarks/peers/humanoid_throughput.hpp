// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <traceur/io/clip_file.hpp>
#include <traceur/learn/ppo.hpp>
#include <traceur/learn/tracking.hpp>

#include "../cpu_seconds.hpp"
#include "../humanoid.hpp"

/// How fast a humanoid learns to track, everything included: 480 Hz of simulation with self-collision, 30 Hz of control,
/// observation, reward, restarts, advantages and updates.
namespace humanoid_throughput {

namespace learn = traceur::learn;
namespace nn = traceur::nn;
using Lane = traceur::core::Pack<float>;
using Threads = traceur::core::ThreadExecutor;
using Tracking = learn::Tracking<Lane, Threads>;

/// The bundled dynamics, timed.
class TimedDynamics final : public traceur::control::Engine<Lane> {
public:
  explicit TimedDynamics(double dt) : dt_(dt) {}
  double seconds() const { return seconds_; }

  bool fits(const traceur::sim::Model&) const override { return true; }
  void begin(const traceur::sim::Lanes<Lane>&, int) override {}
  void push(int, int, const traceur::core::Vector3<double>&, const traceur::core::Vector3<double>&) override {}
  void step(traceur::sim::Lanes<Lane>& lanes, double seconds, std::span<const bool>) override {
    const double start = cpu_seconds();
    lanes.step(static_cast<int>(std::lround(seconds / dt_)));
    seconds_ += cpu_seconds() - start;
  }

private:
  double dt_, seconds_ = 0;
};

/// Environments, timed.
template <class E>
class Timed {
public:
  explicit Timed(E& environments) : of_(&environments) {}
  double seconds() const { return seconds_; }

  Eigen::Index environments() const noexcept { return of_->environments(); }
  Eigen::Index observations() const noexcept { return of_->observations(); }
  Eigen::Index actions() const noexcept { return of_->actions(); }
  void reset(std::uint64_t seed) {
    time([&] { of_->reset(seed); });
  }
  void observe(learn::Columns<float> out) const {
    time([&] { of_->observe(out); });
  }
  void step(learn::ConstColumns<float> actions, learn::StepResult<float>& result) {
    time([&] { of_->step(actions, result); });
  }
  void restart(Eigen::Index e) noexcept {
    time([&] { of_->restart(e); });
  }

private:
  template <class F>
  void time(F&& f) const {
    const double start = cpu_seconds();
    f();
    seconds_ += cpu_seconds() - start;
  }

  E* of_;
  mutable double seconds_ = 0;
};

/// Widths of both networks' hidden layers, and how often an update goes through its 4096 samples.
struct Setting {
  Eigen::Index first, second;
  int epochs;
};

/// Shares of the time of one thread.
struct Shares {
  double simulate, observe_and_reward, act_and_value, update;
};

/// What is tracked, and by whom.
class Scene {
public:
  Scene()
      : model_(traceur::sim::make_model(humanoid())),
        roles_(traceur::control::find_roles(model_)),
        motion_(learn::make_reference_motion(model_, roles_, walk(), learn::TrackingSettings{}.control_hz)) {
    extras_.self_collisions = traceur::sim::self_collision_pairs(model_);
  }

  /// Samples a second of wall time, of `updates` updates on so many threads.
  double samples_per_s(const Setting& setting, int updates, int threads) const {
    Threads executor(threads);
    const auto environments = make(executor);
    learn::Ppo<float> ppo = make_ppo(setting, *environments);
    ppo.iterate(*environments, executor);
    const std::int64_t before = ppo.samples();
    const auto start = std::chrono::steady_clock::now();
    for (int k = 0; k < updates; ++k) ppo.iterate(*environments, executor);
    const std::chrono::duration<double> passed = std::chrono::steady_clock::now() - start;
    return static_cast<double>(ppo.samples() - before) / passed.count();
  }

  /// Where the time of `updates` updates goes.
  Shares shares(const Setting& setting, int updates) const {
    Threads executor(1);
    const auto environments = make(executor);
    std::vector<std::shared_ptr<TimedDynamics>> dynamics;
    for (Eigen::Index g = 0; g < environments->environments() / Tracking::width; ++g)
      dynamics.push_back(std::make_shared<TimedDynamics>(environments->settings().simulation.dt));
    environments->use({dynamics.begin(), dynamics.end()});
    Timed<Tracking> timed(*environments);
    learn::Ppo<float> ppo = make_ppo(setting, *environments);
    ppo.iterate(timed, executor);
    const auto simulated = [&] {
      double sum = 0;
      for (const auto& d : dynamics) sum += d->seconds();
      return sum;
    };
    const double simulated_before = simulated(), environments_before = timed.seconds();
    double collecting = 0, updating = 0;
    for (int k = 0; k < updates; ++k) {
      const double start = cpu_seconds();
      ppo.collect(timed, executor);
      const double middle = cpu_seconds();
      ppo.learn(executor);
      collecting += middle - start;
      updating += cpu_seconds() - middle;
    }
    const double all = collecting + updating, simulating = simulated() - simulated_before;
    const double inside = timed.seconds() - environments_before;
    return {simulating / all, (inside - simulating) / all, (collecting - inside) / all, updating / all};
  }

private:
  static traceur::motion::Clip walk() {
    return traceur::io::read_clip(std::filesystem::path(__FILE__).parent_path() / "../../examples/clips/walk.jsonl").clip;
  }

  std::unique_ptr<Tracking> make(Threads& executor) const {
    learn::TrackingSettings settings;
    settings.spread_ages = true;
    return std::make_unique<Tracking>(model_, roles_, std::vector{motion_}, 256, settings, traceur::sim::Ground<float>(), extras_, executor);
  }

  static learn::Ppo<float> make_ppo(const Setting& s, const Tracking& environments) {
    learn::PpoParameters p;
    p.epochs = s.epochs;
    p.reward_scale = 1 - p.gamma;
    p.divergence_target = 0.03;
    const Eigen::Index seen = environments.observations(), actions = environments.actions();
    return {nn::Mlp<>({seen, s.first, s.second, actions}), nn::Mlp<>({seen, s.first, s.second, 1}), nn::GaussianHead(actions, 1.0),
            environments.environments(), p};
  }

  traceur::sim::Model model_;
  traceur::control::Roles roles_;
  learn::ReferenceMotion motion_;
  traceur::sim::Extras extras_;
};

}  // namespace humanoid_throughput
