// SPDX-License-Identifier: MIT
#pragma once

#include <type_traits>

#include <Eigen/Core>

#include <traceur/core/pack.hpp>
#include <traceur/nn/product.hpp>

namespace traceur::nn::detail {

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
      P out(other);
      for (int lane = 0; lane < P::width; ++lane) {
        if (lane < count) out.set(lane, values[lane]);
      }
      return out;
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

/// The sum of the lanes, by halves.
template <class S>
[[gnu::always_inline]] inline S sum(const core::Pack<S>& values) noexcept {
  S lanes[core::Pack<S>::width];
  values.store(lanes);
  for (int half = core::Pack<S>::width / 2; half > 0; half /= 2) {
    for (int i = 0; i < half; ++i) lanes[i] += lanes[i + half];
  }
  return lanes[0];
}

template <class S>
[[gnu::always_inline]] inline S largest(const core::Pack<S>& values) noexcept {
  S best = values[0];
  for (int i = 1; i < core::Pack<S>::width; ++i) best = values[i] > best ? values[i] : best;
  return best;
}

}  // namespace traceur::nn::detail
