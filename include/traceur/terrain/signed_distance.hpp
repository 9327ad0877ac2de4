// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <cstddef>
#include <limits>
#include <type_traits>

#include "traceur/core/detail/tiles.hpp"
#include "traceur/core/pack.hpp"
#include "traceur/core/vector3.hpp"
#include "traceur/terrain/height_grid.hpp"

namespace traceur::terrain {

/// Where a point is relative to the ground.
template <class S>
struct SurfaceSample {
  S distance;               ///< to the nearest point of the surface, m; negative inside the ground
  core::Vector3<S> normal;  ///< gradient of the distance: unit, out of the ground
};

namespace detail {

/// The cell whose column (of ground, or of air for a point inside) is nearest.
struct NearestCell {
  int own_i, own_j;  ///< the cell the point is over
  int i, j;
  bool inside;
};

/// Why one search serves both sides: ground is the union of the columns below each cell's top, air the union of the
/// columns above. Outside, the distance is that to the nearest column of ground; inside, that to the nearest column of
/// air. Faces between neighbouring columns of ground, which are no surface, never enter.
///
/// Rows of cells are looked at a register at a time, from the point's own row outwards, as far as a nearer column is
/// possible.
template <class T>
[[gnu::noinline]] inline NearestCell search_cells(const HeightTable<T>& t, T x, T y, T z) noexcept {
  using P = core::Pack<T>;
  const int i0 = t.column(x), j0 = t.row(y);
  const T own = t.height(i0, j0);
  NearestCell best{i0, j0, i0, j0, z < own};
  T best_squared = (z - own) * (z - own);
  const T sign = best.inside ? T(-1) : T(1);
  const T least = core::max(best.inside ? t.lowest - z : z - t.highest, T(0)), least_squared = least * least;
  // Columns farther across than this cannot be nearer; the share more covers rounding.
  const T reach_squared = best_squared - least_squared;
  if (!(reach_squared > T(0))) return best;
  const T reach = std::sqrt(reach_squared) * T(1.00001);
  const int west = t.column(x - reach), east = t.column(x + reach);
  const int south = t.row(y - reach), north = t.row(y + reach);
  const auto across_y = [&](int j) {
    return j < j0 ? core::max(y - t.edge_y(j + 1), T(0)) : j > j0 ? core::max(t.edge_y(j) - y, T(0)) : T(0);
  };
  P lane(0.0);
  for (int l = 0; l < P::width; ++l) lane.set(l, static_cast<T>(l));
  const P cell(t.cell), zero(0.0);
  for (int first = west; first <= east; first += P::width) {
    const P column = lane + P(static_cast<T>(first)), low = P(t.x0) + column * cell;
    const P high = P(t.x0) + (column + P(1.0)) * cell;
    P across = core::max(core::max(low - P(x), P(x) - high), zero);
    across = select(column == P(static_cast<T>(i0)), zero, across);
    // Lanes beyond the last column of interest read some other row's heights and are never nearest.
    const P beside = select(column <= P(static_cast<T>(east)), across * across, P(std::numeric_limits<T>::infinity()));
    const auto look = [&](int j) {
      const T r = across_y(j), r_squared = r * r;
      if (!(r_squared + least_squared < best_squared)) return false;
      const std::size_t at =
          static_cast<std::size_t>(first) + static_cast<std::size_t>(t.nx) * static_cast<std::size_t>(j);
      const std::size_t left = t.heights.size() - at;
      const P height = left >= static_cast<std::size_t>(P::width)
                           ? P::load(t.heights.data() + at)
                           : P(core::detail::load_part<T>(t.heights.data() + at, static_cast<Eigen::Index>(left)));
      const P up = core::max(P(sign) * (P(z) - height), zero), squared = beside + P(r_squared) + up * up;
      if (!core::any(squared < P(best_squared))) return true;
      for (int l = 0; l < P::width; ++l) {
        if (!(squared[l] < best_squared)) continue;
        best_squared = squared[l];
        best.i = first + l;
        best.j = j;
      }
      return true;
    };
    look(j0);
    for (int j = j0 - 1; j >= south && look(j);) --j;
    for (int j = j0 + 1; j <= north && look(j);) ++j;
  }
  return best;
}

/// Of a number that is not negative: `std::sqrt` asks whether it is.
template <class T>
[[gnu::always_inline]] inline T root(T squared) noexcept {
  return sqrt(core::Pack<T, 16 / sizeof(T)>(squared))[0];
}

template <class T, int N>
[[gnu::always_inline]] inline T least_of(const core::Pack<T, N>& x) noexcept {
  if constexpr (N == 8) {
    using Half = core::Pack<T, 4>;
    using V = typename Half::Vector;
    return least_of(core::min(Half(V(__builtin_shufflevector(x.v, x.v, 0, 1, 2, 3))),
                              Half(V(__builtin_shufflevector(x.v, x.v, 4, 5, 6, 7)))));
  } else if constexpr (N == 4) {
    using V = typename core::Pack<T, N>::Vector;
    const core::Pack<T, N> two = core::min(x, core::Pack<T, N>(V(__builtin_shufflevector(x.v, x.v, 2, 3, 2, 3))));
    return core::min(two[0], two[1]);
  } else {
    return core::min(x[0], x[1]);
  }
}

/// A point over the grid.
template <class T>
struct Spot {
  const T* heights;  ///< that of its own cell, within `HeightTable::bordered`
  T x, y;            ///< from the lowest corner of its cell, m
  T z;
};

/// Eight columns in one register, or in as many as it takes.
template <class T>
inline constexpr int share = core::native_width<T> < 8 ? core::native_width<T> : 8;

/// What is found up to three columns and rows away from a point's own, squared distances in m^2.
template <class T>
struct Nearby {
  using P = core::Pack<T, share<T>>;
  P nearest[8 / share<T>];  ///< of eight columns, from 3 west on
  P row[8 / share<T>];      ///< where in its column, from -3 to 3; where `which` asks for it
  T squared;                ///< least of `nearest`
  T beyond;                 ///< no column farther away is nearer than this
};

/// Lane l of the first four in every lane.
template <int l, class T, int N>
[[gnu::always_inline]] inline typename Nearby<T>::P spread(const core::Pack<T, N>& x) noexcept {
  if constexpr (N == 8) {
    return core::Pack<T, N>(
        typename core::Pack<T, N>::Vector(__builtin_shufflevector(x.v, x.v, l, l, l, l, l + 4, l + 4, l + 4, l + 4)));
  } else {
    return typename Nearby<T>::P(x[l]);
  }
}

/// Fifty-six heights, with no question asked between them.
template <bool inside, bool which, class T>
[[gnu::always_inline]] inline Nearby<T> nearby(const HeightTable<T>& t, const Spot<T>& p) noexcept {
  using P = typename Nearby<T>::P;
  // To the columns from 3 west to 4 east: none to the point's own.
  static constexpr T signs[8] = {1, 1, 1, 0, -1, -1, -1, -1}, steps[8] = {2, 1, 0, 0, 1, 2, 3, 4};
  const T cell = t.cell;
  const P z(p.z);
  // And to the rows, one to three and a fourth not asked for: twice, since spreading a number over a register is quick
  // from within its half.
  using Q = core::Pack<T, share<T> == 8 ? 8 : 4>;
  static constexpr T far[8] = {0, 1, 2, 3, 0, 1, 2, 3};
  const Q to_south = Q(p.y) + Q::load(far) * Q(cell), to_north = (Q::load(far) + Q(1.0)) * Q(cell) - Q(p.y);
  const Q south = to_south * to_south, north = to_north * to_north;
  Nearby<T> found;
  core::detail::unroll<8 / share<T>>([&](auto part) __attribute__((always_inline)) {
    constexpr int first = decltype(part)::value * share<T>;
    const P to_x = P::load(signs + first) * P(p.x) + P::load(steps + first) * P(cell), beside = to_x * to_x;
    const auto rise = [&](int row) __attribute__((always_inline)) {
      const P height = P::load(p.heights + row * static_cast<std::ptrdiff_t>(t.stride) + (first - 3));
      return inside ? core::max(z, height) - z : z - core::min(z, height);
    };
    const P level = rise(0);
    P nearest = level * level + beside, at(0.0);
    core::detail::unroll<3>([&](auto k) __attribute__((always_inline)) {
      constexpr int l = decltype(k)::value;
      const auto look = [&](int row, const P& along) __attribute__((always_inline)) {
        const P up = rise(row), squared = up * up + (beside + along);
        if constexpr (which) at = select(squared < nearest, P(static_cast<T>(row)), at);
        nearest = core::min(squared, nearest);
      };
      look(-l - 1, spread<l>(south));
      look(l + 1, spread<l>(north));
    });
    found.nearest[decltype(part)::value] = nearest;
    if constexpr (which) found.row[decltype(part)::value] = at;
  });
  P least = found.nearest[0];
  for (int part = 1; part < 8 / share<T>; ++part) least = core::min(least, found.nearest[part]);
  found.squared = least_of(least);
  if constexpr (inside) {
    found.beyond = t.three_squared;
  } else {
    const T fourth = p.z - core::min(p.z, t.ring[static_cast<std::size_t>(p.heights - t.bordered.data())]);
    found.beyond = core::min(fourth * fourth + t.three_squared, t.four_squared);
  }
  return found;
}

/// The squared distance of a point outside the ground if it is less than `known` (m^2), or that, by the columns up to
/// seven away; `known` is less than seven cells squared.
template <class T>
[[gnu::always_inline]] inline T squared_distance_within(const HeightTable<T>& t, const Spot<T>& p, T known) noexcept {
  using P = core::Pack<T, share<T>>;
  static constexpr T steps[8] = {0, 1, 2, 3, 4, 5, 6, 7}, back[8] = {7, 6, 5, 4, 3, 2, 1, 0};
  static constexpr T ones[8] = {0, 1, 1, 1, 1, 1, 1, 1};
  const T cell = t.cell;
  const P z(p.z);
  P nearest(known);
  const int rows = known < t.four_squared ? 4 : 7;
  for (int first = 0; first < 8; first += share<T>) {
    const P to_west = P(p.x) + P::load(back + first) * P(cell);
    const P to_east = P::load(steps + first) * P(cell) - P::load(ones + first) * P(p.x);
    const P west = to_west * to_west, east = to_east * to_east;
    for (int row = -rows; row <= rows; ++row) {
      const T along = row < 0   ? p.y - static_cast<T>(row + 1) * cell
                      : row > 0 ? static_cast<T>(row) * cell - p.y
                                : T(0);
      const T* const heights = p.heights + row * static_cast<std::ptrdiff_t>(t.stride) + first;
      const P left = z - core::min(z, P::load(heights - 8)), right = z - core::min(z, P::load(heights));
      nearest = core::min(core::min(left * left + west, right * right + east) + P(along * along), nearest);
    }
  }
  return least_of(nearest);
}

template <class T>
inline NearestCell nearest_cell(const HeightTable<T>& t, T x, T y, T z) noexcept {
  if (!(x >= t.x0 && x < t.x1 && y >= t.y0 && y < t.y1)) return search_cells(t, x, y, z);
  const int i = t.column(x), j = t.row(y);
  const Spot<T> spot{t.bordered_cell(i, j), x - t.edge_x(i), y - t.edge_y(j), z};
  const T up = z - *spot.heights;
  const bool inside = up < T(0);
  const Nearby<T> found = inside ? nearby<true, true>(t, spot) : nearby<false, true>(t, spot);
  if (!(found.squared < found.beyond)) return search_cells(t, x, y, z);
  NearestCell best{i, j, i, j, inside};
  if (!(found.squared < up * up)) return best;
  int column = 0;
  const auto at = [&](const auto& packs) { return packs[column / share<T>][column % share<T>]; };
  while (at(found.nearest) != found.squared) ++column;
  // A cell beyond the border is the border's.
  best.i = core::clamp(i + column - 3, 0, t.nx - 1);
  best.j = core::clamp(j + static_cast<int>(at(found.row)), 0, t.ny - 1);
  return best;
}

/// One point: plain numbers and dual numbers.
template <class S>
inline SurfaceSample<S> surface_of_one(const HeightGrid& grid, const core::Vector3<S>& p) noexcept {
  using std::sqrt;
  using T = decltype(core::plain(p.x));
  const HeightTable<T>& t = grid.table<T>();
  const T x = core::plain(p.x), y = core::plain(p.y), z = core::plain(p.z);
  const core::Vector3<S> up{S(0.0), S(0.0), S(1.0)};
  if (!std::isfinite(x) || !std::isfinite(y) || !std::isfinite(z))
    return {S(std::numeric_limits<double>::quiet_NaN()), up};
  if (grid.is_flat()) return {p.z - S(t.highest), up};
  const NearestCell n = nearest_cell(t, x, y, z);
  const S height(t.height(n.i, n.j));
  // Over its own top the distance is linear, also across the surface.
  if (n.i == n.own_i && n.j == n.own_j) return {p.z - height, up};
  const int sx = n.i < n.own_i ? 1 : n.i > n.own_i ? -1 : 0, sy = n.j < n.own_j ? 1 : n.j > n.own_j ? -1 : 0;
  const S a = sx > 0 ? p.x - S(t.edge_x(n.i + 1)) : sx < 0 ? p.x - S(t.edge_x(n.i)) : S(0.0);
  const S b = sy > 0 ? p.y - S(t.edge_y(n.j + 1)) : sy < 0 ? p.y - S(t.edge_y(n.j)) : S(0.0);
  S c = n.inside ? height - p.z : p.z - height;
  if (!(core::plain(c) > T(0))) c = S(0.0);
  const S out(n.inside ? -1.0 : 1.0);
  const S squared = a * a + b * b + c * c;
  if (core::plain(squared) < T(1e-20)) {
    // On a wall or at its foot: the direction across it is known, the offset too small to tell.
    const double length = sx != 0 && sy != 0 ? std::sqrt(2.0) : 1.0;
    const S ux(static_cast<T>(sx / length)), uy(static_cast<T>(sy / length));
    return {out * (ux * a + uy * b), {out * ux, out * uy, S(0.0)}};
  }
  const S d = sqrt(squared);
  return {out * d, {out * a / d, out * b / d, c / d}};
}

/// Out of the way of what most points need.
template <class T>
[[gnu::noinline]] inline T distance_of_any(const HeightGrid& grid, const core::Vector3<T>& p) noexcept {
  return surface_of_one(grid, p).distance;
}

/// The distance of a point over the grid, where what is found nearby does not settle it. Its spot comes in parts: most
/// points' are then never written to memory.
template <class T>
[[gnu::noinline]] inline T distance_farther(const HeightGrid& grid, const T* heights, T from_x, T from_y, T x, T y, T z,
                                            T squared) noexcept {
  const Spot<T> p{heights, from_x, from_y, z};
  const HeightTable<T>& t = grid.table<T>();
  if (!(p.z >= *p.heights)) {
    const Nearby<T> found = nearby<true, false>(t, p);
    if (found.squared < found.beyond) return -root(found.squared);
  } else if (squared < T(3) * t.four_squared) {
    // The sides of the point's own cell tell a little more of how far those beyond are.
    const T side = core::min(core::min(p.x, t.cell - p.x), core::min(p.y, t.cell - p.y));
    const T fourth = p.z - core::min(p.z, t.ring[static_cast<std::size_t>(p.heights - t.bordered.data())]);
    const T any = p.z - core::min(p.z, t.highest), three = side + T(3) * t.cell, four = side + T(4) * t.cell;
    if (squared < core::min(fourth * fourth + three * three, any * any + four * four)) return root(squared);
    return root(squared_distance_within(t, p, squared));
  }
  return surface_of_one(grid, core::Vector3<T>{x, y, p.z}).distance;
}

/// The whole part of a number, or some number below zero where there is none that an int holds.
template <class T>
[[gnu::always_inline]] inline int whole(T x) noexcept {
#if defined(__SSE2__)
  // A conversion as the language has it may not be asked of a number that does not fit.
  if constexpr (std::is_same_v<T, float>) return _mm_cvttss_si32(_mm_set_ss(x));
  if constexpr (std::is_same_v<T, double>) return _mm_cvttsd_si32(_mm_set_sd(x));
#endif
  return x > T(-1) && x < T(1 << 30) ? static_cast<int>(x) : -1;
}

/// As a number, of one that is not negative.
template <class T>
[[gnu::always_inline]] inline T whole_part(T x) noexcept {
#if defined(__SSE4_1__)
  // Need not wait for the integer.
  if constexpr (std::is_same_v<T, float>)
    return _mm_cvtss_f32(_mm_round_ss(_mm_set_ss(x), _mm_set_ss(x), _MM_FROUND_TO_ZERO | _MM_FROUND_NO_EXC));
#endif
  return static_cast<T>(static_cast<int>(x));
}

/// One point's distance alone: plain numbers.
template <class T>
[[gnu::always_inline]] inline T distance_of_one(const HeightGrid& grid, const core::Vector3<T>& p) noexcept {
  const HeightTable<T>& t = grid.table<T>();
  // Cells of the grid and its border, counted from the border's corner.
  const T u = (p.x - t.border_x0) * t.inverse_cell, v = (p.y - t.border_y0) * t.inverse_cell;
  const int i = whole(u), j = whole(v);
  constexpr unsigned border = HeightTable<T>::border;
  if (static_cast<unsigned>(i) - border >= static_cast<unsigned>(t.nx) ||
      static_cast<unsigned>(j) - border >= static_cast<unsigned>(t.ny))
    return distance_of_any(grid, p);
  const Spot<T> spot{t.bordered.data() + i + static_cast<std::ptrdiff_t>(t.stride) * j,
                     p.x - (t.border_x0 + whole_part(u) * t.cell), p.y - (t.border_y0 + whole_part(v) * t.cell), p.z};
  if (!(p.z >= *spot.heights)) return distance_farther(grid, spot.heights, spot.x, spot.y, p.x, p.y, p.z, T(0));
  const Nearby<T> found = nearby<false, false>(t, spot);
  return found.squared < found.beyond
             ? root(found.squared)
             : distance_farther(grid, spot.heights, spot.x, spot.y, p.x, p.y, p.z, found.squared);
}

/// The lanes' distances alone: what asks no lane's own question is done for all at once.
template <class T, int N>
inline core::Pack<T, N> distance_of_lanes(const HeightGrid& grid, const core::Vector3<core::Pack<T, N>>& p) noexcept {
  using S = core::Pack<T, N>;
  const HeightTable<T>& t = grid.table<T>();
  if (grid.is_flat()) return p.z - S(t.highest) + S(0.0) * (p.x + p.y + p.z);
  const S x = core::clamp(p.x, S(t.x0), S(t.x1)), y = core::clamp(p.y, S(t.y0), S(t.y1));
  T column[N], row[N], from_x[N], from_y[N], from_z[N], own[N], squared[N], beyond[N];
  int cell[N];
  ((x - S(t.x0)) * S(t.inverse_cell)).store(column);
  ((y - S(t.y0)) * S(t.inverse_cell)).store(row);
  for (int l = 0; l < N; ++l) {
    const int i = static_cast<int>(column[l]), j = static_cast<int>(row[l]);
    cell[l] = (i + t.border) + t.stride * (j + t.border);
    column[l] = static_cast<T>(i);
    row[l] = static_cast<T>(j);
  }
  (x - (S(t.x0) + S::load(column) * S(t.cell))).store(from_x);
  (y - (S(t.y0) + S::load(row) * S(t.cell))).store(from_y);
  p.z.store(from_z);
  const auto spot = [&](int l) { return Spot<T>{t.bordered.data() + cell[l], from_x[l], from_y[l], from_z[l]}; };
#pragma GCC unroll 1
  for (int l = 0; l < N; ++l) {
    const Nearby<T> found = nearby<false, false>(t, spot(l));
    own[l] = t.bordered[static_cast<std::size_t>(cell[l])];
    squared[l] = found.squared;
    beyond[l] = found.beyond;
  }
  S out = sqrt(S::load(squared));
  const auto over = (p.x >= S(t.x0)) & (p.x < S(t.x1)) & (p.y >= S(t.y0)) & (p.y < S(t.y1));
  const auto known = over & (S::load(squared) < S::load(beyond)) & (p.z >= S::load(own));
  if (!core::all(known)) {
    for (int l = 0; l < N; ++l) {
      if (known[l]) continue;
      out.set(l, over[l] ? distance_farther(grid, t.bordered.data() + cell[l], from_x[l], from_y[l], p.x[l], p.y[l],
                                            p.z[l], squared[l])
                         : distance_of_any(grid, core::Vector3<T>{p.x[l], p.y[l], p.z[l]}));
    }
  }
  return out;
}

}  // namespace detail

/// Exact signed distance of a point from the ground and its gradient, by looking at all cells that could be nearer
/// than the point's own. Any scalar: `double`, `float`, `ceres::Jet`, a pack (lane by lane).
///
/// Where two points of the surface are equally near the gradient belongs to one of them, always the same one. A point
/// that is not finite has the distance NaN and the normal +z.
template <core::Scalar S>
inline SurfaceSample<S> surface(const HeightGrid& grid, const core::Vector3<S>& p) noexcept {
  if constexpr (std::is_same_v<S, core::Element<S>>) {
    return detail::surface_of_one(grid, p);
  } else {
    using T = core::Element<S>;
    SurfaceSample<S> out;
    for (int l = 0; l < core::lane_count<S>; ++l) {
      const SurfaceSample<T> one = detail::surface_of_one(grid, core::Vector3<T>{p.x[l], p.y[l], p.z[l]});
      out.distance.set(l, one.distance);
      out.normal.x.set(l, one.normal.x);
      out.normal.y.set(l, one.normal.y);
      out.normal.z.set(l, one.normal.z);
    }
    return out;
  }
}

/// Exact signed distance of a point from the ground, m, negative inside (PARC C.1, which approximates it inside).
template <core::Scalar S>
inline S signed_distance(const HeightGrid& grid, const core::Vector3<S>& p) noexcept {
  if constexpr (std::is_floating_point_v<S>) {
    return detail::distance_of_one(grid, p);
  } else if constexpr (core::lane_count<S> > 1) {
    return detail::distance_of_lanes(grid, p);
  } else {
    return surface(grid, p).distance;
  }
}

/// As `surface`, for contacts: exact (to a micrometre and rounding) where the distance is at most `reach` (m);
/// elsewhere the distance is some number above `reach` and the normal any unit vector. A pack looks only at the cells
/// around each lane's own, and at one number where all lanes are high above them. A lane that is not finite has the
/// distance NaN and reads no foreign memory.
template <core::Scalar S>
inline SurfaceSample<S> contact_surface(const HeightGrid& grid, const core::Vector3<S>& p,
                                        core::Element<S> reach) noexcept {
  using core::clamp;
  using core::max;
  using core::min;
  using core::select;
  using T = core::Element<S>;
  if constexpr (std::is_same_v<S, T>) {
    (void)reach;
    return surface(grid, p);
  } else {
    const HeightTable<T>& t = grid.table<T>();
    const S zero(0.0), one(1.0);
    // A lane that is not finite shows in its distance, whatever cell its index was clamped to.
    const S taint = zero * (p.x + p.y + p.z);
    if (grid.is_flat()) return {p.z - S(t.highest) + taint, {zero, zero, one}};
    // Cells two steps away are a whole cell off; nothing further than that is settled by the nine around the point.
    if (reach >= t.cell) return surface(grid, p);

    constexpr int lanes = core::lane_count<S>;
    const S px = clamp((p.x - S(t.x0)) * S(t.inverse_cell), zero, S(t.nx - 1));
    const S py = clamp((p.y - S(t.y0)) * S(t.inverse_cell), zero, S(t.ny - 1));
    const T* const tops = t.tops.data();
    const T* const heights = t.heights.data();
    const int nx = t.nx, ny = t.ny;
    // Plain arrays: compilers turn loops over them into vector code, and element-wise writes to a pack they do not.
    T fx[lanes], fy[lanes], gathered[lanes];
    int column[lanes], row[lanes];
    px.store(fx);
    py.store(fy);
    for (int l = 0; l < lanes; ++l) {
      column[l] = static_cast<int>(fx[l]);
      row[l] = static_cast<int>(fy[l]);
    }
    for (int l = 0; l < lanes; ++l) {
      fx[l] = static_cast<T>(column[l]);
      fy[l] = static_cast<T>(row[l]);
    }
    for (int l = 0; l < lanes; ++l) gathered[l] = tops[column[l] + nx * row[l]];
    const S edge_x = S::load(fx), edge_y = S::load(fy), top = S::load(gathered);
    const S above = p.z - top;
    if (core::all(above > S(reach))) return {above + taint, {zero, zero, one}};

    int west[lanes], east[lanes], south[lanes], north[lanes];
    for (int l = 0; l < lanes; ++l) {
      west[l] = column[l] > 0 ? column[l] - 1 : 0;
      east[l] = column[l] + 1 < nx ? column[l] + 1 : nx - 1;
      south[l] = nx * (row[l] > 0 ? row[l] - 1 : 0);
      north[l] = nx * (row[l] + 1 < ny ? row[l] + 1 : ny - 1);
      row[l] *= nx;
    }
    const int* const columns[3] = {west, column, east};
    const int* const rows[3] = {south, row, north};
    const auto gather = [&](int di, int dj) {
      const int* const i = columns[di + 1];
      const int* const j = rows[dj + 1];
      for (int l = 0; l < lanes; ++l) gathered[l] = heights[i[l] + j[l]];
      return S::load(gathered);
    };
    const S own = gather(0, 0);
    const auto inside = p.z < own;
    const S sign = select(inside, -one, one);
    // The floors keep the normal defined on a wall and on a top.
    const S least_across(1e-6), least_up(1e-15);
    const S u = p.x - (S(t.x0) + edge_x * S(t.cell)), v = p.y - (S(t.y0) + edge_y * S(t.cell));
    const S offset_x[3] = {max(u, least_across), zero, -max(S(t.cell) - u, least_across)};
    const S offset_y[3] = {max(v, least_across), zero, -max(S(t.cell) - v, least_across)};
    S a = zero, b = zero, c = max(sign * (p.z - own), least_up);
    S best = c * c;
    const S reach_squared(reach * reach);
    for (int dj = -1; dj <= 1; ++dj)
      for (int di = -1; di <= 1; ++di) {
        if (di == 0 && dj == 0) continue;
        // A cell beyond the border is the border cell itself, which its offset only makes farther than it is.
        const S rx = offset_x[di + 1], ry = offset_y[dj + 1];
        const S across = rx * rx + ry * ry;
        // Outside, a cell beyond reach is of no interest; inside, one farther than the best is not.
        if (!core::any(across <= select(inside, best, min(best, reach_squared)))) continue;
        const S up = max(sign * (p.z - gather(di, dj)), zero);
        const S squared = across + up * up;
        const auto nearer = squared < best;
        best = select(nearer, squared, best);
        a = select(nearer, rx, a);
        b = select(nearer, ry, b);
        c = select(nearer, up, c);
      }
    const S d = sqrt(best);
    const S scale = one / d;
    SurfaceSample<S> out{sign * d + taint, {sign * scale * a, sign * scale * b, scale * c}};
    const auto deep = inside & (d > S(t.cell));
    if (core::any(deep)) {
      for (int l = 0; l < lanes; ++l) {
        if (!deep[l]) continue;
        const SurfaceSample<T> lane = detail::surface_of_one(grid, core::Vector3<T>{p.x[l], p.y[l], p.z[l]});
        out.distance.set(l, lane.distance);
        out.normal.x.set(l, lane.normal.x);
        out.normal.y.set(l, lane.normal.y);
        out.normal.z.set(l, lane.normal.z);
      }
    }
    return out;
  }
}

}  // namespace traceur::terrain
