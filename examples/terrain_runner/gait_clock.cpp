// SPDX-License-Identifier: MIT
#include "gait_clock.hpp"

#include <cmath>

#include "traceur/core/error.hpp"

namespace terrain_runner {

using namespace traceur;

GaitClock::GaitClock(const sim::Model& m, const control::Controller& c, const GaitEvents& events) : model(&m), run(&c) {
  const int n = c.ticks();
  left_step = right_step = -1;
  for (int t = 0; t < n; ++t) {
    const int before = c.stance[static_cast<std::size_t>((t + n - 1) % n)], now = c.stance[static_cast<std::size_t>(t)];
    if (before == 0 && now == 1) left_step = t;
    if (before == 1 && now == 0) right_step = t;
  }
  if (left_step < 0 || right_step < 0) throw Error("manoeuvre: expected a gait of two steps");
  const auto after = [&](int tick, int earlier) { return earlier + (((tick - earlier) % n) + n) % n; };
  right_step = after(right_step, left_step);
  take_off = after(events.right_take_off, right_step);
  landing = after(events.left_landing, take_off);
  next_right_step = after(right_step, landing);
}

int GaitClock::of_period(double tick) const {
  const int n = ticks();
  return static_cast<int>(std::floor(tick - n * std::floor(tick / n))) % n;
}

double GaitClock::speed() const { return (run->reference.poses(0, ticks()) - run->reference.poses(0, 0)) / (ticks() * run->tick); }

Eigen::VectorXd GaitClock::pose(double tick) const {
  const control::TrackingReference& r = run->reference;
  const int n = ticks();
  const double p = tick - n * std::floor(tick / n);
  const int t = std::min(static_cast<int>(p), n - 1);
  Eigen::VectorXd q(model->nq);
  body::interpolate(model->character.skeleton, r.poses.col(t).data(), r.poses.col(t + 1).data(), p - t, q.data());
  q[0] -= r.poses(0, 0) + speed() * run->tick * p;
  return q;
}

Eigen::VectorXd GaitClock::target(double tick) const {
  const int n = ticks();
  const double p = tick - n * std::floor(tick / n);
  const int t = std::min(static_cast<int>(p), n - 1);
  Eigen::VectorXd q(model->nq);
  body::interpolate(model->character.skeleton, run->targets.col(t).data(), run->targets.col((t + 1) % n).data(), p - t, q.data());
  return q;
}

void differentiate(const sim::Model& model, const control::Roles& roles, const std::vector<control::TrackedPoint>& points,
                   control::TrackingReference& r) {
  const Eigen::Index last = r.poses.cols() - 1;
  r.velocities.resize(model.nv, last + 1);
  Eigen::VectorXd d(model.nv);
  for (Eigen::Index t = 0; t <= last; ++t) {
    const Eigen::Index before = std::max<Eigen::Index>(t - 1, 0), after = std::min(t + 1, last);
    body::difference(model.character.skeleton, r.poses.col(before).data(), r.poses.col(after).data(), d.data());
    r.velocities.col(t) = d / (static_cast<double>(after - before) * r.dt);
  }
  control::measure_reference(model, roles, points, r);
}

void fly(control::TrackingReference& r, int from, int to, double gravity) {
  const double seconds = (to - from) * r.dt, lift_from = r.center_of_mass(2, from), lift_to = r.center_of_mass(2, to);
  const double upwards = (lift_to - lift_from) / seconds + 0.5 * gravity * seconds;
  for (int t = from + 1; t < to; ++t) {
    const double s = (t - from) * r.dt;
    r.poses(2, t) += lift_from + s * (upwards - 0.5 * gravity * s) - r.center_of_mass(2, t);
  }
}

}  // namespace terrain_runner
