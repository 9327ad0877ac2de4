// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include <traceur/core/error.hpp>
#include <traceur/nn/module.hpp>

namespace traceur::diffusion {

/// How a sample turns into noise, step by step. With x_0 a clean sample, eps standard normal and
/// abar_k = prod_{i <= k} (1 - beta_i),
///
///     x_k = sqrt(abar_k) x_0 + sqrt(1 - abar_k) eps,      k = 0 (clean) ... steps() (noise)
///
/// Ho, Jain and Abbeel, "Denoising Diffusion Probabilistic Models" (NeurIPS 2020), eq. 4. Code that counts its steps from
/// 0 calls our step k its step k - 1.
class Schedule {
public:
  /// From beta_1, beta_2, ... Throws Error unless there is one and each is above 0 and below 1.
  explicit Schedule(std::vector<double> betas) : betas_(std::move(betas)) {
    if (betas_.empty()) throw Error("schedule: expected at least one step");
    betas_.insert(betas_.begin(), 0.0);
    double kept = 1;
    for (std::size_t k = 0; k < betas_.size(); ++k) {
      if (k > 0 && !(betas_[k] > 0.0 && betas_[k] < 1.0)) {
        throw Error("schedule: beta " + std::to_string(k) + ": expected more than 0 and less than 1, got " +
                    std::to_string(betas_[k]));
      }
      kept *= 1.0 - betas_[k];
      kept_.push_back(kept);
      signal_.push_back(std::sqrt(kept));
      noise_.push_back(std::sqrt(1.0 - kept));
    }
  }

  /// abar_k = f(k) / f(0), f(k) = cos^2(pi/2 (k / steps + offset) / (1 + offset)), but for the limits of beta: Nichol and
  /// Dhariwal, "Improved Denoising Diffusion Probabilistic Models" (ICML 2021), eq. 17. The defaults are those of PARC's
  /// released configuration. Throws Error unless steps >= 1, offset >= 0 and 0 < least < most < 1.
  static Schedule cosine(int steps = 21, double offset = 0.008, double least = 1e-4, double most = 0.9999) {
    check_steps(steps);
    if (!(offset >= 0.0) || !std::isfinite(offset)) throw Error("schedule: expected an offset of 0 or more");
    if (!(0.0 < least && least < most && most < 1.0)) {
      throw Error("schedule: expected limits of beta with 0 < least < most < 1");
    }
    const auto f = [&](int k) {
      const double c = std::cos(0.5 * std::numbers::pi * (static_cast<double>(k) / steps + offset) / (1.0 + offset));
      return c * c;
    };
    std::vector<double> betas;
    for (int k = 1; k <= steps; ++k) betas.push_back(std::clamp(1.0 - f(k) / f(k - 1), least, most));
    return Schedule(std::move(betas));
  }

  /// beta rises along a line from `first` to `last`: Ho et al. 2020, section 4, whose values these are.
  static Schedule linear(int steps = 1000, double first = 1e-4, double last = 0.02) {
    check_steps(steps);
    std::vector<double> betas;
    for (int k = 0; k < steps; ++k) {
      betas.push_back(steps == 1 ? first : first + (last - first) * static_cast<double>(k) / (steps - 1));
    }
    return Schedule(std::move(betas));
  }

  /// K, the step of pure noise.
  int steps() const noexcept { return static_cast<int>(betas_.size()) - 1; }
  /// beta_k, the share of the variance that step k replaces by noise; 0 for k = 0.
  double beta(int k) const noexcept { return betas_[at(k)]; }
  /// abar_k; 1 for k = 0.
  double kept(int k) const noexcept { return kept_[at(k)]; }
  /// sqrt(abar_k), what the clean sample is multiplied with.
  double signal(int k) const noexcept { return signal_[at(k)]; }
  /// sqrt(1 - abar_k), what the noise is multiplied with.
  double noise(int k) const noexcept { return noise_[at(k)]; }

  /// x_k for every column: `noisy` may be either of the other two.
  template <class S>
  void diffuse(int k, nn::ConstMatrix<S> clean, nn::ConstMatrix<S> eps, nn::Matrix<S> noisy) const noexcept {
    noisy = static_cast<S>(signal(k)) * clean + static_cast<S>(noise(k)) * eps;
  }

private:
  static void check_steps(int steps) {
    if (steps < 1) throw Error("schedule: expected at least one step, got " + std::to_string(steps));
  }
  std::size_t at(int k) const noexcept {
    assert(k >= 0 && k <= steps());
    return static_cast<std::size_t>(k);
  }

  std::vector<double> betas_, kept_, signal_, noise_;
};

}  // namespace traceur::diffusion
