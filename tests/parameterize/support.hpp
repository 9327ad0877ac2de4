// SPDX-License-Identifier: MIT
#pragma once

#include <string>

#include <Eigen/Core>

#include <traceur/core/error.hpp>
#include <traceur/core/random.hpp>

namespace support {

/// n by count numbers in [low, high).
inline Eigen::MatrixXd uniform(traceur::core::RandomStream& random, Eigen::Index n, Eigen::Index count,
                               double low = 0.0, double high = 1.0) {
  Eigen::MatrixXd x(n, count);
  for (Eigen::Index i = 0; i < x.size(); ++i) x.data()[i] = random.uniform(low, high);
  return x;
}

/// What an Error thrown by `f` says, or nothing.
template <class F>
std::string error_of(F&& f) {
  try {
    f();
  } catch (const traceur::Error& error) {
    return error.what();
  }
  return "";
}

template <class F>
bool fails_with(F&& f, const char* part) {
  const std::string what = error_of(f);
  return !what.empty() && what.find(part) != std::string::npos && what.find('\n') == std::string::npos;
}

}  // namespace support
