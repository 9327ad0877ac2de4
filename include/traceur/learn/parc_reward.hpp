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

/// Constants of the tracking reward of Xu et al., "PARC", SIGGRAPH 2025, appendix F.1, Eq. 16-22. The paper's equations mix
/// hats and dots; a hat is read as the reference, pose before velocity.
struct ParcRewardParameters {
  double pose_weight = 0.5;
  double joint_velocity_weight = 0.1;
  double root_weight = 0.15;
  double root_velocity_weight = 0.1;
  double key_weight = 0.15;
  double contact_weight = 1;  ///< the released code has 5 a body instead of 1 on the mean

  double pose_scale = 0.25;            ///< 1/rad^2
  double joint_velocity_scale = 0.01;  ///< s^2/rad^2
  double root_scale = 5;               ///< 1/m^2
  double root_rotation = 0.1;          ///< share of the squared angle, m^2/rad^2
  double root_velocity_scale = 1;      ///< s^2/m^2
  double root_angular_velocity = 0.1;  ///< share of the squared angular velocity, m^2/rad^2
  double key_scale = 10;               ///< 1/m^2

  bool key_relative_to_root = false;  ///< the released code compares key bodies as seen from the roots, the paper in the world
};

/// PARC's tracking reward. The five exponentials are in (0, 1] and their weights sum to 1; contacts add from
/// -contact_weight to +contact_weight. Perfect tracking without contacts gives 1.
class ParcReward {
 public:
  /// `weight`: one number a joint, not divided by their sum (the root's is not used). `keys`: bodies, in the paper hands and
  /// feet. Throws Error on a wrong number of weights, a negative weight, or a body that is not there.
  ParcReward(const body::Skeleton& skeleton, std::vector<double> weight, std::vector<int> keys,
             const ParcRewardParameters& parameters = {})
      : parameters_(parameters), skeleton_(skeleton), weight_(std::move(weight)), keys_(std::move(keys)) {
    if (weight_.size() != static_cast<std::size_t>(skeleton.size()))
      throw Error("parc reward: expected " + std::to_string(skeleton.size()) + " joint weights, got " +
                  std::to_string(weight_.size()));
    for (const double w : weight_)
      if (!(w >= 0)) throw Error("parc reward: expected joint weights of zero or more");
    for (const int b : keys_)
      if (b < 0 || b >= skeleton.size())
        throw Error("parc reward: key body " + std::to_string(b) + " is not a body of the skeleton");
  }

  const ParcRewardParameters& parameters() const { return parameters_; }

  /// The whole reward, Eq. 22. Contact labels are in [0, 1], one a body; without any the contact term is 0.
  template <class S>
  S operator()(const TrackingState<S>& state, const TrackingState<S>& reference,
               std::type_identity_t<std::span<const S>> contacts = {},
               std::type_identity_t<std::span<const S>> reference_contacts = {}) const {
    const ParcRewardParameters& p = parameters_;
    return S(p.pose_weight) * pose(state, reference) + S(p.joint_velocity_weight) * joint_velocity(state, reference) +
           S(p.root_weight) * root(state, reference) + S(p.root_velocity_weight) * root_velocity(state, reference) +
           S(p.key_weight) * key(state, reference) + S(p.contact_weight) * contact<S>(contacts, reference_contacts);
  }

  /// Eq. 16.
  template <class S>
  S pose(const TrackingState<S>& state, const TrackingState<S>& reference) const {
    using std::exp;
    return exp(S(-parameters_.pose_scale) * joint_error(skeleton_, state, reference, weight_));
  }

  /// Eq. 17.
  template <class S>
  S joint_velocity(const TrackingState<S>& state, const TrackingState<S>& reference) const {
    using std::exp;
    return exp(S(-parameters_.joint_velocity_scale) * joint_velocity_error(skeleton_, state, reference, weight_));
  }

  /// Eq. 18.
  template <class S>
  S root(const TrackingState<S>& state, const TrackingState<S>& reference) const {
    using std::exp;
    const RootError<S> error(state, reference);
    return exp(S(-parameters_.root_scale) * (error.position + S(parameters_.root_rotation) * error.rotation));
  }

  /// Eq. 19.
  template <class S>
  S root_velocity(const TrackingState<S>& state, const TrackingState<S>& reference) const {
    using std::exp;
    const RootError<S> error(state, reference);
    return exp(S(-parameters_.root_velocity_scale) *
               (error.velocity + S(parameters_.root_angular_velocity) * error.angular_velocity));
  }

  /// Eq. 20.
  template <class S>
  S key(const TrackingState<S>& state, const TrackingState<S>& reference) const {
    using std::exp;
    const S error = parameters_.key_relative_to_root ? relative_place_error<S>(state, reference, keys_)
                                                     : place_error<S>(state, reference, keys_);
    return exp(S(-parameters_.key_scale) * error);
  }

  /// Eq. 21: the mean over bodies of c^ c - (1 - c^) c. A contact that should be gives 1, one that should not costs 1, a
  /// missed one costs nothing.
  template <class S>
  static S contact(std::span<const S> contacts, std::span<const S> reference) {
    S sum(0.0);
    for (std::size_t i = 0; i < contacts.size() && i < reference.size(); ++i)
      sum += reference[i] * contacts[i] - (S(1.0) - reference[i]) * contacts[i];
    return contacts.empty() ? sum : S(S(1.0 / static_cast<double>(contacts.size())) * sum);
  }

 private:
  ParcRewardParameters parameters_;
  body::Skeleton skeleton_;
  std::vector<double> weight_;
  std::vector<int> keys_;
};

}  // namespace traceur::learn
