// SPDX-License-Identifier: MIT
#include <traceur/evaluate/skill_accuracy.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/random.hpp>

#include "../error_message.hpp"

namespace {

using namespace traceur;
using core::RandomStream;
using evaluate::Dtw;
using evaluate::no_band;
using evaluate::Segment;
using evaluate::SkillClip;
using evaluate::SkillJudge;
using evaluate::SkillTally;
using evaluate::Verdict;

template <class T>
using Matrix = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;

/// A smooth motion of its own.
template <class T>
Matrix<T> motion(std::uint64_t which, int frames, double pace = 1) {
  RandomStream random(91, which);
  Matrix<T> m(8, frames);
  for (int k = 0; k < 8; ++k) {
    const double rate = random.uniform(1, 5), phase = random.uniform(0, 6.28);
    for (int t = 0; t < frames; ++t) m(k, t) = static_cast<T>(std::sin(pace * rate * t / 30 + phase));
  }
  return m;
}

template <class T>
std::vector<SkillClip<T>> references() {
  std::vector<SkillClip<T>> clips;
  // Nineteen clips of fifteen skills, as in HIL.
  for (int k = 0; k < 19; ++k)
    clips.push_back({"clip " + std::to_string(k), k % 15, motion<T>(static_cast<std::uint64_t>(k), 30 + 3 * k)});
  return clips;
}

using traceur_test::message;

template <class T>
void check_judge(int band) {
  const SkillJudge<T> judge(references<T>(), band);
  CHECK(judge.skills() == 15);
  Dtw<T> warping;
  RandomStream random(92);
  for (int trial = 0; trial < 150; ++trial) {
    Matrix<T> m = motion<T>(random.below(19), 25 + static_cast<int>(random.below(50)), random.uniform(0.8, 1.2));
    const auto noise = static_cast<T>(random.uniform(0, 1.5));
    for (Eigen::Index k = 0; k < m.size(); ++k) m.data()[k] += noise * random.normal<T>();
    const int expected = static_cast<int>(random.below(19));
    const Verdict v = judge.judge(m, expected, warping);
    // Every reference in turn.
    int nearest = -1;
    T best = std::numeric_limits<T>::infinity();
    for (int k = 0; k < 19; ++k) {
      const T d = warping.distance(m, judge.clips()[static_cast<std::size_t>(k)].features, band);
      if (d < best) {
        best = d;
        nearest = k;
      }
    }
    CHECK(v.clip == nearest);
    if (nearest < 0) continue;
    CHECK(v.skill == nearest % 15);
    CHECK(v.correct == (nearest % 15 == expected % 15));
    const double error =
        static_cast<double>(warping.distance(m, judge.clips()[static_cast<std::size_t>(expected)].features, band)) /
        1000;
    CHECK(v.tracking_error == error);
  }
}

}  // namespace

TEST_CASE("segment: from where the root is nearest to the reference's start to where it is nearest to its end") {
  // A run along x at 0.1 m a frame.
  Eigen::MatrixXd root(3, 100);
  for (int t = 0; t < 100; ++t) root.col(t) << 0.1 * t, 0.02 * std::sin(t), 0.9;
  const Segment s = evaluate::segment<double>(root, {3.01, 0.1, 0.9}, {6.52, 0, 1.0});
  CHECK(s.begin == 30);
  CHECK(s.end == 66);
  CHECK(s.frames() == 36);
  // The whole of it for its own ends.
  const auto at = [&](int t) { return core::Vector3<double>{root(0, t), root(1, t), root(2, t)}; };
  CHECK(evaluate::segment<double>(root, at(0), at(99)).frames() == 100);
  // The end is never before the beginning, and the first of equal frames counts.
  CHECK(evaluate::segment<double>(root, at(50), at(20)).begin == 50);
  CHECK(evaluate::segment<double>(root, at(50), at(20)).frames() == 1);
  Eigen::MatrixXd still = Eigen::MatrixXd::Zero(3, 10);
  CHECK(evaluate::segment<double>(still, {0, 0, 0}, {0, 0, 0}).frames() == 1);
  CHECK(message([&] {
          evaluate::segment<double>(still.topRows(2), {0, 0, 0}, {0, 0, 0});
        }) == "segment: expected three rows and at least one frame");
}

TEST_CASE("judge: what a search through all references says, float and double, with a band and without") {
  check_judge<double>(no_band);
  check_judge<double>(20);
  check_judge<float>(no_band);
}

TEST_CASE("judge: a reference at another pace is known, and costs nothing at its own") {
  const SkillJudge<double> judge(references<double>());
  Dtw<double> warping;
  for (int k = 0; k < 19; ++k) {
    const Verdict same = judge.judge(judge.clips()[static_cast<std::size_t>(k)].features, k, warping);
    CHECK(same.clip == k);
    CHECK(same.correct);
    CHECK(same.tracking_error == 0);
    const Verdict slow = judge.judge(motion<double>(static_cast<std::uint64_t>(k), 2 * (30 + 3 * k), 0.5), k, warping);
    CHECK(slow.clip == k);
    const Verdict other = judge.judge(judge.clips()[static_cast<std::size_t>(k)].features, (k + 1) % 19, warping);
    CHECK(other.clip == k);
    CHECK(!other.correct);
    CHECK(other.tracking_error > 0);
  }
  // Clips 0 and 15 show one skill.
  CHECK(judge.judge(judge.clips()[15].features, 0, warping).correct);
}

TEST_CASE("judge: of equal references the first, and no verdict where nothing compares") {
  auto clips = references<double>();
  clips[5].features = clips[3].features;
  const SkillJudge<double> judge(clips);
  Dtw<double> warping;
  CHECK(judge.judge(clips[3].features, 5, warping).clip == 3);
  CHECK(judge.judge(clips[3].features, 7, warping).clip == 3);
  Matrix<double> bad = clips[3].features;
  bad(2, 4) = std::numeric_limits<double>::quiet_NaN();
  const Verdict none = judge.judge(bad, 3, warping);
  CHECK(none.clip == -1);
  CHECK(!none.correct);
  CHECK(std::isinf(none.tracking_error));
}

TEST_CASE("tally: accuracy, error and coverage of many verdicts") {
  SkillTally tally(3);
  for (int k = 0; k < 60; ++k) tally.add({k % 2, k % 2, k % 3 != 0, 0.3 + 0.001 * (k % 10)});
  tally.add({-1, -1, false, std::numeric_limits<double>::infinity()});
  CHECK(tally.judged() == 61);
  CHECK(tally.without_error() == 1);
  CHECK(tally.accuracy().estimate == doctest::Approx(40.0 / 61));
  CHECK(tally.accuracy().low == evaluate::wilson_interval(40, 61).low);
  CHECK(tally.tracking_error().estimate == doctest::Approx(0.3045));
  CHECK(tally.performed().count(0) == 30);
  CHECK(tally.performed().covered() == doctest::Approx(2.0 / 3));
  CHECK(!message([] { SkillTally(2).accuracy(); }).empty());
}

TEST_CASE("judge: references and motions that do not fit are refused by name") {
  CHECK(message([] { SkillJudge<double>({}); }) == "skill judge: expected at least one reference");
  auto clips = references<double>();
  clips[4].features = Matrix<double>::Zero(7, 10);
  CHECK(message([&] { SkillJudge<double> judge(clips); }) ==
        "skill judge: reference 'clip 4': expected 8 features, found 7");
  clips[4].features.resize(8, 0);
  CHECK(message([&] { SkillJudge<double> judge(clips); }) == "skill judge: reference 'clip 4' has no frames");
  clips = references<double>();
  clips[2].features(0, 0) = std::numeric_limits<double>::infinity();
  CHECK(message([&] { SkillJudge<double> judge(clips); }) ==
        "skill judge: reference 'clip 2' has a number that is not finite");
  const SkillJudge<double> judge(references<double>());
  Dtw<double> warping;
  CHECK(message([&] { judge.judge(motion<double>(1, 20), 19, warping); }) ==
        "skill judge: expected a reference below 19, found 19");
}
