// SPDX-License-Identifier: MIT
#include <traceur/control/sole_slide.hpp>

#include <cmath>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace figures;

TEST_CASE("soles that glide: what they carry, times the speed of the feet; none in the air") {
  using S = core::Pack<float, 4>;
  const Figure& f = humanoid();
  sim::Parameters simulation;
  simulation.friction = 0;
  const sim::Ground<float> ground;
  sim::Lanes<S> lanes(f.model, simulation, ground);
  const Eigen::VectorXd stands = standing_pose();
  for (int lane = 0; lane < 4; ++lane) {
    Eigen::VectorXd q = stands, v = at_rest(f);
    v[0] = 0.1 * lane;
    v[1] = -0.2 * lane;
    if (lane == 3) q[2] += 1;
    put(lanes, lane, q, v);
    for (int k = 7; k < f.model.nq; ++k) core::set_lane(lanes.target()[k], lane, static_cast<float>(stands[k]));
  }
  // Until the feet have settled into the ground.
  lanes.step(40);
  double slide[4] = {}, load[4] = {}, glide[4] = {};
  constexpr int steps = 20;
  sim::Lanes<S> whole = lanes;
  for (int k = 0; k < steps; ++k) {
    for (int lane = 0; lane < 4; ++lane)
      for (const auto& leg : f.roles.legs) {
        const auto& v = lanes.work().bodies[static_cast<std::size_t>(leg.foot)].linear;
        glide[lane] += std::hypot(core::lane_of(v.x, lane), core::lane_of(v.y, lane)) / (2 * steps);
      }
    lanes.step(1);
    const sim::LoadedSlide<S> soles = control::sole_slide(lanes, f.roles);
    for (int lane = 0; lane < 4; ++lane) {
      slide[lane] += static_cast<double>(core::lane_of(soles.sum, lane)) / steps;
      load[lane] += static_cast<double>(core::lane_of(soles.load, lane)) / steps;
    }
  }
  // All steps at once give their mean.
  whole.step(steps);
  const sim::LoadedSlide<S> mean = control::sole_slide(whole, f.roles);
  for (int lane = 0; lane < 4; ++lane) {
    CHECK(core::lane_of(mean.sum, lane) == doctest::Approx(slide[lane]).epsilon(1e-3));
    CHECK(core::lane_of(mean.load, lane) == doctest::Approx(load[lane]).epsilon(1e-3));
  }
  const double weight = f.model.total_mass * 9.81;
  for (int lane = 0; lane < 3; ++lane) {
    CAPTURE(lane);
    CHECK(load[lane] == doctest::Approx(weight).epsilon(0.1));
    CHECK(slide[lane] / load[lane] == doctest::Approx(glide[lane]).epsilon(0.05));
  }
  CHECK(glide[2] > glide[0] + 0.2);
  CHECK(slide[3] == 0);
  CHECK(load[3] == 0);
}
