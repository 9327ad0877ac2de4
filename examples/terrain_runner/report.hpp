// SPDX-License-Identifier: MIT
#pragma once

#include <string>

#include <nlohmann/json.hpp>

#include "options.hpp"
#include "skills.hpp"

namespace terrain_runner {

/// Writes report.html into the folder of results: what is explored of running's range (Figure 3 of the paper), step
/// length against speed from runs made for it (Figure 6), what is explored of each obstacle's range, and of how many
/// trials it was cleared, where the folder of skills holds train's report. Adds what it measured to `report`. Throws
/// traceur::Error that names the file, and example::Interrupted.
void write_skill_report(const Options& o, const sim::Model& model, const control::Roles& roles, const Skills& skills,
                        nlohmann::ordered_json& report);

/// The nodes of running's range as a chart, an SVG element. Throws traceur::Error when it is no range of turn
/// and speed.
std::string running_range(const std::string& title, const traceur::parameterize::Continuation& c);

}  // namespace terrain_runner
