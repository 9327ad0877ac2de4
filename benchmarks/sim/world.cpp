// SPDX-License-Identifier: MIT
// Steps of the humanoid per second, all lanes counted, 1/480 s each: in flight, standing, and lying after a fall with
// its limbs in motion. `steps` is the rate to compare; it counts CPU time of one thread. `save` and `restore` copy the whole state
// of one lane after another.
#include <vector>

#include <benchmark/benchmark.h>

#include "../humanoid.hpp"
#include <traceur/core/random.hpp>
#include <traceur/sim/world.hpp>

namespace {

using Vector = traceur::core::Vector3<double>;
enum class Scene { flight, standing, lying };

template <class S, Scene scene>
void world(benchmark::State& state) {
  const auto& s = humanoid().skeleton;
  const int lanes = static_cast<int>(state.range(0)) * traceur::core::lane_count<S>;
  traceur::sim::World<S> w(humanoid(), lanes);
  Eigen::VectorXd q = s.neutral_pose(), v = Eigen::VectorXd::Zero(s.nv());
  q[2] = scene == Scene::flight ? 1e3 : 0.8835;
  if (scene != Scene::flight) {
    about_axis(Vector{0, 1, 0}, 0.045).store(q.data() + 3);
    for (const char* ankle : {"right_ankle", "left_ankle"})
      about_axis(Vector{0, 1, 0}, -0.045).store(q.data() + s[s.find(ankle)].q_index);
  }
  if (scene == Scene::lying) {
    q[2] = 0.4;
    about_axis(Vector{0, 1, 0}, 1.5).store(q.data() + 3);
  }
  for (int l = 0; l < lanes; ++l) w.reset(l, q, v);
  w.step(480);
  constexpr int steps = 16;
  int moment = 0;
  for (auto _ : state) {
    if (scene == Scene::lying) {
      traceur::core::RandomStream random(1, 0, static_cast<std::uint64_t>(moment++));
      Eigen::VectorXd target = s.neutral_pose();
      for (const auto& j : s.joints())
        if (j.type == traceur::body::JointType::ball)
          exp_map(0.5 * Vector{random.normal(), random.normal(), random.normal()}).store(target.data() + j.q_index);
      for (int l = 0; l < lanes; ++l) w.set_target(l, target);
    }
    w.step(steps);
  }
  state.counters["steps"] =
      benchmark::Counter(static_cast<double>(state.iterations()) * steps * lanes, benchmark::Counter::kIsRate);
}

template <class S, bool back>
void copy_state(benchmark::State& state) {
  constexpr int lanes = 64;
  traceur::sim::World<S> w(humanoid(), lanes);
  const auto size = static_cast<std::size_t>(w.state_size());
  std::vector<traceur::core::Element<S>> saved(lanes * size);
  for (int l = 0; l < lanes; ++l) w.save(l, saved.data() + static_cast<std::size_t>(l) * size);
  int lane = 0;
  for (auto _ : state) {
    lane = (lane + 1) % lanes;
    auto* const at = saved.data() + static_cast<std::size_t>(lane) * size;
    if (back)
      w.restore(lane, at);
    else
      w.save(lane, at);
    benchmark::ClobberMemory();
  }
  state.counters["bytes"] = static_cast<double>(size * sizeof(saved[0]));
}

using Wide = traceur::core::Pack<float>;
using Doubles = traceur::core::Pack<double>;

}  // namespace

BENCHMARK(world<double, Scene::flight>)->Arg(1);
BENCHMARK(world<double, Scene::standing>)->Arg(1);
BENCHMARK(world<double, Scene::lying>)->Arg(1);
BENCHMARK(world<float, Scene::flight>)->Arg(1);
BENCHMARK(world<float, Scene::standing>)->Arg(1);
BENCHMARK(world<Doubles, Scene::standing>)->Arg(1);
BENCHMARK(world<Wide, Scene::flight>)->Arg(1)->Arg(16);
BENCHMARK(world<Wide, Scene::standing>)->Arg(1)->Arg(16);
BENCHMARK(world<Wide, Scene::lying>)->Arg(1)->Arg(16);
BENCHMARK(copy_state<float, false>)->Name("save/float");
BENCHMARK(copy_state<float, true>)->Name("restore/float");
BENCHMARK(copy_state<Wide, false>)->Name("save/pack_float");
BENCHMARK(copy_state<Wide, true>)->Name("restore/pack_float");
