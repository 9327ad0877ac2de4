// SPDX-License-Identifier: MIT
#include "../common/lane.hpp"
#include "right_hand.hpp"
#include "skills.hpp"
#include "traceur/control/tracking_regulator.hpp"

namespace terrain_runner {

using namespace traceur;
using example::Lane;

namespace {

std::vector<Eigen::MatrixXd> gains_of(sim::Lanes<Lane>& lanes, const sim::Model& model, const control::SimulatedMotion& motion, int steps_per_tick,
                                      const MotionFamily& family, std::size_t k, const RightHand& hand) {
  control::RegulatorSettings settings;
  settings.place_until = family.placed;
  if (!family.effort.empty()) settings.effort = family.effort[k];
  return control::regulator_gains(control::linearize(lanes, model, motion, steps_per_tick, settings, hand),
                                  control::regulator_costs(model, settings, motion.ticks()), settings.effort);
}

}  // namespace

double regulated_share(const sim::Model& model, const control::Roles& roles, const control::Controller& gait, const control::Hurdle& hurdle,
                       const MotionFamily& family, std::size_t k, const RegulatedStarts& starts) {
  constexpr int width = core::lane_count<Lane>;
  const control::Controller c = family.controller(model, roles, gait, k);
  const control::SimulatedMotion motion{c.targets, c.reference.poses, c.reference.velocities};
  const RightHand hand(model, family.hold_from, family.hold_to);
  const sim::Ground<float> ground = ground_of(hurdle);
  sim::Lanes<Lane> lanes(model, gait.simulation, ground, hand.extras);
  std::vector<Eigen::MatrixXd> gains = gains_of(lanes, model, motion, gait.steps_per_tick, family, k, hand);
  gains.resize(static_cast<std::size_t>(family.end));
  const control::TrackingRegulator regulator(model, roles, {1}, {motion}, {gains});
  control::TrackingRegulator::Scratch scratch = control::TrackingRegulator::scratch(model);
  Eigen::VectorXd q(model.nq), d(model.nv);
  int kept = 0, all = 0;
  for (int first = 0; first < starts.count; first += width) {
    std::array<bool, static_cast<std::size_t>(width)> up;
    up.fill(true);
    for (int l = 0; l < width; ++l) {
      core::RandomStream random(starts.seed, 9000, static_cast<std::uint64_t>(first + l));
      control::RunningStart s{c.start_pose, c.start_velocity};
      s.pose[0] += starts.place * random.uniform(-1.0, 1.0);
      for (int i = 0; i < 3; ++i) s.velocity[i] += starts.velocity * random.uniform(-1.0, 1.0);
      d.setZero();
      for (int i = 6; i < model.nv; ++i) d[i] = starts.joint_angle * random.uniform(-1.0, 1.0);
      body::displace(model.character.skeleton, s.pose.data(), d.data(), s.pose.data());
      control::RunningTrials<Lane>::put(lanes, model, l, s);
    }
    lanes.refresh();
    for (int t = 0; t < family.end; ++t) {
      for (int l = 0; l < width; ++l) {
        for (int i = 7; i < model.nq; ++i) core::set_lane(lanes.target()[i], l, static_cast<float>(motion.targets(i, t)));
        regulator.apply(lanes, l, 1, t, {}, false, scratch);
      }
      lanes.step(gait.steps_per_tick);
      hand(lanes, t);
      for (int l = 0; l < width; ++l) {
        for (int i = 0; i < model.nq; ++i) q[i] = core::lane_of(lanes.q()[i], l);
        const auto of = static_cast<std::size_t>(l);
        up[of] = up[of] && q.allFinite() && !lanes.failed(l);
        if (!up[of]) continue;
        body::difference(model.character.skeleton, motion.poses.col(t + 1).data(), q.data(), d.data());
        up[of] = d[2] > -0.35 && d.segment(3, 3).norm() < 1.15;
      }
    }
    for (int l = 0; l < width && first + l < starts.count; ++l) {
      kept += up[static_cast<std::size_t>(l)];
      ++all;
    }
  }
  return static_cast<double>(kept) / all;
}

control::TrackingRegulator make_regulator(const sim::Model& model, const control::Roles& roles, const control::Controller& gait, Kind kind,
                                          const MotionFamily& family, core::ThreadExecutor& executor) {
  const RightHand hand(model, family.hold_from, family.hold_to);
  std::vector<control::SimulatedMotion> motions(family.heights.size());
  std::vector<std::vector<Eigen::MatrixXd>> gains(family.heights.size());
  executor.run(static_cast<int>(family.heights.size()), [&](int job, int) {
    const auto k = static_cast<std::size_t>(job);
    const control::Controller c = family.controller(model, roles, gait, k);
    motions[k] = {c.targets, c.reference.poses, c.reference.velocities};
    const sim::Ground<float> ground = ground_of(hurdle_of(kind, family.heights[k], family.depth));
    sim::Lanes<Lane> lanes(model, gait.simulation, ground, hand.extras);
    gains[k] = gains_of(lanes, model, motions[k], gait.steps_per_tick, family, k, hand);
    gains[k].resize(static_cast<std::size_t>(family.end));
  });
  return {model, roles, family.heights, std::move(motions), gains};
}

}  // namespace terrain_runner
