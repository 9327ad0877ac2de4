// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include <Eigen/Core>

#include "traceur/core/error.hpp"
#include "traceur/core/random.hpp"
#include "traceur/terrain/height_grid.hpp"

namespace traceur::terrain {

/// Every `window` by `window` block of cells at the height of its highest cell (PARC A.2.1 with window 2, stride 2), so
/// that no gap and no wall is thinner than the window. What the size leaves over at the far borders joins the last
/// block: a strip of its own would be thinner. A grid smaller than the window becomes one block.
inline Eigen::MatrixXd max_pool(const Eigen::Ref<const Eigen::MatrixXd>& heights, int window) {
  if (window < 1) throw Error("max_pool: expected a window of one cell or more");
  Eigen::MatrixXd out(heights.rows(), heights.cols());
  const auto blocks = [window](Eigen::Index n) { return std::max<Eigen::Index>(n / window, 1); };
  const auto first = [window](Eigen::Index block) { return block * window; };
  const auto length = [&](Eigen::Index block, Eigen::Index n) {
    return (block + 1 == blocks(n) ? n : first(block + 1)) - first(block);
  };
  for (Eigen::Index b = 0; b < blocks(heights.cols()); ++b)
    for (Eigen::Index a = 0; a < blocks(heights.rows()); ++a) {
      const Eigen::Index rows = length(a, heights.rows()), cols = length(b, heights.cols());
      out.block(first(a), first(b), rows, cols).setConstant(heights.block(first(a), first(b), rows, cols).maxCoeff());
    }
  return out;
}

/// Overlapping blocks on flat ground (PARC A.2.1; ten boxes is the authors' code's number).
struct RandomBoxes {
  int nx = 16, ny = 16;                    ///< cells
  double cell = HeightGrid::default_cell;  ///< m
  int boxes = 10;                          ///< placed one after the other, the later over the earlier
  int side_min = 5, side_max = 10;         ///< cells, each of a box's two sides
  double height_min = -2, height_max = 2;  ///< of a box's top, m
  double ground = 0;                       ///< m
  int window = 2;                          ///< cells of the final `max_pool`; 1 for none
};

/// Paths of random height that wander over flat ground (PARC A.2.2). The paper gives size and number of paths; their
/// length, width and readiness to turn are chosen here.
struct RandomWalks {
  int nx = 32, ny = 32;                    ///< cells
  double cell = HeightGrid::default_cell;  ///< m
  int paths = 10;                          ///< the later over the earlier
  int steps = 64;                          ///< cells a path is long
  int width = 2;                           ///< cells a path is wide
  double turn = 0.25;                      ///< chance to turn by a quarter before a step
  double height_min = -2, height_max = 2;  ///< of a path, m
  double ground = 0;                       ///< m

  /// The numbers of the authors' code: raised ways over a deep floor.
  static RandomWalks parc_code() {
    RandomWalks p;
    p.paths = 8;
    p.height_min = -1.6;
    p.height_max = 2.0;
    p.ground = -2.0;
    return p;
  }
};

/// Flights of stairs, each from the landing where the last one ended, up or down, ahead or round a corner. Rise, number
/// and width are those of PARC's code; how long a flight is, is chosen here.
struct Stairs {
  int nx = 16, ny = 16;                    ///< cells
  double cell = HeightGrid::default_cell;  ///< m, also the tread of a step
  int flights = 4;
  double rise_min = 0.15, rise_max = 0.25;  ///< of one step, m; the same within a flight
  int width_min = 2, width_max = 8;         ///< cells
  int steps_min = 3, steps_max = 8;         ///< per flight
  int landing = 2;                          ///< cells
  double ground = 0;                        ///< m
};

namespace detail {

inline void require(bool good, const char* generator, const char* expected) {
  if (!good) throw Error(std::string(generator) + ": expected " + expected);
}

inline void require_size(int nx, int ny, const char* generator) {
  require(nx > 0 && ny > 0 && nx <= HeightGrid::max_cells / ny, generator, "at least one cell each way");
}

/// Uniform in [low, high].
inline int between(core::RandomStream& random, int low, int high) {
  return low + static_cast<int>(random.below(static_cast<std::uint32_t>(high - low + 1)));
}

/// Sets the part of a rectangle of cells that lies within the grid.
inline void paint(Eigen::MatrixXd& heights, int i, int j, int rows, int cols, double height) {
  const int i0 = std::max(i, 0), j0 = std::max(j, 0);
  const int i1 = std::min(i + rows, static_cast<int>(heights.rows()));
  const int j1 = std::min(j + cols, static_cast<int>(heights.cols()));
  if (i1 > i0 && j1 > j0) heights.block(i0, j0, i1 - i0, j1 - j0).setConstant(height);
}

inline constexpr int step_i[4] = {1, 0, -1, 0}, step_j[4] = {0, 1, 0, -1};

}  // namespace detail

/// Throws Error on a size, side or range that is empty.
inline HeightGrid random_boxes(const RandomBoxes& p, core::RandomStream& random) {
  constexpr const char* name = "random boxes";
  detail::require_size(p.nx, p.ny, name);
  detail::require(p.boxes >= 0, name, "no negative number of boxes");
  detail::require(p.side_min > 0 && p.side_min <= p.side_max, name, "1 <= side_min <= side_max");
  detail::require(p.height_min <= p.height_max, name, "height_min <= height_max");
  Eigen::MatrixXd h = Eigen::MatrixXd::Constant(p.nx, p.ny, p.ground);
  for (int b = 0; b < p.boxes; ++b) {
    const int i = detail::between(random, 0, p.nx - 1), j = detail::between(random, 0, p.ny - 1);
    const int rows = detail::between(random, p.side_min, p.side_max),
              cols = detail::between(random, p.side_min, p.side_max);
    detail::paint(h, i - rows / 2, j - cols / 2, rows, cols, random.uniform(p.height_min, p.height_max));
  }
  return HeightGrid(max_pool(h, p.window), p.cell, 0, 0, name);
}

/// Throws Error on a size, width, chance or range that makes no sense.
inline HeightGrid random_walks(const RandomWalks& p, core::RandomStream& random) {
  constexpr const char* name = "random walks";
  detail::require_size(p.nx, p.ny, name);
  detail::require(p.paths >= 0 && p.steps >= 0, name, "no negative number of paths or steps");
  detail::require(p.width > 0, name, "a width of one cell or more");
  detail::require(p.turn >= 0 && p.turn <= 1, name, "a chance to turn in [0, 1]");
  detail::require(p.height_min <= p.height_max, name, "height_min <= height_max");
  Eigen::MatrixXd h = Eigen::MatrixXd::Constant(p.nx, p.ny, p.ground);
  for (int path = 0; path < p.paths; ++path) {
    const double height = random.uniform(p.height_min, p.height_max);
    int i = detail::between(random, 0, p.nx - 1), j = detail::between(random, 0, p.ny - 1);
    auto way = static_cast<int>(random.below(4));
    for (int step = 0; step < p.steps; ++step) {
      detail::paint(h, i, j, p.width, p.width, height);
      if (random.bernoulli(p.turn)) way = (way + (random.bernoulli(0.5) ? 1 : 3)) % 4;
      const auto inside = [&] {
        const int a = i + detail::step_i[way], b = j + detail::step_j[way];
        return a >= 0 && a < p.nx && b >= 0 && b < p.ny;
      };
      if (p.nx == 1 && p.ny == 1) break;
      while (!inside()) way = static_cast<int>(random.below(4));
      i += detail::step_i[way];
      j += detail::step_j[way];
    }
  }
  return HeightGrid(std::move(h), p.cell, 0, 0, name);
}

/// Throws Error on a size, number or range that makes no sense.
inline HeightGrid stairs(const Stairs& p, core::RandomStream& random) {
  constexpr const char* name = "stairs";
  detail::require_size(p.nx, p.ny, name);
  detail::require(p.flights >= 0 && p.landing >= 0, name, "no negative number of flights or cells of a landing");
  detail::require(p.rise_min <= p.rise_max, name, "rise_min <= rise_max");
  detail::require(p.width_min > 0 && p.width_min <= p.width_max, name, "1 <= width_min <= width_max");
  detail::require(p.steps_min > 0 && p.steps_min <= p.steps_max, name, "1 <= steps_min <= steps_max");
  Eigen::MatrixXd h = Eigen::MatrixXd::Constant(p.nx, p.ny, p.ground);
  int i = detail::between(random, 0, p.nx - 1), j = detail::between(random, 0, p.ny - 1);
  auto way = static_cast<int>(random.below(4));
  double height = p.ground;
  for (int flight = 0; flight < p.flights; ++flight) {
    const double rise = random.uniform(p.rise_min, p.rise_max) * (flight > 0 && random.bernoulli(0.5) ? -1 : 1);
    const int width = detail::between(random, p.width_min, p.width_max);
    const int steps = detail::between(random, p.steps_min, p.steps_max);
    // One row of cells across the way, `width` long.
    const auto row = [&] {
      const bool along_x = detail::step_i[way] != 0;
      detail::paint(h, along_x ? i : i - width / 2, along_x ? j - width / 2 : j, along_x ? 1 : width,
                    along_x ? width : 1, height);
      i += detail::step_i[way];
      j += detail::step_j[way];
    };
    for (int step = 0; step < steps; ++step) {
      height += rise;
      row();
    }
    for (int step = 0; step < p.landing; ++step) row();
    i = std::clamp(i - detail::step_i[way], 0, p.nx - 1);
    j = std::clamp(j - detail::step_j[way], 0, p.ny - 1);
    way = (way + 3 + static_cast<int>(random.below(3))) % 4;
  }
  return HeightGrid(std::move(h), p.cell, 0, 0, name);
}

/// The part of a terrain that begins at cell (i, j), where it was in the world. Throws Error if it is not within the
/// grid.
inline HeightGrid slice(const HeightGrid& grid, int i, int j, int nx, int ny) {
  if (i < 0 || j < 0 || nx < 1 || ny < 1 || nx > grid.nx() - i || ny > grid.ny() - j)
    throw Error("slice: expected cells within a grid of " + std::to_string(grid.nx()) + " by " +
                std::to_string(grid.ny()));
  return HeightGrid(grid.heights().block(i, j, nx, ny), grid.cell(), grid.x0() + i * grid.cell(),
                    grid.y0() + j * grid.cell(), "slice");
}

/// A slice of nx by ny cells from anywhere in a large terrain, every place equally likely (PARC A.2.3: 16 by 16 of 100
/// by 100).
inline HeightGrid random_slice(const HeightGrid& grid, int nx, int ny, core::RandomStream& random) {
  if (nx < 1 || ny < 1 || nx > grid.nx() || ny > grid.ny()) return slice(grid, 0, 0, nx, ny);
  const int i = detail::between(random, 0, grid.nx() - nx);
  return slice(grid, i, detail::between(random, 0, grid.ny() - ny), nx, ny);
}

}  // namespace traceur::terrain
