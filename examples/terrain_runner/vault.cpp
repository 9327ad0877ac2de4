// SPDX-License-Identifier: MIT
#include <cmath>
#include <numbers>

#include "authored.hpp"
#include "traceur/control/hand_grip.hpp"
#include "traceur/control/pd_targets.hpp"
#include "traceur/motion/blend.hpp"
#include "traceur/motion/keyframes.hpp"

namespace terrain_runner {

using namespace traceur;
using core::Vector3;

Authored author_vault(const sim::Model& model, const control::Roles& roles, const GaitClock& gait, double height, const VaultShape& shape) {
  const body::Skeleton& sk = model.character.skeleton;
  const double tick = gait.run->tick, gravity = gait.run->simulation.gravity;
  const int flight = shape.flight_ticks;
  const int fly_at = gait.take_off - gait.left_step, land_at = fly_at + flight, end = land_at + gait.next_right_step - gait.landing,
            ticks = end + gait.ticks();
  const auto clock = [&](double t) { return t <= fly_at ? gait.left_step + t : gait.landing + (t - land_at); };
  // Slower over the box, and with its middle under the root halfway.
  const auto pace = [&](double t) {
    const double u = (t - fly_at + 10) / 20, w = (t - land_at + 10) / 20;
    return shape.speed + (shape.slowest - shape.speed) * (motion::smoothstep(std::clamp(u, 0.0, 1.0)) - motion::smoothstep(std::clamp(w, 0.0, 1.0)));
  };
  std::vector<double> path(static_cast<std::size_t>(ticks) + 1, 0);
  for (std::size_t t = 1; t < path.size(); ++t) path[t] = path[t - 1] + tick * pace(static_cast<double>(t) - 0.5);
  const double middle = 0.5 * shape.depth;
  const double shift = middle - path[static_cast<std::size_t>(fly_at + flight / 2)];
  for (double& x : path) x += shift;

  Eigen::MatrixXd poses(model.nq, ticks + 1);
  for (int t = 0; t <= ticks; ++t)
    if (t <= fly_at || t >= land_at) {
      poses.col(t) = gait.pose(clock(t));
      poses(0, t) += path[static_cast<std::size_t>(t)];
    }
  const double seconds = flight * tick;
  // The last stance already pushes off as hard as that: the root rises along a parabola that meets the flight's.
  {
    const int push = 12;
    const double upwards = 0.5 * gravity * seconds, gait_upwards = (poses(2, fly_at) - poses(2, fly_at - 2)) / (2 * tick);
    for (int t = fly_at - push; t <= fly_at; ++t) {
      const double u = static_cast<double>(t - (fly_at - push)) / push;
      poses(2, t) += 0.5 * (upwards - gait_upwards) * push * tick * u * u * u / 1.5;
    }
  }
  const double from = poses(2, fly_at), to = poses(2, land_at);
  const double rise = (to - from) / seconds + 0.5 * gravity * seconds;
  const auto ballistic = [&](double u) { return from + seconds * u * (rise - 0.5 * gravity * seconds * u); };

  std::vector<motion::Keyframe> keys;
  const auto key_at = [&](int t, const Eigen::VectorXd& pose) {
    motion::Keyframe k;
    k.time = (t - (fly_at - 12)) * tick;
    k.pose = pose;
    keys.push_back(k);
  };
  for (int t = fly_at - 12; t <= fly_at; t += 4) key_at(t, poses.col(t));
  const auto hands = control::find_hands(model);
  const auto joint_of = [&](int b) { return model.bodies[static_cast<std::size_t>(b)].joint; };
  const auto turn = [&](Eigen::VectorXd& q, int b, const Vector3<double>& degrees) {
    const sim::MovingBody& m = model.bodies[static_cast<std::size_t>(b)];
    core::exp_map((std::numbers::pi / 180) * degrees).store(q.data() + m.q_index);
  };
  const auto bend = [&](Eigen::VectorXd& q, int b, double degrees) { q[model.bodies[static_cast<std::size_t>(b)].q_index] = degrees * std::numbers::pi / 180; };
  const int right = roles.legs[0].foot, left = roles.legs[1].foot;
  struct Way {
    double at;                       // of the flight
    double lean, pitch;              // deg, of the root
    Vector3<double> left, right;     // ankles: x from the root, y, z over the box
    bool hand;
  };
  const Vector3<double> hold{middle, -0.26, height + 0.045};
  const std::vector<Way> ways{
      {0.22, 8, 20, {0.38, 0.20, 0.20}, {-0.45, -0.02, -0.35}, true},
      {0.37, 16, 18, {0.45, 0.24, 0.26}, {-0.27, 0.10, 0.18}, true},
      {0.52, 22, 15, {0.50, 0.26, 0.26}, {0.08, 0.20, 0.26}, true},
      {0.70, 14, 10, {0.42, 0.16, 0.08}, {0.16, 0.12, 0.24}, false},
  };
  for (const Way& w : ways) {
    const int t = fly_at + static_cast<int>(std::lround(w.at * flight));
    Eigen::VectorXd q = gait.pose(gait.take_off + w.at * (gait.landing - gait.take_off));
    q[0] = path[static_cast<std::size_t>(t)];
    q[1] = 0;
    q[2] = ballistic(w.at);
    core::exp_map((std::numbers::pi / 180) * Vector3<double>{w.lean, w.pitch, 0}).store(q.data() + 3);
    turn(q, roles.legs[1].hip, {20, -80, 0});
    bend(q, roles.legs[1].knee, 60);
    turn(q, roles.legs[0].hip, w.at < 0.3 ? Vector3<double>{0, 10, 0} : Vector3<double>{15, -75, 0});
    bend(q, roles.legs[0].knee, w.at < 0.3 ? 40 : 100);
    motion::Keyframe k;
    k.time = (t - (fly_at - 12)) * tick;
    k.pose = q;
    const auto pin = [&](int joint, const Vector3<double>& point, const Vector3<double>& at, double weight) {
      motion::KeyframePin p;
      p.joint = joint;
      p.point = point;
      p.target = at;
      p.weight = weight;
      k.pins.push_back(p);
    };
    pin(0, {0, 0, 0}, {q[0], q[1], q[2]}, 10);
    pin(joint_of(left), {0, 0, 0}, {q[0] + w.left.x, w.left.y, height + w.left.z}, 1);
    pin(joint_of(right), {0, 0, 0}, {q[0] + w.right.x, w.right.y, w.at < 0.3 ? q[2] - 0.7 : height + w.right.z}, 1);
    if (w.hand) pin(hands[0].joint, hands[0].point, hold, 3);
    keys.push_back(k);
  }
  for (int t = land_at; t <= land_at + 12; t += 4) key_at(t, poses.col(t));
  motion::KeyframeSolve solve;
  solve.stay = 3e-3;
  const motion::Clip clip = motion::from_keyframes("vault", sk, keys, 1 / tick, solve);
  for (int t = fly_at + 1; t < land_at; ++t) {
    poses.col(t) = clip.sample((t - (fly_at - 12)) * tick);
    poses(0, t) = path[static_cast<std::size_t>(t)];
  }

  Authored a;
  control::TrackingReference& r = a.reference;
  r.dt = tick;
  r.poses = poses;
  r.velocities.resize(model.nv, ticks + 1);
  const auto differentiate = [&] {
    for (int t = 0; t <= ticks; ++t) {
      const int before = std::max(t - 1, 0), after = std::min(t + 1, ticks);
      Eigen::VectorXd d(model.nv);
      body::difference(sk, r.poses.col(before).data(), r.poses.col(after).data(), d.data());
      r.velocities.col(t) = d / ((after - before) * tick);
    }
  };
  differentiate();
  control::measure_reference(model, roles, {}, r);
  // The centre of mass flies as gravity has it.
  const double lift_from = r.center_of_mass(2, fly_at), lift_to = r.center_of_mass(2, land_at);
  const double speed_up = (lift_to - lift_from) / seconds + 0.5 * gravity * seconds;
  for (int t = fly_at + 1; t < land_at; ++t) {
    const double s = (t - fly_at) * tick;
    r.poses(2, t) += lift_from + s * (speed_up - 0.5 * gravity * s) - r.center_of_mass(2, t);
  }
  r.poses.row(1).array() -= r.center_of_mass.row(1).mean();
  differentiate();
  control::measure_reference(model, roles, control::tracked_points(model, roles), r);

  const double lead = 0.1;
  const Eigen::MatrixXd led = control::led_targets(model, r, lead);
  a.targets.resize(model.nq, ticks);
  a.stance.assign(static_cast<std::size_t>(ticks), 0);
  a.phase = a.parts = a.stance;
  for (int t = 0; t < ticks; ++t) {
    const auto k = static_cast<std::size_t>(t);
    const double g = clock(t);
    const bool flying = t >= fly_at - 4 && t < land_at - 4;
    a.targets.col(t) = flying ? led.col(t) : gait.target(g);
    a.targets.col(t).head(7) = r.poses.col(t).head(7);
    // From the step before, over take-off and the passing of the hand, to the landing and what follows it.
    a.phase[k] = a.parts[k] = t < gait.right_step - gait.left_step ? 0 : t < fly_at + flight / 2 ? 1 : t < land_at ? 2 : 3;
    a.stance[k] = t < gait.right_step - gait.left_step ? 1 : t < fly_at + flight / 2 ? 0 : t < end ? 1 : gait.run->stance[static_cast<std::size_t>(gait.of_period(g))];
  }
  a.end = end;
  a.regulated = end;
  a.depth = shape.depth;
  a.hold_from = fly_at + static_cast<int>(0.1 * flight);
  a.hold_to = land_at;
  return a;
}

}  // namespace terrain_runner
