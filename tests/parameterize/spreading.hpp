// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include <traceur/core/random.hpp>
#include <traceur/parameterize/curriculum.hpp>

/// A skill without a character, on which curricula are compared by test and benchmark.
namespace spreading {

using namespace traceur::parameterize;
using traceur::core::RandomStream;
using Vector = Eigen::VectorXd;
using Attempts = std::vector<Attempt<int>>;

/// A skill over the unit square that spreads from where it is mastered. Practice at a task helps it and its
/// surroundings, but only next to what is mastered already; every failed episode makes all else fade a little. So
/// practice far ahead is worse than useless, and what was learnt must be kept up.
class Skill {
public:
  explicit Skill(const Vector& start) : mastery_(cells * cells) {
    for (int i = 0; i < cells * cells; ++i) mastery_[at(i)] = std::exp(-squared(i, start) / 0.01);
  }

  Attempts practise(const Eigen::MatrixXd& tasks, RandomStream random) {
    Attempts attempts;
    double failed = 0.0;
    std::vector<double> gains;
    for (Eigen::Index t = 0; t < tasks.cols(); ++t) {
      const Vector a = tasks.col(t);
      const double here = mastery(a);
      failed += (1.0 - here) / static_cast<double>(tasks.cols());
      double best = 0.0;
      near(a, [&](int i, double d) { best = d < 0.0144 ? std::max(best, mastery_[at(i)]) : best; });
      gains.push_back(best > 0.3 ? 0.3 * best : 0.0);
      for (int episode = 0; episode < 3; ++episode) {
        Attempt<int> attempt;
        attempt.task = static_cast<int>(t);
        attempt.achieved = a;
        for (Eigen::Index d = 0; d < 2; ++d) attempt.achieved(d) += 0.06 * (1.0 - here) * random.normal();
        attempt.value = std::min(here, mastery(attempt.achieved));
        attempt.fitness = attempt.value * random.uniform(0.85, 1.0);
        attempts.push_back(attempt);
      }
    }
    for (double& m : mastery_) m *= 1.0 - 0.002 - 0.06 * failed;
    for (Eigen::Index t = 0; t < tasks.cols(); ++t) {
      near(tasks.col(t), [&](int i, double d) {
        mastery_[at(i)] += gains[static_cast<std::size_t>(t)] * std::exp(-d / 0.0036) * (1.0 - mastery_[at(i)]);
      });
    }
    return attempts;
  }

private:
  static constexpr int cells = 20;
  static std::size_t at(int i) { return static_cast<std::size_t>(i); }

  static double squared(int cell, const Vector& a) {
    const double x = (cell % cells + 0.5) / cells - a(0), y = (cell / cells + 0.5) / cells - a(1);
    return x * x + y * y;
  }
  template <class F>
  static void near(const Vector& a, F&& f) {
    const int x = static_cast<int>(a(0) * cells), y = static_cast<int>(a(1) * cells);
    for (int j = std::max(0, y - 3); j <= std::min(cells - 1, y + 3); ++j) {
      for (int i = std::max(0, x - 3); i <= std::min(cells - 1, x + 3); ++i)
        f(j * cells + i, squared(j * cells + i, a));
    }
  }
  double mastery(const Vector& a) const {
    double weights = 1e-9, sum = 0.0;
    near(a, [&](int i, double d) {
      const double weight = std::exp(-d / 0.0025);
      weights += weight;
      sum += weight * mastery_[at(i)];
    });
    return sum / weights;
  }

  std::vector<double> mastery_;
};

inline CurriculumParameters square(Schedule schedule = Schedule::adaptive, std::uint64_t seed = 1) {
  CurriculumParameters p;
  p.lower = Vector::Zero(2);
  p.upper = Vector::Ones(2);
  p.start = Vector::Constant(2, 0.1);
  p.elites.radius = 0.05;
  p.density.bandwidth = 0.106;
  p.draws = 30;
  p.schedule = schedule;
  p.mastery = 0.7;
  p.timeout = 40;
  p.seed = seed;
  return p;
}

/// Calls after(batch, curriculum) after every batch.
template <class F>
void practise(Schedule schedule, std::uint64_t seed, int batches, F&& after) {
  Curriculum<int> curriculum(square(schedule, seed));
  Skill skill(curriculum.parameters().start);
  for (int b = 0; b < batches; ++b) {
    curriculum.tell(skill.practise(curriculum.ask(), RandomStream(seed, 7, static_cast<std::uint64_t>(b))));
    after(b, curriculum);
  }
}

}  // namespace spreading
