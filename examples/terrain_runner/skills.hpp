// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <filesystem>
#include <optional>

#include "leap.hpp"
#include "traceur/control/composition.hpp"
#include "traceur/parameterize/continuation.hpp"
#include "traceur/plan/step_planner.hpp"

namespace terrain_runner {

namespace control = traceur::control;
namespace sim = traceur::sim;

/// The laws of all that is composed have these sensors and actions, so that one pack of lanes holds any mixture.
inline constexpr control::FeedbackSets common_sets{true, false, true, true};

/// What planning and authoring need to know of a runner.
struct Measured {
  traceur::plan::StepLength<double> length;
  GaitEvents events;
};

/// What a runner can do, as far as it has been learned: a folder of files, one for each stage.
///
///     gait.json      the gait, simulated: a controller
///     running.txt    controls over turn (degrees per step) and speed: a continuation, at any point of its work
///     measured.json  what was measured of running
///     jump.txt       controls over the height of a step, as running.txt
struct Skills {
  control::Controller gait;
  std::optional<traceur::parameterize::Continuation> running, jump;
  std::optional<Measured> measured;
};

/// Reads what is there of a folder. Throws traceur::Error when the gait is missing or a file is not what it should be.
Skills read_skills(const std::filesystem::path& folder, const sim::Model& model, const control::Roles& roles);
void write_gait(const std::filesystem::path& folder, const control::Controller& gait);
void write_measured(const std::filesystem::path& folder, const Measured& m);
/// `name`: running or jump. Reading gives nothing if there is no such file, and throws traceur::Error when it is not one.
std::optional<traceur::parameterize::Continuation> read_stage(const std::filesystem::path& folder, const char* name);
void write_stage(const std::filesystem::path& folder, const char* name, const traceur::parameterize::Continuation& c);

/// Controls for running at any speed and turn, looked up from those that were learned.
class RunningModel {
public:
  /// `narrow`: the shape of the learned controls; what comes out has `wide`.
  RunningModel(const traceur::parameterize::Continuation& learned, const control::AffineShape& narrow, const control::AffineShape& wide);

  /// Turns to the right are mirror images of turns to the left, running straight ahead is symmetric.
  Eigen::VectorXd operator()(const control::RunningTask& task) const;

private:
  traceur::parameterize::Rbf rbf_;
  control::AffineShape narrow_, wide_;
};

/// The numbers that are searched for a leap: laws, offsets of all parts, beta, what is added to the leap's distance, and what
/// is added to running's law and offsets in transOut.
struct LeapNumbers {
  control::AffineShape shape, running;

  int laws() const { return shape.law.size(); }
  int offsets() const { return shape.offsets * shape.actions(); }
  int beta() const { return laws() + offsets(); }
  int distance() const { return beta() + 1; }
  int recovery() const { return distance() + 1; }
  int recoveries() const { return running.alpha(); }
  int size() const { return recovery() + recoveries(); }

  /// Those of the leap that a running control (of the wide shape) does by itself.
  Eigen::VectorXd first(const Eigen::VectorXd& control) const;
};

/// Everything that playing the skills needs, made from the gait once.
struct Body {
  const sim::Model* model = nullptr;
  control::Roles roles;
  control::Controller gait;
  control::Skill narrow, wide;  ///< the gait with the laws it was learned with, and with the common ones
  /// Over the height of the step, beginning on the right and on the left foot; without a table until `add_leap`.
  std::array<control::Skill, 2> leap;
  LeapNumbers numbers;
  double leap_distance = 0, leap_speed = 3.5, leap_end = 0;  ///< m, m/s, tick

  /// A leap onto a step of some height, by the numbers that were found for it.
  /// `side`: of the foot it begins on, 0 right, 1 left.
  control::Manoeuvre manoeuvre(const Eigen::VectorXd& found, double height, int side = 1) const;

  Body(const sim::Model& m, const control::Roles& r, const control::Controller& gait);
  /// Authors the leap, from where the gait's feet are on the ground.
  void add_leap(const GaitEvents& events);
};

}  // namespace terrain_runner
