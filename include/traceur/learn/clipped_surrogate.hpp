// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>

namespace traceur::learn {

/// The loss of one action under proximal policy optimisation, Schulman et al. 2017 (arXiv:1707.06347), Eq. 7.
template <class S>
struct ClippedSurrogate {
  S loss;        ///< -min(r A, clip(r, 1 - c, 1 + c) A) with r the ratio of probabilities, new over old
  S slope;       ///< d loss / d log probability: -r A, or 0 where the clipped branch is the smaller
  S divergence;  ///< (r - 1) - log r: its mean over actions estimates KL(old, new) and is never negative
  bool clipped;  ///< |r - 1| > c

  /// `log_ratio`: log probability now less that when the action was taken. `advantage`: A. `clip`: c.
  ClippedSurrogate(S log_ratio, S advantage, S clip) noexcept {
    const S ratio = std::exp(log_ratio);
    const S nearest = ratio < S(1) - clip ? S(1) - clip : ratio > S(1) + clip ? S(1) + clip : ratio;
    const bool flat = nearest * advantage < ratio * advantage;
    loss = -(flat ? nearest : ratio) * advantage;
    slope = flat ? S(0) : -ratio * advantage;
    divergence = (ratio - S(1)) - log_ratio;
    clipped = nearest != ratio;
  }
};

}  // namespace traceur::learn
