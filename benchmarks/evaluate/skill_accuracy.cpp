// SPDX-License-Identifier: MIT
// Which of 32 reference motions a piece of motion of 150 frames x 90 features is (HIL s7.2): with lower bounds and comparisons
// that end early, and by warping to every one. The piece is one of the references, its time bent and noise added.
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <benchmark/benchmark.h>

#include <traceur/core/random.hpp>
#include <traceur/evaluate/skill_accuracy.hpp>

namespace {

using namespace traceur;
using Motion = Eigen::MatrixXf;

constexpr int references = 32, expected = 5;
constexpr Eigen::Index features = 90, frames = 150;

Motion reference(std::uint64_t k) {
  core::RandomStream random(1, k);
  Motion out(features, frames);
  for (Eigen::Index i = 0; i < features; ++i) {
    const double rate = random.uniform(0.02, 0.12), begin = random.uniform(0, 6), size = random.uniform(0.2, 1);
    for (Eigen::Index t = 0; t < frames; ++t) out(i, t) = static_cast<float>(size * std::sin(begin + rate * static_cast<double>(t)));
  }
  return out;
}

std::vector<evaluate::SkillClip<float>> clips() {
  std::vector<evaluate::SkillClip<float>> out;
  for (int k = 0; k < references; ++k) {
    evaluate::SkillClip<float> clip;
    clip.name = std::to_string(k);
    clip.skill = k;
    clip.features = reference(static_cast<std::uint64_t>(k));
    out.push_back(clip);
  }
  return out;
}

Motion piece() {
  core::RandomStream random(2);
  const Motion from = reference(expected);
  Motion out(features, frames);
  for (Eigen::Index t = 0; t < frames; ++t) {
    const double share = static_cast<double>(t) / (frames - 1);
    const auto at = static_cast<Eigen::Index>(std::lround((frames - 1) * (share + 0.1 * share * (1 - share))));
    for (Eigen::Index i = 0; i < features; ++i) out(i, t) = from(i, std::min(at, frames - 1)) + random.normal<float>(0, 0.1F);
  }
  return out;
}

void judge(benchmark::State& state) {
  const evaluate::SkillJudge<float> judge(clips());
  const Motion motion = piece();
  evaluate::Dtw<float> warping;
  evaluate::Verdict verdict;
  for (auto _ : state) verdict = judge.judge(motion, expected, warping);
  state.counters["correct"] = verdict.correct;
}

void warp_to_all(benchmark::State& state) {
  const auto all = clips();
  const Motion motion = piece();
  evaluate::Dtw<float> warping;
  for (auto _ : state)
    for (const auto& clip : all) benchmark::DoNotOptimize(warping.distance(motion, clip.features));
}

}  // namespace

BENCHMARK(judge)->Unit(benchmark::kMillisecond);
BENCHMARK(warp_to_all)->Unit(benchmark::kMillisecond);
