// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "skills.hpp"
#include "traceur/control/clearing.hpp"
#include "traceur/terrain/height_grid.hpp"

namespace terrain_runner {

/// Steps up across the way of a runner that starts at x = 0 and runs along +x.
struct Course {
  std::vector<double> edges;  ///< m
  std::vector<double> rises;  ///< m
  traceur::terrain::HeightGrid ground;

  double height(double x) const;
};

struct CourseShape {
  int obstacles = 10;
  double lowest = 0.1, highest = 0.3;        ///< rises, m
  double nearest = 15, farthest = 30;        ///< between edges, and before the first, m
};

Course random_course(const CourseShape& shape, std::uint64_t seed, std::uint64_t number);

/// What of the system is used; all of it, unless an ablation asks for less.
struct CourseSettings {
  bool planner = true;       ///< else the runner keeps its speed and leaps when it is near enough
  bool feedback = true;      ///< else leaps are done with no law at all
  bool recovery = true;      ///< else transOut is running as usual
  control::Composer::Settings composition;
  std::uint64_t seed = 1;
};

/// How a runner fared.
struct CourseOutcome {
  int obstacles = 0, cleared = 0;
  bool completed = false;
  double seconds = 0, distance = 0;
  std::string failure;       ///< in words; empty if there was none
  double failed_rise = 0;    ///< of the step at which it failed, m
  int steps_since_leap = -1; ///< running steps begun since the last leap when it failed; -1: there was none
};

/// The numbers of a leap (LeapNumbers) onto a step of some height, m.
using LeapModel = std::function<Eigen::VectorXd(double height)>;

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

/// The leaps that were learned, in between as the continuation has it, or (without `interpolation`) the nearest.
LeapModel leap_model(const traceur::parameterize::Continuation& jump, bool interpolation = true);

/// Runs characters over courses of their own, one in each lane: a step-based planner (s6) chooses the speed and turn of every
/// step and the moment to leap.
class CourseRunner {
public:
  /// All must outlive it.
  CourseRunner(const Body& body, const RunningModel& running, LeapModel jump, const traceur::plan::StepLength<double>& length,
               const CourseSettings& settings);

  /// As many courses as a pack has lanes, or fewer. What lane 0 does is recorded if asked for; to `arrivals` are added the
  /// states in which leaps begin, as if all began with a step on the left foot.
  std::vector<CourseOutcome> run(const std::vector<Course>& courses, std::uint64_t first_number, CourseRecording* recording = nullptr,
                                 std::vector<control::RunningState>* arrivals = nullptr);

  /// One course, a runner all alone: in less than half the time. Its last bits are not those of a pack's lane.
  CourseOutcome run_alone(const Course& course, std::uint64_t number, CourseRecording* recording = nullptr);

  /// Called with what lane 0 does, before the first tick and after every one until it has ended; empty for nothing.
  std::function<void(const CourseMoment&)> watch;

private:
  template <class Lane>
  std::vector<CourseOutcome> run_in(const std::vector<Course>& courses, std::uint64_t first_number, CourseRecording* recording,
                                    std::vector<control::RunningState>* arrivals);
  struct Runner;
  void decide(Runner& r, const Course& course, double x, double y, double speed_now);

  const Body& body_;
  const RunningModel& running_;
  CourseSettings settings_;
  LeapModel jump_;
  traceur::plan::StepPlanner<double> planner_;
  traceur::plan::DirectionTracker<double> direction_;
  Eigen::VectorXd exit_;
};

}  // namespace terrain_runner
