// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <string>
#include <vector>

#include "traceur/sim/model.hpp"

namespace traceur::control {

/// Which moving bodies are a biped's feet, legs and trunk, read from the tree and the neutral pose, not from names. Indices
/// are moving bodies of a sim::Model; side 0 is right (y < 0), side 1 is left.
struct Roles {
  struct Leg {
    int hip = -1, knee = -1, foot = -1;  ///< bodies whose joints are the hip, the knee and the ankle
  };
  std::array<Leg, 2> legs;
  int waist = -1;                ///< first joint from the root towards the head
  std::vector<int> upper_trunk;  ///< joints between the waist and the first joint that carries arms, that one included
  std::vector<int> head;         ///< leaves above the root that lie near its middle
  std::vector<int> mirror;       ///< the body on the other side, itself on the middle line

  bool is_leg(int b) const {
    for (const Leg& l : legs)
      if (b == l.hip || b == l.knee || b == l.foot) return true;
    return false;
  }
};

/// Finds the roles. Throws Error when the character is not a biped: two chains of at least three joints below the root.
inline Roles find_roles(const sim::Model& model) {
  const std::string where = "character '" + model.character.name + "': ";
  const body::Skeleton& sk = model.character.skeleton;
  const Eigen::VectorXd q = sk.neutral_pose();
  body::Frames<double> frames(sk);
  body::forward_kinematics(sk, q.data(), frames);
  const int n = static_cast<int>(model.bodies.size());
  const auto place = [&](int b) {
    return frames.position[static_cast<std::size_t>(model.bodies[static_cast<std::size_t>(b)].joint)];
  };
  const auto parent = [&](int b) { return model.bodies[static_cast<std::size_t>(b)].parent; };
  if (n == 0 || model.bodies[0].type != body::JointType::free) throw Error(where + "expected a free root");
  std::vector<bool> leaf(static_cast<std::size_t>(n), true);
  for (int b = 1; b < n; ++b) leaf[static_cast<std::size_t>(parent(b))] = false;
  Roles r;
  std::array<double, 2> lowest{0, 0};
  for (int b = 1; b < n; ++b) {
    if (!leaf[static_cast<std::size_t>(b)]) continue;
    const int side = place(b).y > 0 ? 1 : 0;
    const double height = place(b).z - place(0).z;
    std::vector<int> chain;
    for (int k = b; k > 0; k = parent(k)) chain.push_back(k);
    if (height < lowest[static_cast<std::size_t>(side)] && chain.size() >= 3) {
      lowest[static_cast<std::size_t>(side)] = height;
      r.legs[static_cast<std::size_t>(side)] = {chain.back(), chain[chain.size() - 2], b};
    }
  }
  if (r.legs[0].foot < 0 || r.legs[1].foot < 0) throw Error(where + "expected two legs of at least three joints below the root");
  for (int b = 1; b < n; ++b) {
    if (!leaf[static_cast<std::size_t>(b)] || std::abs(place(b).y - place(0).y) > 1e-3 || place(b).z <= place(0).z) continue;
    r.head.push_back(b);
    for (int k = b; k > 0; k = parent(k)) r.waist = k;
  }
  for (int b = 1; b < n && r.waist < 0; ++b)
    if (parent(b) == 0 && b != r.legs[0].hip && b != r.legs[1].hip) r.waist = b;
  if (r.waist < 0) throw Error(where + "expected a trunk above the root");
  // From the waist up while the chain does not branch: the joint below the branch is the chest.
  for (int b = r.waist;;) {
    std::vector<int> children;
    for (int k = b + 1; k < n; ++k)
      if (parent(k) == b) children.push_back(k);
    if (children.size() != 1 || leaf[static_cast<std::size_t>(children[0])]) break;
    b = children[0];
    r.upper_trunk.push_back(b);
  }
  r.mirror.resize(static_cast<std::size_t>(n));
  for (int b = 0; b < n; ++b) {
    int best = b;
    double nearest = 1e9;
    for (int o = 0; o < n; ++o) {
      const core::Vector3<double> d = place(o) - place(b);
      const core::Vector3<double> m{d.x, place(o).y + place(b).y - 2 * place(0).y, d.z};
      if (norm(m) < nearest) {
        nearest = norm(m);
        best = o;
      }
    }
    r.mirror[static_cast<std::size_t>(b)] = best;
  }
  return r;
}

}  // namespace traceur::control
