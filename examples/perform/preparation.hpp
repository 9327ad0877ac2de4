// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "effort.hpp"
#include "options.hpp"
#include "traceur/control/controller.hpp"
#include "traceur/io/load_report.hpp"
#include "traceur/motion/flight_consistency.hpp"
#include "traceur/terrain/height_grid.hpp"

namespace perform {

/// What moves, and on what.
struct Scene {
  traceur::sim::Model model;
  traceur::control::Roles roles;
  std::optional<traceur::terrain::HeightGrid> terrain;  ///< level ground at 0 without
  std::string character_text;                           ///< of the character's file
  traceur::sim::Ground<float> ground() const {
    return terrain ? traceur::sim::Ground<float>(*terrain) : traceur::sim::Ground<float>();
  }
};

/// A motion to be searched: the clip on the character, and on the ticks of control.
struct Motion {
  std::string name;            ///< of its state file
  traceur::motion::Clip clip;  ///< one cycle of a gait; not smoothed
  bool cyclic = false;
  bool flies = false;          ///< of a gait, whether the body leaves the ground in it
  traceur::control::TrackingReference reference;  ///< smoothed, what is searched and learnt for
  traceur::control::TrackingReference measured;   ///< not smoothed, what errors are measured against
  std::vector<int> window_starts;                 ///< of a gait, see SamplingParameters
  int period_ticks = 0;                           ///< of a gait, of half a period when mirrored
  bool mirrored = false;                          ///< the second half is the mirror image of the first
};

/// All that is known before anything is simulated.
struct Preparation {
  traceur::io::LoadReport loaded;
  nlohmann::ordered_json retarget;  ///< of the report
  traceur::motion::Clip clip;       ///< on the character, not smoothed
  traceur::motion::FlightConsistency flight;
  std::vector<std::string> notes;  ///< what was decided about the motion
  std::vector<Motion> motions;     ///< the first is followed open loop, the last is learnt with feedback
};

/// The character and the ground of the user's files; `Preparation` may bring ground of its own. Throws traceur::Error.
Scene load_scene(const Options& options);

/// Loads the clip, puts it on the character, decides whether it is a gait and makes the references. Prints what loading
/// and retargeting report. A clip's own terrain becomes the scene's when the user gave none. Throws traceur::Error.
Preparation prepare(const Options& options, const Effort& effort, Scene& scene);

/// A fingerprint of everything that the search is given.
std::string digest(const Scene& scene, const Preparation& preparation);

}  // namespace perform
