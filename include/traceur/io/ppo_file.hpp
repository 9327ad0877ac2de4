// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "traceur/io/safetensors.hpp"
#include "traceur/learn/ppo_report.hpp"

namespace traceur::io {

/// Adds all that a run of PPO needs to go on, under names that begin with `prefix`.
inline void add_ppo_state(Safetensors& file, const learn::PpoState<float>& s, const std::string& prefix = "ppo.") {
  const auto floats = [&](const char* name, const Eigen::VectorXf& v) {
    file.add<float>(prefix + name, {static_cast<std::uint64_t>(v.size())}, {v.data(), static_cast<std::size_t>(v.size())});
  };
  floats("policy", s.policy);
  floats("value", s.value);
  floats("policy_optimizer", s.policy_optimizer);
  floats("value_optimizer", s.value_optimizer);
  file.add<double>(prefix + "normalizer", {static_cast<std::uint64_t>(s.normalizer.size())},
                   {s.normalizer.data(), static_cast<std::size_t>(s.normalizer.size())});
  const std::vector<std::int64_t> counts{s.policy_steps, s.value_steps, s.updates, s.ticks};
  file.add<std::int64_t>(prefix + "counts", {counts.size()}, counts);
  const std::vector<double> rate{s.policy_rate};
  file.add<double>(prefix + "policy_rate", {1}, rate);
}

/// What `add_ppo_state` put there; whether it fits a run is for `learn::Ppo::restore` to say. Throws Error that names file
/// and tensor.
inline learn::PpoState<float> get_ppo_state(const Safetensors& file, const std::string& prefix = "ppo.") {
  learn::PpoState<float> s;
  const auto floats = [&](const char* name) -> Eigen::VectorXf {
    const std::vector<float> v = file.values<float>(prefix + name);
    return Eigen::Map<const Eigen::VectorXf>(v.data(), static_cast<Eigen::Index>(v.size()));
  };
  s.policy = floats("policy");
  s.value = floats("value");
  s.policy_optimizer = floats("policy_optimizer");
  s.value_optimizer = floats("value_optimizer");
  const std::vector<double> normalizer = file.values<double>(prefix + "normalizer");
  s.normalizer = Eigen::Map<const Eigen::VectorXd>(normalizer.data(), static_cast<Eigen::Index>(normalizer.size()));
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
