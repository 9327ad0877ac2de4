// SPDX-License-Identifier: MIT
#include <traceur/io/bvh.hpp>

#include <clocale>
#include <fstream>
#include <locale>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <doctest/doctest.h>

#include "motions.hpp"

using motions::contains;
using motions::distance;
using motions::error_of;
using motions::Person;
using motions::position;
using motions::replaced;
using motions::Vector;
using traceur::io::BvhOptions;
using traceur::io::LoadedClip;
using traceur::io::parse_bvh;
using traceur::io::UpAxis;

namespace {

std::string standing(const Person& p = {}) { return p.text({p.row(0, 0.95, 0), p.row(0.1, 0.95, 0.3)}); }

/// Every joint of the standing person, in metres, x forward and z up.
void check_standing(const traceur::motion::Clip& clip) {
  const auto at = [&](const char* joint, const Vector& expected) {
    CAPTURE(joint);
    const Vector found = position(clip, 0, joint);
    CAPTURE(found.x);
    CAPTURE(found.y);
    CAPTURE(found.z);
    CHECK(distance(found, expected) < 1e-9);
  };
  at("Hips", {0, 0, 0.95});
  at("Head", {0, 0, 1.5});
  at("Head_end", {0, 0, 1.7});
  at("LeftArm_end", {0, 0.8, 1.45});
  at("RightArm_end", {0, -0.8, 1.45});
  at("LeftLeg", {0, 0.09, 0.48});
  at("LeftFoot", {0, 0.09, 0.06});
  at("LeftFoot_end", {0.15, 0.09, 0.01});
  at("RightFoot_end", {0.15, -0.09, 0.01});
  CHECK(distance(position(clip, 1, "Hips"), {0.3, 0.1, 0.95}) < 1e-9);
  // The root's own axes: x forward, z up.
  CHECK(clip.poses(6, 0) == doctest::Approx(1));
}

}  // namespace

TEST_CASE("a standing person in centimetres, y up, is where it should be") {
  const LoadedClip loaded = parse_bvh(standing(), "folder/person.bvh");
  check_standing(loaded.clip);
  CHECK(loaded.clip.name == "person");
  CHECK(loaded.clip.skeleton.size() == 16);
  CHECK(loaded.clip.skeleton[0].type == traceur::body::JointType::free);
  CHECK(loaded.clip.skeleton[1].type == traceur::body::JointType::ball);
  CHECK(loaded.clip.skeleton[loaded.clip.skeleton.find("Head_end")].type == traceur::body::JointType::fixed);
  CHECK(loaded.clip.times[1] == doctest::Approx(1.0 / 30).epsilon(1e-15));
  CHECK(loaded.report.unit == 0.01);
  CHECK(contains(loaded.report.unit_reason, "centimetres"));
  CHECK(loaded.report.up == "y");
  CHECK(loaded.report.rotation_order == "ZXY, degrees");
  CHECK(loaded.report.fps == doctest::Approx(30));
  CHECK(loaded.report.standing_height == doctest::Approx(0.84 / 0.491));
  CHECK(loaded.report.notes.empty());
  CHECK(contains(loaded.report.text(), "person.bvh: BVH\n  unit 0.01 m"));
}

TEST_CASE("the same person in any known unit is the same person") {
  for (const double unit : {1.0, 0.01, 0.001, 0.0254, 0.0254 / 0.45}) {
    CAPTURE(unit);
    Person p;
    p.unit = unit;
    const LoadedClip loaded = parse_bvh(standing(p), "person");
    CHECK(loaded.report.unit == doctest::Approx(unit));
    check_standing(loaded.clip);
  }
}

TEST_CASE("a unit that fits no person is not guessed") {
  for (const double unit : {0.1, 0.3048, 1e-5, 1000.0}) {
    CAPTURE(unit);
    Person p;
    p.unit = unit;
    const std::string message = error_of([&] { parse_bvh(standing(p), "person"); });
    CHECK(contains(message, "person: "));
    CHECK(contains(message, "set the option unit"));
    BvhOptions options;
    options.unit = unit;
    check_standing(parse_bvh(standing(p), "person", options).clip);
  }
  // Legs of the right length under a trunk of a few centimetres: not a person.
  std::string text = standing();
  text = replaced(replaced(text, "OFFSET 0 15 0", "OFFSET 0 1 0"), "OFFSET 0 40 0", "OFFSET 0 2 0");
  text = replaced(text, "OFFSET 0 20 0", "OFFSET 0 1 0");
  CHECK(contains(error_of([&] { parse_bvh(text, "person"); }), "set the option unit"));
  // No names to tell from.
  CHECK(contains(error_of([&] { parse_bvh(replaced(standing(), "LeftFoot", "Bone7"), "person"); }),
                 "set the option unit"));
  BvhOptions unit_only;
  unit_only.unit = 0.01;
  CHECK(contains(error_of([&] { parse_bvh(replaced(standing(), "LeftFoot", "Bone7"), "person", unit_only); }),
                 "set the option up"));
  BvhOptions bad;
  bad.unit = -1;
  CHECK(contains(error_of([&] { parse_bvh(standing(), "person", bad); }), "option unit"));
}

TEST_CASE("at every height a person can have, exactly the true unit is found") {
  for (double scale = 0.72; scale < 1.28; scale += 0.02)
    for (const double unit : {1.0, 0.01, 0.001, 0.0254, 0.0254 / 0.45}) {
      Person p;
      p.unit = unit / scale;
      CAPTURE(scale);
      CAPTURE(unit);
      CHECK(parse_bvh(standing(p), "person").report.unit == doctest::Approx(unit));
    }
}

TEST_CASE("z up is seen, and the pelvis tells the root's forward axis") {
  Person p;
  // x left, z up, -y forward, as some exporters have it.
  p.axes = p.world = [](double l, double u, double f) { return Vector{l, -f, u}; };
  const LoadedClip loaded = parse_bvh(standing(p), "person");
  CHECK(loaded.report.up == "z");
  // World axes stay: the person faces -y. The root's own x axis is forward all the same.
  CHECK(distance(position(loaded.clip, 0, "LeftFoot_end"), {0.09, -0.15, 0.01}) < 1e-9);
  const auto q = traceur::core::Quaternion<double>::from(loaded.clip.poses.col(0).data() + 3);
  CHECK(distance(q.rotate({1, 0, 0}), {0, -1, 0}) < 1e-12);
  CHECK(distance(q.rotate({0, 0, 1}), {0, 0, 1}) < 1e-12);
}

TEST_CASE("a rest pose along x with a root turned upright still has an upright root frame") {
  Person p;
  // The bones point along the root's x axis, left is -z; the root's rotation stands them up in a y-up world.
  p.axes = [](double l, double u, double f) { return Vector{u, -f, -l}; };
  // Rotation that takes x to y, -y to z, -z to x: about (1, -1, 1) by 120 degrees.
  Eigen::Matrix3d r;
  r << 0, 0, -1, 1, 0, 0, 0, -1, 0;
  REQUIRE(r.determinant() == doctest::Approx(1));
  // ZXY angles of r: r = Rz Rx Ry.
  const double x = std::asin(r(2, 1)), z = std::atan2(r(1, 0), r(0, 0));
  const double degrees = 180 / std::numbers::pi;
  const auto angles = Person::turn("Hips", z * degrees, x * degrees, 0);
  const LoadedClip loaded = parse_bvh(p.text({p.row(0, 0.95, 0, angles), p.row(0.1, 0.95, 0.3, angles)}), "person");
  CHECK(loaded.report.up == "y");
  CHECK(contains(loaded.report.up_reason, "first frame"));
  check_standing(loaded.clip);
}

TEST_CASE("an up axis on which rest pose and motion disagree is not guessed") {
  Person p;
  // Lying on the back all along: head and feet along z in a y-up file.
  const auto lying = Person::turn("Hips", 0, 90, 0);
  const std::string text = p.text({p.row(0, 0.2, 0, lying), p.row(0, 0.2, 0, lying)});
  const std::string message = error_of([&] { parse_bvh(text, "person"); });
  CHECK(contains(message, "up axis is y by the rest pose but z by the motion"));
  CHECK(contains(message, "set the option up"));
  BvhOptions options;
  options.up = UpAxis::y;
  CHECK(parse_bvh(text, "person", options).clip.poses(2, 0) == doctest::Approx(0.2));
  options.up = UpAxis::z;
  CHECK(parse_bvh(text, "person", options).clip.poses(1, 0) == doctest::Approx(0.2));
  options.up = UpAxis::x;
  CHECK(parse_bvh(text, "person", options).clip.poses(0, 0) == doctest::Approx(0.2));
  // Lying at first, then standing most of the time, is no contradiction.
  const std::string up = p.row(0, 0.95, 0);
  const LoadedClip rises = parse_bvh(p.text({p.row(0, 0.2, 0, lying), up, up, up, up, up}), "person");
  CHECK(rises.report.up == "y");
  CHECK(contains(rises.report.up_reason, "on average"));
}

TEST_CASE("angles multiply in the order of the channels, whatever it is") {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> angle(-170, 170);
  std::string order = "XYZ";
  do {
    Person p;
    p.order = order;
    std::vector<double> angles(3 * Person::names().size());
    for (double& a : angles) a = angle(random);
    BvhOptions options;
    options.up = UpAxis::y;
    const LoadedClip loaded = parse_bvh(p.text({p.row(0, 1, 0, angles), p.row(0, 1, 0)}), "person", options);
    CHECK(loaded.report.rotation_order == order + ", degrees");
    const auto rotation = [&](std::size_t joint) {
      Eigen::Matrix3d r = Eigen::Matrix3d::Identity();
      for (std::size_t k = 0; k < 3; ++k)
        r *= Eigen::AngleAxisd(angles[3 * joint + k] * std::numbers::pi / 180, Eigen::Vector3d::Unit(order[k] - 'X'))
                 .toRotationMatrix();
      return r;
    };
    // Hips -> LeftUpLeg -> LeftLeg -> LeftFoot -> end, in file axes.
    Eigen::Vector3d at(0, 1, 0);
    Eigen::Matrix3d turn = rotation(0);
    const Eigen::Vector3d offsets[] = {{0.09, -0.05, 0}, {0, -0.42, 0}, {0, -0.42, 0}, {0, -0.05, 0.15}};
    for (std::size_t k = 0; k < 4; ++k) {
      at += turn * offsets[k];
      turn *= rotation(5 + k);
    }
    CHECK(distance(position(loaded.clip, 0, "LeftFoot_end"), {at.z(), at.x(), at.y()}) < 1e-9);
  } while (std::next_permutation(order.begin(), order.end()));
}

TEST_CASE("a leg swung forward by -90 degrees about the left axis points forward") {
  const Person p;
  const LoadedClip loaded =
      parse_bvh(p.text({p.row(0, 0.95, 0), p.row(0, 0.95, 0, Person::turn("LeftUpLeg", 0, -90, 0))}), "person");
  CHECK(distance(position(loaded.clip, 1, "LeftFoot"), {0.84, 0.09, 0.9}) < 1e-9);
}

TEST_CASE("position channels of other joints stand for their offsets") {
  const char* text =
      "HIERARCHY ROOT a { OFFSET 5 6 7 CHANNELS 4 Yposition Zrotation Xrotation Yrotation JOINT b {\n"
      "OFFSET 9 9 9 CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation End Site { OFFSET 0 0 1 } } "
      "}\n"
      "MOTION\nFrames: 2\nFrame Time: 0.5\n1 0 0 0 1 2 3 0 0 0\n3 0 0 0 1 2 5 0 0 0\n";
  BvhOptions options{1.0, UpAxis::y, 0};
  const LoadedClip loaded = parse_bvh(text, "t", options);
  // Root: channel y, the other axes from OFFSET. House axes are (z, x, y) of the file.
  CHECK(distance(position(loaded.clip, 0, "a"), {7, 5, 1}) < 1e-12);
  CHECK(distance(position(loaded.clip, 0, "b") - position(loaded.clip, 0, "a"), {4, 1, 2}) < 1e-12);
  bool told = false;
  for (const std::string& note : loaded.report.notes)
    told = told || contains(note, "position channels of 'b', which vary by 1 m");
  CHECK(told);
}

TEST_CASE("line ends, tabs, letter case, signs and exponents do not matter") {
  const LoadedClip plain = parse_bvh(standing(), "t");
  std::string text = "\n\n" + standing();
  for (std::size_t at = 0; (at = text.find('\n', at)) != std::string::npos; at += 2) text.replace(at, 1, "\r\n");
  text = replaced(replaced(replaced(text, "CHANNELS", "Channels"), "Xposition", "XPOSITION"), "MOTION", "Motion");
  text = replaced(replaced(text, " 95 ", " \t+9.5e001  "), "Frames: 2", "Frames:\t2");
  while (text.back() == '\n' || text.back() == '\r') text.pop_back();
  CHECK(parse_bvh(text, "t").clip.poses == plain.clip.poses);
}

TEST_CASE("numbers are read alike in every locale") {
  struct Comma : std::numpunct<char> {
    char do_decimal_point() const override { return ','; }
  };
  const LoadedClip plain = parse_bvh(standing(), "t");
  const std::string written = traceur::io::format_bvh(plain.clip);
  const std::locale before = std::locale::global(std::locale(std::locale::classic(), new Comma));
  const std::string c_before = std::setlocale(LC_NUMERIC, nullptr);
  std::setlocale(LC_NUMERIC, "de_DE.UTF-8");
  CHECK(parse_bvh(standing(), "t").clip.poses == plain.clip.poses);
  CHECK(traceur::io::format_bvh(plain.clip) == written);
  std::setlocale(LC_NUMERIC, c_before.c_str());
  std::locale::global(before);
}

TEST_CASE("a rest pose before the motion is pointed out, and dropped when asked") {
  const Person p;
  std::vector<double> bent(3 * Person::names().size(), 0.0);
  bent[4] = 60;
  const std::string text =
      p.text({p.row(0, 0.95, 0), p.row(0, 0.95, 0, bent), p.row(0, 0.95, 0.1, bent), p.row(0, 0.95, 0.2, bent)});
  const LoadedClip whole = parse_bvh(text, "t");
  REQUIRE(whole.report.notes.size() == 1);
  CHECK(contains(whole.report.notes[0], "skip_frames = 1"));
  BvhOptions options;
  options.skip_frames = 1;
  const LoadedClip cut = parse_bvh(text, "t", options);
  CHECK(cut.clip.keys() == 3);
  CHECK(cut.clip.times[0] == 0);
  CHECK(cut.clip.poses == whole.clip.poses.rightCols(3));
  options.skip_frames = 3;
  CHECK(contains(error_of([&] { parse_bvh(text, "t", options); }), "skip_frames"));
}

TEST_CASE("ground far from height zero is pointed out") {
  const Person p;
  const LoadedClip loaded = parse_bvh(p.text({p.row(0, 1.95, 0), p.row(0, 1.95, 0)}), "t");
  REQUIRE(loaded.report.notes.size() == 1);
  CHECK(contains(loaded.report.notes[0], "height 1.01 m"));
}

TEST_CASE("what is written reads back as the same motion") {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> angle(-180, 180);
  const Person p;
  std::vector<std::string> rows{p.row(0, 0.95, 0)};
  for (int k = 0; k < 5; ++k) {
    std::vector<double> angles(3 * Person::names().size());
    for (double& a : angles) a = angle(random);
    rows.push_back(p.row(0.1 * k, 1, 0.2, angles));
  }
  // Gimbal lock: the middle angle at a right angle.
  rows.push_back(p.row(0, 1, 0, Person::turn("LeftArm", 20, 90, 30)));
  rows.push_back(p.row(0, 1, 0, Person::turn("LeftArm", 20, -90, 30)));
  BvhOptions options;
  options.up = UpAxis::y;
  const LoadedClip first = parse_bvh(p.text(rows), "t", options);
  for (const double unit : {0.01, 1.0}) {
    const std::string text = traceur::io::format_bvh(first.clip, unit);
    options.unit = unit;
    const LoadedClip second = parse_bvh(text, "t", options);
    REQUIRE(second.clip.skeleton.size() == first.clip.skeleton.size());
    for (int k = 0; k < first.clip.keys(); ++k) {
      const auto a = motions::positions(first.clip, k), b = motions::positions(second.clip, k);
      for (std::size_t i = 0; i < a.size(); ++i) CHECK(distance(a[i], b[i]) < 1e-9);
    }
  }
}

TEST_CASE("hinges, rest rotations and fixed leaves are written as what they amount to") {
  using namespace traceur;
  motion::Clip clip;
  clip.name = "arm";
  body::Joint root, hinge, hand;
  root.name = root.body = "root";
  root.type = body::JointType::free;
  clip.skeleton.add(root);
  hinge.name = hinge.body = "elbow";
  hinge.parent = 0;
  hinge.type = body::JointType::hinge;
  hinge.offset = {0.1, 0.2, 0.3};
  hinge.axis = {0, 1, 0};
  hinge.rest = core::about_axis(Vector{1, 0, 0}, 0.4);
  clip.skeleton.add(hinge);
  hand.name = hand.body = "hand";
  hand.parent = 1;
  hand.type = body::JointType::fixed;
  hand.offset = {0.5, 0, 0};
  clip.skeleton.add(hand);
  clip.times = Eigen::Vector3d(0, 0.1, 0.2);
  clip.poses = Eigen::MatrixXd::Zero(8, 3);
  clip.poses.row(6).setOnes();
  clip.poses(7, 1) = 0.7;
  const LoadedClip back = parse_bvh(io::format_bvh(clip), "t", {0.01, UpAxis::y, 0});
  for (int k = 0; k < 3; ++k) CHECK(distance(position(back.clip, k, "hand"), position(clip, k, "hand")) < 1e-9);
  CHECK(back.clip.skeleton.find("hand_end") >= 0);

  motion::Clip uneven = clip;
  uneven.times[2] = 0.5;
  CHECK(contains(error_of([&] { io::format_bvh(uneven); }), "evenly spaced"));
  CHECK(contains(error_of([&] { io::format_bvh(clip, 0); }), "unit"));
}

TEST_CASE("files are read and written whole") {
  const motions::Folder folder;
  const LoadedClip loaded = parse_bvh(standing(), "t");
  traceur::io::write_bvh(folder / "a.bvh", loaded.clip);
  check_standing(traceur::io::read_bvh(folder / "a.bvh").clip);
  CHECK(contains(error_of([&] { traceur::io::read_bvh(folder / "none.bvh"); }), "none.bvh: no such file"));
  CHECK(contains(error_of([&] { traceur::io::read_bvh(folder / ""); }), "found a folder"));
  std::ofstream(folder / "bom.bvh") << "\xEF\xBB\xBF" << standing();
  check_standing(traceur::io::read_bvh(folder / "bom.bvh").clip);
}

TEST_CASE("every fault is one line that names the place") {
  const std::string good = standing();
  // Line numbers follow from the text itself.
  const auto line_of = [](const std::string& text, const std::string& part) {
    return std::to_string(1 +
                          std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(text.find(part)), '\n'));
  };
  const auto fault = [&](const std::string& text, const std::string& at, const std::string& expected) {
    const std::string message = error_of([&] { parse_bvh(text, "f.bvh"); });
    CAPTURE(message);
    CHECK(contains(message, expected));
    CHECK(contains(message, at.empty() ? "f.bvh:" : "f.bvh:" + at + ": "));
    CHECK(!contains(message, "\n"));
  };
  const auto change = [&](const std::string& from, const std::string& to, const std::string& expected) {
    fault(replaced(good, from, to), line_of(good, from), expected);
  };
  fault("", "1", "expected 'HIERARCHY', found the end of the file");
  fault("hello\n", "1", "expected 'HIERARCHY', found 'hello'");
  change("OFFSET 0 15 0", "OFFSET 0 nan 0", "OFFSET of 'Spine': expected a finite number below 1e8, found 'nan'");
  change("OFFSET 0 15 0", "OFFSET 0 1,5 0", "OFFSET of 'Spine': expected a number, found '1,5'");
  change("OFFSET 0 15 0", "OFFSET 0 inf 0", "expected a finite number");
  change("OFFSET 0 15 0", "OFFSET 0 1e400 0", "expected a finite number");
  change("JOINT Spine", "JOINT Hips", "a second joint named 'Hips'");
  change("JOINT Spine", "JOINT", "expected a joint name");
  change("JOINT Spine", "BONE Spine", "expected OFFSET, CHANNELS, JOINT, End Site or '}', found 'bone'");
  change("CHANNELS 6", "CHANNELS 7", "expected a count from 0 to 6, found '7'");
  change("Xposition", "Wposition", "found 'Wposition'");
  change("Xposition", "Yposition", "'Yposition' twice");
  change("Frames: 2", "Frames: two", "Frames: expected a whole number, found 'two'");
  change("Frames: 2", "Frames: 1", "expected at least two frames, found 1");
  change("Frames: 2", "Frames: -5", "expected a whole number");
  change("Frames: 2", "Frames: 999999999999999", "do not fit in the rest of the file");
  change("Frames: 2", "Frames: 99999999999999999999999", "expected a whole number");
  change("Frame Time: 0.0333333", "Frame Time: 0", "Frame Time: expected seconds");
  change("Frame Time: 0.0333333", "Frame Time: -1", "Frame Time: expected seconds");
  change("Frame Time: 0.0333333", "Frame Time:", "expected a number, found the end of the line");
  change("MOTION", "ROOT b", "a second ROOT");
  change("MOTION", "}", "expected 'MOTION', found '}'");

  const Person p;
  const std::string row = p.row(0, 0.95, 0);
  fault(p.text({row, replaced(row, " 95 ", " nan ")}), "",
        "frame 1, Hips Yposition: expected a finite number, found 'nan'");
  fault(p.text({row, replaced(row, " 95 ", " x ")}), "",
        "frame 1, Hips Yposition: expected a finite number, found 'x'");
  fault(p.text({row, row.substr(0, row.size() - 3) + "\n"}), "", "RightFoot Yrotation: expected 36 numbers, found 35");
  fault(p.text({row, row.substr(0, row.size() - 1) + " 7\n"}), "", "expected the end of the line, found '7'");
  fault(p.text({row, row}) + row, "", "expected the end of the file after 2 frames");
  fault(replaced(p.text({row, row}), "Frames: 2", "Frames: 3"), "", "truncated");
  fault(replaced(p.text({row, row + row}), "Frames: 2", "Frames: 4"), "", "truncated");

  std::string deep = "HIERARCHY\nROOT r\n{\nOFFSET 0 0 0\n";
  for (int k = 0; k < 100000; ++k) deep += "JOINT j" + std::to_string(k) + "\n{\nOFFSET 0 0 0\n";
  fault(deep, "", "joints nest deeper than 200 levels");
  std::string wide = "HIERARCHY\nROOT r\n{\nOFFSET 0 0 0\n";
  for (int k = 0; k < 100000; ++k) wide += "JOINT j" + std::to_string(k) + "\n{\nOFFSET 0 0 0\n}\n";
  fault(wide, "", "expected at most 2000 joints");
}

TEST_CASE("a file cut anywhere is refused, or read whole where only blanks are missing") {
  const std::string good = standing();
  const std::size_t last = good.find_last_not_of("\r\n ");
  for (std::size_t size = 0; size < last; ++size) {
    const std::string message = error_of([&] { parse_bvh(std::string_view(good).substr(0, size), "f.bvh"); });
    // The last number may lose digits and still be one.
    if (message.empty()) CHECK(good.find(' ', size) == std::string::npos);
  }
}

TEST_CASE("numbers beyond any motion do not get through") {
  CHECK(contains(error_of([&] { parse_bvh(replaced(standing(), "OFFSET 0 15 0", "OFFSET 0 1e9 0"), "f"); }),
                 "below 1e8"));
}

TEST_CASE("recorded take: BVH clips stand on the ground") {
  const auto folder = motions::folder();
  if (!folder) {
    MESSAGE("skipped: no folder of recorded motions");
    return;
  }
  int files = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(*folder)) {
    if (entry.path().extension() != ".bvh") continue;
    CAPTURE(entry.path().string());
    const LoadedClip loaded = traceur::io::read_bvh(entry.path());
    ++files;
    CHECK(loaded.report.up == "y");
    CHECK(loaded.report.standing_height > 1.5);
    CHECK(loaded.report.standing_height < 1.9);
    double lowest = 1e9;
    for (int k = 0; k < loaded.clip.keys(); k += 3) {
      const auto p = motions::positions(loaded.clip, k);
      for (int i = 0; i < loaded.clip.skeleton.size(); ++i)
        if (contains(loaded.clip.skeleton[i].name, "Foot") || contains(loaded.clip.skeleton[i].name, "Toe"))
          lowest = std::min(lowest, p[static_cast<std::size_t>(i)].z);
    }
    CHECK(lowest > -0.08);
    CHECK(lowest < 0.08);
  }
  CHECK(files > 0);
}

TEST_CASE("recorded walks go the way the root faces") {
  const auto folder = motions::folder();
  if (!folder) {
    MESSAGE("skipped: no folder of recorded motions");
    return;
  }
  for (const char* name : {"cmu-subject16/16_21_1.bvh", "cmu-subject16/16_35_1.bvh", "snu-mass/walk.bvh",
                           "snu-ys2010/dir_0_slope_10.bvh", "snu-ys2010/wd2_fast_2foot_hop.bvh"}) {
    if (!std::filesystem::exists(*folder / name)) continue;
    CAPTURE(name);
    const traceur::motion::Clip clip = traceur::io::read_bvh(*folder / name).clip;
    double along = 0, path = 0;
    for (int k = 0; k + 1 < clip.keys(); ++k) {
      const Eigen::Vector3d step = clip.poses.col(k + 1).head(3) - clip.poses.col(k).head(3);
      const Vector forward =
          traceur::core::heading(traceur::core::Quaternion<double>::from(clip.poses.col(k).data() + 3))
              .rotate({1, 0, 0});
      along += forward.x * step.x() + forward.y * step.y();
      path += step.head(2).norm();
    }
    CHECK(along > 0.9 * path);
  }
}
