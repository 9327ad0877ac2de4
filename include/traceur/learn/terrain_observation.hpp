// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <span>
#include <utility>

#include "traceur/learn/feature_writer.hpp"
#include "traceur/terrain/local_map.hpp"
#include "traceur/terrain/point_cloud.hpp"

namespace traceur::learn {

/// What a character sees of its surroundings, in its own frame: heights of the ground on a square or a fan (PARC), the
/// nearest points of obstacles (HIL), or both, one after the other. One object is for one thread at a time; what it looks at
/// must outlive it.
class TerrainObservation {
 public:
  /// Nothing.
  TerrainObservation() = default;
  /// Heights on the places of a map, relative to the root, m.
  TerrainObservation(const terrain::HeightGrid& ground, terrain::LocalMap<float> map) : ground_(&ground), map_(std::move(map)) {}
  /// The nearest points of a cloud, three numbers each, m. Throws Error if `count` is below one.
  TerrainObservation(const terrain::PointCloud<float>& cloud, int count)
      : cloud_(&cloud), nearest_(terrain::NearestPoints<float>(count, cloud.groups())) {}
  TerrainObservation(const terrain::HeightGrid& ground, terrain::LocalMap<float> map, const terrain::PointCloud<float>& cloud, int count)
      : ground_(&ground), map_(std::move(map)), cloud_(&cloud), nearest_(terrain::NearestPoints<float>(count, cloud.groups())) {}

  Eigen::Index size() const noexcept { return (map_ ? map_->size() : 0) + (nearest_ ? 3 * nearest_->count() : 0); }

  /// Writes `size()` rows for each lane. A frame that is not finite gives heights that are not, and points at zero.
  template <class S>
  void write(const terrain::HeadingFrame<S>& frame, FeatureWriter<S, float>& to) {
    float* const first = to.skip(size());
    for (int lane = 0; lane < core::lane_count<S>; ++lane) {
      const auto at = [lane](const S& x) { return static_cast<float>(core::lane_of(x, lane)); };
      const terrain::HeadingFrame<float> own{{at(frame.origin.x), at(frame.origin.y), at(frame.origin.z)}, at(frame.cosine), at(frame.sine)};
      float* out = first + lane * to.stride();
      if (map_) {
        map_->sample(*ground_, own, std::span<float>(out, static_cast<std::size_t>(map_->size())));
        out += map_->size();
      }
      if (nearest_) nearest_->observe(*cloud_, own, std::span<float>(out, 3 * static_cast<std::size_t>(nearest_->count())));
    }
  }

 private:
  const terrain::HeightGrid* ground_ = nullptr;
  std::optional<terrain::LocalMap<float>> map_;
  const terrain::PointCloud<float>* cloud_ = nullptr;
  std::optional<terrain::NearestPoints<float>> nearest_;
};

}  // namespace traceur::learn
