// SPDX-License-Identifier: MIT
// A figure with shapes that walks over two low boxes, for losses and corrections.
#pragma once

#include <vector>

#include <traceur/body/surface_points.hpp>
#include <traceur/motion/losses.hpp>
#include <traceur/terrain/height_grid.hpp>

#include "figure.hpp"

namespace walk_on_boxes {

using namespace traceur;

inline body::Character character() {
  body::Character c;
  c.name = "figure";
  c.skeleton = figure::biped();
  const auto add = [&](const std::string& joint, body::Shape::Kind kind, core::Vector3<double> at,
                       core::Vector3<double> size) {
    body::Shape s;
    s.kind = kind;
    s.name = joint;
    s.body = c.skeleton.find(joint);
    s.position = at;
    s.size = size;
    c.shapes.push_back(s);
  };
  add("root", body::Shape::Kind::sphere, {0, 0, 0}, {0.1, 0, 0});
  add("chest", body::Shape::Kind::sphere, {0, 0, 0.1}, {0.12, 0, 0});
  for (const char* side : {"left_", "right_"}) {
    add(std::string(side) + "knee", body::Shape::Kind::capsule, {0, 0, -0.18}, {0.05, 0.14, 0});
    add(std::string(side) + "foot", body::Shape::Kind::box, {0.04, 0, -0.03}, {0.09, 0.045, 0.03});
    add(std::string(side) + "elbow", body::Shape::Kind::capsule, {0, 0, -0.1}, {0.04, 0.08, 0});
  }
  return c;
}

/// Ground at 0 with boxes of 5 and 9 cm ahead.
inline terrain::HeightGrid ground() {
  Eigen::MatrixXd h = Eigen::MatrixXd::Zero(10, 6);
  h.block(3, 2, 2, 2).setConstant(0.05);
  h.block(6, 1, 2, 3).setConstant(0.09);
  return terrain::HeightGrid(h, 0.4, -1.0, -1.2);
}

/// `keys` frames of gait at 30 a second, feet labelled in turn, soles about `sunk` metres below the ground.
inline motion::Clip clip(int keys = 24, double sunk = 0.05) {
  figure::Gait g;
  g.lead = 0.3;
  motion::Clip out = figure::gait(g, (keys - 1) / 30.0, keys);
  out.poses.row(2).array() += 0.1 - sunk;
  out.contacts.setZero(out.skeleton.size(), keys);
  for (int k = 0; k < keys; ++k)
    out.contacts(out.skeleton.find(k % 18 < 9 ? "left_foot" : "right_foot"), k) = k % 5 == 0 ? 0.5 : 1.0;
  return out;
}

/// A change of every number by up to `size`, nv x keys.
inline Eigen::MatrixXd random_change(const motion::Clip& clip, double size, std::uint64_t seed = 5) {
  std::mt19937_64 rng(seed);
  Eigen::MatrixXd d(clip.skeleton.nv(), clip.keys());
  for (Eigen::Index i = 0; i < d.size(); ++i) d.data()[i] = figure::uniform(rng, -size, size);
  return d;
}

}  // namespace walk_on_boxes
