// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

#include "traceur/io/safetensors.hpp"
#include "traceur/learn/adversarial_imitation.hpp"

namespace traceur::io {

/// Adds all that adversarial imitation needs to go on beside a policy's run, under names that begin with `prefix`.
inline void add_adversarial_state(Safetensors& file, const learn::AdversarialState<float>& s, const std::string& prefix = "style.") {
  add_vector(file, prefix + "discriminator", s.discriminator);
  add_vector(file, prefix + "optimizer", s.optimizer);
  add_vector(file, prefix + "replay", s.replay);
  add_vector(file, prefix + "normalizer", s.normalizer);
  const std::vector<std::int64_t> counts{s.steps, s.updates, s.replayed, s.replay.rows(), s.replay.cols()};
  file.add<std::int64_t>(prefix + "counts", {counts.size()}, counts);
}

/// What `add_adversarial_state` put there; whether it fits a run is for `learn::AdversarialImitation::restore` to say.
/// Throws Error that names file and tensor.
inline learn::AdversarialState<float> get_adversarial_state(const Safetensors& file, const std::string& prefix = "style.") {
  learn::AdversarialState<float> s;
  s.discriminator = get_vector<float>(file, prefix + "discriminator");
  s.optimizer = get_vector<float>(file, prefix + "optimizer");
  s.normalizer = get_vector<double>(file, prefix + "normalizer");
  std::vector<std::int64_t> counts(5);
  file.read<std::int64_t>(prefix + "counts", counts);
  s.steps = counts[0];
  s.updates = counts[1];
  s.replayed = counts[2];
  const Eigen::VectorXf replay = get_vector<float>(file, prefix + "replay");
  constexpr std::int64_t widest = 1 << 24;
  if (counts[3] < 0 || counts[3] > widest || counts[4] < 0 || counts[4] > widest || counts[3] * counts[4] != replay.size())
    throw Error(file.where() + ": tensor '" + prefix + "replay': expected as many numbers as 'counts' says");
  s.replay = Eigen::Map<const Eigen::MatrixXf>(replay.data(), counts[3], counts[4]);
  return s;
}

}  // namespace traceur::io
