// SPDX-License-Identifier: MIT
#pragma once

#include <cassert>
#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <traceur/core/error.hpp>
#include <traceur/core/random.hpp>
#include <traceur/diffusion/denoiser.hpp>
#include <traceur/nn/activation.hpp>
#include <traceur/nn/mlp.hpp>
#include <traceur/nn/module.hpp>
#include <traceur/nn/positions.hpp>

namespace traceur::diffusion {

/// A part of a condition as a network sees it: so many rows, next after those of the part before.
struct ConditionPart {
  Eigen::Index rows = 0;
  Parts needs = 1;  ///< it counts where all of these are given
};

/// A small denoising network: one multi-layer perceptron of the noisy sample, the condition and the step,
///
///     clean = MLP(x, m_1 c_1, m_1, m_2 c_2, m_2, ..., e(k))
///
/// with m_p 1 where part p of the condition is given and 0 where it is not, and e the sinusoids of the step. For data of a
/// few dimensions, and to show that a generator is replaceable (PARC, appendix D, Fig. 18).
///
/// Tensors: those of `nn::Mlp`.
template <nn::Activation A = nn::Silu>
class MlpDenoiser {
public:
  struct Parameters {
    Eigen::Index features = 2;
    std::vector<ConditionPart> condition = {};
    std::vector<Eigen::Index> hidden = {128, 128, 128};
    Eigen::Index step_features = 32;  ///< even
  };

  template <class S>
  struct Workspace {
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> input, step;
    nn::WorkspaceOf<nn::StepEmbedding, S> embedding;
    nn::WorkspaceOf<nn::Mlp<A>, S> mlp;
    Eigen::Index samples = 0;
  };
  template <class S>
  struct Prepared {
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> values;
    std::vector<Parts> given;
  };
  template <class S>
  using Scratch = Workspace<S>;

  /// Throws Error if a number of rows or a width is below 1, or step_features is odd.
  explicit MlpDenoiser(Parameters p) : p_(std::move(p)), embedding_(p_.step_features), mlp_(widths(p_)) {
    for (const ConditionPart& part : p_.condition) condition_features_ += part.rows;
  }

  Eigen::Index features() const noexcept { return p_.features; }
  Eigen::Index condition_features() const noexcept { return condition_features_; }
  Eigen::Index parameters() const noexcept { return mlp_.parameters(); }

  template <class S>
  Workspace<S> workspace(Eigen::Index max_samples) const {
    nn::detail::check_positive("mlp denoiser workspace", "sample", max_samples);
    return {{mlp_.inputs(), max_samples},
            {1, max_samples},
            embedding_.template workspace<S>(max_samples),
            mlp_.template workspace<S>(max_samples),
            0};
  }
  template <class S>
  Prepared<S> prepared(Eigen::Index max_samples) const {
    return {{condition_features_, max_samples}, std::vector<Parts>(static_cast<std::size_t>(max_samples))};
  }
  template <class S>
  Scratch<S> scratch(Eigen::Index max_samples) const {
    return workspace<S>(max_samples);
  }

  /// Estimates of samples at the steps `steps`, one a column. Keeps in w what `backward` needs.
  template <class S>
  void forward(const S* theta, const int* steps, nn::ConstMatrix<S> x, const Condition<S>& condition, Workspace<S>& w,
               nn::Matrix<S> y) const noexcept {
    const Eigen::Index n = w.samples = x.cols();
    for (Eigen::Index j = 0; j < n; ++j) w.step(0, j) = static_cast<S>(steps[j]);
    assemble<S>(x, condition.values, [&](Eigen::Index j) { return condition.parts(j); }, w);
    mlp_.forward(theta, w.input.leftCols(n), w.mlp, y);
  }

  /// Adds to dtheta the gradient of what `forward` wrote last.
  template <class S>
  void backward(const S* theta, nn::ConstMatrix<S> dy, Workspace<S>& w, S* dtheta) const noexcept {
    assert(dy.cols() == w.samples);
    mlp_.backward(theta, w.input.leftCols(w.samples), dy, w.mlp, dtheta, nn::no_gradient<S>());
  }

  template <class S>
  void load(const S*, Prepared<S>&) const noexcept {}

  template <class S>
  void prepare(const S*, const Condition<S>& condition, Eigen::Index first, Scratch<S>&,
               Prepared<S>& prepared) const noexcept {
    for (Eigen::Index j = 0; j < condition.values.cols(); ++j) {
      prepared.values.col(first + j) = condition.values.col(j);
      prepared.given[static_cast<std::size_t>(first + j)] = condition.parts(j);
    }
  }

  template <class S>
  void infer(const S* theta, int step, nn::ConstMatrix<S> x, const Prepared<S>& prepared, Eigen::Index first,
             Parts without, Scratch<S>& w, nn::Matrix<S> y) const noexcept {
    const Eigen::Index n = x.cols();
    w.step.leftCols(n).setConstant(static_cast<S>(step));
    assemble<S>(
        x, prepared.values.middleCols(first, n),
        [&](Eigen::Index j) { return prepared.given[static_cast<std::size_t>(first + j)] & ~without; }, w);
    mlp_.infer(theta, w.input.leftCols(n), w.mlp, y);
  }

  template <class S>
  void initialize(S* theta, core::RandomStream& random) const {
    mlp_.initialize(theta, random);
  }

  template <class F>
  void for_each_parameter(F&& f) const {
    mlp_.for_each_parameter(f);
  }

private:
  static std::vector<Eigen::Index> widths(const Parameters& p) {
    nn::detail::check_positive("mlp denoiser", "feature", p.features);
    std::vector<Eigen::Index> out{p.features + p.step_features};
    for (const ConditionPart& part : p.condition) {
      nn::detail::check_positive("mlp denoiser", "row of a part of the condition", part.rows);
      out[0] += part.rows + 1;
    }
    out.insert(out.end(), p.hidden.begin(), p.hidden.end());
    out.push_back(p.features);
    return out;
  }

  // w.input from the samples, their condition and w.step.
  template <class S, class Given>
  void assemble(nn::ConstMatrix<S> x, nn::ConstMatrix<S> condition, Given&& given, Workspace<S>& w) const noexcept {
    const Eigen::Index n = x.cols();
    w.input.topLeftCorner(p_.features, n) = x;
    for (Eigen::Index j = 0; j < n; ++j) {
      Eigen::Index row = p_.features, from = 0;
      for (const ConditionPart& part : p_.condition) {
        const bool counts = (given(j) & part.needs) == part.needs;
        if (counts) {
          w.input.col(j).segment(row, part.rows) = condition.col(j).segment(from, part.rows);
        } else {
          w.input.col(j).segment(row, part.rows).setZero();
        }
        w.input(row + part.rows, j) = counts ? S(1) : S(0);
        row += part.rows + 1;
        from += part.rows;
      }
    }
    embedding_.infer(static_cast<const S*>(nullptr), w.step.leftCols(n), w.embedding,
                     w.input.bottomRows(p_.step_features).leftCols(n));
  }

  Parameters p_;
  nn::StepEmbedding embedding_;
  nn::Mlp<A> mlp_;
  Eigen::Index condition_features_ = 0;
};

}  // namespace traceur::diffusion
