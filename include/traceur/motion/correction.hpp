// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "traceur/motion/losses.hpp"
#include "traceur/nn/optimizer.hpp"

namespace traceur::motion {

/// How Adam goes down the loss. The defaults are PARC's (E.2).
struct CorrectionOptions {
  CorrectionWeights weights;
  int iterations = 3000;
  double step = 0.001;        ///< of the first iteration, rad or m
  double final_step = 0.001;  ///< of the last; in between it falls or grows linearly
  bool geometric = false;     ///< the step changes by the same factor in every iteration instead
  nn::AdamParameters adam;
  /// s; empty: Adam's unknowns are the change itself. Else the change is a sum of one part for each scale and one more,
  /// each smoothed over its scale in time (TimeScales), and Adam works on what they are before they are smoothed.
  std::vector<double> time_scales;
  KinkRounding rounding, final_rounding;  ///< of the first and last iteration, geometric in between where both are positive

  /// Settings that end near the minimum of the loss, where the paper's are far above it: changes over several time
  /// scales, kinks that begin as wide as to be parabolas and end narrow, a step that falls, and a short memory for squares
  /// of gradients, which the jerk's would else fill for long. Made for a weight of jerk near the paper's.
  static CorrectionOptions multiscale(int iterations = 3000) {
    CorrectionOptions out;
    out.iterations = iterations;
    out.step = 0.002;
    out.final_step = 1e-6;
    out.geometric = true;
    out.adam.beta2 = 0.95;
    out.time_scales = {1.0 / 3, 2.0 / 3, 4.0 / 3};
    out.rounding = {0.1, 1e9, 1};
    out.final_rounding = {1e-4, 300, 1};
    return out;
  }
};

namespace detail {

/// Changes of a motion as sums of smooth ones. With D the third difference over time the part for scale T is
///
///     d = (1 + lambda D^T D)^-1 y,   lambda = (T / (2 pi dt))^6,
///
/// which keeps half of an oscillation of period T, nearly all of slower ones and all of parabolas. One unknown of a coarse
/// part moves many frames alike and hardly changes their jerks; one of d itself changes eight jerks by 1 to 3 / dt^3 for
/// each metre. The first part is y itself, so any change can be had. The matrix is banded and symmetric: a solve is linear
/// in the number of keys, and spreads gradients back as well.
class TimeScales {
public:
  /// `scales` and `dt` in s.
  TimeScales(int keys, double dt, const std::vector<double>& scales) : keys_(keys) {
    constexpr double d[4] = {-1, 3, -3, 1};
    for (const double scale : scales) {
      const double lambda = std::pow(scale / (2 * std::numbers::pi * dt), 6);
      // Rows of the lower triangle's band, the diagonal last; then L D L^T in place, with 1 / D on the diagonal.
      Eigen::Matrix<double, 4, Eigen::Dynamic> band = Eigen::Matrix<double, 4, Eigen::Dynamic>::Zero(4, keys);
      band.row(3).setOnes();
      for (int k = 0; k + 3 < keys; ++k)
        for (int a = 0; a < 4; ++a)
          for (int b = 0; b <= a; ++b) band(3 + b - a, k + a) += lambda * d[a] * d[b];
      for (int k = 0; k < keys; ++k) {
        for (int b = std::max(0, k - 3); b < k; ++b) {
          double& at = band(3 + b - k, k);
          for (int c = std::max(0, k - 3); c < b; ++c) at -= band(3 + c - k, k) * band(3 + c - b, b);
        }
        for (int b = std::max(0, k - 3); b < k; ++b) {
          double& at = band(3 + b - k, k);
          const double l = at * band(3, b);
          band(3, k) -= l * at;
          at = l;
        }
        band(3, k) = 1 / band(3, k);
      }
      bands_.push_back(std::move(band));
    }
  }

  /// How many columns of unknowns there are.
  Eigen::Index columns() const noexcept { return static_cast<Eigen::Index>(bands_.size() + 1) * keys_; }

  /// The change d (n x keys) of the unknowns y (n x columns()). `part` is scratch of the size of d.
  void spread(const Eigen::MatrixXd& y, Eigen::MatrixXd& d, Eigen::MatrixXd& part) const noexcept {
    d = y.leftCols(keys_);
    for (std::size_t i = 0; i < bands_.size(); ++i) {
      part = y.middleCols(static_cast<Eigen::Index>(i + 1) * keys_, keys_);
      solve(bands_[i], part);
      d += part;
    }
  }
  /// The gradient with respect to y of a function whose gradient with respect to d is `g`.
  void gather(const Eigen::MatrixXd& g, Eigen::MatrixXd& gy, Eigen::MatrixXd& part) const noexcept {
    gy.leftCols(keys_) = g;
    for (std::size_t i = 0; i < bands_.size(); ++i) {
      part = g;
      solve(bands_[i], part);
      gy.middleCols(static_cast<Eigen::Index>(i + 1) * keys_, keys_) = part;
    }
  }

private:
  void solve(const Eigen::Matrix<double, 4, Eigen::Dynamic>& band, Eigen::MatrixXd& x) const noexcept {
    for (int k = 0; k < keys_; ++k)
      for (int b = std::max(0, k - 3); b < k; ++b) x.col(k) -= band(3 + b - k, k) * x.col(b);
    for (int k = 0; k < keys_; ++k) x.col(k) *= band(3, k);
    for (int k = keys_ - 1; k >= 0; --k)
      for (int b = std::max(0, k - 3); b < k; ++b) x.col(b) -= band(3 + b - k, k) * x.col(k);
  }

  int keys_;
  std::vector<Eigen::Matrix<double, 4, Eigen::Dynamic>> bands_;  ///< of each scale
};

/// From a to b as share goes from 0 to 1, by equal factors if both are positive.
inline double between(double a, double b, double share) noexcept {
  return a > 0 && b > 0 ? a * std::pow(b / a, share) : a + share * (b - a);
}

}  // namespace detail

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
/// best of all iterates. The report tells of the loss as it is, kinks and all. Throws Error as CorrectionLoss does, for a
/// step or time scale that is not positive, for negative rounding, a margin not below the jerk's limit, or when the loss is
/// not finite. The same bits on any executor.
template <core::Executor E>
inline Corrected correct(const Clip& clip, std::span<const body::SurfacePoint> points, const terrain::HeightGrid& ground,
                         const CorrectionOptions& options, E&& executor) {
  const std::string where = detail::where(clip) + ": correction: ";
  if (options.iterations < 0) throw Error(where + "expected no negative number of iterations");
  if (!(options.step > 0) || !(options.final_step > 0)) throw Error(where + "expected a step above zero");
  for (const double scale : options.time_scales)
    if (!(scale > 0)) throw Error(where + "expected time scales above zero");
  for (const KinkRounding& r : {options.rounding, options.final_rounding})
    if (!(r.distance >= 0) || !(r.jerk >= 0) || !(r.jerk_margin >= 0 && r.jerk_margin < options.weights.jerk_limit))
      throw Error(where + "expected no negative rounding, and a margin below the jerk's limit");
  const auto started = std::chrono::steady_clock::now();
  const CorrectionLoss loss(clip, points, ground, options.weights);
  CorrectionLoss::Workspace w = loss.workspace();
  const detail::TimeScales scales(loss.keys(), loss.dt(), options.time_scales);
  Eigen::MatrixXd d = Eigen::MatrixXd::Zero(loss.nv(), loss.keys()), gradient = d, best = d, part = d;
  Eigen::MatrixXd y = Eigen::MatrixXd::Zero(loss.nv(), scales.columns()), y_gradient = y;
  const Eigen::Index n = y.size();
  nn::Adam<double> adam(n, options.adam);
  Corrected out;
  CorrectionReport& report = out.report;
  for (int i = 0;; ++i) {
    const double share = options.iterations > 1 ? static_cast<double>(i) / (options.iterations - 1) : 0;
    const KinkRounding &from = options.rounding, &to = options.final_rounding;
    const CorrectionLosses now =
        loss.gradient(d, gradient, w, executor,
                      {detail::between(from.distance, to.distance, share), detail::between(from.jerk, to.jerk, share),
                       detail::between(from.jerk_margin, to.jerk_margin, share)});
    if (!std::isfinite(now.total)) throw Error(where + "the loss is not finite after " + std::to_string(i) + " iterations");
    report.history.push_back(now.total);
    report.elapsed.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count());
    if (i == 0) report.before = report.after = now;
    if (now.total < report.after.total) {
      report.after = now;
      best = d;
    }
    if (i == options.iterations) break;
    scales.gather(gradient, y_gradient, part);
    adam.step(Eigen::Map<Eigen::VectorXd>(y.data(), n), Eigen::Map<const Eigen::VectorXd>(y_gradient.data(), n),
              options.geometric ? detail::between(options.step, options.final_step, share)
                                : options.step + share * (options.final_step - options.step));
    scales.spread(y, d, part);
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
