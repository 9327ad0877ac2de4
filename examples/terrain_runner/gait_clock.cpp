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

}  // namespace terrain_runner
