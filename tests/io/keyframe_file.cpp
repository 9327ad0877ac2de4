// SPDX-License-Identifier: MIT
#include <traceur/io/keyframe_file.hpp>

#include <doctest/doctest.h>

#include <traceur/io/mjcf.hpp>

using namespace traceur;

namespace {

const body::Skeleton& humanoid() {
  static const body::Skeleton s = io::read_mjcf(TRACEUR_SOURCE_DIR "/examples/characters/humanoid.xml").skeleton;
  return s;
}

std::string error_of(const std::string& text) {
  try {
    io::keyframes_from_text(text, humanoid(), "here");
  } catch (const Error& e) {
    return e.what();
  }
  return "";
}

const std::string squat = R"({"format": "traceur keyframes 1", "name": "squat", "fps": 30, "keys": [
  {"time_s": 0, "root_m": [0, 0, 0.88], "pins": [{"joint": "right_ankle", "at_m": [0, -0.08, 0.05]}, {"joint": "left_ankle", "at_m": [0, 0.08, 0.05]}]},
  {"time_s": 0.5, "root_m": [0, 0, 0.7], "joints_deg": {"right_knee": [60], "left_knee": [60], "right_hip": [0, -30, 0], "left_hip": [0, -30, 0]},
   "pins": [{"joint": "right_ankle", "at_m": [0, -0.08, 0.05]}, {"joint": "left_ankle", "at_m": [0, 0.08, 0.05], "weight": 2}]},
  {"time_s": 1, "root_m": [0, 0, 0.75]}]})";

}  // namespace

TEST_CASE("an authored squat keeps its feet where they are pinned and bends its knees") {
  const motion::Clip clip = io::keyframes_from_text(squat, humanoid(), "here");
  CHECK(clip.name == "squat");
  CHECK(clip.keys() == 31);
  body::Frames<double> frames(humanoid());
  for (const int k : {0, 15}) {
    body::forward_kinematics(humanoid(), clip.poses.col(k).data(), frames);
    const auto right = frames.position[static_cast<std::size_t>(humanoid().find("right_ankle"))];
    CHECK(norm(right - core::Vector3<double>{0, -0.08, 0.05}) < 0.01);
  }
  const int knee = humanoid()[humanoid().find("right_knee")].q_index;
  CHECK(clip.poses(knee, 15) > 0.6);
  // What a key does not name is as authored in the key before, not as solved there.
  CHECK(clip.poses(knee, 30) == doctest::Approx(60 * std::numbers::pi / 180));
  CHECK(clip.poses(2, 30) == doctest::Approx(0.75));
}

TEST_CASE("what is wrong with a file is named") {
  const auto with = [](const std::string& keys) { return R"({"format": "traceur keyframes 1", "name": "a", "keys": [)" + keys + "]}"; };
  const std::string end = R"(, {"time_s": 1})";
  CHECK(error_of("{}") == "here: expected a field 'format'");
  CHECK(error_of(R"({"format": "keys"})") == "here: expected the format 'traceur keyframes 1'");
  CHECK(error_of(with(R"({"time_s": 0})")) == "here: keyframes 'a': expected at least two keys, found 1");
  CHECK(error_of(with(R"({"time": 0})" + end)) == "here: key 0: expected a field 'time_s'");
  CHECK(error_of(with(R"({"time_s": 0, "joints_deg": {"tail": [1]}})" + end)) == "here: key 0: the character has no joint 'tail'");
  CHECK(error_of(with(R"({"time_s": 0, "joints_deg": {"right_knee": [1, 2, 3]}})" + end)) ==
        "here: key 0: right_knee: expected a list of 1, found 3");
  CHECK(error_of(with(R"({"time_s": 0, "pins": [{"joint": "right_ankle"}]})" + end)) == "here: key 0: pin 0: expected a field 'at_m'");
  CHECK(error_of("{\n\"format\"").find("here:2") != std::string::npos);
}
