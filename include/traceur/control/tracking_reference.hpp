// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <vector>

#include "traceur/body/momentum.hpp"
#include "traceur/control/roles.hpp"
#include "traceur/motion/clip.hpp"

namespace traceur::control {

/// A point fixed to a moving body whose place is compared between a simulation and its reference.
struct TrackedPoint {
  int body = 0;
  core::Vector3<double> local{0, 0, 0};  ///< m, body frame
};

/// The points that tracking errors are measured on: every joint of the skeleton and the middle of the head.
inline std::vector<TrackedPoint> tracked_points(const sim::Model& model, const Roles& roles) {
  std::vector<TrackedPoint> points;
  for (std::size_t j = 0; j < model.moving_of_joint.size(); ++j)
    if (model.moving_of_joint[j] >= 0) points.push_back({model.moving_of_joint[j], model.welded_place[j]});
  for (const int h : roles.head)
    for (const body::Shape& s : model.character.shapes)
      if (model.moving_of_joint[static_cast<std::size_t>(s.body)] == h) {
        points.push_back({h, s.position});
        break;
      }
  return points;
}

/// A clip sampled on the control ticks of a simulation, with everything that costs and feedback compare against. Columns
/// are ticks 0 .. ticks, at times tick x `dt`; `ticks` intervals lie between them. World axes.
struct TrackingReference {
  double dt = 1.0 / 60;  ///< s
  int ticks = 0;
  Eigen::MatrixXd poses;                ///< nq x (ticks + 1)
  Eigen::MatrixXd velocities;           ///< nv x (ticks + 1)
  Eigen::MatrixXd points;               ///< 3P x (ticks + 1), m
  Eigen::MatrixXd center_of_mass;       ///< 3 x (ticks + 1), m
  Eigen::MatrixXd center_velocity;      ///< 3 x (ticks + 1), m/s
  Eigen::MatrixXd feet;                 ///< 6 x (ticks + 1): right, left ankle, m
  Eigen::VectorXd heading;              ///< of the root, rad, per tick
};

/// Fills everything that follows from poses and velocities.
inline void measure_reference(const sim::Model& model, const Roles& roles, const std::vector<TrackedPoint>& points,
                              TrackingReference& r) {
  const body::Skeleton& sk = model.character.skeleton;
  const auto columns = r.poses.cols();
  r.ticks = static_cast<int>(columns) - 1;
  r.points.resize(3 * static_cast<Eigen::Index>(points.size()), columns);
  r.center_of_mass.resize(3, columns);
  r.center_velocity.resize(3, columns);
  r.feet.resize(6, columns);
  r.heading.resize(columns);
  body::Frames<double> frames(sk);
  body::Twists<double> twists(sk);
  for (Eigen::Index t = 0; t < columns; ++t) {
    body::forward_kinematics(sk, r.poses.col(t).data(), frames);
    body::forward_velocities(sk, frames, r.velocities.col(t).data(), twists);
    const auto m = body::momentum(model.character, frames, twists);
    m.center_of_mass.store(r.center_of_mass.col(t).data());
    m.velocity().store(r.center_velocity.col(t).data());
    for (std::size_t p = 0; p < points.size(); ++p)
      frames.point(model.bodies[static_cast<std::size_t>(points[p].body)].joint, points[p].local)
          .store(r.points.col(t).data() + 3 * p);
    for (std::size_t side = 0; side < 2; ++side)
      frames.position[static_cast<std::size_t>(model.bodies[static_cast<std::size_t>(roles.legs[side].foot)].joint)].store(
          r.feet.col(t).data() + 3 * side);
    const auto h = core::heading(core::Quaternion<double>::from(r.poses.col(t).data() + 3));
    r.heading[t] = 2 * std::atan2(h.z, h.w);
  }
}

/// Samples `seconds` of a clip of the character (cyclic clips go on past their end).
inline TrackingReference make_reference(const sim::Model& model, const Roles& roles, const std::vector<TrackedPoint>& points,
                                        const motion::Clip& clip, double seconds, double dt) {
  TrackingReference r;
  r.dt = dt;
  r.ticks = std::max(1, static_cast<int>(std::lround(seconds / dt)));
  r.poses.resize(model.nq, r.ticks + 1);
  r.velocities.resize(model.nv, r.ticks + 1);
  for (int t = 0; t <= r.ticks; ++t) {
    r.poses.col(t) = clip.sample(t * dt);
    r.velocities.col(t) = clip.velocity(t * dt);
  }
  measure_reference(model, roles, points, r);
  return r;
}

}  // namespace traceur::control
