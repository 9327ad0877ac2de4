// SPDX-License-Identifier: MIT
#include <traceur/diffusion/denoiser.hpp>

#include <doctest/doctest.h>

#include <traceur/core/executor.hpp>
#include <traceur/diffusion/blended_denoiser.hpp>
#include <traceur/diffusion/mlp_denoiser.hpp>
#include <traceur/diffusion/motion_generator.hpp>
#include <traceur/diffusion/network_denoiser.hpp>

#include "support.hpp"

using namespace traceur::diffusion;

namespace {

struct Identity {
  Eigen::Index features() const { return 1; }
  Eigen::Index condition_features() const { return 0; }
  void begin(const Condition<float>&) {}
  void denoise(int, traceur::nn::ConstMatrix<float> noisy, traceur::nn::Matrix<float> clean) { clean = noisy; }
};
struct Unconditional {
  Eigen::Index features() const { return 1; }
  void denoise(int, traceur::nn::ConstMatrix<float> noisy, traceur::nn::Matrix<float> clean) { clean = noisy; }
};

template <class N>
using Bound = NetworkDenoiser<float, N, traceur::core::SerialExecutor>;

static_assert(DenoisingNetwork<MlpDenoiser<>, float> && DenoisingNetwork<MlpDenoiser<>, double>);
static_assert(DenoisingNetwork<MotionGenerator, float> && DenoisingNetwork<MotionGenerator, double>);
static_assert(Denoiser<Bound<MlpDenoiser<>>> && Denoiser<Bound<MotionGenerator>> && Denoiser<Identity>);
static_assert(Denoiser<BlendedDenoiser<float, Identity>>);
static_assert(BlendingDenoiser<Bound<MlpDenoiser<>>> && !BlendingDenoiser<Identity>);
static_assert(!Denoiser<Unconditional> && !Denoiser<Identity, double>);

}  // namespace

TEST_CASE("a condition of no parts counts in full") {
  const Table<double> values = random_table<double>(3, 4, 1);
  const Condition<double> c{values};
  CHECK(c.parts(2) == all_parts);
  const Parts given[] = {1, 2, 3, 4};
  const Condition<double> d{values, given};
  CHECK(d.columns(1, 2).parts(1) == 3);
  CHECK(d.columns(1, 2).values == values.middleCols(1, 2));
  CHECK(no_condition<float>(7).values.cols() == 7);
}
