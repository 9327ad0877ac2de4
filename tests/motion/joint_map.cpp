// SPDX-License-Identifier: MIT
#include "traceur/motion/joint_map.hpp"

#include <doctest/doctest.h>

#include <string>
#include <vector>

using namespace traceur;
using namespace traceur::motion;

namespace {

struct Row {
  const char* name;
  int parent;
  core::Vector3<double> offset;
};

body::Skeleton skeleton(const std::vector<Row>& rows) {
  body::Skeleton s;
  for (const Row& r : rows) {
    body::Joint j;
    j.name = j.body = r.name;
    j.parent = r.parent;
    j.type = r.parent < 0 ? body::JointType::free : body::JointType::ball;
    j.offset = r.offset;
    s.add(j);
  }
  return s;
}

/// One skeleton, thirteen to fifteen names: root, spine, neck, then per side collar, arm, forearm, hand, thigh, shin, foot, toe.
body::Skeleton humanoid(const std::array<const char*, 3>& trunk, const std::array<std::array<const char*, 8>, 2>& sides) {
  std::vector<Row> rows{{trunk[0], -1, {0, 0, 0}}, {trunk[1], 0, {0, 0, 0.2}}, {trunk[2], 1, {0, 0, 0.25}}};
  for (int side = 0; side < 2; ++side) {
    const double y = side == 0 ? 1 : -1;
    const auto& n = sides[static_cast<std::size_t>(side)];
    int last = 1;
    const core::Vector3<double> arm[]{{0, 0.05 * y, 0.2}, {0, 0.15 * y, 0}, {0, 0.3 * y, 0}, {0, 0.25 * y, 0}};
    for (int k = 0; k < 4; ++k)
      if (n[static_cast<std::size_t>(k)] != nullptr) {
        rows.push_back({n[static_cast<std::size_t>(k)], last, arm[k]});
        last = static_cast<int>(rows.size()) - 1;
      }
    last = 0;
    const core::Vector3<double> leg[]{{0, 0.1 * y, 0}, {0, 0, -0.4}, {0, 0, -0.4}, {0.15, 0, -0.05}};
    for (int k = 4; k < 8; ++k)
      if (n[static_cast<std::size_t>(k)] != nullptr) {
        rows.push_back({n[static_cast<std::size_t>(k)], last, leg[k - 4]});
        last = static_cast<int>(rows.size()) - 1;
      }
  }
  return skeleton(rows);
}

const auto bvh = [] {
  return humanoid({"Hips", "Spine", "Neck"},
                  {{{"LeftShoulder", "LeftArm", "LeftForeArm", "LeftHand", "LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase"},
                    {"RightShoulder", "RightArm", "RightForeArm", "RightHand", "RightUpLeg", "RightLeg", "RightFoot", "RightToeBase"}}});
};
const auto mujoco = [] {
  return humanoid({"pelvis", "torso", "head"},
                  {{{nullptr, "left_upper_arm", "left_lower_arm", "left_hand", "left_thigh", "left_shin", "left_foot", nullptr},
                    {nullptr, "right_upper_arm", "right_lower_arm", "right_hand", "right_thigh", "right_shin", "right_foot", nullptr}}});
};

void check_complete(const body::Skeleton& source) {
  const body::Skeleton target = mujoco();
  const JointMap map = map_joints(source, target);
  // Every landmark lies where the same landmark of the target does: same depth below the root along limbs, same side.
  for (std::size_t side = 0; side < 2; ++side) {
    const BodyPlan::Limbs &a = map.source.side[side], &b = map.target.side[side];
    CHECK(source[a.hip].parent == 0);
    CHECK(source[a.knee].parent == a.hip);
    CHECK(source[a.ankle].parent == a.knee);
    CHECK(source[a.elbow].parent == a.shoulder);
    CHECK(source[a.wrist].parent == a.elbow);
    CHECK(source[a.hip].offset.y * target[b.hip].offset.y > 0);
    if (a.toe >= 0) CHECK(source[a.toe].parent == a.ankle);
  }
  CHECK(map.source.chest == 1);
  CHECK(map.source.neck == 2);
  for (const int s : map.source_of) CHECK(s >= 0);
}

std::string error_of(const auto& f) {
  try {
    f();
  } catch (const Error& e) {
    return e.what();
  }
  return "";
}

}  // namespace

TEST_SUITE("joint_map") {
  TEST_CASE("one place, many names") {
    struct Named {
      Landmark landmark;
      std::vector<const char*> left;
    };
    const std::vector<Named> all{
        {Landmark::hip, {"LeftUpLeg", "Character1_LeftUpLeg", "mixamorig:LeftUpLeg", "lfemur", "left_hip", "left_thigh", "L_Hip",
                         "lThigh", "LeftHip", "LeftUpperLeg", "Bip01 L Thigh", "thigh.L", "LEFT_THIGH"}},
        {Landmark::knee, {"LeftLeg", "Character1_LeftLeg", "ltibia", "left_knee", "left_shin", "L_Knee", "lShin", "LeftLowLeg", "Bip01 L Calf"}},
        {Landmark::ankle, {"LeftFoot", "Character1_LeftFoot", "lfoot", "left_ankle", "left_foot", "L_Ankle"}},
        {Landmark::toe, {"LeftToe", "LeftToes", "LeftToeBase", "Character1_LeftToeBase", "ltoes", "Bip01 L Toe0", "LeftToe1"}},
        {Landmark::clavicle, {"lclavicle", "LeftCollar", "L_Collar"}},
        {Landmark::shoulder, {"LeftArm", "lhumerus", "left_upper_arm", "left_shoulder", "LeftUpArm", "LeftShoulder1", "Bip01 L UpperArm"}},
        {Landmark::elbow, {"LeftForeArm", "lradius", "left_elbow", "left_lower_arm", "L_Elbow", "LeftLowArm"}},
        {Landmark::wrist, {"LeftHand", "lwrist", "left_hand", "left_wrist", "L_Wrist", "mixamorig:LeftHand"}}};
    for (const Named& n : all)
      for (const char* name : n.left) {
        CAPTURE(name);
        CHECK(recognise_joint(name).landmark == n.landmark);
        CHECK(recognise_joint(name).side == Side::left);
      }
    CHECK(recognise_joint("rfemur").side == Side::right);
    CHECK(recognise_joint("RightForeArm").side == Side::right);
    for (const char* name : {"Hips", "pelvis", "root", "Character1_Hips"}) CHECK(recognise_joint(name).landmark == Landmark::pelvis);
    for (const char* name : {"Spine", "Spine2", "lowerback", "thorax", "chest", "torso"}) CHECK(recognise_joint(name).landmark == Landmark::spine);
    for (const char* name : {"Neck", "Neck1", "lowerneck", "upperneck"}) CHECK(recognise_joint(name).landmark == Landmark::neck);
    CHECK(recognise_joint("Head").landmark == Landmark::head);
    // Joints that only look like a landmark.
    for (const char* name : {"lhipjoint", "LHipJoint", "L_Femur_RIGMESH", "Head_end", "LThumb", "RightUpLegDummy", "lfingers", "", "_", "l"})
      CHECK_MESSAGE(recognise_joint(name).landmark == Landmark::none, name);
  }

  TEST_CASE("styles of naming map onto the character") {
    check_complete(bvh());
    check_complete(mujoco());
    check_complete(humanoid({"root", "thorax", "lowerneck"},
                            {{{"lclavicle", "lhumerus", "lradius", "lwrist", "lfemur", "ltibia", "lfoot", "ltoes"},
                              {"rclavicle", "rhumerus", "rradius", "rwrist", "rfemur", "rtibia", "rfoot", "rtoes"}}}));
    check_complete(humanoid({"root", "chest", "neck"},
                            {{{nullptr, "left_shoulder", "left_elbow", "left_wrist", "left_hip", "left_knee", "left_ankle", nullptr},
                              {nullptr, "right_shoulder", "right_elbow", "right_wrist", "right_hip", "right_knee", "right_ankle", nullptr}}}));
    check_complete(humanoid({"Pelvis", "Torso", "Neck"},
                            {{{"L_Collar", "L_Shoulder", "L_Elbow", "L_Wrist", "L_Hip", "L_Knee", "L_Ankle", "L_Foot"},
                              {"R_Collar", "R_Shoulder", "R_Elbow", "R_Wrist", "R_Hip", "R_Knee", "R_Ankle", "R_Foot"}}}));
  }

  TEST_CASE("a shoulder is the collar where there is an arm besides") {
    const body::Skeleton s = bvh();
    const BodyPlan plan = find_body_plan(s);
    CHECK(s[plan.left().shoulder].name == "LeftArm");
    CHECK(s[plan.right().shoulder].name == "RightArm");
  }

  TEST_CASE("unknown names are listed and can be given by hand") {
    body::Skeleton s = humanoid({"Hips", "Spine", "Neck"},
                                {{{"LeftShoulder", "LeftArm", "LeftForeArm", "LeftHand", "Oberschenkel", "LeftLeg", "LeftFoot", "Zeh"},
                                  {"RightShoulder", "RightArm", "Unterarm", "RightHand", "RightUpLeg", "RightLeg", "RightFoot", "RightToe"}}});
    const body::Skeleton target = mujoco();
    const std::string message = error_of([&] { map_joints(s, target, {}, "clip 'x'"); });
    CHECK(message.find("clip 'x'") == 0);
    CHECK(message.find("left_hip ('left_thigh')") != std::string::npos);
    CHECK(message.find("right_elbow ('right_lower_arm')") != std::string::npos);
    CHECK(message.find("Oberschenkel") != std::string::npos);
    CHECK(message.find('\n') == std::string::npos);

    const JointNames names = parse_joint_names("{\n \"left_thigh\": \"Oberschenkel\",\n \"right_lower_arm\":\"Unterarm\"\n}\n", "map.json");
    const JointMap map = map_joints(s, target, names);
    CHECK(s[map.source.left().hip].name == "Oberschenkel");
    CHECK(s[map.source.right().elbow].name == "Unterarm");
    // A toe without a known name is found below its foot.
    CHECK(s[map.source.left().toe].name == "Zeh");
    CHECK(map.unmapped.empty());
  }

  TEST_CASE("names given by hand win over recognised ones") {
    const body::Skeleton s = bvh(), target = mujoco();
    const JointMap map = map_joints(s, target, {{"left_upper_arm", "LeftShoulder"}, {"right_toe", "RightFoot"}});
    CHECK(s[map.source.left().shoulder].name == "LeftShoulder");
    CHECK(s[map.source.right().toe].name == "RightFoot");
    CHECK(error_of([&] { map_joints(s, target, {{"left_thigh", "Nowhere"}}); }).find("'Nowhere'") != std::string::npos);
    CHECK(error_of([&] { map_joints(s, target, {{"tail", "LeftLeg"}}); }).find("'tail'") != std::string::npos);
  }

  TEST_CASE("a map file that is not one names its line") {
    CHECK(parse_joint_names("{}", "m").empty());
    CHECK(parse_joint_names("{\"a\\\"\\\\b\": \"c d\"}", "m").at("a\"\\b") == "c d");
    for (const char* text : {"", "[]", "{\"a\"}", "{\"a\": 1}", "{\"a\": \"b\"", "{\"a\": \"b\",}", "{\"a\": \"b\"} x", "{\"a\": \"b", "{\"a\": \"\\u0041\"}",
                             "{\"a\":\"b\",\"a\":\"c\"}"}) {
      CAPTURE(text);
      CHECK(error_of([&] { parse_joint_names(text, "map.json"); }).find("map.json:1:") == 0);
    }
    CHECK(error_of([&] { parse_joint_names("{\n\"a\": \"b\"\n\"c\"", "map.json"); }).find("map.json:3:") == 0);
  }

  TEST_CASE("a character without legs is refused") {
    const body::Skeleton s = bvh();
    const body::Skeleton ball = skeleton({{"ball", -1, {0, 0, 0}}});
    CHECK(error_of([&] { map_joints(s, ball); }).find("left_hip") != std::string::npos);
  }
}
