// SPDX-License-Identifier: MIT
#pragma once

#include <cassert>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <traceur/core/error.hpp>
#include <traceur/core/executor.hpp>
#include <traceur/core/random.hpp>
#include <traceur/diffusion/denoiser.hpp>
#include <traceur/diffusion/schedule.hpp>
#include <traceur/nn/data_parallel.hpp>
#include <traceur/nn/module.hpp>

namespace traceur::diffusion {

/// Parts of the condition that a sample loses, all together, with a probability while training, so that the network learns
/// to do without them.
struct Drop {
  Parts parts = 0;
  double probability = 0;  ///< in [0, 1]
};

/// What training minimises, summed over samples: `loss(clean, estimate, first, workspace, gradient)` returns the sum over
/// the columns of `estimate`, which are the samples [first, ...) of the batch, and writes its gradient with respect to
/// them. `clean` is what was noised. Allocates nothing; a workspace serves one thread at a time.
template <class L, class S = float>
concept DenoisingLoss = requires(const L& loss, nn::ConstMatrix<S> clean, nn::Matrix<S> gradient, Eigen::Index first,
                                 decltype(loss.workspace())& w) {
  { loss(clean, clean, first, w, gradient) } -> std::convertible_to<double>;
};

/// The squared distance to the clean sample: Xu et al. 2025 (PARC), eq. 1.
template <class S>
struct SquaredError {
  struct Workspace {};
  Workspace workspace() const noexcept { return {}; }

  double operator()(nn::ConstMatrix<S> clean, nn::ConstMatrix<S> estimate, Eigen::Index, Workspace&,
                    nn::Matrix<S> gradient) const noexcept {
    double sum = 0;
    for (Eigen::Index j = 0; j < clean.cols(); ++j) {
      for (Eigen::Index i = 0; i < clean.rows(); ++i) {
        const S error = estimate(i, j) - clean(i, j);
        sum += static_cast<double>(error) * static_cast<double>(error);
        gradient(i, j) = S(2) * error;
      }
    }
    return sum;
  }
};

/// A step of training with clean-sample prediction (Xu et al. 2025, PARC, eq. 1; Ho et al. 2020, algorithm 1): every sample
/// of a batch is noised to a step k uniform in [1, K], loses parts of its condition by chance, and the network is to give
/// back the clean sample. Holds the memory for it.
///
/// The draws of sample j in step t come from the random stream (seed, j, t), and the gradient is summed in the order of
/// a fixed number of chunks: the same bits on any number of threads.
template <class S, DenoisingNetwork<S> N, class Loss = SquaredError<S>>
class Training {
public:
  struct Parameters {
    Eigen::Index batch = 64;  ///< most samples of a step
    int chunks = 8;           ///< jobs that a step is split into
    std::vector<Drop> drops = {};  ///< drawn independently of each other
    std::uint64_t seed = 1;
  };

  /// Keeps references to the network and the loss. Throws Error if a number is out of its range.
  Training(const N& net, const Schedule& schedule, const Loss& loss, Parameters p)
      : net_(net),
        loss_(loss),
        schedule_(schedule),
        p_(std::move(p)),
        parallel_(net.parameters(), p_.chunks),
        noisy_(net.features(), p_.batch),
        estimate_(net.features(), p_.batch),
        gradient_(net.features(), p_.batch),
        steps_(static_cast<std::size_t>(p_.batch)),
        given_(static_cast<std::size_t>(p_.batch)),
        sums_(static_cast<std::size_t>(p_.chunks)) {
    nn::detail::check_positive("training", "sample", p_.batch);
    for (const Drop& drop : p_.drops) {
      if (!(drop.probability >= 0.0 && drop.probability <= 1.0)) {
        throw Error("training: expected a probability in [0, 1], got " + std::to_string(drop.probability));
      }
    }
    const Eigen::Index largest = parallel_.largest(p_.batch);
    for (int i = 0; i < p_.chunks; ++i) {
      work_.push_back({net.template workspace<S>(largest), loss.workspace()});
    }
  }

  /// Adds the gradient of the mean loss over the samples `clean` (features x up to batch) to `gradient` and returns that
  /// mean. `step` counts the steps of training. A condition's own `given` is what there is to drop from.
  template <core::Executor E>
  double run(E& executor, const S* theta, nn::ConstMatrix<S> clean, const Condition<S>& condition, std::uint64_t step,
             nn::Flat<S> gradient) {
    const Eigen::Index n = clean.cols();
    assert(n > 0 && n <= p_.batch && condition.values.cols() == n);
    parallel_.run(executor, n, gradient, [&](int chunk, Eigen::Index first, Eigen::Index count, S* part) {
      for (Eigen::Index j = first; j < first + count; ++j) noise(clean, condition, j, step);
      Work& w = work_[static_cast<std::size_t>(chunk)];
      const Condition<S> seen{condition.values.middleCols(first, count), given_.data() + first};
      net_.forward(theta, steps_.data() + first, noisy_.middleCols(first, count), seen, w.net,
                   estimate_.middleCols(first, count));
      sums_[static_cast<std::size_t>(chunk)] = loss_(clean.middleCols(first, count), estimate_.middleCols(first, count),
                                                     first, w.loss, gradient_.middleCols(first, count));
      gradient_.middleCols(first, count) /= static_cast<S>(n);
      net_.backward(theta, gradient_.middleCols(first, count), w.net, part);
    });
    double sum = 0;
    for (int chunk = 0; chunk < p_.chunks; ++chunk) {
      if (parallel_.first(chunk, n) < parallel_.first(chunk + 1, n)) sum += sums_[static_cast<std::size_t>(chunk)];
    }
    return sum / static_cast<double>(n);
  }

  /// What the last step drew and found: the noised samples, their steps, the parts each was given, and the estimates.
  nn::ConstMatrix<S> noisy(Eigen::Index samples) const noexcept { return noisy_.leftCols(samples); }
  nn::ConstMatrix<S> estimate(Eigen::Index samples) const noexcept { return estimate_.leftCols(samples); }
  const std::vector<int>& steps() const noexcept { return steps_; }
  const std::vector<Parts>& given() const noexcept { return given_; }

private:
  struct Work {
    typename N::template Workspace<S> net;
    decltype(std::declval<const Loss&>().workspace()) loss;
  };

  void noise(nn::ConstMatrix<S> clean, const Condition<S>& condition, Eigen::Index j, std::uint64_t step) noexcept {
    core::RandomStream random(p_.seed, static_cast<std::uint64_t>(j), step);
    const int k = 1 + static_cast<int>(random.below(static_cast<std::uint32_t>(schedule_.steps())));
    Parts given = condition.parts(j);
    for (const Drop& drop : p_.drops) {
      if (random.bernoulli(drop.probability)) given &= ~drop.parts;
    }
    steps_[static_cast<std::size_t>(j)] = k;
    given_[static_cast<std::size_t>(j)] = given;
    const S signal = static_cast<S>(schedule_.signal(k)), noise = static_cast<S>(schedule_.noise(k));
    for (Eigen::Index i = 0; i < clean.rows(); ++i) {
      noisy_(i, j) = signal * clean(i, j) + noise * random.template normal<S>();
    }
  }

  const N& net_;
  const Loss& loss_;
  Schedule schedule_;
  Parameters p_;
  nn::DataParallel<S> parallel_;
  Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> noisy_, estimate_, gradient_;
  std::vector<int> steps_;
  std::vector<Parts> given_;
  std::vector<double> sums_;
  std::vector<Work> work_;
};

}  // namespace traceur::diffusion
