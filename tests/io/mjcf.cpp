// SPDX-License-Identifier: MIT
#include <traceur/io/mjcf.hpp>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <numbers>
#include <string>

#include <doctest/doctest.h>

#include <traceur/body/momentum.hpp>

namespace {

using traceur::Error;
using traceur::body::Character;
using traceur::body::JointType;
using traceur::body::Shape;
using traceur::io::parse_mjcf;
using Vector = traceur::core::Vector3<double>;
using Quaternion = traceur::core::Quaternion<double>;

constexpr double pi = std::numbers::pi;
constexpr double degree = pi / 180;

/// A free body "a" with `inside` in it, and `beside` after the worldbody.
Character with(const std::string& inside, const std::string& beside = "") {
  return parse_mjcf(
      "<mujoco><worldbody><body name='a'><freejoint/>" + inside + "</body></worldbody>" + beside + "</mujoco>",
      "test.xml");
}

/// As `with`, and a unit sphere on "a" so that it may move.
Character on_ball(const std::string& inside, const std::string& beside = "") {
  return with("<geom type='sphere' size='0.1'/>" + inside, beside);
}

const std::string grain = "<geom type='sphere' size='0.1'/>";

void check_near(const Vector& a, const Vector& b, double tolerance = 1e-12) {
  CHECK(std::abs(a.x - b.x) <= tolerance);
  CHECK(std::abs(a.y - b.y) <= tolerance);
  CHECK(std::abs(a.z - b.z) <= tolerance);
}

/// Largest difference of the images of two vectors, so that q and -q are the same.
double apart(const Quaternion& a, const Quaternion& b) {
  return std::max(norm(a.rotate(Vector{1, 2, 3}) - b.rotate(Vector{1, 2, 3})),
                  norm(a.rotate(Vector{3, -1, 1}) - b.rotate(Vector{3, -1, 1})));
}

std::string message(const std::string& xml) {
  try {
    parse_mjcf(xml, "test.xml");
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

std::string message_with(const std::string& inside, const std::string& beside = "") {
  return message("<mujoco>\n<worldbody>\n<body name='a'><freejoint/>" + grain + "\n" + inside +
                 "\n</body></worldbody>\n" + beside + "</mujoco>");
}

}  // namespace

TEST_CASE("mjcf: solids have the mass and inertia of the textbook") {
  const Character c = with("<geom name='s' type='sphere' size='0.2' density='500' pos='1 2 3'/>");
  const double mass = 500 * 4.0 / 3.0 * pi * 0.008;
  CHECK(c.inertias[0].mass == doctest::Approx(mass).epsilon(1e-14));
  check_near(c.inertias[0].center, {1, 2, 3});
  CHECK(c.inertias[0].about_center.xx == doctest::Approx(0.4 * mass * 0.04));
  REQUIRE(c.shapes.size() == 1);
  CHECK(c.shapes[0].name == "s");
  CHECK(c.shapes[0].kind == Shape::Kind::sphere);

  // A box of stated mass, turned by a quarter about z: x and y change places.
  const Character b = with("<geom type='box' size='0.1 0.2 0.3' mass='6' euler='0 0 90'/>");
  CHECK(b.inertias[0].about_center.xx == doctest::Approx(2 * (0.01 + 0.09)));
  CHECK(b.inertias[0].about_center.yy == doctest::Approx(2 * (0.04 + 0.09)));
  CHECK(b.inertias[0].about_center.zz == doctest::Approx(2 * (0.01 + 0.04)));

  // Two point-like spheres: a dumbbell.
  const Character d = with("<geom size='0.001' mass='1' pos='1 0 0'/><geom size='0.001' mass='3' pos='-1 0 0'/>");
  check_near(d.inertias[0].center, {-0.5, 0, 0});
  CHECK(d.inertias[0].about_center.yy == doctest::Approx(3.0).epsilon(1e-5));

  // A capsule between two points lies along them.
  const Character k = with("<geom type='capsule' fromto='0 0 0 0 3 4' size='0.1'/>");
  CHECK(k.shapes[0].size.y == doctest::Approx(2.5));
  check_near(k.shapes[0].position, {0, 1.5, 2});
  const Vector along = k.shapes[0].rotation.rotate(Vector{0, 0, 1});
  CHECK(std::abs(dot(along, Vector{0, 0.6, 0.8})) == doctest::Approx(1.0));
}

TEST_CASE("mjcf: explicit inertia is used, ignored or insisted on as the compiler says") {
  const std::string body =
      "<worldbody><body name='a'><freejoint/><inertial pos='0 0 1' mass='2' diaginertia='1 2 3' quat='1 0 0 1'/>"
      "<geom size='0.1' mass='5'/></body></worldbody></mujoco>";
  const Character automatic = parse_mjcf("<mujoco>" + body, "m");
  CHECK(automatic.inertias[0].mass == 2);
  check_near(automatic.inertias[0].center, {0, 0, 1});
  CHECK(automatic.inertias[0].about_center.xx == doctest::Approx(2.0));
  CHECK(automatic.inertias[0].about_center.yy == doctest::Approx(1.0));
  CHECK(parse_mjcf("<mujoco><compiler inertiafromgeom='true'/>" + body, "m").inertias[0].mass == 5);
  CHECK(parse_mjcf("<mujoco><compiler inertiafromgeom='false'/>" + body, "m").inertias[0].mass == 2);
  const Character full = with("<inertial pos='0 0 0' mass='2' fullinertia='3 3 3 0.1 0.2 0.3'/>");
  CHECK(full.inertias[0].about_center.xy == 0.1);
  CHECK(full.inertias[0].about_center.xz == 0.2);
  CHECK(full.inertias[0].about_center.yz == 0.3);
}

TEST_CASE("mjcf: every way to write an orientation") {
  const auto rest = [](const std::string& attributes, const std::string& compiler = "") {
    const Character c =
        parse_mjcf("<mujoco>" + compiler + "<worldbody><body><freejoint/>" + grain + "<body " + attributes +
                       "><joint type='ball'/>" + grain + "</body></body></worldbody></mujoco>",
                   "m");
    return c.skeleton[1].rest;
  };
  const auto about = [](double x, double y, double z, double angle) {
    return traceur::core::about_axis(Vector{x, y, z}, angle);
  };
  CHECK(apart(rest("quat='2 0 0 2'"), about(0, 0, 1, pi / 2)) < 1e-12);
  CHECK(apart(rest("axisangle='0 3 0 30'"), about(0, 1, 0, 30 * degree)) < 1e-12);
  CHECK(apart(rest("axisangle='0 3 0 0.5'", "<compiler angle='radian'/>"), about(0, 1, 0, 0.5)) < 1e-12);
  const Quaternion intrinsic = about(1, 0, 0, 10 * degree) * about(0, 1, 0, 20 * degree) * about(0, 0, 1, 30 * degree);
  CHECK(apart(rest("euler='10 20 30'"), intrinsic) < 1e-12);
  const Quaternion extrinsic = about(0, 0, 1, 30 * degree) * about(0, 1, 0, 20 * degree) * about(1, 0, 0, 10 * degree);
  CHECK(apart(rest("euler='10 20 30'", "<compiler eulerseq='XYZ'/>"), extrinsic) < 1e-12);
  CHECK(apart(rest("xyaxes='0 2 0 -1 5 0'"), about(0, 0, 1, pi / 2)) < 1e-12);
  check_near(rest("zaxis='3 0 4'").rotate(Vector{0, 0, 1}), {0.6, 0, 0.8});
  check_near(rest("zaxis='0 0 -1'").rotate(Vector{0, 0, 1}), {0, 0, -1});
}

TEST_CASE("mjcf: three hinges at one point become a ball") {
  const std::string gains = " stiffness='10' damping='1' armature='0.5' ";
  const Character c = on_ball(
      "<body name='b' pos='0 0 1'>"
      "<joint name='hip_z' axis='0 0 1' range='-1 2'" +
          gains +
          "/>"
          "<joint name='hip_x' axis='-3 0 0' range='-10 20'" +
          gains +
          "/>"
          "<joint name='hip_y' axis='0 1 0'" +
          gains + "/>" + grain + "</body>",
      "<actuator><motor joint='hip_x' gear='-30' ctrlrange='-1 1'/>"
      "<motor joint='hip_y' gear='40' ctrlrange='-0.5 1'/><motor joint='hip_z' gear='10' ctrlrange='-2 "
      "1'/></actuator>");
  REQUIRE(c.skeleton.size() == 2);
  CHECK(c.skeleton[1].name == "hip");
  CHECK(c.skeleton[1].type == JointType::ball);
  const auto& a = c.actuators[1];
  CHECK(a.limited);
  check_near(a.lower, {-20 * degree, -pi, -1 * degree});
  check_near(a.upper, {10 * degree, pi, 2 * degree});
  CHECK(a.stiffness == 10);
  CHECK(a.damping == 1);
  CHECK(a.armature == 0.5);
  CHECK(a.torque_limit == 40);

  // Without a common name the ball takes the body's.
  const Character n =
      on_ball("<body name='b'><joint axis='1 0 0'/><joint axis='0 1 0'/><joint axis='0 0 1'/>" + grain + "</body>");
  CHECK(n.skeleton[1].name == "b");
  CHECK(!n.actuators[1].limited);
  CHECK(std::isinf(n.actuators[1].torque_limit));
}

TEST_CASE("mjcf: other hinges become a chain that moves as written") {
  const Character c = on_ball(
      "<body name='b' pos='1 0 0' euler='0 0 90'>"
      "<joint name='u' axis='0 0 1' pos='0 0 0.1'/><joint name='v' axis='0 2 0' pos='0.3 0 0'/>"
      "<geom size='0.1' pos='0.5 0 0'/><body name='e' pos='1 0 0'>" +
      grain + "</body></body>");
  REQUIRE(c.skeleton.size() == 4);
  CHECK(c.skeleton[1].body == "b:u");
  CHECK(c.skeleton[2].body == "b");
  CHECK(c.inertias[1].mass == 0);
  CHECK(c.skeleton[3].type == JointType::fixed);
  check_near(c.skeleton[2].axis, {0, 1, 0});

  Eigen::VectorXd q = c.skeleton.neutral_pose();
  traceur::body::Frames<double> f(c.skeleton);
  const auto end = [&] {
    traceur::body::forward_kinematics(c.skeleton, q.data(), f);
    return f.position[3];
  };
  // At rest b lies at (1, 0, 0) with its x along y, and e one metre along it.
  check_near(end(), {1, 1, 0});
  // u turns about the vertical through b's origin.
  q[7] = pi / 2;
  check_near(end(), {0, 0, 0});
  // v turns about b's y axis through a point 0.3 along b's x: the remaining 0.7 m point down.
  q[7] = 0;
  q[8] = pi / 2;
  check_near(end(), {1, 0.3, -0.7});
  CHECK(c.total_mass() == doctest::Approx(3 * 1000 * 4.0 / 3.0 * pi * 0.001));
}

TEST_CASE("mjcf: a joint away from its body's origin shifts what the body carries") {
  const Character c = on_ball(
      "<body name='b' pos='0 0 2'><joint type='ball' name='j' pos='0 0 1'/><geom name='g' size='0.1' pos='0 0 1'/>"
      "<body name='e' pos='0 0 5'>" +
      grain + "</body></body>");
  check_near(c.skeleton[1].offset, {0, 0, 3});
  check_near(c.skeleton[2].offset, {0, 0, 4});
  check_near(c.shapes[1].position, {0, 0, 0});
  check_near(c.inertias[1].center, {0, 0, 0});
}

TEST_CASE("mjcf: limits follow angle unit, limited and autolimits") {
  const auto hinge = [](const std::string& attributes, const std::string& compiler) {
    return parse_mjcf("<mujoco>" + compiler + "<worldbody><body><freejoint/>" + grain + "<body><joint name='j' " +
                          attributes + "/>" + grain + "</body></body></worldbody></mujoco>",
                      "m")
        .actuators[1];
  };
  CHECK(hinge("range='-90 180'", "").limited);
  CHECK(hinge("range='-90 180'", "").lower.x == doctest::Approx(-pi / 2));
  CHECK(hinge("range='-90 180'", "").upper.x == doctest::Approx(pi));
  CHECK(hinge("range='-1 2'", "<compiler angle='radian'/>").upper.x == 2);
  CHECK(!hinge("range='-90 180' limited='false'", "").limited);
  CHECK(!hinge("range='-90 180'", "<compiler autolimits='false'/>").limited);
  CHECK(hinge("range='-90 180' limited='true'", "<compiler autolimits='false'/>").limited);
  CHECK(!hinge("", "").limited);
  CHECK(hinge("actuatorfrcrange='-5 4'", "").torque_limit == 5);

  const auto ball = hinge("type='ball' range='0 60'", "");
  CHECK(!ball.limited);
  CHECK(ball.cone == doctest::Approx(pi / 3));
  const auto boxed =
      hinge("type='ball' range='0 60'", "<custom><numeric name='j:range' data='-1 2 -3 4 -5 6'/></custom>");
  CHECK(boxed.limited);
  CHECK(boxed.cone == doctest::Approx(pi / 3));
  check_near(boxed.lower, {-degree, -3 * degree, -5 * degree});
  check_near(boxed.upper, {2 * degree, 4 * degree, 6 * degree});
}

TEST_CASE("mjcf: torque limits and gains from actuators") {
  const auto hinge = [](const std::string& actuator, const std::string& type = "hinge") {
    return on_ball("<body><joint name='j' type='" + type + "' stiffness='2' damping='3'/>" + grain + "</body>",
                   "<actuator>" + actuator + "</actuator>")
        .actuators[1];
  };
  CHECK(hinge("<motor joint='j' gear='-7' ctrlrange='-1 2'/>").torque_limit == 14);
  CHECK(hinge("<motor joint='j' gear='7' ctrlrange='-1 2' forcerange='-0.5 0.5'/>").torque_limit == 3.5);
  CHECK(hinge("<motor joint='j' gear='7' ctrllimited='false' ctrlrange='-1 2'/>").torque_limit ==
        std::numeric_limits<double>::infinity());
  CHECK(hinge("<motor joint='j' ctrlrange='-1 2'/><motor joint='j' ctrlrange='-1 3'/>").torque_limit == 5);
  CHECK(hinge("<general joint='j' gainprm='10' ctrlrange='-1 1'/>").torque_limit == 10);
  CHECK(
      hinge("<motor jointinparent='j' gear='90 0 0' ctrlrange='-1 1'/><motor joint='j' gear='0 80' ctrlrange='-1 1'/>",
            "ball")
          .torque_limit == 90);
  const auto servo = hinge("<position joint='j' gear='2' kp='50' kv='5' ctrlrange='-1 1' forcerange='-8 8'/>");
  CHECK(servo.stiffness == 2 + 4 * 50);
  CHECK(servo.damping == 3 + 4 * 5);
  CHECK(servo.torque_limit == 16);
  const auto affine = hinge("<general joint='j' gainprm='50' biastype='affine' biasprm='0 -50 -5'/>");
  CHECK(affine.stiffness == 52);
  CHECK(affine.damping == 8);
}

TEST_CASE("mjcf: default classes nest, and the nearest childclass counts") {
  const Character c = parse_mjcf(R"(<mujoco model="classes">
    <default>
      <geom size="0.1" density="1"/>
      <motor gear="5" ctrlrange="-1 1"/>
      <default class="heavy">
        <geom density="100"/>
        <joint damping="4"/>
        <default class="heavy box"><geom type="box" size="1 1 1"/></default>
      </default>
      <default class="light"><geom mass="0.25"/></default>
    </default>
    <worldbody>
      <body name="a" childclass="heavy"><freejoint/>
        <geom/>
        <body name="b"><joint name="j"/><geom class="heavy box"/></body>
        <body name="c" childclass="light"><joint/><geom/><geom class="heavy"/></body>
        <body name="d"><joint class="light"/><geom class="main"/></body>
      </body>
    </worldbody>
    <actuator><motor joint="j"/></actuator>
  </mujoco>)",
                                 "m");
  const double ball = 4.0 / 3.0 * pi * 0.001;
  CHECK(c.name == "classes");
  CHECK(c.inertias[0].mass == doctest::Approx(100 * ball));
  CHECK(c.inertias[1].mass == doctest::Approx(800.0));
  CHECK(c.inertias[2].mass == doctest::Approx(0.25 + 100 * ball));
  CHECK(c.inertias[3].mass == doctest::Approx(ball));
  CHECK(c.actuators[1].damping == 4);
  CHECK(c.actuators[2].damping == 0);
  CHECK(c.actuators[3].damping == 0);
  CHECK(c.actuators[1].torque_limit == 5);
}

TEST_CASE("mjcf: roots") {
  const Character fixed =
      parse_mjcf("<mujoco><worldbody><geom type='plane' size='1 1 1'/><light/><body name='a' pos='1 2 3'>" + grain +
                     "</body></worldbody></mujoco>",
                 "m");
  REQUIRE(fixed.skeleton.size() == 1);
  CHECK(fixed.skeleton[0].type == JointType::fixed);
  check_near(fixed.skeleton[0].offset, {1, 2, 3});

  const Character pendulum = parse_mjcf(
      "<mujoco><worldbody><body name='a' pos='1 2 3'><joint axis='0 1 0'/>" + grain + "</body></worldbody></mujoco>",
      "m");
  REQUIRE(pendulum.skeleton.size() == 2);
  CHECK(pendulum.skeleton[0].body == "world");
  CHECK(pendulum.skeleton[1].type == JointType::hinge);
  check_near(pendulum.skeleton[1].offset, {1, 2, 3});
  CHECK(pendulum.skeleton.nq() == 1);

  const Character free = parse_mjcf("<mujoco><worldbody><body name='a' pos='0 0 1'><joint name='base' type='free'/>" +
                                        grain + "</body></worldbody></mujoco>",
                                    "m");
  CHECK(free.skeleton.free_root());
  CHECK(free.skeleton[0].name == "base");
  CHECK(free.skeleton[0].offset.z == 1);
}

TEST_CASE("mjcf: what collides with nothing is weighed and not kept") {
  const Character c = on_ball(
      "<geom size='0.1' contype='0' conaffinity='0'/><geom type='mesh' mesh='m' mass='0' contype='0' conaffinity='0'/>"
      "<site name='s'/><camera/>");
  CHECK(c.shapes.size() == 1);
  CHECK(c.inertias[0].mass == doctest::Approx(2 * 1000 * 4.0 / 3.0 * pi * 0.001));
}

TEST_CASE("mjcf: every fault has a message of one line that names the place") {
  struct Case {
    std::string xml;
    std::string expected;
  };
  const std::string ball_body = "<body name='b'><joint name='j' type='ball'/>" + grain + "</body>";
  const auto inside = [](const std::string& s) { return message_with(s); };
  const auto beside = [&](const std::string& s) { return message_with(ball_body, s); };
  const Case cases[] = {
      {message(""), "test.xml: line 1: not XML"},
      {message("<mujoco>\n<worldbody>\n</mujoco>"), "test.xml: line 3: not XML"},
      {message("<robot/>"), "expected <mujoco>, found <robot>"},
      {message("<mujoco/>"), "expected a body"},
      {inside("<geom name='g' type='cylinder' size='1 1'/>"),
       "test.xml: line 4: geom 'g': type 'cylinder' is not supported"},
      {inside("<geom name='g' type='ellipsoid' size='1 1 1'/>"), "type 'ellipsoid'"},
      {inside("<geom name='g' type='mesh' mesh='m'/>"), "type 'mesh'"},
      {inside("<geom name='g' type='mesh' contype='0' conaffinity='0'/>"), "the mass of type 'mesh'"},
      {inside("<geom name='g'/>"), "geom 'g': expected size"},
      {inside("<geom name='g' size='0'/>"), "size must be positive"},
      {inside("<geom name='g' size='1 x'/>"), "size: expected 1 to 3 numbers, found '1 x'"},
      {inside("<geom name='g' size='nan'/>"), "found 'nan'"},
      {inside("<geom name='g' size='1e11'/>"), "beyond 1e10"},
      {inside("<geom name='g' type='box' size='1 1'/>"), "size: expected 3 numbers, found '1 1'"},
      {inside("<geom name='g' type='capsule' size='1' fromto='0 0 0 0 0 0'/>"),
       "fromto: expected two points that differ"},
      {inside("<geom name='g' size='1' mass='-1'/>"), "must not be negative"},
      {inside("<geom name='g' size='1' shellinertia='true'/>"), "shellinertia"},
      {inside("<geom size='1' class='nowhere'/>"), "no default class 'nowhere'"},
      {inside("<geom size='1' quat='0 0 0 0'/>"), "quat: expected a rotation"},
      {inside("<geom size='1' quat='1 0 0 0' euler='0 0 0'/>"), "both quat and euler"},
      {inside("<geom size='1' zaxis='0 0 0'/>"), "zaxis: expected a direction"},
      {inside("<geom size='1' xyaxes='1 0 0 2 0 0'/>"), "xyaxes: expected two directions that differ"},
      {inside("<inertial pos='0 0 0' diaginertia='1 1 1'/>"), "inertial: expected mass"},
      {inside("<inertial mass='1' diaginertia='1 1 1'/>"), "inertial: expected pos"},
      {inside("<inertial pos='0 0 0' mass='1'/>"), "expected either diaginertia or fullinertia"},
      {inside("<inertial pos='0 0 0' mass='1' fullinertia='1 1 1 2 0 0'/>"), "expected a positive inertia"},
      {inside("<inertial pos='0 0 0' mass='1' fullinertia='1 1 1 0 0 0' euler='1 0 0'/>"), "expected no orientation"},
      {inside(
           "<inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/><inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/>"),
       "a second one"},
      {inside("<body><joint name='j' type='slide'/></body>"), "joint 'j': type 'slide' is not supported"},
      {inside("<body><freejoint name='j'/>" + grain + "</body>"), "joint 'j': a free joint is for the root only"},
      {inside("<joint name='k' type='hinge'/>"), "its body's only joint"},
      {inside("<body><joint name='j' axis='0 0 0'/></body>"), "axis: expected a direction"},
      {inside("<body><joint name='j' ref='5'/></body>"), "ref is not supported"},
      {inside("<body><joint name='j' range='2 1'/></body>"), "lower end above"},
      {inside("<body><joint name='j' type='ball' range='1 2'/></body>"), "expected '0 angle'"},
      {inside("<body><joint name='j' limited='true'/></body>"), "expected range"},
      {inside("<body><joint name='j' limited='yes'/></body>"), "expected true, false or auto"},
      {inside("<body><joint name='j' damping='-1'/></body>"), "must not be negative"},
      {inside("<body><joint name='j'/>" + grain + "</body><body><joint name='j'/>" + grain + "</body>"),
       "a second joint of that name"},
      {inside("<body name='a'>" + grain + "</body>"), "a second body named 'a'"},
      {inside("<body name='z'><joint name='j'/></body>"), "body 'z': has zero mass"},
      {inside("<body><joint name='j_x' axis='1 0 0' damping='1'/><joint name='j_y' axis='0 1 0'/><joint "
              "name='j_z'/></body>"),
       "joint 'j_y': three hinges become one ball joint 'j'"},
      {inside("<body mocap='true'/>"), "mocap"},
      {inside("<composite type='rope'/>"), "composite: is not supported in a body"},
      {inside("<body name='x&#10;y'/>"), "control characters"},
      {inside("<body name='" + std::string(300, 'n') + "'/>"), "more than 256 bytes"},
      {beside("<actuator><motor name='m' joint='nobody'/></actuator>"), "motor 'm': no joint 'nobody'"},
      {beside("<actuator><motor name='m' tendon='t'/></actuator>"), "expected joint"},
      {beside("<actuator><muscle name='m' joint='j'/></actuator>"), "expected motor, general or position"},
      {beside("<actuator><general name='m' joint='j' biastype='affine' gainprm='1'/></actuator>"), "expected a servo"},
      {beside("<actuator><general name='m' joint='j' gaintype='muscle'/></actuator>"), "expected gaintype fixed"},
      {beside("<actuator><position name='m' joint='j' kp='5'/></actuator>"), "on all three axes"},
      {beside("<custom><numeric name='j:range' data='1 0 0 0 0 0'/></custom>"), "numeric 'j:range': data: a range"},
      {beside("<custom><numeric name='j:range' data='1 0'/></custom>"), "expected 6 numbers"},
      {beside("<custom><numeric name='k:range' data='0 0 0 0 0 0'/></custom>"), "no ball joint 'k'"},
      {beside("<compiler coordinate='global'/>"), "only local"},
      {beside("<compiler angle='grad'/>"), "expected degree or radian"},
      {beside("<compiler settotalmass='5'/>"), "settotalmass is not supported"},
      {beside("<compiler eulerseq='xyw'/>"), "expected three of xyzXYZ"},
      {beside("<compiler inertiafromgeom='maybe'/>"), "expected true, false or auto"},
      {beside("<compiler autolimits='1'/>"), "autolimits: expected true or false"},
      {beside("<equality><weld/></equality>"), "equality: constraints"},
      {beside("<include file='x.xml'/>"), "include: is not read"},
      {beside("<default><default><geom/></default></default>"), "default: expected class"},
      {beside("<default><default class='c'/><default class='c'/></default>"), "a second class 'c'"},
      {beside("<worldbody><geom name='step' type='box' size='1 1 1'/></worldbody>"), "is terrain"},
      {beside("<worldbody><frame/></worldbody>"), "not supported in worldbody"},
      {beside("<worldbody><body/></worldbody>"), "expected one character"},
  };
  for (const Case& c : cases) {
    CAPTURE(c.expected);
    CAPTURE(c.xml);
    CHECK(c.xml.find(c.expected) != std::string::npos);
    CHECK(c.xml.find('\n') == std::string::npos);
    CHECK(c.xml.rfind("test.xml", 0) == 0);
  }
}

TEST_CASE("mjcf: hostile sizes are refused") {
  std::string deep;
  for (int i = 0; i < 100000; ++i) deep += "<body>";
  std::string closing;
  for (int i = 0; i < 100000; ++i) closing += "</body>";
  CHECK(message_with(deep + closing).find("nested more than 64 deep") != std::string::npos);
  std::string wide;
  for (int i = 0; i < 1100; ++i) wide += "<body/>";
  CHECK(message_with(wide).find("more than 1024 bodies") != std::string::npos);
  CHECK(message(std::string((16u << 20) + 1, ' ')).find("at most 16 MiB") != std::string::npos);
  std::string classes;
  for (int i = 0; i < 1100; ++i) classes += "<default class='c" + std::to_string(i) + "'/>";
  CHECK(message("<mujoco><default>" + classes + "</default></mujoco>").find("more than 1024 classes") !=
        std::string::npos);
}

TEST_CASE("mjcf: a file that is not there") {
  CHECK_THROWS_AS(traceur::io::read_mjcf("/no/such/file.xml"), Error);
  CHECK_THROWS_AS(traceur::io::read_mjcf(std::filesystem::temp_directory_path()), Error);
}

TEST_CASE("mjcf: the humanoid is the one its description states") {
  const Character c = traceur::io::read_mjcf(TRACEUR_SOURCE_DIR "/examples/characters/humanoid.xml");
  REQUIRE(c.skeleton.size() == 15);
  CHECK(c.skeleton.nq() == 43);
  CHECK(c.skeleton.nv() == 34);
  CHECK(c.total_mass() == doctest::Approx(50.05).epsilon(1e-3));
  const int hand = c.skeleton.find_body("right_hand");
  REQUIRE(hand >= 0);
  CHECK(c.skeleton[hand].type == JointType::fixed);

  traceur::body::Frames<double> f(c.skeleton);
  Eigen::VectorXd q = c.skeleton.neutral_pose();
  q[2] = 0.882416;
  traceur::body::forward_kinematics(c.skeleton, q.data(), f);
  const auto at = [&](const char* body) { return f.position[static_cast<std::size_t>(c.skeleton.find_body(body))]; };
  CHECK(at("right_hand").z == doctest::Approx(0.882416 + 0.236151 + 0.2435 - 0.274788 - 0.258947));
  CHECK(at("right_hand").y == doctest::Approx(-0.18311));
  double lowest = 1;
  for (const Shape& s : c.shapes)
    if (s.kind == Shape::Kind::box) lowest = std::min(lowest, f.point(s.body, s.position).z - s.size.z);
  CHECK(std::abs(lowest) < 0.002);

  // Left and right mirror each other, and a bent elbow brings the hand forward, a bent knee the foot back.
  for (const char* side : {"right_", "left_"}) {
    const std::string s = side;
    q[c.skeleton[c.skeleton.find(s + "elbow")].q_index] = pi / 2;
    q[c.skeleton[c.skeleton.find(s + "knee")].q_index] = pi / 2;
  }
  traceur::body::forward_kinematics(c.skeleton, q.data(), f);
  CHECK(at("right_hand").x == doctest::Approx(-0.02405 + 0.258947));
  CHECK(at("right_foot").x == doctest::Approx(-0.40987));
  for (const char* body : {"upper_arm", "lower_arm", "hand", "thigh", "shin", "foot"}) {
    const std::string b = body;
    const Vector right = at(("right_" + b).c_str()), left = at(("left_" + b).c_str());
    check_near(left, {right.x, -right.y, right.z});
  }
  for (const char* joint : {"shoulder", "hip", "ankle"}) {
    const auto& right = c.actuators[static_cast<std::size_t>(c.skeleton.find(std::string("right_") + joint))];
    const auto& left = c.actuators[static_cast<std::size_t>(c.skeleton.find(std::string("left_") + joint))];
    CHECK(right.limited);
    check_near(left.lower, {-right.upper.x, right.lower.y, -right.upper.z});
    check_near(left.upper, {-right.lower.x, right.upper.y, -right.lower.z});
    CHECK(left.torque_limit == right.torque_limit);
  }
  CHECK(c.actuators[static_cast<std::size_t>(c.skeleton.find("left_elbow"))].torque_limit == 60);
}
