// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <traceur/nn/activation.hpp>
#include <traceur/nn/attention.hpp>
#include <traceur/nn/dense.hpp>
#include <traceur/nn/initializers.hpp>
#include <traceur/nn/layer_norm.hpp>
#include <traceur/nn/module.hpp>
#include <traceur/nn/packed.hpp>
#include <traceur/nn/product.hpp>

namespace traceur::nn {

/// Where the layer norms of a transformer stand.
enum class NormOrder {
  before,  ///< before attention and feed-forward, beside the residual path: Xiong et al. 2020; trains without warm-up
  after,   ///< on the residual path, after each sum: Vaswani et al. 2017
};

struct TransformerLayerParameters {
  Attention::Parameters attention;
  Eigen::Index feed_forward = 1024;  ///< hidden features of the feed-forward network
  NormOrder norm = NormOrder::before;
};

/// One layer of a transformer encoder: self-attention, then the same two-layer network for every token, each beside a
/// residual path:
///
///     before:  a = x + attention(norm1(x)),    y = a + W_2 A(W_1 norm2(a) + b_1) + b_2
///     after:   a = norm1(x + attention(x)),    y = norm2(a + W_2 A(W_1 a + b_1) + b_2)
///
/// Xiong et al., "On Layer Normalization in the Transformer Architecture" (ICML 2020), table 1. Columns are tokens, sample
/// after sample, and masks are those of `Attention`.
///
/// Tensors, as PyTorch's TransformerEncoderLayer names them: `self_attn.*`, `linear1.*`, `linear2.*`, `norm1.*`, `norm2.*`.
template <Activation A = Gelu>
class TransformerLayer {
public:
  /// What `backward` needs of `forward`.
  template <class S>
  struct State {
    Attention::State<S> attention;
    LayerNorm::Workspace<S> norm1;
    LayerNorm::Workspace<S> norm2;
    detail::Storage<S> first;      // input of the attention (before) or of norm1 (after)
    detail::Storage<S> middle;     // a
    detail::Storage<S> second;     // input of the feed-forward (before) or of norm2 (after)
    detail::Storage<S> hidden;     // before A, if its derivative reads that
    detail::Storage<S> activated;  // after A
  };

  /// Memory nothing stays in between two calls: the layers of a stack share one.
  template <class S>
  struct Scratch {
    Attention::Scratch<S> attention;
    detail::Storage<S> gradient;
    detail::Storage<S> other;
    detail::Storage<S> dhidden;
    detail::FlatStorage<S> product;
  };

  template <class S>
  struct Workspace {
    State<S> state;
    Scratch<S> scratch;
  };

  /// Throws Error as `Attention` does, or if there is no hidden feature.
  explicit TransformerLayer(const TransformerLayerParameters& p)
      : attention_(p.attention),
        linear1_(p.attention.width, p.feed_forward),
        linear2_(p.feed_forward, p.attention.width),
        norm1_(p.attention.width),
        norm2_(p.attention.width),
        order_(p.norm) {}

  Eigen::Index inputs() const noexcept { return attention_.inputs(); }
  Eigen::Index outputs() const noexcept { return attention_.inputs(); }
  Eigen::Index tokens() const noexcept { return attention_.tokens(); }
  Eigen::Index parameters() const noexcept { return at_norm2() + norm2_.parameters(); }

  template <class S>
  State<S> state(Eigen::Index max_columns) const {
    const Eigen::Index width = inputs(), hidden = linear1_.outputs();
    return {attention_.template state<S>(max_columns),
            norm1_.template workspace<S>(max_columns),
            norm2_.template workspace<S>(max_columns),
            {width, max_columns},
            {width, max_columns},
            {width, max_columns},
            {A::reads_output ? 0 : hidden, A::reads_output ? 0 : max_columns},
            {hidden, max_columns}};
  }

  template <class S>
  Scratch<S> scratch(Eigen::Index max_columns) const {
    const Eigen::Index width = inputs(), hidden = linear1_.outputs();
    const Eigen::Index up = product_scratch<S>(hidden, width), down = product_scratch<S>(width, hidden);
    return {attention_.template scratch<S>(max_columns),
            {width, max_columns},
            {width, max_columns},
            {hidden, max_columns},
            detail::FlatStorage<S>(up > down ? up : down)};
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
    Attention::Packed<S> attention;
    PackedMatrix<S> linear1, linear2;
  };
  template <class S>
  Packed<S> packed() const {
    return {attention_.template packed<S>(), {linear1_.outputs(), inputs()}, {inputs(), linear1_.outputs()}};
  }
  template <class S>
  void pack(const S* theta, Packed<S>& p) const noexcept {
    const Feed<const S> f = feed(theta);
    attention_.pack(theta, p.attention);
    p.linear1.pack(detail::weight_matrix<S>(f.weight1, linear1_.outputs(), inputs()));
    p.linear2.pack(detail::weight_matrix<S>(f.weight2, inputs(), linear1_.outputs()));
  }

  /// What the layer makes of each token by itself: `Attention::project` of x, or of its norm.
  template <class S>
  void project(const S* theta, const Packed<S>& p, ConstMatrix<S> x, State<S>& state, Matrix<S> qkv) const noexcept {
    attention_.project(theta, p.attention, to_project(theta, x, state), qkv);
  }
  template <class S>
  void project(const S* theta, const Packed<S>& p, ConstMatrix<S> x, Eigen::Index from, State<S>& state,
               Matrix<S> qkv) const noexcept {
    attention_.project(theta, p.attention, to_project(theta, x, state), from, qkv);
  }

  /// As `infer`, given `project` of x, for the tokens from `from` on of every sample only: y has tokens() - from columns a
  /// sample.
  template <class S>
  void infer_projected(const S* theta, const Packed<S>& p, ConstMatrix<S> x, ConstMatrix<S> qkv, KeyMask keys,
                       Eigen::Index from, State<S>& state, Scratch<S>& scratch, Matrix<S> y) const noexcept {
    const Eigen::Index samples = x.cols() / tokens(), asking = tokens() - from, n = samples * asking;
    Matrix<S> first = state.first.leftCols(n), middle = state.middle.leftCols(n), second = state.second.leftCols(n);
    Matrix<S> sum = order_ == NormOrder::before ? middle : first;
    attention_.infer_projected(theta, p.attention, qkv, keys, from, state.attention, scratch.attention, sum);
    for (Eigen::Index sample = 0; sample < samples; ++sample) {
      sum.middleCols(sample * asking, asking) += x.middleCols(sample * tokens() + from, asking);
    }
    // to = beside + W_2 A(W_1 in + b_1) + b_2
    const auto feed_packed = [&](ConstMatrix<S> in, ConstMatrix<S> beside, Matrix<S> to) {
      const Feed<const S> f = feed(theta);
      Matrix<S> hidden = state.activated.leftCols(n);
      p.linear1.multiply(in, hidden, Into::set, f.bias1, [&](Eigen::Index begin, Eigen::Index count) {
        activate<A, S>(hidden.middleCols(begin, count), hidden.middleCols(begin, count));
      });
      to = beside.colwise() + Eigen::Map<const detail::FlatStorage<S>>(f.bias2, inputs());
      p.linear2.multiply(hidden, to, Into::add);
    };
    if (order_ == NormOrder::before) {
      norm2_.forward(theta + at_norm2(), middle, state.norm2, second);
      feed_packed(second, middle, y);
    } else {
      norm1_.forward(theta + at_norm1(), first, state.norm1, middle);
      feed_packed(middle, middle, second);
      norm2_.forward(theta + at_norm2(), second, state.norm2, y);
    }
  }

  template <class S>
  void backward(const S* theta, ConstMatrix<S> x, ConstMatrix<S> dy, Workspace<S>& w, S* dtheta,
                Matrix<S> dx) const noexcept {
    backward(theta, x, dy, w.state, w.scratch, dtheta, dx);
  }

  /// dx may be dy.
  template <class S>
  void backward(const S* theta, ConstMatrix<S> x, ConstMatrix<S> dy, State<S>& state, Scratch<S>& scratch, S* dtheta,
                Matrix<S> dx) const noexcept {
    const Eigen::Index n = x.cols();
    Matrix<S> gradient = scratch.gradient.leftCols(n), other = scratch.other.leftCols(n);
    const bool wanted = dx.cols() > 0;
    if (order_ == NormOrder::before) {
      feed_backward<S>(theta, state.second.leftCols(n), dy, state, scratch, dtheta, other);
      norm2_.backward(theta + at_norm2(), state.middle.leftCols(n), other, state.norm2, dtheta + at_norm2(), gradient);
      gradient += dy;
      attention_.backward(theta, state.first.leftCols(n), gradient, state.attention, scratch.attention, dtheta, other);
      norm1_.backward(theta + at_norm1(), x, other, state.norm1, dtheta + at_norm1(), wanted ? other : no_gradient<S>());
      if (wanted) dx = gradient + other;
    } else {
      norm2_.backward(theta + at_norm2(), state.second.leftCols(n), dy, state.norm2, dtheta + at_norm2(), gradient);
      feed_backward<S>(theta, state.middle.leftCols(n), gradient, state, scratch, dtheta, other);
      other += gradient;
      norm1_.backward(theta + at_norm1(), state.first.leftCols(n), other, state.norm1, dtheta + at_norm1(), gradient);
      attention_.backward(theta, x, gradient, state.attention, scratch.attention, dtheta, dx);
      if (wanted) dx += gradient;
    }
  }

  /// As `Attention`, `Dense` and `LayerNorm` do.
  template <class S>
  void initialize(S* theta, core::RandomStream& random) const {
    attention_.initialize(theta, random);
    linear1_.initialize(theta + at_linear1(), random);
    linear2_.initialize(theta + at_linear2(), random);
    norm1_.initialize(theta + at_norm1(), random);
    norm2_.initialize(theta + at_norm2(), random);
  }

  template <class F>
  void for_each_parameter(F&& f) const {
    for_each_parameter_of(attention_, "self_attn", 0, f);
    for_each_parameter_of(linear1_, "linear1", at_linear1(), f);
    for_each_parameter_of(linear2_, "linear2", at_linear2(), f);
    for_each_parameter_of(norm1_, "norm1", at_norm1(), f);
    for_each_parameter_of(norm2_, "norm2", at_norm2(), f);
  }

private:
  Eigen::Index at_linear1() const noexcept { return attention_.parameters(); }
  Eigen::Index at_linear2() const noexcept { return at_linear1() + linear1_.parameters(); }
  Eigen::Index at_norm1() const noexcept { return at_linear2() + linear2_.parameters(); }
  Eigen::Index at_norm2() const noexcept { return at_norm1() + norm1_.parameters(); }

  template <class S>
  ConstMatrix<S> to_project(const S* theta, ConstMatrix<S> x, State<S>& state) const noexcept {
    if (order_ == NormOrder::after) return x;
    Matrix<S> first = state.first.leftCols(x.cols());
    norm1_.forward(theta + at_norm1(), x, state.norm1, first);
    return first;
  }

  // Weights of the feed-forward network, or their gradients.
  template <class S>
  struct Feed {
    S *weight1, *bias1, *weight2, *bias2;
  };
  template <class S>
  Feed<S> feed(S* theta) const noexcept {
    S* const first = theta + at_linear1();
    S* const second = theta + at_linear2();
    const Eigen::Index size = inputs() * linear1_.outputs();
    return {first, first + size, second, second + size};
  }

  template <bool keep, class S>
  void run(const S* theta, ConstMatrix<S> x, KeyMask keys, State<S>& state, Scratch<S>& scratch,
           Matrix<S> y) const noexcept {
    const Eigen::Index n = x.cols();
    Matrix<S> first = state.first.leftCols(n), middle = state.middle.leftCols(n), second = state.second.leftCols(n);
    const auto attend = [&](ConstMatrix<S> in, Matrix<S> out) {
      if constexpr (keep) {
        attention_.forward(theta, in, keys, state.attention, scratch.attention, out);
      } else {
        attention_.infer(theta, in, keys, state.attention, scratch.attention, out);
      }
      out += x;
    };
    if (order_ == NormOrder::before) {
      norm1_.forward(theta + at_norm1(), x, state.norm1, first);
      attend(first, middle);
      norm2_.forward(theta + at_norm2(), middle, state.norm2, second);
      feed_forward<keep, S>(theta, second, middle, state, scratch, y);
    } else {
      attend(x, first);
      norm1_.forward(theta + at_norm1(), first, state.norm1, middle);
      feed_forward<keep, S>(theta, middle, middle, state, scratch, second);
      norm2_.forward(theta + at_norm2(), second, state.norm2, y);
    }
  }

  // y = beside + W_2 A(W_1 x + b_1) + b_2
  template <bool keep, class S>
  void feed_forward(const S* theta, ConstMatrix<S> x, ConstMatrix<S> beside, State<S>& state, Scratch<S>& scratch,
                    Matrix<S> y) const noexcept {
    const Eigen::Index n = x.cols(), hidden = linear1_.outputs();
    const Feed<const S> p = feed(theta);
    Matrix<S> activated = state.activated.leftCols(n);
    Matrix<S> kept = A::reads_output ? activated : Matrix<S>(state.hidden.leftCols(n));
    detail::dense_forward<A, keep, S>(detail::weight_matrix<S>(p.weight1, hidden, inputs()), p.bias1, x, kept, activated,
                                      scratch.product.data());
    y = beside.colwise() + Eigen::Map<const detail::FlatStorage<S>>(p.bias2, inputs());
    product<S>(detail::weight_matrix<S>(p.weight2, inputs(), hidden), activated, y, scratch.product.data(), Into::add);
  }

  // x is the network's input; dx its gradient without that of the path beside.
  template <class S>
  void feed_backward(const S* theta, ConstMatrix<S> x, ConstMatrix<S> dy, State<S>& state, Scratch<S>& scratch, S* dtheta,
                     Matrix<S> dx) const noexcept {
    const Eigen::Index n = x.cols(), hidden = linear1_.outputs();
    const Feed<const S> p = feed(theta);
    const Feed<S> d = feed(dtheta);
    S* const work = scratch.product.data();
    Matrix<S> activated = state.activated.leftCols(n), dhidden = scratch.dhidden.leftCols(n);
    detail::dense_backward<S>(detail::weight_matrix<S>(p.weight2, inputs(), hidden), activated, dy,
                              detail::weight_matrix<S>(d.weight2, inputs(), hidden), d.bias2, dhidden, work);
    const auto& kept = A::reads_output ? state.activated : state.hidden;
    activate_backward<A, S>(kept.leftCols(n), dhidden, dhidden);
    detail::dense_backward<S>(detail::weight_matrix<S>(p.weight1, hidden, inputs()), x, dhidden,
                              detail::weight_matrix<S>(d.weight1, hidden, inputs()), d.bias1, dx, work);
  }

  Attention attention_;
  Dense<> linear1_;
  Dense<> linear2_;
  LayerNorm norm1_;
  LayerNorm norm2_;
  NormOrder order_;
};

struct TransformerParameters {
  Eigen::Index layers = 4;
  TransformerLayerParameters layer;
  bool final_norm = true;  ///< a last layer norm; with `NormOrder::after` there is one already
};

/// A stack of transformer encoder layers of the same shape, each with parameters of its own. Columns are tokens, sample
/// after sample; positions and kinds of tokens are added before (see `SinusoidalPositions`): to the stack itself, tokens are
/// a set.
///
/// `forward` keeps what `backward` needs of every layer: per column 2 feed_forward + 8 width + heads * tokens numbers, one
/// feed_forward less where A's derivative is read from its output.
///
/// Tensors: `layers.0.*` and so on, and `norm.*` if there is a last norm, as PyTorch's TransformerEncoder names them.
template <Activation A = Gelu>
class Transformer {
public:
  template <class S>
  struct Workspace {
    std::vector<typename TransformerLayer<A>::template State<S>> layers;
    std::vector<detail::Storage<S>> between;  // outputs of the layers that something follows
    LayerNorm::Workspace<S> norm;
    typename TransformerLayer<A>::template Scratch<S> scratch;
    detail::Storage<S> gradient;
  };

  /// Throws Error as `TransformerLayer` does, or if there is no layer.
  explicit Transformer(const TransformerParameters& p)
      : count_(p.layers), layer_(p.layer), norm_(p.layer.attention.width), final_norm_(p.final_norm) {
    detail::check_positive("transformer", "layer", count_);
  }

  Eigen::Index inputs() const noexcept { return layer_.inputs(); }
  Eigen::Index outputs() const noexcept { return layer_.outputs(); }
  Eigen::Index layers() const noexcept { return count_; }
  Eigen::Index tokens() const noexcept { return layer_.tokens(); }
  Eigen::Index parameters() const noexcept { return at_norm() + (final_norm_ ? norm_.parameters() : 0); }

  template <class S>
  Workspace<S> workspace(Eigen::Index max_columns) const {
    Workspace<S> w;
    for (Eigen::Index l = 0; l < count_; ++l) {
      w.layers.push_back(layer_.template state<S>(max_columns));
      if (l + 1 < count_ || final_norm_) w.between.emplace_back(outputs(), max_columns);
    }
    w.norm = norm_.template workspace<S>(max_columns);
    w.scratch = layer_.template scratch<S>(max_columns);
    w.gradient.resize(outputs(), max_columns);
    return w;
  }

  /// A workspace for `infer`, `project` and `infer_projected` only: the memory of one layer.
  template <class S>
  Workspace<S> inference_workspace(Eigen::Index max_columns) const {
    Workspace<S> w;
    w.layers.push_back(layer_.template state<S>(max_columns));
    for (int i = 0; i < 2; ++i) w.between.emplace_back(outputs(), max_columns);
    w.norm = norm_.template workspace<S>(max_columns);
    w.scratch = layer_.template scratch<S>(max_columns);
    return w;
  }

  template <class S>
  void forward(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    forward(theta, x, no_mask(), w, y);
  }

  template <class S>
  void forward(const S* theta, ConstMatrix<S> x, KeyMask keys, Workspace<S>& w, Matrix<S> y) const noexcept {
    const Eigen::Index n = x.cols();
    for (Eigen::Index l = 0; l < count_; ++l) {
      const auto i = static_cast<std::size_t>(l);
      layer_.forward(theta + l * layer_.parameters(), l == 0 ? x : ConstMatrix<S>(w.between[i - 1].leftCols(n)), keys,
                     w.layers[i], w.scratch, i < w.between.size() ? Matrix<S>(w.between[i].leftCols(n)) : y);
    }
    if (final_norm_) norm_.forward(theta + at_norm(), w.between.back().leftCols(n), w.norm, y);
  }

  template <class S>
  void infer(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    infer(theta, x, no_mask(), w, y);
  }

  /// All layers in the memory of one.
  template <class S>
  void infer(const S* theta, ConstMatrix<S> x, KeyMask keys, Workspace<S>& w, Matrix<S> y) const noexcept {
    const Eigen::Index n = x.cols();
    for (Eigen::Index l = 0; l < count_; ++l) {
      const auto own = static_cast<std::size_t>(l % 2), last = static_cast<std::size_t>((l + 1) % 2);
      const bool followed = l + 1 < count_ || final_norm_;
      layer_.infer(theta + l * layer_.parameters(), l == 0 ? x : ConstMatrix<S>(w.between[last].leftCols(n)), keys,
                   w.layers[0], w.scratch, followed ? Matrix<S>(w.between[own].leftCols(n)) : y);
    }
    const auto last = static_cast<std::size_t>((count_ + 1) % 2);
    if (final_norm_) norm_.forward(theta + at_norm(), w.between[last].leftCols(n), w.norm, y);
  }

  /// Weights in the form products work on, for those that use them again and again: a copy of the parameters but for
  /// biases and norms.
  template <class S>
  struct Packed {
    std::vector<typename TransformerLayer<A>::template Packed<S>> layers;
  };
  template <class S>
  Packed<S> packed() const {
    Packed<S> p;
    for (Eigen::Index l = 0; l < count_; ++l) p.layers.push_back(layer_.template packed<S>());
    return p;
  }
  template <class S>
  void pack(const S* theta, Packed<S>& p) const noexcept {
    for (Eigen::Index l = 0; l < count_; ++l) {
      layer_.pack(theta + l * layer_.parameters(), p.layers[static_cast<std::size_t>(l)]);
    }
  }

  /// What the first layer makes of each token by itself, q, k and v below each other: 3 inputs() x columns. Of tokens that
  /// stay the same from call to call it needs computing only once.
  template <class S>
  void project(const S* theta, const Packed<S>& p, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> qkv) const noexcept {
    layer_.project(theta, p.layers[0], x, w.layers[0], qkv);
  }

  /// As `infer`, given `pack` of theta and `project` of x, for the tokens from `from` on of every sample only, which the last
  /// layer alone then works on: y has tokens() - from columns a sample.
  template <class S>
  void infer_projected(const S* theta, const Packed<S>& p, ConstMatrix<S> x, ConstMatrix<S> qkv, KeyMask keys,
                       Eigen::Index from, Workspace<S>& w, Matrix<S> y) const noexcept {
    const Eigen::Index n = x.cols(), asking = y.cols();
    for (Eigen::Index l = 0; l < count_; ++l) {
      const auto own = static_cast<std::size_t>(l % 2), last = static_cast<std::size_t>((l + 1) % 2);
      const ConstMatrix<S> in = l == 0 ? x : ConstMatrix<S>(w.between[last].leftCols(n));
      const bool end = l + 1 == count_;
      const S* const at = theta + l * layer_.parameters();
      const auto& weights = p.layers[static_cast<std::size_t>(l)];
      Matrix<S> projected = w.layers[0].attention.qkv.leftCols(n);
      if (l > 0) layer_.project(at, weights, in, end ? from : Eigen::Index{0}, w.layers[0], projected);
      layer_.infer_projected(at, weights, in, l == 0 ? qkv : ConstMatrix<S>(projected), keys, end ? from : Eigen::Index{0},
                             w.layers[0], w.scratch,
                             !end          ? Matrix<S>(w.between[own].leftCols(n))
                             : final_norm_ ? Matrix<S>(w.between[own].leftCols(asking))
                                           : y);
    }
    const auto last = static_cast<std::size_t>((count_ + 1) % 2);
    if (final_norm_) norm_.forward(theta + at_norm(), w.between[last].leftCols(asking), w.norm, y);
  }

  template <class S>
  void backward(const S* theta, ConstMatrix<S> x, ConstMatrix<S> dy, Workspace<S>& w, S* dtheta,
                Matrix<S> dx) const noexcept {
    const Eigen::Index n = x.cols();
    Matrix<S> gradient = w.gradient.leftCols(n);
    if (final_norm_) {
      norm_.backward(theta + at_norm(), w.between.back().leftCols(n), dy, w.norm, dtheta + at_norm(), gradient);
    }
    for (Eigen::Index l = count_ - 1; l >= 0; --l) {
      const auto i = static_cast<std::size_t>(l);
      const bool from_outside = l + 1 == count_ && !final_norm_;
      layer_.backward(theta + l * layer_.parameters(), l == 0 ? x : ConstMatrix<S>(w.between[i - 1].leftCols(n)),
                      from_outside ? dy : ConstMatrix<S>(gradient), w.layers[i], w.scratch,
                      dtheta + l * layer_.parameters(), l == 0 ? dx : gradient);
    }
  }

  template <class S>
  void initialize(S* theta, core::RandomStream& random) const {
    for (Eigen::Index l = 0; l < count_; ++l) layer_.initialize(theta + l * layer_.parameters(), random);
    if (final_norm_) norm_.initialize(theta + at_norm(), random);
  }

  template <class F>
  void for_each_parameter(F&& f) const {
    for (Eigen::Index l = 0; l < count_; ++l) {
      for_each_parameter_of(layer_, "layers." + std::to_string(l), l * layer_.parameters(), f);
    }
    if (final_norm_) for_each_parameter_of(norm_, "norm", at_norm(), f);
  }

private:
  Eigen::Index at_norm() const noexcept { return count_ * layer_.parameters(); }

  Eigen::Index count_;
  TransformerLayer<A> layer_;
  LayerNorm norm_;
  bool final_norm_;
};

}  // namespace traceur::nn
