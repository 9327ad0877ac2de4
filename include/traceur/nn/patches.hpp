// SPDX-License-Identifier: MIT
#pragma once

#include <string>

#include <traceur/nn/module.hpp>

namespace traceur::nn {

/// Cuts an image into squares that do not overlap. A column goes in as `Convolution` has it, number (c, y, x) in row
/// (c height + y) width + x, and comes out as its patches, left to right and top to bottom, each of channels * size * size
/// numbers in the same order: seen as a matrix of `features()` rows, a column is `tokens()` tokens, which `Folded` maps by
/// a module of tokens. A permutation of the rows; no parameters.
class Patches {
public:
  template <class S>
  struct Workspace {};

  /// Throws Error unless `size` divides height and width.
  Patches(Eigen::Index channels, Eigen::Index height, Eigen::Index width, Eigen::Index size)
      : channels_(channels), height_(height), width_(width), size_(size) {
    detail::check_positive("patches", "channel", channels);
    detail::check_positive("patches", "row", height);
    detail::check_positive("patches", "column", width);
    detail::check_positive("patches", "row in a patch", size);
    if (height % size != 0 || width % size != 0) {
      throw Error("patches: expected a size that divides " + std::to_string(height) + " and " + std::to_string(width) +
                  ", got " + std::to_string(size));
    }
  }

  Eigen::Index inputs() const noexcept { return channels_ * height_ * width_; }
  Eigen::Index outputs() const noexcept { return inputs(); }
  Eigen::Index parameters() const noexcept { return 0; }
  /// Patches of an image.
  Eigen::Index tokens() const noexcept { return height_ / size_ * (width_ / size_); }
  /// Numbers of a patch.
  Eigen::Index features() const noexcept { return channels_ * size_ * size_; }

  template <class S>
  Workspace<S> workspace(Eigen::Index) const {
    return {};
  }

  template <class S>
  void forward(const S*, ConstMatrix<S> x, Workspace<S>&, Matrix<S> y) const noexcept {
    for (Eigen::Index j = 0; j < x.cols(); ++j) {
      for_each_run([&](Eigen::Index in, Eigen::Index out) { y.col(j).segment(out, size_) = x.col(j).segment(in, size_); });
    }
  }

  template <class S>
  void infer(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    forward(theta, x, w, y);
  }

  template <class S>
  void backward(const S*, ConstMatrix<S>, ConstMatrix<S> dy, Workspace<S>&, S*, Matrix<S> dx) const noexcept {
    for (Eigen::Index j = 0; j < dx.cols(); ++j) {
      for_each_run([&](Eigen::Index in, Eigen::Index out) { dx.col(j).segment(in, size_) = dy.col(j).segment(out, size_); });
    }
  }

  template <class S>
  void initialize(S*, core::RandomStream&) const {}

  template <class F>
  void for_each_parameter(F&&) const {}

private:
  // f(row of the image, row of the patches) for the first of every `size_` numbers that stay together.
  template <class F>
  void for_each_run(F&& f) const noexcept {
    Eigen::Index out = 0;
    for (Eigen::Index top = 0; top < height_; top += size_) {
      for (Eigen::Index left = 0; left < width_; left += size_) {
        for (Eigen::Index c = 0; c < channels_; ++c) {
          for (Eigen::Index y = top; y < top + size_; ++y, out += size_) f((c * height_ + y) * width_ + left, out);
        }
      }
    }
  }

  Eigen::Index channels_;
  Eigen::Index height_;
  Eigen::Index width_;
  Eigen::Index size_;
};

}  // namespace traceur::nn
