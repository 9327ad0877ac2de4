// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json.hpp>

#include "options.hpp"
#include "skills.hpp"

namespace terrain_runner {

/// Explores running's range twice from one gait and the control of its first node (those of `skills`), once as
/// predictor_corrector and once as axis_by_axis, with the same searches and about the same number of runs, and writes
/// compare.html: coverage over runs, and where each got to. What it saves after every round is gone on with. Adds what
/// it found to `report`. Throws traceur::Error that names the file, and example::Interrupted.
void compare(const Options& o, const sim::Model& model, const control::Roles& roles, const Skills& skills,
             nlohmann::ordered_json& report);

}  // namespace terrain_runner
