// SPDX-License-Identifier: MIT
// Threads that pretend to be processes, and a run of everything that is shared out, for a group of any kind.
#pragma once

#include <array>
#include <barrier>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <exception>
#include <span>
#include <thread>
#include <vector>

#include <traceur/learn/adversarial_imitation.hpp>
#include <traceur/learn/group_executor.hpp>
#include <traceur/learn/ppo.hpp>
#include <traceur/learn/shared_environments.hpp>

namespace learn_test {

namespace learn = traceur::learn;

/// What the threads of one group have in common.
struct Room {
  explicit Room(int members) : size(members), door(members) {}
  int size;
  std::barrier<> door;
  std::span<std::byte> shown;
};

class ThreadGroup final : public learn::ProcessGroup {
 public:
  ThreadGroup(Room& room, int rank) : room_(&room), rank_(rank) {}
  int rank() const noexcept override { return rank_; }
  int size() const noexcept override { return room_->size; }
  void broadcast(int root, std::span<std::byte> memory) override {
    if (root == rank_) room_->shown = memory;
    room_->door.arrive_and_wait();
    if (root != rank_) std::memcpy(memory.data(), room_->shown.data(), memory.size());
    room_->door.arrive_and_wait();
  }
  [[noreturn]] void abort(int) override { std::terminate(); }

 private:
  Room* room_;
  int rank_;
};

/// Calls f(group) in as many threads as the group has members.
template <class F>
void as_processes(int size, F&& f) {
  Room room(size);
  std::vector<std::thread> threads;
  for (int rank = 0; rank < size; ++rank)
    threads.emplace_back([&, rank] {
      ThreadGroup group(room, rank);
      f(group);
    });
  for (std::thread& t : threads) t.join();
}

/// A part of a task: points on a line that should keep still, and whose kind, of three, is drawn by how often it fails. What
/// environment `first + e` of the whole does depends on its number alone, and on the ends of all.
struct Points {
  Eigen::Index count, first;
  std::uint64_t seed = 0;
  Eigen::VectorXf place;
  Eigen::MatrixXf speeds;
  Eigen::VectorXi episode, kind;
  std::vector<bool> fell;
  double failures[3] = {1, 1, 1};

  Points(Eigen::Index n, Eigen::Index from)
      : count(n), first(from), place(n), speeds(2, n), episode(n), kind(n), fell(static_cast<std::size_t>(n)) {
    reset(0);
  }
  Eigen::Index environments() const { return count; }
  Eigen::Index observations() const { return 2; }
  Eigen::Index actions() const { return 1; }
  Eigen::Index style_features() const { return 2; }
  void reset(std::uint64_t s) {
    seed = s;
    for (Eigen::Index e = 0; e < count; ++e) {
      episode[e] = 0;
      begin(e);
    }
  }
  std::int32_t outcome(Eigen::Index e) const { return fell[static_cast<std::size_t>(e)] ? kind[e] : -1; }
  void witness(std::int32_t outcome) {
    if (outcome >= 0) failures[outcome] += 1;
  }
  void restart(Eigen::Index e) noexcept {
    witness(outcome(e));
    begin(e);
  }
  void begin(Eigen::Index e) noexcept {
    traceur::core::RandomStream random(seed, static_cast<std::uint64_t>(first + e), static_cast<std::uint64_t>(episode[e]++));
    const double u = random.uniform() * (failures[0] + failures[1] + failures[2]);
    kind[e] = u < failures[0] ? 0 : u < failures[0] + failures[1] ? 1 : 2;
    place[e] = random.uniform<float>(-0.5f, 0.5f);
    speeds.col(e).setZero();
    fell[static_cast<std::size_t>(e)] = false;
  }
  void observe(learn::Columns<float> out) const {
    out.row(0) = place.transpose();
    out.row(1) = kind.cast<float>().transpose();
  }
  void observe_style(learn::Columns<float> out) const { out = speeds; }
  void step(learn::ConstColumns<float> actions, learn::StepResult<float>& result) {
    for (Eigen::Index e = 0; e < count; ++e) {
      speeds(0, e) = speeds(1, e);
      speeds(1, e) = actions(0, e) * static_cast<float>(1 + kind[e]);
      place[e] += 0.2f * speeds(1, e);
      result.reward[e] = 1 - place[e] * place[e];
      fell[static_cast<std::size_t>(e)] = !(place[e] * place[e] < 1);
      if (fell[static_cast<std::size_t>(e)]) result.end[e] = learn::End::terminated;
    }
  }
};

struct StandStill {
  std::array<float, 2> sample(traceur::core::RandomStream& random) const {
    return {random.normal<float>(0.0f, 0.1f), random.normal<float>(0.0f, 0.1f)};
  }
};

/// What a run of four updates of 16 environments comes to, as seen by one member of the group.
inline std::vector<float> shared_run(learn::ProcessGroup& group, bool with_style) {
  using namespace traceur;
  constexpr int all = 16, steps = 8;
  core::ThreadExecutor local(1);
  learn::GroupExecutor<core::ThreadExecutor> executor(group, local);
  Points own(all / group.size(), group.rank() * all / group.size());
  learn::SharedEnvironments<Points> environments(own, group);
  learn::PpoParameters p;
  p.steps = steps;
  p.minibatch = 50;
  p.policy_rate = 3e-3;
  p.divergence_target = 0.01;
  learn::Ppo<> ppo(nn::Mlp<>({2, 16, 1}), nn::Mlp<>({2, 16, 1}), nn::GaussianHead(1, 0.5), all, p);
  learn::AdversarialParameters a;
  a.minibatch = 30;
  learn::AdversarialImitation<> imitation(learn::Discriminator<>(nn::Mlp<>({2, 8, 1})), all * steps, a);
  std::vector<float> out;
  for (int k = 0; k < 4; ++k) {
    learn::PpoReport r;
    if (with_style) {
      const learn::AdversarialReport both = imitation.iterate(ppo, environments, StandStill{}, executor);
      r = both.ppo;
      out.push_back(static_cast<float>(both.real_accuracy + 10 * both.loss));
    } else {
      r = ppo.iterate(environments, executor);
    }
    for (const double x : {r.reward, r.surrogate, r.value_loss, r.divergence, r.clip_fraction, static_cast<double>(r.terminated)})
      out.push_back(static_cast<float>(x));
  }
  out.insert(out.end(), ppo.policy_parameters().begin(), ppo.policy_parameters().end());
  out.insert(out.end(), ppo.value_parameters().begin(), ppo.value_parameters().end());
  if (with_style) out.insert(out.end(), imitation.theta().begin(), imitation.theta().end());
  for (const double f : own.failures) out.push_back(static_cast<float>(f));
  return out;
}

}  // namespace learn_test
