// SPDX-License-Identifier: MIT
#include <traceur/io/deepmimic.hpp>

#include <fstream>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <doctest/doctest.h>

#include "motions.hpp"

using motions::contains;
using motions::distance;
using motions::error_of;
using motions::position;
using motions::replaced;
using motions::Vector;
using traceur::io::LoadedClip;
using traceur::io::parse_deepmimic;
using traceur::io::parse_deepmimic_skeleton;

namespace {

using Row = std::vector<double>;

/// A frame of all identity rotations and straight limbs.
Row rest(double duration = 0.1, double x = 0, double height = 0.9) {
  Row r{duration, x, height, 0};
  const auto identity = [&] { r.insert(r.end(), {1, 0, 0, 0}); };
  for (int k = 0; k < 4; ++k) identity();  // root, chest, neck, right hip
  r.push_back(0);                          // right knee
  identity();                              // right ankle
  identity();                              // right shoulder
  r.push_back(0);                          // right elbow
  identity();                              // left hip
  r.push_back(0);                          // left knee
  identity();                              // left ankle
  identity();                              // left shoulder
  r.push_back(0);                          // left elbow
  return r;
}

constexpr std::size_t at_root = 4, at_right_knee = 20, at_right_shoulder = 25, at_left_knee = 34, at_left_elbow = 43;

std::string text(const std::vector<Row>& rows, const std::string& loop = "none") {
  std::string out = "{\n\"Loop\": \"" + loop + "\",\n\"Frames\":\n[\n";
  for (std::size_t k = 0; k < rows.size(); ++k) {
    out += "[";
    for (std::size_t i = 0; i < rows[k].size(); ++i) {
      char number[32];
      std::snprintf(number, sizeof number, "%s%.17g", i > 0 ? ", " : "", rows[k][i]);
      out += number;
    }
    out += k + 1 < rows.size() ? "],\n" : "]\n";
  }
  return out + "]\n}\n";
}

std::string character(const std::string& changed = "", const std::string& key = "", const std::string& value = "") {
  std::string out = "{\"Skeleton\": {\"Joints\": [";
  const auto& joints = traceur::io::detail::deepmimic_joints;
  for (std::size_t i = 0; i < joints.size(); ++i) {
    const auto& j = joints[i];
    using traceur::body::JointType;
    const std::string type = j.type == JointType::free    ? "none"
                             : j.type == JointType::ball  ? "spherical"
                             : j.type == JointType::hinge ? "revolute"
                                                          : "fixed";
    const auto field = [&](const std::string& name, std::string content) {
      if (changed == j.name && key == name) content = value;
      return content.empty() ? std::string() : "\"" + name + "\": " + content + ", ";
    };
    out += std::string(i > 0 ? "," : "") + "{" + field("Name", std::string("\"") + j.name + "\"") +
           field("Type", "\"" + type + "\"") + field("Parent", std::to_string(j.parent)) +
           field("AttachX", std::to_string(j.x)) + field("AttachY", std::to_string(j.y)) +
           field("AttachZ", std::to_string(j.z)) + field("AttachThetaX", "0") + "\"ID\": " + std::to_string(i) + "}";
  }
  return out + "]}}";
}

}  // namespace

TEST_CASE("at rest the humanoid stands with its arms down, left at +y") {
  const LoadedClip loaded = parse_deepmimic(text({rest(), rest(0.2, 0.5)}), "clips/walk.txt");
  const auto& clip = loaded.clip;
  CHECK(clip.name == "walk");
  CHECK(clip.skeleton.nq() == 43);
  CHECK(distance(position(clip, 0, "root"), {0, 0, 0.9}) < 1e-12);
  CHECK(distance(position(clip, 1, "root"), {0.5, 0, 0.9}) < 1e-12);
  CHECK(distance(position(clip, 0, "neck"), {0, 0, 0.9 + 0.236151 + 0.223894}) < 1e-12);
  CHECK(distance(position(clip, 0, "left_ankle"), {0, 0.084887, 0.9 - 0.421546 - 0.40987}) < 1e-12);
  CHECK(distance(position(clip, 0, "right_ankle"), {0, -0.084887, 0.9 - 0.421546 - 0.40987}) < 1e-12);
  CHECK(distance(position(clip, 0, "right_wrist"),
                 {-0.02405, -0.18311, 0.9 + 0.236151 + 0.2435 - 0.274788 - 0.258947}) < 1e-12);
  CHECK(clip.skeleton[clip.skeleton.find_body("left_shin")].name == "left_knee");
  CHECK(clip.skeleton[clip.skeleton.find("left_knee")].type == traceur::body::JointType::hinge);
  CHECK(clip.skeleton[clip.skeleton.find("left_wrist")].type == traceur::body::JointType::fixed);
  CHECK(!clip.cyclic);
  CHECK(loaded.report.up == "y");
  CHECK(loaded.report.fps == doctest::Approx(10));
  CHECK(loaded.report.notes.empty());
}

TEST_CASE("knees bend back by negative angles, elbows forward by positive ones") {
  Row bent = rest();
  bent[at_left_knee] = -1.5707963267948966;
  bent[at_left_elbow] = 1.5707963267948966;
  const auto clip = parse_deepmimic(text({bent, rest()}), "t").clip;
  CHECK(distance(position(clip, 0, "left_ankle"), {-0.40987, 0.084887, 0.9 - 0.421546}) < 1e-9);
  CHECK(distance(position(clip, 0, "left_wrist"), {-0.02405 + 0.258947, 0.18311, 0.9 + 0.236151 + 0.2435 - 0.274788}) <
        1e-9);
  CHECK(distance(position(clip, 0, "right_ankle"), {0, -0.084887, 0.9 - 0.421546 - 0.40987}) < 1e-12);
}

TEST_CASE("quaternions are w x y z in y-up axes") {
  // Independent of the reader's algebra: rotate in the file's axes by Eigen, then relabel axes.
  const Eigen::Quaterniond root = Eigen::Quaterniond(0.5, 0.1, -0.7, 0.3).normalized(),
                           shoulder = Eigen::Quaterniond(0.2, 0.8, 0.1, -0.4).normalized();
  Row r = rest();
  const auto put = [&](std::size_t at, const Eigen::Quaterniond& q) {
    r[at] = q.w(), r[at + 1] = q.x(), r[at + 2] = q.y(), r[at + 3] = q.z();
  };
  put(at_root, root);
  put(at_right_shoulder, shoulder);
  const auto clip = parse_deepmimic(text({r, rest()}), "t").clip;
  const Eigen::Vector3d p = Eigen::Vector3d(0, 0.9, 0) +
                            root * (Eigen::Vector3d(0, 0.236151, 0) + Eigen::Vector3d(-0.02405, 0.2435, 0.18311) +
                                    shoulder * Eigen::Vector3d(0, -0.274788 - 0.258947, 0));
  CHECK(distance(position(clip, 0, "right_wrist"), {p.x(), -p.z(), p.y()}) < 1e-9);
}

TEST_CASE("key times add up the durations, the last one leads nowhere") {
  const auto clip = parse_deepmimic(text({rest(0.1), rest(0.3), rest(0.25), rest(7)}), "t").clip;
  REQUIRE(clip.keys() == 4);
  CHECK(clip.times[0] == 0);
  CHECK(clip.times[1] == doctest::Approx(0.1));
  CHECK(clip.times[2] == doctest::Approx(0.4));
  CHECK(clip.times[3] == doctest::Approx(0.65));
  CHECK(parse_deepmimic(text({rest(0.1), rest(0)}), "t").clip.keys() == 2);
}

TEST_CASE("a clip that wraps is cyclic and its gap is reported, travel aside") {
  const LoadedClip closed = parse_deepmimic(text({rest(0.1), rest(0.1, 0.5), rest(0.1, 1.0)}, "wrap"), "t");
  CHECK(closed.clip.cyclic);
  CHECK(closed.report.cycle_gap == doctest::Approx(0).epsilon(1e-12));
  CHECK(closed.report.cycle_gap_angle == doctest::Approx(0).epsilon(1e-9));
  CHECK(closed.report.notes.empty());
  CHECK(closed.clip.sample(0.3)[0] == doctest::Approx(1.5));

  Row last = rest(0, 1.0, 0.97);
  last[at_right_knee] = -0.3;
  const LoadedClip open = parse_deepmimic(text({rest(0.1), last}, "wrap"), "t");
  CHECK(open.report.cycle_gap == doctest::Approx(0.07));
  CHECK(open.report.cycle_gap_angle == doctest::Approx(0.3));
  REQUIRE(open.report.notes.size() == 1);
  CHECK(contains(open.report.notes[0], "the cycle is not closed"));
}

TEST_CASE("quaternions off unit length are scaled and told of, far off refused") {
  Row r = rest();
  r[at_right_shoulder] = 0.7;
  const LoadedClip loaded = parse_deepmimic(text({r, rest()}), "t");
  CHECK(loaded.clip.poses.col(0) == loaded.clip.poses.col(1));
  REQUIRE(loaded.report.notes.size() == 1);
  CHECK(contains(loaded.report.notes[0], "scaled 1 quaternions"));
  CHECK(contains(loaded.report.notes[0], "0.7 to 1"));
  r[at_right_shoulder] = 0.4;
  CHECK(contains(error_of([&] {
                   parse_deepmimic(text({r, rest()}), "t");
                 }),
                 "t: frame 0, right_shoulder: expected a unit quaternion, found length 0.4"));
}

TEST_CASE("a character file gives the same skeleton, or its own proportions") {
  const auto built_in = traceur::io::deepmimic_skeleton(), read = parse_deepmimic_skeleton(character(), "c");
  REQUIRE(read.size() == built_in.size());
  for (int i = 0; i < read.size(); ++i) {
    CHECK(read[i].name == built_in[i].name);
    CHECK(read[i].type == built_in[i].type);
    CHECK(distance(read[i].offset, built_in[i].offset) < 1e-6);
  }
  const auto longer = parse_deepmimic_skeleton(character("left_knee", "AttachY", "-0.5"), "c");
  CHECK(distance(longer[longer.find("left_knee")].offset, {0, 0, -0.5}) < 1e-12);

  const motions::Folder folder;
  std::ofstream(folder / "clip.txt") << text({rest(), rest()});
  std::ofstream(folder / "character.txt") << character("left_knee", "AttachY", "-0.5");
  const auto clip = traceur::io::read_deepmimic(folder / "clip.txt", {folder / "character.txt"}).clip;
  CHECK(position(clip, 0, "left_ankle").z == doctest::Approx(0.9 - 0.5 - 0.40987));
  CHECK(contains(error_of([&] { traceur::io::read_deepmimic(folder / "none.txt"); }), "no such file"));
}

TEST_CASE("every fault of a character names joint and field") {
  const auto fault = [](const std::string& c, const std::string& expected) {
    const std::string message = error_of([&] { parse_deepmimic_skeleton(c, "c.txt"); });
    CAPTURE(message);
    CHECK(contains(message, "c.txt"));
    CHECK(contains(message, expected));
    CHECK(!contains(message, "\n"));
  };
  fault(character("chest", "Name", "\"belly\""), "joint 1: expected 'chest', found 'belly'");
  fault(character("chest", "Type", "\"revolute\""), "joint 1 'chest': expected type spherical, found 'revolute'");
  fault(character("chest", "Parent", "3"), "joint 1 'chest': expected parent 0");
  fault(character("chest", "AttachY", "\"x\""), "joint 1: AttachY: expected a number");
  fault(character("chest", "AttachY", ""), "joint 1: expected a field 'AttachY'");
  fault(character("chest", "AttachThetaX", "0.5"), "AttachThetaX: expected 0");
  fault("{}", "expected a field 'Skeleton'");
  fault("[]", "expected an object");
  fault("{\"Skeleton\": {\"Joints\": [1]}}", "expected a list of 15, found 1");
}

TEST_CASE("every fault of a clip names frame and field") {
  const std::string good = text({rest(), rest()});
  const auto fault = [](const std::string& clip, const std::string& expected) {
    const std::string message = error_of([&] { parse_deepmimic(clip, "c.txt"); });
    CAPTURE(message);
    CHECK(contains(message, "c.txt:"));
    CHECK(contains(message, expected));
    CHECK(!contains(message, "\n"));
  };
  fault("", "is the file truncated?");
  fault("walk", "c.txt:1: not JSON: did not expect 'walk'");
  fault(replaced(good, "]\n]", "]\n"), "not JSON");
  fault(replaced(good, "0.90000000000000002", "nan"), "c.txt:5: not JSON");
  fault(replaced(good, "0.90000000000000002", "1e999"), "a number is too large");
  fault(replaced(good, "0.90000000000000002", "1e20"), "frame 0, number 2 (root): expected a finite number");
  fault(replaced(good, "0.90000000000000002", "null"), "frame 0, number 2 (root): expected a number");
  fault(replaced(good, "0.90000000000000002", "\"tall\""), "frame 0, number 2 (root): expected a number");
  fault(replaced(good, "0.90000000000000002, ", ""), "frame 0: expected a list of 44, found 43");
  fault(replaced(good, "none", "twice"), "Loop: expected wrap or none, found 'twice'");
  fault(replaced(good, "\"none\"", "1"), "Loop: expected a text");
  fault(replaced(good, "Loop", "loop"), "expected a field 'Loop'");
  fault(replaced(good, "Frames", "frames"), "expected a field 'Frames'");
  fault(text({rest()}), "expected at least two frames, found 1");
  fault(text({rest(0), rest()}), "frame 0: duration: expected seconds, more than 0");
  fault(text({rest(), rest(-1), rest()}), "frame 1: duration");
  for (std::size_t size = 0; size < good.size() - 2; size += 5)
    CHECK(!error_of([&] { parse_deepmimic(good.substr(0, size), "c"); }).empty());
}

TEST_CASE("recorded clips: built-in skeleton equals the character file, feet stand on the ground") {
  const auto folder = motions::folder();
  if (!folder || !std::filesystem::exists(*folder / "deepmimic/humanoid3d.txt")) {
    MESSAGE("skipped: no folder of recorded motions");
    return;
  }
  const auto character_path = *folder / "deepmimic/humanoid3d.txt";
  const auto read = parse_deepmimic_skeleton(traceur::io::detail::read_text(character_path), character_path.string());
  const auto built_in = traceur::io::deepmimic_skeleton();
  for (int i = 0; i < read.size(); ++i) {
    CHECK(distance(read[i].offset, built_in[i].offset) == 0);
    CHECK(read[i].body == built_in[i].body);
  }
  for (const auto& entry : std::filesystem::directory_iterator(*folder / "deepmimic")) {
    if (entry.path() == character_path) continue;
    CAPTURE(entry.path().string());
    const LoadedClip loaded = traceur::io::read_deepmimic(entry.path());
    double lowest = 1e9;
    for (int k = 0; k < loaded.clip.keys(); ++k)
      for (const char* ankle : {"left_ankle", "right_ankle"})
        lowest = std::min(lowest, position(loaded.clip, k, ankle).z);
    CHECK(lowest > -0.05);
    CHECK(lowest < 0.1);
  }
}
