// SPDX-License-Identifier: MIT
#pragma once

#include <concepts>
#include <cstdint>
#include <string_view>

#include <Eigen/Core>

#include <traceur/core/random.hpp>
#include <traceur/nn/module.hpp>

namespace traceur::diffusion {

/// A set of parts of a condition, one bit each: the terrain, a target, past frames. Which bit is which part is the
/// network's to say.
using Parts = std::uint32_t;
inline constexpr Parts all_parts = ~Parts{0};

/// What samples are conditioned on: a column of numbers for each sample, and which parts of it count.
template <class S>
struct Condition {
  nn::ConstMatrix<S> values;     ///< condition_features() x samples; numbers of parts that do not count must be finite
  const Parts* given = nullptr;  ///< one for each sample; null: every part of every sample counts

  Parts parts(Eigen::Index sample) const noexcept { return given == nullptr ? all_parts : given[sample]; }
  Condition columns(Eigen::Index first, Eigen::Index count) const noexcept {
    return {values.middleCols(first, count), given == nullptr ? nullptr : given + first};
  }
};

/// A condition of no numbers.
template <class S>
Condition<S> no_condition(Eigen::Index samples) noexcept {
  return {Eigen::Map<const Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>>(nullptr, 0, samples), nullptr};
}

/// (step, noisy samples, condition) -> clean samples, the condition being given first: `begin(condition)` says what the
/// calls that follow are conditioned on, and does the work that is the same for every step; `denoise(step, noisy, clean)`
/// estimates the clean samples. Columns are samples; `noisy` has as many as the condition.
///
/// Laws the compiler cannot check: columns do not depend on each other; neither call allocates; `denoise` is a function of
/// the condition, the step and `noisy` alone, and keeps nothing.
template <class D, class S = float>
concept Denoiser = requires(D& denoiser, const D& constant, const Condition<S>& condition, int step,
                            nn::ConstMatrix<S> noisy, nn::Matrix<S> clean) {
  { constant.features() } -> std::same_as<Eigen::Index>;
  { constant.condition_features() } -> std::same_as<Eigen::Index>;
  { denoiser.begin(condition) } -> std::same_as<void>;
  { denoiser.denoise(step, noisy, clean) } -> std::same_as<void>;
};

/// A mixture of two estimates (PARC eq. 5): `share` of the one that does not see the parts `without`, and the rest of the
/// one that does.
struct Blend {
  Parts without = 0;
  double share = 0;  ///< s of the paper, in [0, 1]: 0.65 to generate data, 0.5 to generate long motions
};

/// A network that learns to denoise: like an nn::Module an immutable description of shapes, whose parameters lie in a flat
/// array of the caller's, with the same rules for memory and gradients.
///
/// `forward` and `backward` are for training, each sample with a step of its own. To sample, `load` writes what depends on
/// the parameters alone, `prepare` what depends on them and the condition for the samples [first, first + n) of a batch, and
/// `infer` reads both: the same estimate as `forward`, to rounding, but without seeing the parts `without`. Scratch memory
/// keeps nothing between two calls.
template <class N, class S = float>
concept DenoisingNetwork =
    requires(const N& net, const S* theta, S* dtheta, const int* steps, int step, nn::ConstMatrix<S> x, nn::Matrix<S> y,
             const Condition<S>& condition, typename N::template Workspace<S>& w,
             typename N::template Prepared<S>& prepared, typename N::template Scratch<S>& scratch, Eigen::Index samples,
             Parts without, core::RandomStream& random) {
  { net.features() } -> std::same_as<Eigen::Index>;
  { net.condition_features() } -> std::same_as<Eigen::Index>;
  { net.parameters() } -> std::same_as<Eigen::Index>;
  { net.template workspace<S>(samples) } -> std::same_as<typename N::template Workspace<S>>;
  { net.template prepared<S>(samples) } -> std::same_as<typename N::template Prepared<S>>;
  { net.template scratch<S>(samples) } -> std::same_as<typename N::template Scratch<S>>;
  { net.forward(theta, steps, x, condition, w, y) } -> std::same_as<void>;
  { net.backward(theta, x, w, dtheta) } -> std::same_as<void>;
  { net.load(theta, prepared) } -> std::same_as<void>;
  { net.prepare(theta, condition, samples, scratch, prepared) } -> std::same_as<void>;
  { net.infer(theta, step, x, prepared, samples, without, scratch, y) } -> std::same_as<void>;
  { net.initialize(dtheta, random) } -> std::same_as<void>;
  net.for_each_parameter([](std::string_view, Eigen::Index, Eigen::Index, Eigen::Index) {});
};

/// Fills samples with standard normal numbers: those of column j come from stream `first + j`, whatever the batch.
template <class S>
void draw_noise(nn::Matrix<S> x, std::uint64_t seed, std::uint64_t step = 0, std::uint64_t first = 0) noexcept {
  for (Eigen::Index j = 0; j < x.cols(); ++j) {
    core::RandomStream random(seed, first + static_cast<std::uint64_t>(j), step);
    for (Eigen::Index i = 0; i < x.rows(); ++i) x(i, j) = random.normal<S>();
  }
}

}  // namespace traceur::diffusion
