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

/// A kind of obstacle. The skill that clears it is the continuation `name`.txt in the folder of skills.
struct ObstacleKind {
  const char* name;
  const char* size;     ///< what its skill is learned over, in words and units
  double default_size;  ///< m
};
inline constexpr std::array obstacle_kinds{ObstacleKind{"jump", "height of the step, m", 0.2}};

/// The parts that can be left out.
inline constexpr std::array parts{"planner", "feedback", "recovery", "blending", "interpolation"};

/// What playing needs, made from learned skills, which have all stages.
struct Player {
  Body body;
  RunningModel running;

  /// The model must outlive it.
  Player(const sim::Model& model, const control::Roles& roles, const Skills& skills);
};

/// Runs one course after the other or a pack of them; `without`: one of `parts`, or empty. The player must outlive it.
CourseRunner course_runner(const Player& player, const Skills& skills, std::uint64_t seed, const std::string& without);

CourseShape course_shape(const Options& o);

/// A course of one step of height `rise` (m), `distance` (m) from the start.
Course one_step(double distance, double rise);

/// Carries out `evaluate`: many courses; with `ablations` the same courses without each part, too; with `approach` one
/// obstacle from many distances. Prints what it finds and adds it to the report. Throws example::Interrupted.
void evaluate(const Options& o, const Player& player, const Skills& skills, nlohmann::ordered_json& report);

}  // namespace terrain_runner
