// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <traceur/core/error.hpp>
#include <traceur/core/random.hpp>
#include <traceur/diffusion/denoiser.hpp>
#include <traceur/diffusion/terrain_encoder.hpp>
#include <traceur/nn/activation.hpp>
#include <traceur/nn/mlp.hpp>
#include <traceur/nn/module.hpp>
#include <traceur/nn/positions.hpp>
#include <traceur/nn/transformer.hpp>

namespace traceur::diffusion {

/// Parts of the condition of a motion generator.
inline constexpr Parts terrain_part = 1;  ///< the height map may be looked at
inline constexpr Parts target_part = 2;   ///< so may the target direction
inline constexpr Parts past_part = 4;     ///< the past frames are those of the condition, not noise
inline constexpr Parts past_seen = 8;     ///< the past frames may be looked at

/// The motion generator of Xu et al. 2025 (PARC, section 5 and Fig. 3; sizes of their released configuration): a
/// transformer encoder over
///
///     64 terrain tokens | target | flag | step | 2 past frames | 13 future frames
///
/// that estimates the clean frames. Each token comes from an encoder of its own kind (terrain: TerrainEncoder; frames, target
/// and step: perceptrons of one hidden layer; flag: one of two learned columns, whether the past is clean or noise), and
/// sinusoidal positions are added. The output perceptron maps the tokens of the frames to frames.
///
/// A sample is its frames below each other, past ones first, `frame_features` numbers each. A condition is the heights
/// (m, as LocalMap gives them), the target direction and the past frames, below each other. Parts that are not given:
/// without `terrain_part` or `target_part` no token looks at those; without `past_seen` none looks at the past frames (the
/// G(h, d) of eq. 5); without `past_part` the past frames are the noisy ones, to be generated with the rest. Samples that
/// lack a part must still hold finite numbers there.
///
/// A DenoisingNetwork. To sample, `prepare` computes the tokens of the condition and what the first layer makes of each, once
/// for all steps; of the last layer only the frames are computed.
///
/// Tensors: `terrain.*`, `target.*`, `flag`, `step.*`, `frame.*`, `transformer.*`, `output.*`.
class MotionGenerator {
public:
  struct Parameters {
    Eigen::Index frame_features = 105;
    Eigen::Index past = 2;
    Eigen::Index future = 13;
    TerrainEncoder::Parameters terrain = {};  ///< its `token` is the width of all tokens
    Eigen::Index target = 2;                ///< numbers of a target direction
    Eigen::Index target_hidden = 512;       ///< hidden features of the encoder of targets
    Eigen::Index hidden = 256;              ///< and of the others
    Eigen::Index heads = 8;
    Eigen::Index feed_forward = 256;
    Eigen::Index layers = 4;
    nn::NormOrder norm = nn::NormOrder::before;
  };

  template <class S>
  struct Workspace {
    nn::WorkspaceOf<TerrainEncoder, S> terrain;
    nn::WorkspaceOf<nn::Mlp<nn::Silu>, S> target, step, frame, output;
    nn::WorkspaceOf<nn::StepEmbedding, S> embedding;
    nn::WorkspaceOf<nn::Transformer<>, S> transformer;
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> positions;  // of all tokens of a sample
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> steps, embedded;
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> heights, targets;
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> terrain_tokens, target_tokens, step_tokens;
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> frames, frame_tokens;
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> tokens, encoded, answers, written;
    Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic> keys;
    std::vector<char> clean_past;
    Eigen::Index samples = 0;
  };

  /// What depends on the parameters or the condition alone.
  template <class S>
  struct Prepared {
    typename nn::Transformer<>::template Packed<S> transformer;
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> tokens;     // with positions, `fixed()` a sample
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> projected;  // by the first layer
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> past;
    std::vector<Parts> given;
  };

  template <class S>
  struct Scratch {
    nn::WorkspaceOf<TerrainEncoder, S> terrain;
    nn::WorkspaceOf<nn::Mlp<nn::Silu>, S> target, step, frame, output;
    nn::WorkspaceOf<nn::StepEmbedding, S> embedding;
    nn::WorkspaceOf<nn::Transformer<>, S> transformer;
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> positions;
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> steps, embedded, step_tokens;
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> heights, targets, terrain_tokens, target_tokens;
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> frames, frame_tokens, moving, moving_projected;
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> tokens, projected, answers, written;
    Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic> keys;
  };

  /// Throws Error if a size is below 1 or does not fit the others.
  explicit MotionGenerator(Parameters p)
      : p_(std::move(p)),
        terrain_(p_.terrain),
        target_({p_.target, p_.target_hidden, width()}),
        embedding_(width()),
        step_({width(), p_.hidden, width()}),
        frame_({p_.frame_features, p_.hidden, width()}),
        positions_(width(), tokens()),
        transformer_(transformer_parameters()),
        output_({width(), p_.hidden, p_.frame_features}) {
    nn::detail::check_positive("motion generator", "future frame", p_.future);
    if (p_.past < 0) throw Error("motion generator: expected 0 past frames or more, got " + std::to_string(p_.past));
  }

  const Parameters& shape() const noexcept { return p_; }
  Eigen::Index frames() const noexcept { return p_.past + p_.future; }
  Eigen::Index features() const noexcept { return frames() * p_.frame_features; }
  Eigen::Index condition_features() const noexcept { return past_row() + p_.past * p_.frame_features; }
  /// Where the parts of a condition begin; the heights at 0.
  Eigen::Index target_row() const noexcept { return terrain_.inputs(); }
  Eigen::Index past_row() const noexcept { return target_row() + p_.target; }
  /// Tokens of a sample.
  Eigen::Index tokens() const noexcept { return fixed() + 1 + frames(); }
  Eigen::Index parameters() const noexcept { return at_output() + output_.parameters(); }

  template <class S>
  Workspace<S> workspace(Eigen::Index n) const {
    nn::detail::check_positive("motion generator workspace", "sample", n);
    const Eigen::Index d = width();
    return {terrain_.workspace<S>(n),
            target_.workspace<S>(n),
            step_.workspace<S>(n),
            frame_.workspace<S>(n * frames()),
            output_.workspace<S>(n * frames()),
            embedding_.workspace<S>(n),
            transformer_.workspace<S>(n * tokens()),
            positions_.cast<S>(),
            {1, n},
            {d, n},
            {terrain_.inputs(), n},
            {p_.target, n},
            {terrain_.outputs(), n},
            {d, n},
            {d, n},
            {p_.frame_features, n * frames()},
            {d, n * frames()},
            {d, n * tokens()},
            {d, n * tokens()},
            {d, n * frames()},
            {p_.frame_features, n * frames()},
            {tokens(), n},
            std::vector<char>(static_cast<std::size_t>(n)),
            0};
  }

  template <class S>
  Prepared<S> prepared(Eigen::Index n) const {
    nn::detail::check_positive("motion generator", "sample", n);
    return {transformer_.packed<S>(),
            {width(), n * fixed()},
            {3 * width(), n * fixed()},
            {p_.past * p_.frame_features, n},
            std::vector<Parts>(static_cast<std::size_t>(n))};
  }

  template <class S>
  Scratch<S> scratch(Eigen::Index n) const {
    nn::detail::check_positive("motion generator", "sample", n);
    const Eigen::Index d = width(), moving = n * (tokens() - fixed());
    return {terrain_.workspace<S>(n),
            target_.workspace<S>(n),
            step_.workspace<S>(1),
            frame_.workspace<S>(n * frames()),
            output_.workspace<S>(n * frames()),
            embedding_.workspace<S>(1),
            transformer_.inference_workspace<S>(n * tokens()),
            positions_.cast<S>(),
            {1, 1},
            {d, 1},
            {d, 1},
            {terrain_.inputs(), n},
            {p_.target, n},
            {terrain_.outputs(), n},
            {d, n},
            {p_.frame_features, n * frames()},
            {d, n * frames()},
            {d, moving},
            {3 * d, moving},
            {d, n * tokens()},
            {3 * d, n * tokens()},
            {d, n * frames()},
            {p_.frame_features, n * frames()},
            {tokens(), n}};
  }

  template <class S>
  void forward(const S* theta, const int* steps, nn::ConstMatrix<S> x, const Condition<S>& condition, Workspace<S>& w,
               nn::Matrix<S> y) const noexcept {
    const Eigen::Index n = w.samples = x.cols(), all = n * frames();
    for (Eigen::Index j = 0; j < n; ++j) {
      w.steps(0, j) = static_cast<S>(steps[j]);
      w.clean_past[static_cast<std::size_t>(j)] = (condition.parts(j) & past_part) != 0;
      set_keys(condition.parts(j), w.keys.col(j).data());
      set_frames<S>(x.col(j).data(), w.clean_past[static_cast<std::size_t>(j)] != 0 ? condition.values.col(j).data() + past_row() : nullptr,
                    w.frames.data() + j * features());
    }
    w.heights.leftCols(n) = condition.values.topRows(terrain_.inputs());
    w.targets.leftCols(n) = condition.values.middleRows(target_row(), p_.target);
    terrain_.forward(theta, w.heights.leftCols(n), w.terrain, w.terrain_tokens.leftCols(n));
    target_.forward(theta + at_target(), w.targets.leftCols(n), w.target, w.target_tokens.leftCols(n));
    embedding_.forward(theta, w.steps.leftCols(n), w.embedding, w.embedded.leftCols(n));
    step_.forward(theta + at_step(), w.embedded.leftCols(n), w.step, w.step_tokens.leftCols(n));
    frame_.forward(theta + at_frame(), w.frames.leftCols(all), w.frame, w.frame_tokens.leftCols(all));
    for (Eigen::Index j = 0; j < n; ++j) {
      auto tokens_of = w.tokens.middleCols(j * tokens(), tokens());
      set_fixed<S>(theta, w.terrain_tokens.col(j).data(), w.target_tokens.col(j).data(),
                   w.clean_past[static_cast<std::size_t>(j)] != 0, tokens_of.leftCols(fixed()));
      tokens_of.col(fixed()) = w.step_tokens.col(j);
      tokens_of.rightCols(frames()) = w.frame_tokens.middleCols(j * frames(), frames());
      tokens_of += w.positions;
    }
    transformer_.forward(theta + at_transformer(), w.tokens.leftCols(n * tokens()), w.keys.leftCols(n), w.transformer,
                         w.encoded.leftCols(n * tokens()));
    for (Eigen::Index j = 0; j < n; ++j) {
      w.answers.middleCols(j * frames(), frames()) = w.encoded.middleCols((j + 1) * tokens() - frames(), frames());
    }
    output_.forward(theta + at_output(), w.answers.leftCols(all), w.output, w.written.leftCols(all));
    y = Eigen::Map<const Table<S>>(w.written.data(), features(), n);
  }

  template <class S>
  void backward(const S* theta, nn::ConstMatrix<S> dy, Workspace<S>& w, S* dtheta) const noexcept {
    const Eigen::Index n = w.samples, all = n * frames();
    assert(dy.cols() == n);
    Eigen::Map<Table<S>>(w.written.data(), features(), n) = dy;
    // Gradients take the place of what they belong to, once that is not needed any more.
    output_.backward(theta + at_output(), w.answers.leftCols(all), w.written.leftCols(all), w.output, dtheta + at_output(),
                     w.frame_tokens.leftCols(all));
    w.encoded.leftCols(n * tokens()).setZero();
    for (Eigen::Index j = 0; j < n; ++j) {
      w.encoded.middleCols((j + 1) * tokens() - frames(), frames()) = w.frame_tokens.middleCols(j * frames(), frames());
    }
    nn::Matrix<S> dtokens = w.encoded.leftCols(n * tokens());
    transformer_.backward(theta + at_transformer(), w.tokens.leftCols(n * tokens()), dtokens, w.transformer,
                          dtheta + at_transformer(), dtokens);
    const Eigen::Index t = terrain_.tokens();
    for (Eigen::Index j = 0; j < n; ++j) {
      const auto d = dtokens.middleCols(j * tokens(), tokens());
      Eigen::Map<Table<S>>(w.terrain_tokens.col(j).data(), width(), t) = d.leftCols(t);
      w.target_tokens.col(j) = d.col(t);
      flag<S>(dtheta, w.clean_past[static_cast<std::size_t>(j)] != 0) += d.col(t + 1);
      w.step_tokens.col(j) = d.col(fixed());
      w.frame_tokens.middleCols(j * frames(), frames()) = d.rightCols(frames());
    }
    terrain_.backward(theta, w.heights.leftCols(n), w.terrain_tokens.leftCols(n), w.terrain, dtheta, nn::no_gradient<S>());
    target_.backward(theta + at_target(), w.targets.leftCols(n), w.target_tokens.leftCols(n), w.target, dtheta + at_target(),
                     nn::no_gradient<S>());
    step_.backward(theta + at_step(), w.embedded.leftCols(n), w.step_tokens.leftCols(n), w.step, dtheta + at_step(),
                   nn::no_gradient<S>());
    frame_.backward(theta + at_frame(), w.frames.leftCols(all), w.frame_tokens.leftCols(all), w.frame, dtheta + at_frame(),
                    nn::no_gradient<S>());
  }

  template <class S>
  void load(const S* theta, Prepared<S>& prepared) const noexcept {
    transformer_.pack(theta + at_transformer(), prepared.transformer);
  }

  template <class S>
  void prepare(const S* theta, const Condition<S>& condition, Eigen::Index first, Scratch<S>& w,
               Prepared<S>& prepared) const noexcept {
    const Eigen::Index n = condition.values.cols();
    w.heights.leftCols(n) = condition.values.topRows(terrain_.inputs());
    w.targets.leftCols(n) = condition.values.middleRows(target_row(), p_.target);
    terrain_.infer(theta, w.heights.leftCols(n), w.terrain, w.terrain_tokens.leftCols(n));
    target_.infer(theta + at_target(), w.targets.leftCols(n), w.target, w.target_tokens.leftCols(n));
    nn::Matrix<S> all = prepared.tokens.middleCols(first * fixed(), n * fixed());
    for (Eigen::Index j = 0; j < n; ++j) {
      prepared.given[static_cast<std::size_t>(first + j)] = condition.parts(j);
      prepared.past.col(first + j) = condition.values.col(j).segment(past_row(), prepared.past.rows());
      auto own = all.middleCols(j * fixed(), fixed());
      set_fixed<S>(theta, w.terrain_tokens.col(j).data(), w.target_tokens.col(j).data(),
                   (condition.parts(j) & past_part) != 0, own);
      own += w.positions.leftCols(fixed());
    }
    transformer_.project(theta + at_transformer(), prepared.transformer, all, w.transformer,
                         prepared.projected.middleCols(first * fixed(), n * fixed()));
  }

  template <class S>
  void infer(const S* theta, int step, nn::ConstMatrix<S> x, const Prepared<S>& prepared, Eigen::Index first,
             Parts without, Scratch<S>& w, nn::Matrix<S> y) const noexcept {
    const Eigen::Index n = x.cols(), all = n * frames(), moving = tokens() - fixed();
    w.steps(0, 0) = static_cast<S>(step);
    embedding_.infer(theta, w.steps, w.embedding, w.embedded);
    step_.infer(theta + at_step(), w.embedded, w.step, w.step_tokens);
    for (Eigen::Index j = 0; j < n; ++j) {
      const Parts given = prepared.given[static_cast<std::size_t>(first + j)] & ~without;
      set_keys(given, w.keys.col(j).data());
      set_frames<S>(x.col(j).data(), (given & past_part) != 0 ? prepared.past.col(first + j).data() : nullptr,
                    w.frames.data() + j * features());
    }
    frame_.infer(theta + at_frame(), w.frames.leftCols(all), w.frame, w.frame_tokens.leftCols(all));
    for (Eigen::Index j = 0; j < n; ++j) {
      auto own = w.moving.middleCols(j * moving, moving);
      own.col(0) = w.step_tokens.col(0);
      own.rightCols(frames()) = w.frame_tokens.middleCols(j * frames(), frames());
      own += w.positions.rightCols(moving);
    }
    transformer_.project(theta + at_transformer(), prepared.transformer, w.moving.leftCols(n * moving), w.transformer,
                         w.moving_projected.leftCols(n * moving));
    for (Eigen::Index j = 0; j < n; ++j) {
      gather(prepared.tokens, w.moving, first + j, j, w.tokens);
      gather(prepared.projected, w.moving_projected, first + j, j, w.projected);
    }
    transformer_.infer_projected(theta + at_transformer(), prepared.transformer, w.tokens.leftCols(n * tokens()),
                                 w.projected.leftCols(n * tokens()), w.keys.leftCols(n), tokens() - frames(), w.transformer,
                                 w.answers.leftCols(all));
    output_.infer(theta + at_output(), w.answers.leftCols(all), w.output, w.written.leftCols(all));
    y = Eigen::Map<const Table<S>>(w.written.data(), features(), n);
  }

  template <class S>
  void initialize(S* theta, core::RandomStream& random) const {
    terrain_.initialize(theta, random);
    target_.initialize(theta + at_target(), random);
    for (Eigen::Index i = 0; i < 2 * width(); ++i) theta[at_flag() + i] = random.normal<S>(0, S(0.02));
    step_.initialize(theta + at_step(), random);
    frame_.initialize(theta + at_frame(), random);
    transformer_.initialize(theta + at_transformer(), random);
    output_.initialize(theta + at_output(), random);
  }

  template <class F>
  void for_each_parameter(F&& f) const {
    nn::for_each_parameter_of(terrain_, "terrain", 0, f);
    nn::for_each_parameter_of(target_, "target", at_target(), f);
    f(std::string_view("flag"), at_flag(), width(), Eigen::Index{2});
    nn::for_each_parameter_of(step_, "step", at_step(), f);
    nn::for_each_parameter_of(frame_, "frame", at_frame(), f);
    nn::for_each_parameter_of(transformer_, "transformer", at_transformer(), f);
    nn::for_each_parameter_of(output_, "output", at_output(), f);
  }

private:
  template <class S>
  using Table = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;

  Eigen::Index width() const noexcept { return p_.terrain.token; }
  // Tokens that depend on the condition alone: the terrain's, the target, the flag.
  Eigen::Index fixed() const noexcept { return terrain_.tokens() + 2; }
  Eigen::Index at_target() const noexcept { return terrain_.parameters(); }
  Eigen::Index at_flag() const noexcept { return at_target() + target_.parameters(); }
  Eigen::Index at_step() const noexcept { return at_flag() + 2 * width(); }
  Eigen::Index at_frame() const noexcept { return at_step() + step_.parameters(); }
  Eigen::Index at_transformer() const noexcept { return at_frame() + frame_.parameters(); }
  Eigen::Index at_output() const noexcept { return at_transformer() + transformer_.parameters(); }

  nn::TransformerParameters transformer_parameters() const {
    nn::TransformerParameters p;
    p.layers = p_.layers;
    p.layer.attention.width = width();
    p.layer.attention.heads = p_.heads;
    p.layer.attention.tokens = tokens();
    p.layer.feed_forward = p_.feed_forward;
    p.layer.norm = p_.norm;
    p.final_norm = p_.norm == nn::NormOrder::before;
    return p;
  }

  template <class S>
  auto flag(S* theta, bool clean) const noexcept {
    using Column = Eigen::Matrix<std::remove_const_t<S>, Eigen::Dynamic, 1>;
    using Seen = std::conditional_t<std::is_const_v<S>, const Column, Column>;
    return Eigen::Map<Seen>(theta + at_flag() + (clean ? width() : 0), width());
  }

  // Which tokens may be looked at.
  void set_keys(Parts given, bool* keys) const noexcept {
    std::fill_n(keys, tokens(), true);
    if ((given & terrain_part) == 0) std::fill_n(keys, terrain_.tokens(), false);
    if ((given & target_part) == 0) keys[terrain_.tokens()] = false;
    if ((given & past_seen) == 0) std::fill_n(keys + fixed() + 1, p_.past, false);
  }

  // Noisy frames, their past replaced unless that is null.
  template <class S>
  void set_frames(const S* noisy, const S* past, S* to) const noexcept {
    std::copy_n(noisy, features(), to);
    if (past != nullptr) std::copy_n(past, p_.past * p_.frame_features, to);
  }

  // Tokens of the condition, without positions.
  template <class S>
  void set_fixed(const S* theta, const S* terrain, const S* target, bool clean_past, nn::Matrix<S> to) const noexcept {
    const Eigen::Index t = terrain_.tokens();
    to.leftCols(t) = Eigen::Map<const Table<S>>(terrain, width(), t);
    to.col(t) = Eigen::Map<const Table<S>>(target, width(), 1);
    to.col(t + 1) = flag<const S>(theta, clean_past);
  }

  // All columns of a sample: those of sample `from` that stay, then those of sample j that move.
  template <class S>
  void gather(const Table<S>& fixed_ones, const Table<S>& moving_ones, Eigen::Index from, Eigen::Index j,
              Table<S>& to) const noexcept {
    const Eigen::Index moving = tokens() - fixed();
    to.middleCols(j * tokens(), fixed()) = fixed_ones.middleCols(from * fixed(), fixed());
    to.middleCols(j * tokens() + fixed(), moving) = moving_ones.middleCols(j * moving, moving);
  }

  static Eigen::MatrixXd make_positions(Eigen::Index width, Eigen::Index tokens) {
    nn::detail::check_sinusoid_width("motion generator", width);
    return Eigen::MatrixXd::NullaryExpr(width, tokens, [width](Eigen::Index i, Eigen::Index t) {
      return nn::sinusoid(static_cast<double>(t), i, width);
    });
  }

  struct Positions {
    Positions(Eigen::Index width, Eigen::Index tokens) : table(make_positions(width, tokens)) {}
    template <class S>
    Table<S> cast() const {
      return table.template cast<S>();
    }
    Eigen::MatrixXd table;
  };

  Parameters p_;
  TerrainEncoder terrain_;
  nn::Mlp<nn::Silu> target_;
  nn::StepEmbedding embedding_;
  nn::Mlp<nn::Silu> step_;
  nn::Mlp<nn::Silu> frame_;
  Positions positions_;
  nn::Transformer<> transformer_;
  nn::Mlp<nn::Silu> output_;
};

}  // namespace traceur::diffusion
