// SPDX-License-Identifier: MIT
#include <traceur/io/clip_file.hpp>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <random>
#include <string>

#include <doctest/doctest.h>

#include "motions.hpp"

using motions::contains;
using motions::error_of;
using motions::replaced;
using namespace traceur;

namespace {

/// A clip of every joint type, with numbers that need all their digits.
motion::Clip example(bool labels = true) {
  motion::Clip clip;
  clip.name = "a \"quoted\" name, \xC3\xA9";
  const auto add = [&](const char* name, int parent, body::JointType type) {
    body::Joint j;
    j.name = name;
    j.body = std::string(name) + " body";
    j.parent = parent;
    j.type = type;
    j.offset = {0.1, 1.0 / 3, -2e-7};
    j.rest = core::about_axis(core::Vector3<double>{0, 1, 0}, 0.1);
    j.axis = {0, -1, 0};
    clip.skeleton.add(j);
  };
  add("root", -1, body::JointType::free);
  add("shoulder", 0, body::JointType::ball);
  add("elbow", 1, body::JointType::hinge);
  add("hand", 2, body::JointType::fixed);
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  const int keys = 7;
  clip.times = Eigen::VectorXd::LinSpaced(keys, 0, 1);
  clip.poses.resize(clip.skeleton.nq(), keys);
  for (int k = 0; k < keys; ++k)
    for (int i = 0; i < clip.poses.rows(); ++i) clip.poses(i, k) = normal(random);
  for (int k = 0; k < keys; ++k) body::normalize(clip.skeleton, clip.poses.col(k).data());
  clip.poses(0, 0) = -0.0;
  clip.poses(1, 0) = 5e-324;
  if (labels) clip.contacts = Eigen::MatrixXd::Random(4, keys).cwiseAbs();
  return clip;
}

bool same(const body::Joint& a, const body::Joint& b) {
  const auto equal = [](const auto& u, const auto& v) { return norm(u - v) == 0; };
  return a.name == b.name && a.body == b.body && a.parent == b.parent && a.type == b.type &&
         equal(a.offset, b.offset) && equal(a.axis, b.axis) && equal(a.rest.vec(), b.rest.vec()) &&
         a.rest.w == b.rest.w;
}

}  // namespace

TEST_CASE("a clip comes back bit for bit") {
  for (const bool labels : {true, false})
    for (const bool cyclic : {true, false}) {
      motion::Clip clip = example(labels);
      clip.cyclic = cyclic;
      const std::string text = io::format_clip(clip);
      const motion::Clip back = io::parse_clip(text, "t").clip;
      CHECK(back.name == clip.name);
      CHECK(back.cyclic == cyclic);
      CHECK(back.times == clip.times);
      CHECK((back.poses == clip.poses));
      CHECK(std::signbit(back.poses(0, 0)));
      CHECK(back.contacts.cols() == clip.contacts.cols());
      CHECK(back.contacts == clip.contacts);
      REQUIRE(back.skeleton.size() == clip.skeleton.size());
      for (int i = 0; i < back.skeleton.size(); ++i) CHECK(same(back.skeleton[i], clip.skeleton[i]));
      CHECK((io::format_clip(back) == text));
    }
}

TEST_CASE("the text is one JSON object a line: a header, then the keys") {
  const std::string text = io::format_clip(example());
  CHECK(std::count(text.begin(), text.end(), '\n') == 8);
  CHECK(text.starts_with("{\"format\":\"traceur-clip\",\"version\":1,"));
  io::detail::Lines lines(text);
  std::string_view line;
  while (lines.next(line)) CHECK(nlohmann::json::parse(line).is_object());
}

TEST_CASE("files are written whole and read back") {
  const motions::Folder folder;
  const motion::Clip clip = example();
  io::write_clip(folder / "a.jsonl", clip);
  CHECK(io::read_clip(folder / "a.jsonl").clip.poses == clip.poses);
  CHECK(contains(error_of([&] { io::write_clip(folder / "no" / "a.jsonl", clip); }), "cannot write"));
  CHECK(contains(error_of([&] { io::read_clip(folder / "b.jsonl"); }), "b.jsonl: no such file"));
  // A clip that cannot be written leaves the old file as it was.
  motion::Clip bad = clip;
  bad.poses(0, 1) = std::nan("");
  CHECK(contains(error_of([&] { io::write_clip(folder / "a.jsonl", bad); }), "not finite"));
  CHECK(io::read_clip(folder / "a.jsonl").clip.poses == clip.poses);
  bad = clip;
  bad.name = "\xFF";
  CHECK(contains(error_of([&] { io::format_clip(bad); }), "not UTF-8"));
}

TEST_CASE("every fault names line and field") {
  motion::Clip clip = example();
  const std::string good = io::format_clip(clip);
  const auto fault = [](const std::string& text, int line, const std::string& expected) {
    const std::string message = error_of([&] { io::parse_clip(text, "c.jsonl"); });
    CAPTURE(message);
    CHECK(contains(message, line > 0 ? "c.jsonl:" + std::to_string(line) + ": " : "c.jsonl: "));
    CHECK(contains(message, expected));
    CHECK(!contains(message, "\n"));
  };
  const auto change = [&](const std::string& from, const std::string& to, int line, const std::string& expected) {
    fault(replaced(good, from, to), line, expected);
  };
  fault("", 1, "expected a header line");
  fault("hello", 1, "not JSON: did not expect 'hello'");
  fault("{}\n", 1, "expected a field 'format'");
  change("traceur-clip", "other", 1, "header.format: expected 'traceur-clip', found 'other'");
  change("\"version\":1", "\"version\":2", 1, "header.version: expected 1");
  change("\"cyclic\":false", "\"cyclic\":0", 1, "header.cyclic: expected true or false");
  change("\"keys\":7", "\"keys\":1", 1, "header.keys: expected a whole number, two or more");
  change("\"keys\":7", "\"keys\":7.5", 1, "header.keys: expected a whole number");
  change("\"keys\":7", "\"keys\":1e7", 8, "expected 10000000 frames, found 7; is the file truncated?");
  change("\"keys\":7", "\"keys\":1e300", 1, "finite number below 1e8");
  change("\"keys\":7", "\"keys\":6", 8, "frame 6: expected the end of the file after 6 frames");
  change("\"joints\":[", "\"joints\":[],\"x\":[", 1, "joints: expected 1 to 2000 joints");
  change("\"parent\":1,", "\"parent\":3,", 1,
         "joints[2]: skeleton: joint 'elbow': expected a parent that comes before it");
  change("\"parent\":1,", "\"parent\":-7,", 1, "joints[2].parent: expected a joint's index or -1");
  change("elbow body", "root body", 1, "joints[2]: skeleton: joint 'elbow': a second body named 'root body'");
  change("\"hinge\"", "\"slide\"", 1, "joints[2].type: expected fixed, hinge, ball or free, found 'slide'");
  change("\"axis\":[0,-1,0]", "\"axis\":[0,-2,0]", 1, "hinge axis is not a unit vector");
  change("\"axis\":[0,-1,0]", "\"axis\":[0,-1]", 1, "joints[0].axis: expected a list of 3, found 2");
  change("\"t\":0,", "\"t\":0.5,", 0, "expected the first frame at time 0");
  change("\"t\":0,", "\"t\":null,", 2, "frame 0.t: expected a number");
  change("\"t\":0,", "\"s\":0,", 2, "frame 0: expected a field 't'");
  change("\"q\":[-0.0,", "\"q\":[NaN,", 2, "not JSON");
  change("\"q\":[-0.0,", "\"q\":[", 2, "frame 0.q: expected a list of 12, found 11");
  change("\"q\":[-0.0,", "\"q\":[1e12,", 2, "frame 0.q: expected a finite number");
  change("\"c\":[", "\"c\":[2,", 2, "frame 0.c: expected a list of 4, found 5");
  change("\"c\":[", "\"d\":[", 2, "frame 0: expected a field 'c'");
  std::string stretched = good;
  const std::size_t at = stretched.find("\"c\":[", stretched.find('\n')) + 5;
  stretched.replace(at, stretched.find(',', at) - at, "1.5");
  fault(stretched, 2, "frame 0.c: expected labels from 0 to 1");
  motion::Clip still = clip;
  const std::string spun = io::format_clip(still);
  fault(replaced(spun, "\"version\":1", "\"version\":\"1\""), 1, "header.version: expected a number");
  for (std::size_t size = 0; size + 2 < good.size(); size += 3)
    CHECK(!error_of([&] { io::parse_clip(good.substr(0, size), "c"); }).empty());
}

TEST_CASE("a cyclic clip reports its gap") {
  motion::Clip clip = example(false);
  clip.poses.colwise() = clip.poses.col(2).eval();
  clip.poses(2, 6) += 0.05;
  clip.cyclic = true;
  const io::LoadedClip loaded = io::parse_clip(io::format_clip(clip), "t");
  CHECK(loaded.report.cycle_gap == doctest::Approx(0.05));
  CHECK(loaded.report.notes.size() == 1);
}
