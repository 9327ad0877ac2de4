// SPDX-License-Identifier: MIT
#include <traceur/learn/evaluate_locomotion.hpp>

#include <memory>
#include <vector>

#include <doctest/doctest.h>

#include "tracking_support.hpp"

using namespace traceur;
using namespace traceur::learn;
using namespace learn_test;
using doctest::Approx;

TEST_CASE("errors, falls and bands of speed are counted") {
  constexpr int width = core::lane_count<Lane>;
  core::SerialExecutor serial;
  LocomotionSettings s;
  s.start = LocomotionStart::spread;
  s.episode_s = 4;
  s.task.slowest = 1;
  s.task.fastest = 4;
  const std::vector<ReferenceMotion> motions{make_reference_motion(humanoid(), roles(), wave(true, 1), 30)};
  Locomotion<Lane, core::SerialExecutor> task(humanoid(), roles(), motions, width, s, sim::Ground<float>(), {}, serial);
  // Everyone goes a fifth of a metre a second faster than wanted; lane 0 falls after two steps.
  task.use({std::make_shared<Puppeteer>([&](int lane, int step, Eigen::VectorXf& q, Eigen::VectorXf& v) {
    q = motions[0].poses.col(0);
    v = Eigen::VectorXf::Zero(humanoid().nv);
    v[0] = task.goal(lane).speed + 0.2f;
    if (lane == 0 && step > 2) q[2] = -0.5f;
  })});
  int asked = 0;
  const auto bands = evaluate_locomotion(task, 1, [&](ConstColumns<float> x, Columns<float> y) {
    CHECK(x.rows() == task.observations());
    y.setZero();
    ++asked;
  });
  CHECK(asked == 120);
  REQUIRE(bands.size() == 4);
  const LocomotionEvaluation& all = bands[0].result;
  CHECK(all.episodes == width);
  CHECK(all.completed == width - 1);
  CHECK(all.falls == 1);
  CHECK(all.failures == 0);
  CHECK(all.speed_error_m_s == Approx(0.2).epsilon(1e-3));
  CHECK(all.greatest_error_m_s == Approx(0.2).epsilon(1e-3));
  CHECK(all.seconds == Approx((120.0 * (width - 1) + 3) / width / 30).epsilon(1e-3));
  const double right = 0.7 * std::exp(-0.25 * 0.04) + 0.3;
  CHECK(all.normalized_return == Approx(right * (120.0 * (width - 1) + 2) / (120.0 * width)).epsilon(1e-3));
  CHECK(bands[1].slowest == 1);
  CHECK(bands[1].fastest == Approx(2));
  CHECK(bands[1].result.falls == 1);
  CHECK(bands[3].fastest == 4);
  CHECK(bands[1].result.episodes + bands[2].result.episodes + bands[3].result.episodes == width);
}
