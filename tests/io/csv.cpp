// SPDX-License-Identifier: MIT
#include <traceur/io/csv.hpp>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include "motions.hpp"

using motions::contains;
using motions::error_of;
using traceur::io::clip_table;
using traceur::io::CsvTable;
using traceur::io::format_csv;

namespace {

/// Reads RFC 4180 by its grammar, knowing nothing of the writer.
std::vector<std::vector<std::string>> fields(const std::string& text) {
  std::vector<std::vector<std::string>> rows;
  std::vector<std::string> row;
  std::string field;
  bool quoted = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (quoted) {
      if (c != '"') {
        field += c;
      } else if (i + 1 < text.size() && text[i + 1] == '"') {
        field += '"';
        ++i;
      } else {
        quoted = false;
      }
    } else if (c == '"') {
      quoted = true;
    } else if (c == ',') {
      row.push_back(std::move(field));
      field.clear();
    } else if (c == '\n') {
      row.push_back(std::move(field));
      field.clear();
      rows.push_back(std::move(row));
      row.clear();
    } else {
      field += c;
    }
  }
  return rows;
}

traceur::motion::Clip arm() {
  using namespace traceur::body;
  traceur::motion::Clip clip;
  Joint root, elbow, hand, tip;
  root.name = root.body = "root";
  root.type = JointType::free;
  elbow.name = "elbow";
  elbow.body = "lower_arm";
  elbow.parent = 0;
  elbow.type = JointType::hinge;
  hand.name = hand.body = "hand";
  hand.parent = 1;
  tip.name = tip.body = "tip";
  tip.parent = 2;
  tip.type = JointType::fixed;
  for (const Joint& j : {root, elbow, hand, tip}) clip.skeleton.add(j);
  clip.times = Eigen::Vector2d(0, 0.1);
  clip.poses = clip.skeleton.neutral_pose().replicate(1, 2);
  clip.poses.col(1).head(3) << 1.0 / 3, -2, 5e-324;
  clip.poses(7, 1) = 0.25;
  return clip;
}

}  // namespace

TEST_CASE("numbers come back with their bits, names with their commas") {
  CsvTable table;
  table.columns = {"a", "b, in \"m\"", "c\nd"};
  table.values.resize(3, 3);
  const double inf = std::numeric_limits<double>::infinity();
  table.values << 0.1, -0.0, 1e300, 1.0 / 3, 5e-324, -7, std::nan(""), inf, -inf;
  const auto rows = fields(format_csv(table));
  REQUIRE(rows.size() == 4);
  CHECK(rows[0] == table.columns);
  for (Eigen::Index r = 0; r < 3; ++r)
    for (Eigen::Index c = 0; c < 3; ++c) {
      const double read =
          std::strtod(rows[static_cast<std::size_t>(r) + 1][static_cast<std::size_t>(c)].c_str(), nullptr);
      const double expected = table.values(r, c);
      CHECK(std::isnan(read) == std::isnan(expected));
      if (!std::isnan(expected)) CHECK(read == expected);
      CHECK(std::signbit(read) == std::signbit(expected));
    }
}

TEST_CASE("a table without rows is its names") {
  CsvTable table;
  table.columns = {"a", "b"};
  table.values.resize(0, 2);
  CHECK(format_csv(table) == "a,b\n");
}

TEST_CASE("a clip has a column for every number") {
  traceur::motion::Clip clip = arm();
  CsvTable table = clip_table(clip);
  CHECK(table.columns == std::vector<std::string>{"time_s", "root.x_m", "root.y_m", "root.z_m", "root.qx", "root.qy",
                                                  "root.qz", "root.qw", "elbow.angle_rad", "hand.qx", "hand.qy",
                                                  "hand.qz", "hand.qw"});
  CHECK(table.values.col(0) == clip.times);
  CHECK(table.values.rightCols(clip.skeleton.nq()) == clip.poses.transpose());
  clip.contacts.setConstant(4, 2, 0.5);
  table = clip_table(clip);
  REQUIRE(table.columns.size() == 17);
  CHECK(table.columns[14] == "lower_arm.contact");
  CHECK(table.values(1, 14) == 0.5);
  CHECK(fields(format_csv(table)).size() == 3);
}

TEST_CASE("a file is written whole") {
  const auto path = std::filesystem::temp_directory_path() / "traceur-test-csv.csv";
  const CsvTable table = clip_table(arm());
  traceur::io::write_csv(path, table);
  std::ifstream in(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  CHECK(text == format_csv(table));
  std::filesystem::remove(path);
  CHECK(contains(error_of([&] { traceur::io::write_csv("/no/such/folder/t.csv", table); }), "cannot write"));
}

TEST_CASE("what is no table is refused") {
  CsvTable table;
  CHECK(contains(error_of([&] { format_csv(table); }), "at least one column"));
  table.columns = {"a", "b"};
  table.values.resize(1, 3);
  CHECK(contains(error_of([&] { format_csv(table); }), "expected 2 columns of values, found 3"));
  table.values.resize(1, 2);
  table.columns = {"a", "a"};
  CHECK(contains(error_of([&] { format_csv(table); }), "a second column named 'a'"));
  table.columns = {"a", ""};
  CHECK(contains(error_of([&] { format_csv(table); }), "column 1: expected a name"));
  traceur::motion::Clip clip = arm();
  clip.times[1] = 0;
  CHECK(contains(error_of([&] { clip_table(clip); }), "frame 1"));
}
