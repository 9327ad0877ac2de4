// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "traceur/body/character.hpp"

namespace traceur::sim {

/// A sphere fixed to a body that touches the world: shapes are covered by a few of them.
struct ContactSphere {
  int body = 0;                              ///< index of the moving body
  int shape = 0;                             ///< index of the character's shape it stands for
  core::Vector3<double> center{0, 0, 0};  ///< in the moving body's frame, m
  double radius = 0;                         ///< m; zero for the corners of a box
};

/// What of a body touches obstacles: a sphere, or a capsule about a segment. Corners and edges of boxes are rounded a little,
/// so that a corner that has sunk in by some millimetres still knows which way is out.
struct TouchingFeature {
  int body = 0;                              ///< index of the moving body
  core::Vector3<double> center{0, 0, 0};     ///< in the moving body's frame, m
  core::Vector3<double> half_axis{0, 0, 0};  ///< from the middle of the segment to its end, m; zero for a sphere
  double radius = 0;                         ///< m
};

/// A moving body as the dynamics sees it: everything welded to it is merged into it.
struct MovingBody {
  int joint = 0;    ///< index in the skeleton
  int parent = -1;  ///< index of the moving body it hangs on; -1 for the root and for bodies on a fixed root
  body::JointType type = body::JointType::ball;
  core::Vector3<double> offset{0, 0, 0};  ///< joint in the parent's frame, m
  core::Quaternion<double> rest = core::Quaternion<double>::identity();
  bool turned_rest = false;  ///< whether `rest` differs from the identity
  core::Vector3<double> axis{0, 0, 1};
  double mass = 0;                                                             ///< kg
  core::Vector3<double> first_moment{0, 0, 0};                                 ///< mass x centre of mass, body frame, kg m
  core::Symmetric3<double> inertia = core::Symmetric3<double>::zero();  ///< about the joint, body axes, kg m^2
  body::Actuator actuator;
  int q_index = 0, v_index = 0;
  int first_contact = 0, contacts = 0;  ///< its contact spheres in Model::contacts
  int first_feature = 0, features = 0;  ///< its touching features in Model::features
  double reach = 0;                     ///< largest distance of its contact surfaces from its joint, m
};

/// A character prepared for simulation: welds merged, shapes covered by contact spheres. Immutable once made.
struct Model {
  body::Character character;
  std::vector<MovingBody> bodies;  ///< parents before children; [0] is the root when it is free
  std::vector<ContactSphere> contacts;      ///< what touches the ground
  std::vector<TouchingFeature> features;    ///< what touches obstacles
  std::vector<int> moving_of_joint;  ///< for each joint of the skeleton the moving body that carries it; -1: the fixed root
  std::vector<core::Vector3<double>> welded_place;        ///< each joint's place in its moving body, m
  std::vector<core::Quaternion<double>> welded_rotation;  ///< each joint's frame seen from its moving body
  int nq = 0, nv = 0;
  double total_mass = 0;
  double reach = 0;  ///< no part of the character is farther from the root's origin, joints bent or not, m

  /// A point of a joint's frame (m) in the frame of the moving body that carries the joint.
  core::Vector3<double> on_moving_body(int joint, const core::Vector3<double>& point) const {
    const auto j = static_cast<std::size_t>(joint);
    return welded_place[j] + welded_rotation[j].rotate(point);
  }
};

/// The features of one shape, in the shape's own axes, `body` left at zero. A box has rounded corners and edges: all twelve,
/// or only the four longest, which are what a foot meets a step with.
inline std::vector<TouchingFeature> touching_features(const body::Shape& shape, bool all_edges) {
  using core::Vector3;
  std::vector<TouchingFeature> out;
  const Vector3<double>& h = shape.size;
  if (shape.kind == body::Shape::Kind::sphere) out.push_back({0, {0, 0, 0}, {0, 0, 0}, h.x});
  if (shape.kind == body::Shape::Kind::capsule) {
    out.push_back({0, {0, 0, -h.y}, {0, 0, 0}, h.x});
    out.push_back({0, {0, 0, h.y}, {0, 0, 0}, h.x});
    out.push_back({0, {0, 0, 0}, {0, 0, h.y}, h.x});
  }
  if (shape.kind == body::Shape::Kind::box) {
    const double round = std::min(0.002, 0.4 * std::min({h.x, h.y, h.z}));
    const Vector3<double> in{h.x - round, h.y - round, h.z - round};
    for (int corner = 0; corner < 8; ++corner)
      out.push_back({0,
                     {(corner & 1 ? 1 : -1) * in.x, (corner & 2 ? 1 : -1) * in.y, (corner & 4 ? 1 : -1) * in.z},
                     {0, 0, 0},
                     round});
    const int longest = h.x >= h.y && h.x >= h.z ? 0 : h.y >= h.z ? 1 : 2;
    for (int axis = 0; axis < 3; ++axis) {
      if (!all_edges && axis != longest) continue;
      for (int side = 0; side < 4; ++side) {
        const double a = side & 1 ? 1 : -1, b = side & 2 ? 1 : -1;
        if (axis == 0) out.push_back({0, {0, a * in.y, b * in.z}, {in.x, 0, 0}, round});
        if (axis == 1) out.push_back({0, {a * in.x, 0, b * in.z}, {0, in.y, 0}, round});
        if (axis == 2) out.push_back({0, {a * in.x, b * in.y, 0}, {0, 0, in.z}, round});
      }
    }
  }
  return out;
}

/// Prepares a character. Throws Error when body::check_character refuses it.
inline Model make_model(const body::Character& character) {
  using core::Quaternion;
  using core::Vector3;
  body::check_character(character, "character '" + character.name + "'");
  Model m;
  m.character = character;
  const body::Skeleton& sk = character.skeleton;
  m.nq = sk.nq();
  m.nv = sk.nv();
  const auto n = static_cast<std::size_t>(sk.size());
  m.moving_of_joint.assign(n, -1);
  std::vector<Vector3<double>> place(n, Vector3<double>::zero());
  m.welded_rotation.assign(n, Quaternion<double>::identity());
  std::vector<body::Inertia> merged;
  for (int i = 0; i < sk.size(); ++i) {
    const auto k = static_cast<std::size_t>(i);
    const body::Joint& j = sk[i];
    // The frame that carries this joint: its parent's moving body and the parent's place in it.
    const int carrier = j.parent < 0 ? -1 : m.moving_of_joint[static_cast<std::size_t>(j.parent)];
    Vector3<double> at = j.offset;
    Quaternion<double> turn = j.rest;
    if (j.parent >= 0) {
      const auto p = static_cast<std::size_t>(j.parent);
      at = place[p] + m.welded_rotation[p].rotate(j.offset);
      turn = m.welded_rotation[p] * j.rest;
    }
    if (j.type == body::JointType::fixed) {
      m.moving_of_joint[k] = carrier;
      place[k] = at;
      m.welded_rotation[k] = turn;
      if (carrier >= 0) {
        auto& into = merged[static_cast<std::size_t>(carrier)];
        into = body::combined(into, body::transformed(character.inertias[k], at, turn));
      }
      continue;
    }
    MovingBody b;
    b.joint = i;
    b.parent = carrier;
    b.type = j.type;
    b.offset = at;
    b.rest = turn;
    b.turned_rest = std::abs(turn.w) < 1.0 - 1e-12;
    b.axis = j.axis;
    b.actuator = character.actuators[k];
    b.q_index = j.q_index;
    b.v_index = j.v_index;
    m.moving_of_joint[k] = static_cast<int>(m.bodies.size());
    m.bodies.push_back(b);
    merged.push_back(character.inertias[k]);
  }
  for (std::size_t b = 0; b < m.bodies.size(); ++b) {
    const body::Inertia& in = merged[b];
    MovingBody& body = m.bodies[b];
    body.mass = in.mass;
    body.first_moment = in.mass * in.center;
    body.inertia = in.about_center + core::Symmetric3<double>::scalar(in.mass * squared_norm(in.center)) -
                   core::Symmetric3<double>::outer(in.mass, in.center);
    m.total_mass += in.mass;
  }
  for (std::size_t b = 0; b < m.bodies.size(); ++b) {
    MovingBody& body = m.bodies[b];
    body.first_contact = static_cast<int>(m.contacts.size());
    body.first_feature = static_cast<int>(m.features.size());
    for (std::size_t s = 0; s < character.shapes.size(); ++s) {
      const body::Shape& shape = character.shapes[s];
      const auto joint = static_cast<std::size_t>(shape.body);
      if (m.moving_of_joint[joint] != static_cast<int>(b)) continue;
      const Vector3<double> center = place[joint] + m.welded_rotation[joint].rotate(shape.position);
      const Quaternion<double> turn = m.welded_rotation[joint] * shape.rotation;
      for (TouchingFeature f : touching_features(shape, false)) {
        f.body = static_cast<int>(b);
        f.center = center + turn.rotate(f.center);
        f.half_axis = turn.rotate(f.half_axis);
        m.features.push_back(f);
      }
      const auto add = [&](const Vector3<double>& local, double radius) {
        m.contacts.push_back({static_cast<int>(b), static_cast<int>(s), center + turn.rotate(local), radius});
      };
      if (shape.kind == body::Shape::Kind::sphere) add({0, 0, 0}, shape.size.x);
      if (shape.kind == body::Shape::Kind::capsule) {
        add({0, 0, -shape.size.y}, shape.size.x);
        add({0, 0, shape.size.y}, shape.size.x);
      }
      if (shape.kind == body::Shape::Kind::box)
        for (int corner = 0; corner < 8; ++corner)
          add({(corner & 1 ? 1 : -1) * shape.size.x, (corner & 2 ? 1 : -1) * shape.size.y, (corner & 4 ? 1 : -1) * shape.size.z}, 0);
    }
    body.contacts = static_cast<int>(m.contacts.size()) - body.first_contact;
    body.features = static_cast<int>(m.features.size()) - body.first_feature;
    for (int c = 0; c < body.contacts; ++c) {
      const ContactSphere& s = m.contacts[static_cast<std::size_t>(body.first_contact + c)];
      body.reach = std::max(body.reach, norm(s.center) + s.radius);
    }
  }
  std::vector<double> chain(m.bodies.size(), 0.0);
  for (std::size_t b = 0; b < m.bodies.size(); ++b) {
    if (m.bodies[b].parent >= 0) chain[b] = chain[static_cast<std::size_t>(m.bodies[b].parent)] + norm(m.bodies[b].offset);
    m.reach = std::max(m.reach, chain[b] + m.bodies[b].reach);
  }
  m.welded_place = place;
  return m;
}

}  // namespace traceur::sim
