// SPDX-License-Identifier: MIT
#pragma once

#include <cassert>
#include <string>
#include <vector>

#include <Eigen/Core>

#include <traceur/core/error.hpp>
#include <traceur/diffusion/denoiser.hpp>
#include <traceur/nn/module.hpp>

namespace traceur::diffusion {

/// A denoiser that can blend two estimates itself, and share the work between them.
template <class D, class S = float>
concept BlendingDenoiser = Denoiser<D, S> && requires(D& denoiser, const Condition<S>& condition, Blend blend) {
  { denoiser.begin(condition, blend) } -> std::same_as<void>;
};

/// Blended denoising (Xu et al. 2025, PARC, eq. 5): with C the condition and C' what is left of it without some parts,
///
///     clean = s G(step, noisy, C') + (1 - s) G(step, noisy, C)
///
/// Without past frames a generator heeds the terrain better, with them its motion is smoother; s trades one for the other.
/// The same formula with s < 0 is classifier-free guidance (Ho and Salimans 2022). Itself a Denoiser, of any other: one that
/// cannot blend is given every sample twice.
template <class S, Denoiser<S> D>
class BlendedDenoiser {
public:
  /// For up to `max_samples` samples; the denoiser, which must take twice as many unless it blends itself, is kept by
  /// reference. Throws Error if there is no sample or the share is not finite.
  BlendedDenoiser(D& denoiser, Blend blend, Eigen::Index max_samples) : denoiser_(denoiser), blend_(blend) {
    nn::detail::check_positive("blended denoiser", "sample", max_samples);
    if (!(blend.share - blend.share == 0.0)) throw Error("blended denoiser: expected a finite share");
    if constexpr (!BlendingDenoiser<D, S>) {
      values_.resize(denoiser.condition_features(), 2 * max_samples);
      noisy_.resize(denoiser.features(), 2 * max_samples);
      clean_.resize(denoiser.features(), 2 * max_samples);
      given_.resize(static_cast<std::size_t>(2 * max_samples));
    }
  }

  Eigen::Index features() const noexcept { return denoiser_.features(); }
  Eigen::Index condition_features() const noexcept { return denoiser_.condition_features(); }

  void begin(const Condition<S>& condition) {
    if constexpr (BlendingDenoiser<D, S>) {
      denoiser_.begin(condition, blend_);
    } else {
      const Eigen::Index n = condition.values.cols();
      assert(2 * n <= values_.cols());
      for (Eigen::Index j = 0; j < n; ++j) {
        given_[static_cast<std::size_t>(j)] = condition.parts(j);
        given_[static_cast<std::size_t>(n + j)] = condition.parts(j) & ~blend_.without;
      }
      values_.leftCols(n) = condition.values;
      values_.middleCols(n, n) = condition.values;
      denoiser_.begin(Condition<S>{values_.leftCols(2 * n), given_.data()});
    }
  }

  void denoise(int step, nn::ConstMatrix<S> noisy, nn::Matrix<S> clean) {
    if constexpr (BlendingDenoiser<D, S>) {
      denoiser_.denoise(step, noisy, clean);
    } else {
      const Eigen::Index n = noisy.cols();
      noisy_.leftCols(n) = noisy;
      noisy_.middleCols(n, n) = noisy;
      denoiser_.denoise(step, noisy_.leftCols(2 * n), clean_.leftCols(2 * n));
      const S share = static_cast<S>(blend_.share);
      clean = share * clean_.middleCols(n, n) + (S(1) - share) * clean_.leftCols(n);
    }
  }

private:
  D& denoiser_;
  Blend blend_;
  Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> values_, noisy_, clean_;  // all parts, then without some
  std::vector<Parts> given_;
};

}  // namespace traceur::diffusion
