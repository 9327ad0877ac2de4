// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <traceur/body/kinematics.hpp>
#include <traceur/core/error.hpp>
#include <traceur/core/random.hpp>
#include <traceur/core/vector3.hpp>
#include <traceur/diffusion/ddim.hpp>
#include <traceur/diffusion/denoiser.hpp>
#include <traceur/diffusion/motion_generator.hpp>
#include <traceur/diffusion/motion_windows.hpp>
#include <traceur/motion/clip.hpp>
#include <traceur/terrain/height_grid.hpp>

namespace traceur::diffusion {

/// Numbers of PARC's released configuration.
struct LongHorizonParameters {
  int rewind = 5;           ///< frames before the end of what there is at which the next window begins; >= its past frames
  int look_ahead = 7;       ///< nodes of the path ahead of the nearest one that the target direction points to
  double arrive = 0.5;      ///< m in the ground plan from the end of the path at which a motion has arrived
  double longest = 10;      ///< s, at most
  double stand_low = 0.7;   ///< height of the root above the ground in the first frame of a motion without past, m: from
  double stand_high = 0.9;  ///< ... to
  std::vector<int> feet = {};  ///< bodies whose mean place has to arrive; empty: the root
};

/// How a generated motion ended.
enum class LongHorizonEnd {
  arrived,     ///< at the end of the path
  too_long,    ///< `longest` seconds were not enough
  not_finite,  ///< the denoiser gave a number that is not finite; the frames before that window are kept
};

/// Long motions along a path over terrain (Xu et al. 2025, PARC, section 5.4), window after window: each is conditioned on
/// the last frames of what there is, on the ground around them and on the direction to a node of the path ahead. A batch of
/// motions of the same path is generated at once, of which the best may be chosen. Holds the memory for it.
///
///     |- frames so far ------------|
///                          |past|- future ----------|
///                          rewind
///
/// Motion b of a batch draws from the random streams of b: its bits depend neither on the other motions nor on threads.
template <class S>
class LongHorizon {
public:
  /// Keeps a reference to the windows. For up to `max_motions` at once. Throws Error if a number is out of its range.
  LongHorizon(const MotionWindows<S>& windows, const Schedule& schedule, int stride, int max_motions,
              LongHorizonParameters p = {})
      : windows_(windows),
        p_(std::move(p)),
        ddim_(schedule, stride, windows.sample_features(), std::max(max_motions, 1)),
        project_(windows),
        scratch_(windows.scratch()) {
    const int past = windows.parameters().past, frames = windows.frames();
    if (max_motions < 1) throw Error("long horizon: expected at least one motion, got " + std::to_string(max_motions));
    if (p_.rewind < past || p_.rewind >= frames) {
      throw Error("long horizon: expected a rewind of " + std::to_string(past) + " to " + std::to_string(frames - 1) +
                  " frames, got " + std::to_string(p_.rewind));
    }
    if (p_.look_ahead < 0 || !(p_.arrive > 0) || !(p_.longest > 0) || !std::isfinite(p_.longest) ||
        !(p_.stand_low <= p_.stand_high)) {
      throw Error("long horizon: expected look_ahead >= 0, positive distance and time, and stand_low <= stand_high");
    }
    const body::Skeleton& skeleton = windows.features().skeleton();
    for (const int foot : p_.feet) {
      if (foot < 0 || foot >= skeleton.size()) throw Error("long horizon: no body " + std::to_string(foot));
    }
    capacity_ = std::max(static_cast<int>(std::ceil(p_.longest * windows.parameters().fps)) + 1, 2) + frames;
    poses_.resize(skeleton.nq(), static_cast<Eigen::Index>(capacity_) * max_motions);
    contacts_.resize(skeleton.size(), poses_.cols());
    motions_.resize(static_cast<std::size_t>(max_motions));
    x_.resize(windows.sample_features(), max_motions);
    condition_.resize(windows.condition_features(), max_motions);
    given_.resize(motions_.size());
    frames_.resize(motions_.size());
    active_.reserve(motions_.size());
  }

  int max_motions() const noexcept { return static_cast<int>(motions_.size()); }

  /// Generates `motions` motions from standing at the first node of the path, or, if there are `start` poses (nq x as many as
  /// a window has past frames) and contact labels (bodies x as many), going on from those. `first` denoises windows without
  /// a past, `next` the others, usually blended (BlendedDenoiser, 0.5). A path has at least two nodes, m, world; where their
  /// heights are does not matter. Throws Error on a path or a start that does not fit.
  template <Denoiser<S> First, Denoiser<S> Next>
  void generate(First& first, Next& next, std::span<const core::Vector3<double>> path, const terrain::HeightGrid& ground,
                std::uint64_t seed, int motions, const Eigen::MatrixXd& start = {}, const Eigen::MatrixXd& contacts = {}) {
    begin(path, motions, start, contacts);
    for (std::uint64_t window = 0;; ++window) {
      active_.clear();
      for (int b = 0; b < count_; ++b) {
        if (!motions_[static_cast<std::size_t>(b)].done) active_.push_back(b);
      }
      if (active_.empty()) return;
      for (std::size_t i = 0; i < active_.size(); ++i) ask(path, ground, seed, window, i);
      const auto n = static_cast<Eigen::Index>(active_.size());
      const Condition<S> condition{condition_.leftCols(n), given_.data()};
      nn::Matrix<S> x = x_.leftCols(n);
      project_.set_condition(condition, past_part);
      // All motions are at the same window.
      if (window == 0 && start.cols() == 0) {
        ddim_.sample(first, condition, x, project_);
      } else {
        ddim_.sample(next, condition, x, project_);
      }
      for (std::size_t i = 0; i < active_.size(); ++i) take(path, i);
    }
  }

  /// Of the last batch.
  LongHorizonEnd end(int motion) const { return at(motion).end; }
  int frames(int motion) const { return at(motion).frames; }
  /// The motion as a clip with contact labels. Throws Error if it has fewer than two frames.
  motion::Clip clip(int motion, const std::string& name = "generated") const {
    const Motion& m = at(motion);
    const Eigen::Index first = static_cast<Eigen::Index>(motion) * capacity_;
    motion::Clip out;
    out.name = name;
    out.skeleton = windows_.features().skeleton();
    out.times = Eigen::VectorXd::LinSpaced(m.frames, 0, std::max(m.frames - 1, 0) * windows_.dt());
    out.poses = poses_.middleCols(first, m.frames);
    out.contacts = contacts_.middleCols(first, m.frames);
    out.check();
    return out;
  }

private:
  struct Motion {
    int frames = 0;
    std::size_t node = 0;  // of the path, the nearest one
    bool done = false;
    LongHorizonEnd end = LongHorizonEnd::too_long;
  };

  const Motion& at(int motion) const {
    assert(motion >= 0 && motion < count_);
    return motions_[static_cast<std::size_t>(motion)];
  }
  double* pose(int motion, int frame) noexcept {
    return poses_.col(static_cast<Eigen::Index>(motion) * capacity_ + frame).data();
  }
  double* labels(int motion, int frame) noexcept {
    return contacts_.col(static_cast<Eigen::Index>(motion) * capacity_ + frame).data();
  }

  void begin(std::span<const core::Vector3<double>> path, int motions, const Eigen::MatrixXd& start,
             const Eigen::MatrixXd& contacts) {
    if (motions < 1 || motions > max_motions()) {
      throw Error("long horizon: expected 1 to " + std::to_string(max_motions()) + " motions, got " + std::to_string(motions));
    }
    if (path.size() < 2) throw Error("long horizon: expected a path of at least two nodes");
    for (const auto& node : path) {
      if (!std::isfinite(node.x + node.y)) throw Error("long horizon: expected a path of finite nodes");
    }
    const int past = windows_.parameters().past;
    if (start.cols() != 0 && (start.cols() != past || start.rows() != poses_.rows() || !start.allFinite())) {
      throw Error("long horizon: expected a start of " + std::to_string(past) + " finite poses of " +
                  std::to_string(poses_.rows()) + " numbers");
    }
    if (contacts.cols() != 0 && (contacts.cols() != start.cols() || contacts.rows() != contacts_.rows())) {
      throw Error("long horizon: expected contact labels for every body and pose of the start");
    }
    count_ = motions;
    for (int b = 0; b < motions; ++b) {
      Motion& m = motions_[static_cast<std::size_t>(b)] = Motion{};
      m.frames = static_cast<int>(start.cols());
      for (int f = 0; f < m.frames; ++f) {
        std::copy_n(start.col(f).data(), start.rows(), pose(b, f));
        if (contacts.cols() != 0) {
          std::copy_n(contacts.col(f).data(), contacts.rows(), labels(b, f));
        } else {
          std::fill_n(labels(b, f), contacts_.rows(), 0.0);
        }
      }
    }
  }

  // Noise and condition of column i.
  void ask(std::span<const core::Vector3<double>> path, const terrain::HeightGrid& ground, std::uint64_t seed,
           std::uint64_t window, std::size_t i) noexcept {
    const int b = active_[i];
    const auto column = static_cast<Eigen::Index>(i);
    Motion& m = motions_[static_cast<std::size_t>(b)];
    core::RandomStream random(seed, static_cast<std::uint64_t>(b), window);
    for (Eigen::Index k = 0; k < x_.rows(); ++k) x_(k, column) = random.normal<S>();
    const int past = windows_.parameters().past;
    const FrameFeatures& features = windows_.features();
    S* const condition = condition_.col(column).data();
    auto& frame = frames_[i];
    if (m.frames == 0) {
      const double height = ground.height(path[0].x, path[0].y) + random.uniform(p_.stand_low, p_.stand_high);
      frame = terrain::HeadingFrame<double>::at({path[0].x, path[0].y, height},
                                                std::atan2(path[1].y - path[0].y, path[1].x - path[0].x));
      std::fill_n(condition + windows_.past_row(), past * features.size(), S(0));
      given_[i] = all_parts & ~past_part;
    } else {
      m.frames = std::max(m.frames - (p_.rewind - past), past);
      frame = heading_frame(features.skeleton(), pose(b, m.frames - 1));
      for (int f = 0; f < past; ++f) {
        features.encode(pose(b, m.frames - past + f), labels(b, m.frames - past + f), frame, scratch_.frames,
                        condition + windows_.past_row() + f * features.size());
      }
      windows_.scale().apply(condition + windows_.past_row(), past);
      given_[i] = all_parts;
    }
    // The nearest node never goes back: a path that crosses itself is walked in its order.
    const auto away = [&](std::size_t node) { return std::hypot(path[node].x - frame.origin.x, path[node].y - frame.origin.y); };
    const std::size_t furthest = std::min(path.size() - 1, m.node + static_cast<std::size_t>(std::max(p_.look_ahead, 1)));
    std::size_t nearest = m.node;
    for (std::size_t node = m.node; node <= furthest; ++node) {
      if (away(node) < away(nearest)) nearest = node;
    }
    m.node = nearest;
    windows_.look(ground, frame, path[std::min(path.size() - 1, nearest + static_cast<std::size_t>(p_.look_ahead))], condition);
  }

  // Appends the window of column i to its motion.
  void take(std::span<const core::Vector3<double>> path, std::size_t i) noexcept {
    const int b = active_[i];
    const auto column = static_cast<Eigen::Index>(i);
    Motion& m = motions_[static_cast<std::size_t>(b)];
    if (!x_.col(column).allFinite()) {
      m.done = true;
      m.end = LongHorizonEnd::not_finite;
      return;
    }
    const FrameFeatures& features = windows_.features();
    S* const x = x_.col(column).data();
    windows_.scale().undo(x, windows_.frames());
    const int limit = static_cast<int>(std::floor(p_.longest * windows_.parameters().fps)) + 1;
    for (int f = m.frames == 0 ? 0 : windows_.parameters().past; f < windows_.frames(); ++f) {
      features.decode(x + f * features.size(), frames_[i], pose(b, m.frames), labels(b, m.frames));
      ++m.frames;
      if (arrived(path.back(), pose(b, m.frames - 1)) && m.frames >= 2) {
        m.done = true;
        m.end = LongHorizonEnd::arrived;
        return;
      }
      if (m.frames >= limit) {
        m.done = true;
        m.end = LongHorizonEnd::too_long;
        return;
      }
    }
  }

  bool arrived(const core::Vector3<double>& goal, const double* q) noexcept {
    body::forward_kinematics(windows_.features().skeleton(), q, scratch_.frames);
    double x = q[0], y = q[1];
    if (!p_.feet.empty()) {
      x = y = 0;
      for (const int foot : p_.feet) {
        x += scratch_.frames.position[static_cast<std::size_t>(foot)].x / static_cast<double>(p_.feet.size());
        y += scratch_.frames.position[static_cast<std::size_t>(foot)].y / static_cast<double>(p_.feet.size());
      }
    }
    return std::hypot(goal.x - x, goal.y - y) < p_.arrive;
  }

  const MotionWindows<S>& windows_;
  LongHorizonParameters p_;
  Ddim<S> ddim_;
  WindowProjection<S> project_;
  typename MotionWindows<S>::Scratch scratch_;
  int capacity_ = 0;  // frames of a motion
  int count_ = 0;     // motions of the batch
  Eigen::MatrixXd poses_, contacts_;
  std::vector<Motion> motions_;
  std::vector<int> active_;
  Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> x_, condition_;
  std::vector<Parts> given_;
  std::vector<terrain::HeadingFrame<double>> frames_;
};

}  // namespace traceur::diffusion
