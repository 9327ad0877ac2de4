// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <limits>
#include <string>
#include <vector>

#include "effort.hpp"
#include "engines.hpp"
#include "job_folder.hpp"
#include "preparation.hpp"
#include "sole_slide.hpp"
#include "traceur/core/executor.hpp"

namespace perform {

/// How well the targets alone, without feedback, follow the clip. Errors are means over joints, m.
struct OpenLoopResult {
  double mean_joint_error_m = 0;  ///< in the world
  double mean_local_error_m = 0;  ///< after taking the root's place off
  double worst_tick_error_m = 0;
  bool fell = false;
  double wall_s = 0, simulated_s = 0;
};

/// What became of the controller on starts that it never saw.
struct TrialResult {
  int trials = 0, survived = 0, reached_end = 0, held = 0;
  double mean_joint_error_m = 0;  ///< of those that survived, after taking the root's place off
  double mean_speed_m_s = 0;      ///< of those that survived
  double clip_speed_m_s = 0;
  double root_velocity_m_s = 0, joint_angle_rad = 0;  ///< how far starts were moved
  double simulated_s = 0;
};

/// The eight directions of pushes, counterclockwise from ahead, seen from above.
inline constexpr std::array<const char*, 8> push_directions{"forward",  "forward_left",   "left",  "backward_left",
                                                            "backward", "backward_right", "right", "forward_right"};

/// Impulse (N s) that half of the pushes of each direction are survived with.
struct PushResult {
  std::array<double, 8> tolerance_Ns{};
  double simulated_s = 0;
};

/// A motion of the simulated character tick by tick, for a replay.
struct Recording {
  struct Contact {
    traceur::core::Vector3<double> point, force;  ///< m, N, on the character
  };
  traceur::motion::Clip clip;
  std::vector<std::vector<Contact>> contacts;                 ///< of each key
  std::vector<traceur::core::Vector3<double>> push_points;    ///< of each key, m
  std::vector<traceur::core::Vector3<double>> push_impulses;  ///< of each key, N s
  Eigen::MatrixXd reference;                                  ///< poses of the controller's reference at the same keys
  SlideShares sole_slide;                                     ///< its shares are known of the bundled simulator only
};

/// Learning done, or a controller that was read.
struct Learned {
  traceur::control::Controller controller;
  int generations = 0;
  bool persisted = false;  ///< it went on because the first law failed too often
  double wall_s = 0, simulated_s = 0;
};

using Runners = std::vector<traceur::control::EpisodeRunner<Lane>>;

/// The steps of the job that simulate. Long ones tell how far they are, save what they have and throw Interrupted when
/// asked to stop.
class Performer {
public:
  Performer(const Scene& scene, const Options& options, const Effort& effort);

  /// Searches targets with which the character follows the motion, or takes them from the job's state.
  SavedSearch search(const Motion& motion);
  OpenLoopResult judge(const Motion& motion, const SavedSearch& search) const;
  /// Learns a feedback law around the targets.
  Learned learn(const Motion& motion, const SavedSearch& search);
  /// Goes on learning the law in worlds that differ, on the bundled simulator.
  Learned harden(const traceur::control::Controller& controller);
  /// Goes on learning the law for the simulator that the user chose, for at most so many seconds of wall time.
  Learned fine_tune(const traceur::control::Controller& controller, double seconds);
  /// `measured` is what errors are measured against: the controller's reference without smoothing.
  TrialResult test(const traceur::control::Controller& controller, const traceur::control::TrackingReference& measured);
  PushResult push(const traceur::control::Controller& controller);
  /// One performance; from a perturbed start and with a push of `push_Ns` from the right when the user asked for that.
  Recording record(const traceur::control::Controller& controller, double push_Ns);

private:
  /// On the simulator that the user chose. They look at the controller's constants; an engine gives up after `most_s`.
  Runners chosen_runners(const traceur::control::Controller& controller,
                         double most_s = std::numeric_limits<double>::infinity());
  /// Whether a law for a motion done once reaches the end, and stands there, as often as is wanted, on fresh starts.
  bool does_well(Runners& runners, traceur::control::Controller controller, const Eigen::VectorXd& law);
  Learned tune_for_engine(const traceur::control::Controller& controller, double seconds);
  /// With the job's seed, and starts moved as the controller's motion allows.
  traceur::control::FeedbackLearning for_job(traceur::control::FeedbackLearning settings,
                                             const traceur::control::Controller& controller) const;
  traceur::control::Perturbation perturbation(const traceur::control::Controller& controller) const;
  int windows_of(const Motion& motion) const;
  traceur::control::SamplingParameters sampling(const Motion& motion) const;
  traceur::control::EpisodeSettings settings(const traceur::control::Controller& controller,
                                             std::uint64_t stream) const;
  traceur::core::Vector3<double> push_force(const traceur::control::Controller& controller, int tick, double angle,
                                            double impulse) const;

  const Scene& scene_;
  const Options& options_;
  Effort effort_;
  JobFolder folder_;
  traceur::sim::Parameters simulation_;
  traceur::sim::Ground<float> ground_;
  traceur::control::TrackingCost cost_;
  std::vector<std::shared_ptr<Engine>> engines_;  ///< one for each worker, made when first needed
  traceur::core::ThreadExecutor executor_;
};

}  // namespace perform
