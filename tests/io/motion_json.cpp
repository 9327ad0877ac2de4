// SPDX-License-Identifier: MIT
#include <traceur/io/motion_json.hpp>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <string>
#include <vector>

#include <doctest/doctest.h>
#include <nlohmann/json.hpp>

#include "motions.hpp"
#include <traceur/io/deepmimic.hpp>

using Json = nlohmann::json;
using motions::contains;
using motions::distance;
using motions::error_of;
using motions::position;
using motions::replaced;
using motions::Vector;
using traceur::io::LoadedClip;
using traceur::io::parse_motion_json;

namespace {

const Json one = {0, 0, 0, 1};
const double half = std::sqrt(0.5);
const Json left_turn = {0, 0, half, half};  // 90 degrees about z

/// Two frames of a three-node chain.
Json amp() {
  return {{"fps", 20},
          {"node_names", {"pelvis", "torso", "head"}},
          {"parent_indices", {-1, 0, 1}},
          {"local_translation", {{7, 7, 7}, {0.1, 0, 0.2}, {0, 0.3, 0}}},
          {"is_local", true},
          {"root_translation", {{1, 2, 3}, {1, 2, 3.5}}},
          {"rotation", {{one, one, one}, {left_turn, left_turn, one}}}};
}

Json parc() {
  Json joints = Json::array(), labels = Json::array();
  for (int i = 0; i < 14; ++i) joints.push_back(one);
  for (int i = 0; i < 15; ++i) labels.push_back(i == 11 ? 1 : 0);
  return {{"fps", 30},
          {"loop_mode", "CLAMP"},
          {"root_pos", {{0, 0, 0.9}, {0.1, 0, 0.9}}},
          {"root_rot", {one, one}},
          {"joint_rot", {joints, joints}},
          {"body_contacts", {labels, labels}},
          {"terrain", {{"hf", {{0, 0.5}, {1, 1.5}, {2, 2.5}}}, {"min_point", {-1, -2}}, {"dx", 0.4}}}};
}

LoadedClip load(const Json& json) { return parse_motion_json(json.dump(), "clips/m.json"); }

}  // namespace

TEST_CASE("an AMP clip brings its skeleton and local rotations") {
  const LoadedClip loaded = load(amp());
  const auto& clip = loaded.clip;
  CHECK(clip.name == "m");
  REQUIRE(clip.skeleton.size() == 3);
  CHECK(clip.skeleton[2].parent == 1);
  CHECK(clip.skeleton[2].type == traceur::body::JointType::ball);
  CHECK(clip.times[1] == doctest::Approx(0.05));
  CHECK(distance(position(clip, 0, "head"), {1.1, 2.3, 3.2}) < 1e-12);
  // Turned left at pelvis and torso: (0.1, 0) to (0, 0.1), then (0, 0.3) by half a turn to (0, -0.3).
  CHECK(distance(position(clip, 1, "torso"), {1, 2.1, 3.7}) < 1e-12);
  CHECK(distance(position(clip, 1, "head"), {1, 1.8, 3.7}) < 1e-12);
  CHECK(!clip.cyclic);
  CHECK(!loaded.terrain);
  CHECK(loaded.report.format == "AMP JSON");
  CHECK(loaded.report.up == "z");
}

TEST_CASE("a PARC clip has the humanoid, contact labels and the ground") {
  const LoadedClip loaded = load(parc());
  const auto& clip = loaded.clip;
  CHECK(clip.skeleton.nq() == 7 + 14 * 4);
  CHECK(clip.skeleton[11].body == "right_foot");
  CHECK(clip.skeleton[11].name == "right_ankle");
  CHECK(distance(position(clip, 0, "right_ankle"), {0, -0.084887, 0.9 - 0.421546 - 0.40987}) < 1e-12);
  CHECK(distance(position(clip, 1, "left_wrist"),
                 {0.1 - 0.02405, 0.18311 + 0.274788 + 0.258947, 0.9 + 0.236151 + 0.2435}) < 1e-12);
  REQUIRE(clip.contacts.rows() == 15);
  REQUIRE(clip.contacts.cols() == 2);
  CHECK(clip.contacts(11, 1) == 1);
  CHECK(clip.contacts.sum() == 2);
  REQUIRE(loaded.terrain);
  CHECK(loaded.terrain->heights.rows() == 3);
  CHECK(loaded.terrain->heights.cols() == 2);
  CHECK(loaded.terrain->heights(2, 1) == 2.5);
  CHECK(loaded.terrain->min_point == Eigen::Vector2d(-1, -2));
  CHECK(loaded.terrain->dx == 0.4);
  CHECK(!clip.cyclic);
}

TEST_CASE("labels, ground and loop mode may be absent; wrapping is cyclic") {
  Json j = parc();
  j.erase("body_contacts");
  j.erase("terrain");
  j["loop_mode"] = "WRAP";
  j["obs"] = {1, 2};
  const LoadedClip loaded = load(j);
  CHECK(loaded.clip.contacts.size() == 0);
  CHECK(!loaded.terrain);
  CHECK(loaded.clip.cyclic);
  REQUIRE(loaded.report.notes.size() == 1);
  CHECK(contains(loaded.report.notes[0], "dropped the field 'obs'"));
  j.erase("loop_mode");
  CHECK(!load(j).clip.cyclic);
}

TEST_CASE("every fault names field and frame") {
  const auto fault = [](const std::string& text, const std::string& expected) {
    const std::string message = error_of([&] { parse_motion_json(text, "m.json"); });
    CAPTURE(message);
    CHECK(contains(message, "m.json:"));
    CHECK(contains(message, expected));
    CHECK(!contains(message, "\n"));
  };
  const auto change = [&](Json j, const std::string& pointer, const Json& value, const std::string& expected) {
    j[Json::json_pointer(pointer)] = value;
    fault(j.dump(), expected);
  };
  const auto drop = [&](Json j, const std::string& key, const std::string& expected) {
    j.erase(key);
    fault(j.dump(), expected);
  };
  fault("", "truncated");
  fault("[1]", "expected an object");
  fault("{}", "found neither");
  fault("{\"root_pos\": [[NaN]]}", "m.json:1: not JSON");

  drop(amp(), "fps", "expected a field 'fps'");
  drop(amp(), "rotation", "expected a field 'rotation'");
  change(amp(), "/fps", 0, "fps: expected frames a second");
  change(amp(), "/fps", "fast", "fps: expected a number");
  change(amp(), "/is_local", false, "is_local: expected true");
  change(amp(), "/node_names/1", "pelvis", "node_names[1]: a second node named 'pelvis'");
  change(amp(), "/node_names/1", 3, "node_names[1]: expected a text");
  change(amp(), "/node_names", Json::array(), "node_names: expected 1 to 2000 names");
  change(amp(), "/parent_indices/0", 0, "parent_indices[0]: expected -1");
  change(amp(), "/parent_indices/1", 1, "parent_indices[1]: expected the index of an earlier node");
  change(amp(), "/parent_indices/2", 0.5, "parent_indices[2]: expected the index of an earlier node");
  change(amp(), "/parent_indices", {-1, 0}, "parent_indices: expected a list of 3, found 2");
  change(amp(), "/local_translation/1", {1, 2}, "local_translation[1]: expected a list of 3, found 2");
  change(amp(), "/root_translation/1", {1, 2, "x"}, "root_translation[1]: expected a number");
  change(amp(), "/root_translation", {{1, 2, 3}}, "rotation: expected a list of 1, found 2");
  change(amp(), "/rotation/1/2", {0, 0, 0, 0}, "rotation[1][2]: expected a unit quaternion");
  change(amp(), "/rotation/1/2", {0, 0, 1e300, 0}, "rotation[1][2]: expected a finite number");
  change(amp(), "/rotation/1", {one, one}, "rotation[1]: expected a list of 3, found 2");
  Json short_clip = amp();
  short_clip["root_translation"] = {{1, 2, 3}};
  short_clip["rotation"] = {{one, one, one}};
  fault(short_clip.dump(), "expected at least two frames, found 1");

  drop(parc(), "joint_rot", "expected a field 'joint_rot'");
  change(parc(), "/loop_mode", "PING", "loop_mode: expected CLAMP or WRAP, found 'PING'");
  change(parc(), "/root_rot", Json::array({one}), "root_rot: expected a list of 2, found 1");
  change(parc(), "/joint_rot/0", Json::array({one}), "joint_rot[0]: expected a list of 14, found 1");
  change(parc(), "/joint_rot/1/3", {1, 1, 1, 1}, "joint_rot[1][3]: expected a unit quaternion");
  change(parc(), "/body_contacts/1", {1}, "body_contacts[1]: expected a list of 15, found 1");
  change(parc(), "/body_contacts/1/0", 2, "body_contacts[1]: expected labels from 0 to 1");
  change(parc(), "/terrain/hf/2", {1}, "hf[2]: expected a list of 2, found 1");
  change(parc(), "/terrain/hf", Json::array(), "hf: expected at least one row");
  change(parc(), "/terrain/hf/0/0", nullptr, "hf[0]: expected a number");
  change(parc(), "/terrain/dx", 0, "dx: expected metres, more than 0");
  change(parc(), "/terrain/min_point", {0, 0, 0}, "min_point: expected a list of 2, found 3");
  const std::string good = parc().dump();
  for (std::size_t size = 0; size < good.size(); size += 7)
    CHECK(!error_of([&] { parse_motion_json(good.substr(0, size), "m"); }).empty());
  fault(std::string(200000, '['), "not JSON");
  fault(good + std::string(1, '\0'), "m.json:1: not JSON: did not expect a null byte");
  fault(good + "\n" + std::string("\0 and more", 10), "m.json:2: not JSON: did not expect a null byte");
  fault(replaced(amp().dump(), "pelvis", std::string("pel\0vis", 7)), "null byte");
}

TEST_CASE("recorded: feet labelled in contact touch the ground that came with the clip") {
  const auto folder = motions::folder();
  if (!folder || !std::filesystem::exists(*folder / "parc")) {
    MESSAGE("skipped: no folder of recorded motions");
    return;
  }
  for (const char* name : {"parc/dec2024_teaser_717_1_opt_dm.json", "parc/TEASER_TERRAIN.json", "parc/sfu.json"}) {
    CAPTURE(name);
    const LoadedClip loaded = traceur::io::read_motion_json(*folder / name);
    REQUIRE(loaded.terrain);
    const auto& t = *loaded.terrain;
    // Height of a foot's joint over the cell it is nearest to; the median, as a foot on an edge may be nearest to the
    // pit beside.
    std::vector<double> above;
    for (int k = 0; k < loaded.clip.keys(); ++k) {
      const auto p = motions::positions(loaded.clip, k);
      for (const int foot : {11, 14}) {
        const Vector at = p[static_cast<std::size_t>(foot)];
        const auto i = std::lround((at.x - t.min_point.x()) / t.dx), j = std::lround((at.y - t.min_point.y()) / t.dx);
        if (loaded.clip.contacts(foot, k) < 0.5 || i < 0 || j < 0 || i >= t.heights.rows() || j >= t.heights.cols())
          continue;
        above.push_back(at.z - t.heights(i, j));
      }
    }
    REQUIRE(above.size() > 10);
    std::nth_element(above.begin(), above.begin() + static_cast<std::ptrdiff_t>(above.size() / 2), above.end());
    const double median = above[above.size() / 2];
    CAPTURE(median);
    CHECK(median > 0.02);
    CHECK(median < 0.1);
  }
}

TEST_CASE("recorded: two clips of one motion in two formats agree") {
  const auto folder = motions::folder();
  if (!folder || !std::filesystem::exists(*folder / "cmu-amp-humanoid/amp_humanoid_backflip.json")) {
    MESSAGE("skipped: no folder of recorded motions");
    return;
  }
  const auto amp_clip = traceur::io::read_motion_json(*folder / "cmu-amp-humanoid/amp_humanoid_backflip.json").clip;
  const auto deepmimic = traceur::io::read_deepmimic(*folder / "deepmimic/humanoid3d_backflip.txt").clip;
  REQUIRE(amp_clip.keys() == deepmimic.keys());
  double worst = 0;
  for (int k = 0; k < amp_clip.keys(); ++k)
    for (const char* name : {"pelvis", "left_foot", "right_shin", "head"}) {
      const auto a = motions::positions(amp_clip, k), b = motions::positions(deepmimic, k);
      const int i = amp_clip.skeleton.find_body(name), j = deepmimic.skeleton.find_body(name);
      REQUIRE(i >= 0);
      REQUIRE(j >= 0);
      worst = std::max(worst, distance(a[static_cast<std::size_t>(i)] - a[0], b[static_cast<std::size_t>(j)] - b[0]));
    }
  CAPTURE(worst);
  CHECK(worst < 0.02);
}
