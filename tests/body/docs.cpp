// SPDX-License-Identifier: MIT
// The code of docs/body.md.
#include <vector>

#include <doctest/doctest.h>

#include <traceur/body/momentum.hpp>
#include <traceur/body/proportions.hpp>
#include <traceur/body/pose.hpp>

using namespace traceur::body;

TEST_CASE("docs/body.md") {
  Character swing;  // a rod of 2 kg and 1 m that hangs from a free sphere of 1 kg
  Joint root, rod;
  root.name = root.body = "root";
  root.type = JointType::free;
  rod.name = rod.body = "rod";
  rod.type = JointType::hinge;
  rod.axis = {0, 1, 0};
  rod.parent = swing.skeleton.add(root);
  swing.skeleton.add(rod);
  swing.inertias = {{1, {0, 0, 0}, {0.01, 0.01, 0.01, 0, 0, 0}}, {2, {0, 0, -0.5}, {0.17, 0.17, 0.001, 0, 0, 0}}};
  swing.actuators.resize(2);
  check_character(swing, "swing");

  Eigen::VectorXd q = swing.skeleton.neutral_pose();
  Eigen::VectorXd v = Eigen::VectorXd::Zero(swing.skeleton.nv());
  v[6] = 3.0;  // the hinge's rate, rad/s
  Frames<double> frames(swing.skeleton);
  Twists<double> twists(swing.skeleton);
  forward_kinematics(swing.skeleton, q.data(), frames);
  forward_velocities(swing.skeleton, frames, v.data(), twists);
  const Momentum<double> m = momentum(swing, frames, twists);  // m.linear is (-3, 0, 0)
  CHECK(norm(m.linear - traceur::core::Vector3<double>{-3, 0, 0}) < 1e-14);

  std::vector<SegmentScale> scales(static_cast<std::size_t>(swing.skeleton.size()));
  scales[1] = {1.5, 1.0, 1.0};
  const Character longer = with_proportions(swing, scales);  // the rod weighs 3 kg
  CHECK(longer.inertias[1].mass == doctest::Approx(3));
}
