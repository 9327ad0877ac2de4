// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "traceur/io/safetensors.hpp"
#include "traceur/learn/ppo_report.hpp"

namespace traceur::io {

/// Adds all that a run of PPO needs to go on, under names that begin with `prefix`.
inline void add_ppo_state(Safetensors& file, const learn::PpoState<float>& s, const std::string& prefix = "ppo.") {
  add_vector(file, prefix + "policy", s.policy);
  add_vector(file, prefix + "value", s.value);
  add_vector(file, prefix + "policy_optimizer", s.policy_optimizer);
  add_vector(file, prefix + "value_optimizer", s.value_optimizer);
  add_vector(file, prefix + "normalizer", s.normalizer);
  const std::vector<std::int64_t> counts{s.policy_steps, s.value_steps, s.updates, s.ticks};
  file.add<std::int64_t>(prefix + "counts", {counts.size()}, counts);
  const std::vector<double> rate{s.policy_rate};
  file.add<double>(prefix + "policy_rate", {1}, rate);
}

/// What `add_ppo_state` put there; whether it fits a run is for `learn::Ppo::restore` to say. Throws Error that names file
/// and tensor.
inline learn::PpoState<float> get_ppo_state(const Safetensors& file, const std::string& prefix = "ppo.") {
  learn::PpoState<float> s;
  s.policy = get_vector<float>(file, prefix + "policy");
  s.value = get_vector<float>(file, prefix + "value");
  s.policy_optimizer = get_vector<float>(file, prefix + "policy_optimizer");
  s.value_optimizer = get_vector<float>(file, prefix + "value_optimizer");
  s.normalizer = get_vector<double>(file, prefix + "normalizer");
  std::vector<std::int64_t> counts(4);
  file.read<std::int64_t>(prefix + "counts", counts);
  s.policy_steps = counts[0];
  s.value_steps = counts[1];
  s.updates = counts[2];
  s.ticks = counts[3];
  std::vector<double> rate(1);
  file.read<double>(prefix + "policy_rate", rate);
  s.policy_rate = rate[0];
  return s;
}

}  // namespace traceur::io
