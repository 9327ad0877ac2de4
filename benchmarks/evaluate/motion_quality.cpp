// SPDX-License-Identifier: MIT
// Measures of a motion of 5 s (150 frames, 304 surface points, 15 joints) over a terrain of 32 by 32 boxes: total penetration
// and contact loss and the share of frames of high jerk (PARC s7.2); and how much of a task space of two parameters a
// thousand elites cover (Lee et al. 2021, ER).
#include <vector>

#include <Eigen/Core>
#include <benchmark/benchmark.h>

#include <traceur/core/random.hpp>
#include <traceur/evaluate/coverage.hpp>
#include <traceur/evaluate/motion_quality.hpp>
#include <traceur/parameterize/density.hpp>
#include <traceur/parameterize/elite_set.hpp>

#include "../rough_ground.hpp"

namespace {

using namespace traceur;
template <class T>
using Matrix = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;

constexpr Eigen::Index frames = 150;
constexpr int bodies = 15, per_body = 20;

/// A cloud of points as large as a body that goes along x, a tenth of them in the ground.
template <class T>
Matrix<T> points(const terrain::HeightGrid& grid, Eigen::Index count) {
  core::RandomStream random(4);
  Matrix<T> out(3 * count, frames);
  for (Eigen::Index t = 0; t < frames; ++t)
    for (Eigen::Index k = 0; k < count; ++k) {
      const double x = 2 + 0.05 * static_cast<double>(t) + random.uniform(-0.4, 0.4), y = 6 + random.uniform(-0.4, 0.4);
      out(3 * k, t) = static_cast<T>(x);
      out(3 * k + 1, t) = static_cast<T>(y);
      out(3 * k + 2, t) = static_cast<T>(grid.height(x, y) + random.uniform(-0.2, 1.6));
    }
  return out;
}

template <class T>
void penetration(benchmark::State& state) {
  const terrain::HeightGrid grid = rough_ground();
  const Matrix<T> places = points<T>(grid, bodies * per_body);
  for (auto _ : state) benchmark::DoNotOptimize(evaluate::penetration_loss<T>(grid, places));
}

template <class T>
void contact(benchmark::State& state) {
  const terrain::HeightGrid grid = rough_ground();
  const Matrix<T> places = points<T>(grid, bodies * per_body);
  std::vector<int> body_of_point;
  for (int k = 0; k < bodies * per_body; ++k) body_of_point.push_back(k / per_body);
  Matrix<T> labels = Matrix<T>::Zero(bodies, frames);
  labels.topRows(2).setOnes();
  for (auto _ : state) benchmark::DoNotOptimize(evaluate::contact_loss<T>(grid, places, body_of_point, labels));
}

template <class T>
void high_jerk(benchmark::State& state) {
  const Matrix<T> joints = points<T>(rough_ground(), bodies);
  for (auto _ : state) benchmark::DoNotOptimize(evaluate::high_jerk_share<T>(joints, T(1.0 / 30)));
}

void exploration(benchmark::State& state) {
  parameterize::EliteSetParameters parameters;
  parameters.radius = 0.01;
  parameterize::EliteSet<int> elites(2, parameters);
  core::RandomStream random(5);
  Eigen::VectorXd a(2);
  while (elites.size() < 1000) {
    a << random.uniform(), random.uniform(0, 0.5);
    elites.insert(a, random.uniform(0.1, 1.0));
  }
  const parameterize::KernelDensity kernel({0.02, 1.0, 3.0});
  const Eigen::VectorXd lower = Eigen::VectorXd::Zero(2), upper = Eigen::VectorXd::Ones(2);
  double ratio = 0;
  for (auto _ : state)
    ratio = evaluate::exploration_ratio([&](const Eigen::VectorXd& at) { return kernel(elites, at); }, lower, upper);
  state.counters["ratio"] = ratio;
}

}  // namespace

BENCHMARK_TEMPLATE(penetration, float)->Unit(benchmark::kMicrosecond);
BENCHMARK_TEMPLATE(penetration, double)->Unit(benchmark::kMicrosecond);
BENCHMARK_TEMPLATE(contact, float)->Unit(benchmark::kMicrosecond);
BENCHMARK_TEMPLATE(contact, double)->Unit(benchmark::kMicrosecond);
BENCHMARK_TEMPLATE(high_jerk, float)->Unit(benchmark::kMicrosecond);
BENCHMARK_TEMPLATE(high_jerk, double)->Unit(benchmark::kMicrosecond);
BENCHMARK(exploration)->Unit(benchmark::kMicrosecond);
