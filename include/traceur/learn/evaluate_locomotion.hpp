// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "traceur/learn/locomotion.hpp"

namespace traceur::learn {

/// How well characters moved as they were asked to.
struct LocomotionEvaluation {
  int episodes = 0, completed = 0, falls = 0, failures = 0;
  double speed_error_m_s = 0;    ///< mean distance of the speed, averaged over a second, from the wanted one, after settling;
                                 ///< NaN where no episode lasted so long
  double greatest_error_m_s = 0; ///< of the mean of one episode
  double normalized_return = 0;  ///< mean task reward a step of whole episodes, nothing being earned after an early end
  double seconds = 0;            ///< mean length
};

/// The same for the episodes that were asked for one range of speeds.
struct SpeedBand {
  double slowest = 0, fastest = 0;  ///< m/s
  LocomotionEvaluation result;
};

/// One episode in every environment from where they begin with this seed, all together and in `bands` bands of the speeds that
/// the task has. Goals should stand, as they do with `LocomotionStart::spread`. `settle_s`: time that counts for no speed's
/// error. `policy(observations, actions)` maps columns. Leaves the environments at their ends.
template <class S, core::Executor E, class Policy>
std::vector<SpeedBand> evaluate_locomotion(Locomotion<S, E>& environments, std::uint64_t seed, Policy&& policy, int bands = 3,
                                           double settle_s = 2) {
  const Eigen::Index n = environments.environments();
  const TargetSpeed& task = environments.settings().task;
  const double hz = environments.settings().control_hz;
  const int window = std::max(1, static_cast<int>(std::lround(hz))), settle = static_cast<int>(std::lround(settle_s * hz));
  environments.reset(seed);
  Eigen::MatrixXf observation(environments.observations(), n), action(environments.actions(), n);
  StepResult<float> result(n);
  struct Course {
    bool over = false;
    int steps = 0, expected = 0, errors = 0;
    double earned = 0, error = 0;
    std::vector<double> speeds;
    End end = End::running;
  };
  std::vector<Course> courses(static_cast<std::size_t>(n));
  for (Eigen::Index e = 0; e < n; ++e) courses[static_cast<std::size_t>(e)].expected = environments.steps_left(e);
  for (Eigen::Index left = n; left > 0;) {
    environments.observe(observation);
    policy(ConstColumns<float>(observation), Columns<float>(action));
    result.clear();
    environments.step(action, result);
    for (Eigen::Index e = 0; e < n; ++e) {
      Course& c = courses[static_cast<std::size_t>(e)];
      if (c.over) continue;
      ++c.steps;
      c.end = result.end[e];
      if (c.end == End::running || c.end == End::timed_out) {
        c.earned += static_cast<double>(result.reward[e]);
        if (c.steps > settle) c.speeds.push_back(environments.speed(e));
        if (static_cast<int>(c.speeds.size()) >= window) {
          double mean = 0;
          for (int k = 0; k < window; ++k) mean += c.speeds[c.speeds.size() - 1 - static_cast<std::size_t>(k)];
          c.error += std::abs(mean / window - static_cast<double>(environments.goal(e).speed));
          ++c.errors;
        }
      }
      if (c.end == End::running) continue;
      c.over = true;
      --left;
    }
  }
  std::vector<SpeedBand> out(static_cast<std::size_t>(bands) + 1);
  for (std::size_t b = 0; b < out.size(); ++b) {
    SpeedBand& band = out[b];
    const double width = (task.fastest - task.slowest) / bands;
    band.slowest = b == 0 ? task.slowest : task.slowest + width * static_cast<double>(b - 1);
    band.fastest = b == 0 ? task.fastest : band.slowest + width;
    LocomotionEvaluation& sum = band.result;
    double expected = 0, errors = 0, steps = 0;
    for (Eigen::Index e = 0; e < n; ++e) {
      const Course& c = courses[static_cast<std::size_t>(e)];
      const double speed = static_cast<double>(environments.goal(e).speed);
      const bool last = b + 1 == out.size();
      if (b > 0 && (speed < band.slowest || (speed >= band.fastest && !last))) continue;
      ++sum.episodes;
      sum.completed += c.end == End::timed_out;
      sum.falls += c.end == End::terminated;
      sum.failures += c.end == End::failed;
      sum.normalized_return += c.earned;
      expected += c.expected;
      steps += c.steps;
      sum.speed_error_m_s += c.error;
      errors += c.errors;
      double mean = 0;
      for (const double s : c.speeds) mean += s / static_cast<double>(c.speeds.size());
      if (c.errors > 0) sum.greatest_error_m_s = std::max(sum.greatest_error_m_s, std::abs(mean - speed));
    }
    if (expected > 0) sum.normalized_return /= expected;
    sum.speed_error_m_s = errors > 0 ? sum.speed_error_m_s / errors : std::numeric_limits<double>::quiet_NaN();
    if (sum.episodes > 0) sum.seconds = steps / sum.episodes / hz;
  }
  return out;
}

}  // namespace traceur::learn
