// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>

#include <nlohmann/json.hpp>

#include "traceur/core/error.hpp"
#include "traceur/io/atomic_file.hpp"
#include "traceur/io/detail/json.hpp"
#include "traceur/terrain/height_grid.hpp"

namespace traceur::io {

namespace detail {

inline constexpr std::size_t terrain_max_bytes = std::size_t{256} << 20;

inline double terrain_number(const nlohmann::json& value, const std::string& where) {
  if (!value.is_number()) throw Error(where + ": expected a number");
  return value.get<double>();
}

inline const nlohmann::json& terrain_field(const nlohmann::json& object, const char* key, const std::string& where) {
  const auto found = object.find(key);
  if (found == object.end()) throw Error(where + ": expected field '" + key + "'");
  return *found;
}

/// A pair of numbers.
inline Eigen::Vector2d terrain_pair(const nlohmann::json& value, const std::string& where) {
  if (!value.is_array() || value.size() != 2) throw Error(where + ": expected two numbers");
  return {terrain_number(value[0], where), terrain_number(value[1], where)};
}

/// An array of arrays of one size as a matrix whose row is the outer index.
inline Eigen::MatrixXd terrain_heights(const nlohmann::json& value, const std::string& where) {
  if (!value.is_array() || value.empty() || !value[0].is_array() || value[0].empty())
    throw Error(where + ": expected an array of arrays of heights");
  const std::size_t nx = value.size(), ny = value[0].size();
  if (nx > static_cast<std::size_t>(terrain::HeightGrid::max_cells) / ny)
    throw Error(where + ": expected at most " + std::to_string(terrain::HeightGrid::max_cells) + " cells");
  Eigen::MatrixXd h(static_cast<Eigen::Index>(nx), static_cast<Eigen::Index>(ny));
  for (std::size_t i = 0; i < nx; ++i) {
    const std::string row = where + "[" + std::to_string(i) + "]";
    if (!value[i].is_array() || value[i].size() != ny)
      throw Error(row + ": expected " + std::to_string(ny) + " heights");
    for (std::size_t j = 0; j < ny; ++j) {
      if (!value[i][j].is_number()) throw Error(row + "[" + std::to_string(j) + "]: expected a number");
      h(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = value[i][j].get<double>();
    }
  }
  return h;
}

}  // namespace detail

/// A height grid from a JSON object, in either of two forms, heights[i][j] with i along x:
/// ours, {"cell_m": d, "corner_m": [x0, y0], "heights_m": [[...], ...]} with the lowest corner of cell (0, 0); and
/// PARC's,
/// {"dx": d, "min_point": [x, y], "hf": [[...], ...]}, where min_point is the middle of cell (0, 0) (PARC A.1). Other
/// fields are passed over. Throws Error, one line beginning with `where`.
inline terrain::HeightGrid terrain_from_json(const nlohmann::json& object, const std::string& where) {
  if (!object.is_object()) throw Error(where + ": expected an object");
  const bool parc = object.contains("hf");
  const std::string side_key = parc ? "dx" : "cell_m", place_key = parc ? "min_point" : "corner_m",
                    heights_key = parc ? "hf" : "heights_m";
  const double side =
      detail::terrain_number(detail::terrain_field(object, side_key.c_str(), where), where + ": " + side_key);
  Eigen::Vector2d corner =
      detail::terrain_pair(detail::terrain_field(object, place_key.c_str(), where), where + ": " + place_key);
  if (parc) corner.array() -= 0.5 * side;
  return terrain::HeightGrid(
      detail::terrain_heights(detail::terrain_field(object, heights_key.c_str(), where), where + ": " + heights_key),
      side, corner.x(), corner.y(), where);
}

/// A height grid from JSON text; a file with a field "terrain", as a motion of PARC is, is read for that field alone.
/// Throws Error, one line beginning with `name`.
inline terrain::HeightGrid parse_terrain(std::string_view text, const std::string& name) {
  if (text.size() > detail::terrain_max_bytes) throw Error(name + ": expected at most 256 MiB");
  const nlohmann::json root = detail::parse_json(text, name);
  if (root.is_object() && root.contains("terrain")) return terrain_from_json(root["terrain"], name + ": terrain");
  return terrain_from_json(root, name);
}

/// Reads a file for parse_terrain. Throws Error if it cannot be read.
inline terrain::HeightGrid read_terrain(const std::filesystem::path& path) {
  std::error_code failure;
  const auto size = std::filesystem::file_size(path, failure);
  if (failure) throw Error(path.string() + ": cannot be opened: " + failure.message());
  if (size > detail::terrain_max_bytes) throw Error(path.string() + ": expected at most 256 MiB");
  std::ifstream in(path, std::ios::binary);
  std::string text(static_cast<std::size_t>(size), '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (!in) throw Error(path.string() + ": cannot be read");
  return parse_terrain(text, path.string());
}

/// The grid as a JSON object of our form. Numbers are written in full, so reading gives the same grid.
inline nlohmann::json terrain_to_json(const terrain::HeightGrid& grid) {
  nlohmann::json heights = nlohmann::json::array();
  for (int i = 0; i < grid.nx(); ++i) {
    nlohmann::json row = nlohmann::json::array();
    for (int j = 0; j < grid.ny(); ++j) row.push_back(grid(i, j));
    heights.push_back(std::move(row));
  }
  return {{"cell_m", grid.cell()}, {"corner_m", {grid.x0(), grid.y0()}}, {"heights_m", std::move(heights)}};
}

/// Writes the grid; the file is complete or absent. Throws Error.
inline void write_terrain(const std::filesystem::path& path, const terrain::HeightGrid& grid) {
  write_atomically(path, terrain_to_json(grid).dump() + "\n");
}

}  // namespace traceur::io
