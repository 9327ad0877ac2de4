// SPDX-License-Identifier: MIT
// Joint accelerations of the examples' humanoid from pose, velocity and torques, without contacts: in double, in float and on
// packs, beside mj_forward with constraints off (which also finds the inertia matrix and its factors). `states` counts lanes;
// `ratio` is ours, one state at a time in double, over MuJoCo's, both timed in turn in one run.
#include <vector>

#include <benchmark/benchmark.h>
#include <mujoco/mujoco.h>

#include "../humanoid.hpp"
#include "../in_turn.hpp"
#include "../mujoco_peer.hpp"
#include <traceur/core/pack.hpp>
#include <traceur/core/random.hpp>
#include <traceur/sim/dynamics.hpp>

namespace {

using namespace traceur;

template <class S>
class Ours {
 public:
  Ours() {
    const body::Skeleton& skeleton = humanoid().skeleton;
    core::RandomStream random(1);
    for (const double x : skeleton.neutral_pose()) q_.push_back(S(static_cast<core::Element<S>>(x)));
    for (int k = 0; k < skeleton.nv(); ++k) v_.push_back(S(static_cast<core::Element<S>>(random.normal())));
    tau_.assign(v_.size(), S(0));
    out_ = tau_;
  }
  void operator()() {
    benchmark::DoNotOptimize(q_.data());
    sim::forward_dynamics(model_, numbers_, q_.data(), v_.data(), tau_.data(), S(static_cast<core::Element<S>>(9.81)), work_,
                          out_.data());
    benchmark::ClobberMemory();
  }
  static constexpr int lanes = core::lane_count<S>;

 private:
  sim::Model model_ = sim::make_model(humanoid());
  sim::Numbers<S> numbers_{model_};
  sim::DynamicsWork<S> work_{model_};
  std::vector<S> q_, v_, tau_, out_;
};

class Peer {
 public:
  Peer() { mujoco_.model()->opt.disableflags |= mjDSBL_CONSTRAINT | mjDSBL_CONTACT | mjDSBL_SENSOR; }
  void operator()() {
    mj_forward(mujoco_.model(), mujoco_.data());
    benchmark::ClobberMemory();
  }
  static constexpr int lanes = 1;

 private:
  MujocoPeer mujoco_;
};

template <class Side>
void states(benchmark::State& state) {
  Side side;
  for (auto _ : state) side();
  state.counters["states"] = benchmark::Counter(static_cast<double>(state.iterations()) * Side::lanes, benchmark::Counter::kIsRate);
}

void against_mujoco(benchmark::State& state) {
  Ours<double> ours;
  Peer peer;
  in_turn(state, 1000, ours.lanes, ours, peer);
}

}  // namespace

BENCHMARK(states<Ours<double>>)->Name("forward_dynamics/double");
BENCHMARK(states<Ours<float>>)->Name("forward_dynamics/float");
BENCHMARK(states<Ours<core::Pack<float>>>)->Name("forward_dynamics/pack_float");
BENCHMARK(states<Peer>)->Name("forward_dynamics/mujoco");
BENCHMARK(against_mujoco)->Name("forward_dynamics/against_mujoco");
