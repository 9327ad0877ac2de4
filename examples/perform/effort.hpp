// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>

#include "traceur/control/learn_feedback.hpp"
#include "traceur/control/sampling_control.hpp"

namespace perform {

/// How much is spent on each step. The searches' own defaults are tuned for quality; what is quick is for a first look.
struct Effort {
  traceur::control::SamplingParameters sampling;
  traceur::control::FeedbackLearning learning;
  double windows = 1.6e6;       ///< simulated in a search, all rounds together; short clips get more samples
  int one_shot_starts = 16;     ///< starts of each candidate where a trial is short
  int gait_generations = 450;   ///< in place of the learning's own number, which is for motions done once
  double smoothing_s = 0.03;    ///< standard deviation of the Gaussian over the clip before the search
  double least_search_s = 3.6;  ///< gaits are searched over as many cycles as fill this, at least three
  int trials = 100;             ///< unseen starts
  double trial_s = 120;         ///< of a gait
  int push_trials = 16;         ///< for each direction and impulse, at different moments
  int push_halvings = 7;        ///< of the interval of impulses
  double push_most_Ns = 240;

  /// The search's settings for a motion of so many windows.
  traceur::control::SamplingParameters search(int count) const {
    traceur::control::SamplingParameters p = sampling;
    p.samples = std::clamp(static_cast<int>(windows / (count * p.rounds)), 512, 8192);
    p.elites = p.samples / 8;
    return p;
  }

  static Effort of(bool quick) {
    Effort e;
    if (!quick) {
      e.sampling.rounds = 16;
      e.learning.starts = 8;
      e.learning.generations = 400;
      return e;
    }
    e.windows = 1.5e5;
    e.one_shot_starts = 8;
    e.sampling.rounds = 8;
    e.learning.population = 24;
    e.learning.starts = 8;
    e.learning.generations = 60;
    e.gait_generations = 160;
    e.learning.last_seconds = 8;
    e.learning.validation_episodes = 16;
    e.trial_s = 20;
    e.push_trials = 8;
    e.push_halvings = 5;
    return e;
  }
};

}  // namespace perform
