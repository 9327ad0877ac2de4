// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <span>
#include <utility>
#include <variant>
#include <vector>

#include "traceur/learn/deepmimic_reward.hpp"
#include "traceur/learn/hil_reward.hpp"
#include "traceur/learn/parc_reward.hpp"

namespace traceur::learn {

/// The constants of one of the tracking rewards.
using TrackingRewardParameters = std::variant<DeepMimicRewardParameters, ParcRewardParameters, HilReward>;

/// What a tracking reward may ask about besides the two states. Contacts have one entry a moving body.
template <class S>
struct TrackingEvidence {
  std::span<const S> contacts;            ///< 1 where a body touches something
  std::span<const S> reference_contacts;  ///< labels in [0, 1]
  S power;                                ///< of all motors together, W
};

/// One of the tracking rewards, as a share of the most that it can be: 1 for perfect tracking by DeepMimic's, by HIL's at
/// rest, by PARC's where every body should touch the ground and does (half of that where none should).
class TrackingReward {
 public:
  /// `end_effectors`: hands and feet. Throws Error for a joint whose weight the reward's table does not tell.
  TrackingReward(const body::Skeleton& skeleton, const std::vector<int>& end_effectors, const TrackingRewardParameters& parameters)
      : reward_(make(skeleton, end_effectors, parameters)) {
    if (const auto* parc = std::get_if<ParcReward>(&reward_)) most_ = 1 + parc->parameters().contact_weight;
    if (const auto* hil = std::get_if<HilReward>(&reward_))
      most_ = hil->position_weight + hil->rotation_weight + hil->velocity_weight + hil->angular_velocity_weight + hil->height_weight;
  }

  /// What shares are taken of.
  double most() const noexcept { return most_; }
  bool reads_contacts() const noexcept { return std::holds_alternative<ParcReward>(reward_); }
  bool reads_power() const noexcept { return std::holds_alternative<HilReward>(reward_); }

  template <class S>
  S operator()(const TrackingState<S>& state, const TrackingState<S>& reference, const TrackingEvidence<S>& evidence) const {
    if (const auto* parc = std::get_if<ParcReward>(&reward_))
      return S(1 / most_) * (*parc)(state, reference, evidence.contacts, evidence.reference_contacts);
    if (const auto* hil = std::get_if<HilReward>(&reward_)) return S(1 / most_) * (*hil)(state, reference, evidence.power);
    return std::get<DeepMimicReward>(reward_)(state, reference);
  }

 private:
  using Reward = std::variant<DeepMimicReward, ParcReward, HilReward>;

  static Reward make(const body::Skeleton& skeleton, const std::vector<int>& ends, const TrackingRewardParameters& parameters) {
    if (const auto* parc = std::get_if<ParcRewardParameters>(&parameters))
      return ParcReward(skeleton, joint_weights(skeleton, parc_joint_weights), ends, *parc);
    if (const auto* hil = std::get_if<HilReward>(&parameters)) return *hil;
    return DeepMimicReward(skeleton, joint_weights(skeleton, deepmimic_joint_weights), ends,
                           std::get<DeepMimicRewardParameters>(parameters));
  }

  Reward reward_;
  double most_ = 1;
};

}  // namespace traceur::learn
