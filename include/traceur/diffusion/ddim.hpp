// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <traceur/core/error.hpp>
#include <traceur/diffusion/denoiser.hpp>
#include <traceur/diffusion/schedule.hpp>
#include <traceur/nn/module.hpp>

namespace traceur::diffusion {

/// One step of DDIM from noise level `from` to `to` < `from`, as weights of the estimate and of the noisy sample:
///
///     x_to = sqrt(abar_to) x0 + sqrt(1 - abar_to) (x_from - sqrt(abar_from) x0) / sqrt(1 - abar_from)
///          = clean x0 + noisy x_from
///
/// Song, Meng and Ermon, "Denoising Diffusion Implicit Models" (ICLR 2021), eq. 12 without noise; Xu et al. 2025 (PARC),
/// eq. 13, whose first coefficient is printed with the level of `from` by mistake. If x0 is exact, x_to is too: noised to
/// its level by the same eps.
struct DdimStep {
  double clean, noisy;

  DdimStep(const Schedule& schedule, int from, int to)
      : clean(schedule.signal(to) - schedule.signal(from) * schedule.noise(to) / schedule.noise(from)),
        noisy(schedule.noise(to) / schedule.noise(from)) {
    assert(0 <= to && to < from && from <= schedule.steps());
  }
};

/// Leaves estimates as they are.
struct NoProjection {
  template <class M>
  void operator()(M&&) const noexcept {}
};

/// Turns noise into samples by DDIM: deterministic, and with any stride through the steps. The steps visited are K, K -
/// stride, K - 2 stride and so on, down to the last above 0, from which the clean estimate is the sample: with 21 steps and
/// a stride of 5 the denoiser is called five times.
template <class S>
class Ddim {
public:
  /// For up to `max_samples` samples of `features` numbers. Throws Error for a number below 1.
  Ddim(const Schedule& schedule, int stride, Eigen::Index features, Eigen::Index max_samples) {
    if (stride < 1) throw Error("ddim: expected a stride of at least 1, got " + std::to_string(stride));
    nn::detail::check_positive("ddim", "feature", features);
    nn::detail::check_positive("ddim", "sample", max_samples);
    for (int k = schedule.steps(); k > 0; k -= stride) {
      steps_.push_back(k);
      weights_.emplace_back(schedule, k, std::max(k - stride, 0));
    }
    clean_.resize(features, max_samples);
  }

  /// The steps at which the denoiser is called, in order.
  const std::vector<int>& steps() const noexcept { return steps_; }
  Eigen::Index features() const noexcept { return clean_.rows(); }
  Eigen::Index max_samples() const noexcept { return clean_.cols(); }

  /// Replaces x, noise of level K (see `draw_noise`), by samples. `project(clean)` may change every estimate, such as to
  /// something a body can do.
  template <Denoiser<S> D, class Projection = NoProjection>
  void sample(D& denoiser, const Condition<S>& condition, nn::Matrix<S> x, Projection&& project = {}) {
    assert(x.rows() == features() && x.cols() <= max_samples());
    denoiser.begin(condition);
    nn::Matrix<S> clean = clean_.leftCols(x.cols());
    for (std::size_t i = 0; i < steps_.size(); ++i) {
      denoiser.denoise(steps_[i], x, clean);
      project(clean);
      x = static_cast<S>(weights_[i].clean) * clean + static_cast<S>(weights_[i].noisy) * x;
    }
  }

private:
  std::vector<int> steps_;
  std::vector<DdimStep> weights_;
  Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> clean_;
};

}  // namespace traceur::diffusion
