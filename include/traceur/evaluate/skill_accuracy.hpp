// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "traceur/core/error.hpp"
#include "traceur/core/vector3.hpp"
#include "traceur/evaluate/confidence.hpp"
#include "traceur/evaluate/coverage.hpp"
#include "traceur/evaluate/dtw.hpp"

namespace traceur::evaluate {

/// By what HIL divides a distance of dynamic time warping to report a tracking error (C.3).
inline constexpr double tracking_error_unit = 1000;

/// Frames [begin, end) of a motion.
struct Segment {
  int begin = 0, end = 0;
  int frames() const { return end - begin; }
};

/// The part of a long run in which an obstacle was dealt with (HIL C.3): from the frame whose root is nearest to where
/// the reference's is in its first frame to the one nearest to its last, both included. The end is looked for from the
/// beginning on, so a segment has at least one frame; of frames equally near the first counts. `root` is 3 x frames,
/// world, m. Throws Error if it is not or has no frame.
template <std::floating_point T>
inline Segment segment(const Sequence<T>& root, const core::Vector3<T>& first, const core::Vector3<T>& last) {
  if (root.rows() != 3 || root.cols() == 0) throw Error("segment: expected three rows and at least one frame");
  const auto nearest = [&](const core::Vector3<T>& place, Eigen::Index from) {
    Eigen::Index best = from;
    T least = std::numeric_limits<T>::infinity();
    for (Eigen::Index t = from; t < root.cols(); ++t) {
      const T d = (root.col(t) - place.eigen()).squaredNorm();
      if (d < least) {
        least = d;
        best = t;
      }
    }
    return best;
  };
  const Eigen::Index begin = nearest(first, 0);
  return {static_cast<int>(begin), static_cast<int>(nearest(last, begin)) + 1};
}

/// A reference motion as skills are told apart by it.
template <std::floating_point T = double>
struct SkillClip {
  std::string name;
  int skill = 0;                                              ///< clips may show the same skill
  Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic> features;  ///< features x frames, those of the discriminator in HIL
};

/// What a piece of motion looks like.
struct Verdict {
  int clip = 0;               ///< the most similar reference
  int skill = 0;              ///< its skill
  bool correct = false;       ///< whether that is the skill of the reference expected
  double tracking_error = 0;  ///< distance from the expected reference over 1000
};

/// Tells which of a set of reference motions a piece of motion is most similar to, by dynamic time warping (HIL s7.2,
/// C.3).
///
/// References are tried in the order of lower bounds (`kim_bound`, `keogh_bound`); those whose bound is above the best
/// distance are not compared at all, and a comparison ends once it is sure to lose.
template <std::floating_point T = double>
class SkillJudge {
public:
  /// Throws Error that names the clip at fault if there are none, one has no frames, other features than the first, a
  /// negative skill or a number that is not finite. The band is that of `Dtw`; HIL uses none.
  explicit SkillJudge(std::vector<SkillClip<T>> clips, int band = no_band) : clips_(std::move(clips)), band_(band) {
    if (clips_.empty()) throw Error("skill judge: expected at least one reference");
    for (const SkillClip<T>& c : clips_) {
      const std::string where = "skill judge: reference '" + c.name + "'";
      if (c.features.cols() == 0) throw Error(where + " has no frames");
      if (c.features.rows() != clips_.front().features.rows())
        throw Error(where + ": expected " + std::to_string(clips_.front().features.rows()) + " features, found " +
                    std::to_string(c.features.rows()));
      if (c.skill < 0) throw Error(where + ": expected a skill of zero or more");
      if (!c.features.allFinite()) throw Error(where + " has a number that is not finite");
      envelopes_.emplace_back(c.features, band);
      skills_ = std::max(skills_, c.skill + 1);
    }
  }

  const std::vector<SkillClip<T>>& clips() const { return clips_; }
  /// One more than the largest number of a skill.
  int skills() const { return skills_; }

  /// Of references equally near the first counts. Where no reference can be compared (a band too narrow, a number that
  /// is not finite) the verdict is wrong and its error infinite. `warping` is scratch memory. Throws Error if there is
  /// no such expected reference, or the motion has no frames or other features.
  Verdict judge(const Sequence<T>& motion, int expected, Dtw<T>& warping) const {
    if (expected < 0 || expected >= static_cast<int>(clips_.size()))
      throw Error("skill judge: expected a reference below " + std::to_string(clips_.size()) + ", found " +
                  std::to_string(expected));
    const T target = warping.distance(motion, features(expected), band_);
    Verdict out;
    if (!std::isfinite(target)) {
      out.tracking_error = std::numeric_limits<double>::infinity();
    } else {
      out.tracking_error = static_cast<double>(target) / tracking_error_unit;
    }
    T best = std::isfinite(target) ? target : std::numeric_limits<T>::infinity();
    int nearest = std::isfinite(target) ? expected : -1;
    std::vector<std::pair<T, int>> order;
    for (int k = 0; k < static_cast<int>(clips_.size()); ++k)
      if (k != expected)
        order.push_back(
            {std::max(kim_bound<T>(motion, features(k)), keogh_bound(motion, envelopes_[static_cast<std::size_t>(k)])),
             k});
    std::sort(order.begin(), order.end());
    // Bounds and distances are rounded differently.
    const T slack = 1 - std::sqrt(std::numeric_limits<T>::epsilon());
    for (const auto& [bound, k] : order) {
      if (bound * slack > best) break;
      const T d = warping.distance(motion, features(k), band_, best);
      if (d < best || (d == best && std::isfinite(d) && k < nearest)) {
        best = d;
        nearest = k;
      }
    }
    if (nearest < 0) {
      out.clip = out.skill = -1;
      return out;
    }
    out.clip = nearest;
    out.skill = clips_[static_cast<std::size_t>(nearest)].skill;
    out.correct = out.skill == clips_[static_cast<std::size_t>(expected)].skill;
    return out;
  }

private:
  const Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>& features(int k) const {
    return clips_[static_cast<std::size_t>(k)].features;
  }

  std::vector<SkillClip<T>> clips_;
  std::vector<Envelope<T>> envelopes_;
  int band_;
  int skills_ = 0;
};

/// Verdicts over many obstacles, as HIL's Table 1 and Figure 6 report them.
class SkillTally {
public:
  explicit SkillTally(int skills) : performed_(skills) {}

  void add(const Verdict& v) {
    ++judged_;
    correct_ += v.correct ? 1 : 0;
    if (v.skill >= 0) performed_.add(v.skill);
    if (std::isfinite(v.tracking_error)) errors_.push_back(v.tracking_error);
  }

  int judged() const { return judged_; }
  /// Verdicts that have no finite tracking error and are left out of its mean.
  int without_error() const { return judged_ - static_cast<int>(errors_.size()); }
  /// Share of correct verdicts with Wilson's interval. Throws Error without verdicts.
  Interval accuracy(double level = 0.95) const { return wilson_interval(correct_, judged_, level); }
  /// Mean tracking error with its bootstrap interval. Throws Error without one.
  Interval tracking_error(const Bootstrap& p = {}) const { return mean_interval(errors_, p); }
  /// How often each skill was seen.
  const CoverageHistogram& performed() const { return performed_; }

private:
  CoverageHistogram performed_;
  std::vector<double> errors_;
  int judged_ = 0, correct_ = 0;
};

}  // namespace traceur::evaluate
