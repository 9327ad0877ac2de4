// SPDX-License-Identifier: MIT
#pragma once

#include "traceur/learn/environment.hpp"

namespace traceur::learn {

/// How one episode of every environment went.
struct EpisodeReport {
  Eigen::VectorXd earned;  ///< undiscounted sum of rewards, rates times durations included
  Eigen::VectorXi steps;
  Eigen::Matrix<End, Eigen::Dynamic, 1> end;  ///< `running` where `most_steps` cut it short

  double mean() const { return earned.mean(); }
};

/// Plays one episode in every environment with `act(observations, actions)`, which writes an action for each column; at most
/// `most_steps` steps. `reset` the environments first. What comes after an environment's first end is not counted; a failed
/// step earns nothing.
template <class S, class E, class Act>
  requires Environments<E, S> && std::invocable<Act&, ConstColumns<S>, Columns<S>>
EpisodeReport play_episodes(E& environments, Act&& act, int most_steps) {
  using Matrix = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;
  const Eigen::Index n = environments.environments();
  EpisodeReport report{Eigen::VectorXd::Zero(n), Eigen::VectorXi::Zero(n), {}};
  report.end.setConstant(n, End::running);
  Matrix observation(environments.observations(), n), action(environments.actions(), n);
  StepResult<S> result(n);
  Eigen::Index running = n;
  for (int step = 0; step < most_steps && running > 0; ++step) {
    environments.observe(observation);
    act(ConstColumns<S>(observation), Columns<S>(action));
    result.clear();
    environments.step(action, result);
    for (Eigen::Index e = 0; e < n; ++e) {
      if (report.end[e] == End::running) {
        ++report.steps[e];
        report.end[e] = result.end[e];
        if (result.end[e] != End::failed)
          report.earned[e] += static_cast<double>(result.reward[e]) +
                              static_cast<double>(result.reward_rate[e]) * static_cast<double>(result.duration[e]);
        if (result.end[e] != End::running) --running;
      }
      if (result.end[e] != End::running) environments.restart(e);
    }
  }
  return report;
}

}  // namespace traceur::learn
