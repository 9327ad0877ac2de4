// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string>
#include <utility>

#include <traceur/nn/activation.hpp>
#include <traceur/nn/dense.hpp>
#include <traceur/nn/detail/runs.hpp>
#include <traceur/nn/initializers.hpp>
#include <traceur/nn/module.hpp>
#include <traceur/nn/packed.hpp>
#include <traceur/nn/product.hpp>

namespace traceur::nn {

/// Which tokens of each sample may be looked at: tokens x samples, true where a token counts. Without columns: all of them.
using KeyMask = Eigen::Ref<const Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic>, 0, Eigen::OuterStride<>>;

/// All tokens count.
inline KeyMask no_mask() noexcept {
  return KeyMask(Eigen::Map<const Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic>>(nullptr, 0, 0));
}

/// Multi-head self-attention: Vaswani et al., "Attention Is All You Need" (NeurIPS 2017), eq. 1 and section 3.2.2. With
/// d = width / heads, head h and the tokens x_t of one sample,
///
///     q_t, k_t, v_t = rows h of  W_in x_t + b_in,     p_ij = exp(k_i . q_j / sqrt(d)) / sum_l exp(k_l . q_j / sqrt(d))
///     o_j = sum_i p_ij v_i                             y_j = W_out [o_j of all heads] + b_out
///
/// Columns are tokens, sample after sample; x and y have a whole number of samples. Samples do not see each other.
///
/// Masks leave tokens i out of both sums: `causal` those after j, `pattern` those where it is false, both for every sample;
/// a `KeyMask` those of one sample, such as padding or a condition that is dropped. A token that may look at nothing gets
/// o_j = 0. Tokens left out must be finite all the same.
///
/// Tensors, as PyTorch names them: `in_proj_weight` (q, k and v below each other), `in_proj_bias`, `out_proj.weight`,
/// `out_proj.bias`.
class Attention {
public:
  using Pattern = Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic>;

  struct Parameters {
    Eigen::Index width = 256;  ///< features of a token
    Eigen::Index heads = 4;    ///< divides the width
    Eigen::Index tokens = 80;  ///< of a sample
    bool causal = false;
    Pattern pattern;  ///< tokens x tokens, element (i, j) true where j may look at i; empty for everywhere
  };

  /// What `backward` needs of `forward`.
  template <class S>
  struct State {
    detail::Storage<S> qkv;      // 3 width x columns
    detail::Storage<S> weights;  // p, tokens x (tokens of each head of each sample)
    detail::Storage<S> mixed;    // o, width x columns
  };

  /// Memory nothing stays in between two calls: the layers of a stack share one.
  template <class S>
  struct Scratch {
    detail::Storage<S> dqkv;
    detail::Storage<S> dmixed;
    detail::Storage<S> scores;
    detail::FlatStorage<S> product;
  };

  template <class S>
  struct Workspace {
    State<S> state;
    Scratch<S> scratch;
  };

  /// Throws Error unless the heads divide the width and a pattern has the size of a sample.
  explicit Attention(Parameters p)
      : width_(p.width), heads_(p.heads), tokens_(p.tokens), allowed_(std::move(p.pattern)) {
    detail::check_positive("attention", "feature", width_);
    detail::check_positive("attention", "head", heads_);
    detail::check_positive("attention", "token", tokens_);
    if (width_ % heads_ != 0) {
      throw Error("attention: expected heads that divide the width " + std::to_string(width_) + ", got " +
                  std::to_string(heads_));
    }
    if (allowed_.size() != 0 && (allowed_.rows() != tokens_ || allowed_.cols() != tokens_)) {
      throw Error("attention: expected a pattern of " + std::to_string(tokens_) + " x " + std::to_string(tokens_) +
                  ", got " + std::to_string(allowed_.rows()) + " x " + std::to_string(allowed_.cols()));
    }
    if (p.causal) {
      if (allowed_.size() == 0) allowed_.setConstant(tokens_, tokens_, true);
      for (Eigen::Index j = 0; j < tokens_; ++j) allowed_.col(j).tail(tokens_ - j - 1).setConstant(false);
    }
  }

  Eigen::Index inputs() const noexcept { return width_; }
  Eigen::Index outputs() const noexcept { return width_; }
  Eigen::Index heads() const noexcept { return heads_; }
  Eigen::Index tokens() const noexcept { return tokens_; }
  Eigen::Index parameters() const noexcept { return 4 * width_ * (width_ + 1); }

  template <class S>
  State<S> state(Eigen::Index max_columns) const {
    return {{3 * width_, max_columns}, {tokens_, heads_ * max_columns}, {width_, max_columns}};
  }

  template <class S>
  Scratch<S> scratch(Eigen::Index max_columns) const {
    const Eigen::Index whole = product_scratch<S>(3 * width_, width_), head = product_scratch<S>(depth(), tokens_);
    return {{3 * width_, max_columns},
            {width_, max_columns},
            {tokens_, tokens_},
            detail::FlatStorage<S>(whole > head ? whole : head)};
  }

  template <class S>
  Workspace<S> workspace(Eigen::Index max_columns) const {
    return {state<S>(max_columns), scratch<S>(max_columns)};
  }

  template <class S>
  void forward(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    run<true, S>(theta, x, no_mask(), w.state, w.scratch, y);
  }

  template <class S>
  void forward(const S* theta, ConstMatrix<S> x, KeyMask keys, Workspace<S>& w, Matrix<S> y) const noexcept {
    run<true, S>(theta, x, keys, w.state, w.scratch, y);
  }

  template <class S>
  void forward(const S* theta, ConstMatrix<S> x, KeyMask keys, State<S>& state, Scratch<S>& scratch,
               Matrix<S> y) const noexcept {
    run<true, S>(theta, x, keys, state, scratch, y);
  }

  template <class S>
  void infer(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    run<false, S>(theta, x, no_mask(), w.state, w.scratch, y);
  }

  template <class S>
  void infer(const S* theta, ConstMatrix<S> x, KeyMask keys, Workspace<S>& w, Matrix<S> y) const noexcept {
    run<false, S>(theta, x, keys, w.state, w.scratch, y);
  }

  template <class S>
  void infer(const S* theta, ConstMatrix<S> x, KeyMask keys, State<S>& state, Scratch<S>& scratch,
             Matrix<S> y) const noexcept {
    run<false, S>(theta, x, keys, state, scratch, y);
  }

  /// Weights in the form products work on, for those that use them again and again.
  template <class S>
  struct Packed {
    PackedMatrix<S> queries, others, out;
  };
  template <class S>
  Packed<S> packed() const {
    return {{width_, width_}, {2 * width_, width_}, {width_, width_}};
  }
  template <class S>
  void pack(const S* theta, Packed<S>& p) const noexcept {
    const ConstMatrix<S> in = detail::weight_matrix<S>(theta, 3 * width_, width_);
    p.queries.pack(in.topRows(width_));
    p.others.pack(in.bottomRows(2 * width_));
    p.out.pack(detail::weight_matrix<S>(theta + out_weight(), width_, width_));
  }

  /// q, k and v of every column, below each other: 3 width x columns. They depend on nothing but the column, so those of
  /// tokens that stay the same need computing only once.
  template <class S>
  void project(const S* theta, const Packed<S>& p, ConstMatrix<S> x, Matrix<S> qkv) const noexcept {
    p.queries.multiply(x, qkv.topRows(width_), Into::set, theta + in_bias());
    p.others.multiply(x, qkv.bottomRows(2 * width_), Into::set, theta + in_bias() + width_);
  }

  /// As `project` of whole samples, but q of the tokens from `from` on only; the others' keep what they hold.
  template <class S>
  void project(const S* theta, const Packed<S>& p, ConstMatrix<S> x, Eigen::Index from, Matrix<S> qkv) const noexcept {
    assert(x.cols() % tokens_ == 0);
    if (from == 0) return project(theta, p, x, qkv);
    for (Eigen::Index first = from; first < x.cols(); first += tokens_) {
      p.queries.multiply(x.middleCols(first, tokens_ - from), qkv.block(0, first, width_, tokens_ - from), Into::set,
                         theta + in_bias());
    }
    p.others.multiply(x, qkv.bottomRows(2 * width_), Into::set, theta + in_bias() + width_);
  }

  /// As `infer`, from q, k and v of all tokens, for the tokens from `from` on of every sample only: y has tokens() - from
  /// columns a sample.
  template <class S>
  void infer_projected(const S* theta, const Packed<S>& p, ConstMatrix<S> qkv, KeyMask keys, Eigen::Index from,
                       State<S>& state, Scratch<S>& scratch, Matrix<S> y) const noexcept {
    p.out.multiply(attend<false, S>(qkv, keys, from, state, scratch), y, Into::set, theta + out_bias());
  }

  /// Of whichever mask `forward` had: what was left out has weight zero.
  template <class S>
  void backward(const S* theta, ConstMatrix<S> x, ConstMatrix<S> dy, Workspace<S>& w, S* dtheta,
                Matrix<S> dx) const noexcept {
    backward(theta, x, dy, w.state, w.scratch, dtheta, dx);
  }

  template <class S>
  void backward(const S* theta, ConstMatrix<S> x, ConstMatrix<S> dy, State<S>& state, Scratch<S>& scratch, S* dtheta,
                Matrix<S> dx) const noexcept {
    const Eigen::Index n = x.cols();
    S* const work = scratch.product.data();
    const S scale = score_scale<S>();
    const ConstMatrix<S> w_in = detail::weight_matrix<S>(theta, 3 * width_, width_);
    const ConstMatrix<S> w_out = detail::weight_matrix<S>(theta + out_weight(), width_, width_);
    const Matrix<S> dw_in = detail::weight_matrix<S>(dtheta, 3 * width_, width_);
    const Matrix<S> dw_out = detail::weight_matrix<S>(dtheta + out_weight(), width_, width_);

    outer_product<S>(dy, state.mixed.leftCols(n), dw_out, work);
    detail::add_columns<S>(dy, dtheta + out_bias());
    transposed_product<S>(w_out, dy, scratch.dmixed.leftCols(n), work);

    scratch.dqkv.leftCols(n).setZero();
    for (Eigen::Index sample = 0; sample < n / tokens_; ++sample) {
      for (Eigen::Index h = 0; h < heads_; ++h) {
        const auto p = state.weights.middleCols((sample * heads_ + h) * tokens_, tokens_);
        const auto dout = scratch.dmixed.block(h * depth(), sample * tokens_, depth(), tokens_);
        transposed_product<S>(head(state.qkv, 2, h, sample), dout, scratch.scores, work);
        for (Eigen::Index j = 0; j < tokens_; ++j) {
          const S* const weight = p.col(j).data();
          S* const score = scratch.scores.col(j).data();
          core::Pack<S> total(S(0));
          detail::for_each_run<S>(tokens_, [&](auto run) { total += run.load(weight) * run.load(score); });
          const core::Pack<S> mean(detail::sum(total)), factor(scale);
          detail::for_each_run<S>(tokens_, [&](auto run) {
            run.store(score, run.load(weight) * (run.load(score) - mean) * factor);
          });
        }
        outer_product<S>(dout, p, head(scratch.dqkv, 2, h, sample), work);
        product<S>(head(state.qkv, 1, h, sample), scratch.scores, head(scratch.dqkv, 0, h, sample), work);
        outer_product<S>(head(state.qkv, 0, h, sample), scratch.scores, head(scratch.dqkv, 1, h, sample), work);
      }
    }

    outer_product<S>(scratch.dqkv.leftCols(n), x, dw_in, work);
    detail::add_columns<S>(scratch.dqkv.leftCols(n), dtheta + in_bias());
    if (dx.cols() > 0) transposed_product<S>(w_in, scratch.dqkv.leftCols(n), dx, work);
  }

  /// As PyTorch does: uniform with variance 2 / (fan-in + fan-out) of the whole of W_in, 1 / (3 fan-in) of W_out; biases 0.
  template <class S>
  void initialize(S* theta, core::RandomStream& random) const {
    Glorot{}(theta, 3 * width_, width_, random);
    Zeros{}(theta + in_bias(), 3 * width_, 1, random);
    UniformFanIn{}(theta + out_weight(), width_, width_, random);
    Zeros{}(theta + out_bias(), width_, 1, random);
  }

  template <class F>
  void for_each_parameter(F&& f) const {
    f("in_proj_weight", Eigen::Index{0}, 3 * width_, width_);
    f("in_proj_bias", in_bias(), 3 * width_, Eigen::Index{1});
    f("out_proj.weight", out_weight(), width_, width_);
    f("out_proj.bias", out_bias(), width_, Eigen::Index{1});
  }

private:
  Eigen::Index depth() const noexcept { return width_ / heads_; }
  Eigen::Index in_bias() const noexcept { return 3 * width_ * width_; }
  Eigen::Index out_weight() const noexcept { return in_bias() + 3 * width_; }
  Eigen::Index out_bias() const noexcept { return out_weight() + width_ * width_; }
  template <class S>
  S score_scale() const noexcept {
    return S(1) / std::sqrt(static_cast<S>(depth()));
  }

  // Queries (0), keys (1) or values (2) of a head of a sample.
  template <class M>
  auto head(M& qkv, Eigen::Index which, Eigen::Index h, Eigen::Index sample) const noexcept {
    return qkv.block(which * width_ + h * depth(), sample * tokens_, depth(), tokens_);
  }

  template <bool keep, class S>
  void run(const S* theta, ConstMatrix<S> x, KeyMask keys, State<S>& state, Scratch<S>& scratch,
           Matrix<S> y) const noexcept {
    S* const work = scratch.product.data();
    Matrix<S> qkv = state.qkv.leftCols(x.cols());
    product<S>(detail::weight_matrix<S>(theta, 3 * width_, width_), x, qkv, work, Into::set, theta + in_bias());
    const ConstMatrix<S> mixed = attend<keep, S>(qkv, keys, 0, state, scratch);
    product<S>(detail::weight_matrix<S>(theta + out_weight(), width_, width_), mixed, y, work, Into::set,
               theta + out_bias());
  }

  // From q, k and v of all tokens to o, that of the tokens from `from` on of every sample.
  template <bool keep, class S>
  ConstMatrix<S> attend(ConstMatrix<S> qkv, KeyMask keys, Eigen::Index from, State<S>& state,
                        Scratch<S>& scratch) const noexcept {
    const Eigen::Index samples = qkv.cols() / tokens_, asking = tokens_ - from;
    assert(qkv.cols() % tokens_ == 0 && (keys.cols() == 0 || (keys.rows() == tokens_ && keys.cols() == samples)));
    S* const work = scratch.product.data();
    for (Eigen::Index sample = 0; sample < samples; ++sample) {
      for (Eigen::Index h = 0; h < heads_; ++h) {
        // Weights nobody asks for again stay in the nearest cache.
        Matrix<S> p = keep ? Matrix<S>(state.weights.middleCols((sample * heads_ + h) * tokens_, tokens_))
                           : Matrix<S>(scratch.scores.leftCols(asking));
        transposed_product<S>(head(qkv, 1, h, sample), head(qkv, 0, h, sample).rightCols(asking), p, work);
        soften<S>(p, keys, sample, from);
        product<S>(head(qkv, 2, h, sample), p, state.mixed.block(h * depth(), sample * asking, depth(), asking), work);
      }
    }
    return state.mixed.leftCols(samples * asking);
  }

  // Scores to weights, column by column; the first column is token `from`'s.
  template <class S>
  void soften(Matrix<S> p, const KeyMask& keys, Eigen::Index sample, Eigen::Index from) const noexcept {
    using P = core::Pack<S>;
    constexpr S never = -std::numeric_limits<S>::infinity();
    const P scale(score_scale<S>());
    for (Eigen::Index j = 0; j < p.cols(); ++j) {
      S* const score = p.data() + j * p.outerStride();
      if (keys.cols() > 0) leave_out(score, &keys.coeffRef(0, sample));
      if (allowed_.size() > 0) leave_out(score, &allowed_.coeffRef(0, from + j));
      P best(never);
      detail::for_each_run<S>(tokens_, [&](auto run) {
        const P values = run.inside(run.load(score), never);
        best = select(values > best, values, best);
      });
      const S most = detail::largest(best);
      if (most == never) {
        for (Eigen::Index i = 0; i < tokens_; ++i) score[i] = S(0);
        continue;
      }
      P total(0);
      detail::for_each_run<S>(tokens_, [&](auto run) {
        const P values = run.load(score);
        const P weights = run.inside(select(values == P(never), P(0), bounded_exp((values - P(most)) * scale)));
        total += weights;
        run.store(score, weights);
      });
      const P share(S(1) / detail::sum(total));
      detail::for_each_run<S>(tokens_, [&](auto run) { run.store(score, run.load(score) * share); });
    }
  }

  // Eight tokens at a time, as most of them count.
  template <class S>
  void leave_out(S* score, const bool* counts) const noexcept {
    constexpr std::uint64_t all = 0x0101010101010101u;
    for (Eigen::Index first = 0; first < tokens_; first += 8) {
      const Eigen::Index end = std::min<Eigen::Index>(first + 8, tokens_);
      std::uint64_t eight = all;
      std::memcpy(&eight, counts + first, static_cast<std::size_t>(end - first));
      if (eight == all) continue;
      for (Eigen::Index i = first; i < end; ++i) {
        if (!counts[i]) score[i] = -std::numeric_limits<S>::infinity();
      }
    }
  }

  Eigen::Index width_;
  Eigen::Index heads_;
  Eigen::Index tokens_;
  Pattern allowed_;
};

}  // namespace traceur::nn
