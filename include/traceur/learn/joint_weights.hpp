// SPDX-License-Identifier: MIT
#pragma once

#include <span>
#include <string_view>
#include <vector>

#include "traceur/body/skeleton.hpp"

namespace traceur::learn {

/// How much the joints whose name contains `part` count.
struct NamedWeight {
  std::string_view part;
  double weight;
};

/// One weight a joint: that of the first entry whose `part` is in the joint's name. Throws Error that names a moving joint,
/// other than the root, which no entry matches.
inline std::vector<double> joint_weights(const body::Skeleton& skeleton, std::span<const NamedWeight> table) {
  std::vector<double> weights;
  for (int i = 0; i < skeleton.size(); ++i) {
    const body::Joint& j = skeleton[i];
    double weight = -1;
    for (const NamedWeight& entry : table) {
      if (weight < 0 && j.name.find(entry.part) != std::string::npos) weight = entry.weight;
    }
    if (i == 0 || body::velocity_size(j.type) == 0) weight = weight < 0 ? 0 : weight;
    if (weight < 0) throw Error("joint weights: expected an entry for joint '" + j.name + "'");
    weights.push_back(weight);
  }
  return weights;
}

/// Weights of the humanoid of DeepMimic's released code, before they are divided by their sum.
inline constexpr NamedWeight deepmimic_joint_weights[] = {{"root", 1.0},     {"pelvis", 1.0},   {"abdomen", 0.5},
                                                          {"chest", 0.5},    {"neck", 0.3},     {"shoulder", 0.3},
                                                          {"elbow", 0.2},    {"wrist", 0.0},    {"hip", 0.5},
                                                          {"knee", 0.3},     {"ankle", 0.2}};

/// Weights of the same humanoid in PARC's released tracker, used as they are.
inline constexpr NamedWeight parc_joint_weights[] = {{"abdomen", 1.0}, {"chest", 1.0}, {"neck", 0.6},  {"shoulder", 0.6},
                                                     {"elbow", 0.4},   {"wrist", 0.0}, {"hip", 1.0},   {"knee", 0.6},
                                                     {"ankle", 0.4}};

}  // namespace traceur::learn
