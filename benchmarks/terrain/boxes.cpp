// SPDX-License-Identifier: MIT
// Boxes of a scene near a place, and the signed distance from those, for scenes of more and more boxes of the same density: the
// cost follows the boxes nearby. `distance` is from one box, in double, float and on packs (times are for one point).
#include <vector>

#include <benchmark/benchmark.h>

#include <traceur/core/pack.hpp>
#include <traceur/core/random.hpp>
#include <traceur/terrain/box_scene.hpp>

namespace {

using namespace traceur;

terrain::BoxScene scene(int side) {
  core::RandomStream random(1);
  std::vector<terrain::Box> boxes;
  for (int i = 0; i < side; ++i)
    for (int j = 0; j < side; ++j)
      boxes.push_back({{2.0 * i + random.uniform(-0.3, 0.3), 2.0 * j + random.uniform(-0.3, 0.3), 0.3},
                       {random.uniform(0.1, 0.6), random.uniform(0.1, 0.6), random.uniform(0.1, 0.3)}});
  return terrain::BoxScene(boxes);
}

void near(benchmark::State& state) {
  const auto side = static_cast<int>(state.range(0));
  const terrain::BoxScene boxes = scene(side);
  core::RandomStream random(2);
  std::vector<int> found;
  for (auto _ : state) {
    found.clear();
    boxes.near({random.uniform(0, 2.0 * side), random.uniform(0, 2.0 * side), 0.9}, 1.5, found);
    benchmark::DoNotOptimize(found.data());
  }
  state.counters["boxes"] = boxes.size();
}

template <class S>
void distance(benchmark::State& state) {
  using T = core::Element<S>;
  const core::Vector3<S> half{S(T(0.3)), S(T(0.5)), S(T(0.2))};
  core::RandomStream random(3);
  std::vector<core::Vector3<S>> places(64);
  for (auto& p : places)
    for (int l = 0; l < core::lane_count<S>; ++l) {
      core::set_lane(p.x, l, static_cast<T>(random.uniform(-1, 1)));
      core::set_lane(p.y, l, static_cast<T>(random.uniform(-1, 1)));
      core::set_lane(p.z, l, static_cast<T>(random.uniform(-1, 1)));
    }
  for (auto _ : state)
    for (const auto& p : places) {
      auto d = terrain::box_distance(p, half);
      benchmark::DoNotOptimize(d);
    }
  state.counters["seconds_per_point"] = benchmark::Counter(static_cast<double>(state.iterations()) * 64 * core::lane_count<S>,
                                                           benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

}  // namespace

BENCHMARK(near)->Arg(4)->Arg(16)->Arg(64);
BENCHMARK_TEMPLATE(distance, double);
BENCHMARK_TEMPLATE(distance, float);
BENCHMARK_TEMPLATE(distance, core::Pack<float>);
