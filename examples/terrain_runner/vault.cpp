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

Authored author_vault(const sim::Model& model, const control::Roles& roles, const GaitClock& gait, double height, const VaultShape& shape) {
  const body::Skeleton& sk = model.character.skeleton;
  const double tick = gait.run->tick, gravity = gait.run->simulation.gravity;
  const int flight = shape.flight_ticks;
  const Passage passage(gait, flight, shape.steps_after, shape.steps_beyond);
  const int fly_at = passage.fly_at, land_at = passage.land_at;
  // Slower over the box, and with its middle under the root halfway.
  const auto pace = [&](double t) {
    const double u = (t - fly_at + 10) / 20, w = (t - land_at + 10) / 20;
    return shape.speed + (shape.slowest - shape.speed) * (motion::smoothstep(std::clamp(u, 0.0, 1.0)) - motion::smoothstep(std::clamp(w, 0.0, 1.0)));
  };
  Eigen::MatrixXd poses = passage.run(pace);
  const double middle = 0.5 * shape.depth;
  poses.row(0).array() += middle - poses(0, fly_at + flight / 2);
  const Eigen::VectorXd path = poses.row(0);

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
  // Over a high box one leans on the hand, legs beside the hips, and the trailing leg has farther to come.
  const double high = std::clamp((height - shape.leans_from) / 0.2, 0.0, 1.0);
  const std::vector<Way> ways{
      {0.22, 8 + 8 * high, 20, {0.38, 0.20, 0.20 - 0.08 * high}, {-0.45, -0.02, -0.35}, true},
      {0.37, 16 + 14 * high, 18, {0.45, 0.24 + 0.10 * high, 0.26 - 0.06 * high}, {-0.27, 0.10, 0.18 - 0.20 * high}, true},
      {0.52, 22 + 18 * high, 15, {0.50, 0.26 + 0.14 * high, 0.26 - 0.06 * high}, {0.08, 0.20 + 0.08 * high, 0.26 - 0.06 * high}, true},
      {0.70, 14 + 10 * high, 10, {0.42, 0.16 + 0.06 * high, 0.08 - 0.08 * high}, {0.16, 0.12 + 0.04 * high, 0.24 - 0.08 * high}, false},
  };
  for (const Way& w : ways) {
    const int t = fly_at + static_cast<int>(std::lround(w.at * flight));
    Eigen::VectorXd q = gait.pose(gait.take_off + w.at * (gait.landing - gait.take_off));
    q[0] = path[t];
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
    pin(joint_of(right), {0, 0, 0}, {q[0] + w.right.x, w.right.y, w.at < 0.3 ? q[2] - 0.7 + 0.2 * high : height + w.right.z}, 1);
    if (w.hand) pin(hands[0].joint, hands[0].point, hold, 3);
    keys.push_back(k);
  }
  for (int t = land_at; t <= land_at + 12; t += 4) key_at(t, poses.col(t));
  motion::KeyframeSolve solve;
  solve.stay = 3e-3;
  const motion::Clip clip = motion::from_keyframes("vault", sk, keys, 1 / tick, solve);
  for (int t = fly_at + 1; t < land_at; ++t) {
    poses.col(t) = clip.sample((t - (fly_at - 12)) * tick);
    poses(0, t) = path[t];
  }

  control::TrackingReference r = passage.reference(poses, roles);
  fly(r, fly_at, land_at, gravity);
  Authored a = passage.author(std::move(r), roles);
  // From the step before, over take-off and the passing of the hand, to the landing and what follows it.
  const int step_at = passage.step_at, passed_at = fly_at + flight / 2;
  for (int t = 0; t < passage.ticks; ++t) {
    const auto k = static_cast<std::size_t>(t);
    a.phase[k] = a.parts[k] = t < step_at ? 0 : t < passed_at ? 1 : t < land_at ? 2 : 3;
    if (t >= step_at && t < passage.stand_at) a.stance[k] = t < passed_at ? 0 : 1;
  }
  a.depth = shape.depth;
  a.hold_from = fly_at + static_cast<int>(0.1 * flight);
  a.hold_to = a.placed = land_at;
  return a;
}

}  // namespace terrain_runner
