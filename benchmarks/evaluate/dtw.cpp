// SPDX-License-Identifier: MIT
// Dynamic time warping of two motions of 300 frames (10 s at 30 Hz) and 100 features: what one comparison of a run with
// a reference costs. `by_the_definition` is the double loop over all pairs that also yields the path; `banded` keeps to
// 30 frames off the diagonal; `bounds` are what decides whether a comparison is made at all.
#include <vector>

#include <Eigen/Core>
#include <benchmark/benchmark.h>

#include <traceur/core/random.hpp>
#include <traceur/evaluate/dtw.hpp>

namespace {

using namespace traceur;
using traceur::evaluate::Dtw;
using traceur::evaluate::FramePair;

constexpr int frames = 300, features = 100;

template <class T>
using Matrix = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;

/// A smooth motion: features swing at rates of their own.
template <class T>
Matrix<T> motion(std::uint64_t stream) {
  core::RandomStream random(1, stream);
  Matrix<T> m(features, frames);
  for (int k = 0; k < features; ++k) {
    const double rate = random.uniform(1, 6), phase = random.uniform(0, 6.28), size = random.uniform(0.1, 1);
    for (int t = 0; t < frames; ++t) m(k, t) = static_cast<T>(size * std::sin(rate * t / 30 + phase));
  }
  return m;
}

template <class T>
void distance(benchmark::State& state) {
  const Matrix<T> a = motion<T>(1), b = motion<T>(2);
  Dtw<T> dtw(frames, features);
  for (auto _ : state) benchmark::DoNotOptimize(dtw.distance(a, b));
}

void banded(benchmark::State& state) {
  const Matrix<float> a = motion<float>(1), b = motion<float>(2);
  Dtw<float> dtw(frames, features);
  for (auto _ : state) benchmark::DoNotOptimize(dtw.distance(a, b, 30));
}

void by_the_definition(benchmark::State& state) {
  const Matrix<float> a = motion<float>(1), b = motion<float>(2);
  Dtw<float> dtw;
  std::vector<FramePair> path;
  for (auto _ : state) benchmark::DoNotOptimize(dtw.align(a, b, path));
}

void bounds(benchmark::State& state) {
  const Matrix<float> a = motion<float>(1), b = motion<float>(2);
  const evaluate::Envelope<float> envelope(b, 30);
  for (auto _ : state) {
    benchmark::DoNotOptimize(evaluate::kim_bound<float>(a, b));
    benchmark::DoNotOptimize(evaluate::keogh_bound(a, envelope));
  }
}

}  // namespace

BENCHMARK_TEMPLATE(distance, float)->Unit(benchmark::kMicrosecond);
BENCHMARK_TEMPLATE(distance, double)->Unit(benchmark::kMicrosecond);
BENCHMARK(banded)->Unit(benchmark::kMicrosecond);
BENCHMARK(by_the_definition)->Unit(benchmark::kMicrosecond);
BENCHMARK(bounds)->Unit(benchmark::kMicrosecond);
