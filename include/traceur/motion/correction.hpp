// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>
#include <cmath>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "traceur/motion/losses.hpp"
#include "traceur/nn/optimizer.hpp"

namespace traceur::motion {

/// How Adam goes down the loss (PARC E.2).
struct CorrectionOptions {
  CorrectionWeights weights;
  int iterations = 3000;
  double step = 0.001;        ///< of the first iteration, rad or m
  double final_step = 0.001;  ///< of the last; in between it falls or grows linearly
};

struct CorrectionReport {
  CorrectionLosses before, after;
  int iterations = 0;
  double seconds = 0;           ///< wall time
  std::vector<double> history;  ///< total loss at the start and after each iteration
  std::vector<double> elapsed;  ///< s, when each entry of the history was known
};

/// A corrected clip, keyed as its source.
struct Corrected {
  Clip clip;
  CorrectionReport report;
};

/// Kinematic correction as PARC does it (E.2): Adam on a change of every frame until the surface points no longer
/// penetrate the ground, bodies that are to touch it do, and no joint's jerk is above the limit, while the motion stays
/// near what it was. Every frame is free, also the first.
///
/// The loss has kinks at its minima, so Adam ends up going back and forth across them by about its step; the result is the
/// best of all iterates. Throws Error as CorrectionLoss does, for a step that is not positive, or when the loss is not
/// finite. The same bits on any executor.
template <core::Executor E>
inline Corrected correct(const Clip& clip, std::span<const body::SurfacePoint> points, const terrain::HeightGrid& ground,
                         const CorrectionOptions& options, E&& executor) {
  const std::string where = detail::where(clip) + ": correction: ";
  if (options.iterations < 0) throw Error(where + "expected no negative number of iterations");
  if (!(options.step > 0) || !(options.final_step > 0)) throw Error(where + "expected a step above zero");
  const auto started = std::chrono::steady_clock::now();
  const CorrectionLoss loss(clip, points, ground, options.weights);
  CorrectionLoss::Workspace w = loss.workspace();
  Eigen::MatrixXd d = Eigen::MatrixXd::Zero(loss.nv(), loss.keys()), gradient = d, best = d;
  const Eigen::Index n = d.size();
  nn::Adam<double> adam(n);
  Corrected out;
  CorrectionReport& report = out.report;
  for (int i = 0;; ++i) {
    const CorrectionLosses now = loss.gradient(d, gradient, w, executor);
    if (!std::isfinite(now.total)) throw Error(where + "the loss is not finite after " + std::to_string(i) + " iterations");
    report.history.push_back(now.total);
    report.elapsed.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count());
    if (i == 0) report.before = report.after = now;
    if (now.total < report.after.total) {
      report.after = now;
      best = d;
    }
    if (i == options.iterations) break;
    const double share = options.iterations > 1 ? static_cast<double>(i) / (options.iterations - 1) : 0;
    adam.step(Eigen::Map<Eigen::VectorXd>(d.data(), n), Eigen::Map<const Eigen::VectorXd>(gradient.data(), n),
              options.step + share * (options.final_step - options.step));
  }
  report.iterations = options.iterations;
  out.clip = loss.changed(best);
  report.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  return out;
}

inline Corrected correct(const Clip& clip, std::span<const body::SurfacePoint> points, const terrain::HeightGrid& ground,
                         const CorrectionOptions& options = {}) {
  return correct(clip, points, ground, options, core::SerialExecutor{});
}

}  // namespace traceur::motion
