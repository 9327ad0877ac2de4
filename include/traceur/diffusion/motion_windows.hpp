// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <traceur/body/kinematics.hpp>
#include <traceur/core/error.hpp>
#include <traceur/core/random.hpp>
#include <traceur/diffusion/denoiser.hpp>
#include <traceur/diffusion/frame_features.hpp>
#include <traceur/motion/clip.hpp>
#include <traceur/nn/module.hpp>
#include <traceur/terrain/height_grid.hpp>
#include <traceur/terrain/local_map.hpp>

namespace traceur::diffusion {

/// The windows a motion generator sees: sizes of Xu et al. 2025 (PARC, section 5.1), numbers of their released
/// configuration where the paper has none.
struct WindowParameters {
  int past = 2;     ///< frames given, at least 1; the last of them is the reference frame
  int future = 13;  ///< frames generated, at least 1
  double fps = 30;
  terrain::SquareMap map = {};  ///< heights around the root of the reference frame
  double target_first = 0.4;   ///< the moment a target direction points to, s after the reference frame: from
  double target_last = 1.5;    ///< ... to
  double target_noise = 0.05;  ///< deviation of the place it points to, m
  double target_least = 0.1;   ///< a place nearer than this, m, has no direction: zero
  double past_noise = 0.01;    ///< deviation of what is added to the past frames of a condition while training, m and rad
};

/// Cuts clips into windows, and windows into samples and conditions for a motion generator. A sample is past + future
/// frames below each other, each as FrameFeatures seen from the heading frame of the reference frame's root, scaled. A
/// condition is the heights of the map less that of the root (m), the direction to a target (unit and horizontal, or zero),
/// and the past frames as they stand in the sample.
template <class S>
class MotionWindows {
public:
  struct Scratch {
    std::vector<double> pose;
    Eigen::VectorXd contacts;
    body::Frames<double> frames;
  };

  /// Throws Error if a number is out of its range.
  explicit MotionWindows(FrameFeatures features, WindowParameters p = {})
      : features_(std::move(features)), p_(p), map_(p.map), scale_(FeatureScale<S>::none(features_.size())) {
    if (p.past < 1 || p.future < 1) throw Error("motion windows: expected at least one past and one future frame");
    if (!(p.fps > 0) || !std::isfinite(p.fps)) throw Error("motion windows: expected a positive frame rate");
    if (!(p.target_first >= 0 && p.target_last >= p.target_first)) {
      throw Error("motion windows: expected 0 <= target_first <= target_last");
    }
    if (!(p.target_noise >= 0 && p.target_least >= 0 && p.past_noise >= 0)) {
      throw Error("motion windows: expected noise and distances of zero or more");
    }
  }

  const FrameFeatures& features() const noexcept { return features_; }
  const WindowParameters& parameters() const noexcept { return p_; }
  const FeatureScale<S>& scale() const noexcept { return scale_; }
  int frames() const noexcept { return p_.past + p_.future; }
  double dt() const noexcept { return 1 / p_.fps; }
  /// Seconds from the first frame of a window to its last.
  double duration() const noexcept { return (frames() - 1) * dt(); }
  Eigen::Index sample_features() const noexcept { return frames() * features_.size(); }
  Eigen::Index condition_features() const noexcept { return past_row() + p_.past * features_.size(); }
  /// Where the parts of a condition begin; the heights at 0.
  Eigen::Index target_row() const noexcept { return map_.size(); }
  Eigen::Index past_row() const noexcept { return target_row() + 2; }

  Scratch scratch() const {
    const body::Skeleton& skeleton = features_.skeleton();
    return {std::vector<double>(static_cast<std::size_t>(skeleton.nq())), Eigen::VectorXd(skeleton.size()),
            body::Frames<double>(skeleton)};
  }

  /// Scales samples from now on. Throws Error unless it is for these features.
  void set_scale(FeatureScale<S> scale) {
    if (scale.size() != features_.size()) {
      throw Error("motion windows: expected a scale of " + std::to_string(features_.size()) + " features, got " +
                  std::to_string(scale.size()));
    }
    scale_ = std::move(scale);
  }

  /// Throws Error unless windows can be cut from the clip: the same joints, and not cyclic and shorter than a window.
  void check(const motion::Clip& clip) const {
    const std::string where = "clip '" + clip.name + "'";
    const body::Skeleton& own = features_.skeleton();
    bool same = clip.skeleton.size() == own.size();
    for (int i = 0; same && i < own.size(); ++i) {
      same = clip.skeleton[i].type == own[i].type && clip.skeleton[i].parent == own[i].parent;
    }
    if (!same) throw Error(where + ": expected the joints of the motion windows");
    if (!clip.cyclic && clip.duration() < duration()) {
      throw Error(where + ": expected at least " + std::to_string(duration()) + " s for a window, found " +
                  std::to_string(clip.duration()));
    }
  }

  /// The latest time (s) at which a window of the clip begins.
  double last_start(const motion::Clip& clip) const noexcept {
    return clip.cyclic ? clip.duration() : clip.duration() - duration();
  }

  /// The window that begins at `time` (s), as a sample, into x (sample_features() numbers). Returns its heading frame.
  terrain::HeadingFrame<double> sample(const motion::Clip& clip, double time, Scratch& w, S* x) const {
    clip.sample(time + (p_.past - 1) * dt(), w.pose.data());
    const auto frame = heading_frame(features_.skeleton(), w.pose.data());
    for (int f = 0; f < frames(); ++f) {
      const double at = time + f * dt();
      clip.sample(at, w.pose.data());
      const bool labels = clip.contacts.cols() != 0;
      if (labels) clip.sample_contacts(at, w.contacts);
      features_.encode(w.pose.data(), labels ? w.contacts.data() : nullptr, frame, w.frames, x + f * features_.size());
    }
    scale_.apply(x, frames());
    return frame;
  }

  /// Writes heights and target direction of a condition; `target` is a place in the world, m.
  void look(const terrain::HeightGrid& ground, const terrain::HeadingFrame<double>& frame,
            const core::Vector3<double>& target, S* condition) const noexcept {
    const terrain::HeadingFrame<S> own{frame.origin.template cast<S>(), static_cast<S>(frame.cosine),
                                       static_cast<S>(frame.sine)};
    map_.sample(ground, own, std::span<S>(condition, static_cast<std::size_t>(map_.size())));
    const core::Vector3<double> way = frame.to_local(target);
    const double distance = std::hypot(way.x, way.y);
    const bool near = !(distance >= p_.target_least) || distance == 0.0;
    condition[target_row()] = near ? S(0) : static_cast<S>(way.x / distance);
    condition[target_row() + 1] = near ? S(0) : static_cast<S>(way.y / distance);
  }

  /// A random window for training: begins anywhere in the clip, and is asked to go where the clip does a little later. Writes
  /// sample and condition and returns the heading frame.
  terrain::HeadingFrame<double> draw(const motion::Clip& clip, const terrain::HeightGrid& ground, core::RandomStream& random,
                                     Scratch& w, S* x, S* condition) const {
    const double time = last_start(clip) * random.uniform();
    const auto frame = sample(clip, time, w, x);
    const double ahead = random.uniform(p_.target_first, p_.target_last);
    const double when = time + (p_.past - 1) * dt() + ahead;
    clip.sample(clip.cyclic ? when : std::min(when, clip.duration()), w.pose.data());
    core::Vector3<double> target = core::Vector3<double>::from(w.pose.data());
    target.x += random.normal(0, p_.target_noise);
    target.y += random.normal(0, p_.target_noise);
    look(ground, frame, target, condition);
    S* const past = condition + past_row();
    std::copy_n(x, p_.past * features_.size(), past);
    for (int f = 0; f < p_.past; ++f) {
      for (Eigen::Index i = 0; i < features_.contact(0); ++i) {
        past[f * features_.size() + i] += static_cast<S>(random.normal(0, p_.past_noise)) / scale_.deviation[i];
      }
    }
    return frame;
  }

private:
  FrameFeatures features_;
  WindowParameters p_;
  terrain::LocalMap<S> map_;
  FeatureScale<S> scale_;
};

/// Mean and deviation of the features of windows that begin every `spacing` seconds of every clip.
template <class S>
FeatureScale<S> measure_scale(const MotionWindows<S>& windows, std::span<const motion::Clip* const> clips,
                              double spacing = 0.1) {
  if (!(spacing > 0)) throw Error("measure scale: expected a spacing above zero");
  MotionWindows<S> plain = windows;
  plain.set_scale(FeatureScale<S>::none(windows.features().size()));
  auto w = plain.scratch();
  const Eigen::Index size = windows.features().size();
  std::vector<S> all;
  for (const motion::Clip* clip : clips) {
    windows.check(*clip);
    for (double t = 0; t <= plain.last_start(*clip); t += spacing) {
      const std::size_t at = all.size();
      all.resize(at + static_cast<std::size_t>(plain.sample_features()));
      plain.sample(*clip, t, w, all.data() + at);
    }
  }
  using Frames = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;
  return FeatureScale<S>::of(Eigen::Map<const Frames>(all.data(), size, static_cast<Eigen::Index>(all.size()) / size));
}

/// Makes estimates of a denoiser windows that the body can do (FrameFeatures::project), the past frames those given: for
/// Ddim::sample. PARC's published code does so after each step.
template <class S>
class WindowProjection {
public:
  explicit WindowProjection(const MotionWindows<S>& windows) : windows_(windows), frames_(windows.features().skeleton()) {}

  /// The condition of the samples to come: where it gives `past_part`-like `parts`, its past frames are put in place of those
  /// estimated. Must outlive its use.
  void set_condition(const Condition<S>& condition, Parts parts) noexcept {
    past_ = condition.values.data() + windows_.past_row();
    stride_ = condition.values.outerStride();
    given_ = condition.given;
    parts_ = parts;
  }

  void operator()(nn::Matrix<S> clean) noexcept {
    const Eigen::Index size = windows_.features().size();
    for (Eigen::Index j = 0; j < clean.cols(); ++j) {
      S* const x = clean.data() + j * clean.outerStride();
      windows_.scale().undo(x, windows_.frames());
      for (int f = 0; f < windows_.frames(); ++f) windows_.features().project(x + f * size, frames_);
      windows_.scale().apply(x, windows_.frames());
      const bool past = past_ != nullptr && ((given_ == nullptr ? all_parts : given_[j]) & parts_) == parts_;
      if (past) std::copy_n(past_ + j * stride_, windows_.parameters().past * size, x);
    }
  }

private:
  const MotionWindows<S>& windows_;
  body::Frames<S> frames_;
  const S* past_ = nullptr;
  Eigen::Index stride_ = 0;
  const Parts* given_ = nullptr;
  Parts parts_ = 0;
};

}  // namespace traceur::diffusion
