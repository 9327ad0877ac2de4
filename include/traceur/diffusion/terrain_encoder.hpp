// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <traceur/core/error.hpp>
#include <traceur/core/random.hpp>
#include <traceur/nn/activation.hpp>
#include <traceur/nn/convolution.hpp>
#include <traceur/nn/dense.hpp>
#include <traceur/nn/module.hpp>
#include <traceur/nn/patches.hpp>

namespace traceur::diffusion {

/// A height map as tokens (Xu et al. 2025, PARC, section 5 and Fig. 3): convolutions, each followed by a leaky ReLU, then
/// patches of the last image, each mapped to a token by one dense layer. With the defaults 31 x 31 heights become an image
/// of 64 x 16 x 16 and 64 tokens.
///
/// An nn::Module: a column is a map, number (row, column) in row `row * width + column`; its output are the tokens, one below
/// the other. Heights are multiplied by `scale` first.
///
/// Tensors: `convolutions.0.weight`, `convolutions.0.bias`, ..., `token.weight`, `token.bias`.
class TerrainEncoder {
public:
  struct Layer {
    Eigen::Index filters = 32;
    Eigen::Index kernel = 5;
  };
  struct Parameters {
    Eigen::Index height = 31, width = 31;  ///< rows and columns of the map
    std::vector<Layer> layers = {{32, 5}, {32, 5}, {32, 5}, {64, 4}};
    Eigen::Index patch = 2;     ///< rows and columns of a patch; divides the last image
    Eigen::Index token = 256;   ///< features of a token
    double scale = 1.0 / 3.0;   ///< 1/m
  };

  template <class S>
  struct Workspace {
    using Image = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;
    std::vector<nn::WorkspaceOf<nn::Convolution, S>> convolutions;
    std::vector<Image> images;  // scaled heights, then the output of each convolution
    Image patches;
    nn::WorkspaceOf<nn::Patches, S> cut;
    nn::WorkspaceOf<nn::Dense<>, S> token;
    Image copy;            // of tokens that are not contiguous
    Image back[2];         // gradients on their way
  };

  /// Throws Error if there is no convolution, a size does not fit, or the scale is not finite.
  explicit TerrainEncoder(Parameters p) : p_(std::move(p)), patches_(make_patches()), token_(patches_.features(), p_.token) {
    if (!(p_.scale - p_.scale == 0.0)) throw Error("terrain encoder: expected a finite scale");
  }

  Eigen::Index inputs() const noexcept { return p_.height * p_.width; }
  Eigen::Index outputs() const noexcept { return tokens() * p_.token; }
  Eigen::Index tokens() const noexcept { return patches_.tokens(); }
  Eigen::Index parameters() const noexcept { return offsets_.back() + token_.parameters(); }

  template <class S>
  Workspace<S> workspace(Eigen::Index max_columns) const {
    nn::detail::check_positive("terrain encoder workspace", "column", max_columns);
    Workspace<S> w;
    w.images.emplace_back(inputs(), max_columns);
    Eigen::Index largest = patches_.outputs();
    for (const nn::Convolution& c : convolutions_) {
      w.convolutions.push_back(c.template workspace<S>(max_columns));
      w.images.emplace_back(c.outputs(), max_columns);
      largest = std::max(largest, c.outputs());
    }
    w.patches.resize(patches_.outputs(), max_columns);
    w.token = token_.template workspace<S>(max_columns * tokens());
    w.copy.resize(outputs(), max_columns);
    for (auto& m : w.back) m.resize(largest, max_columns);
    return w;
  }

  template <class S>
  void forward(const S* theta, nn::ConstMatrix<S> x, Workspace<S>& w, nn::Matrix<S> y) const noexcept {
    const Eigen::Index n = x.cols();
    w.images[0].leftCols(n) = static_cast<S>(p_.scale) * x;
    for (std::size_t l = 0; l < convolutions_.size(); ++l) {
      nn::Matrix<S> out = w.images[l + 1].leftCols(n);
      convolutions_[l].forward(theta + offsets_[l], w.images[l].leftCols(n), w.convolutions[l], out);
      nn::activate<Activation, S>(out, out);
    }
    patches_.forward(theta, w.images.back().leftCols(n), w.cut, w.patches.leftCols(n));
    const bool direct = n <= 1 || y.outerStride() == y.rows();
    token_.forward(theta + offsets_.back(), in_tokens<const S>(w.patches.data(), patches_.features(), n), w.token,
                   in_tokens<S>(direct ? y.data() : w.copy.data(), p_.token, n));
    if (!direct) y = w.copy.leftCols(n);
  }

  template <class S>
  void infer(const S* theta, nn::ConstMatrix<S> x, Workspace<S>& w, nn::Matrix<S> y) const noexcept {
    forward(theta, x, w, y);
  }

  template <class S>
  void backward(const S* theta, nn::ConstMatrix<S> x, nn::ConstMatrix<S> dy, Workspace<S>& w, S* dtheta,
                nn::Matrix<S> dx) const noexcept {
    const Eigen::Index n = x.cols();
    const bool direct = n <= 1 || dy.outerStride() == dy.rows();
    if (!direct) w.copy.leftCols(n) = dy;
    // The gradient of the patches lies packed in its buffer.
    token_.backward(theta + offsets_.back(), in_tokens<const S>(w.patches.data(), patches_.features(), n),
                    in_tokens<const S>(direct ? dy.data() : w.copy.data(), p_.token, n), w.token, dtheta + offsets_.back(),
                    in_tokens<S>(w.back[1].data(), patches_.features(), n));
    const Eigen::Map<const Storage<S>> dpatches(w.back[1].data(), patches_.outputs(), n);
    patches_.backward(theta, w.images.back().leftCols(n), dpatches, w.cut, dtheta,
                      w.back[0].topLeftCorner(patches_.inputs(), n));
    int own = 0;
    for (std::size_t l = convolutions_.size(); l-- > 0; own = 1 - own) {
      nn::Matrix<S> dimage = w.back[own].topLeftCorner(convolutions_[l].outputs(), n);
      nn::activate_backward<Activation, S>(w.images[l + 1].leftCols(n), dimage, dimage);
      const bool last = l == 0;
      nn::Matrix<S> next = last ? dx : nn::Matrix<S>(w.back[1 - own].topLeftCorner(convolutions_[l].inputs(), n));
      convolutions_[l].backward(theta + offsets_[l], w.images[l].leftCols(n), dimage, w.convolutions[l],
                                dtheta + offsets_[l], next);
    }
    if (dx.cols() > 0) dx *= static_cast<S>(p_.scale);
  }

  template <class S>
  void initialize(S* theta, core::RandomStream& random) const {
    for (std::size_t l = 0; l < convolutions_.size(); ++l) convolutions_[l].initialize(theta + offsets_[l], random);
    token_.initialize(theta + offsets_.back(), random);
  }

  template <class F>
  void for_each_parameter(F&& f) const {
    for (std::size_t l = 0; l < convolutions_.size(); ++l) {
      nn::for_each_parameter_of(convolutions_[l], "convolutions." + std::to_string(l), offsets_[l], f);
    }
    nn::for_each_parameter_of(token_, "token", offsets_.back(), f);
  }

private:
  using Activation = nn::LeakyRelu<>;
  template <class S>
  using Storage = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;

  nn::Patches make_patches() {
    if (p_.layers.empty()) throw Error("terrain encoder: expected at least one convolution");
    Eigen::Index channels = 1, height = p_.height, width = p_.width, offset = 0;
    for (const Layer& layer : p_.layers) {
      const nn::Convolution& c = convolutions_.emplace_back(nn::Convolution::Parameters{
          .channels = channels, .height = height, .width = width, .filters = layer.filters, .kernel = layer.kernel});
      offsets_.push_back(offset);
      offset += c.parameters();
      channels = layer.filters;
      height = c.output_height();
      width = c.output_width();
    }
    offsets_.push_back(offset);
    return nn::Patches(channels, height, width, p_.patch);
  }

  // Columns of all tokens as columns of one token each. S may be const.
  template <class S>
  auto in_tokens(S* data, Eigen::Index rows, Eigen::Index samples) const noexcept {
    using Plain = Storage<std::remove_const_t<S>>;
    using Seen = std::conditional_t<std::is_const_v<S>, const Plain, Plain>;
    return Eigen::Map<Seen>(data, rows, samples * tokens());
  }

  Parameters p_;
  std::vector<nn::Convolution> convolutions_;
  std::vector<Eigen::Index> offsets_;  // of the convolutions' parameters, and of the dense layer's
  nn::Patches patches_;
  nn::Dense<> token_;
};

}  // namespace traceur::diffusion
