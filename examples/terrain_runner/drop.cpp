// SPDX-License-Identifier: MIT
#include <cmath>
#include <numbers>

#include "authored.hpp"
#include "traceur/control/hand_grip.hpp"
#include "traceur/motion/blend.hpp"
#include "traceur/motion/keyframes.hpp"

namespace terrain_runner {

using namespace traceur;
using core::Vector3;

Authored author_drop(const sim::Model& model, const control::Roles& roles, const GaitClock& gait, double height, const DropShape& shape) {
  const double tick = gait.run->tick, gravity = gait.run->simulation.gravity;
  const Passage passage(gait, shape.flight_ticks + shape.roll_ticks, shape.steps_after, shape.steps_beyond);
  const int fly_at = passage.fly_at, down_at = fly_at + shape.flight_ticks, land_at = passage.land_at;
  // It loses speed from touchdown on, and regains it once it runs.
  const auto pace = [&](double t) {
    const double u = std::clamp((t - down_at) / 18.0, 0.0, 1.0), w = std::clamp((t - down_at - 0.6 * shape.roll_ticks) / (0.4 * shape.roll_ticks + 48.0), 0.0, 1.0);
    return shape.speed + (shape.slowest - shape.speed) * (motion::smoothstep(u) - motion::smoothstep(w));
  };
  Eigen::MatrixXd poses = passage.run(pace);
  const Eigen::VectorXd path = poses.row(0);

  // Root: how far it has turned forwards (deg) and to the left, so that it rolls over the right shoulder; joints, deg.
  struct Way {
    double at;                              // s after touchdown, of a flight and a roll of the lengths below
    double pitch, yaw;
    double abdomen, neck, arms, elbows;     // arms: towards overhead
    double right_hip, left_hip, right_knee, left_knee;
  };
  const std::vector<Way> ways{
      {-0.45, 8, 0, 5, 0, 50, 50, 35, 40, 60, 50},
      {-0.25, 12, 0, 10, 0, 60, 40, 40, 50, 60, 60},
      {0.00, 20, 0, 15, 5, 60, 30, 45, 55, 50, 50},
      {0.17, 75, 15, 40, 25, 100, 30, 110, 115, 105, 105},
      {0.30, 122, 28, 50, 40, 110, 60, 95, 100, 75, 70},
      {0.45, 180, 30, 50, 45, 105, 75, 90, 95, 80, 75},
      {0.60, 228, 28, 50, 45, 95, 75, 105, 105, 105, 100},
      {0.75, 277, 22, 45, 35, 80, 60, 115, 110, 130, 120},
      {0.88, 325, 12, 40, 20, 60, 45, 125, 110, 140, 125},
      {0.99, 357, 4, 30, 5, 35, 45, 95, 75, 125, 95},
  };
  std::vector<motion::Keyframe> keys;
  const int first = fly_at - 8;
  const auto key_at = [&](int t) {
    motion::Keyframe k;
    k.time = (t - first) * tick;
    k.pose = poses.col(t);
    keys.push_back(k);
  };
  for (int t = fly_at - 8; t <= fly_at; t += 4) key_at(t);
  const auto turn = [&](Eigen::VectorXd& q, int b, const Vector3<double>& degrees) {
    core::exp_map((std::numbers::pi / 180) * degrees).store(q.data() + model.bodies[static_cast<std::size_t>(b)].q_index);
  };
  const auto bend = [&](Eigen::VectorXd& q, int b, double degrees) {
    q[model.bodies[static_cast<std::size_t>(b)].q_index] = degrees * std::numbers::pi / 180;
  };
  const auto hands = control::find_hands(model);
  for (const Way& w : ways) {
    const double s = w.at < 0 ? w.at * shape.flight_ticks / 41 : w.at * shape.roll_ticks / 66;
    motion::Keyframe k;
    k.time = (down_at - first) * tick + s;
    const int t = down_at + static_cast<int>(std::lround(s / tick));
    Eigen::VectorXd q = gait.pose(passage.clock(fly_at));
    q[0] = path[t];
    q[1] = 0;
    const core::Quaternion<double> root = core::about_axis(Vector3<double>{0, 1, 0}, w.pitch * std::numbers::pi / 180) *
                                          core::about_axis(Vector3<double>{0, 0, 1}, w.yaw * std::numbers::pi / 180);
    root.store(q.data() + 3);
    turn(q, roles.waist, {0, w.abdomen, 0});
    for (const int b : roles.head) turn(q, b, {0, w.neck, 0});
    for (std::size_t side = 0; side < 2; ++side) {
      const int elbow = model.moving_of_joint[static_cast<std::size_t>(hands[side].joint)];
      turn(q, model.bodies[static_cast<std::size_t>(elbow)].parent, {side == 0 ? -15.0 : 15.0, -w.arms, 0});
      bend(q, elbow, w.elbows);
      turn(q, roles.legs[side].hip, {0, -(side == 0 ? w.right_hip : w.left_hip), 0});
      bend(q, roles.legs[side].knee, side == 0 ? w.right_knee : w.left_knee);
      turn(q, roles.legs[side].foot, {0, 0, 0});
    }
    k.pose = q;
    keys.push_back(k);
  }
  for (int t = land_at; t <= land_at + 8; t += 4) key_at(t);
  const motion::Clip clip = motion::from_keyframes("drop", model.character.skeleton, keys, 1 / tick);
  for (int t = fly_at + 1; t < land_at; ++t) {
    poses.col(t) = clip.sample((t - first) * tick);
    poses(0, t) = path[t];
  }
  control::TrackingReference r = passage.reference(poses, roles);
  // The centre of mass: a parabola from take-off to touchdown, down into the roll, along it, and up to that of running.
  const double crouched = 0.31, touching = 0.88, down_s = 0.17, roll_s = 0.80;
  const double seconds = shape.flight_ticks * tick, from = r.center_of_mass(2, fly_at), to = touching - height;
  const double up = (to - from) / seconds + 0.5 * gravity * seconds, sinking = up - gravity * seconds, up_at = (land_at - down_at) * tick;
  const double stand = r.center_of_mass(2, land_at);
  const double x_from = r.center_of_mass(0, fly_at),
               stretch = (r.center_of_mass(0, land_at) - x_from - path[land_at] + path[fly_at]) / ((land_at - fly_at) * tick);
  const auto hermite = [](double u, double a, double va, double b) {
    return a + u * va + u * u * (3 * (b - a) - 2 * va) + u * u * u * (va - 2 * (b - a));
  };
  for (int t = fly_at + 1; t < land_at; ++t) {
    const double s = (t - fly_at) * tick, w = (t - down_at) * tick;
    double z = 0;
    if (w <= 0)
      z = from + s * (up - 0.5 * gravity * s);
    else if (w < down_s)
      z = hermite(w / down_s, touching, std::max(sinking * down_s, -3 * (touching - crouched)), crouched) - height;
    else if (w < roll_s)
      z = crouched - height;
    else
      z = crouched + (stand - crouched) * motion::smoothstep((w - roll_s) / (up_at - roll_s)) - height;
    r.poses(2, t) += z - r.center_of_mass(2, t);
    r.poses(0, t) += x_from + path[t] - path[fly_at] + stretch * s - r.center_of_mass(0, t);
  }
  r.poses.row(2).tail(passage.ticks + 1 - land_at).array() -= height;
  // The right foot takes off well before the edge, for those who come too far.
  r.poses.row(0).array() -= r.feet(0, fly_at - 4) + 0.5;
  differentiate(model, roles, {}, r);
  Authored a = passage.author(std::move(r), roles);
  // The step before, take-off until both feet have left, flight until they are down, the roll, and what follows it.
  for (int t = 0; t < passage.ticks; ++t) {
    const auto k = static_cast<std::size_t>(t);
    a.phase[k] = a.parts[k] = t < passage.step_at ? 0 : t < fly_at ? 1 : t < down_at ? 2 : t < land_at ? 3 : 4;
    if (t >= passage.step_at && t < passage.stand_at) a.stance[k] = t < fly_at ? 0 : 1;
  }
  a.placed = fly_at;
  return a;
}

}  // namespace terrain_runner
