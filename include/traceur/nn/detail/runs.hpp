// SPDX-License-Identifier: MIT
#pragma once

#include <type_traits>
#include <utility>

#include <Eigen/Core>

#include <traceur/core/pack.hpp>
#include <traceur/nn/product.hpp>

namespace traceur::nn::detail {

/// 0, 1, 2 and so on.
template <class S>
[[gnu::always_inline]] inline core::Pack<S> lane_numbers() noexcept {
  return [&]<int... lane>(std::integer_sequence<int, lane...>) __attribute__((always_inline)) {
    return core::Pack<S>(typename core::Pack<S>::Vector{static_cast<S>(lane)...});
  }(std::make_integer_sequence<int, core::Pack<S>::width>{});
}

/// The numbers [at, at + count) of an array, one register wide; `full` if they fill it. Reductions over runs depend neither
/// on where an array lies in memory nor on what is around it, as those of Eigen do.
template <class S, bool full>
struct Run {
  using P = core::Pack<S>;
  Eigen::Index at;
  Eigen::Index count;

  [[gnu::always_inline]] P load(const S* from) const noexcept {
    if constexpr (full) {
      return P::load(from + at);
    } else {
      return P(load_part<S>(from + at, count));
    }
  }

  [[gnu::always_inline]] void store(S* to, const P& values) const noexcept {
    if constexpr (full) {
      values.store(to + at);
    } else {
      store_part<S>(to + at, values.v, count);
    }
  }

  /// `other` in the lanes beyond the array's end.
  [[gnu::always_inline]] P inside(const P& values, S other = S(0)) const noexcept {
    if constexpr (full) {
      return values;
    } else {
      return select(lane_numbers<S>() < P(static_cast<S>(count)), values, P(other));
    }
  }
};

/// Calls `f(run)` for every run of an array of n numbers, in order.
template <class S, class F>
[[gnu::always_inline]] inline void for_each_run(Eigen::Index n, F&& f) noexcept {
  constexpr Eigen::Index w = core::Pack<S>::width;
  Eigen::Index at = 0;
  for (; at + w <= n; at += w) f(Run<S, true>{at, w});
  if (at < n) f(Run<S, false>{at, n - at});
}

/// Lane `i + Half` in lane `i`.
template <int Half, class S>
[[gnu::always_inline]] inline core::Pack<S> shifted(const core::Pack<S>& values) noexcept {
  return [&]<int... lane>(std::integer_sequence<int, lane...>) __attribute__((always_inline)) {
    return core::Pack<S>(__builtin_shufflevector(values.v, values.v, (lane + Half)...));
  }(std::make_integer_sequence<int, core::Pack<S>::width>{});
}

/// The sum of the lanes, by halves.
template <class S, int Half = core::Pack<S>::width / 2>
[[gnu::always_inline]] inline S sum(const core::Pack<S>& values) noexcept {
  if constexpr (Half == 0) {
    return values[0];
  } else {
    return sum<S, Half / 2>(values + shifted<Half>(values));
  }
}

template <class S, int Half = core::Pack<S>::width / 2>
[[gnu::always_inline]] inline S largest(const core::Pack<S>& values) noexcept {
  if constexpr (Half == 0) {
    return values[0];
  } else {
    const core::Pack<S> other = shifted<Half>(values);
    return largest<S, Half / 2>(select(other > values, other, values));
  }
}

}  // namespace traceur::nn::detail
