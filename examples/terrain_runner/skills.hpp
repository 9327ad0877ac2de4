// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "kinds.hpp"
#include "gait_clock.hpp"
#include "motion_family.hpp"
#include "traceur/control/clearing.hpp"
#include "traceur/control/regulator_practice.hpp"
#include "traceur/core/executor.hpp"
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
///     gait.json           the gait, simulated: a controller
///     running.txt         controls over turn (degrees per step) and speed: a continuation, at any point of its work
///     wider_1.txt         the same, of nodes that were reached under lesser disturbances as well; likewise wider_2.txt, under lesser ones yet
///     measured.json       what was measured of running
///     jump.safetensors    the jump as it was simulated without feedback: a family of motions; likewise of the vault and the drop
///     jump.txt            controls over the height of a step, as running.txt; likewise vault.txt and drop.txt
struct Skills {
  control::Controller gait;
  std::optional<traceur::parameterize::Continuation> running;
  std::vector<traceur::parameterize::Continuation> wider;
  std::optional<Measured> measured;
  OfKinds<std::optional<traceur::parameterize::Continuation>> clearing;
  OfKinds<std::optional<MotionFamily>> family;
};

/// Reads what is there of a folder. Throws traceur::Error when the gait is missing or a file is not what it should be.
Skills read_skills(const std::filesystem::path& folder, const sim::Model& model, const control::Roles& roles);
void write_gait(const std::filesystem::path& folder, const control::Controller& gait);
void write_measured(const std::filesystem::path& folder, const Measured& m);
/// Of step 0 and so on.
std::string wider_name(int step);
/// `name`: running, a wider one or that of a kind. Reading gives nothing if there is no such file, and throws traceur::Error when it is not one.
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

/// The numbers that are searched for a manoeuvre: laws, offsets of all parts, beta, what is added to its distance, and what
/// is added to running's law and offsets in transOut.
struct ManoeuvreNumbers {
  control::AffineShape shape, running;

  int laws() const { return shape.law.size(); }
  int offsets() const { return shape.offsets * shape.actions(); }
  int beta() const { return laws() + offsets(); }
  int distance() const { return beta() + 1; }
  int recovery() const { return distance() + 1; }
  int recoveries() const { return running.alpha(); }
  int size() const { return recovery() + recoveries(); }

  /// Those of a manoeuvre that a running control (of the wide shape) does by itself.
  Eigen::VectorXd first(const Eigen::VectorXd& control) const;
};

/// One way to clear obstacles, ready to be played once it has motions.
struct ObstacleSkill {
  Kind kind{};
  /// Over the obstacle's height, beginning on the right and on the left foot.
  std::array<control::Skill, 2> skill;
  ManoeuvreNumbers numbers;
  double distance = 0;   ///< from the centre of mass to the obstacle when it begins, m
  double speed = 3.5;    ///< when it begins, m/s
  double speed_out = 3.5;  ///< of running after it, m/s
  double end = 0;        ///< tick
  double hold_from = 0, hold_to = 0;  ///< ticks
  double depth = 0;      ///< m
  double slide = 0;      ///< m, how far from its place it may be done
  std::shared_ptr<const control::TrackingRegulator> regulator;  ///< of a sampled motion

  bool known() const { return end > 0; }
  /// The manoeuvre at an obstacle of some height, by the numbers that were found for it. `side`: of the foot it begins on,
  /// 0 right, 1 left.
  control::Manoeuvre manoeuvre(const Eigen::VectorXd& found, double height, int side = 1) const;
  /// What such an obstacle is in the way.
  control::Hurdle hurdle(double height) const;
};

/// How far from its place a manoeuvre may be done, m.
double slide_of(Kind kind);
/// What an obstacle of a kind is in the way; `depth` is that of boxes, m.
control::Hurdle hurdle_of(Kind kind, double height, double depth);
/// Ground with an obstacle at x = 0.
sim::Ground<float> ground_of(const control::Hurdle& hurdle);

/// Keeps runners on a family's motions.
control::TrackingRegulator make_regulator(const sim::Model& model, const control::Roles& roles, const control::Controller& gait, const MotionFamily& family);

/// Starts from which a regulator practises: states in which manoeuvres begin, or, where there are none yet, that in which the
/// motion does, perturbed by up to so much.
struct RegulatedStarts {
  std::vector<control::RunningState> states;
  double distance = 0;        ///< from the centre of mass to the obstacle where the states should be, m
  double place = 0.1;         ///< m, along the run
  double slide = 0;           ///< m, how far the motion may be done from its place
  double velocity = 0.2;      ///< m/s, along each axis
  double joint_angle = 0.06;  ///< rad
};

/// What a regulator is made for: the k-th motion of a family, an obstacle, and starts. All must outlive it.
struct Regulated {
  const sim::Model* model = nullptr;
  control::Roles roles;
  const control::Controller* gait = nullptr;
  control::Hurdle hurdle;
  const MotionFamily* family = nullptr;
  std::size_t k = 0;
  const RegulatedStarts* starts = nullptr;
};

/// A regulator, by practice.
control::PractisedRegulator practise(const Regulated& of, const control::PracticeSettings& settings, traceur::core::ThreadExecutor& executor);

/// Targets with which such a regulator keeps more starts to the motion.
control::RefinedTargets refine(const Regulated& of, const std::vector<control::Gain>& gains, const control::PracticeSettings& settings,
                               const control::RefinementSettings& refinement, traceur::core::ThreadExecutor& executor);

/// Everything that playing the skills needs, made from the gait once.
struct Body {
  const sim::Model* model = nullptr;
  control::Roles roles;
  control::Controller gait;
  control::Skill narrow, wide;  ///< the gait with the laws it was learned with, and with the common ones
  OfKinds<ObstacleSkill> skills;

  Body(const sim::Model& m, const control::Roles& r, const control::Controller& gait);
  const ObstacleSkill& skill(Kind kind) const { return skills[index_of(kind)]; }
  void add_family(Kind kind, const MotionFamily& family);

private:
  void add(Kind kind, const std::array<std::vector<control::Controller>, 2>& motions, const std::vector<double>& heights,
           const std::vector<int>& parts, int laws, int offsets);
};

}  // namespace terrain_runner
