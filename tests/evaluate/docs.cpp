// SPDX-License-Identifier: MIT
// The snippets of docs/evaluate.md, compiled and run. Keep the two alike.
#include <cmath>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/evaluate/confidence.hpp>
#include <traceur/evaluate/dtw.hpp>
#include <traceur/evaluate/skill_accuracy.hpp>

using namespace traceur;

namespace {

Eigen::MatrixXf swing(double rate, int frames) {
  Eigen::MatrixXf m(3, frames);
  for (int t = 0; t < frames; ++t)
    for (int k = 0; k < 3; ++k) m(k, t) = static_cast<float>(std::sin(rate * (k + 1) * t / 30 + k));
  return m;
}

}  // namespace

TEST_CASE("docs/evaluate.md: dynamic time warping") {
  const Eigen::MatrixXf a = swing(2, 90), b = swing(1.8, 100);

  evaluate::Dtw<float> dtw;
  const float distance = dtw.distance(a, b);    // features x frames each
  const float banded = dtw.distance(a, b, 30);  // frames at most 30 apart
  std::vector<evaluate::FramePair> path;
  dtw.align(a, b, path);  // the alignment itself

  CHECK(distance > 0);
  CHECK(distance <= banded);
  CHECK(path.size() >= 100);
}

TEST_CASE("docs/evaluate.md: skills") {
  std::vector<evaluate::SkillClip<float>> references;
  for (int k = 0; k < 3; ++k) references.push_back({"clip " + std::to_string(k), k, swing(1.0 + k, 40)});
  struct Encounter {
    core::Vector3<double> first, last;
    int reference;
  };
  Eigen::MatrixXd root(3, 120);
  Eigen::MatrixXf features(3, 120);
  std::vector<Encounter> encounters;
  for (int t = 0; t < 120; ++t) root.col(t) << 0.1 * t, 0, 0.9;
  for (int k = 0; k < 3; ++k) {
    features.middleCols(40 * k, 40) = references[static_cast<std::size_t>(k)].features;
    encounters.push_back({{4.0 * k, 0, 0.9}, {4.0 * k + 3.9, 0, 0.9}, k});
  }

  const evaluate::SkillJudge<float> judge(references);
  evaluate::Dtw<float> dtw;
  evaluate::SkillTally tally(judge.skills());
  for (const auto& met : encounters) {
    const evaluate::Segment piece = evaluate::segment<double>(root, met.first, met.last);
    tally.add(judge.judge(features.middleCols(piece.begin, piece.frames()), met.reference, dtw));
  }
  const evaluate::Interval accuracy = tally.accuracy();  // Wilson, 95 %
  const double evenness = tally.performed().evenness();  // 0 when one skill does for all

  CHECK(accuracy.estimate == 1);
  CHECK(accuracy.low < 0.5);
  CHECK(evenness == doctest::Approx(1));
}

TEST_CASE("docs/evaluate.md: confidence") {
  const std::vector<double> errors{0.28, 0.35, 0.31, 0.40, 0.22, 0.33, 0.30, 0.27, 0.36, 0.29, 0.34};

  const evaluate::Interval done = evaluate::wilson_interval(74, 100);  // 0.646 to 0.816
  const evaluate::Interval mean = evaluate::mean_interval(errors);     // 2000 resamples, seed 0

  CHECK(done.low == doctest::Approx(0.646).epsilon(0.001));
  CHECK(done.high == doctest::Approx(0.816).epsilon(0.001));
  CHECK(mean.low < mean.estimate);
}
