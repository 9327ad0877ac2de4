// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <traceur/nn/dense.hpp>
#include <traceur/nn/detail/shifted_product.hpp>
#include <traceur/nn/initializers.hpp>
#include <traceur/nn/module.hpp>
#include <traceur/nn/product.hpp>

namespace traceur::nn {

/// Two-dimensional convolution (cross-correlation, as the field has it) of images with zeros around them:
///
///     y(o, r, q) = bias(o) + sum over c, i, j of  weight(o, c, i, j) x(c, stride r + i - padding, stride q + j - padding)
///
/// A column is one image: number (c, r, q) stands in row (c height + r) width + q, as in a row-major array of channels, rows
/// and columns. A height map is an image of one channel.
///
/// The products read the patches under the kernel straight from the image; they are never gathered. `backward` by the image
/// is a convolution too, of the gradient with its places spread by the stride and the kernel turned round.
///
/// Tensors, as PyTorch names and lays them out: `weight`, filters by (channels kernel kernel), and `bias`.
class Convolution {
public:
  struct Parameters {
    Eigen::Index channels = 1;
    Eigen::Index height = 1;
    Eigen::Index width = 1;
    Eigen::Index filters = 1;  ///< channels of the output
    Eigen::Index kernel = 3;   ///< rows and columns of the kernel
    Eigen::Index stride = 1;
    Eigen::Index padding = 0;  ///< rows and columns of zeros on each side
  };

  /// No state but x itself.
  template <class S>
  struct Workspace {
    detail::FlatStorage<S> image;     // x with its border
    detail::FlatStorage<S> gradient;  // dy spread by the stride, with its border
    detail::FlatStorage<S> weights;   // packed
    detail::FlatStorage<S> turned;    // packed, the kernel turned round, by channels
    detail::FlatStorage<S> strip;     // some rows of an output, channels next to each other
  };

  /// Throws Error unless all sizes are positive, the padding is not negative and the kernel fits into the padded image.
  explicit Convolution(Parameters p) : p_(p) {
    detail::check_positive("convolution", "channel", p.channels);
    detail::check_positive("convolution", "row", p.height);
    detail::check_positive("convolution", "column", p.width);
    detail::check_positive("convolution", "filter", p.filters);
    detail::check_positive("convolution", "row of the kernel", p.kernel);
    detail::check_positive("convolution", "row in a stride", p.stride);
    if (p.padding < 0) throw Error("convolution: expected a padding of 0 or more, got " + std::to_string(p.padding));
    if (std::min(p.height, p.width) + 2 * p.padding < p.kernel) {
      throw Error("convolution: expected a kernel of at most " +
                  std::to_string(std::min(p.height, p.width) + 2 * p.padding) + " rows, got " + std::to_string(p.kernel));
    }
    const auto limit = static_cast<Eigen::Index>(std::numeric_limits<int>::max());
    const Eigen::Index side = 2 * (p.padding + p.kernel);
    if ((p.height + side) > limit / (p.width + side) / std::max(p.channels, p.filters)) {
      throw Error("convolution: expected images of less than 2^31 numbers");
    }
    offsets_ = offsets(p.channels, padded_height(), padded_width());
    turned_offsets_ = offsets(p.filters, spread_height(), spread_width());
  }

  Eigen::Index inputs() const noexcept { return p_.channels * p_.height * p_.width; }
  Eigen::Index outputs() const noexcept { return p_.filters * output_height() * output_width(); }
  Eigen::Index parameters() const noexcept { return p_.filters * (under_kernel() + 1); }
  Eigen::Index filters() const noexcept { return p_.filters; }
  Eigen::Index output_height() const noexcept { return (p_.height + 2 * p_.padding - p_.kernel) / p_.stride + 1; }
  Eigen::Index output_width() const noexcept { return (p_.width + 2 * p_.padding - p_.kernel) / p_.stride + 1; }

  template <class S>
  Workspace<S> workspace(Eigen::Index) const {
    using Flat = detail::FlatStorage<S>;
    const Eigen::Index out = detail::padded_rows<S>(p_.filters) * strip_rows<S>(p_.filters, output_width()) * output_width();
    const Eigen::Index in = detail::padded_rows<S>(p_.channels) * strip_rows<S>(p_.channels, p_.width) * p_.width;
    return {Flat(p_.channels * padded_height() * padded_width()), Flat(p_.filters * spread_height() * spread_width()),
            Flat(detail::packed_size<S>(p_.filters, under_kernel())),
            Flat(detail::packed_size<S>(p_.channels, p_.filters * p_.kernel * p_.kernel)), Flat(std::max(in, out))};
  }

  template <class S>
  void forward(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    const S* const bias = theta + p_.filters * under_kernel();
    detail::pack_rows<S>(
        p_.filters, under_kernel(), [&](Eigen::Index o, Eigen::Index k) { return theta[o + k * p_.filters]; },
        [&](Eigen::Index o) { return bias[o]; }, w.weights.data());
    if (p_.padding > 0) w.image.setZero();
    for (Eigen::Index image = 0; image < x.cols(); ++image) {
      const S* const in = with_border<S>(x.data() + image * x.outerStride(), w);
      convolve<S>(p_.filters, offsets_, w.weights.data(), in,
                  {output_height(), output_width(), p_.stride * padded_width(), p_.stride}, w.strip.data(),
                  y.data() + image * y.outerStride());
    }
  }

  template <class S>
  void infer(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    forward(theta, x, w, y);
  }

  template <class S>
  void backward(const S* theta, ConstMatrix<S> x, ConstMatrix<S> dy, Workspace<S>& w, S* dtheta,
                Matrix<S> dx) const noexcept {
    if (p_.padding > 0) w.image.setZero();
    for (Eigen::Index image = 0; image < x.cols(); ++image) {
      const S* const in = with_border<S>(x.data() + image * x.outerStride(), w);
      add_weight_gradient<S>(in, dy.data() + image * dy.outerStride(), w.strip.data(), dtheta);
    }
    if (dx.cols() == 0) return;
    const Eigen::Index squares = p_.kernel * p_.kernel;
    detail::pack_rows<S>(
        p_.channels, p_.filters * squares,
        [&](Eigen::Index c, Eigen::Index k) {
          const Eigen::Index o = k / squares, turned = squares - 1 - k % squares;
          return theta[o + (c * squares + turned) * p_.filters];
        },
        [](Eigen::Index) { return S(0); }, w.turned.data());
    w.gradient.setZero();
    for (Eigen::Index image = 0; image < x.cols(); ++image) {
      spread<S>(dy.data() + image * dy.outerStride(), w.gradient.data());
      convolve<S>(p_.channels, turned_offsets_, w.turned.data(), w.gradient.data(),
                  {p_.height, p_.width, spread_width(), 1}, w.strip.data(), dx.data() + image * dx.outerStride());
    }
  }

  /// Uniform with variance 1 / (3 fan-in), weights and biases: PyTorch's default.
  template <class S>
  void initialize(S* theta, core::RandomStream& random) const {
    detail::fill_uniform(theta, parameters(), 1.0 / std::sqrt(static_cast<double>(under_kernel())), random);
  }

  template <class F>
  void for_each_parameter(F&& f) const {
    f("weight", Eigen::Index{0}, p_.filters, under_kernel());
    f("bias", p_.filters * under_kernel(), p_.filters, Eigen::Index{1});
  }

private:
  Eigen::Index under_kernel() const noexcept { return p_.channels * p_.kernel * p_.kernel; }
  Eigen::Index padded_height() const noexcept { return p_.height + 2 * p_.padding; }
  Eigen::Index padded_width() const noexcept { return p_.width + 2 * p_.padding; }
  Eigen::Index spread_height() const noexcept { return p_.height + p_.kernel - 1; }
  Eigen::Index spread_width() const noexcept { return p_.width + p_.kernel - 1; }

  // Where the numbers under the kernel stand in an image, from the first of them.
  std::vector<int> offsets(Eigen::Index channels, Eigen::Index height, Eigen::Index width) const {
    std::vector<int> out;
    for (Eigen::Index c = 0; c < channels; ++c) {
      for (Eigen::Index i = 0; i < p_.kernel; ++i) {
        for (Eigen::Index j = 0; j < p_.kernel; ++j) out.push_back(static_cast<int>((c * height + i) * width + j));
      }
    }
    return out;
  }

  // Rows of an output that are worked on at a time: 16 kB, or one row.
  template <class S>
  static Eigen::Index strip_rows(Eigen::Index channels, Eigen::Index width) noexcept {
    const Eigen::Index row = detail::padded_rows<S>(channels) * width * static_cast<Eigen::Index>(sizeof(S));
    return std::max<Eigen::Index>(1, 16384 / row);
  }

  // The border of w.image is zero and stays so.
  template <class S>
  const S* with_border(const S* x, Workspace<S>& w) const noexcept {
    if (p_.padding == 0) return x;
    for (Eigen::Index c = 0; c < p_.channels; ++c) {
      S* to = w.image.data() + (c * padded_height() + p_.padding) * padded_width() + p_.padding;
      for (Eigen::Index r = 0; r < p_.height; ++r, x += p_.width, to += padded_width()) std::copy_n(x, p_.width, to);
    }
    return w.image.data();
  }

  // What lies between the places is zero and stays so. Places whose patches hold no number of the image are left out.
  template <class S>
  void spread(const S* dy, S* to) const noexcept {
    const Eigen::Index shift = p_.kernel - 1 - p_.padding;
    for (Eigen::Index o = 0; o < p_.filters; ++o, to += spread_height() * spread_width()) {
      for (Eigen::Index r = 0; r < output_height(); ++r, dy += output_width()) {
        const Eigen::Index row = r * p_.stride + shift;
        if (row < 0 || row >= spread_height()) continue;
        for (Eigen::Index q = 0; q < output_width(); ++q) {
          const Eigen::Index column = q * p_.stride + shift;
          if (column >= 0 && column < spread_width()) to[row * spread_width() + column] = dy[q];
        }
      }
    }
  }

  template <class S>
  static void convolve(Eigen::Index channels, const std::vector<int>& offsets, const S* packed, const S* image,
                       const detail::Places& all, S* strip, S* y) noexcept {
    const Eigen::Index padded = detail::padded_rows<S>(channels), step = strip_rows<S>(channels, all.width);
    for (Eigen::Index row = 0; row < all.rows; row += step) {
      detail::Places places = all;
      places.rows = std::min(step, all.rows - row);
      detail::shifted_product<S>(channels, static_cast<Eigen::Index>(offsets.size()), packed, offsets.data(),
                                 image + row * all.row_stride, places, strip);
      const Eigen::Index count = places.rows * places.width;
      for (Eigen::Index c = 0; c < channels; ++c) {
        S* const to = y + (c * all.rows + row) * all.width;
        for (Eigen::Index place = 0; place < count; ++place) to[place] = strip[place * padded + c];
      }
    }
  }

  template <class S>
  void add_weight_gradient(const S* image, const S* dy, S* strip, S* dtheta) const noexcept {
    const Eigen::Index padded = detail::padded_rows<S>(p_.filters), step = strip_rows<S>(p_.filters, output_width());
    for (Eigen::Index row = 0; row < output_height(); row += step) {
      const detail::Places places{std::min(step, output_height() - row), output_width(), p_.stride * padded_width(),
                                  p_.stride};
      const Eigen::Index count = places.rows * places.width;
      for (Eigen::Index o = 0; o < padded; ++o) {
        const S* const from = dy + (o * output_height() + row) * output_width();
        for (Eigen::Index place = 0; place < count; ++place) strip[place * padded + o] = o < p_.filters ? from[place] : S(0);
      }
      detail::add_columns<S>(Eigen::Map<const detail::Storage<S>, 0, Eigen::OuterStride<>>(
                                 strip, p_.filters, count, Eigen::OuterStride<>(padded)),
                             dtheta + p_.filters * under_kernel());
      detail::shifted_outer_product<S>(p_.filters, under_kernel(), strip, offsets_.data(),
                                       image + row * places.row_stride, places, dtheta);
    }
  }

  Parameters p_;
  std::vector<int> offsets_;
  std::vector<int> turned_offsets_;
};

}  // namespace traceur::nn
