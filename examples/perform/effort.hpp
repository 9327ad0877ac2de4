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
  double windows = 1.5e5;       ///< simulated in a search, all rounds together; short clips get more samples
  int longest_whole = 36;       ///< windows of a motion that is searched as a whole
  int horizon = 24;             ///< of those that are not; windows are in two horizons each
  int one_shot_starts = 16;     ///< starts of each candidate where a trial is short
  int gait_generations = 600;   ///< in place of the learning's own number, which is for motions done once
  int one_shot_patience = 250;  ///< they improve slowly for long: their success has no second chance to add up
  double one_shot_most_s = 4e6;  ///< simulated in learning such a motion: some 16 minutes of a core
  double reached_wanted = 0.95;  ///< share of fresh starts; with less, learning of what is done once goes on
  double held_wanted = 0.8;      ///< the same of those that still stand after the end
  int looks = 0;                 ///< fresh starts that tell; none: it never goes on
  int look_every = 50;           ///< generations, once it goes on
  int hardening_generations = 250;
  double run_slide = 5;         ///< cost of soles that slide at 1 m/s in the search for targets, of gaits with flight
  double run_law_slide = 2;     ///< the same while their law is learnt; more ties it to the ground it is learnt on
  double smoothing_s = 0.03;    ///< standard deviation of the Gaussian over the clip before the search
  double least_search_s = 3.6;  ///< gaits are searched over as many cycles as fill this, at least three
  int trials = 100;             ///< unseen starts
  double trial_s = 120;         ///< of a gait
  int push_trials = 16;         ///< for each direction and impulse, at different moments
  int push_halvings = 7;        ///< of the interval of impulses
  double push_most_Ns = 240;

  /// The search's settings for a motion of so many windows.
  traceur::control::SamplingParameters search(int count, bool cyclic) const {
    traceur::control::SamplingParameters p = sampling;
    double visits = 1;
    if (!cyclic && count > longest_whole) {
      p.horizon = horizon;
      p.stride = horizon / 2;
      visits = 2;
    }
    const auto affordable = [&] { return static_cast<int>(windows / (visits * count * p.rounds)); };
    // Of very long motions a missing round is missed less than samples are.
    while (visits > 1 && p.rounds > 8 && affordable() < 400) --p.rounds;
    p.samples = std::clamp(affordable(), 512, 8192);
    p.elites = p.samples / 8;
    return p;
  }

  /// Engines simulate one character after another, far slower than the bundled simulator its packs.
  Effort on_engine(bool quick) const {
    Effort e = *this;
    e.trials = 20;
    e.trial_s = 20;
    e.push_trials = quick ? 2 : 4;
    e.push_halvings = quick ? 3 : 4;
    return e;
  }

  /// Learning that goes on from a law, under full perturbation and until it is told to stop.
  static traceur::control::FeedbackLearning going_on() {
    traceur::control::FeedbackLearning p;
    p.generations = 1 << 20;
    p.patience = 1 << 20;
    p.perturbation_step = 0.5;
    p.first_perturbation = 1;
    return p;
  }

  /// Share of the perturbation that learning climbs from again when the law of a motion done once fails too often: a
  /// law that a few lucky generations hurried up to full perturbation fails under little as well.
  static constexpr double persisting_from = 0.3;

  /// What else changes then: luck weighs less in more starts, and moves no one up so soon.
  static void persist(traceur::control::FeedbackLearning& p) {
    p.starts = 48;
    p.success_to_advance = 0.8;
  }

  /// From a law which holds, in worlds that differ.
  static traceur::control::FeedbackLearning hardening() {
    traceur::control::FeedbackLearning p = going_on();
    p.population = 24;
    p.starts = 8;
    p.sigma = 0.05;
    p.first_seconds = 6;
    p.last_seconds = 12;
    p.validation_episodes = 96;
    p.worlds = 4;
    p.push = 8;
    p.slide = 4;
    return p;
  }

  /// From a law which nearly holds.
  static traceur::control::FeedbackLearning fine_tuning() {
    traceur::control::FeedbackLearning p = going_on();
    p.population = 12;
    p.starts = 2;
    p.sigma = 0.03;
    p.first_seconds = 5;
    p.last_seconds = 8;
    p.validation_episodes = 12;
    p.validate_every = 3;
    return p;
  }

  static Effort of(bool quick) {
    Effort e;
    if (!quick) {
      e.sampling.rounds = 16;
      e.learning.starts = 8;
      e.learning.generations = 1200;
      e.learning.validation_episodes = 128;
      e.looks = 256;
      e.windows = 2.2e6;
      return e;
    }
    e.one_shot_starts = 8;
    e.sampling.rounds = 8;
    // So few samples find no run that does not slide: it falls.
    e.run_slide = e.run_law_slide = 0;
    e.learning.population = 24;
    e.learning.starts = 8;
    e.learning.generations = 60;
    e.gait_generations = 160;
    e.hardening_generations = 30;
    e.learning.last_seconds = 8;
    e.learning.validation_episodes = 16;
    e.trial_s = 20;
    e.push_trials = 8;
    e.push_halvings = 5;
    return e;
  }
};

}  // namespace perform
