// SPDX-License-Identifier: MIT
// A small biped with all that a reader of trees can get wrong: turned rest frames, hinges whose axes are and are not mirror
// images, a trunk of two joints, wrists below the root, a welded toe on each foot.
#pragma once

#include <string>

#include <traceur/control/mirror.hpp>

namespace figures {

using Vector = traceur::core::Vector3<double>;
using Quaternion = traceur::core::Quaternion<double>;

/// Right is y < 0 as everywhere; `side` = -1 exchanges left and right. Joints are named `prefix` and their place.
inline traceur::body::Character biped(double side = 1, const std::string& prefix = "") {
  using traceur::body::JointType;
  namespace control = traceur::control;
  traceur::body::Character c;
  c.name = "biped";
  const auto add = [&](const std::string& name, int parent, JointType type, const Vector& offset, const Vector& rest,
                       const Vector& axis, double mass) {
    traceur::body::Joint j;
    j.name = prefix + name;
    j.body = j.name + " body";
    j.parent = parent;
    j.type = type;
    j.offset = offset;
    j.rest = exp_map(rest);
    j.axis = axis;
    traceur::body::Inertia in;
    in.mass = mass;
    in.center = {0.01, 0, -0.05};
    in.about_center = traceur::core::Symmetric3<double>::scalar(0.02 * mass);
    traceur::body::Actuator a;
    a.stiffness = 200;
    a.damping = 20;
    a.armature = 0.01;
    traceur::body::Shape s;
    s.name = j.name;
    s.size = {0.05, 0, 0};
    s.body = c.skeleton.add(j);
    c.inertias.push_back(in);
    c.actuators.push_back(a);
    c.shapes.push_back(s);
    return s.body;
  };
  const Vector none{0, 0, 0}, x{1, 0, 0}, y{0, 1, 0};
  const int root = add("pelvis", -1, JointType::free, none, none, y, 8);
  const int spine = add("spine", root, JointType::ball, {0, 0, 0.2}, {0, 0.1, 0}, y, 5);
  const int chest = add("chest", spine, JointType::ball, {0.01, 0, 0.2}, {0, -0.1, 0}, y, 6);
  add("neck", chest, JointType::hinge, {0, 0, 0.15}, none, y, 3);
  for (const double s : {-side, side}) {
    const std::string name = s < 0 ? "right " : "left ";
    const auto placed = [&](const Vector& v) { return s < 0 ? v : control::mirrored_vector(v); };
    const auto turned = [&](const Vector& v) { return s < 0 ? v : control::mirrored_rotation(v); };
    // The knees' and wrists' axes are mirror images, those of elbows and ankles point the same way on both sides.
    const int shoulder = add(name + "shoulder", chest, JointType::ball, placed({0, -0.2, 0.1}), turned({0.1, 0.05, -0.1}), y, 1.5);
    const int elbow = add(name + "elbow", shoulder, JointType::hinge, placed({0, -0.02, -0.3}), none, y, 1);
    add(name + "wrist", elbow, JointType::hinge, {0, 0, -0.3}, none, turned(x), 0.5);
    const int hip = add(name + "hip", root, JointType::ball, placed({0, -0.1, -0.05}), turned({0.02, -0.1, 0.03}), y, 5);
    const int knee = add(name + "knee", hip, JointType::hinge, {0, 0, -0.4}, turned({0.01, 0.05, 0}), turned(y), 3);
    const int ankle = add(name + "ankle", knee, JointType::hinge, {0, 0, -0.4}, none, x, 1);
    add(name + "toe", ankle, JointType::fixed, {0.12, 0, -0.03}, turned({0, 0.1, 0.2}), y, 0.3);
  }
  return c;
}

}  // namespace figures
