// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <traceur/body/kinematics.hpp>
#include <traceur/body/surface_points.hpp>
#include <traceur/core/error.hpp>
#include <traceur/core/rotation.hpp>
#include <traceur/diffusion/frame_features.hpp>
#include <traceur/nn/module.hpp>
#include <traceur/terrain/height_grid.hpp>
#include <traceur/terrain/local_map.hpp>
#include <traceur/terrain/signed_distance.hpp>

namespace traceur::diffusion {

/// Weights of the terms of MotionLoss: those of PARC's released configuration.
struct MotionLossWeights {
  double root_position = 1;          ///< of Eq. 10, per m^2
  double root_rotation = 1;          ///< per rad^2
  double joint_rotation = 0.5;       ///< per rad^2
  double joint_position = 0.5;       ///< per m^2
  double contacts = 1;
  double root_velocity = 0.5;        ///< of Eq. 11, per (m/s)^2
  double joint_velocity = 0.03;      ///< per (m/s)^2
  double root_turning = 0.02;        ///< per (rad/s)^2
  double joint_turning = 0.01;       ///< per (rad/s)^2
  double consistency = 1;            ///< of Eq. 12, per m^2
  double penetration = 15;           ///< of Eq. 7, per m

  /// Penetration alone: for samples on terrain they were not recorded on, which have nothing to be reconstructed (section
  /// 5.3: one step in ten).
  static MotionLossWeights penetration_only() {
    MotionLossWeights w{};
    w.root_position = w.root_rotation = w.joint_rotation = w.joint_position = w.contacts = 0;
    w.root_velocity = w.joint_velocity = w.root_turning = w.joint_turning = w.consistency = 0;
    return w;
  }
};

/// The terms, in order.
enum class MotionLossTerm { reconstruction, velocity, consistency, penetration };

/// The loss of a motion generator (Xu et al. 2025, PARC, eq. 4) on windows of frames, with its gradient: with hats for what
/// is estimated,
///
///     L = |p - p^|^2 + |q (-) q^|^2 + |c - c^|^2           reconstruction, eq. 10: (-) is the angle between two rotations
///       + |dp/dt - dp^/dt|^2 + |w - w^|^2                   velocity, eq. 11, by differences of neighbouring frames
///       + |p^ - FK(q^)|^2                                   consistency, eq. 12
///       + sum over surface points of max(-sd, 0)            penetration, eq. 7, of the body that FK(q^) places
///
/// each with its weight, summed over joints and points, and averaged over frames (velocities: over pairs of them). Samples
/// are frames below each other, scaled by `FeatureScale`; the loss is that of the features themselves. Angular velocities are
/// those of the body's own frame, log(q_t^-1 q_t+1) / dt.
///
/// A DenoisingLoss.
template <class S>
class MotionLoss {
public:
  struct Workspace {
    std::vector<S> x, y, dx;  // features of a window: clean, estimated, and the gradient
    body::Frames<S> frames;
    std::vector<core::Vector3<S>> force, torque;  // gradient by the place of a body, and by turning it about its joint
    std::array<double, 4> terms{};                ///< weighted sums of the last call's terms, by MotionLossTerm
  };

  /// For windows of `frames` frames `dt` seconds apart. `points` are those of the penetration. Throws Error if a number is
  /// out of its range or the scale is not one of these features.
  MotionLoss(const FrameFeatures& features, FeatureScale<S> scale, int frames, double dt, MotionLossWeights weights = {},
             std::vector<body::SurfacePoint> points = {})
      : features_(features),
        scale_(std::move(scale)),
        frames_(frames),
        dt_(static_cast<S>(dt)),
        weights_(weights),
        points_(std::move(points)) {
    if (frames < 2) throw Error("motion loss: expected at least two frames, got " + std::to_string(frames));
    if (!(dt > 0) || !std::isfinite(dt)) throw Error("motion loss: expected a time step above zero");
    if (scale_.size() != features.size()) {
      throw Error("motion loss: expected a scale of " + std::to_string(features.size()) + " features, got " +
                  std::to_string(scale_.size()));
    }
    for (const body::SurfacePoint& p : points_) {
      if (p.body < 0 || p.body >= features.skeleton().size()) {
        throw Error("motion loss: point of body " + std::to_string(p.body) + ": no such body");
      }
    }
  }

  int frames() const noexcept { return frames_; }
  const MotionLossWeights& weights() const noexcept { return weights_; }
  void set_weights(const MotionLossWeights& weights) noexcept { weights_ = weights; }

  /// The ground under each sample of the next steps' batches, and the heading frame its features are seen from; none for no
  /// penetration. Both must outlive their use.
  void set_terrain(std::span<const terrain::HeightGrid* const> grids,
                   std::span<const terrain::HeadingFrame<S>> frames) noexcept {
    assert(grids.size() == frames.size());
    grids_ = grids;
    heading_ = frames;
  }

  Workspace workspace() const {
    const auto n = static_cast<std::size_t>(frames_ * features_.size());
    const auto bodies = static_cast<std::size_t>(features_.skeleton().size());
    return {std::vector<S>(n),
            std::vector<S>(n),
            std::vector<S>(n),
            body::Frames<S>(features_.skeleton()),
            std::vector<core::Vector3<S>>(bodies),
            std::vector<core::Vector3<S>>(bodies),
            {}};
  }

  double operator()(nn::ConstMatrix<S> clean, nn::ConstMatrix<S> estimate, Eigen::Index first, Workspace& w,
                    nn::Matrix<S> gradient) const noexcept {
    const Eigen::Index size = features_.size(), n = frames_ * size;
    assert(clean.rows() == n && estimate.rows() == n && estimate.cols() == clean.cols());
    w.terms = {};
    double total = 0;
    for (Eigen::Index j = 0; j < clean.cols(); ++j) {
      std::copy_n(clean.data() + j * clean.outerStride(), n, w.x.begin());
      std::copy_n(estimate.data() + j * estimate.outerStride(), n, w.y.begin());
      std::fill(w.dx.begin(), w.dx.end(), S(0));
      scale_.undo(w.x.data(), frames_);
      scale_.undo(w.y.data(), frames_);
      const std::array<double, 4> terms{reconstruction(w), velocity(w), S(0), S(0)};
      for (std::size_t t = 0; t < 2; ++t) w.terms[t] += terms[t];
      total += terms[0] + terms[1] + geometry(w, first + j);
      for (Eigen::Index i = 0; i < n; ++i) {
        gradient(i, j) = w.dx[static_cast<std::size_t>(i)] * scale_.deviation[i % size];
      }
    }
    return total;
  }

private:
  using V = core::Vector3<S>;
  using Q = core::Quaternion<S>;

  static double square(const V& v) noexcept { return static_cast<double>(squared_norm(v)); }
  static void add(S* to, const V& v) noexcept {
    to[0] += v.x;
    to[1] += v.y;
    to[2] += v.z;
  }

  // Factors a, b of the derivative of exp_map, J = 1 - a [v] + b [v]^2 (right; left with +a): exp(v + dv) = exp(v) exp(J dv).
  struct Derivative {
    S a, b;
    explicit Derivative(const V& v) noexcept {
      const S t2 = squared_norm(v);
      if (t2 < S(1e-4)) {
        a = S(0.5) - t2 / S(24);
        b = S(1) / S(6) - t2 / S(120);
      } else {
        const S t = std::sqrt(t2);
        a = (S(1) - std::cos(t)) / t2;
        b = (t - std::sin(t)) / (t2 * t);
      }
    }
  };
  // J^T g of the right Jacobian at v: the gradient by v, from the gradient by a turn of the rotated body's own frame.
  static V by_parameter(const V& v, const V& g) noexcept {
    const Derivative d(v);
    const V vg = cross(v, g);
    return g + d.a * vg + d.b * cross(v, vg);
  }
  // (J_r^-1)^T g at v = log of a rotation: the gradient by a turn of the body's own frame, from the gradient by v.
  static V by_turn(const V& v, const V& g) noexcept {
    const S t2 = squared_norm(v);
    S c = S(1) / S(12) + t2 / S(720);
    if (t2 >= S(1e-2)) {
      const S t = std::sqrt(t2);
      c = (S(1) - S(0.5) * t / std::tan(S(0.5) * t)) / t2;
    }
    const V vg = cross(v, g);
    return g - S(0.5) * vg + c * cross(v, vg);
  }

  double reconstruction(Workspace& w) const noexcept {
    const S share = S(1) / static_cast<S>(frames_);
    double sum = 0;
    for (int f = 0; f < frames_; ++f) {
      const auto at = static_cast<std::size_t>(f * features_.size());
      const S *x = w.x.data() + at, *y = w.y.data() + at;
      S* const d = w.dx.data() + at;
      for (int i = 0; i <= features_.joints(); ++i) {
        const bool root = i == 0;
        const S position = share * static_cast<S>(root ? weights_.root_position : weights_.joint_position);
        const S rotation = share * static_cast<S>(root ? weights_.root_rotation : weights_.joint_rotation);
        const S contact = share * static_cast<S>(weights_.contacts);
        const Eigen::Index p = features_.position(i), r = features_.rotation(i), c = features_.contact(i);
        const V away = V::from(y + p) - V::from(x + p);
        add(d + p, S(2) * position * away);
        const V v = V::from(y + r);
        const V angle = core::log_map(core::exp_map(V::from(x + r)).conjugate() * core::exp_map(v));
        // Along the angle itself the inverse of its Jacobian changes nothing.
        add(d + r, by_parameter(v, S(2) * rotation * angle));
        const S label = y[c] - x[c];
        d[c] += S(2) * contact * label;
        sum += static_cast<double>(position) * square(away) + static_cast<double>(rotation) * square(angle) +
               static_cast<double>(contact * label * label);
      }
    }
    return sum;
  }

  double velocity(Workspace& w) const noexcept {
    const S share = S(1) / static_cast<S>(frames_ - 1), rate = S(1) / dt_;
    const Eigen::Index size = features_.size();
    double sum = 0;
    for (int f = 0; f + 1 < frames_; ++f) {
      const auto at = static_cast<std::size_t>(f * size);
      const S *x = w.x.data() + at, *y = w.y.data() + at, *x1 = x + size, *y1 = y + size;
      S* const d = w.dx.data() + at;
      S* const d1 = d + size;
      for (int i = 0; i <= features_.joints(); ++i) {
        const bool root = i == 0;
        const S linear = share * static_cast<S>(root ? weights_.root_velocity : weights_.joint_velocity);
        const S turning = share * static_cast<S>(root ? weights_.root_turning : weights_.joint_turning);
        const Eigen::Index p = features_.position(i), r = features_.rotation(i);
        const V error = rate * (V::from(y1 + p) - V::from(y + p) - V::from(x1 + p) + V::from(x + p));
        const V push = S(2) * linear * rate * error;
        add(d1 + p, push);
        add(d + p, -push);
        sum += static_cast<double>(linear) * square(error);
        if (turning == S(0)) continue;
        const V v = V::from(y + r), v1 = V::from(y1 + r);
        const V truth = core::log_map(core::exp_map(V::from(x + r)).conjugate() * core::exp_map(V::from(x1 + r)));
        const V turn = core::log_map(core::exp_map(v).conjugate() * core::exp_map(v1));
        const V wrong = rate * (turn - truth);
        const V g = S(2) * turning * rate * wrong;
        add(d1 + r, by_parameter(v1, by_turn(turn, g)));
        // Turning the earlier frame is turning the later one backwards, seen from the other end.
        add(d + r, -by_parameter(v, by_turn(-turn, g)));
        sum += static_cast<double>(turning) * square(wrong);
      }
    }
    return sum;
  }

  // Consistency and penetration, which both go through forward kinematics.
  double geometry(Workspace& w, Eigen::Index sample) const noexcept {
    const S share = S(1) / static_cast<S>(frames_);
    const S agree = share * static_cast<S>(weights_.consistency), deep = share * static_cast<S>(weights_.penetration);
    const bool ground = !grids_.empty() && !points_.empty() && deep != S(0);
    if (agree == S(0) && !ground) return 0;
    const int bodies = features_.skeleton().size();
    double consistency = 0, penetration = 0;
    for (int f = 0; f < frames_; ++f) {
      const auto at = static_cast<std::size_t>(f * features_.size());
      const S* const y = w.y.data() + at;
      S* const d = w.dx.data() + at;
      features_.kinematics(y, w.frames);
      for (int i = 0; i < bodies; ++i) {
        const auto k = static_cast<std::size_t>(i);
        w.force[k] = w.torque[k] = V::zero();
        if (i == 0) continue;
        const V away = V::from(y + features_.position(i)) - w.frames.position[k];
        const V push = S(2) * agree * away;
        add(d + features_.position(i), push);
        w.force[k] = -push;
        consistency += static_cast<double>(agree) * square(away);
      }
      if (ground) {
        const auto s = static_cast<std::size_t>(sample);
        for (const body::SurfacePoint& point : points_) {
          const auto k = static_cast<std::size_t>(point.body);
          const V arm = w.frames.rotation[k].rotate(point.local.template cast<S>());
          const auto surface = terrain::surface(*grids_[s], heading_[s].to_world(w.frames.position[k] + arm));
          if (!(surface.distance < S(0))) continue;
          penetration -= static_cast<double>(deep * surface.distance);
          const V push = -deep * heading_[s].direction_to_local(surface.normal);
          w.force[k] += push;
          w.torque[k] += cross(arm, push);
        }
      }
      through_kinematics(w, y, d);
    }
    w.terms[static_cast<std::size_t>(MotionLossTerm::consistency)] += consistency;
    w.terms[static_cast<std::size_t>(MotionLossTerm::penetration)] += penetration;
    return consistency + penetration;
  }

  // From leaves to root: forces and torques of a body act on its parent too.
  void through_kinematics(Workspace& w, const S* y, S* d) const noexcept {
    const body::Skeleton& skeleton = features_.skeleton();
    for (int i = skeleton.size() - 1; i > 0; --i) {
      const body::Joint& joint = skeleton[i];
      const auto k = static_cast<std::size_t>(i), p = static_cast<std::size_t>(joint.parent);
      const V own = w.frames.rotation[k].conjugate().rotate(w.torque[k]);
      const Eigen::Index r = features_.rotation(i);
      if (joint.type == body::JointType::ball) add(d + r, by_parameter(V::from(y + r), own));
      if (joint.type == body::JointType::hinge) {
        const V axis = joint.axis.template cast<S>();
        add(d + r, dot(axis, own) * axis);
      }
      w.force[p] += w.force[k];
      w.torque[p] += w.torque[k] + cross(w.frames.position[k] - w.frames.position[p], w.force[k]);
    }
    add(d, w.force[0]);
    add(d + 3, by_parameter(V::from(y + 3), w.frames.rotation[0].conjugate().rotate(w.torque[0])));
  }

  const FrameFeatures& features_;
  FeatureScale<S> scale_;
  int frames_;
  S dt_;
  MotionLossWeights weights_;
  std::vector<body::SurfacePoint> points_;
  std::span<const terrain::HeightGrid* const> grids_;
  std::span<const terrain::HeadingFrame<S>> heading_;
};

}  // namespace traceur::diffusion
