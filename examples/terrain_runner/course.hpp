// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "../common/engines.hpp"
#include "skills.hpp"
#include "traceur/control/clearing.hpp"
#include "traceur/terrain/height_grid.hpp"

namespace terrain_runner {

/// Something across the way of a runner.
struct CourseObstacle {
  Kind kind{};
  double x = 0;       ///< where it begins, m
  double height = 0;  ///< m
};

/// Obstacles across the way of a runner that starts at x = 0 and runs along +x.
struct Course {
  std::vector<CourseObstacle> obstacles;
  traceur::terrain::HeightGrid ground;

  double height(double x) const;
};

struct CourseShape {
  int obstacles = 10;
  std::vector<Kind> kinds{Kind::jump};         ///< what there is
  OfKinds<std::array<double, 2>> heights{{{0.1, 0.3}, {0.6, 0.8}, {0.9, 2.0}}};  ///< lowest and highest, m
  double nearest = 20, farthest = 35;        ///< between obstacles, and before the first, m
  double depth = 0.4;                          ///< of boxes along the way, m
};

/// The ground that obstacles make; `depth` is that of boxes, m. They are in the order of their places, multiples of 0.2 m.
Course course_of(std::vector<CourseObstacle> obstacles, double depth = 0.4);
Course random_course(const CourseShape& shape, std::uint64_t seed, std::uint64_t number);

/// What of the system is used; all of it, unless an ablation asks for less.
struct CourseSettings {
  bool planner = true;       ///< else the runner keeps its speed and begins a manoeuvre when it is near enough
  bool feedback = true;      ///< else manoeuvres are done with no law at all
  bool recovery = true;      ///< else transOut is running as usual
  control::Composer::Settings composition;
  std::uint64_t seed = 1;
};

/// What is seen of a manoeuvre.
struct Labels {
  Kind kind{};
  double height = 0;    ///< of the obstacle, m
  double hand = 0;      ///< how long a hand held on to it, s
  double flight = 0;    ///< longest time that no foot was on the ground nor a hand held on, s
  double turned = 0;    ///< of the root, forwards about the axis across the way, rad
};

/// How a runner fared.
struct CourseOutcome {
  int obstacles = 0, cleared = 0;
  bool completed = false;
  double seconds = 0, distance = 0;
  std::string failure;       ///< in words; empty if there was none
  Kind failed_at{};          ///< the obstacle at which it failed, and its height, m
  double failed_height = 0;
  int steps_since = -1;      ///< running steps begun since the last obstacle when it failed; -1: there was none
  OfKinds<int> cleared_of{}; ///< obstacles cleared, by kind
  std::vector<Labels> labels;  ///< of each manoeuvre that was done to its end
  double running = 0, flying = 0;  ///< time spent running, and of it with no foot on the ground, s
};

/// The numbers of a manoeuvre (ManoeuvreNumbers) at an obstacle of some height, m.
using ManoeuvreModel = std::function<Eigen::VectorXd(double height)>;

/// Where a runner is.
struct CourseMoment {
  double seconds = 0, distance = 0, speed = 0;  ///< since the start, s and m; of the centre of mass, m/s
  control::RunStage stage{};
  const char* skill = "";    ///< what it does
  int next = 0, obstacles = 0;  ///< the one ahead or in the making, counted from 0; of the course
};

/// Poses of one runner tick by tick.
struct CourseRecording {
  std::vector<Eigen::VectorXd> poses;
  std::vector<control::RunStage> stages;
};

/// Heights of obstacles that a kind of manoeuvre was learned for, m, increasing.
std::vector<double> learned_heights(const traceur::parameterize::Continuation& learned);

/// The manoeuvres that were learned, in between as the continuation has it, or (without `interpolation`) the nearest.
ManoeuvreModel manoeuvre_model(const traceur::parameterize::Continuation& learned, bool interpolation = true);

/// Runs characters over courses of their own, one in each lane: a step-based planner (s6) chooses the speed and turn of every
/// step and the moment to jump or vault.
class CourseRunner {
public:
  /// All must outlive it.
  CourseRunner(const Body& body, const RunningModel& running, OfKinds<ManoeuvreModel> clearing, const traceur::plan::StepLength<double>& length,
               const CourseSettings& settings);

  /// As many courses as a pack has lanes, or fewer. What lane 0 does is recorded if asked for; to `arrivals` are added the
  /// states in which manoeuvres begin, as if all began with a step on the left foot. What is not null of `engine` moves them
  /// in place of the bundled simulator: its lanes must be on these courses.
  std::vector<CourseOutcome> run(const std::vector<Course>& courses, std::uint64_t first_number, CourseRecording* recording = nullptr,
                                 std::vector<control::RunningState>* arrivals = nullptr, example::Engine* engine = nullptr);

  /// One course, a runner all alone: in less than half the time. Its last bits are not those of a pack's lane.
  CourseOutcome run_alone(const Course& course, std::uint64_t number, CourseRecording* recording = nullptr);

  /// Called with what lane 0 does, before the first tick and after every one until it has ended; empty for nothing.
  std::function<void(const CourseMoment&)> watch;

private:
  template <class Lane>
  std::vector<CourseOutcome> run_in(const std::vector<Course>& courses, std::uint64_t first_number, CourseRecording* recording,
                                    std::vector<control::RunningState>* arrivals, control::Engine<Lane>* engine);
  struct Runner;
  void decide(Runner& r, const Course& course, double x, double y, double speed_now);

  const Body& body_;
  const RunningModel& running_;
  CourseSettings settings_;
  OfKinds<ManoeuvreModel> clearing_;
  traceur::plan::StepPlanner<double> planner_;
  traceur::plan::DirectionTracker<double> direction_;
  Eigen::VectorXd exit_;
};

}  // namespace terrain_runner
