// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "traceur/body/kinematics.hpp"
#include "traceur/control/roles.hpp"
#include "traceur/core/error.hpp"
#include "traceur/motion/align.hpp"
#include "traceur/motion/contact_labels.hpp"
#include "traceur/motion/loop.hpp"

namespace traceur::learn {

/// A clip on the ticks of a policy: what tracking it is measured against, as single floats ready to be gathered into packs.
///
/// It begins above the origin, heading along +x. A cycle is closed and does not turn, and its length is rounded to whole
/// ticks, velocities with it; after each cycle everything is `carry` farther on.
struct ReferenceMotion {
  std::string name;
  bool cyclic = false;
  int ticks = 0;       ///< intervals; of a cycle, tick `ticks` is tick 0 of the next
  double tick = 0;     ///< s
  float carry[2] = {0, 0};      ///< travel of a cycle, m
  bool trunk_touches = false;   ///< whether trunk or head come near the ground in the motion itself
  Eigen::MatrixXf poses;       ///< nq x (ticks + 1)
  Eigen::MatrixXf velocities;  ///< nv x (ticks + 1)
  Eigen::MatrixXf contacts;    ///< labels in [0, 1], moving bodies x (ticks + 1)
};

namespace detail {

/// Least height over the motion of what must not touch the ground: the shapes of the trunk and the head, m.
inline double lowest_of_trunk(const sim::Model& model, const std::vector<int>& trunk, const Eigen::MatrixXd& poses) {
  const body::Skeleton& skeleton = model.character.skeleton;
  body::Frames<double> frames(skeleton);
  double lowest = std::numeric_limits<double>::infinity();
  for (Eigen::Index t = 0; t < poses.cols(); ++t) {
    body::forward_kinematics(skeleton, poses.col(t).data(), frames);
    for (const int b : trunk) {
      const sim::MovingBody& m = model.bodies[static_cast<std::size_t>(b)];
      for (int c = 0; c < m.contacts; ++c) {
        const sim::ContactSphere& s = model.contacts[static_cast<std::size_t>(m.first_contact + c)];
        lowest = std::min(lowest, frames.point(m.joint, s.center).z - s.radius);
      }
    }
  }
  return lowest;
}

/// Contact labels of the moving bodies on every tick: the clip's own, or else found from its motion.
inline Eigen::MatrixXd contact_labels(const sim::Model& model, const motion::Clip& clip, int ticks, double interval) {
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(model.bodies.size()), ticks + 1);
  motion::Clip labelled = clip;
  if (clip.contacts.cols() == 0) {
    const std::vector<motion::ContactPoint> points = motion::contact_points(model.character);
    if (points.empty()) return out;
    labelled = motion::label_contacts(clip, points);
  }
  Eigen::VectorXd joints(clip.skeleton.size());
  for (int t = 0; t <= ticks; ++t) {
    labelled.sample_contacts(std::min(t * interval, clip.duration()), joints);
    for (int j = 0; j < clip.skeleton.size(); ++j)
      if (const int b = model.moving_of_joint[static_cast<std::size_t>(j)]; b >= 0) out(b, t) = std::max(out(b, t), joints[j]);
  }
  return out;
}

}  // namespace detail

/// Trunk and head: the bodies that a fall puts on the ground.
inline std::vector<int> trunk_bodies(const control::Roles& roles) {
  std::vector<int> out{0, roles.waist};
  out.insert(out.end(), roles.upper_trunk.begin(), roles.upper_trunk.end());
  out.insert(out.end(), roles.head.begin(), roles.head.end());
  std::sort(out.begin(), out.end());
  out.erase(std::unique(out.begin(), out.end()), out.end());
  return out;
}

/// What hands and feet are to a skeleton: where its chains below the root end, the head left out.
inline std::vector<int> end_effectors(const sim::Model& model, const control::Roles& roles) {
  const body::Skeleton& skeleton = model.character.skeleton;
  std::vector<bool> leaf(static_cast<std::size_t>(skeleton.size()), true);
  for (int i = 1; i < skeleton.size(); ++i) leaf[static_cast<std::size_t>(skeleton[i].parent)] = false;
  for (const int h : roles.head) leaf[static_cast<std::size_t>(model.bodies[static_cast<std::size_t>(h)].joint)] = false;
  std::vector<int> out;
  for (int i = 1; i < skeleton.size(); ++i)
    if (leaf[static_cast<std::size_t>(i)]) out.push_back(i);
  return out;
}

/// Samples a clip that is on the model's character, `rate` ticks a second. Throws Error when the clip is shorter than two
/// ticks or on another skeleton.
inline ReferenceMotion make_reference_motion(const sim::Model& model, const control::Roles& roles, const motion::Clip& clip,
                                             double rate) {
  const std::string where = "clip '" + clip.name + "': ";
  if (clip.skeleton.nq() != model.nq || clip.skeleton.nv() != model.nv)
    throw Error(where + "expected a clip of the character '" + model.character.name + "'");
  if (!(rate > 0)) throw Error(where + "expected a positive rate of ticks");
  ReferenceMotion out;
  out.name = clip.name;
  out.cyclic = clip.cyclic;
  out.tick = 1 / rate;
  out.ticks = static_cast<int>(std::lround(clip.duration() * rate));
  if (out.ticks < 2) throw Error(where + "expected at least two ticks, found " + std::to_string(clip.duration()) + " s");
  motion::Clip straight = clip.cyclic ? motion::straighten_cycle(motion::close_cycle(clip)) : clip;
  motion::GroundTransform ahead;
  ahead.turn = core::heading(core::Quaternion<double>::from(straight.poses.col(0).data() + 3)).conjugate();
  straight = motion::moved(straight, ahead);
  motion::GroundTransform home;
  home.shift = {-straight.poses(0, 0), -straight.poses(1, 0), 0};
  straight = motion::moved(straight, home);

  const double interval = clip.duration() / out.ticks;
  Eigen::MatrixXd poses(model.nq, out.ticks + 1), velocities(model.nv, out.ticks + 1);
  for (int t = 0; t <= out.ticks; ++t) {
    // The last key of a cycle is where it ends, not where the next begins.
    const double phi = std::min(t * interval, straight.duration());
    poses.col(t) = t == out.ticks ? Eigen::VectorXd(straight.poses.col(straight.keys() - 1)) : straight.sample(phi);
    velocities.col(t) = (interval / out.tick) * straight.velocity(phi, 0.5 * interval);
  }
  if (!poses.allFinite() || !velocities.allFinite()) throw Error(where + "expected finite numbers");
  out.poses = poses.cast<float>();
  out.velocities = velocities.cast<float>();
  if (out.cyclic) {
    out.carry[0] = out.poses(0, out.ticks) - out.poses(0, 0);
    out.carry[1] = out.poses(1, out.ticks) - out.poses(1, 0);
  }
  out.contacts = detail::contact_labels(model, straight, out.ticks, interval).cast<float>();
  out.trunk_touches = detail::lowest_of_trunk(model, trunk_bodies(roles), poses) < 0.05;
  return out;
}

}  // namespace traceur::learn
