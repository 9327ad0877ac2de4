// SPDX-License-Identifier: MIT
#include "traceur/motion/retarget.hpp"

#include <doctest/doctest.h>

#include <cstdlib>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "traceur/core/random.hpp"
#include "traceur/io/load_clip.hpp"
#include "traceur/io/mjcf.hpp"

using namespace traceur;
using namespace traceur::motion;

namespace {

using Vec = core::Vector3<double>;
using Quat = core::Quaternion<double>;
constexpr double pi = std::numbers::pi;
const Vec ex{1, 0, 0}, ey{0, 1, 0}, ez{0, 0, 1};

const body::Character& humanoid() {
  static const body::Character c = io::read_mjcf(TRACEUR_SOURCE_DIR "/examples/characters/humanoid.xml");
  return c;
}

body::Frames<double> frames(const body::Skeleton& s, const Eigen::VectorXd& q) {
  body::Frames<double> f(s);
  body::forward_kinematics(s, q.data(), f);
  return f;
}
body::Frames<double> frames(const Clip& c, int key) { return frames(c.skeleton, c.poses.col(key)); }
Vec place(const Clip& c, int key, const char* body) { return frames(c, key).position[static_cast<std::size_t>(c.skeleton.find_body(body))]; }
Quat turn(const Clip& c, int key, const char* body) { return frames(c, key).rotation[static_cast<std::size_t>(c.skeleton.find_body(body))]; }

double angle(const Quat& a, const Quat& b) { return norm(core::log_map(a.conjugate() * b)); }
double degrees(double rad) { return rad * 180 / pi; }
Quat about(const Vec& axis, double rad) { return core::about_axis(axis, rad); }

RetargetOptions in_place() {
  RetargetOptions o;
  o.align = false;
  return o;
}

/// Our humanoid squats: soles stay where they are, arms swing, elbows bend, trunk leans, head turns. 2 s at 30 fps.
Clip squat() {
  const body::Skeleton& s = humanoid().skeleton;
  Clip c{"squat", s, Eigen::VectorXd::LinSpaced(61, 0, 2), Eigen::MatrixXd(s.nq(), 61), {}, false};
  const double thigh = 0.421546, shin = 0.40987;
  for (int k = 0; k < c.keys(); ++k) {
    const double u = 0.5 - 0.5 * std::cos(pi * c.times[k]);
    const double hip = -0.9 * u, knee = 1.6 * u + 0.02;
    Eigen::VectorXd q = s.neutral_pose();
    q[0] = thigh * std::sin(hip) + shin * std::sin(hip + knee);
    q[2] = 0.05 + thigh * std::cos(hip) + shin * std::cos(hip + knee);
    const auto set = [&](const std::string& joint, const Quat& r) { r.store(q.data() + s[s.find(joint)].q_index); };
    for (const std::string side : {"left", "right"}) {
      set(side + "_hip", about(ey, hip));
      q[s[s.find(side + "_knee")].q_index] = knee;
      set(side + "_ankle", about(ey, -hip - knee));
      set(side + "_shoulder", about(ey, -1.2 * u) * about(ex, side == "left" ? 0.3 : -0.3));
      q[s[s.find(side + "_elbow")].q_index] = 0.7 + 0.3 * u;
    }
    set("abdomen", about(ey, 0.4 * u));
    set("neck", about(ez, 0.3 * u));
    c.poses.col(k) = q;
  }
  return c;
}

struct Row {
  const char* name;
  const char* parent;
  Vec offset;
};

/// A person with names as in many BVH files, taller than our humanoid, in a T-pose at zero angles; x forward, z up.
body::Skeleton t_pose() {
  std::vector<Row> rows{{"Hips", "", {0, 0, 0}},           {"Spine", "Hips", {0, 0, 0.12}},     {"Spine1", "Spine", {0, 0, 0.15}},
                        {"Neck", "Spine1", {0, 0, 0.25}},  {"Head", "Neck", {0, 0, 0.1}},       {"Head_end", "Head", {0, 0, 0.2}}};
  static const char* names[2][8] = {
      {"LeftShoulder", "LeftArm", "LeftForeArm", "LeftHand", "LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase"},
      {"RightShoulder", "RightArm", "RightForeArm", "RightHand", "RightUpLeg", "RightLeg", "RightFoot", "RightToeBase"}};
  for (int side = 0; side < 2; ++side) {
    const double y = side == 0 ? 1 : -1;
    const char* const* n = names[side];
    rows.push_back({n[0], "Spine1", {0, 0.05 * y, 0.2}});
    rows.push_back({n[1], n[0], {0, 0.15 * y, 0}});
    rows.push_back({n[2], n[1], {0, 0.31 * y, 0}});
    rows.push_back({n[3], n[2], {0, 0.26 * y, 0}});
    rows.push_back({n[4], "Hips", {0, 0.1 * y, -0.05}});
    rows.push_back({n[5], n[4], {0, 0, -0.5}});
    rows.push_back({n[6], n[5], {0, 0, -0.48}});
    rows.push_back({n[7], n[6], {0.16, 0, -0.07}});
  }
  body::Skeleton s;
  for (const Row& r : rows) {
    body::Joint j;
    j.name = j.body = r.name;
    j.parent = s.find(r.parent);
    j.type = j.parent < 0 ? body::JointType::free : j.name == "Head_end" ? body::JointType::fixed : body::JointType::ball;
    if (j.parent >= 0) j.offset = r.offset;
    s.add(j);
  }
  return s;
}

/// A clip of `s` from each joint's rotation in time, standing with its ankles 9 cm high where it rests at zero angles.
using Rotation = std::function<Quat(const std::string& joint, double time)>;
Clip animate(const body::Skeleton& s, const Rotation& rotation, double seconds = 2, int keys = 61) {
  Clip c{"animated", s, Eigen::VectorXd::LinSpaced(keys, 0, seconds), Eigen::MatrixXd(s.nq(), keys), {}, false};
  for (int k = 0; k < keys; ++k) {
    Eigen::VectorXd q = s.neutral_pose();
    for (const body::Joint& j : s.joints()) {
      if (j.type == body::JointType::ball) rotation(j.name, c.times[k]).store(q.data() + j.q_index);
      if (j.type == body::JointType::free) rotation(j.name, c.times[k]).store(q.data() + 3);
    }
    // The left foot stays where it is.
    const Vec ankle = frames(s, q).position[static_cast<std::size_t>(s.find("LeftFoot"))];
    q[0] = -ankle.x;
    q[1] = 0.1 - ankle.y;
    q[2] = 0.09 - ankle.z;
    c.poses.col(k) = q;
  }
  return c;
}

/// Squats with bent elbows and raised arms.
Quat t_pose_squat(const std::string& joint, double time) {
  const double u = 0.5 - 0.5 * std::cos(pi * time), hip = -0.8 * u, knee = 1.5 * u + 0.01;
  const bool left = joint.starts_with("Left");
  const double y = left ? 1 : -1;
  if (joint.ends_with("UpLeg")) return about(ey, hip);
  if (joint.ends_with("Leg")) return about(ey, knee);
  if (joint.ends_with("Foot")) return about(ey, -hip - knee);
  // Down to the side first, then forward.
  if (joint.ends_with("Arm") && !joint.ends_with("ForeArm")) return about(ey, -1.3 * u) * about(ex, -1.2 * y);
  if (joint.ends_with("ForeArm")) return about(ez, -y * (0.5 + 0.8 * u));
  if (joint == "Spine1") return about(ey, 0.3 * u);
  return Quat::identity();
}

/// The same motion on a skeleton whose joints' own axes are turned, as exporters that align axes with bones have it.
Clip with_other_axes(const Clip& c) {
  const auto axes = [](int i) {
    core::RandomStream random(11, static_cast<std::uint64_t>(i));
    return core::exp_map(Vec{3 * random.uniform() - 1.5, 3 * random.uniform() - 1.5, 3 * random.uniform() - 1.5});
  };
  Clip out = c;
  out.skeleton = {};
  for (int i = 0; i < c.skeleton.size(); ++i) {
    body::Joint j = c.skeleton[i];
    if (j.parent >= 0) j.offset = axes(j.parent).conjugate().rotate(j.offset);
    out.skeleton.add(j);
  }
  for (int k = 0; k < c.keys(); ++k)
    for (int i = 0; i < c.skeleton.size(); ++i) {
      const body::Joint& j = c.skeleton[i];
      const int at = j.type == body::JointType::free ? 3 : j.q_index;
      if (j.type == body::JointType::fixed) continue;
      const Quat parent = j.parent < 0 ? Quat::identity() : axes(j.parent);
      const bool fixed_parent = j.parent >= 0 && c.skeleton[j.parent].type == body::JointType::fixed;
      REQUIRE(!fixed_parent);
      (parent.conjugate() * Quat::from(c.poses.col(k).data() + at) * axes(i)).store(out.poses.col(k).data() + at);
    }
  return out;
}

double fastest_joint(const Clip& c) {
  double worst = 0;
  Eigen::VectorXd d(c.skeleton.nv());
  for (int k = 1; k < c.keys(); ++k) {
    body::difference(c.skeleton, c.poses.col(k - 1).data(), c.poses.col(k).data(), d.data());
    for (const body::Joint& j : c.skeleton.joints())
      if (j.parent >= 0) worst = std::max(worst, d.segment(j.v_index, body::velocity_size(j.type)).norm() / (c.times[k] - c.times[k - 1]));
  }
  return worst;
}

double lowest_point(const Clip& c) {
  const detail::TargetBody target(humanoid(), find_body_plan(humanoid().skeleton));
  double lowest = 1e9;
  for (int k = 0; k < c.keys(); ++k) lowest = std::min(lowest, -target.depth(frames(c, k)));
  return lowest;
}

std::filesystem::path motions() {
  if (const char* given = std::getenv("TRACEUR_MOTIONS")) return given;
  return std::filesystem::path(TRACEUR_SOURCE_DIR) / "../shared/motions";
}

std::string error_of(const std::function<void()>& f) {
  try {
    f();
  } catch (const Error& e) {
    return e.what();
  }
  return "";
}

}  // namespace

TEST_SUITE("retarget") {
  TEST_CASE("onto itself is the identity when copied") {
    const Clip c = squat();
    RetargetOptions o = in_place();
    const Retargeted r = retarget(c, humanoid(), o);
    CHECK(r.report.direct);
    CHECK(r.report.scale == 1);
    CHECK(std::abs(r.report.ground_offset) < 1e-9);
    CHECK(r.report.direction_error_max < 1e-9);
    CHECK((r.clip.poses - c.poses).cwiseAbs().maxCoeff() < 1e-9);
    CHECK(r.clip.times == c.times);
  }

  TEST_CASE("a copied clip in the air is set on the ground, nothing else") {
    Clip c = squat();
    c.poses.row(2).array() += 0.2;
    const Retargeted r = retarget(c, humanoid(), in_place());
    CHECK(r.report.ground_offset == doctest::Approx(-0.2));
    CHECK((r.clip.poses - squat().poses).cwiseAbs().maxCoeff() < 1e-9);
    RetargetOptions keep = in_place();
    keep.flat_ground = false;
    CHECK((retarget(c, humanoid(), keep).clip.poses - c.poses).cwiseAbs().maxCoeff() < 1e-9);
  }

  TEST_CASE("onto itself is the identity when solved") {
    const Clip c = squat();
    RetargetOptions o = in_place();
    o.direct = false;
    const Retargeted r = retarget(c, humanoid(), o);
    CHECK(!r.report.direct);
    CHECK(r.report.scale == doctest::Approx(1));
    CHECK(std::abs(r.report.ground_offset) < 0.002);
    CHECK(degrees(r.report.direction_error_max) < 1.0);
    CHECK(r.report.contact_share == 1);
    for (int k = 0; k < c.keys(); ++k)
      for (int i = 0; i < c.skeleton.size(); ++i) {
        const auto j = static_cast<std::size_t>(i);
        const body::Frames<double> a = frames(c, k), b = frames(r.clip, k);
        CHECK_MESSAGE(norm(a.position[j] - b.position[j]) < 0.01, c.skeleton[i].body);
        CHECK_MESSAGE(degrees(angle(a.rotation[j], b.rotation[j])) < 2.5, c.skeleton[i].body);
      }
  }

  TEST_CASE("a T-pose source with arms raised forward") {
    // Turned by 90 degrees about the vertical from sideways; the left arm points to +x, the right one too.
    const Clip c = animate(t_pose(), [](const std::string& joint, double) {
      if (joint == "LeftArm") return about(ez, -pi / 2);
      if (joint == "RightArm") return about(ez, pi / 2);
      return Quat::identity();
    }, 1, 31);
    const Retargeted r = retarget(c, humanoid(), in_place());
    CHECK(!r.report.direct);
    CHECK(r.report.scale == doctest::Approx((0.421546 + 0.40987) / 0.98));
    for (const std::string side : {"left", "right"}) {
      const Vec shoulder = place(r.clip, 15, (side + "_upper_arm").c_str());
      const Vec elbow = place(r.clip, 15, (side + "_lower_arm").c_str()), hand = place(r.clip, 15, (side + "_hand").c_str());
      CHECK(norm(elbow - (shoulder + Vec{0.274788, 0, 0})) < 0.01);
      CHECK(norm(hand - (shoulder + Vec{0.274788 + 0.258947, 0, 0})) < 0.02);
      CHECK(place(r.clip, 15, (side + "_foot").c_str()).z == doctest::Approx(0.05).epsilon(0.02));
    }
    for (const char* upright : {"pelvis", "torso", "head", "left_foot", "right_foot", "left_thigh", "right_shin"})
      CHECK_MESSAGE(degrees(angle(turn(r.clip, 15, upright), Quat::identity())) < 2, upright);
    CHECK(r.report.penetration_after < 0.002);
  }

  TEST_CASE("a turned source keeps its facing, and aligning makes it +x") {
    const auto turned = [](const std::string& joint, double time) {
      const Quat r = t_pose_squat(joint, time);
      return joint == "Hips" ? about(ez, 2.0) * r : r;
    };
    const Clip c = animate(t_pose(), turned);
    const Retargeted there = retarget(c, humanoid(), in_place());
    for (const char* part : {"pelvis", "torso", "head", "left_foot", "right_foot"})
      CHECK_MESSAGE(degrees(angle(core::heading(turn(there.clip, 0, part)), about(ez, 2.0))) < 2, part);
    const Retargeted here = retarget(c, humanoid());
    CHECK(std::abs(here.clip.poses(0, 0)) < 1e-12);
    CHECK(std::abs(here.clip.poses(1, 0)) < 1e-12);
    for (const char* part : {"pelvis", "torso", "head", "left_foot", "right_foot"})
      CHECK_MESSAGE(degrees(angle(core::heading(turn(here.clip, 0, part)), Quat::identity())) < 2, part);
  }

  TEST_CASE("bones keep the source's directions, joints their hinges") {
    const Clip c = animate(t_pose(), t_pose_squat);
    const Retargeted r = retarget(c, humanoid(), in_place());
    CHECK(degrees(r.report.direction_error) < 1.5);
    const body::Skeleton& s = c.skeleton;
    const char* bones[][4] = {{"LeftUpLeg", "LeftLeg", "left_thigh", "left_shin"},
                              {"RightLeg", "RightFoot", "right_shin", "right_foot"},
                              {"LeftArm", "LeftForeArm", "left_upper_arm", "left_lower_arm"},
                              {"RightForeArm", "RightHand", "right_lower_arm", "right_hand"}};
    for (const int k : {0, 10, 30, 45})
      for (const auto& b : bones) {
        const Vec from = place(c, k, b[1]) - place(c, k, b[0]), to = place(r.clip, k, b[3]) - place(r.clip, k, b[2]);
        CHECK_MESSAGE(degrees(detail::angle_between(from, to)) < 4, b[2]);
      }
    // The knee's one angle is the angle between the source's bones.
    const Vec thigh = place(c, 30, "LeftLeg") - place(c, 30, "LeftUpLeg"), shin = place(c, 30, "LeftFoot") - place(c, 30, "LeftLeg");
    const int knee = r.clip.skeleton[r.clip.skeleton.find("left_knee")].q_index;
    CHECK(r.clip.poses(knee, 30) == doctest::Approx(detail::angle_between(thigh, shin)).epsilon(0.05));
    CHECK(r.report.limits_clipped == 0);
    CHECK(s.size() > 0);
  }

  TEST_CASE("twist in a ball knee does not bend the hinge") {
    // A leg that twists along the shin, compensated at the foot, looks the same: bones do not move.
    const auto twisted = [](const std::string& joint, double time) {
      const Quat twist = about(ez, 0.4 * std::sin(pi * time));
      const Quat r = t_pose_squat(joint, time);
      if (joint == "LeftLeg") return r * twist;
      if (joint == "LeftFoot") return twist.conjugate() * r;
      return r;
    };
    const Retargeted plain = retarget(animate(t_pose(), t_pose_squat), humanoid(), in_place());
    const Retargeted r = retarget(animate(t_pose(), twisted), humanoid(), in_place());
    for (const int k : {0, 15, 30, 50})
      for (const char* part : {"left_thigh", "left_shin", "left_foot"})
        CHECK_MESSAGE(degrees(angle(turn(plain.clip, k, part), turn(r.clip, k, part))) < 3, part);
  }

  TEST_CASE("the source's own joint axes do not matter") {
    // Only the motion of the root's frame must tell forward and up, which the readers see to; here it does not even do that.
    const Clip c = animate(t_pose(), t_pose_squat);
    const Clip turned = with_other_axes(c);
    const body::Frames<double> a = frames(c, 20), b = frames(turned, 20);
    for (std::size_t i = 0; i < a.position.size(); ++i) REQUIRE(norm(a.position[i] - b.position[i]) < 1e-9);
    const Retargeted plain = retarget(c, humanoid(), in_place()), r = retarget(turned, humanoid(), in_place());
    for (const int k : {0, 15, 30, 60})
      for (const char* part : {"pelvis", "torso", "left_thigh", "right_shin", "left_foot", "right_foot", "left_upper_arm", "right_lower_arm"})
        CHECK_MESSAGE(degrees(angle(turn(plain.clip, k, part), turn(r.clip, k, part))) < 5, part);
    // The head's pitch has no geometry behind it but its mean along the trunk's.
    CHECK(degrees(angle(turn(plain.clip, 0, "head"), turn(r.clip, 0, "head"))) < 15);
  }

  TEST_CASE("a foot that slides a little is planted") {
    Clip c = animate(t_pose(), t_pose_squat);
    for (int k = 0; k < c.keys(); ++k) c.poses(0, k) += 0.02 * std::sin(8 * c.times[k]);
    const Retargeted r = retarget(c, humanoid(), in_place());
    CHECK(r.report.foot_slide_before > 0.1);
    CHECK(r.report.foot_slide_after < 0.01);
    CHECK(r.report.contact_share == 1);
    const int foot = r.clip.skeleton.find_body("left_foot"), head = r.clip.skeleton.find_body("head");
    REQUIRE(r.clip.contacts.cols() == r.clip.keys());
    CHECK(r.clip.contacts.row(foot).minCoeff() == 1);
    CHECK(r.clip.contacts.row(head).maxCoeff() == 0);
    const Vec first = place(r.clip, 0, "left_foot");
    for (int k = 0; k < r.clip.keys(); ++k) CHECK(norm(place(r.clip, k, "left_foot") - first) < 0.003);
  }

  TEST_CASE("a foot that turns on the spot is not held") {
    // One turn a second about the left ankle: heel and toe go round, at first slowly.
    const auto spin = [](const std::string& joint, double time) { return joint == "Hips" ? about(ez, time * time) : Quat::identity(); };
    const Clip c = animate(t_pose(), spin, 2.5, 76);
    const Retargeted r = retarget(c, humanoid(), in_place());
    CHECK(degrees(r.report.direction_error_max) < 12);
    CHECK(degrees(angle(core::heading(turn(r.clip, 75, "left_foot")), about(ez, 6.25))) < 10);
    CHECK(degrees(angle(core::heading(turn(r.clip, 75, "pelvis")), about(ez, 6.25))) < 10);
  }

  TEST_CASE("hands that reach below the ground are lifted out of it") {
    // Bent over so far that, with our proportions, the hands would go through the floor.
    const Clip c = animate(t_pose(), [](const std::string& joint, double time) {
      const double u = 0.5 - 0.5 * std::cos(pi * time);
      const double y = joint.starts_with("Left") ? 1 : -1;
      if (joint == "Hips") return about(ey, 0.9 * u);
      if (joint.ends_with("UpLeg")) return about(ey, -2.4 * u);
      if (joint.ends_with("Leg")) return about(ey, 2.4 * u + 0.01);
      if (joint.ends_with("Foot")) return about(ey, -0.9 * u - 0.01);
      if (joint == "Spine") return about(ey, 0.6 * u);
      if (joint.ends_with("Arm") && !joint.ends_with("ForeArm")) return about(ey, -1.5 * u) * about(ex, -1.5 * y);
      return Quat::identity();
    });
    const Retargeted r = retarget(c, humanoid(), in_place());
    CHECK(r.report.penetration_before > 0.02);
    CHECK(r.report.penetration_after < 0.005);
    CHECK(lowest_point(r.clip) > -0.005);
    CHECK(r.report.foot_slide_after < 0.02);
  }

  TEST_CASE("stairs: with ground that is not flat, feet rest at their own heights") {
    Clip c = animate(t_pose(), t_pose_squat);
    c.poses.row(2).array() += 0.35;
    RetargetOptions o = in_place();
    o.flat_ground = false;
    const Retargeted r = retarget(c, humanoid(), o);
    CHECK(r.report.contact_share == 1);
    CHECK(r.report.foot_slide_after < 0.01);
    const Vec foot = place(r.clip, 0, "left_foot");
    CHECK(foot.z == doctest::Approx(0.35 * r.report.scale + 0.05).epsilon(0.05));
    for (int k = 0; k < r.clip.keys(); ++k) CHECK(norm(place(r.clip, k, "left_foot") - foot) < 0.003);
  }

  TEST_CASE("frame rates, labels and the cyclic flag") {
    Clip c = squat();
    c.cyclic = true;
    CHECK(retarget(c, humanoid()).clip.cyclic);
    CHECK(retarget(c, humanoid()).clip.keys() == 61);
    const Clip slow = resample(c, 16);
    RetargetOptions keep = in_place();
    keep.flat_ground = false;
    const Clip more = retarget(slow, humanoid(), keep).clip;
    CHECK(more.keys() == 2 * (slow.keys() - 1) + 1);
    for (int k = 0; k < slow.keys(); ++k) CHECK((more.poses.col(2 * k) - slow.poses.col(k)).cwiseAbs().maxCoeff() < 1e-9);
    CHECK(retarget(resample(c, 120), humanoid()).clip.keys() == 121);
    Clip uneven = c;
    uneven.times[3] += 0.01;
    const Clip even = retarget(uneven, humanoid()).clip;
    for (int k = 1; k < even.keys(); ++k) CHECK(even.times[k] - even.times[k - 1] == doctest::Approx(1.0 / 30));
  }

  TEST_CASE("faults are named") {
    Clip c = animate(t_pose(), t_pose_squat);
    body::Skeleton other;
    for (const body::Joint& joint : c.skeleton.joints()) {
      body::Joint j = joint;
      if (j.name == "LeftLeg") j.name = j.body = "Knie";
      other.add(j);
    }
    c.skeleton = other;
    const std::string message = error_of([&] { retarget(c, humanoid()); });
    CHECK(message.find("clip 'animated'") == 0);
    CHECK(message.find("left_knee") != std::string::npos);
    CHECK(message.find("Knie") != std::string::npos);
    RetargetOptions o;
    o.joints["left_shin"] = "Knie";
    CHECK(error_of([&] { retarget(c, humanoid(), o); }) == "");

    Clip rooted = squat();
    body::Skeleton fixed;
    for (const body::Joint& joint : rooted.skeleton.joints()) {
      body::Joint j = joint;
      if (j.parent < 0) j.type = body::JointType::fixed;
      fixed.add(j);
    }
    rooted.skeleton = fixed;
    const Eigen::MatrixXd poses = rooted.poses.bottomRows(fixed.nq());
    rooted.poses = poses;
    CHECK(error_of([&] { retarget(rooted, humanoid()); }).find("free root") != std::string::npos);
  }

  TEST_CASE("the solve's derivatives are those of its residuals") {
    const Clip c = squat();
    const detail::TargetBody target(humanoid(), find_body_plan(humanoid().skeleton));
    RetargetWeights weights;
    weights.contact = weights.ground = weights.limit = 0.05;
    detail::KeyGoal goal;
    goal.pelvis = goal.torso = goal.head = about(ex, 0.2);
    for (std::size_t side = 0; side < 2; ++side) {
      goal.foot[side] = goal.twist[side][0] = goal.twist[side][1] = about(ez, 0.3);
      for (Vec& d : goal.direction[side]) d = {0, 0, -1};
      goal.ankle[side] = {0.1, 0.1, 0.1};
    }
    Eigen::VectorXd q = c.poses.col(20);
    q[2] -= 0.07;  // some points below ground
    const int foot = target.plan.left().ankle;
    const detail::KeyCost cost(target, weights, goal, q.data(), {{foot, {0.1, 0, -0.05}, 0}, {foot, {-0.1, 0, -0.05}, 0.02}});
    const int nv = c.skeleton.nv(), rows = cost.num_residuals();
    std::vector<double> d(static_cast<std::size_t>(nv)), anchors{0.1, 0.2, -0.1, 0.3};
    core::RandomStream random(3, 1);
    for (double& v : d) v = 0.1 * random.uniform() - 0.05;
    Eigen::VectorXd r(rows), plus(rows), minus(rows);
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> j0(rows, nv), j1(rows, 2), j2(rows, 2);
    const std::array<const double*, 3> parameters{d.data(), anchors.data(), anchors.data() + 2};
    std::array<double*, 3> jacobians{j0.data(), j1.data(), j2.data()};
    cost.Evaluate(parameters.data(), r.data(), jacobians.data());
    cost.Evaluate(parameters.data(), plus.data(), nullptr);
    CHECK((r - plus).cwiseAbs().maxCoeff() < 1e-12);
    CHECK(r.cwiseAbs().maxCoeff() > 0.5);
    const double h = 1e-6;
    const auto column = [&](double& x) {
      const double x0 = x;
      x = x0 + h;
      cost.Evaluate(parameters.data(), plus.data(), nullptr);
      x = x0 - h;
      cost.Evaluate(parameters.data(), minus.data(), nullptr);
      x = x0;
      return Eigen::VectorXd((plus - minus) / (2 * h));
    };
    for (int i = 0; i < nv; ++i) CHECK((column(d[static_cast<std::size_t>(i)]) - j0.col(i)).cwiseAbs().maxCoeff() < 1e-5);
    for (int i = 0; i < 2; ++i) {
      CHECK((column(anchors[static_cast<std::size_t>(i)]) - j1.col(i)).cwiseAbs().maxCoeff() < 1e-5);
      CHECK((column(anchors[static_cast<std::size_t>(i + 2)]) - j2.col(i)).cwiseAbs().maxCoeff() < 1e-5);
    }
  }

  TEST_CASE("captured clips stand, stay above ground and do not jerk") {
    struct Real {
      const char* file;
      double heading;  // where the feet point on average in the first key, from +x, at most, deg
    };
    for (const Real& real : {Real{"cmu-subject16/16_21_1.bvh", 35}, Real{"cmu-subject16/16_35_1.bvh", 35}, Real{"cmu-subject16/16_55_1.bvh", 35},
                             Real{"cmu-asfamc/02_01.amc", 35}, Real{"snu-ys2010/wd2_long_broad_jump.bvh", 35}}) {
      const std::filesystem::path path = motions() / real.file;
      if (!std::filesystem::exists(path)) {
        MESSAGE("left out, not found: " << path.string());
        continue;
      }
      CAPTURE(std::string(real.file));
      const Clip source = io::load_clip(path).clip;
      const Retargeted r = retarget(source, humanoid());
      MESSAGE(std::string(real.file) << ": " << r.report.text());
      CHECK(!r.report.direct);
      CHECK(r.report.foot_slide_after < 0.05);
      CHECK(r.report.penetration_after < 0.005);
      CHECK(lowest_point(r.clip) > -0.005);
      CHECK(degrees(r.report.direction_error) < 2.5);
      CHECK(r.report.limits_clipped == 0);
      CHECK(r.report.contact_share > 0.5);
      CHECK(fastest_joint(r.clip) < 25);
      CHECK(r.clip.keys() >= 30 * r.clip.duration());
      // Everything faces the way the clip goes.
      const Vec way{r.clip.poses(0, r.clip.keys() - 1), r.clip.poses(1, r.clip.keys() - 1), 0};
      CHECK(std::abs(std::atan2(way.y, way.x)) < 0.5);
      for (const char* part : {"torso", "head", "left_foot", "right_foot"}) {
        Vec mean{0, 0, 0};
        for (int k = 0; k < r.clip.keys(); ++k) mean += core::heading(turn(r.clip, k, part)).rotate(ex);
        CHECK_MESSAGE(degrees(std::abs(std::atan2(mean.y, mean.x))) < real.heading, part);
      }
    }
  }

  TEST_CASE("DeepMimic clips are copied exactly, and can be planted") {
    for (const char* name : {"walk", "run", "backflip", "cartwheel", "roll", "kick"}) {
      const std::filesystem::path path = motions() / "deepmimic" / ("humanoid3d_" + std::string(name) + ".txt");
      if (!std::filesystem::exists(path)) {
        MESSAGE("left out, not found: " << path.string());
        continue;
      }
      CAPTURE(std::string(name));
      const Clip source = io::load_clip(path).clip;
      const Retargeted r = retarget(source, humanoid(), in_place());
      CHECK(r.report.direct);
      CHECK(r.clip.cyclic == source.cyclic);
      CHECK(r.report.direction_error_max < 1e-6);
      CHECK(std::abs(r.report.ground_offset) < 0.1);
      for (const int k : {0, r.clip.keys() / 2, r.clip.keys() - 1}) {
        Eigen::VectorXd at(source.skeleton.nq());
        source.sample_within(r.clip.times[k], at.data());
        const body::Frames<double> a = frames(source.skeleton, at), b = frames(r.clip, k);
        for (std::size_t i = 0; i < a.position.size(); ++i) {
          const Vec p = a.position[static_cast<std::size_t>(source.skeleton.find_body(r.clip.skeleton[static_cast<int>(i)].body))];
          CHECK(norm(p + Vec{0, 0, r.report.ground_offset} - b.position[i]) < 1e-6);
        }
      }
      if (std::string(name) != "walk" && std::string(name) != "run") continue;
      RetargetOptions o;
      o.direct = false;
      const Retargeted planted = retarget(source, humanoid(), o);
      CHECK(planted.report.foot_slide_after < 0.05);
      CHECK(planted.report.penetration_after < 0.005);
      CHECK(degrees(planted.report.direction_error) < 2.5);
    }
  }
}
