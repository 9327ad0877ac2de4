// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "traceur/learn/joint_weights.hpp"
#include "traceur/learn/tracking_error.hpp"

namespace traceur::learn {

/// Constants of the tracking reward of Peng et al., "DeepMimic", ACM TOG 37(4), 2018, as its released code has them; the
/// paper's formula has no root term and compares the centre of mass's place. Every exponent is a scale times a squared error.
struct DeepMimicRewardParameters {
  double pose_weight = 0.5;
  double velocity_weight = 0.05;
  double end_effector_weight = 0.15;
  double root_weight = 0.2;
  double center_weight = 0.1;

  double pose_scale = 2.0 / 15;       ///< times the number of joints, 1/rad^2
  double velocity_scale = 0.1 / 15;   ///< times the number of joints, s^2/rad^2
  double end_effector_scale = 10;     ///< on the mean over end effectors, 1/m^2
  double root_scale = 5;              ///< 1/m^2
  double center_scale = 10;           ///< on 0.1 of the squared velocity

  double root_rotation = 0.1;             ///< share in the root's error, m^2/rad^2
  double root_velocity = 0.01;            ///< s^2
  double root_angular_velocity = 0.001;   ///< m^2 s^2/rad^2
  double center_velocity = 0.1;           ///< s^2/m^2
};

/// DeepMimic's tracking reward: in (0, 1], 1 when tracking is perfect.
class DeepMimicReward {
 public:

  /// `weight`: one number a joint, the root's included, divided by their sum here. `end_effectors`: bodies, usually hands
  /// and feet. Throws Error on a wrong number of weights, weights that are negative or all zero, or a body that is not there.
  DeepMimicReward(const body::Skeleton& skeleton, std::vector<double> weight, std::vector<int> end_effectors,
                  const DeepMimicRewardParameters& parameters = {})
      : parameters_(parameters), skeleton_(skeleton), weight_(std::move(weight)), end_effectors_(std::move(end_effectors)) {
    if (weight_.size() != static_cast<std::size_t>(skeleton.size()))
      throw Error("deepmimic reward: expected " + std::to_string(skeleton.size()) + " joint weights, got " +
                  std::to_string(weight_.size()));
    double sum = 0;
    for (const double w : weight_) {
      if (!(w >= 0)) throw Error("deepmimic reward: expected joint weights of zero or more");
      sum += w;
    }
    if (!(sum > 0)) throw Error("deepmimic reward: expected a joint weight above zero");
    for (double& w : weight_) w /= sum;
    if (end_effectors_.empty()) throw Error("deepmimic reward: expected at least one end effector");
    for (const int b : end_effectors_)
      if (b < 0 || b >= skeleton.size())
        throw Error("deepmimic reward: end effector " + std::to_string(b) + " is not a body of the skeleton");
  }

  const DeepMimicRewardParameters& parameters() const { return parameters_; }

  /// The reward. The grounds are heights of the ground under the two roots, m: end effectors are compared by their height
  /// above it.
  template <class S>
  S operator()(const TrackingState<S>& state, const TrackingState<S>& reference, const std::type_identity_t<S>& ground = S(0.0),
               const std::type_identity_t<S>& reference_ground = S(0.0)) const {
    const DeepMimicRewardParameters& p = parameters_;
    S sum(0.0);
    const auto add = [&](double weight, const S& error) {
      using std::exp;
      sum += S(weight) * exp(-error);
    };
    const double joints = static_cast<double>(skeleton_.size());
    const RootError<S> root(state, reference);
    const S turned = S(weight_[0]) * root.rotation + joint_error(skeleton_, state, reference, weight_);
    const S spun = S(weight_[0]) * root.angular_velocity + joint_velocity_error(skeleton_, state, reference, weight_);
    add(p.pose_weight, S(p.pose_scale * joints) * turned);
    add(p.velocity_weight, S(p.velocity_scale * joints) * spun);
    add(p.end_effector_weight, S(p.end_effector_scale) * end_effector_error(state, reference, ground, reference_ground));
    add(p.root_weight, S(p.root_scale) * (root.position + S(p.root_rotation) * root.rotation +
                                          S(p.root_velocity) * root.velocity +
                                          S(p.root_angular_velocity) * root.angular_velocity));
    add(p.center_weight, S(p.center_scale * p.center_velocity) *
                             squared_norm(state.center_velocity - reference.center_velocity));
    return sum;
  }

 private:
  // Each place seen from its own root in its own heading, its height from the ground.
  template <class S>
  S end_effector_error(const TrackingState<S>& state, const TrackingState<S>& reference, const S& ground,
                       const S& reference_ground) const {
    const core::Quaternion<S> mine = core::heading(state.frames.rotation[0]).conjugate();
    const core::Quaternion<S> theirs = core::heading(reference.frames.rotation[0]).conjugate();
    S sum(0.0);
    for (const int b : end_effectors_) {
      const auto k = static_cast<std::size_t>(b);
      core::Vector3<S> a = mine.rotate(state.frames.position[k] - state.frames.position[0]);
      core::Vector3<S> r = theirs.rotate(reference.frames.position[k] - reference.frames.position[0]);
      a.z = state.frames.position[k].z - ground;
      r.z = reference.frames.position[k].z - reference_ground;
      sum += squared_norm(a - r);
    }
    return S(1.0 / static_cast<double>(end_effectors_.size())) * sum;
  }

  DeepMimicRewardParameters parameters_;
  body::Skeleton skeleton_;
  std::vector<double> weight_;
  std::vector<int> end_effectors_;
};

}  // namespace traceur::learn
