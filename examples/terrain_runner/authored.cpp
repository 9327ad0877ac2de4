// SPDX-License-Identifier: MIT
#include "authored.hpp"

#include <cmath>

#include "traceur/control/pd_targets.hpp"

namespace terrain_runner {

using namespace traceur;

Passage::Passage(const GaitClock& clock, int middle, int steps_after, int steps_beyond) : gait(&clock) {
  const auto in_time = [&](int gait_ticks) { return static_cast<int>(std::lround(gait_ticks / clock.rate)); };
  step_at = in_time(clock.right_step - clock.left_step);
  fly_at = in_time(clock.take_off - clock.left_step);
  land_at = fly_at + middle;
  stand_at = land_at + in_time(clock.next_right_step - clock.landing);
  end = stand_at + in_time(clock.ticks() * steps_after / 2);
  ticks = end + in_time(clock.ticks() * steps_beyond / 2);
}

double Passage::clock(int tick) const {
  return tick <= fly_at ? gait->left_step + gait->rate * tick : gait->landing + gait->rate * (tick - land_at);
}

int Passage::stance(int tick) const { return gait->run->stance[static_cast<std::size_t>(gait->of_period(clock(tick) + 1e-6))]; }

Eigen::MatrixXd Passage::run(const std::function<double(double)>& pace) const {
  Eigen::MatrixXd poses = Eigen::MatrixXd::Zero(gait->model->nq, ticks + 1);
  double x = 0;
  for (int t = 0; t <= ticks; ++t) {
    if (t > 0) x += gait->run->tick * pace(t - 0.5);
    if (running(t)) poses.col(t) = gait->pose(clock(t));
    poses(0, t) += x;
  }
  return poses;
}

control::TrackingReference Passage::reference(const Eigen::MatrixXd& poses, const control::Roles& roles) const {
  control::TrackingReference r;
  r.dt = gait->run->tick;
  r.poses = poses;
  differentiate(*gait->model, roles, {}, r);
  return r;
}

Authored Passage::author(control::TrackingReference reference, const control::Roles& roles) const {
  const sim::Model& model = *gait->model;
  Authored a;
  a.reference = std::move(reference);
  control::TrackingReference& r = a.reference;
  r.poses.row(1).array() -= r.center_of_mass.row(1).mean();
  differentiate(model, roles, control::tracked_points(model, roles), r);
  const Eigen::MatrixXd led = control::led_targets(model, r, 0.1);
  a.targets.resize(model.nq, ticks);
  for (int t = 0; t < ticks; ++t) {
    const bool own = t >= fly_at - 4 && t < land_at - 4;
    a.targets.col(t) = own ? led.col(t) : gait->target(clock(t));
    a.targets.col(t).head(7) = r.poses.col(t).head(7);
  }
  a.stance.assign(static_cast<std::size_t>(ticks), 0);
  a.phase = a.parts = a.stance;
  for (int t = 0; t < ticks; ++t)
    if (running(t)) a.stance[static_cast<std::size_t>(t)] = stance(t);
  a.end = end;
  return a;
}

}  // namespace terrain_runner
