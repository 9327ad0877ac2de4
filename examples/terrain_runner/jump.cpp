// SPDX-License-Identifier: MIT
#include <cmath>
#include <numbers>

#include "authored.hpp"
#include "traceur/motion/blend.hpp"
#include "traceur/motion/keyframes.hpp"

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

Authored author_jump(const sim::Model& model, const control::Roles& roles, const GaitClock& gait, double height, const JumpShape& shape) {
  const body::Skeleton& sk = model.character.skeleton;
  const Passage passage(gait, shape.flight_ticks, shape.steps_after, shape.steps_beyond);
  const int fly_at = passage.fly_at, land_at = passage.land_at;
  const double tick = gait.run->tick, flight = shape.flight_ticks;
  Eigen::MatrixXd poses = passage.run([&](double) { return shape.speed; });
  const auto turn = [&](Eigen::VectorXd& q, int b, double angle) {
    const sim::MovingBody& m = model.bodies[static_cast<std::size_t>(b)];
    double* j = q.data() + m.q_index;
    if (m.type == body::JointType::ball)
      (core::about_axis(Vector3<double>{0, 1, 0}, angle) * Quaternion<double>::from(j)).store(j);
    else
      j[0] += angle;
  };
  // In flight the gait's clock goes slower; legs are bent, the leading one first.
  for (int t = fly_at - 4; t < land_at + 4; ++t) {
    const double u = (t - fly_at) / flight;
    Eigen::VectorXd q = poses.col(t);
    if (t > fly_at && t < land_at) {
      q = gait.pose(gait.take_off + u * (gait.landing - gait.take_off));
      q[0] = poses(0, t);
    }
    const double leading = bump((t - fly_at + 4) / (flight + 6)), trailing = bump((t - fly_at - 0.15 * flight) / (1.1 * flight));
    turn(q, roles.legs[1].hip, -leading * (shape.thigh + shape.thigh_rise * height));
    turn(q, roles.legs[1].knee, leading * (shape.knee + shape.knee_rise * height));
    turn(q, roles.legs[0].knee, trailing * (shape.trail_knee + shape.trail_knee_rise * height));
    poses.col(t) = q;
  }
  // Landing on a bent leg spares some of the height.
  const double sinks = shape.sinks * height;
  std::vector<motion::Keyframe> keys;
  const int first = land_at - 8, last = land_at + 20;
  body::Frames<double> frames(sk);
  for (int t = first; t <= last; t += 4) {
    motion::Keyframe k;
    k.time = (t - first) * tick;
    k.pose = poses.col(t);
    const double w = t < land_at ? motion::smoothstep((t - first) / 8.0) : 1 - motion::smoothstep((t - land_at) / 20.0);
    if (t >= land_at && t < last) {
      body::forward_kinematics(sk, k.pose.data(), frames);
      k.pose[2] -= w * sinks;
      for (int side = 0; side < 2; ++side) {
        motion::KeyframePin p;
        p.joint = model.bodies[static_cast<std::size_t>(roles.legs[static_cast<std::size_t>(side)].foot)].joint;
        p.target = frames.point(p.joint, p.point);
        k.pins.push_back(p);
      }
      motion::KeyframePin root;
      root.target = {k.pose[0], k.pose[1], k.pose[2]};
      root.weight = 10;
      k.pins.push_back(root);
    } else {
      k.pose[2] -= w * sinks;
    }
    keys.push_back(k);
  }
  const motion::Clip clip = motion::from_keyframes("jump", sk, keys, 1 / tick);
  for (int t = first; t <= last; ++t) poses.col(t) = clip.sample((t - first) * tick);
  poses.row(2).tail(passage.ticks + 1 - land_at).array() += height;

  control::TrackingReference r = passage.reference(poses, roles);
  fly(r, fly_at, land_at, gait.run->simulation.gravity);
  // The edge is where the left foot lands well behind it.
  r.poses.row(0).array() -= r.feet(3, land_at) - shape.behind_edge;
  differentiate(model, roles, {}, r);
  Authored a = passage.author(std::move(r), roles);
  for (int t = 0; t < passage.ticks; ++t) {
    const auto k = static_cast<std::size_t>(t);
    a.phase[k] = a.parts[k] = t < passage.step_at ? 0 : t < fly_at ? 1 : t < land_at ? 2 : 3;
    if (t >= passage.step_at && t < passage.stand_at) a.stance[k] = t < fly_at + shape.flight_ticks / 2 ? 0 : 1;
  }
  a.placed = land_at;
  return a;
}

}  // namespace terrain_runner
