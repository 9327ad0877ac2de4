// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <limits>
#include <memory>

#include "traceur/core/error.hpp"
#include "traceur/core/vector3.hpp"
#include "traceur/terrain/signed_distance.hpp"

namespace traceur::sim {

/// Where the ground is, seen from a point.
template <class S>
struct GroundSample {
  S distance;               ///< signed distance to the surface, m; negative below it
  core::Vector3<S> normal;  ///< unit gradient of the distance, pointing out of the ground
};

/// What characters stand on: the plane z = 0, another plane, or a terrain. T is `float` or `double`; copies share the
/// terrain's memory.
template <class T>
class Ground {
public:
  Ground() = default;

  /// A terrain of square columns, taken as it is now.
  Ground(const terrain::HeightGrid& grid)
      : level_(false), highest_(grid.table<T>().highest), grid_(std::make_shared<const terrain::HeightGrid>(grid)) {}

  /// The half space normal . p < offset (m). Gravity stays along -z, so a tilted plane is a slope. Throws Error unless
  /// the normal is a unit vector and the offset finite.
  static Ground plane(const core::Vector3<double>& normal, double offset) {
    if (!(std::abs(norm(normal) - 1) < 1e-9)) throw Error("ground: plane: expected a unit normal");
    if (!std::isfinite(offset)) throw Error("ground: plane: expected a finite offset");
    Ground ground;
    ground.level_ = false;
    ground.normal_ = normal.template cast<T>();
    ground.offset_ = static_cast<T>(offset);
    ground.highest_ = normal.z > 1 - 1e-12 ? static_cast<T>(offset) : std::numeric_limits<T>::infinity();
    return ground;
  }

  /// No contact is possible above this height, m.
  T highest() const { return highest_; }
  /// The terrain, or null on a plane.
  const terrain::HeightGrid* grid() const { return grid_.get(); }
  /// The plane normal . p = offset (m) where there is no terrain.
  core::Vector3<double> normal() const { return normal_.template cast<double>(); }
  double offset() const { return static_cast<double>(offset_); }

  /// The same ground in another floating-point type; the terrain's memory is shared.
  template <class U>
  Ground<U> cast() const {
    Ground<U> out;
    out.level_ = level_;
    out.highest_ = static_cast<U>(highest_);
    out.offset_ = static_cast<U>(offset_);
    out.normal_ = normal_.template cast<U>();
    out.grid_ = grid_;
    return out;
  }

  /// Distances are exact up to `reach` (m); beyond it a terrain may answer any larger number. A point that is not a
  /// number has a distance that is not one.
  template <class S>
  [[gnu::always_inline]] GroundSample<S> sample(const core::Vector3<S>& point,
                                                T reach = std::numeric_limits<T>::infinity()) const {
    if (level_) return {point.z, core::Vector3<S>{S(0.0), S(0.0), S(1.0)}};
    if (grid_) return on_grid(point, reach);
    const core::Vector3<S> normal = normal_.template cast<S>();
    return {dot(normal, point) - S(offset_), normal};
  }

private:
  template <class U>
  friend class Ground;

  // Apart from sample, so that a step on level ground is not burdened with the code for terrain.
  template <class S>
  [[gnu::noinline]] GroundSample<S> on_grid(const core::Vector3<S>& point, T reach) const noexcept {
    const terrain::SurfaceSample<S> s = terrain::contact_surface(*grid_, point, reach);
    return {s.distance, s.normal};
  }

  bool level_ = true;
  T highest_ = 0;
  T offset_ = 0;
  core::Vector3<T> normal_{0, 0, 1};
  std::shared_ptr<const terrain::HeightGrid> grid_;
};

}  // namespace traceur::sim
