// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "traceur/core/error.hpp"
#include "traceur/core/scalar.hpp"

namespace traceur::terrain {

/// A height grid's numbers in one floating-point type, for kernels. Cell (i, j) is entry i + nx j.
template <class T>
struct HeightTable {
  T x0 = 0, y0 = 0;                        ///< lowest corner of cell (0, 0), m
  T x1 = 1, y1 = 1;                        ///< highest corner of the last cell, m
  T cell = 1;                              ///< side of a cell, m
  T inverse_cell = 1;                      ///< 1/m
  T three_squared = 9, four_squared = 16;  ///< squares of three and of four cells, m^2
  T lowest = 0, highest = 0;
  int nx = 1, ny = 1;
  std::vector<T> heights;  ///< m
  std::vector<T> tops;     ///< highest of the cell and the eight around it, m
  /// The heights again, with the border's cells repeated `border` times on all sides, so that a look around any cell
  /// stays within: cell (i, j) is entry i + border + stride (j + border).
  std::vector<T> bordered;
  static constexpr int border = 8;
  T border_x0 = 0, border_y0 = 0;  ///< lowest corner of the border, m
  /// Highest of the cells four rows south or north of each, or four columns west, m; entries as of `bordered`. The
  /// column four to the east is what fills a look from three to the west on up to eight columns.
  std::vector<T> ring;
  int stride = 1 + 2 * border;

  /// The cell that holds a coordinate; the border's beyond the border; a safe index for a NaN.
  int column(T x) const noexcept {
    return static_cast<int>(core::clamp((x - x0) * inverse_cell, T(0), static_cast<T>(nx - 1)));
  }
  int row(T y) const noexcept {
    return static_cast<int>(core::clamp((y - y0) * inverse_cell, T(0), static_cast<T>(ny - 1)));
  }
  T height(int i, int j) const noexcept {
    return heights[static_cast<std::size_t>(i) + static_cast<std::size_t>(nx) * static_cast<std::size_t>(j)];
  }
  /// That of cell (i, j) within `bordered`.
  const T* bordered_cell(int i, int j) const noexcept {
    return bordered.data() + (i + border) + static_cast<std::ptrdiff_t>(stride) * (j + border);
  }
  /// The lower bound of column i; that of column i + 1 is its upper bound.
  T edge_x(int i) const noexcept { return x0 + static_cast<T>(i) * cell; }
  T edge_y(int j) const noexcept { return y0 + static_cast<T>(j) * cell; }
};

/// Terrain of square columns (Xu et al. 2025, "PARC", A.1): the column over cell (i, j) has a flat top at height h(i,
/// j) and reaches down without end. Outside the grid the cells at its border go on for ever, so the ground has no edge
/// to fall from. World frame, metres, z up.
///
///   y ^  +----+----+----+
///     |  |0,1 |1,1 |2,1 |     i counts along x, j along y
///     |  +----+----+----+
///     |  |0,0 |1,0 |2,0 |
///     |  +----+----+----+
///     |  ^ (x0, y0)
///     +-------------------> x
class HeightGrid {
public:
  static constexpr double default_cell = 0.4;

  /// A grid of heights.rows() cells along x by heights.cols() along y, with the lowest corner of cell (0, 0) at (x0,
  /// y0). Throws Error, one line beginning with `where`, if a size is zero or a number is not finite.
  explicit HeightGrid(Eigen::MatrixXd heights, double cell = default_cell, double x0 = 0, double y0 = 0,
                      const std::string& where = "height grid")
      : heights_(std::move(heights)) {
    if (heights_.size() == 0) throw Error(where + ": expected at least one cell");
    // Beyond this an int no longer holds an entry's index.
    if (heights_.size() > max_cells) throw Error(where + ": expected at most " + std::to_string(max_cells) + " cells");
    if (!(cell > 0) || !std::isfinite(cell)) throw Error(where + ": expected a cell size above zero");
    if (!std::isfinite(x0) || !std::isfinite(y0)) throw Error(where + ": expected a finite origin");
    for (Eigen::Index j = 0; j < heights_.cols(); ++j)
      for (Eigen::Index i = 0; i < heights_.rows(); ++i)
        if (!std::isfinite(heights_(i, j)))
          throw Error(where + ": height of cell (" + std::to_string(i) + ", " + std::to_string(j) + ") is not finite");
    fill(double_, cell, x0, y0);
    fill(float_, cell, x0, y0);
  }

  /// Level ground everywhere at one height. One cell: all queries take the short way.
  static HeightGrid flat(double height = 0) { return HeightGrid(Eigen::MatrixXd::Constant(1, 1, height)); }

  static constexpr Eigen::Index max_cells = Eigen::Index{1} << 24;

  int nx() const { return double_.nx; }
  int ny() const { return double_.ny; }
  double cell() const { return double_.cell; }
  double x0() const { return double_.x0; }
  double y0() const { return double_.y0; }
  double lowest() const { return double_.lowest; }
  double highest() const { return double_.highest; }
  /// Whether all cells are of one height.
  bool is_flat() const { return double_.lowest == double_.highest; }

  /// Heights, nx by ny, m.
  const Eigen::MatrixXd& heights() const { return heights_; }
  /// Height of a cell; the indices are within the grid.
  double operator()(int i, int j) const { return heights_(i, j); }
  /// Column and row of the cell that holds a point; the border's outside the grid, the last one's for a NaN. A point
  /// between two cells belongs to the one of higher index.
  int column(double x) const { return double_.column(x); }
  int row(double y) const { return double_.row(y); }
  /// Middle of a column or row of cells, m.
  double center_x(int i) const { return double_.x0 + (i + 0.5) * double_.cell; }
  double center_y(int j) const { return double_.y0 + (j + 0.5) * double_.cell; }
  /// Height of the ground at (x, y), m.
  double height(double x, double y) const { return heights_(column(x), row(y)); }

  /// The grid in `float` or `double`.
  template <class T>
  const HeightTable<T>& table() const {
    if constexpr (std::is_same_v<T, float>) {
      return float_;
    } else {
      static_assert(std::is_same_v<T, double>);
      return double_;
    }
  }

private:
  template <class T>
  void fill(HeightTable<T>& t, double cell, double x0, double y0) const {
    t.x0 = static_cast<T>(x0);
    t.y0 = static_cast<T>(y0);
    t.cell = static_cast<T>(cell);
    t.inverse_cell = static_cast<T>(1 / cell);
    t.three_squared = static_cast<T>(9 * cell * cell);
    t.four_squared = static_cast<T>(16 * cell * cell);
    t.nx = static_cast<int>(heights_.rows());
    t.ny = static_cast<int>(heights_.cols());
    t.x1 = t.edge_x(t.nx);
    t.y1 = t.edge_y(t.ny);
    t.heights.resize(static_cast<std::size_t>(heights_.size()));
    t.tops.resize(t.heights.size());
    for (std::size_t k = 0; k < t.heights.size(); ++k) t.heights[k] = static_cast<T>(heights_.data()[k]);
    t.lowest = *std::min_element(t.heights.begin(), t.heights.end());
    t.highest = *std::max_element(t.heights.begin(), t.heights.end());
    for (int j = 0; j < t.ny; ++j)
      for (int i = 0; i < t.nx; ++i) {
        T top = t.height(i, j);
        for (int b = std::max(j - 1, 0); b <= std::min(j + 1, t.ny - 1); ++b)
          for (int a = std::max(i - 1, 0); a <= std::min(i + 1, t.nx - 1); ++a) top = std::max(top, t.height(a, b));
        t.tops[static_cast<std::size_t>(i) + static_cast<std::size_t>(t.nx) * static_cast<std::size_t>(j)] = top;
      }
    constexpr int border = HeightTable<T>::border;
    t.stride = t.nx + 2 * border;
    t.border_x0 = static_cast<T>(x0 - border * cell);
    t.border_y0 = static_cast<T>(y0 - border * cell);
    t.bordered.resize(static_cast<std::size_t>(t.stride) * static_cast<std::size_t>(t.ny + 2 * border));
    for (int j = -border; j < t.ny + border; ++j) {
      T* const row = t.bordered.data() + static_cast<std::ptrdiff_t>(t.stride) * (j + border) + border;
      const int inner = std::clamp(j, 0, t.ny - 1);
      for (int i = 0; i < t.nx; ++i) row[i] = t.height(i, inner);
      for (int i = 1; i <= border; ++i) {
        row[-i] = row[0];
        row[t.nx - 1 + i] = row[t.nx - 1];
      }
    }
    fill_ring(t);
  }

  template <class T>
  static void fill_ring(HeightTable<T>& t) {
    constexpr int border = HeightTable<T>::border, away = 4;
    const std::ptrdiff_t stride = t.stride, size = static_cast<std::ptrdiff_t>(t.bordered.size());
    // Of each cell and those on either side of it the highest, along x and along y: one farther on either side each
    // turn.
    std::vector<T> along_x = t.bordered, along_y = along_x, narrower(along_x.size());
    const auto widen = [&](std::vector<T>& along, std::ptrdiff_t step, bool first) {
      narrower = along;
      const T* const from = narrower.data();
      T* const to = along.data();
      for (std::ptrdiff_t k = step; k < size - step; ++k) {
        const T sides = std::max(from[k - step], from[k + step]);
        to[k] = first ? std::max(sides, from[k]) : sides;
      }
    };
    for (int r = 1; r <= away; ++r) {
      widen(along_x, 1, r == 1);
      widen(along_y, stride, r == 1);
    }
    t.ring.assign(t.bordered.size(), t.highest);
    for (int j = 0; j < t.ny; ++j)
      for (int i = 0; i < t.nx; ++i) {
        const std::ptrdiff_t k = i + border + stride * (j + border);
        const T* const x = along_x.data() + k;
        const T* const y = along_y.data() + k;
        t.ring[static_cast<std::size_t>(k)] = std::max(std::max(x[-away * stride], x[away * stride]), y[-away]);
      }
  }

  Eigen::MatrixXd heights_;
  HeightTable<double> double_;
  HeightTable<float> float_;
};

}  // namespace traceur::terrain
