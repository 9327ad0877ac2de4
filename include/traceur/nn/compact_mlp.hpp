// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>
#include <vector>

#include <Eigen/Core>

#include <traceur/nn/activation.hpp>
#include <traceur/nn/mlp.hpp>
#include <traceur/nn/product.hpp>

namespace traceur::nn {

/// The bfloat16 nearest to x, ties to even, as its 16 bits: the upper half of a float. Its relative error is at most 2^-9;
/// what is not finite stays so.
inline std::uint16_t to_bfloat16(float x) noexcept {
  const auto bits = std::bit_cast<std::uint32_t>(x);
  if ((bits & 0x7f800000u) == 0x7f800000u) {
    // The quiet bit keeps a NaN from becoming an infinity when its lower half is lost.
    return static_cast<std::uint16_t>(bits >> 16 | ((bits & 0x007fffffu) != 0 ? 0x40u : 0u));
  }
  return static_cast<std::uint16_t>((bits + 0x7fffu + (bits >> 16 & 1u)) >> 16);
}

/// A perceptron for one sample at a time whose weights are kept as bfloat16: half of the memory that a single sample spends
/// its time waiting for. Sums, biases and activations are in float, so what differs from `Mlp` is each weight by at most
/// 2^-9 of itself: an output of a layer by at most 2^-9 sum_k |w_k x_k|.
///
/// Inputs of a layer that are exactly zero, as a ReLU leaves many, cost nothing. What a weight that is not finite would make
/// of them is not seen.
template <Activation Hidden = Relu, Activation Output = Identity>
class CompactMlp {
public:
  struct Workspace {
    std::vector<float> values[2];
    std::vector<float> given;  // inputs of a layer that are not zero
    std::vector<std::int32_t> columns;
  };

  /// Room for the weights of such a perceptron.
  explicit CompactMlp(const Mlp<Hidden, Output>& mlp) : widths_(mlp.widths()) {
    std::size_t weights = 0, biases = 0;
    for (std::size_t i = 0; i < layers(); ++i) {
      layers_.push_back({weights, biases});
      weights += static_cast<std::size_t>(padded(widths_[i + 1]) * widths_[i]);
      biases += static_cast<std::size_t>(padded(widths_[i + 1]));
    }
    weights_.resize(weights);
    biases_.resize(biases);
  }
  /// The same, loaded.
  CompactMlp(const Mlp<Hidden, Output>& mlp, const float* theta) : CompactMlp(mlp) { load(theta); }

  Eigen::Index inputs() const noexcept { return widths_.front(); }
  Eigen::Index outputs() const noexcept { return widths_.back(); }

  Workspace workspace() const {
    const auto widest = static_cast<std::size_t>(padded(*std::max_element(widths_.begin(), widths_.end())));
    return {{std::vector<float>(widest), std::vector<float>(widest)},
            std::vector<float>(widest),
            std::vector<std::int32_t>(widest)};
  }

  /// Rounds and copies the parameters of the perceptron, of length `Mlp::parameters()`.
  void load(const float* theta) noexcept {
    for (std::size_t i = 0; i < layers(); ++i) {
      const Eigen::Index rows = widths_[i + 1], depth = widths_[i];
      std::uint16_t* const to = weights_.data() + layers_[i].weights;
      for_each_panel(rows, [&](auto blocks, Eigen::Index first) {
        const Eigen::Index height = blocks * block;
        for (Eigen::Index k = 0; k < depth; ++k) {
          for (Eigen::Index r = 0; r < height; ++r) {
            const Eigen::Index row = first + r, lane = r % block;
            // A register of pairs: row `lane` in the lower half of a lane, the row a register further in the upper.
            const Eigen::Index at = r - lane + 2 * (lane % lanes) + lane / lanes;
            to[first * depth + k * height + at] = row < rows ? to_bfloat16(theta[k * rows + row]) : std::uint16_t{0};
          }
        }
      });
      theta += rows * depth;
      float* const bias = biases_.data() + layers_[i].biases;
      std::fill_n(std::copy_n(theta, rows, bias), padded(rows) - rows, 0.0f);
      theta += rows;
    }
  }

  /// y (outputs()) of the sample x (inputs()).
  void infer(const float* x, Workspace& w, float* y) const noexcept {
    for (std::size_t i = 0; i < layers(); ++i) {
      const Eigen::Index rows = widths_[i + 1], depth = widths_[i];
      const Eigen::Index count = leave_out_zeros(x, depth, w);
      float* const to = w.values[i % 2].data();
      const std::uint16_t* const weights = weights_.data() + layers_[i].weights;
      const float* const bias = biases_.data() + layers_[i].biases;
      for_each_panel(rows, [&](auto blocks, Eigen::Index first) {
        multiply<decltype(blocks)::value>(count, w.columns.data(), w.given.data(), weights + first * depth, bias + first,
                                          to + first);
      });
      if (i + 1 < layers()) {
        activate<Hidden, float>(rows, to, to);
      } else {
        activate<Output, float>(rows, to, y);
      }
      x = to;
    }
  }

private:
  static constexpr Eigen::Index lanes = detail::lanes<float>, block = 2 * lanes;
  // Two registers of sums a block, of which all but a few hold sums.
  static constexpr int most_blocks = detail::tile_vectors == 4 ? 8 : 4;

  struct Layer {
    std::size_t weights, biases;  // where they begin
  };

  static constexpr Eigen::Index padded(Eigen::Index rows) noexcept { return (rows + block - 1) / block * block; }
  std::size_t layers() const noexcept { return widths_.size() - 1; }

  // Calls f(blocks, first row) for all rows.
  template <class F>
  static void for_each_panel(Eigen::Index rows, F&& f) noexcept {
    Eigen::Index left = padded(rows) / block, first = 0;
    const auto panels = [&](auto blocks) {
      for (; left >= blocks; left -= blocks, first += blocks * block) f(blocks, first);
    };
    panels(std::integral_constant<int, most_blocks>{});
    if constexpr (most_blocks > 4) panels(std::integral_constant<int, 4>{});
    panels(std::integral_constant<int, 2>{});
    panels(std::integral_constant<int, 1>{});
  }

  static Eigen::Index leave_out_zeros(const float* x, Eigen::Index n, Workspace& w) noexcept {
    std::size_t count = 0;
    for (Eigen::Index k = 0; k < n; ++k) {
      w.columns[count] = static_cast<std::int32_t>(k);
      w.given[count] = x[k];
      count += x[k] != 0.0f ? 1 : 0;
    }
    return static_cast<Eigen::Index>(count);
  }

  template <int Blocks>
  [[gnu::noinline]] static void multiply(Eigen::Index count, const std::int32_t* columns, const float* x,
                                         const std::uint16_t* panel, const float* bias, float* y) noexcept {
    using Vector = detail::VectorOf<float>;
    typedef std::uint32_t Pairs __attribute__((vector_size(sizeof(Vector))));
    Vector sum[2 * Blocks];
    detail::unroll<2 * Blocks>([&](auto v) __attribute__((always_inline)) { sum[v] = detail::load<float>(bias + v * lanes); });
    for (Eigen::Index k = 0; k < count; ++k) {
      const std::uint16_t* const column = panel + columns[k] * (Blocks * block);
      const Vector factor = x[k] - Vector{};
      detail::unroll<Blocks>([&](auto v) __attribute__((always_inline)) {
        Pairs pairs;
        std::memcpy(&pairs, column + v * block, sizeof pairs);
        sum[2 * v] = sum[2 * v] + reinterpret_cast<Vector>(pairs << 16) * factor;
        sum[2 * v + 1] = sum[2 * v + 1] + reinterpret_cast<Vector>(pairs & 0xffff0000u) * factor;
      });
    }
    detail::unroll<2 * Blocks>([&](auto v) __attribute__((always_inline)) { detail::store<float>(y + v * lanes, sum[v]); });
  }

  std::vector<Eigen::Index> widths_;
  std::vector<Layer> layers_;
  std::vector<std::uint16_t> weights_;
  std::vector<float> biases_;
};

}  // namespace traceur::nn
