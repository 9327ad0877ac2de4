// SPDX-License-Identifier: MIT
#include <traceur/io/asf_amc.hpp>

#include <algorithm>
#include <fstream>
#include <numbers>
#include <string>
#include <utility>

#include <Eigen/Geometry>
#include <doctest/doctest.h>

#include "motions.hpp"
#include <traceur/io/bvh.hpp>

using motions::contains;
using motions::distance;
using motions::error_of;
using motions::position;
using motions::replaced;
using motions::Vector;
using traceur::io::Asf;
using traceur::io::AsfAmcOptions;
using traceur::io::LoadedClip;
using traceur::io::parse_amc;
using traceur::io::parse_asf;

namespace {

constexpr double unit = 0.0254 / 0.45;

/// A person of legs 14.6 units: 0.824 m, so 1.68 m tall. The left shin's axes are turned.
const char* const skeleton = R"(# made by hand
:version 1.10
:name person
:units
  mass 1.0
  length 0.45
  angle deg
:documentation
  any text, begin end
:root
   order TX TY TZ RX RY RZ
   axis XYZ
   position 0 0 0
   orientation 0 0 0
:bonedata
  begin
    id 1
    name lhip
    direction 0.8 -0.6 0
    length 2
    axis 0 0 0 XYZ
  end
  begin
    id 2
    name lfemur
    direction 0 -1 0
    length 7.3
    axis 0 0 0 XYZ
    dof rx ry rz
    limits (-160.0 20.0)
           (-70.0 70.0)
           (-60.0 70.0)
  end
  begin
    name ltibia
    direction 0 -1 0
    length 7.3
    axis 30 40 20 XYZ
    dof rx rz
    limits (-10.0 170.0)
           (-10.0 170.0)
  end
  begin
    name lfoot
    direction 0 0 1
    length 2
    axis 0 0 0 XYZ
    dof rz
  end
  begin
    name rhip
    direction -0.8 -0.6 0
    length 2
    axis 0 0 0 XYZ
  end
  begin
    name rfemur
    direction 0 -1 0
    length 14.6
    axis 0 0 0 XYZ
    dof rx
  end
  begin
    name rfoot
    direction 0 0 1
    length 2
    axis 0 0 0 XYZ
  end
  begin
    name spine
    direction 0 1 0
    length 9
    axis 0 0 0 XYZ
  end
  begin
    name head
    direction 0 1 0
    length 5
    axis 0 0 0 XYZ
    dof ry
  end
:hierarchy
  begin
    root lhip rhip spine
    lhip lfemur
    lfemur ltibia
    ltibia lfoot
    rhip rfemur
    rfemur rfoot
    spine head
  end
)";

std::string frame(int number, const std::string& root, const std::string& lfemur, const std::string& ltibia = "0 0") {
  return std::to_string(number) + "\nroot " + root + "\nlfemur " + lfemur + "\nltibia " + ltibia +
         "\nlfoot 0\nrfemur 0\nhead 0\n";
}

std::string motion() {
  return "#!OML\n:FULLY-SPECIFIED\n:DEGREES\n" + frame(1, "0 16 0 0 0 0", "0 0 0") +
         frame(2, "1 16 3 0 90 0", "-90 0 0");
}

LoadedClip load(const std::string& amc, const std::string& asf = skeleton, const AsfAmcOptions& options = {}) {
  return parse_amc(amc, parse_asf(asf, "p.asf"), "p_01.amc", options);
}

/// House axes and metres of a point given in file axes and units.
Vector house(double x, double y, double z) { return {z * unit, x * unit, y * unit}; }

Eigen::Matrix3d about(int axis, double degrees) {
  return Eigen::AngleAxisd(degrees * std::numbers::pi / 180, Eigen::Vector3d::Unit(axis)).toRotationMatrix();
}

}  // namespace

TEST_CASE("a standing person is where its bones put it") {
  const LoadedClip loaded = load(motion());
  const auto& clip = loaded.clip;
  CHECK(distance(position(clip, 0, "root"), house(0, 16, 0)) < 1e-12);
  CHECK(distance(position(clip, 0, "lhip"), house(0, 16, 0)) < 1e-12);
  CHECK(distance(position(clip, 0, "lfemur"), house(1.6, 14.8, 0)) < 1e-12);
  CHECK(distance(position(clip, 0, "lfoot"), house(1.6, 0.2, 0)) < 1e-12);
  CHECK(distance(position(clip, 0, "lfoot_end"), house(1.6, 0.2, 2)) < 1e-12);
  CHECK(distance(position(clip, 0, "rfoot_end"), house(-1.6, 0.2, 2)) < 1e-12);
  CHECK(distance(position(clip, 0, "head_end"), house(0, 30, 0)) < 1e-12);
  using traceur::body::JointType;
  CHECK(clip.skeleton[0].type == JointType::free);
  CHECK(clip.skeleton[clip.skeleton.find("lhip")].type == JointType::fixed);
  CHECK(clip.skeleton[clip.skeleton.find("ltibia")].type == JointType::ball);
  CHECK(clip.skeleton[clip.skeleton.find("head_end")].type == JointType::fixed);
  CHECK(loaded.report.unit == doctest::Approx(0.056444).epsilon(1e-5));
  CHECK(loaded.report.up == "y");
  CHECK(loaded.report.fps == 120);
  CHECK(contains(loaded.report.fps_reason, "option fps"));
  CHECK(loaded.report.standing_height == doctest::Approx(14.6 * unit / 0.491));
  CHECK(clip.times[1] == doctest::Approx(1.0 / 120));
}

TEST_CASE("angles turn about the bone's axes, in the order of dof") {
  const auto& clip = load(motion()).clip;
  // Root turned left by 90 degrees about y: left is -z, forward is x. The thigh swung forward.
  CHECK(distance(position(clip, 1, "root"), house(1, 16, 3)) < 1e-12);
  CHECK(distance(position(clip, 1, "lfemur"), house(1, 14.8, 3 - 1.6)) < 1e-9);
  CHECK(distance(position(clip, 1, "lfoot"), house(1 + 14.6, 14.8, 3 - 1.6)) < 1e-9);

  // The shin: C M C^-1 with C and M about fixed axes, x first.
  const std::string amc = frame(1, "0 16 0 10 20 30", "11 22 33", "25 -35") + frame(2, "0 16 0 0 0 0", "0 0 0");
  const auto turned = load(amc).clip;
  const Eigen::Matrix3d root = about(2, 30) * about(1, 20) * about(0, 10);
  const Eigen::Matrix3d thigh = root * about(2, 33) * about(1, 22) * about(0, 11);
  const Eigen::Matrix3d c = about(2, 20) * about(1, 40) * about(0, 30);
  const Eigen::Matrix3d shin = thigh * c * about(2, -35) * about(0, 25) * c.transpose();
  Eigen::Vector3d p =
      Eigen::Vector3d(0, 16, 0) + root * Eigen::Vector3d(1.6, -1.2, 0) + thigh * Eigen::Vector3d(0, -7.3, 0);
  CHECK(distance(position(turned, 0, "ltibia"), house(p.x(), p.y(), p.z())) < 1e-9);
  p += shin * Eigen::Vector3d(0, -7.3, 0);
  CHECK(distance(position(turned, 0, "lfoot"), house(p.x(), p.y(), p.z())) < 1e-9);
  p += shin * Eigen::Vector3d(0, 0, 2);
  CHECK(distance(position(turned, 0, "lfoot_end"), house(p.x(), p.y(), p.z())) < 1e-9);
}

TEST_CASE("orders of root and axis are as the file says") {
  std::string asf = replaced(skeleton, "order TX TY TZ RX RY RZ", "order RZ RX RY TZ TX TY");
  asf = replaced(asf, "axis 30 40 20 XYZ", "axis 20 30 40 ZXY");
  const std::string amc = frame(1, "30 10 20 3 1 16", "0 0 0", "25 0") + frame(2, "0 0 0 0 0 0", "0 0 0");
  const auto clip = load(amc, asf).clip;
  const Eigen::Matrix3d root = about(1, 20) * about(0, 10) * about(2, 30);
  const Eigen::Matrix3d c = about(1, 40) * about(0, 30) * about(2, 20);
  const Eigen::Vector3d p = Eigen::Vector3d(1, 16, 3) + root * Eigen::Vector3d(1.6, -1.2 - 7.3, 0) +
                            root * c * about(0, 25) * c.transpose() * Eigen::Vector3d(0, -7.3, 0);
  CHECK(distance(position(clip, 0, "lfoot"), house(p.x(), p.y(), p.z())) < 1e-9);
}

TEST_CASE("radians and degrees are told apart, by the clip before the skeleton") {
  const double half = std::numbers::pi / 2;
  char angle[32];
  std::snprintf(angle, sizeof angle, "-%.17g 0 0", half);
  const std::string frames = frame(1, "0 16 0 0 0 0", "0 0 0") + frame(2, "0 16 0 0 0 0", angle);
  const Vector swung = house(1.6, 14.8, 14.6);
  CHECK(distance(position(load(":RADIANS\n" + frames).clip, 1, "lfoot"), swung) < 1e-9);
  CHECK(
      distance(
          position(
              load(frames, replaced(replaced(skeleton, "angle deg", "angle rad"), "axis 30 40 20", "axis 0 0 0")).clip,
              1, "lfoot"),
          swung) < 1e-9);
}

TEST_CASE("a clip's own bones may come in any order, its frames start anywhere") {
  std::string amc = motion();
  amc = replaced(replaced(amc, "\n1\n", "\n41\n"), "\n2\n", "\n42\n");
  amc = replaced(amc, "head 0\n42", "42");
  amc = replaced(amc, "41\n", "41\nhead 0\n");
  const LoadedClip loaded = load(amc);
  CHECK(loaded.clip.poses == load(motion()).clip.poses);
  REQUIRE(!loaded.report.notes.empty());
  CHECK(contains(loaded.report.notes[0], "number 41"));
}

TEST_CASE("options: rate, unit, frames to skip, up axis") {
  AsfAmcOptions options;
  options.fps = 60;
  options.unit = 0.05;
  CHECK(load(motion(), skeleton, options).clip.times[1] == doctest::Approx(1.0 / 60));
  CHECK(load(motion(), skeleton, options).clip.poses(2, 0) == doctest::Approx(0.8));
  options.up = traceur::io::UpAxis::z;
  CHECK(load(motion(), skeleton, options).clip.poses(1, 0) == doctest::Approx(0.8));
  options = {};
  options.skip_frames = 1;
  const std::string third = frame(3, "0 16 0 0 0 0", "0 0 0");
  CHECK(load(motion() + third, skeleton, options).clip.poses == load(motion() + third).clip.poses.rightCols(2));
  CHECK(contains(error_of([&] { load(motion(), skeleton, options); }), "skip_frames"));
  options = {};
  options.fps = 0;
  CHECK(contains(error_of([&] { load(motion(), skeleton, options); }), "fps"));
}

TEST_CASE("a unit or an up axis that cannot be right is refused by the option's name") {
  CHECK(contains(error_of([&] { load(motion(), replaced(skeleton, "length 0.45", "length 1.0")); }),
                 "set the option unit"));
  std::string lying = skeleton;
  for (const auto& [from, to] :
       {std::pair{"direction 0 1 0", "direction 0 0 1"}, std::pair{"direction 0 1 0", "direction 0 0 1"},
        std::pair{"direction 0.8 -0.6 0", "direction 0.8 0 -0.6"},
        std::pair{"direction -0.8 -0.6 0", "direction -0.8 0 -0.6"}})
    lying = replaced(lying, from, to);
  CHECK(contains(error_of([&] { load(motion(), lying); }), "set the option up"));
  // Without names there is nothing to check against, which the report says.
  const LoadedClip nameless = load(replaced(motion(), "", ""), [] {
    std::string asf = skeleton;
    for (std::size_t at = 0; (at = asf.find("rfoot", at)) != std::string::npos;) asf.replace(at, 5, "rtip");
    return asf;
  }());
  CHECK(contains(nameless.report.notes.at(0), "could not be checked"));
}

TEST_CASE("the skeleton is the one beside the clip with its name up to the first underscore") {
  const motions::Folder folder;
  std::ofstream(folder / "07_12.amc") << motion();
  CHECK(traceur::io::asf_beside("a/07_12_b.amc") == std::filesystem::path("a/07.asf"));
  const std::string message = error_of([&] { traceur::io::read_asf_amc(folder / "07_12.amc"); });
  CHECK(contains(message, "07.asf; set the option skeleton"));
  std::ofstream(folder / "07.asf") << skeleton;
  CHECK(traceur::io::read_asf_amc(folder / "07_12.amc").clip.keys() == 2);
  std::ofstream(folder / "other.asf") << replaced(skeleton, "length 9", "length 8");
  AsfAmcOptions options;
  options.skeleton = folder / "other.asf";
  CHECK(distance(position(traceur::io::read_asf_amc(folder / "07_12.amc", options).clip, 0, "head_end"),
                 house(0, 29, 0)) < 1e-12);
  options.skeleton = folder / "none.asf";
  CHECK(
      contains(error_of([&] { traceur::io::read_asf_amc(folder / "07_12.amc", options); }), "none.asf: no such file"));
}

TEST_CASE("every fault of a skeleton is one line that names the place") {
  const std::string good = skeleton;
  const auto change = [&](const std::string& from, const std::string& to, const std::string& expected,
                          bool line = true) {
    const std::string message = error_of([&] { parse_asf(replaced(good, from, to), "s.asf"); });
    CAPTURE(message);
    CHECK(contains(message, expected));
    CHECK(!contains(message, "\n"));
    const auto number = 1 + std::count(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(good.find(from)), '\n');
    CHECK(contains(message, line ? "s.asf:" + std::to_string(number) + ": " : "s.asf:"));
  };
  change("length 0.45", "length x", "length: expected a number, found 'x'");
  change("length 0.45", "length 0", "length: expected more than 0");
  change("angle deg", "angle grad", "expected deg or rad");
  change("order TX TY TZ", "order TX TX TZ", "root order");
  change("orientation 0 0 0", "orientation 0 0 90", "not supported");
  change("name rhip", "name lhip", "a second bone named 'lhip'");
  change("name rhip", "name root", "expected a bone name other than 'root'");
  change("direction -0.8 -0.6 0", "direction -0.8 -0.6", "direction: expected a number, found the end of the line");
  change("direction -0.8 -0.6 0", "direction -0.8 -0.6 nan", "finite");
  change("direction -0.8 -0.6 0", "direction -0.8 -0.6 1", "expected a unit vector");
  change("length 14.6", "length -1", "expected zero or more");
  change("axis 30 40 20 XYZ", "axis 30 40 20 XXZ", "expected XYZ in some order");
  change("dof rx ry rz", "dof rx ry tx", "found 'tx'");
  change("dof rx ry rz", "dof rx ry rx", "found 'rx'");
  change("dof rx ry rz", "wheels 4", "found 'wheels'");
  change("root lhip rhip spine", "root lhip rhip spine tail", "no bone named 'tail'");
  change("root lhip rhip spine", "trunk lhip rhip spine", "no bone named 'trunk'");
  change("lhip lfemur", "lhip lfemur rfoot", "has two parents", false);
  change("spine head\n", "\n", "bone 'head' is not in the hierarchy", false);
  change("root lhip rhip spine", "root lhip spine\n lfoot rhip\n rfoot lfemur", "has two parents", false);
  change(":hierarchy", ":other", "expected a ':hierarchy' section", false);
  change(":bonedata", ":other", "no bone named 'lhip'", false);
  CHECK(contains(error_of([] { parse_asf("", "s.asf"); }), "s.asf:0: expected a ':bonedata' section"));
  CHECK(contains(error_of([] { parse_asf("hello", "s.asf"); }), "expected a section such as ':units'"));
  const std::string loop =
      ":bonedata\nbegin\nname a\ndirection 1 0 0\nlength 1\nend\nbegin\nname b\ndirection 1 0 0\nlength 1\nend\n"
      ":hierarchy\nbegin\na b\nb a\nend\n";
  CHECK(contains(error_of([&] { parse_asf(loop, "s.asf"); }), "hang in a loop"));
  for (std::size_t size = 0; size + 8 < good.size(); size += 3)
    CHECK(!error_of([&] { parse_asf(std::string_view(good).substr(0, size), "s.asf"); }).empty());
}

TEST_CASE("every fault of a clip is one line that names the place") {
  const std::string good = motion();
  const auto change = [&](const std::string& from, const std::string& to, const std::string& expected, int later = 0) {
    const std::string message = error_of([&] { load(replaced(good, from, to)); });
    CAPTURE(message);
    CHECK(contains(message, expected));
    CHECK(!contains(message, "\n"));
    const auto number =
        1 + later + std::count(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(good.find(from)), '\n');
    CHECK(contains(message, "p_01.amc:" + std::to_string(number) + ": "));
  };
  change("rfemur 0", "tail 0", "frame 1: bone 'tail' is not in the skeleton p.asf");
  change("rfemur 0", "lfoot 0", "frame 1: bone 'lfoot' twice");
  change("rfemur 0", "rfemur nan", "frame 1, rfemur: expected a finite number");
  change("rfemur 0", "rfemur -inf", "frame 1, rfemur: expected a finite number");
  change("rfemur 0", "rfemur x", "frame 1, rfemur: expected a number, found 'x'");
  change("rfemur 0", "rfemur", "expected a number, found the end of the line");
  change("rfemur 0", "rfemur 0 0", "expected the end of the line, found '0'");
  change("-90 0 0", "-90 0", "frame 2, lfemur: expected a number");
  change("rfemur 0\n", "#\n", "frame 1: expected bone 'rfemur'", 2);
  change("1\nroot 0 16", "root 0 16", "expected a frame number, found 'root'");
  change("2\nroot", "3\nroot", "expected frame 2, found 3");
  change("2\nroot", "2 2\nroot", "expected a frame number alone");
  change("2\nroot", ":RADIANS\nroot", "before the first frame");
  CHECK(contains(error_of([] { load(""); }), "expected at least two frames, found 0"));
  CHECK(contains(error_of([] { load(frame(1, "0 16 0 0 0 0", "0 0 0")); }), "expected at least two frames, found 1"));
  // Cut inside the second frame.
  const std::size_t begin = good.find("\n2\n") + 2, last = good.rfind("head");
  for (std::size_t size = begin; size < last; ++size) CHECK(!error_of([&] { load(good.substr(0, size)); }).empty());
}

TEST_CASE("recorded take: AMC and BVH of the same take put every joint in the same place") {
  const auto folder = motions::folder();
  if (!folder || !std::filesystem::exists(*folder / "cmu-asfamc/01_01.bvh")) {
    MESSAGE("skipped: no folder of recorded motions");
    return;
  }
  const auto amc = traceur::io::read_asf_amc(*folder / "cmu-asfamc/01_01.amc").clip;
  traceur::io::BvhOptions options;
  options.skip_frames = 1;
  const auto bvh = traceur::io::read_bvh(*folder / "cmu-asfamc/01_01.bvh", options).clip;
  REQUIRE(amc.keys() == bvh.keys());
  struct Pair {
    const char *in_amc, *in_bvh;
    bool above;
  };
  const Pair pairs[] = {
      {"root", "Hips", false},          {"lfemur", "LeftUpLeg", false},    {"ltibia", "LeftLeg", false},
      {"lfoot", "LeftFoot", false},     {"ltoes", "LeftToeBase", false},   {"ltoes_end", "LeftToeBase_end", false},
      {"rfemur", "RightUpLeg", false},  {"rtibia", "RightLeg", false},     {"rfoot", "RightFoot", false},
      {"rtoes", "RightToeBase", false}, {"upperback", "Spine", false},     {"thorax", "Spine1", false},
      {"lhumerus", "LeftArm", true},    {"lradius", "LeftForeArm", true},  {"lwrist", "LeftHand", true},
      {"rhumerus", "RightArm", true},   {"rradius", "RightForeArm", true}, {"head", "Head", true},
      {"head_end", "Head_end", true}};
  double worst = 0;
  for (int k = 0; k < amc.keys(); k += 7) {
    const auto a = motions::positions(amc, k), b = motions::positions(bvh, k);
    const auto in_amc = [&](const char* name) { return a[static_cast<std::size_t>(amc.skeleton.find(name))]; };
    const auto in_bvh = [&](const char* name) { return b[static_cast<std::size_t>(bvh.skeleton.find(name))]; };
    // Whoever made the BVH twin left out the thorax bone: neck and arms start where it starts, not where it ends.
    const Vector thorax = in_amc("lowerneck") - in_amc("thorax");
    for (const Pair& p : pairs) {
      REQUIRE(amc.skeleton.find(p.in_amc) >= 0);
      REQUIRE(bvh.skeleton.find(p.in_bvh) >= 0);
      const Vector expected = p.above ? in_amc(p.in_amc) - thorax : in_amc(p.in_amc);
      worst = std::max(worst, distance(expected, in_bvh(p.in_bvh)));
    }
  }
  CAPTURE(worst);
  CHECK(worst < 1e-5);
}
