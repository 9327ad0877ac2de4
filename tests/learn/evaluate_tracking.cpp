// SPDX-License-Identifier: MIT
#include <traceur/learn/evaluate_tracking.hpp>

#include <doctest/doctest.h>

#include "tracking_support.hpp"

using namespace traceur;
using namespace traceur::learn;
using namespace learn_test;

TEST_CASE("an evaluation counts one episode an environment and what is lost after an early end") {
  constexpr int width = core::lane_count<Lane>;
  const ReferenceMotion motion = make_reference_motion(humanoid(), roles(), wave(false), 30);
  core::SerialExecutor serial;
  TrackingSettings s;
  s.start = TrackingStart::begin;
  Tracking<Lane, core::SerialExecutor> task(humanoid(), roles(), {motion}, width, s, sim::Ground<float>(), {}, serial);
  // Lane 1 falls at its tenth step of thirty, lane 2 drifts at its twentieth, the others track perfectly.
  task.use({std::make_shared<Puppeteer>([&](int lane, int step, Eigen::VectorXf& q, Eigen::VectorXf& v) {
    const int t = std::min(step, 30);
    q = motion.poses.col(t);
    v = motion.velocities.col(t);
    if (lane == 1 && step >= 10) core::about_axis(core::Vector3<float>{0, 1, 0}, 2.0f).store(q.data() + 3);
    if (lane == 2 && step >= 20) q[1] += 3;
  })});
  int asked = 0;
  const auto found = evaluate_tracking(task, 1, [&](ConstColumns<float> x, Columns<float> y) {
    CHECK(x.cols() == width);
    ++asked;
    y.setZero();
  });
  REQUIRE(found.size() == 1);
  CHECK(asked == 30);
  CHECK(found[0].episodes == width);
  CHECK(found[0].completed == width - 2);
  CHECK(found[0].falls == 1);
  CHECK(found[0].drifts == 1);
  CHECK(found[0].failures == 0);
  const double steps = 30.0 * (width - 2) + 9 + 19;
  CHECK(found[0].normalized_return == doctest::Approx(steps / (30.0 * width)).epsilon(1e-4));
  CHECK(found[0].seconds == doctest::Approx(steps / width / 30));
  CHECK(found[0].joint_error_m < 1e-5);
}
