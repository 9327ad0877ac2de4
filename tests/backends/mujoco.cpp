// SPDX-License-Identifier: MIT
#include <traceur/backends/mujoco.hpp>

#include "conformance.hpp"

TEST_CASE("MuJoCo is a simulator") {
  conformance::Bounds bounds;
  // Its Euler step lets what a body does within itself move the whole a little.
  bounds.fall = 0.002;
  conformance::conforms<traceur::backends::Mujoco>(bounds);
}

TEST_CASE("MuJoCo's given ground is the spring and the damper of the parameters") {
  using traceur::backends::Mujoco;
  using traceur::backends::MujocoGround;
  const auto c = scene::box({0.2, 0.2, 0.05}, 5);
  traceur::sim::Parameters p;
  p.dt = 1.0 / 960;
  p.contact_stiffness = 1e4;
  Mujoco given(c, 1, p, {}, MujocoGround::given), stiff(c, 1, p, {});
  Eigen::VectorXd q = c.skeleton.neutral_pose();
  q[2] = 0.05;
  for (Mujoco* w : {&given, &stiff}) {
    w->reset(0, q, Eigen::VectorXd::Zero(6));
    w->step(1920);
  }
  // On four corners.
  const double depth = 5 * p.gravity / (4 * p.contact_stiffness);
  CHECK(0.05 - conformance::pose(given)[2] == doctest::Approx(depth).epsilon(0.03));
  CHECK(0.05 - conformance::pose(stiff)[2] < 0.1 * depth);
  // A damper of 4 x 1000 N s/m over 4 x 10^4 N/m lets it sink in with a time of 0.1 s.
  given.reset(0, q, Eigen::VectorXd::Zero(6));
  given.step(96);
  CHECK(0.05 - conformance::pose(given)[2] == doctest::Approx(depth * (1 - std::exp(-1.0))).epsilon(0.1));
}
