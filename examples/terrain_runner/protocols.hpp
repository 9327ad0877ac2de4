// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <functional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "course.hpp"
#include "options.hpp"

namespace terrain_runner {

/// What sizes of each kind of obstacle are, in words and units, and the default, m.
struct ObstacleSize {
  const char* size;
  double default_size;
};
inline constexpr OfKinds<ObstacleSize> obstacle_sizes{{{"height of the step, m", 0.2}, {"height of the box, m", 0.7}, {"height of the cliff, m", 1.5}}};

/// The parts that can be left out.
inline constexpr std::array parts{"planner", "feedback", "recovery", "blending", "interpolation"};

/// What playing needs, made from learned skills, which have all stages.
struct Player {
  Body body;
  RunningModel running;

  /// Of the kinds of obstacles that are asked for. The model must outlive it.
  Player(const sim::Model& model, const control::Roles& roles, const Skills& skills, const std::vector<Kind>& asked);
};

/// The simulator that was asked for, on courses.
class OnSimulator {
public:
  /// The model must outlive it. Throws traceur::Error where this build has no such simulator.
  OnSimulator(const Options& o, const sim::Model& model, const sim::Parameters& parameters);
  /// An engine with each lane on a course of its own; null for the bundled simulator, which needs none.
  std::shared_ptr<example::Engine> operator()(const std::vector<Course>& courses) const;

private:
  std::string name_, character_;
  const sim::Model* model_;
  sim::Parameters parameters_;
};

/// Runs one course after the other or a pack of them; `without`: one of `parts`, or empty. The player must outlive it.
CourseRunner course_runner(const Player& player, const Skills& skills, std::uint64_t seed, const std::string& without);

/// The kinds of obstacles that were asked for, or else all that the skills are for. Throws traceur::Error where one is missing.
std::vector<Kind> obstacle_kinds(const Options& o, const Skills& skills);
CourseShape course_shape(const Options& o, const Skills& skills);

/// Carries out `evaluate`: many courses; with `ablations` the same courses without each part, too; with `approach` one
/// obstacle of each kind from many distances; with `running` no obstacles, speeds and turns. Prints what it finds and adds it to the report. Throws example::Interrupted.
void evaluate(const Options& o, const Player& player, const Skills& skills, nlohmann::ordered_json& report);

}  // namespace terrain_runner
