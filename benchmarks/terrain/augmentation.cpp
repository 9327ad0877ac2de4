// SPDX-License-Identifier: MIT
// Making terrain that a motion does not notice (PARC A.2, A.3): per frame, the bounds that one pose of the humanoid puts on the
// heights of a terrain of 32 by 32 cells; per terrain, another one within the bounds of a second of walking.
#include <benchmark/benchmark.h>

#include <traceur/body/kinematics.hpp>
#include <traceur/core/random.hpp>
#include <traceur/terrain/augmentation.hpp>
#include <traceur/terrain/generators.hpp>

#include "../humanoid.hpp"

namespace {

using namespace traceur;

terrain::HeightGrid ground() {
  terrain::RandomBoxes p;
  p.nx = p.ny = 32;
  p.height_min = -0.2;
  p.height_max = 0.2;
  core::RandomStream random(3);
  return terrain::random_boxes(p, random);
}

/// Adds the humanoid, upright, at a place along x.
void stand(terrain::HeightBounds& bounds, double x) {
  const body::Skeleton& s = humanoid().skeleton;
  Eigen::VectorXd q = s.neutral_pose();
  q[0] = x;
  q[1] = 6.4;
  q[2] = 1.0 + bounds.grid().height(x, 6.4);
  body::Frames<double> frames(s);
  body::forward_kinematics(s, q.data(), frames);
  bounds.add(humanoid(), frames);
}

void bounds_of_a_pose(benchmark::State& state) {
  terrain::HeightBounds bounds(ground());
  double x = 2;
  for (auto _ : state) {
    x = x < 10 ? x + 0.05 : 2;
    stand(bounds, x);
    benchmark::ClobberMemory();
  }
}

void augmented(benchmark::State& state) {
  terrain::HeightBounds bounds(ground());
  for (int k = 0; k < 30; ++k) stand(bounds, 5 + 0.05 * k);
  core::RandomStream random(4);
  for (auto _ : state) benchmark::DoNotOptimize(terrain::augmented(bounds, {}, random));
}

}  // namespace

BENCHMARK(bounds_of_a_pose)->Unit(benchmark::kMicrosecond);
BENCHMARK(augmented)->Unit(benchmark::kMicrosecond);
