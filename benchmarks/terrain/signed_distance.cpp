// SPDX-License-Identifier: MIT
// Signed distances of a body's surface points from the ground, as losses (PARC Eq. 7, 8) and contacts ask for them: 64
// points within a metre or so of a character that stands on a terrain of 32 by 32 random boxes. Times are for one
// point.
#include <array>
#include <cstddef>

#include <benchmark/benchmark.h>

#include <traceur/core/pack.hpp>
#include <traceur/core/random.hpp>
#include <traceur/terrain/signed_distance.hpp>

#include "../rough_ground.hpp"

namespace {

using namespace traceur;
template <class S>
using Vector = core::Vector3<S>;

constexpr std::size_t points = 64;

/// Around a body on the ground; `below` puts every point half a metre under the ground it is over.
template <class S>
std::array<Vector<S>, points> body(const terrain::HeightGrid& grid, bool below) {
  core::RandomStream random(4);
  std::array<Vector<S>, points> out;
  for (auto& p : out) {
    p = {S(0.0), S(0.0), S(0.0)};
    for (int lane = 0; lane < core::lane_count<S>; ++lane) {
      const double x = 6.4 + random.uniform(-0.8, 0.8), y = 6.4 + random.uniform(-0.8, 0.8);
      const double z = grid.height(x, y) + (below ? -0.5 : random.uniform(0, 1.8));
      core::set_lane(p.x, lane, static_cast<core::Element<S>>(x));
      core::set_lane(p.y, lane, static_cast<core::Element<S>>(y));
      core::set_lane(p.z, lane, static_cast<core::Element<S>>(z));
    }
  }
  return out;
}

void per_point(benchmark::State& state, int lanes) {
  state.counters["seconds_per_point"] =
      benchmark::Counter(static_cast<double>(state.iterations()) * static_cast<double>(points) * lanes,
                         benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

template <class S>
void surface(benchmark::State& state, bool below) {
  const terrain::HeightGrid grid = rough_ground();
  const auto places = body<S>(grid, below);
  for (auto _ : state)
    for (const Vector<S>& p : places) {
      auto sample = terrain::surface(grid, p);
      benchmark::DoNotOptimize(sample);
    }
  per_point(state, core::lane_count<S>);
}

template <class S>
void outside(benchmark::State& state) {
  surface<S>(state, false);
}

template <class S>
void inside(benchmark::State& state) {
  surface<S>(state, true);
}

/// The distance without its gradient.
template <class S>
void alone(benchmark::State& state) {
  const terrain::HeightGrid grid = rough_ground();
  const auto places = body<S>(grid, false);
  for (auto _ : state)
    for (const Vector<S>& p : places) {
      S distance = terrain::signed_distance(grid, p);
      benchmark::DoNotOptimize(distance);
    }
  per_point(state, core::lane_count<S>);
}

template <class S>
void contact_surface(benchmark::State& state) {
  const terrain::HeightGrid grid = rough_ground();
  const auto places = body<S>(grid, false);
  for (auto _ : state)
    for (const Vector<S>& p : places) {
      auto sample = terrain::contact_surface(grid, p, core::Element<S>(0.1));
      benchmark::DoNotOptimize(sample);
    }
  per_point(state, core::lane_count<S>);
}

}  // namespace

BENCHMARK_TEMPLATE(outside, double);
BENCHMARK_TEMPLATE(inside, double);
BENCHMARK_TEMPLATE(outside, float);
BENCHMARK_TEMPLATE(alone, double);
BENCHMARK_TEMPLATE(alone, float);
BENCHMARK_TEMPLATE(alone, core::Pack<float>);
BENCHMARK_TEMPLATE(contact_surface, float);
BENCHMARK_TEMPLATE(contact_surface, core::Pack<float>);
