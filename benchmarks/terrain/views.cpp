// SPDX-License-Identifier: MIT
// What one character sees of its ground in one control step: PARC's square map and height fan over a height grid, and the 60
// nearest of the points on a course's boxes (HIL); and making such grounds, as at the begin of an episode.
#include <cmath>
#include <vector>

#include <benchmark/benchmark.h>

#include <traceur/core/random.hpp>
#include <traceur/terrain/generators.hpp>
#include <traceur/terrain/local_map.hpp>
#include <traceur/terrain/point_cloud.hpp>

namespace {

using namespace traceur;

terrain::HeightGrid ground() {
  core::RandomStream random(3);
  return terrain::random_boxes({}, random);
}

template <class T, class Places>
void local_map(benchmark::State& state) {
  const terrain::HeightGrid grid = ground();
  const terrain::LocalMap<T> map{Places{}};
  std::vector<T> out(static_cast<std::size_t>(map.size()));
  T heading = 0;
  for (auto _ : state) {
    heading += T(0.1);
    map.sample(grid, terrain::HeadingFrame<T>::at({T(3.2), T(3.2), T(0.9)}, heading), out);
    benchmark::ClobberMemory();
  }
  state.counters["places"] = map.size();
}

template <class T>
void nearest_points(benchmark::State& state) {
  core::RandomStream random(4);
  std::vector<terrain::Box> boxes;
  for (int i = 0; i < 20; ++i)
    boxes.push_back({{2.0 * i, random.uniform(-0.5, 0.5), 0.3}, {random.uniform(0.2, 0.8), random.uniform(0.5, 1.5), 0.3}});
  const terrain::PointCloud<T> cloud{terrain::BoxScene(boxes)};
  terrain::NearestPoints<T> nearest;
  std::vector<T> out(3 * static_cast<std::size_t>(nearest.count()));
  T x = 0;
  for (auto _ : state) {
    x = std::fmod(x + T(0.7), T(38));
    nearest.observe(cloud, terrain::HeadingFrame<T>::at({x, T(0), T(0.9)}, T(0)), out);
    benchmark::ClobberMemory();
  }
  state.counters["points"] = cloud.size();
}

void make_boxes(benchmark::State& state) {
  core::RandomStream random(5);
  for (auto _ : state) benchmark::DoNotOptimize(terrain::random_boxes({}, random));
}
void make_walks(benchmark::State& state) {
  core::RandomStream random(6);
  for (auto _ : state) benchmark::DoNotOptimize(terrain::random_walks({}, random));
}
void make_stairs(benchmark::State& state) {
  core::RandomStream random(7);
  for (auto _ : state) benchmark::DoNotOptimize(terrain::stairs({}, random));
}

}  // namespace

BENCHMARK_TEMPLATE(local_map, float, terrain::SquareMap);
BENCHMARK_TEMPLATE(local_map, float, terrain::HeightFan);
BENCHMARK_TEMPLATE(local_map, double, terrain::HeightFan);
BENCHMARK_TEMPLATE(nearest_points, float);
BENCHMARK_TEMPLATE(nearest_points, double);
BENCHMARK(make_boxes);
BENCHMARK(make_walks);
BENCHMARK(make_stairs);
