// SPDX-License-Identifier: MIT
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "../common/lane.hpp"
#include "authored.hpp"
#include "course.hpp"
#include "traceur/control/running_search.hpp"
#include "traceur/core/executor.hpp"

namespace terrain_runner {

using example::Lane;

/// How much is spent on one way to clear obstacles.
struct ManoeuvreEffort {
  std::vector<double> heights;           ///< nodes, m
  std::vector<double> round_heights;     ///< m; 1, 2, 4 or 8 of them
  std::vector<double> family_heights;    ///< where it is sampled, m, increasing;
  int sampling_rounds = 14;              ///< for how long,
  int plans = 8;                         ///< and how often at most,
  double most_error = 0.2;               ///< m: joints of a plan farther than that from what was meant are elsewhere
  double good_plan = 0.98;               ///< unless from this share of starts one is kept to
  double refined_below = 0;              ///< and if none is from this share, the best one's targets are refined
  double refined_longer_below = 0;       ///< share below which a motion of the whole family is refined once more, for longer
  double first_height = 0.2;             ///< m: where the law is first said to do
  int rounds = 0;                        ///< of states from courses, law and transOut
  double share = 0.9;                    ///< of trials that must clear it and run on
};

/// How much is spent on each stage.
struct Effort {
  control::RunningSearch gait, running;  ///< searches for the gait and for each node of the running range
  std::int64_t running_evaluations = 90000;  ///< runs after which the range is left as it is
  double hardest_push = 0;               ///< of the first node of the range, as RunningSettings has them
  control::RunningTask hardest_wander;
  std::vector<double> turns, speeds;     ///< nodes: degrees per step, 0 and more; m/s
  /// Disturbances under which nodes are tried that failed under harder ones, and after how many runs, with those before, that ends.
  struct Wider {
    double push;
    control::RunningTask wander;
    std::int64_t evaluations;
  };
  std::vector<Wider> wider;
  OfKinds<ManoeuvreEffort> kinds;
  control::PracticeSettings practice;    ///< of regulators
  control::RefinementSettings refinement;  ///< of their targets
  control::ClearingSettings clearing;    ///< trials of manoeuvres, from states of courses
  int clearing_population = 32, clearing_trials = 64;
  double clearing_good_cost = 0.8;       ///< with which a search ends early if all its trials clear the obstacle
  double clearing_sigma = 0.4;           ///< first standard deviation, in units of the search's scales
  int round_generations = 150, recovery_generations = 60, round_starts = 8, arrival_courses = 64;
  int choice_courses = 64;               ///< of ten obstacles, that choose among what the rounds lead to
  int max_attempts = 2;

  static Effort of(bool quick, std::uint64_t seed);
};

/// How well one node of the running range is done, on starts that learning never saw.
struct NodeResult {
  control::RunningTask task;
  traceur::parameterize::NodeStatus status{};
  control::RunningJudgement judgement;
};

/// How well obstacles of some height are cleared, likewise.
struct ClearingResult {
  double height = 0;
  int trials = 0, survived = 0, cleared = 0;
  double exit_speed = 0;
};

/// Learns the skills one stage after the other. Each takes up what its file holds; after every round of work it saves.
class Trainer {
public:
  using Progress = std::function<void(const char* stage, const std::string& what)>;

  Trainer(const sim::Model& model, const control::Roles& roles, const Effort& effort, std::filesystem::path folder, int threads,
          Progress progress);

  /// Makes the law good for Eq. 8 and resets the reference to the simulated motion.
  control::Controller make_gait(const control::Controller& from);
  /// Spreads the gait over speeds and turns. `on_range` is told after each round.
  traceur::parameterize::Continuation learn_running(const control::Controller& gait, std::optional<traceur::parameterize::Continuation> from);
  /// Goes on with nodes that are to be tried again, under the lesser disturbances of a step.
  traceur::parameterize::Continuation widen_running(const control::Controller& gait, traceur::parameterize::Continuation from, int step);
  /// Simulates a manoeuvre as it was authored, over obstacles of several heights, by sampling control, and makes a regulator
  /// for each by practice; goes on with what there is already.
  MotionFamily sample_family(Kind kind, const RunningModel& running, const Body& body, const Measured& measured, std::optional<MotionFamily> from);
  /// Learns a manoeuvre, improves it and what follows it from states in which manoeuvres on courses begin, and spreads it
  /// over heights.
  traceur::parameterize::Continuation learn_clearing(Kind kind, const RunningModel& running, const Body& body,
                                                     const traceur::plan::StepLength<double>& length,
                                                     std::optional<traceur::parameterize::Continuation> from);

  std::function<void(const traceur::parameterize::Continuation&)> on_range;

  /// At nodes with turns of at most `most_turn` degrees per step, to either side.
  std::vector<NodeResult> test_running(const control::Controller& gait, const traceur::parameterize::Continuation& c, int trials,
                                       double most_turn = 90, bool disturbed = false);
  std::vector<ClearingResult> test_clearing(Kind kind, const RunningModel& running, const Body& body, const ManoeuvreModel& manoeuvre,
                                            const traceur::plan::StepLength<double>& length, const std::vector<double>& heights,
                                            int trials);
  /// Step length against speed over the nodes that were done.
  traceur::plan::StepLength<double> step_length(const std::vector<NodeResult>& nodes) const;

  /// Where the feet are on the ground.
  GaitEvents watch(const control::Controller& gait, const traceur::parameterize::Continuation& running);
  /// States in which manoeuvres begin on courses of their obstacles that are numbered from `first` on.
  std::vector<control::RunningState> arrivals(Kind kind, const RunningModel& running, const Body& body, const ManoeuvreModel& manoeuvre,
                                              const traceur::plan::StepLength<double>& length, std::uint64_t first);

private:
  /// Goes on with the nodes of a range, and saves it after each round of them.
  traceur::parameterize::Continuation spread_running(const control::Controller& gait, const Body& body, traceur::parameterize::Continuation c,
                                                     const control::RunningSearch& p, std::int64_t evaluations, const std::string& file);
  /// How runners fared on courses, and the states in which their manoeuvres began.
  struct OnCourses {
    int cleared = 0;
    std::vector<control::RunningState> arrivals;
  };
  OnCourses run_courses(Kind kind, const RunningModel& running, const Body& body, const ManoeuvreModel& manoeuvre,
                        const traceur::plan::StepLength<double>& length, int obstacles, int count, std::uint64_t first);
  /// States in which manoeuvres begin on courses, for a family's regulators to practise from.
  RegulatedStarts regulated_starts(Kind kind, const RunningModel& running, const Body& body, const MotionFamily& first,
                                   const traceur::plan::StepLength<double>& length);
  /// Running as it is on courses, on average: the gait with its reference reset to that.
  control::Controller steady_running(const Body& body, const Eigen::VectorXd& control, double speed);
  struct Search;
  class Trials;
  /// The same with the share of trials that did what was asked for.
  struct Found : traceur::parameterize::ContinuationResult {
    double share = 0;
  };
  Found search(Trials& trials, const Search& s);

  const sim::Model& model_;
  control::Roles roles_;
  Effort effort_;
  std::filesystem::path folder_;
  traceur::core::ThreadExecutor executor_;
  Progress progress_;
  sim::Ground<float> flat_;
};

}  // namespace terrain_runner
