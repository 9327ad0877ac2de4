// SPDX-License-Identifier: MIT
#include "../common/lane.hpp"
#include "right_hand.hpp"
#include "skills.hpp"
#include "traceur/control/regulator_practice.hpp"

namespace terrain_runner {

using namespace traceur;
using example::Lane;

namespace {

control::SimulatedMotion motion_of(const sim::Model& model, const control::Roles& roles, const control::Controller& gait, const MotionFamily& family, std::size_t k) {
  const control::Controller c = family.controller(model, roles, gait, k);
  return {c.targets, c.reference.poses, c.reference.velocities};
}

/// Does something with the practice of the k-th motion of a family and the starts it begins from.
template <class Do>
auto with_practice(const Regulated& of, const control::PracticeSettings& settings, Do&& something) {
  const sim::Model& model = *of.model;
  const MotionFamily& family = *of.family;
  const RegulatedStarts& starts = *of.starts;
  const control::SimulatedMotion motion = motion_of(model, of.roles, *of.gait, family, of.k);
  const RightHand hand(model, family.hold_from, family.hold_to);
  const sim::Ground<float> ground = ground_of(of.hurdle);
  control::RegulatorSettings regulator;
  regulator.place_until = family.placed;
  const control::RegulatorPractice<Lane, RightHand> practice(model, of.roles, of.gait->simulation, ground, hand.extras, motion, family.end, of.gait->steps_per_tick,
                                                             regulator, settings, hand);
  const auto begin = [&](core::RandomStream& random) {
    control::PracticeStart s{{motion.poses.col(0), motion.velocities.col(0)}};
    double off = 0;
    if (!starts.states.empty()) {
      const control::RunningState& from = starts.states[static_cast<std::size_t>(random.next_u32()) % starts.states.size()];
      s.pose = from.pose;
      s.velocity = from.velocity;
      s.pose[0] += from.off - starts.distance;
      off = from.off;
    }
    const double moved = starts.place * random.uniform(-1.0, 1.0);
    s.pose[0] += moved;
    s.along = std::clamp(off + moved, -starts.slide, starts.slide);
    for (int i = 0; i < 3; ++i) s.velocity[i] += starts.velocity * random.uniform(-1.0, 1.0);
    Eigen::VectorXd d = Eigen::VectorXd::Zero(model.nv);
    for (int i = 6; i < model.nv; ++i) d[i] = starts.joint_angle * random.uniform(-1.0, 1.0);
    body::displace(model.character.skeleton, s.pose.data(), d.data(), s.pose.data());
    return s;
  };
  return something(practice, begin);
}

}  // namespace

control::PractisedRegulator practise(const Regulated& of, const control::PracticeSettings& settings, core::ThreadExecutor& executor) {
  return with_practice(of, settings, [&](const auto& practice, const auto& begin) { return practice.run(begin, executor); });
}

control::RefinedTargets refine(const Regulated& of, const std::vector<control::Gain>& gains, const control::PracticeSettings& settings,
                               const control::RefinementSettings& refinement, core::ThreadExecutor& executor) {
  return with_practice(of, settings, [&](const auto& practice, const auto& begin) { return practice.refine(gains, refinement, begin, executor); });
}

control::TrackingRegulator make_regulator(const sim::Model& model, const control::Roles& roles, const control::Controller& gait, const MotionFamily& family) {
  std::vector<control::SimulatedMotion> motions;
  for (std::size_t k = 0; k < family.heights.size(); ++k) motions.push_back(motion_of(model, roles, gait, family, k));
  return {model, roles, family.heights, std::move(motions), family.gains};
}

}  // namespace terrain_runner
