// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <span>
#include <type_traits>
#include <utility>

namespace traceur::core {

/// The keyed bijection Philox4x32-10 on 128-bit blocks: Salmon, Moraes, Dror and Shaw, "Parallel Random Numbers: As
/// Easy as 1, 2, 3", SC 2011, section 3.3. Counting up through `counter` with a fixed `key` gives 2^128 blocks that
/// pass BigCrush. Words are least significant first.
constexpr std::array<std::uint32_t, 4> philox4x32(std::array<std::uint32_t, 4> counter,
                                                  std::array<std::uint32_t, 2> key) noexcept {
  for (int round = 0; round < 10; ++round) {
    const std::uint64_t a = std::uint64_t{0xD2511F53u} * counter[0];
    const std::uint64_t b = std::uint64_t{0xCD9E8D57u} * counter[2];
    counter = {static_cast<std::uint32_t>(b >> 32) ^ counter[1] ^ key[0], static_cast<std::uint32_t>(b),
               static_cast<std::uint32_t>(a >> 32) ^ counter[3] ^ key[1], static_cast<std::uint32_t>(a)};
    key[0] += 0x9E3779B9u;
    key[1] += 0xBB67AE85u;
  }
  return counter;
}

/// An endless sequence of random numbers that is a pure function of (seed, stream, step).
///
/// Give each independent actor (lane, candidate, clip) its own `stream` and each repetition (time step, generation) its
/// own `step`: what is drawn then depends neither on the number of threads nor on the order of the work. All 64 bits of
/// the three numbers count. There is no warm-up: constructing one costs a single Philox block, about 10 ns, so a stream
/// is made where it is used and thrown away.
///
/// The seed is the Philox key. The 192 bits of (stream, step, draw) do not fit the 128-bit counter, so the block at
/// (stream, step), unique to that pair, is where counting starts; two of 2^32 streams of 2^32 draws overlap with a
/// probability below 2^-31.
///
/// The integers are the same on every machine. So are the uniforms; normals are as equal as the C library's `log`,
/// `sin` and `cos` are.
class RandomStream {
public:
  using result_type = std::uint32_t;

  explicit constexpr RandomStream(std::uint64_t seed, std::uint64_t stream = 0, std::uint64_t step = 0) noexcept
      : key_{low(seed), high(seed)}, counter_{philox4x32({low(step), high(step), low(stream), high(stream)}, key_)} {}

  /// 32 uniform bits.
  constexpr std::uint32_t next_u32() noexcept {
    if (used_ == 4) {
      block_ = philox4x32(counter_, key_);
      if (++counter_[0] == 0 && ++counter_[1] == 0 && ++counter_[2] == 0) ++counter_[3];
      used_ = 0;
    }
    return block_[static_cast<std::size_t>(used_++)];
  }

  /// 64 uniform bits.
  constexpr std::uint64_t next_u64() noexcept {
    const std::uint64_t first = next_u32();
    return first | (std::uint64_t{next_u32()} << 32);
  }

  /// Uniform in [0, 1), on the grid of 2^-53 for double and 2^-24 for float.
  template <std::floating_point T = double>
  constexpr T uniform() noexcept {
    if constexpr (sizeof(T) == sizeof(float)) {
      return static_cast<T>(next_u32() >> 8) * static_cast<T>(0x1p-24);
    } else {
      return static_cast<T>(next_u64() >> 11) * static_cast<T>(0x1p-53);
    }
  }

  /// Uniform between `lo` and `hi`, `lo` included; `hi` comes up only where rounding cannot tell it from its neighbour.
  template <std::floating_point T = double>
  constexpr T uniform(std::type_identity_t<T> lo, std::type_identity_t<T> hi) noexcept {
    return lo + (hi - lo) * uniform<T>();
  }

  /// Standard normal, by Box and Muller's transformation; |value| < 8.6. Two calls share one pair, so every second call
  /// costs nothing. The float version is the double one rounded.
  template <std::floating_point T = double>
  T normal() noexcept {
    if (has_spare_) {
      has_spare_ = false;
      return static_cast<T>(spare_);
    }
    const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform()));
    const double angle = 2.0 * std::numbers::pi * uniform();
    spare_ = radius * std::sin(angle);
    has_spare_ = true;
    return static_cast<T>(radius * std::cos(angle));
  }

  /// Normal with the given mean and standard deviation.
  template <std::floating_point T = double>
  T normal(std::type_identity_t<T> mean, std::type_identity_t<T> deviation) noexcept {
    return mean + deviation * normal<T>();
  }

  /// Uniform integer in [0, n), without bias, for n >= 1 (0 for n = 0). Lemire, "Fast Random Integer Generation in an
  /// Interval", ACM TOMACS 29 (2019), algorithm 5.
  constexpr std::uint32_t below(std::uint32_t n) noexcept {
    std::uint64_t product = std::uint64_t{next_u32()} * n;
    if (low(product) < n) {
      const std::uint32_t rejected = (0u - n) % n;
      while (low(product) < rejected) product = std::uint64_t{next_u32()} * n;
    }
    return high(product);
  }

  /// True with the given probability; never for 0, always for 1.
  constexpr bool bernoulli(double probability) noexcept { return uniform() < probability; }

  /// Fills `values` with standard normals.
  template <std::floating_point T>
  void fill_normal(std::span<T> values) noexcept {
    for (T& value : values) value = normal<T>();
  }

  /// Brings up to 2^32 `values` into a uniformly random order (Fisher and Yates). Unlike `std::shuffle`, the same order
  /// with every standard library.
  template <class T>
  constexpr void shuffle(std::span<T> values) noexcept(std::is_nothrow_swappable_v<T>) {
    using std::swap;
    for (std::size_t i = values.size(); i > 1; --i) {
      swap(values[i - 1], values[below(static_cast<std::uint32_t>(i))]);
    }
  }

  /// With these three, a stream is a `std::uniform_random_bit_generator`.
  static constexpr result_type min() noexcept { return 0; }
  static constexpr result_type max() noexcept { return 0xFFFFFFFFu; }
  constexpr result_type operator()() noexcept { return next_u32(); }

private:
  static constexpr std::uint32_t low(std::uint64_t x) noexcept { return static_cast<std::uint32_t>(x); }
  static constexpr std::uint32_t high(std::uint64_t x) noexcept { return static_cast<std::uint32_t>(x >> 32); }

  std::array<std::uint32_t, 2> key_;
  std::array<std::uint32_t, 4> counter_;
  std::array<std::uint32_t, 4> block_{};
  double spare_ = 0.0;
  int used_ = 4;
  bool has_spare_ = false;
};

}  // namespace traceur::core
