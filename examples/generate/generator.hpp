// SPDX-License-Identifier: MIT
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "options.hpp"
#include "traceur/body/character.hpp"
#include "traceur/motion/clip.hpp"
#include "traceur/terrain/height_grid.hpp"

namespace generate {

/// A clip on the character, and the ground it was recorded on.
struct Material {
  traceur::motion::Clip clip;
  traceur::terrain::HeightGrid ground;
};

/// Who moves, and what it learns from: each clip, followed by its mirror image.
struct Scene {
  traceur::body::Character character;
  std::vector<Material> material;
};

/// Loads the character, puts the clips on it, and adds their mirror images; prints what loading and retargeting report.
/// Throws traceur::Error.
Scene load_scene(const Options& options);

/// One look at training.
struct Milestone {
  double step = 0;
  double loss = 0;  ///< mean since the last look, of steps with reconstruction
};

struct Training {
  std::vector<Milestone> milestones;
  int steps = 0;
  double wall_s = 0;  ///< of this run
  long parameters = 0;
};

/// Trains until the steps are done, the minutes over, or interruption is asked for. A checkpoint stands in the folder after
/// every fifty steps, and the averaged network in generator.safetensors at the end. Throws example::Interrupted, and
/// traceur::Error when the loss is not finite.
Training train(const Scene& scene, const Options& options);

/// A ground and a path over it, from one edge to another.
struct Course {
  traceur::terrain::HeightGrid ground = traceur::terrain::HeightGrid::flat();
  std::vector<traceur::core::Vector3<double>> path;
};

/// Draws grounds until one has a path. Throws traceur::Error when none of a hundred has.
Course make_course(const Options& options);

/// What can be said of one motion on a ground.
struct Quality {
  double seconds = 0;
  double penetration_m = 0;       ///< PARC Eq. 7, mean over frames
  double contact_m = 0;           ///< PARC Eq. 8, mean over frames
  double high_jerk_share = 0;     ///< of frames, above 11666 m/s^3
  double foot_slide_m_s = 0;      ///< mean horizontal speed of feet that are labelled as touching
  double end_distance_m = 0;      ///< root from the end of the path, horizontally; 0 where there is no path
};

/// Motions along the course by the generator of a file, the best of them, and what became of it.
struct Generated {
  int motions = 0, arrived = 0, not_finite = 0;
  traceur::motion::Clip best, corrected;
  Quality best_quality, corrected_quality;
  double generation_wall_s = 0, correction_wall_s = 0;
  int correction_iterations = 0;
  int cut_frames = 0;  ///< at which it hesitated
};
Generated generate_along(const Scene& scene, const Options& options, const Course& course, const std::filesystem::path& file);

/// Of the material itself, over all clips that are not mirror images.
Quality quality_of(const Scene& scene);

/// Windows of half a second that the generator makes from their two past frames, target and ground, beside those of the
/// clips which these were taken from.
struct WindowsQuality {
  int count = 100;
  Quality generated, clips;
  double generated_fk_gap_m = 0;  ///< between joints where features have them and where forward kinematics does, mean
  double clips_fk_gap_m = 0;
};
WindowsQuality quality_of_windows(const Scene& scene, const Options& options, const std::filesystem::path& file);

}  // namespace generate
