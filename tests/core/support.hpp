// SPDX-License-Identifier: MIT
// The scalars that every law of this folder is checked for.
#pragma once

#include <type_traits>

#include <traceur/core/pack.hpp>
#include <traceur/core/random.hpp>

#if __has_include(<ceres/jet.h>) && defined(TRACEUR_HAS_CERES)
// By a name: the build leaves out a file that plainly includes what it has not found.
#define TRACEUR_TEST_JET_HEADER <ceres/jet.h>
#include TRACEUR_TEST_JET_HEADER
#define TRACEUR_TEST_JET , ceres::Jet<double, 2>
#else
#define TRACEUR_TEST_JET
#endif

#define TRACEUR_TEST_SCALARS \
  float, double, traceur::core::Pack<float>, traceur::core::Pack<double>, traceur::core::Pack<float, 4> TRACEUR_TEST_JET

namespace law {

using namespace traceur::core;

template <class S>
struct Lanes {
  static constexpr int count = lane_count<S>;
};

/// A lane's plain number.
template <class S>
double number(const S& x, int lane) {
  if constexpr (lane_count<S> == 1) {
    (void)lane;
    return static_cast<double>(plain(x));
  } else {
    return static_cast<double>(x[lane]);
  }
}

/// Whether a mask holds in a lane.
template <class M>
bool holds(const M& mask, int lane) {
  return mask_lane(mask, lane);
}

/// Rounding unit of the scalar's elements, not that of a dual number's derivative.
template <class S>
constexpr double unit() {
  using T = Element<S>;
  return std::is_same_v<T, float> ? 1.2e-7 : 2.3e-16;
}

/// A different number in every lane.
template <class S>
S any_of(RandomStream& random, double low, double high) {
  if constexpr (lane_count<S> == 1) {
    return S(random.uniform(low, high));
  } else {
    S x(0.0);
    for (int l = 0; l < lane_count<S>; ++l) x.set(l, static_cast<Element<S>>(random.uniform(low, high)));
    return x;
  }
}

}  // namespace law
