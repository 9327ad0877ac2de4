// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "traceur/core/error.hpp"
#include "traceur/io/atomic_file.hpp"
#include "traceur/io/detail/text.hpp"
#include "traceur/motion/clip.hpp"

namespace traceur::io {

/// Numbers under names, one name a column.
struct CsvTable {
  std::vector<std::string> columns;
  Eigen::MatrixXd values;  ///< rows x columns

  /// Throws Error that names the column: none, one without a name, two of one name, or values of another width.
  void check() const {
    if (columns.empty()) throw Error("CSV: expected at least one column");
    if (values.cols() != static_cast<Eigen::Index>(columns.size()))
      throw Error("CSV: expected " + std::to_string(columns.size()) + " columns of values, found " +
                  std::to_string(values.cols()));
    for (std::size_t i = 0; i < columns.size(); ++i) {
      if (columns[i].empty()) throw Error("CSV: column " + std::to_string(i) + ": expected a name");
      for (std::size_t k = 0; k < i; ++k)
        if (columns[k] == columns[i]) throw Error("CSV: a second column named " + detail::shown(columns[i]));
    }
  }
};

namespace detail {

/// A field as RFC 4180 has it: quoted where a comma, a quote or a line's end would end it, quotes doubled.
inline void append_csv_field(std::string& out, std::string_view field) {
  if (field.find_first_of(",\"\r\n") == std::string_view::npos) {
    out += field;
    return;
  }
  out += '"';
  for (const char c : field) {
    if (c == '"') out += '"';
    out += c;
  }
  out += '"';
}

}  // namespace detail

/// The table as text (RFC 4180, but lines end with a line feed alone): a line of names, then one a row. Numbers read
/// back with the same bits, in every locale; those that are not finite are `nan`, `inf` and `-inf`.
inline std::string format_csv(const CsvTable& table) {
  table.check();
  std::string out;
  for (std::size_t i = 0; i < table.columns.size(); ++i) {
    if (i > 0) out += ',';
    detail::append_csv_field(out, table.columns[i]);
  }
  out += '\n';
  for (Eigen::Index r = 0; r < table.values.rows(); ++r) {
    for (Eigen::Index c = 0; c < table.values.cols(); ++c) {
      if (c > 0) out += ',';
      detail::append_number(out, table.values(r, c));
    }
    out += '\n';
  }
  return out;
}

/// Writes the table whole or not at all; see format_csv.
inline void write_csv(const std::filesystem::path& path, const CsvTable& table) {
  write_atomically(path, format_csv(table));
}

/// A clip as a table with one row a key: `time_s`; the root's `<joint>.x_m`, `.y_m`, `.z_m` if it is free; then every
/// joint's coordinates as `body::Skeleton` lays them out, quaternions as `<joint>.qx` to `.qw`, hinges as
/// `<joint>.angle_rad`; then, if the clip has labels, `<body>.contact`. Throws Error when the clip does not pass its
/// own check or two joints are of one name.
inline CsvTable clip_table(const motion::Clip& clip) {
  clip.check();
  CsvTable table;
  table.columns.push_back("time_s");
  for (const body::Joint& j : clip.skeleton.joints()) {
    if (j.type == body::JointType::hinge) table.columns.push_back(j.name + ".angle_rad");
    if (j.type == body::JointType::free)
      for (const char* axis : {".x_m", ".y_m", ".z_m"}) table.columns.push_back(j.name + axis);
    if (j.type == body::JointType::free || j.type == body::JointType::ball)
      for (const char* part : {".qx", ".qy", ".qz", ".qw"}) table.columns.push_back(j.name + part);
  }
  const bool contacts = clip.contacts.cols() != 0;
  if (contacts)
    for (const body::Joint& j : clip.skeleton.joints()) table.columns.push_back(j.body + ".contact");
  table.values.resize(clip.keys(), static_cast<Eigen::Index>(table.columns.size()));
  table.values.col(0) = clip.times;
  table.values.middleCols(1, clip.skeleton.nq()) = clip.poses.transpose();
  if (contacts) table.values.rightCols(clip.skeleton.size()) = clip.contacts.transpose();
  table.check();
  return table;
}

}  // namespace traceur::io
