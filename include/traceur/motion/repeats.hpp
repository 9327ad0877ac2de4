// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <vector>

#include "traceur/motion/clip.hpp"

namespace traceur::motion {

/// Drops keys whose pose repeats the one before to the bit, as left by programs that raise a clip's rate by showing each
/// frame twice: between them the motion stands still, and its velocity is wrong everywhere. Times of the keys that stay are
/// kept. Does nothing where few keys repeat (fewer than a quarter) or one pose is held for more than four keys, which is
/// how a character that stands still looks. Returns how many keys were dropped.
inline int drop_repeats(Clip& clip) {
  constexpr int longest_run = 4;
  std::vector<Eigen::Index> kept{0};
  int run = 1, longest = 1;
  for (Eigen::Index k = 1; k < clip.keys(); ++k) {
    run = clip.poses.col(k) == clip.poses.col(k - 1) ? run + 1 : 1;
    longest = std::max(longest, run);
    if (run == 1) kept.push_back(k);
  }
  const int dropped = clip.keys() - static_cast<int>(kept.size());
  if (4 * dropped < clip.keys() || longest > longest_run || kept.size() < 2) return 0;
  const Clip whole = clip;
  const auto count = static_cast<Eigen::Index>(kept.size());
  clip.times.resize(count);
  clip.poses.resize(whole.poses.rows(), count);
  if (whole.contacts.cols() != 0) clip.contacts.resize(whole.contacts.rows(), count);
  for (Eigen::Index k = 0; k < count; ++k) {
    const Eigen::Index from = kept[static_cast<std::size_t>(k)];
    clip.times[k] = whole.times[from];
    clip.poses.col(k) = whole.poses.col(from);
    if (whole.contacts.cols() != 0) clip.contacts.col(k) = whole.contacts.col(from);
  }
  return dropped;
}

}  // namespace traceur::motion
