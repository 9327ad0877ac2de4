// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <span>
#include <string>
#include <vector>

#include "traceur/motion/losses.hpp"

namespace traceur::motion {

/// What a generated motion is judged by.
struct MotionScore {
  double penetration = 0;      ///< PARC Eq. 7 over all frames, m
  double contact = 0;          ///< PARC Eq. 8 over all frames, m
  bool reached_end = false;    ///< whether it came to the end of its path
};

/// PARC Eq. 14: penetration + contact + 1000 if the path's end was not reached. The equation prints the last term with
/// the opposite sense; the text before it calls it a penalty for not getting there.
struct SelectionHeuristic {
  double penetration = 1;     ///< 1/m
  double contact = 1;         ///< 1/m
  double incomplete = 1000;

  double operator()(const MotionScore& s) const {
    return penetration * s.penetration + contact * s.contact + (s.reached_end ? 0.0 : incomplete);
  }

  /// The weights of PARC's released configuration.
  static SelectionHeuristic parc_code() { return {0.1, 0.1, 1000}; }
};

/// Penetration and contact of a clip on a ground; `reached_end` as given. The clip may be without contact labels.
inline MotionScore score(const Clip& clip, std::span<const body::SurfacePoint> points, const terrain::HeightGrid& ground,
                         bool reached_end) {
  MotionScore out;
  out.reached_end = reached_end;
  body::Frames<double> frames(clip.skeleton);
  for (int k = 0; k < clip.keys(); ++k) {
    body::forward_kinematics(clip.skeleton, clip.poses.col(k).data(), frames);
    out.penetration += penetration(ground, points, frames);
    if (clip.contacts.cols() != 0) out.contact += contact(ground, points, clip.contacts.col(k).data(), frames);
  }
  return out;
}

/// Numbers of the `count` best motions (or of all, if there are fewer), best first; of equals the earlier. A value that
/// is not a number comes last.
inline std::vector<std::size_t> best_motions(std::span<const MotionScore> scores, std::size_t count,
                                             const SelectionHeuristic& heuristic = {}) {
  std::vector<double> value;
  for (const MotionScore& s : scores) value.push_back(heuristic(s));
  std::vector<std::size_t> order(scores.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    if (value[a] != value[a]) return false;
    return value[b] != value[b] || value[a] < value[b];
  });
  order.resize(std::min(count, order.size()));
  return order;
}

}  // namespace traceur::motion
