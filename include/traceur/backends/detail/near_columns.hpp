// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>

#include "traceur/core/vector3.hpp"
#include "traceur/terrain/height_grid.hpp"

namespace traceur::backends::detail {

/// Calls `use(center, half_size)` (m, world) with a box for every column of the terrain that reaches into the upright box
/// between `low` and `high`. Columns of equal height side by side along x come as one box. The boxes end `margin` m below
/// `low`, and beyond the grid's border `margin` m outside it.
template <class Use>
inline void near_columns(const terrain::HeightGrid& grid, const core::Vector3<double>& low, const core::Vector3<double>& high,
                         double margin, Use&& use) {
  const terrain::HeightTable<double>& t = grid.table<double>();
  const int i0 = t.column(low.x), i1 = t.column(high.x), j0 = t.row(low.y), j1 = t.row(high.y);
  for (int j = j0; j <= j1; ++j) {
    double y0 = t.edge_y(j), y1 = t.edge_y(j + 1);
    if (j == 0) y0 = std::min(y0, low.y - margin);
    if (j == t.ny - 1) y1 = std::max(y1, high.y + margin);
    for (int i = i0; i <= i1;) {
      const double top = t.height(i, j);
      int end = i + 1;
      while (end <= i1 && t.height(end, j) == top) ++end;
      double x0 = t.edge_x(i), x1 = t.edge_x(end);
      if (i == 0) x0 = std::min(x0, low.x - margin);
      if (end == t.nx) x1 = std::max(x1, high.x + margin);
      if (top > low.z) {
        const double bottom = low.z - margin;
        use(core::Vector3<double>{0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.5 * (bottom + top)},
            core::Vector3<double>{0.5 * (x1 - x0), 0.5 * (y1 - y0), 0.5 * (top - bottom)});
      }
      i = end;
    }
  }
}

/// Whether a contact at `point` with a column, pushing along `normal`, lies on a face that its neighbour covers. A body that
/// glides over two columns of one height must not catch on the seam between them.
inline bool on_seam(const terrain::HeightGrid& grid, const core::Vector3<double>& point, const core::Vector3<double>& normal) {
  if (std::abs(normal.z) > 0.7) return false;
  // A contact point sits within a few centimetres of the face that it belongs to.
  const double reach = 0.125 * grid.cell();
  return grid.height(point.x + reach * normal.x, point.y + reach * normal.y) > point.z - 1e-3;
}

}  // namespace traceur::backends::detail
