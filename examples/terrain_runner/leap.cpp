// SPDX-License-Identifier: MIT
#include "gait_clock.hpp"

#include <cmath>
#include <numbers>

#include "traceur/control/mirror.hpp"
#include "traceur/control/motion_table.hpp"
#include "traceur/core/error.hpp"

namespace terrain_runner {

using namespace traceur;
using core::Quaternion;
using core::Vector3;

namespace {

/// From 0 to 1 and back as u goes from 0 to 1; 0 outside.
double bump(double u) {
  if (!(u > 0 && u < 1)) return 0;
  const double s = std::sin(std::numbers::pi * u);
  return s * s;
}

}  // namespace

Leap make_leap(const sim::Model& model, const control::Roles& roles, const control::Controller& run, const GaitEvents& events,
               double height, const LeapShape& shape) {
  const int n = run.ticks();
  const body::Skeleton& sk = model.character.skeleton;
  const GaitClock gait(model, run, events);
  const int left_step = gait.left_step, right = gait.right_step, take_off = gait.take_off, landing = gait.landing, end = gait.next_right_step;

  // The gait's clock, which goes slower in flight.
  const int fly_at = take_off - left_step, land_at = fly_at + shape.flight_ticks, last = land_at + end - landing,
            ticks = last + n / 2;
  const auto clock = [&](double t) {
    if (t <= fly_at) return left_step + t;
    if (t >= land_at) return landing + (t - land_at);
    return take_off + (t - fly_at) * (landing - take_off) / shape.flight_ticks;
  };
  struct Bend {
    double right_hip, left_hip, right_knee, left_knee;
  };
  const auto bend = [&](double t) {
    const double flight = shape.flight_ticks;
    const double leading = bump((t - fly_at + 4) / (flight + 6)), trailing = bump((t - fly_at - 0.15 * flight) / (1.1 * flight));
    return Bend{0, -leading * (shape.thigh + shape.thigh_rise * height), trailing * (shape.trail_knee + shape.trail_knee_rise * height),
                leading * (shape.knee + shape.knee_rise * height)};
  };
  const auto bent = [&](Eigen::VectorXd& q, const Bend& b) {
    const auto turn = [&](int body, double angle) {
      const sim::MovingBody& m = model.bodies[static_cast<std::size_t>(body)];
      double* j = q.data() + m.q_index;
      if (m.type == body::JointType::ball)
        (core::about_axis(Vector3<double>{0, 1, 0}, angle) * Quaternion<double>::from(j)).store(j);
      else
        j[0] += angle;
    };
    turn(roles.legs[0].hip, b.right_hip);
    turn(roles.legs[1].hip, b.left_hip);
    turn(roles.legs[0].knee, b.right_knee);
    turn(roles.legs[1].knee, b.left_knee);
  };

  control::Controller c = run;
  c.clip = run.clip + ", leap";
  c.cyclic = false;
  c.targets.resize(model.nq, ticks);
  c.sensory.resize(control::full_sensors, ticks);
  c.stance.assign(static_cast<std::size_t>(ticks), 0);
  c.phase.assign(static_cast<std::size_t>(ticks), 0);
  Leap leap;
  leap.parts.assign(static_cast<std::size_t>(ticks), 0);
  Eigen::MatrixXd poses(model.nq, ticks + 1);
  for (int t = 0; t <= ticks; ++t) {
    const double g = clock(t);
    Eigen::VectorXd q = gait.pose(g);
    // What the root sways about its mean path stays; the path is at the leap's own speed.
    q[0] += shape.speed * run.tick * t;
    bent(q, bend(t));
    poses.col(t) = q;
    if (t == ticks) continue;
    const auto k = static_cast<std::size_t>(t);
    Eigen::VectorXd target = gait.target(g);
    bent(target, bend(t + shape.lead_s / run.tick));
    c.targets.col(t) = target;
    const int tick = static_cast<int>(std::floor(g)) % n;
    c.sensory.col(t) = run.sensory.col(tick);
    c.stance[k] = g < right ? 1 : t < fly_at + shape.flight_ticks / 2 || t >= last ? 0 : 1;
    c.phase[k] = g < right ? 0 : 1;
    leap.parts[k] = g < right ? 0 : t < fly_at ? 1 : t < land_at ? 2 : 3;
  }

  // The centre of mass flies as gravity has it, from the height of take-off to that of landing on top.
  control::TrackingReference& r = c.reference;
  r.dt = run.tick;
  r.poses = poses;
  r.velocities = Eigen::MatrixXd::Zero(model.nv, ticks + 1);
  control::measure_reference(model, roles, {}, r);
  const double t_flight = shape.flight_ticks * run.tick, g = run.simulation.gravity;
  const double from = r.center_of_mass(2, fly_at), to = r.center_of_mass(2, land_at) + height;
  const double rise_speed = (to - from) / t_flight + 0.5 * g * t_flight;
  for (int t = fly_at + 1; t <= ticks; ++t) {
    const double s = (t - fly_at) * run.tick;
    const double wanted = t < land_at ? from + s * (rise_speed - 0.5 * g * s) : r.center_of_mass(2, t) + height;
    poses(2, t) += wanted - r.center_of_mass(2, t);
  }
  // The edge is where the left foot lands well behind it.
  const double edge = r.feet(3, land_at) - shape.behind_edge;
  poses.row(0).array() -= edge;
  poses.row(1).array() -= r.center_of_mass.row(1).mean();
  r.poses = poses;
  for (int t = 0; t <= ticks; ++t) {
    const int a = std::max(t - 1, 0), b = std::min(t + 1, ticks);
    Eigen::VectorXd d(model.nv);
    body::difference(sk, poses.col(a).data(), poses.col(b).data(), d.data());
    r.velocities.col(t) = d / ((b - a) * run.tick);
  }
  control::measure_reference(model, roles, {}, r);
  c.start_pose = poses.col(0);
  c.start_velocity = r.velocities.col(0);
  leap.end = last;
  leap.distance = -r.center_of_mass(0, 0);
  leap.controller = std::move(c);
  return leap;
}

control::Controller mirrored(const sim::Model& model, const control::Roles& roles, control::Controller c) {
  const auto mirror_poses = [&](Eigen::MatrixXd& poses) {
    for (Eigen::Index t = 0; t < poses.cols(); ++t) poses.col(t) = control::mirrored_pose(model, roles, poses.col(t));
  };
  mirror_poses(c.targets);
  mirror_poses(c.reference.poses);
  for (Eigen::Index t = 0; t < c.reference.velocities.cols(); ++t)
    c.reference.velocities.col(t) = control::mirrored_tangent(model, roles, c.reference.velocities.col(t));
  control::measure_reference(model, roles, {}, c.reference);
  for (auto& side : c.stance) side = 1 - side;
  c.start_pose = c.reference.poses.col(0);
  c.start_velocity = c.reference.velocities.col(0);
  return c;
}

}  // namespace terrain_runner
