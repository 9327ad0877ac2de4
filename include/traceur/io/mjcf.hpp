// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <numbers>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "traceur/body/character.hpp"
#include "traceur/io/detail/mjcf_document.hpp"

namespace traceur::io {

namespace detail {

/// Turns the elements of one MJCF file into a character.
class MjcfReader {
public:
  MjcfReader(std::string_view text, const std::string& name) : xml_(text, name) {}

  body::Character read() {
    const pugi::xml_node root = xml_.root();
    out_.name = root.attribute("model") ? MjcfDocument::printable(root.attribute("model").value()) : xml_.name();
    std::vector<pugi::xml_node> bodies;
    for (const pugi::xml_node section : root.children()) {
      const std::string_view tag = section.name();
      if (tag == "include") xml_.fail(section, "is not read; give one file");
      if (tag == "equality" && section.first_child()) xml_.fail(section, "constraints are not supported");
      if (tag == "compiler") read_compiler(section);
    }
    for (const pugi::xml_node section : root.children("actuator"))
      for (const pugi::xml_node node : section.children()) read_actuator(node);
    for (const pugi::xml_node section : root.children("custom"))
      for (const pugi::xml_node node : section.children("numeric")) read_numeric(node);
    for (const pugi::xml_node section : root.children("worldbody")) {
      for (const pugi::xml_node node : section.children()) {
        const std::string_view tag = node.name();
        if (tag == "body") {
          bodies.push_back(node);
        } else if (tag == "geom") {
          const MjcfElement e{node, xml_.class_of(node, 0)};
          if (xml_.word(e, "type", "sphere") != "plane" && collides(e))
            xml_.fail(node, "a fixed shape other than a plane is terrain, not part of a character");
        } else if (!decoration(tag)) {
          xml_.fail(node, "is not supported in worldbody");
        }
      }
    }
    read_tree(root, bodies);
    for (const auto& [joint, drives] : drives_)
      if (joints_.count(joint) == 0) xml_.fail(drives.front().node, "no joint '" + joint + "'");
    for (const auto& [joint, range] : ranges_)
      if (balls_.count(joint) == 0) xml_.fail(range.node, "no ball joint '" + joint + "'");
    body::check_character(out_, xml_.name());
    return std::move(out_);
  }

private:
  using Vector = core::Vector3<double>;
  using Quaternion = core::Quaternion<double>;
  static constexpr int max_bodies = 1024;
  static constexpr std::size_t max_shapes = 16384;

  /// What one actuator does to its joint: force limit and gains per unit of gear.
  struct Drive {
    pugi::xml_node node;
    std::array<double, 3> gear;
    double force;
    double stiffness;
    double damping;
  };

  /// One joint as written, before three hinges become a ball.
  struct Stop {
    pugi::xml_node node;
    std::string name;
    body::JointType type;
    Vector position;
    Vector axis;
    body::Actuator actuator;
  };

  struct Range {
    pugi::xml_node node;
    std::array<double, 6> values;
  };

  void read_compiler(pugi::xml_node node) {
    const MjcfElement e{node, 0};
    const std::string_view angle = xml_.word(e, "angle", degrees_ ? "degree" : "radian");
    if (angle != "degree" && angle != "radian") xml_.fail(node, "angle: expected degree or radian");
    degrees_ = angle == "degree";
    if (xml_.word(e, "coordinate", "local") != "local") xml_.fail(node, "coordinate: only local is supported");
    autolimits_ = xml_.flag(e, "autolimits", autolimits_);
    const std::string_view from = xml_.word(e, "inertiafromgeom", "");
    if (from == "true" || from == "false" || from == "auto")
      inertia_from_geoms_ = from;
    else if (!from.empty())
      xml_.fail(node, "inertiafromgeom: expected true, false or auto");
    const std::string_view sequence = xml_.word(e, "eulerseq", euler_sequence_);
    if (sequence.size() != 3 || sequence.find_first_not_of("xyzXYZ") != std::string_view::npos)
      xml_.fail(node, "eulerseq: expected three of xyzXYZ");
    euler_sequence_ = sequence;
    for (const char* attribute : {"settotalmass", "boundmass", "boundinertia"})
      if (xml_.number(e, attribute, 0) > 0) xml_.fail(node, std::string(attribute) + " is not supported");
    if (xml_.flag(e, "balanceinertia", false)) xml_.fail(node, "balanceinertia is not supported");
    if (node.attribute("inertiagrouprange")) xml_.fail(node, "inertiagrouprange is not supported");
  }

  /// Whether the limit that `range` describes holds.
  bool limited(const MjcfElement& e, const char* attribute, const char* range) const {
    const std::string_view word = xml_.word(e, attribute, "auto");
    if (word == "auto") return autolimits_ && xml_.value(e, range) != nullptr;
    if (word != "true" && word != "false") xml_.fail(e.node, std::string(attribute) + ": expected true, false or auto");
    if (word == "true" && !xml_.value(e, range)) xml_.fail(e.node, std::string("expected ") + range);
    return word == "true";
  }

  /// The larger magnitude of a range that holds, infinity otherwise.
  double bound(const MjcfElement& e, const char* attribute, const char* range) const {
    if (!limited(e, attribute, range)) return std::numeric_limits<double>::infinity();
    double r[2];
    xml_.numbers(e, range, r, 2, 2);
    return std::max(std::abs(r[0]), std::abs(r[1]));
  }

  void read_actuator(pugi::xml_node node) {
    const MjcfElement e{node, xml_.class_of(node, 0)};
    const std::string_view tag = node.name();
    if (tag != "motor" && tag != "general" && tag != "position") xml_.fail(node, "expected motor, general or position");
    std::string joint = node.attribute("joint").value();
    if (joint.empty()) joint = node.attribute("jointinparent").value();
    if (joint.empty()) xml_.fail(node, "expected joint; no other transmission is supported");
    if (MjcfDocument::printable(joint) != joint) xml_.fail(node, "a joint name with control characters");
    Drive drive{node, {1, 0, 0}, bound(e, "forcelimited", "forcerange"), 0, 0};
    double gear[6] = {1, 0, 0, 0, 0, 0};
    const int given = xml_.numbers(e, "gear", gear, 1, 6);
    for (int i = 0; i < 3; ++i) drive.gear[static_cast<std::size_t>(i)] = i < std::max(given, 1) ? gear[i] : 0;
    double gain = 1;
    if (tag == "position") {
      gain = 0;
      drive.stiffness = xml_.number(e, "kp", 1);
      drive.damping = xml_.number(e, "kv", 0);
      if (xml_.value(e, "dampratio")) xml_.fail(node, "dampratio is not supported");
    } else if (tag == "general") {
      double gains[10] = {1}, bias[10] = {0};
      xml_.numbers(e, "gainprm", gains, 1, 10);
      xml_.numbers(e, "biasprm", bias, 1, 10);
      const std::string_view kind = xml_.word(e, "biastype", "none");
      if (xml_.word(e, "gaintype", "fixed") != "fixed" || (kind != "none" && kind != "affine"))
        xml_.fail(node, "expected gaintype fixed and biastype none or affine");
      gain = gains[0];
      if (kind == "affine") {
        if (bias[0] != 0 || std::abs(bias[1] + gain) > 1e-9 * std::abs(gain))
          xml_.fail(node, "expected a servo: biasprm '0 -kp -kv' with kp the gain");
        drive.stiffness = gain;
        drive.damping = -bias[2];
        gain = 0;
      }
    }
    // A servo's control is a position and says nothing about its force.
    if (gain != 0) drive.force = std::min(drive.force, std::abs(gain) * bound(e, "ctrllimited", "ctrlrange"));
    drives_[joint].push_back(drive);
  }

  void read_numeric(pugi::xml_node node) {
    const std::string name = xml_.name_of(node);
    constexpr std::string_view suffix = ":range";
    if (name.size() <= suffix.size() || name.substr(name.size() - suffix.size()) != suffix) return;
    Range range{node, {}};
    xml_.numbers({node, 0}, "data", range.values.data(), 6, 6);
    if (!node.attribute("data")) xml_.fail(node, "expected data");
    for (double& v : range.values) v *= radians();
    for (std::size_t i = 0; i < 6; i += 2)
      if (!(range.values[i] <= range.values[i + 1]))
        xml_.fail(node, "data: a range has its lower end above its upper end");
    ranges_[name.substr(0, name.size() - suffix.size())] = range;
  }

  double radians() const { return degrees_ ? std::numbers::pi / 180 : 1; }

  static bool decoration(std::string_view tag) {
    return tag == "site" || tag == "camera" || tag == "light" || tag.empty();
  }

  bool collides(const MjcfElement& e) const {
    return xml_.number(e, "contype", 1) != 0 || xml_.number(e, "conaffinity", 1) != 0;
  }

  /// The shortest rotation that takes the z axis to `v`.
  static Quaternion from_z(const Vector& v) {
    const double length = norm(v);
    const Vector d = (1 / length) * v;
    if (d.z < -1 + 1e-12) return {1, 0, 0, 0};
    return Quaternion{-d.y, d.x, 0, 1 + d.z}.normalized();
  }

  Quaternion orientation(const MjcfElement& e) const {
    constexpr std::array<const char*, 5> names = {"quat", "axisangle", "xyaxes", "zaxis", "euler"};
    const char* which = nullptr;
    for (const char* name : names)
      if (e.node.attribute(name)) {
        if (which) xml_.fail(e.node, std::string("both ") + which + " and " + name);
        which = name;
      }
    for (const char* name : names)
      if (!which && xml_.value(e, name)) which = name;
    if (!which) return Quaternion::identity();
    const auto unit = [&](const double* v) {
      const Vector d = Vector::from(v);
      if (!(norm(d) > 1e-10)) xml_.fail(e.node, std::string(which) + ": expected a direction, found zero");
      return (1 / norm(d)) * d;
    };
    const std::string_view kind = which;
    double v[6];
    if (kind == "quat") {
      xml_.numbers(e, which, v, 4, 4);
      const Quaternion q{v[1], v[2], v[3], v[0]};
      if (!(dot(q, q) > 1e-20)) xml_.fail(e.node, "quat: expected a rotation, found zero");
      return q.normalized();
    }
    if (kind == "axisangle") {
      xml_.numbers(e, which, v, 4, 4);
      return core::about_axis(unit(v), v[3] * radians());
    }
    if (kind == "zaxis") {
      xml_.numbers(e, which, v, 3, 3);
      return from_z(unit(v));
    }
    if (kind == "xyaxes") {
      xml_.numbers(e, which, v, 6, 6);
      const Vector x = unit(v);
      Vector y = unit(v + 3);
      y = y - dot(x, y) * x;
      if (!(norm(y) > 1e-10)) xml_.fail(e.node, "xyaxes: expected two directions that differ");
      y = (1 / norm(y)) * y;
      Eigen::Matrix3d m;
      m << x.eigen(), y.eigen(), cross(x, y).eigen();
      return Quaternion::from(Eigen::Quaterniond(m)).normalized();
    }
    xml_.numbers(e, which, v, 3, 3);
    Quaternion q = Quaternion::identity();
    for (std::size_t i = 0; i < 3; ++i) {
      const char axis = euler_sequence_[i];
      const bool moving = axis >= 'x';
      const int k = moving ? axis - 'x' : axis - 'X';
      const Quaternion turn =
          core::about_axis(Vector{k == 0 ? 1.0 : 0.0, k == 1 ? 1.0 : 0.0, k == 2 ? 1.0 : 0.0}, v[i] * radians());
      q = moving ? q * turn : turn * q;
    }
    return q;
  }

  /// Adds the geom to the body's shapes and returns what it weighs.
  body::Inertia read_geom(const MjcfElement& e, int index, const Vector& shift, bool weighed) {
    const std::string_view type = xml_.word(e, "type", "sphere");
    const bool solid = collides(e);
    const bool known = type == "sphere" || type == "capsule" || type == "box";
    const bool has_mass = xml_.value(e, "mass") != nullptr;
    const double mass = xml_.number(e, "mass", 0), density = xml_.number(e, "density", 1000);
    if (mass < 0 || density < 0) xml_.fail(e.node, "mass and density must not be negative");
    if (xml_.flag(e, "shellinertia", false)) xml_.fail(e.node, "shellinertia is not supported");
    if (!known) {
      if (solid)
        xml_.fail(e.node,
                  "type '" + MjcfDocument::printable(type) + "' is not supported; expected sphere, capsule or box");
      if (weighed && (has_mass ? mass : density) > 0)
        xml_.fail(e.node, "the mass of type '" + MjcfDocument::printable(type) +
                              "' is not computed; expected mass 0 or <inertial>");
      return {};
    }
    body::Shape shape;
    shape.name = xml_.name_of(e.node);
    if (shape.name.empty()) shape.name = out_.skeleton[index].body;
    shape.body = index;
    shape.kind = type == "sphere"    ? body::Shape::Kind::sphere
                 : type == "capsule" ? body::Shape::Kind::capsule
                                     : body::Shape::Kind::box;
    double ends[6];
    const bool spanned = xml_.numbers(e, "fromto", ends, 6, 6) > 0 && type != "sphere";
    const int wanted = type == "sphere" || spanned ? 1 : type == "capsule" ? 2 : 3;
    double size[3] = {0, 0, 0};
    if (xml_.numbers(e, "size", size, wanted, 3) == 0) xml_.fail(e.node, "expected size");
    if (spanned) {
      const Vector from = Vector::from(ends), to = Vector::from(ends + 3);
      if (!(norm(to - from) > 1e-10)) xml_.fail(e.node, "fromto: expected two points that differ");
      shape.position = 0.5 * (from + to);
      shape.rotation = from_z(from - to);
      size[type == "capsule" ? 1 : 2] = 0.5 * norm(to - from);
      if (type == "box") size[1] = size[0];
    } else {
      shape.position = xml_.vector(e, "pos", {0, 0, 0});
      shape.rotation = orientation(e);
    }
    shape.position = shape.position - shift;
    shape.size = {size[0], type == "sphere" ? 0 : size[1], type == "box" ? size[2] : 0};
    for (int i = 0; i < (type == "sphere" ? 1 : type == "capsule" ? 2 : 3); ++i)
      if (!(size[i] > 0)) xml_.fail(e.node, "size must be positive");
    double filled = density;
    if (has_mass) filled = mass / body::solid(shape, 1).mass;
    const body::Inertia own = body::transformed(body::solid(shape, filled), shape.position, shape.rotation);
    if (solid) {
      if (out_.shapes.size() == max_shapes) xml_.fail(e.node, "more than " + std::to_string(max_shapes) + " shapes");
      out_.shapes.push_back(std::move(shape));
    }
    return own;
  }

  body::Inertia read_inertial(pugi::xml_node node, const Vector& shift) const {
    const MjcfElement e{node, 0};
    for (const char* attribute : {"pos", "mass"})
      if (!node.attribute(attribute)) xml_.fail(node, std::string("expected ") + attribute);
    body::Inertia in;
    in.mass = xml_.number(e, "mass", 0);
    if (in.mass < 0) xml_.fail(node, "mass must not be negative");
    double m[6] = {0, 0, 0, 0, 0, 0};
    const bool full = xml_.numbers(e, "fullinertia", m, 6, 6) > 0;
    const bool diagonal = xml_.numbers(e, "diaginertia", m, 3, 3) > 0;
    if (full == diagonal) xml_.fail(node, "expected either diaginertia or fullinertia");
    const Quaternion turn = orientation(e);
    if (full && turn.w != 1) xml_.fail(node, "fullinertia is in the body's axes; expected no orientation");
    in.about_center = {m[0], m[1], m[2], m[3], m[4], m[5]};
    const core::Symmetric3<double>& s = in.about_center;
    const double minor = s.xx * s.yy - s.xy * s.xy;
    const double determinant = minor * s.zz - s.xx * s.yz * s.yz + 2 * s.xy * s.yz * s.xz - s.yy * s.xz * s.xz;
    if (!(s.xx >= 0 && s.yy >= 0 && s.zz >= 0) || (full && !(s.xx > 0 && minor > 0 && determinant > 0)))
      xml_.fail(node, "expected a positive inertia");
    return body::transformed(in, xml_.vector(e, "pos", {0, 0, 0}) - shift, turn);
  }

  static bool agree(double a, double b) { return std::abs(a - b) <= 1e-9 * std::max({1.0, std::abs(a), std::abs(b)}); }

  Stop read_joint(pugi::xml_node node, int inherited) {
    const MjcfElement e{node, xml_.class_of(node, inherited)};
    const std::string_view type = std::string_view(node.name()) == "freejoint" ? "free" : xml_.word(e, "type", "hinge");
    Stop joint{node, xml_.name_of(node), body::JointType::free, {0, 0, 0}, {0, 0, 1}, {}};
    if (!joint.name.empty() && !joints_.insert(joint.name).second) xml_.fail(node, "a second joint of that name");
    if (type == "free") return joint;
    if (type == "ball")
      joint.type = body::JointType::ball;
    else if (type == "hinge")
      joint.type = body::JointType::hinge;
    else
      xml_.fail(node, "type '" + MjcfDocument::printable(type) + "' is not supported; expected free, ball or hinge");
    const bool ball = joint.type == body::JointType::ball;
    if (ball && !joint.name.empty()) balls_.insert(joint.name);
    joint.position = xml_.vector(e, "pos", {0, 0, 0});
    body::Actuator& a = joint.actuator;
    a.armature = xml_.number(e, "armature", 0);
    std::array<double, 3> stiffness{}, damping{}, torque{};
    stiffness.fill(xml_.number(e, "stiffness", 0));
    damping.fill(xml_.number(e, "damping", 0));
    if (!ball) {
      const Vector axis = xml_.vector(e, "axis", {0, 0, 1});
      if (!(norm(axis) > 1e-10)) xml_.fail(node, "axis: expected a direction, found zero");
      joint.axis = (1 / norm(axis)) * axis;
      if (xml_.number(e, "ref", 0) != 0) xml_.fail(node, "ref is not supported");
    }
    if (limited(e, "limited", "range")) {
      double r[2];
      xml_.numbers(e, "range", r, 2, 2);
      if (!(r[0] <= r[1])) xml_.fail(node, "range has its lower end above its upper end");
      if (ball && r[0] != 0) xml_.fail(node, "range of a ball joint: expected '0 angle'");
      a.limited = !ball;
      if (ball)
        a.cone = r[1] * radians();
      else
        a.lower.x = r[0] * radians(), a.upper.x = r[1] * radians();
    }
    const auto range = ball ? ranges_.find(joint.name) : ranges_.end();
    if (range != ranges_.end()) {
      const std::array<double, 6>& v = range->second.values;
      a.limited = true;
      a.lower = {v[0], v[2], v[4]};
      a.upper = {v[1], v[3], v[5]};
    }
    const auto drives = drives_.find(joint.name);
    if (drives != drives_.end()) {
      for (const Drive& d : drives->second)
        for (std::size_t k = 0; k < (ball ? 3u : 1u); ++k) {
          if (d.gear[k] == 0) continue;
          torque[k] += std::abs(d.gear[k]) * d.force;
          stiffness[k] += d.gear[k] * d.gear[k] * d.stiffness;
          damping[k] += d.gear[k] * d.gear[k] * d.damping;
        }
      a.torque_limit = std::max({torque[0], torque[1], torque[2]});
      if (ball)
        for (std::size_t k = 1; k < 3; ++k)
          if (!agree(stiffness[0], stiffness[k]) || !agree(damping[0], damping[k]))
            xml_.fail(node, "expected servos of the same gains on all three axes");
    }
    a.torque_limit = std::min(a.torque_limit, bound(e, "actuatorfrclimited", "actuatorfrcrange"));
    a.stiffness = stiffness[0];
    a.damping = damping[0];
    if (!(a.stiffness >= 0 && a.damping >= 0 && a.armature >= 0))
      xml_.fail(node, "stiffness, damping and armature must not be negative");
    return joint;
  }

  /// The body axis (0, 1, 2) that a hinge turns about, or -1.
  static int along(const Vector& axis) {
    constexpr double close = 1 - 1e-9;
    return std::abs(axis.x) > close ? 0 : std::abs(axis.y) > close ? 1 : std::abs(axis.z) > close ? 2 : -1;
  }

  static bool fusible(const std::vector<Stop>& joints) {
    if (joints.size() != 3) return false;
    int seen = 0;
    for (const Stop& j : joints) {
      const int k = along(j.axis);
      if (k < 0 || !(norm(j.position - joints[0].position) < 1e-9)) return false;
      seen |= 1 << k;
    }
    return seen == 7;
  }

  Stop fused(const std::vector<Stop>& joints, const std::string& body) {
    Stop ball = joints[0];
    ball.type = body::JointType::ball;
    std::string prefix = joints[0].name;
    for (const Stop& j : joints) {
      std::size_t same = 0;
      while (same < prefix.size() && same < j.name.size() && prefix[same] == j.name[same]) ++same;
      prefix.resize(same);
    }
    while (!prefix.empty() && std::string_view("_-. :").find(prefix.back()) != std::string_view::npos)
      prefix.pop_back();
    ball.name = prefix.empty() ? body : prefix;
    body::Actuator& a = ball.actuator;
    std::array<double, 3> lower{}, upper{};
    a.limited = false;
    for (const Stop& j : joints) {
      const auto k = static_cast<std::size_t>(along(j.axis));
      const double sign = j.axis.x + j.axis.y + j.axis.z > 0 ? 1 : -1;
      const body::Actuator& h = j.actuator;
      a.limited = a.limited || h.limited;
      // No rotation vector is longer than half a turn, so this is no limit.
      const double low = h.limited ? h.lower.x : -std::numbers::pi, high = h.limited ? h.upper.x : std::numbers::pi;
      lower[k] = sign > 0 ? low : -high;
      upper[k] = sign > 0 ? high : -low;
      a.torque_limit = std::max(a.torque_limit, h.torque_limit);
      if (!agree(a.stiffness, h.stiffness) || !agree(a.damping, h.damping) || !agree(a.armature, h.armature))
        xml_.fail(j.node, "three hinges become one ball joint '" + ball.name +
                              "'; expected them to agree in stiffness, damping and armature");
    }
    a.lower = Vector::from(lower.data());
    a.upper = Vector::from(upper.data());
    return ball;
  }

  int append(const std::string& name, const std::string& body, int parent, const Stop* stop, const Vector& offset,
             const Quaternion& rest, pugi::xml_node node) {
    if (out_.skeleton.size() == max_bodies)
      xml_.fail(node, "more than " + std::to_string(max_bodies) + " bodies and joints");
    body::Joint joint;
    joint.name = name;
    joint.body = body;
    joint.parent = parent;
    joint.type = stop ? stop->type : body::JointType::fixed;
    joint.offset = offset;
    joint.rest = rest;
    if (joint.type == body::JointType::hinge) joint.axis = stop->axis;
    int index = -1;
    try {
      index = out_.skeleton.add(std::move(joint));
    } catch (const Error& error) {
      xml_.fail(node, error.what());
    }
    out_.inertias.emplace_back();
    out_.actuators.push_back(stop ? stop->actuator : body::Actuator{});
    return index;
  }

  void read_tree(pugi::xml_node root, const std::vector<pugi::xml_node>& bodies) {
    if (bodies.empty()) xml_.fail(root, "expected a body in worldbody");
    bool free = false, jointed = false;
    for (const pugi::xml_node b : bodies) {
      const int inherited = xml_.class_of(b, 0, "childclass");
      for (const pugi::xml_node n : b.children("joint")) {
        const bool is_free = xml_.word({n, xml_.class_of(n, inherited)}, "type", "hinge") == "free";
        free = free || is_free;
        jointed = jointed || !is_free;
      }
      free = free || b.child("freejoint");
    }
    if (free && bodies.size() > 1) xml_.fail(bodies[1], "expected one character; a free body stands beside another");
    int parent = -1;
    if (jointed || bodies.size() > 1)
      parent = append("world", "world", -1, nullptr, {0, 0, 0}, Quaternion::identity(), root);
    for (const pugi::xml_node b : bodies) read_body(b, parent, {0, 0, 0}, 0, 0);
  }

  /// `parent_shift` is the parent's joint seen from the frame that the file gives the parent.
  void read_body(pugi::xml_node node, int parent, const Vector& parent_shift, int inherited, int depth) {
    if (depth > MjcfDocument::max_depth)
      xml_.fail(node, "nested more than " + std::to_string(MjcfDocument::max_depth) + " deep");
    inherited = xml_.class_of(node, inherited, "childclass");
    const MjcfElement e{node, 0};
    if (xml_.flag(e, "mocap", false)) xml_.fail(node, "mocap is not supported");
    std::string name = xml_.name_of(node);
    if (name.empty()) name = "body" + std::to_string(++unnamed_);
    std::vector<Stop> joints;
    for (const pugi::xml_node child : node.children()) {
      const std::string_view tag = child.name();
      if (tag == "joint" || tag == "freejoint")
        joints.push_back(read_joint(child, inherited));
      else if (tag != "geom" && tag != "body" && tag != "inertial" && !decoration(tag))
        xml_.fail(child, "is not supported in a body");
    }
    for (std::size_t i = 0; i < joints.size(); ++i) {
      if (joints.size() > 1 && joints[i].type != body::JointType::hinge)
        xml_.fail(joints[i].node, "a free or ball joint is its body's only joint");
      if (joints[i].type == body::JointType::free && parent >= 0)
        xml_.fail(joints[i].node, "a free joint is for the root only");
      if (joints[i].name.empty())
        joints[i].name = joints[i].type == body::JointType::free ? "root"
                         : joints.size() > 1                     ? name + ":" + std::to_string(i)
                                                                 : name;
    }
    if (fusible(joints)) {
      joints = {fused(joints, name)};
      if (!joints_.insert(joints[0].name).second && joints[0].name != name) joints[0].name = name;
    }

    Vector shift{0, 0, 0};
    const Vector place = xml_.vector(e, "pos", {0, 0, 0});
    const Quaternion turn = orientation(e);
    int index = parent;
    if (joints.empty()) {
      index = append(name, name, parent, nullptr, place - parent_shift, turn, node);
    } else if (joints[0].type == body::JointType::free) {
      // A free joint's pose is in the world, so the rotation at which the file draws the body is not part of it.
      index = append(joints[0].name, name, parent, &joints[0], place, Quaternion::identity(), joints[0].node);
    } else {
      for (std::size_t i = 0; i < joints.size(); ++i) {
        const bool first = i == 0, last = i + 1 == joints.size();
        const Vector offset =
            first ? place + turn.rotate(joints[i].position) - parent_shift : joints[i].position - shift;
        shift = joints[i].position;
        index = append(joints[i].name, last ? name : name + ":" + joints[i].name, index, &joints[i], offset,
                       first ? turn : Quaternion::identity(), joints[i].node);
      }
    }

    bool given = false;
    body::Inertia stated, summed;
    for (const pugi::xml_node child : node.children("inertial")) {
      if (given) xml_.fail(child, "a second one in its body");
      given = true;
      stated = read_inertial(child, shift);
    }
    const bool geoms = inertia_from_geoms_ == "true" || (inertia_from_geoms_ == "auto" && !given);
    for (const pugi::xml_node child : node.children("geom"))
      summed = body::combined(summed, read_geom({child, xml_.class_of(child, inherited)}, index, shift, geoms));
    if (geoms)
      out_.inertias[static_cast<std::size_t>(index)] = summed;
    else if (given)
      out_.inertias[static_cast<std::size_t>(index)] = stated;
    for (const pugi::xml_node child : node.children("body")) read_body(child, index, shift, inherited, depth + 1);
  }

  MjcfDocument xml_;
  body::Character out_;
  bool degrees_ = true;
  bool autolimits_ = true;
  std::string inertia_from_geoms_ = "auto";
  std::string euler_sequence_ = "xyz";
  int unnamed_ = 0;
  std::map<std::string, std::vector<Drive>> drives_;
  std::map<std::string, Range> ranges_;
  std::set<std::string> joints_;
  std::set<std::string> balls_;
};

}  // namespace detail

/// A character from the text of an MJCF file, the format MuJoCo reads. `name` begins every message, and names the
/// character where the file does not.
///
/// Read: compiler angle, autolimits (true unless the file says otherwise), inertiafromgeom, eulerseq; nested default
/// classes; bodies with pos and any orientation; free, ball and hinge joints; sphere, capsule and box geoms with mass
/// or density, or explicit <inertial>; motor, general and position actuators.
///
/// - A joint's frame is its body's frame moved to the joint's `pos`.
/// - Three hinges of one body at one point along its three axes become one ball joint named by their common prefix.
/// Their
///   ranges become the box of the rotation vector, which near the stops is close to the original and not equal to it.
///   Other sets of hinges become a chain of massless bodies named "body:joint".
/// - A root without a free joint is fixed; hinges and balls on it hang from a massless fixed body "world".
/// - Joint stiffness and damping are taken as the gains of the joint's motor (springref is not read); a position
///   actuator adds its gains. `range` of a ball joint is its cone; <custom><numeric name="J:range" data="x x y y z z"/>
///   in the compiler's angle unit is the box of ball joint J, which MuJoCo passes over.
/// - The torque limit is gear times the largest control or force; of a ball joint the largest of its three axes;
/// infinity
///   for a joint without actuator.
/// - Not read: sites, tendons, contact pairs, sensors, keyframes, options, and geoms that collide with nothing except
/// for
///   their mass. What would change the motion otherwise (equality constraints, slides, meshes, other actuators,
///   <include>) throws.
///
/// Throws Error, one line with file, line, element and what was expected; and what body::check_character throws.
inline body::Character parse_mjcf(std::string_view text, const std::string& name) {
  return detail::MjcfReader(text, name).read();
}

/// A character from an MJCF file; see parse_mjcf. Throws Error if the file cannot be read.
inline body::Character read_mjcf(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in || std::filesystem::is_directory(path)) throw Error(path.string() + ": cannot be opened");
  std::string text;
  // One byte beyond the limit is enough for parse_mjcf to refuse it.
  text.resize(detail::MjcfDocument::max_bytes + 1);
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (in.bad()) throw Error(path.string() + ": cannot be read");
  text.resize(static_cast<std::size_t>(in.gcount()));
  return parse_mjcf(text, path.string());
}

}  // namespace traceur::io
