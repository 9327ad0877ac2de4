// SPDX-License-Identifier: MIT
// Poses per second read from a clip between its keys: as it is, its velocity, warped in time and displaced (Lee et al. 2021,
// Eq. 1-3) in double and with derivatives by ceres::Jet; and the warp and its inverse alone.
#include <filesystem>
#include <vector>

#include <benchmark/benchmark.h>
#include <ceres/jet.h>

#include <traceur/io/clip_file.hpp>
#include <traceur/motion/displacement.hpp>
#include <traceur/motion/time_warp.hpp>

namespace {

using namespace traceur;

const motion::Clip& walk() {
  static const motion::Clip clip =
      io::read_clip(std::filesystem::path(__FILE__).parent_path() / "../../examples/clips/walk.jsonl").clip;
  return clip;
}

/// Moments all over the clip, in no order.
double next(double phi) {
  phi += 0.618 * walk().duration();
  return phi < walk().duration() ? phi : phi - walk().duration();
}

void count(benchmark::State& state) {
  state.counters["poses"] = benchmark::Counter(static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
}

void sample(benchmark::State& state) {
  Eigen::VectorXd q(walk().skeleton.nq());
  double phi = 0;
  for (auto _ : state) {
    walk().sample(phi = next(phi), q.data());
    benchmark::ClobberMemory();
  }
  count(state);
}

void velocity(benchmark::State& state) {
  double phi = 0;
  for (auto _ : state) benchmark::DoNotOptimize(walk().velocity(phi = next(phi)));
  count(state);
}

template <class S>
motion::TimeWarp<S> warp() {
  Eigen::Matrix<S, Eigen::Dynamic, 1> tau(30);
  for (Eigen::Index k = 0; k < tau.size(); ++k) tau[k] = S(k % 2 == 0 ? 0.2 : -0.1);
  return {tau, walk().duration() / 30};
}

template <class S>
void sample_changed(benchmark::State& state) {
  const auto w = warp<S>();
  motion::Displacement<S> d;
  d.times = Eigen::VectorXd::LinSpaced(8, 0, walk().duration());
  d.values.setConstant(walk().skeleton.nv(), 8, S(0.05));
  std::vector<S> q(static_cast<std::size_t>(walk().skeleton.nq())), scratch(static_cast<std::size_t>(walk().skeleton.nv()));
  double t = 0;
  for (auto _ : state) {
    motion::sample_displaced(walk(), d, w.phase(S(t = next(t))), q.data(), scratch.data());
    benchmark::ClobberMemory();
  }
  count(state);
}

void phase(benchmark::State& state) {
  const auto w = warp<double>();
  double t = 0;
  for (auto _ : state) benchmark::DoNotOptimize(w.phase(t = next(t)));
}
void time(benchmark::State& state) {
  const auto w = warp<double>();
  double phi = 0;
  for (auto _ : state) benchmark::DoNotOptimize(w.time(phi = next(phi)));
}

}  // namespace

BENCHMARK(sample);
BENCHMARK(velocity);
BENCHMARK_TEMPLATE(sample_changed, double);
BENCHMARK_TEMPLATE(sample_changed, ceres::Jet<double, 4>);
BENCHMARK(phase);
BENCHMARK(time);
