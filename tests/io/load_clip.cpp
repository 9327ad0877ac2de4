// SPDX-License-Identifier: MIT
#include <traceur/io/load_clip.hpp>

#include <cmath>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include "motions.hpp"

using motions::contains;
using motions::error_of;
using motions::Person;
using namespace traceur;

namespace {

std::string walk() {
  const Person p;
  return p.text({p.row(0, 0.95, 0), p.row(0, 0.95, 0.1), p.row(0, 0.95, 0.2)});
}

void put(const std::filesystem::path& path, const std::string& text) { std::ofstream(path, std::ios::binary) << text; }

std::string deepmimic() {
  std::string frame = "[0.1, 0, 0.9, 0";
  for (const int numbers : {4, 4, 4, 4, 1, 4, 4, 1, 4, 1, 4, 4, 1}) frame += numbers == 4 ? ", 1, 0, 0, 0" : ", 0";
  return "{\"Loop\": \"wrap\", \"Frames\": [" + frame + "], " + frame + "]]}";
}

}  // namespace

TEST_CASE("every format is found by content, whatever its extension") {
  const motions::Folder folder;
  put(folder / "a.bvh", walk());
  put(folder / "b.txt", walk());
  put(folder / "c.txt", deepmimic());
  put(folder / "d.json", deepmimic());
  put(folder / "e.json", R"({"fps":30,"node_names":["p"],"parent_indices":[-1],"local_translation":[[0,0,0]],
    "root_translation":[[0,0,1],[0,0,1]],"rotation":[[[0,0,0,1]],[[0,0,0,1]]]})");
  io::write_clip(folder / "f.jsonl", io::load_clip(folder / "a.bvh").clip);
  io::write_clip(folder / "g.json", io::load_clip(folder / "a.bvh").clip);
  struct Case {
    const char *name, *format;
  };
  for (const Case& c :
       {Case{"a.bvh", "BVH"}, Case{"b.txt", "BVH"}, Case{"c.txt", "DeepMimic"}, Case{"d.json", "DeepMimic"},
        Case{"e.json", "AMP JSON"}, Case{"f.jsonl", "traceur clip"}, Case{"g.json", "traceur clip"}}) {
    CAPTURE(c.name);
    const io::LoadedClip loaded = io::load_clip(folder / c.name);
    CHECK(loaded.report.format == c.format);
    CHECK(loaded.report.source == (folder / c.name).string());
    CHECK(!loaded.report.unit_reason.empty());
    CHECK(!loaded.report.up_reason.empty());
    CHECK(!loaded.report.rotation_order.empty());
    CHECK(loaded.report.fps > 0);
    CHECK(!loaded.report.fps_reason.empty());
  }
  CHECK(io::load_clip(folder / "c.txt").clip.cyclic);
}

TEST_CASE("what is no motion is refused with what would be one") {
  const motions::Folder folder;
  const auto fault = [&](const std::string& name, const std::string& text, const std::string& expected) {
    put(folder / name, text);
    const std::string message = error_of([&] { io::load_clip(folder / name); });
    CAPTURE(message);
    CHECK(contains(message, name));
    CHECK(contains(message, expected));
    CHECK(!contains(message, "\n"));
  };
  fault("a.txt", "", "found an empty file");
  fault("b.txt", "  \n\n", "found an empty file");
  fault("c.xml", "<mujoco/>",
        "expected a motion in BVH (.bvh), Acclaim (.amc), DeepMimic (.txt), JSON (.json) or our own format (.jsonl)");
  fault("d.asf", ":version", "a skeleton; expected a motion");
  fault("e.txt", "{\"Skeleton\": {}}", "a DeepMimic character; expected a motion");
  fault("f.json", "{\"a\": 1}", "found neither");
  fault("g.bvh", "not a bvh", "expected 'HIERARCHY'");
  fault("h.bin", std::string("\0\1\2\xFF", 4), "expected a motion in BVH");
  fault("i_01.amc", "1\n", "expected its skeleton at");
  CHECK(contains(error_of([&] { io::load_clip(folder / "none.bvh"); }), "none.bvh: no such file"));
  CHECK(contains(error_of([&] { io::load_clip(folder / ""); }), "found a folder"));
}

TEST_CASE("options reach the reader, or are refused where they mean nothing") {
  const motions::Folder folder;
  put(folder / "a.bvh", walk());
  put(folder / "c.txt", deepmimic());
  io::LoadOptions options;
  options.unit = 0.02;
  options.skip_frames = 1;
  options.cyclic = true;
  const io::LoadedClip loaded = io::load_clip(folder / "a.bvh", options);
  CHECK(loaded.clip.poses(2, 0) == doctest::Approx(1.9));
  CHECK(loaded.clip.keys() == 2);
  CHECK(loaded.clip.cyclic);
  CHECK(loaded.report.cycle_gap_angle == doctest::Approx(0).epsilon(1e-9));
  CHECK(contains(loaded.report.notes.back(), "cyclic, as asked"));
  options = {};
  const io::LoadedClip stated = io::load_clip(folder / "a.bvh");
  options.fps = 0.5 * stated.report.fps;
  const io::LoadedClip slow = io::load_clip(folder / "a.bvh", options);
  CHECK(slow.clip.duration() == doctest::Approx(2 * stated.clip.duration()));
  CHECK(slow.report.fps == *options.fps);
  CHECK(contains(slow.report.notes.back(), "as asked"));
  options = {};
  options.cyclic = false;
  CHECK(!io::load_clip(folder / "c.txt", options).clip.cyclic);

  const auto refused = [&](const std::string& name, const io::LoadOptions& o, const std::string& option) {
    CHECK(contains(error_of([&] { io::load_clip(folder / name, o); }), name + ": option " + option));
  };
  options = {};
  options.skeleton = folder / "x.asf";
  refused("a.bvh", options, "skeleton");
  options = {};
  options.unit = 1;
  refused("c.txt", options, "unit");
  options = {};
  options.up = io::UpAxis::z;
  refused("c.txt", options, "up");
  options = {};
  options.fps = 0;
  refused("a.bvh", options, "fps");
  options = {};
  options.skip_frames = 1;
  refused("c.txt", options, "skip_frames");
}

TEST_CASE("recorded: every motion of the collection loads as its table says") {
  const auto folder = motions::folder();
  if (!folder || !std::filesystem::exists(*folder / "SOURCES.md")) {
    MESSAGE("skipped: no folder of recorded motions");
    return;
  }
  std::ifstream table(*folder / "SOURCES.md");
  std::string line, section;
  int files = 0;
  while (std::getline(table, line)) {
    if (line.starts_with("## ")) section = line.substr(3, line.find('/') - 3);
    std::vector<std::string> cells;
    std::istringstream row(line);
    for (std::string cell; std::getline(row, cell, '|');) {
      const auto trimmed = io::detail::trimmed(cell);
      cells.emplace_back(trimmed);
    }
    // | file | path | motion | fps | frames | s | root path | peak | height |
    if (cells.size() < 10 || cells[4].empty() || cells[4].find_first_not_of("0123456789") != std::string::npos)
      continue;
    const auto path = *folder / section / cells[1];
    if (path.extension() == ".xml" || !std::filesystem::exists(path)) continue;
    CAPTURE(path.string());
    const io::LoadedClip loaded = io::load_clip(path);
    ++files;
    CHECK(loaded.clip.keys() == std::stoi(cells[5]));
    CHECK(std::lround(loaded.report.fps) == std::stoi(cells[4]));
    const std::size_t dash = cells[9].find('-', 1);
    CHECK(std::abs(loaded.clip.poses.row(2).minCoeff() - std::stod(cells[9].substr(0, dash))) < 0.0051);
    CHECK(std::abs(loaded.clip.poses.row(2).maxCoeff() - std::stod(cells[9].substr(dash + 1))) < 0.0051);
    if (!cells[7].empty()) {
      // Horizontal path of the root in steps of 0.1 s.
      double travelled = 0;
      for (double t = 0.1; t < loaded.clip.duration() + 1e-9; t += 0.1)
        travelled += (loaded.clip.sample(t) - loaded.clip.sample(t - 0.1)).head(2).norm();
      CHECK(travelled == doctest::Approx(std::stod(cells[7])).epsilon(0.06));
    }
  }
  MESSAGE(files << " motions");
  CHECK(files > 40);
}
