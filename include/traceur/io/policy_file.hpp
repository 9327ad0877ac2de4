// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "traceur/io/safetensors.hpp"
#include "traceur/learn/policy.hpp"

namespace traceur::io {

/// Adds a policy to a file: its network's tensors under `prefix` + "network.", the widths of its layers, and its
/// normaliser's state.
inline void add_policy(Safetensors& file, const learn::Policy<float>& policy, const std::string& prefix = "") {
  std::vector<std::int64_t> widths;
  for (const Eigen::Index w : policy.network().widths()) widths.push_back(w);
  file.add<std::int64_t>(prefix + "widths", {widths.size()}, widths);
  add_module<float>(file, policy.network(), policy.parameters().data(), prefix + "network.");
  add_vector(file, prefix + "normalizer", policy.normalizer().state());
}

/// The policy that `add_policy` put there. Throws Error that names file and tensor.
inline learn::Policy<float> get_policy(const Safetensors& file, const std::string& prefix = "") {
  const auto refuse = [&](const std::string& what) -> void {
    throw Error(file.where() + ": tensor '" + prefix + what);
  };
  constexpr std::int64_t widest = 1 << 20;
  std::vector<Eigen::Index> widths;
  for (const std::int64_t w : file.values<std::int64_t>(prefix + "widths")) {
    if (w < 1 || w > widest) refuse("widths': expected widths from 1 to " + std::to_string(widest) + ", found " + std::to_string(w));
    widths.push_back(static_cast<Eigen::Index>(w));
  }
  if (widths.size() < 2) refuse("widths': expected at least two");
  // A few numbers can announce more memory than there is; the weights themselves are in the file.
  std::int64_t held = 0, announced = 0;
  for (const Tensor& tensor : file.tensors()) held += static_cast<std::int64_t>(tensor.size());
  for (std::size_t k = 1; k < widths.size() && announced <= held; ++k) announced += widths[k] * widths[k - 1];
  if (announced > held) refuse("widths': expected a network of no more weights than the file has numbers");
  nn::Mlp<> network(widths);
  Eigen::VectorXf parameters(network.parameters());
  read_module<float>(file, network, parameters.data(), prefix + "network.");
  nn::Normalizer normalizer(network.inputs());
  normalizer.restore(get_vector<double>(file, prefix + "normalizer"));
  return learn::Policy<float>(std::move(network), std::move(parameters), std::move(normalizer));
}

/// Writes a policy and texts about it, atomically. Throws Error that names the path.
inline void write_policy(const std::filesystem::path& path, const learn::Policy<float>& policy,
                         const std::map<std::string, std::string>& metadata = {}) {
  Safetensors file(path.string());
  file.metadata = metadata;
  add_policy(file, policy);
  write_safetensors(path, file);
}

/// Reads a policy. Throws Error that names path and tensor.
inline learn::Policy<float> read_policy(const std::filesystem::path& path) { return get_policy(read_safetensors(path)); }

}  // namespace traceur::io
