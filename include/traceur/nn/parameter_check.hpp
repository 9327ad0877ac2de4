// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <string>
#include <string_view>

#include <Eigen/Core>

#include <traceur/core/error.hpp>

namespace traceur::nn {

/// The first number that is not finite among a module's parameters, or among their gradients, as `layers.1.weight(3, 5)
/// is nan`; empty if all are finite. `values` is laid out as theta.
template <class M, class S>
std::string first_not_finite(const M& module, const S* values) {
  std::string found;
  module.for_each_parameter([&](std::string_view name, Eigen::Index offset, Eigen::Index rows, Eigen::Index cols) {
    if (!found.empty()) return;
    for (Eigen::Index i = 0; i < rows * cols; ++i) {
      const S value = values[offset + i];
      if (std::isfinite(value)) continue;
      found = std::string(name) + "(" + std::to_string(i % rows) + ", " + std::to_string(i / rows) + ") is " +
              (std::isnan(value) ? "nan"
               : value > S(0)    ? "inf"
                                 : "-inf");
      return;
    }
  });
  return found;
}

/// Throws Error if one of them is not finite: `policy gradient: layers.1.weight(3, 5) is nan`.
template <class M, class S>
void check_finite(const char* what, const M& module, const S* values) {
  const std::string found = first_not_finite(module, values);
  if (!found.empty()) throw Error(std::string(what) + ": " + found);
}

}  // namespace traceur::nn
