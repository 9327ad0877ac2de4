// SPDX-License-Identifier: MIT
// Poses per second whose bodies are placed, and states whose momenta are summed, of the examples' humanoid: in double, in float
// and on packs, beside MuJoCo's mj_kinematics (which also places geoms and inertial frames) and mj_comVel with what it needs.
// `poses` counts lanes; `ratio` is ours, one pose at a time in double, over MuJoCo's, both timed in turn in one run.
#include <vector>

#include <benchmark/benchmark.h>
#include <mujoco/mujoco.h>

#include "../humanoid.hpp"
#include "../in_turn.hpp"
#include "../mujoco_peer.hpp"
#include <traceur/body/kinematics.hpp>
#include <traceur/body/momentum.hpp>
#include <traceur/core/pack.hpp>
#include <traceur/core/random.hpp>

namespace {

using namespace traceur;

template <class S>
class Ours {
 public:
  Ours() : frames_(humanoid().skeleton), twists_(humanoid().skeleton) {
    const body::Skeleton& skeleton = humanoid().skeleton;
    core::RandomStream random(1);
    const Eigen::VectorXd q = skeleton.neutral_pose();
    for (const double x : q) q_.push_back(S(static_cast<core::Element<S>>(x)));
    for (int k = 0; k < skeleton.nv(); ++k) v_.push_back(S(static_cast<core::Element<S>>(random.normal())));
  }
  void place() {
    benchmark::DoNotOptimize(q_.data());
    body::forward_kinematics(humanoid().skeleton, q_.data(), frames_);
    benchmark::ClobberMemory();
  }
  void momenta() {
    place();
    body::forward_velocities(humanoid().skeleton, frames_, v_.data(), twists_);
    const body::Momentum<S> m = body::momentum(humanoid(), frames_, twists_);
    benchmark::DoNotOptimize(&m);
    benchmark::ClobberMemory();
  }
  static constexpr int lanes = core::lane_count<S>;

 private:
  std::vector<S> q_, v_;
  body::Frames<S> frames_;
  body::Twists<S> twists_;
};

class Peer {
 public:
  void place() {
    mj_kinematics(mujoco_.model(), mujoco_.data());
    benchmark::ClobberMemory();
  }
  void momenta() {
    place();
    mj_comPos(mujoco_.model(), mujoco_.data());
    mj_comVel(mujoco_.model(), mujoco_.data());
    mj_subtreeVel(mujoco_.model(), mujoco_.data());
    benchmark::ClobberMemory();
  }
  static constexpr int lanes = 1;

 private:
  MujocoPeer mujoco_;
};

template <class Side, void (Side::*work)()>
void poses(benchmark::State& state) {
  Side side;
  for (auto _ : state) (side.*work)();
  state.counters["poses"] = benchmark::Counter(static_cast<double>(state.iterations()) * Side::lanes, benchmark::Counter::kIsRate);
}

template <void (Ours<double>::*mine)(), void (Peer::*theirs)()>
void against_mujoco(benchmark::State& state) {
  Ours<double> ours;
  Peer peer;
  in_turn(state, 1000, ours.lanes, [&] { (ours.*mine)(); }, [&] { (peer.*theirs)(); });
}

}  // namespace

BENCHMARK(poses<Ours<double>, &Ours<double>::place>)->Name("place/double");
BENCHMARK(poses<Ours<float>, &Ours<float>::place>)->Name("place/float");
BENCHMARK(poses<Ours<core::Pack<float>>, &Ours<core::Pack<float>>::place>)->Name("place/pack_float");
BENCHMARK(poses<Peer, &Peer::place>)->Name("place/mujoco");
BENCHMARK(poses<Ours<double>, &Ours<double>::momenta>)->Name("momenta/double");
BENCHMARK(poses<Ours<core::Pack<float>>, &Ours<core::Pack<float>>::momenta>)->Name("momenta/pack_float");
BENCHMARK(poses<Peer, &Peer::momenta>)->Name("momenta/mujoco");
BENCHMARK(against_mujoco<&Ours<double>::place, &Peer::place>)->Name("against_mujoco/place");
BENCHMARK(against_mujoco<&Ours<double>::momenta, &Peer::momenta>)->Name("against_mujoco/momenta");
